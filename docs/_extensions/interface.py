"""The Python interface: a page for each object, from its docstring, its types and the options of its command.

The groups and the links of the pages are in docs/reference/interface.toml; the directive ``interface-index`` lists a
group.
"""

import inspect
import re
import textwrap
import tomllib
import types
from collections.abc import Iterator, Mapping
from dataclasses import MISSING, dataclass, fields, is_dataclass
from functools import cache, cached_property
from importlib import import_module
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal, Union, get_args, get_origin

from command_pages import escaped, heading, literal, meaning, table, unit_of, value, write_pages
from docutils import nodes
from docutils.statemachine import StringList
from sphinx.application import Sphinx
from sphinx.util.docutils import SphinxDirective

import lab
from lab.cli.commands import all_commands
from lab.cli.help_text import Option, grouped, options_of_command
from lab.options.command import Command
from lab.options.option_texts import OF_EVERY_CALL, WIDER, field_texts

REFERENCE = Path(__file__).parents[1] / "reference"
GROUPS, FOLDER = REFERENCE / "interface.toml", REFERENCE / "interface"
OWN = ("Criterion", "Estimator", "Sampler")  # classes of which a user writes subclasses
MADE = (*OWN, "Effects", "Instrument", "PosePlanner", "Targets")  # classes that a user calls
_OF_RESULTS = {
    "options": "Options of the call.", "robot": "The robot.", "warnings": "Warnings on the input and the result.",
}  # fmt: skip
_WIDTHS = (18, 24, 12, 46)
_SECTIONS = ("Args", "Attributes", "Returns", "Yields", "Raises", "Example", "Note", "Options")


@dataclass(frozen=True)
class Documented:
    """An object of the interface.

    Attributes:
        path: its name in ``lab``, or ``module:name`` of a class that ``lab`` does not name.
        see: pages that explain it.
        sources: where its method comes from; "" where it has no source of its own.
        only: of a class, the attributes and methods that are shown; empty for all.
    """

    path: str
    see: tuple[str, ...] = ()
    sources: str = ""
    only: tuple[str, ...] = ()

    @property
    def name(self) -> str:
        """Its name without its module, which is that of its page."""
        return self.path.rpartition(":")[2]

    @property
    def page(self) -> str:
        """The name of its page, which differs from that of every other in more than capitals."""
        return self.name if self.is_call else f"class_{self.name}"

    @property
    def full_name(self) -> str:
        """The name by which it is imported."""
        return self.path.replace(":", ".") if ":" in self.path else f"lab.{self.path}"

    @property
    def is_call(self) -> bool:
        """Whether it is a function."""
        return isinstance(self.value, types.FunctionType)

    @cached_property
    def value(self) -> Any:
        """The object itself."""
        module, _, name = self.path.rpartition(":")
        return getattr(import_module(module) if module else lab, name)

    @cached_property
    def sections(self) -> dict[str, str]:
        """The sections of its docstring."""
        return sections(inspect.getdoc(self.value) or "")


@cache
def documented() -> dict[str, tuple[Documented, ...]]:
    """Return the objects by the titles of their groups."""
    groups = tomllib.loads(GROUPS.read_text(encoding="utf-8"))["group"]
    return {
        each["title"]: tuple(
            Documented(path, tuple(about.get("see", ())), about.get("sources", ""), tuple(about.get("only", ())))
            for path, about in each["names"].items()
        )
        for each in groups
    }


@cache
def _by_name() -> dict[str, Documented]:
    return {each.name: each for group in documented().values() for each in group}


def sections(text: str) -> dict[str, str]:
    """Return a docstring's sections by their titles, and what precedes them as ""."""
    found, title = {"": list[str]()}, ""
    for line in text.splitlines():
        if (name := line.removesuffix(":")) in _SECTIONS and line.endswith(":"):
            title = name
            found[title] = []
        else:
            found[title].append(line)
    return {name: textwrap.dedent("\n".join(lines)).strip() for name, lines in found.items()}


