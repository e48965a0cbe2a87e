"""Parse the command line of one command by tyro: its own options, and those that every command takes.

An error becomes one line: what is wrong, where, and where to read on. tyro prints a box and exits; its hook
``tyro._errors.on_parse_error`` gives the error as an event with fields. That module is private, so it is used here
alone; without it, or for an unknown event, tyro's box is shown.
"""

import os
import re
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field, fields, is_dataclass, make_dataclass, replace
from difflib import get_close_matches
from itertools import pairwise, zip_longest
from pathlib import Path
from types import NoneType
from typing import Annotated, Any, Literal, get_args, get_origin, get_type_hints

import tyro

from lab.cli.commands import all_commands
from lab.cli.help_text import HELP_FLAGS, ROBOT, help_text
from lab.core.errors import LabError
from lab.formats.structured import structured
from lab.library.run_folder import positional
from lab.options.command import Command
from lab.options.option_types import Flag, number, whole_number
from lab.options.plan_settings import PlanSettings, filled_in, settings_of_plan
from lab.robots.config_file import CONFIG_FILE, read_options
from lab.robots.robot_files import joined

__all__ = ["Arguments", "parsed", "print_completion"]

SHELLS = ("bash", "zsh", "fish")

try:
    from tyro import _errors as events
except ImportError:  # of a later tyro
    events = None  # type: ignore[assignment]

os.environ.setdefault("TYPEGUARD_DISABLE_PLUGIN_AUTOLOAD", "1")  # else tyro has all packages' metadata read

_NUMBER = re.compile(r"[+-]?[\d.]+,?")
_OF_SEVERAL_TYPES = "no type matching"  # tyro's words of a value that may be left out, with types as it calls them


@contextmanager
def _one_line_errors(program: str, flags: Sequence[str], alone: Sequence[str] = ()) -> Iterator[None]:
    """Raise a LabError for arguments that tyro rejects within the block.

    Args:
        program: the command line that prints help.
        flags: of the command, from which a similar one is proposed.
        alone: the flags of positional arguments.
    """
    if events is None:
        yield
        return

    def refuse(event: Any) -> None:
        if line := _line(event, flags, alone):
            raise LabError(f"{line}; see {program} --help")

    with events.on_parse_error(refuse):
        yield


def _line(event: Any, flags: Sequence[str], alone: Sequence[str]) -> str:
    """Describe the error of a parsing event; "" for an unknown event."""
    if isinstance(event, events.UnrecognizedArgs):
        return _unknown(event.tokens, flags, alone)
    if isinstance(event, events.MissingArgs):
        missing = " and ".join(_described(each.arg) for each in event.missing_arguments)
        also = f"; {_unknown(event.unrecognized_tokens, flags, alone)}" if event.unrecognized_tokens else ""
        return f"give {missing}{also}"
    return "" if getattr(event, "argument", None) is None else _value_line(event, event.argument)


def _value_line(event: Any, argument: Any) -> str:
    """Describe the error of an argument's value; "" for an unknown event."""
    if isinstance(event, events.BadValue):
        return (
            f"give {_described(argument)}" if argument.is_positional() else f"{_name(argument)}: its value is missing"
        )
    if isinstance(event, events.InvalidChoice):
        valid = str(argument.lowered.metavar).strip("{}").replace(",", ", ")
        return f"{_name(argument)}: '{event.value}' is unknown; give one of {valid}"
    if isinstance(event, events.InstantiationFailure):
        if str(event.message).startswith(_OF_SEVERAL_TYPES):
            return f"{_name(argument)}: not understood; give {argument.lowered.metavar}"
        return f"{_name(argument)}: {event.message}"
    return ""


def _name(argument: Any) -> str:
    return str(argument.lowered.metavar if argument.is_positional() else argument.lowered.name_or_flags[0])


def _described(argument: Any) -> str:
    name = argument.field.intern_name if argument.is_positional() else argument.lowered.name_or_flags[0]
    return f"{name} ({argument.lowered.metavar})"


def _unknown(tokens: Sequence[str], flags: Sequence[str], alone: Sequence[str]) -> str:
    if tokens[0] in alone:
        return f"{' '.join(tokens)} is not understood; give it without {tokens[0]}"
    if _NUMBER.fullmatch(tokens[0]):
        return f"{' '.join(tokens)} is not understood; separate the numbers of one option by commas, without spaces"
    if tokens[0].isidentifier() and "--robot" in {*flags} - {*alone}:
        return f"{' '.join(tokens)} is not understood; is --robot {tokens[0]} meant?"
    meant = get_close_matches(tokens[0], flags, 1, cutoff=0.75)
    return f"{' '.join(tokens)} is not understood" + (f"; is {meant[0]} meant?" if meant else "")


