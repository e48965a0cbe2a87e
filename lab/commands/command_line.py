"""The command line of one command: its options, by tyro, and what every command takes beside them."""

import shutil
import textwrap
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, fields, is_dataclass, make_dataclass
from itertools import zip_longest
from pathlib import Path
from types import NoneType
from typing import Annotated, Any, Literal, get_args, get_origin, get_type_hints

import tyro

from lab.campaign.config_file import read_options
from lab.campaign.option_types import Flag, number, whole_number
from lab.commands.parser_errors import one_line_errors
from lab.commands.provenance import positional
from lab.commands.registry import Command
from lab.core.errors import LabError

__all__ = ["Arguments", "parsed"]

_CONFIG = "--config"
_JSON = Annotated[Flag, tyro.conf.arg(help="Print the result as one JSON object.")]
_RESUME = Annotated[Flag, tyro.conf.arg(help="Go on with the run in --out that was interrupted or killed.")]
_OVERWRITE = Annotated[Flag, tyro.conf.arg(help="Replace an earlier run in that folder.")]


@dataclass(frozen=True)
class Arguments:
    """What was asked for.

    Attributes:
        options: of the command's own class.
        out: the run's folder; None for the default one.
        overwrite: whether an earlier run in that folder is replaced.
        json: whether to print the result as JSON.
        resume: whether to go on with a run that was interrupted.
    """

    options: Any
    out: Path | None
    overwrite: bool
    json: bool
    resume: bool


def parsed(command: Command, arguments: Sequence[str]) -> Arguments:
    """The arguments that follow the command's name; those for help print it and end the program.

    Raises:
        LabError: they cannot be parsed, or ``--config`` names what is no run's ``config.json``.
    """
    kind = command.load_options()
    rest, default = _configured(command, kind, arguments)
    rest = _with_switches_on(kind, rest)
    titled = Annotated[kind, tyro.conf.arg(name="")]  # type: ignore[valid-type]
    given = tyro.conf.OmitArgPrefixes[titled]
    options = ("options", given) if default is None else ("options", given, field(default=default))
    common: list[Any] = [("json", _JSON, field(default=False))]
    if "out" not in _names(kind):  # of a command that looks after its folder itself
        default_folder = f"The run's folder: runs/{command.folder} by default, numbered if taken."
        said = default_folder if command.folder else "A folder for the page and the result; by default none is written."
        out = ("out", Annotated[Path | None, tyro.conf.arg(help=said)], field(default=None))
        common = [out, ("overwrite", _OVERWRITE, field(default=False)), *common]
    if command.resumed:
        common = [*common, ("resume", _RESUME, field(default=False))]
    made: Any = make_dataclass("Arguments", [options, *common])
    program = f"lab {command.name}"
    flags = [f"--{name.replace('_', '-')}" for name in (*_names(kind), *(each[0] for each in common))]
    with one_line_errors(program, flags, [f"--{name}" for name in positional(kind)]):
        found = tyro.cli(made, prog=program, description=_described(command), args=rest, registry=_numbers())
    given_flags = (getattr(found, name, False) for name in ("overwrite", "json", "resume"))
    return Arguments(found.options, getattr(found, "out", None), *given_flags)


def _described(command: Command) -> str:
    again = " With --config FILE an earlier run's config.json gives the defaults." if command.folder else ""
    width = max(40, shutil.get_terminal_size().columns)  # as tyro has it, which does not break this text
    return textwrap.fill(command.help + again, width, subsequent_indent="  ")


def _configured(command: Command, kind: type[Any], arguments: Sequence[str]) -> tuple[list[str], Any]:
    """The arguments without ``--config FILE``, and that file's options; None where it is not given."""
    found = [part for given in arguments for part in _split(given)]
    if not command.folder or _CONFIG not in found:
        return found, None
    at = found.index(_CONFIG)
    if at + 1 == len(found):
        raise LabError(f"{_CONFIG}: give the config.json of an earlier run")
    return [*found[:at], *found[at + 2 :]], read_options(Path(found[at + 1]), command.name, kind)


def _with_switches_on(kind: type[Any], arguments: Sequence[str]) -> list[str]:
    """The arguments, where options that may be ``on`` and are given without a value have that one."""
    choices = {f"--{name.replace('_', '-')}": words for name, words in _words(kind) if "on" in words}
    found = list[str]()
    for argument, following in zip_longest(arguments, arguments[1:]):
        found.append(argument)
        if argument in choices and following not in choices[argument]:
            found.append("on")
    return found


def _words(kind: Any) -> Iterator[tuple[str, tuple[str, ...]]]:
    """The options that take one of some words, with these; those of groups among them."""
    hints = get_type_hints(kind)
    for each in fields(kind):
        hint = hints[each.name]
        if is_dataclass(hint):
            yield from _words(hint)
        elif get_origin(hint) is Literal:
            yield each.name, get_args(hint)


def _split(argument: str) -> tuple[str, ...]:
    """``--config=FILE`` as two arguments; any other as it is."""
    name, _, value = argument.partition("=")
    return (name, value) if name == _CONFIG and value else (argument,)


def _names(kind: Any) -> Iterator[str]:
    """Of all options, those of groups among them."""
    hints = get_type_hints(kind)
    for each in fields(kind):
        yield from _names(hints[each.name]) if is_dataclass(hints[each.name]) else (each.name,)


def _numbers() -> tyro.constructors.ConstructorRegistry:
    """Numbers whose refusal is a plain sentence, and what need not be given, whose help says so in words."""
    registry = tyro.constructors.ConstructorRegistry()
    words: dict[type, tuple[Any, str]] = {
        int: (whole_number, "INT"), float: (number, "FLOAT"), Path: (Path, "PATH"), str: (str, "STR"),
    }  # fmt: skip

    @registry.primitive_rule
    def rule(info: tyro.constructors.PrimitiveTypeInfo) -> tyro.constructors.PrimitiveConstructorSpec[Any] | None:
        for kind, (read, metavar) in words.items():
            if info.type is kind:
                return _spec(kind, read, metavar, optional=False)
            if info.type == kind | None:
                return _spec(kind, read, metavar, optional=True)
        return _one_of(get_args(info.type))

    return registry


def _one_of(kinds: Sequence[Any]) -> "tyro.constructors.PrimitiveConstructorSpec[Any] | None":
    """Of words that may be left out; None where the parts of a type are others."""
    words = [each for each in kinds if get_origin(each) is Literal]
    if len(words) != 1 or len(kinds) != 2 or NoneType not in kinds:
        return None
    choices = tuple(str(each) for each in get_args(words[0]))
    return tyro.constructors.PrimitiveConstructorSpec(
        nargs=1,
        metavar="{" + ",".join(choices) + "}",
        instance_from_str=lambda texts: texts[0],
        is_instance=lambda value: value is None or value in choices,
        str_from_instance=lambda value: ["none" if value is None else str(value)],
        choices=choices,
    )


def _spec(kind: type, read: Any, metavar: str, *, optional: bool) -> "tyro.constructors.PrimitiveConstructorSpec[Any]":
    return tyro.constructors.PrimitiveConstructorSpec(
        nargs=1,
        metavar=metavar,
        instance_from_str=lambda texts: None if optional and texts[0] == "None" else read(texts[0]),
        is_instance=lambda value: isinstance(value, kind) or (optional and value is None),
        str_from_instance=lambda value: ["none" if value is None else str(value)],
    )