def items(text: str) -> dict[str, str]:
    """Return the items ``name: text`` of a section, each on one line."""
    found, name = dict[str, str](), ""
    for line in text.splitlines():
        start = re.match(r"([\w*, ]+): (.*)", line)
        if start and not line.startswith(" "):
            name, found[start[1]] = start[1], start[2]
        elif name:
            found[name] += f" {line.strip()}"
    return {each.strip(): text for names, text in found.items() for each in names.split(",")}


def spelled(hint: Any) -> str:
    """Return a type as a person writes it."""
    if hint is inspect.Parameter.empty or hint is MISSING:
        return ""
    if isinstance(hint, list):  # the arguments of a function
        return f"[{', '.join(map(spelled, hint))}]"
    if isinstance(hint, str):
        return re.sub(r"\b(?:\w+\.)+(\w+)", r"\1", hint.replace("Array", "ndarray")).strip('"')
    origin, args = get_origin(hint), get_args(hint)
    if origin in (Annotated, ClassVar):
        return spelled(args[0])
    if origin is Literal:
        return " | ".join(f'"{each}"' for each in args)
    if origin in (Union, types.UnionType):
        if any(getattr(each, "__module__", "").startswith("numpy._typing") for each in map(_origin_or_self, args)):
            return "array_like | None" if types.NoneType in args else "array_like"
        parts = dict.fromkeys(part for each in args for part in spelled(each).split(" | "))
        return " | ".join(parts)
    if origin is tuple and args[1:] == (...,):
        return f"Sequence[{spelled(args[0])}]"
    if getattr(origin, "__name__", "") == "ndarray":
        return "ndarray"
    if origin is not None:
        inside = ", ".join("..." if each is ... else spelled(each) for each in args)
        return f"{getattr(origin, '__name__', origin)}[{inside}]"
    if hint is Path:
        return "Path"
    return "None" if hint is types.NoneType else getattr(hint, "__name__", str(hint))


def _origin_or_self(hint: Any) -> Any:
    return get_origin(hint) or hint


def linked(kind: str) -> str:
    """Return a type as markup, in which classes that have a page lead to it."""
    classes = [each.name for each in _by_name().values() if not each.is_call]
    parts = re.split(rf"""("[^"]*"|\b(?:{"|".join(classes)})\b)""", kind)
    shown = [
        escaped(part) if part not in classes and not part.startswith('"')
        else literal(part) if part.startswith('"') else f":py:class:`~{_by_name()[part].full_name}`"
        for part in parts
    ]  # fmt: skip
    return "\\ ".join(part for part in shown if part)


def command_of(each: Documented) -> Command | None:
    """Return the command whose options a call takes, or some of them."""
    kind = getattr(each.value, "option_class", None)
    return next((command for command in all_commands() if kind is command.load_options()), None)


def _parameters(call: Any) -> Mapping[str, inspect.Parameter]:
    return inspect.signature(call).parameters


def own_arguments(each: Documented) -> dict[str, str]:
    """Return the arguments of a call that are no options, with what its docstring says of them."""
    stated, shown = items(each.sections.get("Args", "")), _parameters(inspect.unwrap(each.value))
    plain = {name for name, one in shown.items() if one.kind is not one.VAR_KEYWORD}
    return {name: stated.get(name, "") for name in shown if name in plain}


def options_of_call(each: Documented) -> dict[str, tuple[Option | str, ...]]:
    """Return the options of a call by the groups of its command's help; the group of effects as its name."""
    command = command_of(each)
    if command is None:
        return {}
    own, taken = own_arguments(each), set(_parameters(each.value))
    found = dict[str, tuple[Option | str, ...]]()
    for title, options in grouped(command, options_of_command(command), every=True).items():
        names = dict[str, Option | str]()
        for one in options:
            if one.name in taken - {*own}:
                names[one.name] = one
            elif one.group in taken:
                names[one.group] = one.group
        if names:
            found[title.partition(",")[0] if "effects" in names else title] = tuple(names.values())
    every = tuple(Option(name, "", text) for name, text in OF_EVERY_CALL.items())
    left = taken - {*own} - {getattr(one, "name", one) for group in found.values() for one in group}
    alone = tuple(one for one in options_of_command(command) if one.name in left)
    return found | ({"files": alone} if alone else {}) | {"every call": every}