_CONFIG = "--config"


@dataclass(frozen=True)
class Arguments:
    """Parsed arguments of a command."""

    options: Any  # of the command's own class
    out: Path | None  # the run's folder; None for the default one
    overwrite: bool  # whether an earlier run in that folder is replaced
    json: bool  # whether to print the result as JSON
    notes: tuple[str, ...] = ()  # lines on what was taken from a plan, and where options differ from it


def parsed(command: Command, arguments: Sequence[str]) -> Arguments:
    """Parse the arguments after the command's name; those for help print it and end the program.

    Raises:
        LabError: they cannot be parsed, or ``--config`` names what is no run's ``config.json``.
    """
    kind = command.load_options()
    rest, default = _configured(command, kind, arguments)
    stated = _stated_by_plan(command, rest) if default is None else None
    if stated is not None:
        default = structured(stated.folder / CONFIG_FILE, kind, stated.values)
    if asked := [each for each in rest if each in HELP_FLAGS]:
        print(help_text(command, every="--help-all" in asked, defaults=default))
        raise SystemExit(0)
    rest = _without_flags_on(default, _with_switches_on(kind, rest))
    made = _arguments(command, kind, default)
    program = f"lab {command.name}"
    flags = _flags((*_names(kind), *(each.name for each in fields(made)[1:])))
    with _one_line_errors(program, flags, [f"--{name}" for name in positional(kind)]):
        found = tyro.cli(made, prog=program, description="", args=rest, registry=_numbers(), add_help=False)
    overwrite, json = (bool(getattr(found, name, False)) for name in ("overwrite", "json"))
    chosen, notes = _noted(command, _with_ends(found), kind, stated)
    return Arguments(chosen, getattr(found, "out", None), overwrite, json, notes)


def _flags(names: Iterable[str]) -> list[str]:
    return [f"--{name.replace('_', '-')}" for name in names]


def _without_flags_on(default: Any, arguments: list[str]) -> list[str]:
    """Return arguments without flags that are on by default: tyro knows such a flag by its ``--no-…`` alone."""
    on = set() if default is None else set(_flags(_flags_on(default)))
    return [each for each in arguments if each not in on]


def _flags_on(options: Any) -> Iterator[str]:
    """Yield the flags that are on, those of groups among them."""
    for each in fields(options):
        value = getattr(options, each.name)
        if is_dataclass(value):
            yield from _flags_on(value)
        elif value is True:
            yield each.name


def _arguments(command: Command, kind: type[Any], default: Any = None) -> Any:
    """Return a class of all arguments of a command: its own options, then those that every command takes."""
    # Without the empty help, tyro parses this source anew on each call, in search of one.
    titled = Annotated[kind, tyro.conf.arg(name="", help="")]  # type: ignore[valid-type]
    given = tyro.conf.OmitArgPrefixes[titled]
    options = ("options", given) if default is None else ("options", given, field(default=default))
    common: list[Any] = [("json", Flag, field(default=False))]
    if "out" not in _names(kind):  # of a command that looks after its folder itself
        common = [("out", Path | None, field(default=None)), ("overwrite", Flag, field(default=False)), *common]
    if ROBOT in _names(kind):
        tips = tyro.conf.UseAppendAction[tuple[str, ...]]
        common = [*common, ("tip", tips, field(default=())), ("base", str, field(default=""))]
    return make_dataclass("Arguments", [options, *common])


def print_completion(shell: str) -> None:
    """Print tyro's script that makes a shell complete the commands of ``lab`` and their options.

    Raises:
        LabError: the shell is none of ``SHELLS``.
    """
    if shell not in SHELLS:
        raise LabError(f"--completion {shell}".rstrip() + f": give {', '.join(SHELLS[:-1])} or {SHELLS[-1]}")
    commands = {each.name: _arguments(each, each.load_options()) for each in all_commands()}
    with suppress(SystemExit):
        tyro.extras.subcommand_cli_from_dict(
            commands, prog="lab", args=["--tyro-print-completion", shell], registry=_numbers()
        )


_CHECKED_ANEW = ("cell", "clearance_mm", "self_clearance_mm")  # in which lab design --check may differ from the plan


