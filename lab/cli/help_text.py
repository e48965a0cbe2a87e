"""Make the help of a command from its options: examples, then groups of options, the common ones alone or all.

Parsing does not depend on it: all options are accepted, whichever help shows them.
"""

import shutil
import textwrap
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import MISSING, dataclass, fields, is_dataclass, replace
from pathlib import Path
from types import NoneType, UnionType
from typing import Annotated, Any, Literal, Union, get_args, get_origin, get_type_hints

from lab.library.run_folder import positional
from lab.options.command import Command, OptionGroup
from lab.options.option_texts import field_texts

__all__ = ["HELP_FLAGS", "ROBOT", "Option", "grouped", "help_text", "options_of_command"]

HELP_FLAGS = ("-h", "--help", "--help-all")
_COLUMN = 32  # the widest column of flags; longer ones have a line of their own
_NARROWEST = 40
_METAVARS = {str: "STR", int: "INT", float: "FLOAT", Path: "PATH"}
_REST = "more options"
ROBOT, _ENDS = "robot", ("tip", "base")  # the option beside which tips and a base are taken
_TIP = (
    "A body, link or site of an MJCF or a URDF that is the end of a chain; give it again for a robot with several tips."
)
_BASE = "The body or link below the first joint; joints that move it are held at zero."
_OUTPUT = OptionGroup("output", ("out", "overwrite", "json", "resume", "config"), ("no_recording",))


@dataclass(frozen=True)
class Option:
    """An argument of a command, as help shows it.

    Attributes:
        name: of the field.
        metavar: of its value; "" for a flag.
        help: what it is for: a sentence or two, and after an empty line what is shown by ``--help-all`` alone.
        default: as it is typed; "" where there is none to name.
        group: the field that holds it; "" for an option outside groups.
        required: whether it has to be given.
        positional: whether it stands without its flag.
        several: whether several words are given.
        choices: words of which one is given.
    """

    name: str
    metavar: str
    help: str
    default: str = ""
    group: str = ""
    required: bool = False
    positional: bool = False
    several: bool = False
    choices: tuple[str, ...] = ()

    @property
    def flag(self) -> str:
        """What is typed before its value."""
        return f"--{self.name.replace('_', '-')}"


def options_of_command(command: Command, defaults: Any = None) -> tuple[Option, ...]:
    """Return all options of a command, those that every command takes last.

    Args:
        defaults: an object of its options whose values are the defaults; those of the class if None.
    """
    kind = command.load_options()
    own = list(_options(kind, defaults, positional(kind)))
    names = {each.name for each in own}
    common = []
    if "out" not in names:
        folder = f"The run's folder: runs/{command.folder} by default, numbered if taken."
        text = folder if command.folder else "A folder for the page and the result; by default none is written."
        common += [Option("out", "PATH", text), Option("overwrite", "", "Replace an earlier run in that folder.")]
    common.append(Option("json", "", "Print the result as one JSON object."))
    if ROBOT in names:
        common += [Option("tip", "NAME", _TIP), Option("base", "NAME", _BASE)]
    if command.folder:
        common.append(Option("config", "FILE", "An earlier run's config.json gives the defaults."))
    return (*own, *common)


def _options(kind: type[Any], defaults: Any, alone: Sequence[str], group: str = "") -> Iterator[Option]:
    hints, texts = get_type_hints(kind, include_extras=True), field_texts(kind)
    for each in fields(kind):
        hint = hints[each.name]
        value = getattr(defaults, each.name) if defaults is not None else each.default
        if inner := _group_class(hint):
            held = None if defaults is None else value
            yield from _options(inner, held, (), each.name)
            continue
        if value is MISSING and each.default_factory is not MISSING:
            value = each.default_factory()
        extras = list(_extras(hint))
        text = _first(extras, "help") or texts.get(each.name, "")
        choices = tuple(_first(extras, "choices") or _choices(hint))
        yield Option(
            each.name, _metavar(each.name, hint, extras), text, _shown_default(value, extras), group,
            value is MISSING, each.name in alone, _is_open(hint, extras), choices,
        )  # fmt: skip