def _default(value: Any) -> str:
    if value is inspect.Parameter.empty or value is MISSING:
        return "required"
    plain = isinstance(value, bool | int | float | str | tuple | types.NoneType)
    return literal(repr(value)) if plain else ""


def _argument_row(name: str, one: inspect.Parameter, text: str) -> tuple[str, str, str, str]:
    kind = re.sub(r" \| \w*(?:Options|Campaign)\b", "", spelled(one.annotation))  # all options in one object
    unit = unit_of(name)
    shown = f"{linked(kind)}, {unit}" if unit else linked(kind)
    return literal(name), shown, _default(one.default), _prose(text[:1].upper() + text[1:])


def _option_row(each: Documented, option: Option | str) -> tuple[str, str, str, str]:
    name = option if isinstance(option, str) else option.name
    one = _parameters(each.value)[name]
    kind = re.sub(r"\bPath\b", "str | Path", spelled(one.annotation))
    kind = linked(" | ".join(dict.fromkeys([*kind.split(" | "), *WIDER.get(name, ())])))
    if isinstance(option, Option) and option.metavar.startswith("{"):
        kind = value(option)
    if one.default is None and "None" not in kind:
        kind += " \\| None"
    unit = unit_of(name)
    text = "Effects of the virtual arm, each with its unit." if isinstance(option, str) else option.help
    return literal(name), f"{kind}, {unit}" if unit else kind, _default(one.default), meaning(text, "{name}")


def _prose(text: str) -> str:
    """Return a docstring's prose, in which single backticks are code."""
    return re.sub(r"(?<!`)`([^`\n]+)`(?!`)", r"``\1``", text)


def call_page(each: Documented) -> str:
    """Return the page of a function."""
    text, own, groups = each.sections, own_arguments(each), options_of_call(each)
    shown, stated = _parameters(each.value), items(each.sections.get("Args", ""))
    titles = ("argument", "type, unit", "default", "meaning")
    places = []
    for name in own:
        one = shown[name]
        if one.kind is one.KEYWORD_ONLY and "*" not in places:
            places.append("*")
        places.append(name if one.default is one.empty else f"{name}={one.default!r}")
    gathered = [name for name, one in _parameters(inspect.unwrap(each.value)).items() if one.kind is one.VAR_KEYWORD]
    places += [f"**{name}" for name in gathered] if groups else []
    returned = spelled(inspect.signature(each.value).return_annotation)
    lines = [f".. py:function:: {each.full_name}({', '.join(places)})\n", textwrap.indent(_prose(text[""]), "   "), ""]
    lines += [heading("Arguments", "-")]
    lines += (
        [table(titles, (_argument_row(name, shown[name], said) for name, said in own.items()), _WIDTHS)] if own else []
    )
    if groups:
        said = stated.get(gathered[0], "")
        lines += [heading("Options", "-"), _prose(said[:1].upper() + said[1:]), ""]
    for title, options in groups.items():
        lines += [heading(title[0].upper() + title[1:], "~")]
        lines += [table(titles, (_option_row(each, one) for one in options), _WIDTHS)]
    if returned != "None" or "Returns" in text:
        lines += [heading("Returns", "-"), f"{linked(returned)}\n", _prose(text.get("Returns", "")), ""]
    lines += _further(each)
    return _page(each, lines)


def _page(each: Documented, lines: list[str]) -> str:
    intro = [f".. _interface-{each.page}:\n", heading(each.full_name if ":" not in each.path else each.name, "=")]
    return "\n".join([*intro, *lines])


def _further(each: Documented) -> Iterator[str]:
    """Yield what is raised, an example, and where to read on."""
    text = each.sections
    if "Raises" in text:
        rows = ((linked(kind), _prose(said)) for kind, said in items(text["Raises"]).items())
        yield from (heading("Raises", "-"), *(f"{kind}\n    {said[0].upper()}{said[1:]}\n" for kind, said in rows))
    if "Example" in text:
        yield from (heading("Example", "-"), f"{_without_skipped(text['Example'])}\n")
    yield heading("See also", "-")
    if each.is_call and (command := command_of(each)):
        yield f"- on the command line: :ref:`lab-{command.name}`"
    yield from (f"- :doc:`/{page}`" for page in each.see)
    yield ""
    if each.sources:
        yield f"Sources: {each.sources} (:doc:`/theory/bibliography`).\n"