def _stated_by_plan(command: Command, arguments: Sequence[str]) -> PlanSettings | None:
    """Return the settings of the plan that an option names; None without one, or for a file that no design made."""
    given = _value_of(f"--{command.plan}", arguments) if command.plan else None
    if given is None:
        return None
    found = settings_of_plan(Path(given), clearances=command.plan == "check")
    if found is None:
        return None
    if command.plan == "check":  # is of measured points
        return found.without("observe", "cameras")
    if _value_of("--observe", arguments) not in (None, found.observe):  # by another instrument
        return found.without("observe", "cameras", "instrument")
    return found


def _value_of(flag: str, arguments: Sequence[str]) -> str | None:
    """Return the value of an option's last occurrence; None without one."""
    values = [after for each, after in pairwise(arguments) if each == flag]
    values += [each.partition("=")[2] for each in arguments if each.startswith(f"{flag}=")]
    return values[-1] if values else None


def _noted(command: Command, options: Any, kind: type[Any], stated: PlanSettings | None) -> tuple[Any, tuple[str, ...]]:
    """Return the options with what they take from the plan of a measurement file, and lines on what was taken."""
    if stated is not None:
        expected = _CHECKED_ANEW if command.plan == "check" else ()
        differ = stated.without(*expected).differences(options)
        note = stated.taken_note(options, kind())
        return options, (*((note,) if note else ()), *(f"warning: {each}" for each in differ))
    if command.plan == "file":
        return filled_in(options, options.file)
    return options, ()


def _with_ends(found: Any) -> Any:
    """Return the command's options, whose robot has the base and the tips that are given beside it."""
    base, tips = getattr(found, "base", ""), tuple(getattr(found, "tip", ()))
    if not (base or tips):
        return found.options
    if found.options.robot is None:
        raise LabError(f"--{'tip' if tips else 'base'}: give --robot too, whose chains it ends")
    return replace(found.options, robot=joined(found.options.robot, base, tips))


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
    switches = {name: values for name, values in _choices(kind) if "on" in values}
    choices = dict(zip(_flags(switches), switches.values(), strict=True))
    found = list[str]()
    for argument, following in zip_longest(arguments, arguments[1:]):
        found.append(argument)
        if argument in choices and following not in choices[argument]:
            found.append("on")
    return found


def _choices(kind: Any) -> Iterator[tuple[str, tuple[str, ...]]]:
    """The options that take one of some words, with these; those of groups among them."""
    hints = get_type_hints(kind)
    for each in fields(kind):
        hint = hints[each.name]
        if is_dataclass(hint):
            yield from _choices(hint)
        elif get_origin(hint) is Literal:
            yield each.name, get_args(hint)


def _split(argument: str) -> tuple[str, ...]:
    """``--config=FILE`` as two arguments; any other as it is."""
    name, _, value = argument.partition("=")
    return (name, value) if name == _CONFIG and value else (argument,)


def _names(kind: Any) -> Iterator[str]:
    hints = get_type_hints(kind)
    for each in fields(kind):
        yield from _names(hints[each.name]) if is_dataclass(hints[each.name]) else (each.name,)


def _numbers() -> tyro.constructors.ConstructorRegistry:
    """Return constructors of numbers and optional values with plain errors and help."""
    registry = tyro.constructors.ConstructorRegistry()
    parsers: dict[type, tuple[Any, str]] = {
        int: (whole_number, "INT"), float: (number, "FLOAT"), Path: (Path, "PATH"), str: (str, "STR"),
    }  # fmt: skip

    @registry.primitive_rule
    def rule(info: tyro.constructors.PrimitiveTypeInfo) -> tyro.constructors.PrimitiveConstructorSpec[Any] | None:
        for kind, (read, metavar) in parsers.items():
            if info.type is kind:
                return _spec(kind, read, metavar, optional=False)
            if info.type == kind | None:
                return _spec(kind, read, metavar, optional=True)
        return _one_of(get_args(info.type))

    return registry


def _one_of(kinds: Sequence[Any]) -> "tyro.constructors.PrimitiveConstructorSpec[Any] | None":
    """Return the parser of an optional choice of words; None for any other type."""
    values = [each for each in kinds if get_origin(each) is Literal]
    if len(values) != 1 or len(kinds) != 2 or NoneType not in kinds:
        return None
    choices = tuple(str(each) for each in get_args(values[0]))
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
