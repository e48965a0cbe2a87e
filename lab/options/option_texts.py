"""Texts of options: what stands below each field of a dataclass, for the command line, ``help`` and the pages."""

import re
import sys
from functools import cache
from inspect import Parameter, formatannotation
from pathlib import Path
from textwrap import fill
from typing import Annotated, Any, get_args, get_origin, get_type_hints

__all__ = ["OF_EVERY_CALL", "WIDER", "field_texts", "options_section"]

WIDER = {  # options that a call takes as an object, too, by the names of what ``lab`` offers
    "instrument": ("Path", "Instrument"),
    "validate": ("Measurements",),
    "criterion": ("Criterion",),
    "estimator": ("Estimator",),
    "sampler": ("Sampler",),
    "region": ("Path",),
    "robot": ("Path",),
}
OF_EVERY_CALL = {  # arguments that each call takes beside its options
    "parts": "Further parts of your own, which options name.",
    "progress": "Called with each event of the work.",
}
_FIELD = re.compile(  # a field, the rest of its statement, and the text below
    r'^    (\w+): [^\n]*\n(?:(?:        |    [\])}])[^\n]*\n)*    """(.*?)"""', re.MULTILINE | re.DOTALL
)
_FLAG = re.compile(r"--([a-z][a-z-]*)")  # the command line's name of an option
_WIDTH = 116


def field_texts(kind: type[Any]) -> dict[str, str]:
    """Return the text below each field of a class and its bases, from the source; none where that is not there."""
    return {name: text for base in reversed(kind.__mro__) for name, text in _own_texts(base).items()}


@cache
def _own_texts(kind: type[Any]) -> dict[str, str]:
    """Return the text below each field of a class, without its bases."""
    start = re.search(rf"^class {kind.__name__}\b", source := _source(kind.__module__), re.MULTILINE)
    if start is None:
        return {}
    end = re.search(r"^[@\w]", source[start.end() :], re.MULTILINE)
    body = source[start.start() : start.end() + end.start() if end else None]
    return dict(_FIELD.findall(body))


@cache
def _source(module: str) -> str:
    """Return the source of a module; "" where there is none."""
    try:
        return Path(getattr(sys.modules.get(module), "__file__", None) or "").read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError):
        return ""


def options_section(kind: type[Any], parameters: list[Parameter]) -> str:
    """Return the section of a call's docstring on its options: type, default and meaning of each.

    Args:
        kind: class of the options.
        parameters: of the call, one for each option, and those of every call.
    """
    texts = OF_EVERY_CALL | _texts_with_groups(kind)
    lines = ["    Options:"]
    for each in parameters:
        default = "required" if each.default is Parameter.empty else f"default {each.default!r}"
        meaning = " ".join(texts.get(each.name, "").partition("\n\n")[0].split())
        meaning = _FLAG.sub(lambda flag: flag[1].replace("-", "_"), meaning)
        text = f"{each.name} ({_spelled(each)}, {default}): {meaning}"
        lines.append(fill(text, _WIDTH, initial_indent=8 * " ", subsequent_indent=12 * " ", break_on_hyphens=False))
    return "\n".join(lines)


def _spelled(parameter: Parameter) -> str:
    """Return the type of an option of a call, with the objects that it may be."""
    text = re.sub(r"\b(?:typing|pathlib|[a-z_]+(?:\.\w+)+)\.(?=\w)", "", formatannotation(parameter.annotation))
    text = re.sub(r"Optional\[(.*)\]", r"\1 | None", text)
    parts = re.sub(r"\bPath\b", "str | Path", text.replace("tuple[", "Sequence[").replace(", ...]", "]")).split(" | ")
    none = ["None"] * ("None" in parts)
    wider = WIDER.get(parameter.name, ())
    return " | ".join(dict.fromkeys([*(part for part in parts if part != "None"), *wider, *none]))


def _texts_with_groups(kind: type[Any]) -> dict[str, str]:
    """Return the texts of all options, those of nested groups and those that annotate a type among them."""
    texts = field_texts(kind)
    for name, hint in get_type_hints(kind, include_extras=True).items():
        inner = get_args(hint)[0] if get_origin(hint) is Annotated else hint
        if hasattr(inner, "__dataclass_fields__"):
            texts = _texts_with_groups(inner) | texts
        for extra in get_args(hint)[1:] if get_origin(hint) is Annotated else ():
            if text := getattr(extra, "help", None):
                texts[name] = text
    return texts