def _without_skipped(example: str) -> str:
    return "\n".join(line.partition("  # doctest:")[0] for line in example.splitlines())


def attributes(each: Documented) -> dict[str, tuple[str, str, str]]:
    """Return the attributes of a class by name: type, default, and what they are."""
    stated, found = items(each.sections.get("Attributes", "")), dict[str, tuple[str, str, str]]()
    hints = {name: hint for base in reversed(each.value.__mro__) for name, hint in _annotations(base).items()}
    texts = field_texts(each.value)
    defaults = {one.name: one.default for one in fields(each.value)} if is_dataclass(each.value) else {}
    told = {name for name in defaults if name in texts or name in _OF_RESULTS}
    for name in {**dict.fromkeys(stated), **{name: None for name in defaults if name in told}}:
        default = defaults.get(name, MISSING)
        said = _prose(stated[name]) if name in stated else meaning(texts.get(name, _OF_RESULTS.get(name, "")))
        found[name] = (spelled(hints.get(name, "")), "" if default is MISSING else _default(default), said)
    for name, member in _members(each.value):
        if name not in found and isinstance(member, property | cached_property):
            function = member.fget if isinstance(member, property) else member.func
            said = sections(inspect.getdoc(function) or "")[""]
            found[name] = (spelled(_annotations(function).get("return", "")), "", _prose(said))
    return {name: row for name, row in found.items() if not each.only or name in each.only}


def _annotations(thing: Any) -> Mapping[str, Any]:
    return inspect.get_annotations(thing)


def _members(kind: type) -> Iterator[tuple[str, Any]]:
    """Yield the public members of a class, without those that every result or value has."""
    shared = {"Result", "Value", "ABC", "object", "Exception", "BaseException", "ValueError", "tuple"}
    bases = (
        [kind]
        if kind is lab.Effects
        else [base for base in kind.__mro__ if base.__name__ not in shared - {kind.__name__}]
    )
    for base in bases:
        yield from ((name, member) for name, member in vars(base).items() if not name.startswith("_"))


def methods(each: Documented) -> list[str]:
    """Return the names of the public methods of a class."""
    of_results = {name for name, _ in _members(lab.Result)} if each.name != "Result" else set[str]()
    kinds = (types.FunctionType, classmethod, staticmethod)
    names = dict.fromkeys(name for name, value in _members(each.value) if isinstance(value, kinds))
    inherits = issubclass(each.value, lab.Result)
    shown = [name for name in names if not (inherits and name in of_results)]
    return [name for name in shown if not each.only or name in each.only]


def class_page(each: Documented) -> str:
    """Return the page of a class."""
    text, own = each.sections, attributes(each)
    made = f"({', '.join(_places(each.value))})" if each.name in MADE else ""
    kind = "exception" if issubclass(each.value, Exception) else "class"
    lines = [f".. py:{kind}:: {each.full_name}{made}\n", textwrap.indent(_prose(text[""]), "   "), ""]
    calls = [one for one in _by_name().values() if one.is_call and _returns(one, each.name)]
    if calls:
        lines += [f"Returned by {', '.join(f':py:func:`{one.full_name}`' for one in calls)}.\n"]
    written = items(sections(inspect.getdoc(each.value.__init__) or "").get("Args", "")) if made else {}
    if written:
        taken = [(name, one) for name, one in _parameters(each.value).items() if name in written]
        lines += [heading("Arguments", "-"), table(("argument", "type, unit", "default", "meaning"), (
            _argument_row(name, one, written[name]) for name, one in taken), _WIDTHS)]  # fmt: skip
    if own:
        with_default = each.name in MADE and any(default for _, default, _ in own.values())
        titles = ("attribute", "type, unit", *(("default",) if with_default else ()), "meaning")
        rows = []
        for name, (hint, default, said) in own.items():
            unit = unit_of(name)
            shown = f"{linked(hint)}, {unit}" if unit and hint else linked(hint)
            rows.append((literal(name), shown, *((default,) if with_default else ()), said[:1].upper() + said[1:]))
        lines += [heading("Attributes", "-"), table(titles, rows, _WIDTHS if with_default else (22, 24, 54))]
    names = methods(each)
    if names:
        lines += [heading("Methods", "-")]
        rows = [
            (f":py:meth:`{name} <{each.full_name}.{name}>`", _first_line(getattr(each.value, name))) for name in names
        ]
        lines += [table(("method", "purpose"), rows, (30, 70))]
        lines += [f".. automethod:: {each.full_name.rpartition('.')[0]}::{each.name}.{name}\n" for name in names]
    if issubclass(each.value, lab.Result) and each.name != "Result":
        lines += ["It also has the methods of every :py:class:`~lab.Result`: ``summary``, ``report``, ``save``, "
                  "``to_dict``, ``to_frame``, ``plot`` and ``recording``.\n"]  # fmt: skip
    lines += _further(each)
    return _page(each, lines)