def _first(extras: Sequence[Any], name: str) -> Any:
    """Return the first attribute of that name that is not empty; None without any."""
    return next((value for each in extras if (value := getattr(each, name, None))), None)


def _group_class(hint: Any) -> type[Any] | None:
    plain = get_args(hint)[0] if get_origin(hint) is Annotated else hint
    return plain if isinstance(plain, type) and is_dataclass(plain) else None


def _extras(hint: Any) -> Iterator[Any]:
    """Yield what annotates a type, at any depth: the outermost last, which tyro gives the last word, too."""
    if get_origin(hint) is Annotated:
        yield from _extras(get_args(hint)[0])
        yield from reversed(get_args(hint)[1:])
    elif get_origin(hint) in (Union, UnionType):
        for each in get_args(hint):
            yield from _extras(each)


def _bare(hint: Any) -> Any:
    """Return a type without what annotates it, and without None."""
    if get_origin(hint) is Annotated:
        return _bare(get_args(hint)[0])
    if get_origin(hint) in (Union, UnionType):
        some = [each for each in get_args(hint) if each is not NoneType]
        return _bare(some[0]) if len(some) == 1 else hint
    return hint


def _choices(hint: Any) -> tuple[str, ...]:
    return tuple(map(str, get_args(_bare(hint)))) if get_origin(_bare(hint)) is Literal else ()


def _is_open(hint: Any, extras: Sequence[Any]) -> bool:
    """Decide whether a type is a tuple of any length whose items are words of their own."""
    one_word = any(hasattr(each, "instance_from_str") for each in extras)
    return not one_word and Ellipsis in get_args(_bare(hint))


def _metavar(name: str, hint: Any, extras: Sequence[Any]) -> str:
    if metavar := _first(extras, "metavar"):
        return str(metavar)
    bare = _bare(hint)
    if bare is bool:
        return ""
    if choices := _choices(hint):
        return "{" + ",".join(choices) + "}"
    if get_origin(bare) is tuple:
        return " ".join(_METAVARS.get(each, name.upper()) for each in get_args(bare) if each is not Ellipsis)
    return _METAVARS.get(bare, name.upper())


def _shown_default(value: Any, extras: Sequence[Any]) -> str:
    """Return a default as it is typed; "" for none, and for an error or effect of size 0.0, which is off."""
    if value is MISSING or value is None or value is False or value in ("", ()):
        return ""
    if value is True:
        return "given"  # by --config
    if isinstance(value, float):
        return f"{value:g}" if value else ""
    if write := _first(extras, "str_from_instance"):
        return " ".join(write(value))
    return " ".join(map(str, value)) if isinstance(value, tuple) else str(value)


def grouped(command: Command, options: Sequence[Option], *, every: bool) -> dict[str, tuple[Option, ...]]:
    """Return the options with flags by the titles of their groups; the common ones alone, unless every one is wanted.

    A command without groups has all its options among the common ones.
    """
    left = {each.name: each for each in options if not each.positional}
    groups = (*_with_ends(command.groups), _OUTPUT) if command.groups else _without_groups(left)
    common = [_taken(left, group.common) for group in groups]
    shown = {group.title: own for group, own in zip(groups, common, strict=True)}
    if every:
        for group in groups:
            shown[group.title] += _taken(left, _members(left, group.more))
        shown[_REST] = tuple(left.values())
    return {title: own for title, own in shown.items() if own}


def _without_groups(names: Iterable[str]) -> tuple[OptionGroup, ...]:
    """Return the groups of a command without any: its own options, and those of its output."""
    output = (*_OUTPUT.common, *_OUTPUT.more)
    own = tuple(name for name in names if name not in output)
    return OptionGroup("options", own), OptionGroup(_OUTPUT.title, output)


