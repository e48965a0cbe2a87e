"""Write ``lab/__init__.pyi``: what ``import lab`` offers to type checkers, every option of a call in its signature.

Run it after an option or a public name has changed: until then a test fails.
"""

import ast
import builtins
import subprocess
import sys
from collections import defaultdict
from inspect import Parameter, getsource, signature, unwrap
from pathlib import Path
from textwrap import indent
from types import FunctionType, NoneType, UnionType
from typing import Annotated, Any, ForwardRef, Literal, Union, get_args, get_origin, get_overloads

import tyro

import lab
from lab.options.option_groups import Effects
from lab.options.option_texts import WIDER

STUB = Path(lab.__file__).with_name("__init__.pyi")


class Stub:
    """The text of a stub, and what it imports."""

    def __init__(self) -> None:
        self.imports = defaultdict[str, set[str]](set)
        self.sources = dict[str, str]()

    def named(self, module: str, name: str) -> str:
        """A name, imported from a module; a public one from where ``lab`` has it."""
        if module != "builtins" and name != Effects.__name__:
            self.imports[getattr(lab, name).__module__ if name in lab.__all__ else module].add(name)
        return name

    def spelled(self, hint: Any) -> str:
        """A type, as it is written; paths may be texts, and tuples of any length other sequences."""
        if isinstance(hint, str | ForwardRef):
            return self.as_written(hint if isinstance(hint, str) else hint.__forward_arg__)
        if isinstance(hint, list):  # arguments of a callable
            return f"[{', '.join(map(self.spelled, hint))}]"
        origin, args = get_origin(hint), get_args(hint)
        if origin is Annotated:
            return self.spelled(args[0])
        if origin is Literal:
            return f"{self.named('typing', 'Literal')}[{', '.join(map(_quoted, args))}]"
        if origin in (Union, UnionType):
            return " | ".join(dict.fromkeys(" | ".join(map(self.spelled, args)).split(" | ")))
        if origin is tuple and args[1:] == (...,):
            return f"{self.named('collections.abc', 'Sequence')}[{self.spelled(args[0])}]"
        if origin is not None:
            inner = ", ".join(map(self.spelled, args))
            return f"{self.spelled(origin)}[{inner}]"
        if hint is NoneType or hint is None:
            return "None"
        if hint is Path:
            return f"str | {self.named('pathlib', 'Path')}"
        return self.named(hint.__module__, hint.__name__)

    def as_written(self, text: str) -> str:
        """A type that a module has as a text, for what it imports for type checkers alone."""
        for name in {each.id for each in ast.walk(ast.parse(text)) if isinstance(each, ast.Name)}:
            if name not in vars(builtins):
                self.named(self.sources.get(name) or getattr(lab, name).__module__, name)
        return text

    def parameter(self, each: Parameter) -> str:
        """An argument with its type and, where it may be written, its default."""
        if each.annotation is Parameter.empty:  # self
            return each.name
        kind = self.spelled(each.annotation)
        if each.kind is Parameter.KEYWORD_ONLY:
            kind += "".join(f" | {self.named('pathlib', wider)}" for wider in WIDER.get(each.name, ()))
        default = each.default
        if default is Parameter.empty:
            return f"{each.name}: {kind}"
        plain = isinstance(default, bool | int | float | str | None)
        return f"{each.name}: {kind} = {_quoted(default) if plain else '...'}"

    def function(self, name: str, call: FunctionType) -> str:
        """The definition of a call with all its options."""
        shown, module = signature(call), sys.modules[call.__module__]
        self.sources = {
            name.name: each.module
            for each in ast.walk(ast.parse(getsource(module)))
            if isinstance(each, ast.ImportFrom) and each.module
            for name in each.names
        }
        kinds = get_overloads(unwrap(call))
        if not kinds:
            return self.definition(name, list(shown.parameters.values()), shown.return_annotation)
        text = ""
        for own in map(signature, kinds):  # each with the options that all take
            narrower = {each.name: each for each in own.parameters.values() if each.kind is not Parameter.VAR_KEYWORD}
            parameters = [narrower.get(each.name, each) for each in shown.parameters.values()]
            text += f"@{self.named('typing', 'overload')}\n"
            text += self.definition(name, parameters, own.return_annotation)
        return text

    def definition(self, name: str, parameters: list[Parameter], returned: Any) -> str:
        """The definition of a call with these arguments."""
        lines, keyword = [], False
        for each in parameters:
            if each.kind is Parameter.KEYWORD_ONLY and not keyword:
                keyword = True
                lines.append("*")
            lines.append(self.parameter(each))
        body = "".join(f"    {line},\n" for line in lines)
        return f"def {name}(\n{body}) -> {self.spelled(returned)}: ...\n"

    def effects(self) -> str:
        """The definition of the class of all effects: type checkers do not see the options of its computed bases."""
        name, given = Effects.__name__, signature(Effects.__init__)
        self.imports[Effects.__module__].add(f"{name} as _{name}")
        init = self.definition("__init__", list(given.parameters.values()), given.return_annotation)
        return f"class {name}(_{name}):\n{indent(init, '    ')}\n"


def _quoted(value: object) -> str:
    return f'"{value}"' if isinstance(value, str) else repr(value)


def stub_text() -> str:
    """What the file must hold."""
    stub, calls = Stub(), list[str]()
    for name in lab.__all__:
        if name == "__version__":
            continue
        given = getattr(lab, name)
        if given is Effects:
            calls.append(stub.effects())
            continue
        inner = unwrap(given) if isinstance(given, FunctionType) else given
        if inner is not given and any(p.kind is Parameter.VAR_KEYWORD for p in signature(inner).parameters.values()):
            calls.append(stub.function(name, given))
        else:
            stub.named(given.__module__, name)
    imports = "".join(f"from {module} import {', '.join(names)}\n" for module, names in stub.imports.items())
    listed = "".join(f'    "{name}",\n' for name in lab.__all__)
    return _tidied("\n".join([imports, f"__all__ = [\n{listed}]\n", "__version__: str\n", *calls]))


def _tidied(text: str) -> str:
    """The text as ruff writes it."""
    for order in (["check", "--fix", "--quiet"], ["format", "--quiet"]):
        command = [sys.executable, "-m", "ruff", *order, f"--stdin-filename={STUB}", "-"]
        text = subprocess.run(
            command, input=text, capture_output=True, text=True, check=True, cwd=STUB.parents[1]
        ).stdout
    return text


def main() -> None:
    """Write the stub."""
    STUB.write_text(stub_text(), encoding="utf-8")


if __name__ == "__main__":
    tyro.cli(main, description=__doc__)