def _returns(call: Documented, name: str) -> bool:
    return name in re.findall(r"\w+", spelled(inspect.signature(call.value).return_annotation))


def _places(kind: type) -> list[str]:
    """Return the arguments of a class as its signature shows them; a default that is no plain value as dots."""
    if kind.__name__ in (*OWN, "Effects"):
        return ["**effects"] if kind.__name__ == "Effects" else []
    found = list[str]()
    for name, one in _parameters(kind).items():
        plain = isinstance(one.default, bool | int | float | str | types.NoneType)
        found.append(name if one.default is one.empty else f"{name}={one.default!r}" if plain else f"{name}=...")
    return found


def _first_line(thing: Any) -> str:
    first = sections(inspect.getdoc(thing) or "")[""].partition("\n\n")[0]
    return _prose(" ".join(first.split()))


def page(each: Documented) -> str:
    """Return the page of an object."""
    return call_page(each) if each.is_call else class_page(each)


class InterfaceIndex(SphinxDirective):
    """List the objects of a group, one line each, and put their pages into a hidden toctree."""

    required_arguments = 1
    final_argument_whitespace = True

    def run(self) -> list[nodes.Node]:
        """Return the table and the toctree."""
        self.env.note_dependency(str(GROUPS))
        group = documented()[self.arguments[0]]
        for each in group:
            self.env.note_dependency(str(FOLDER / f"{each.page}.rst"))  # it changes with the docstring
        rows = [(f":ref:`{each.name} <interface-{each.page}>`", _first_line(each.value)) for each in group]
        lines = [table(("name", "purpose"), rows, (25, 75)), ".. toctree::\n   :hidden:\n"]
        lines += [f"   /reference/interface/{each.page}" for each in group]
        parsed = nodes.Element()
        self.state.nested_parse(StringList("\n".join(lines).splitlines(), str(GROUPS)), 0, parsed)
        return list(parsed.children)


_ARRAY = re.compile(r"~?(?:\w+\.)*ndarray\[.*?dtype\[[^\]]*\]\]")
_ARRAY_LIKE = re.compile(r"[\w.~]*_Buffer.*?_NestedSequence\[[^\[\]]*\]")


def shorten(
    app: Sphinx, what: str, name: str, obj: object, options: object, signature: str | None, returned: str | None
) -> tuple[str | None, str | None]:
    """Write types of arrays as a person does."""
    signature, returned = (
        text and _ARRAY_LIKE.sub("array_like", _ARRAY.sub("ndarray", text)) for text in (signature, returned)
    )
    return signature, returned


def write_interface(app: Sphinx) -> None:
    """Write the pages of all objects before the builder looks for pages."""
    write_pages(FOLDER, {each.page: page(each) for each in _by_name().values()})


def setup(app: Sphinx) -> dict[str, bool]:
    """Write the pages, register the directive, and shorten what autodoc makes of signatures."""
    app.add_directive("interface-index", InterfaceIndex)
    app.connect("builder-inited", write_interface)
    app.connect("autodoc-process-signature", shorten)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