def _with_ends(groups: Sequence[OptionGroup]) -> list[OptionGroup]:
    """Return groups of options, of which the robot's, or else the first, has its tips and base."""
    at = next((i for i, group in enumerate(groups) if ROBOT in group.common), 0)
    return [replace(group, more=(*group.more, *_ENDS)) if i == at else group for i, group in enumerate(groups)]


def _members(left: dict[str, Option], names: Sequence[str]) -> list[str]:
    """Return names of options, those that a named group holds in its place."""
    return [found for name in names for found in ([name] if name in left else _held(left, name))]


def _held(left: dict[str, Option], group: str) -> list[str]:
    return [each.name for each in left.values() if each.group == group]


def _taken(left: dict[str, Option], names: Sequence[str]) -> tuple[Option, ...]:
    return tuple(left.pop(name) for name in names if name in left)


def help_text(command: Command, *, every: bool = False, defaults: Any = None, width: int | None = None) -> str:
    """Return the help of a command.

    Args:
        every: whether all options are shown, and all of their texts; the common ones otherwise.
        defaults: as ``options_of_command`` takes them.
        width: columns of the terminal, by default as it is.
    """
    width = max(_NARROWEST, shutil.get_terminal_size().columns if width is None else width)
    options = options_of_command(command, defaults)
    alone = [each for each in options if each.positional]
    groups = grouped(command, options, every=every)
    lines = [_usage(command, options), "", textwrap.fill(command.help, width)]
    if command.examples:
        lines += ["", "examples:", *(f"  lab {command.name} {each}".rstrip() for each in command.examples)]
    sections = {"arguments": alone, **groups}
    widest = max((len(_typed(each)) for section in sections.values() for each in section), default=0)
    column = min(_COLUMN, 4 + widest, width // 3)
    for title, section in sections.items():
        lines += ["", f"{title}:"] if section else []
        for option in section:
            lines += _entry(_typed(option), _described(option, every=every), column, width)
    hidden = sum(not each.positional for each in options) - sum(map(len, groups.values()))
    if hidden:
        lines += ["", f"{hidden} more: lab {command.name} --help-all"]
    return "\n".join(lines)


def _usage(command: Command, options: Sequence[Option]) -> str:
    places = [_place(each) for each in options if each.positional]
    needed = [_typed(each) for each in options if each.required and not each.positional]
    return " ".join([f"usage: lab {command.name}", *places, *needed, "[OPTIONS]"])


def _typed(option: Option) -> str:
    """Return what is typed of an option: its place, or its flag with its value."""
    return option.name.upper() if option.positional else f"{option.flag} {option.metavar}".rstrip()


def _place(option: Option) -> str:
    name = option.name.upper()
    name = f"{name} [{name} ...]" if option.required and option.several else f"{name} ..." if option.several else name
    return name if option.required else f"[{name}]"


def _described(option: Option, *, every: bool) -> str:
    text = option.help if every else option.help.partition("\n\n")[0]
    hint = "required" if option.required and not option.positional else option.default
    shown = f" ({hint})" if hint in ("required", "given") else f" (default: {hint})" if hint else ""
    return " ".join(text.split()) + shown


def _entry(name: str, text: str, column: int, width: int) -> list[str]:
    """Lay out an option: its flag, and from a column on its text."""
    room = max(width - column, 20)
    lines = textwrap.wrap(text, room, break_on_hyphens=False, break_long_words=False)
    first = f"  {name}"
    if len(first) + 2 > column:
        return [*textwrap.wrap(first.strip(), width - 2, initial_indent="  ", subsequent_indent="  "),
                *(" " * column + line for line in lines)]  # fmt: skip
    first_line, *rest = lines or [""]
    return [f"{first:{column}}{first_line}".rstrip(), *(" " * column + line for line in rest)]
