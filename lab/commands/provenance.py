"""What every report says of how it came about: the command, its options, seed, versions and model. No date, no time."""

import shlex
from collections.abc import Iterator
from dataclasses import MISSING, fields, is_dataclass
from typing import TYPE_CHECKING, Any, get_args, get_type_hints

import tyro

from lab.commands.registry import command_named
from lab.commands.run_folder import config
from lab.render.document import PAGE, Code, Command, Paragraph, Row, Section, Table

if TYPE_CHECKING:
    from _typeshed import DataclassInstance

__all__ = ["command_line", "positional", "provenance_section"]

(_POSITIONAL,) = get_args(tyro.conf.Positional[str])[1:]  # the mark of an option without a flag
_SHOWN = ("robot", "instrument", "seed")  # also where they are at their defaults


def command_line(name: str, options: "DataclassInstance") -> str:
    """What to type for these options: those that are not at their defaults."""
    given, words, flags = dict(_asked(options)), ["lab", name], []
    for option in positional(type(options)):
        value, told = getattr(options, option), given.pop(option, "")
        several = map(str, value) if isinstance(value, tuple) else (told,)
        words += map(shlex.quote, several if told else ())
    for option, value in given.items():
        flags.append(f"--{option.replace('_', '-')}" + (f" {shlex.quote(value)}" if value else ""))
    return " ".join([*words, *flags])


def positional(kind: type[Any]) -> list[str]:
    """The options of a command that stand without a flag."""
    hints = get_type_hints(kind, include_extras=True)
    return [option for option, hint in hints.items() if _POSITIONAL in get_args(hint)]


def _asked(options: Any) -> Iterator[tuple[str, str]]:
    """Options that are not at their defaults, those of groups among them; no text for one that is only switched on."""
    for field in fields(options):
        value = getattr(options, field.name)
        default = field.default if field.default_factory is MISSING else field.default_factory()
        if is_dataclass(value):
            yield from _asked(value)
        elif value != default:
            yield field.name, _written(value)


def _written(value: Any) -> str:
    if value is True:
        return ""
    if isinstance(value, tuple):
        return ",".join(_written(each) for each in value)
    return f"{value:g}" if isinstance(value, float) else str(value)


def provenance_section(
    name: str, options: "DataclassInstance", model_sha256: str, serial: str | None = None
) -> Section:
    """The section on what was done: enough to do it again.

    Args:
        name: of the command.
        serial: the serial number of the arm, where it is known.
    """
    made = config(name, options, model_sha256)
    versions = ", ".join(f"{library} {version}" for library, version in made["versions"].items())
    rows: list[Row] = [(key, str(made["options"][key])) for key in _SHOWN if made["options"].get(key) is not None]
    rows += [("serial", serial)] if serial is not None else []
    rows += [("versions", versions), ("model (SHA-256)", Code(model_sha256))]
    words = "All other options were at their defaults"
    if command_named(name).folder:
        words += f"; config.json holds every one; lab {name} --config config.json gives the same numbers again"
    return Section(
        "What was done",
        (Command(command_line(name, options)), Paragraph(f"{words}."), Table(("", ""), tuple(rows))),
        shown_in=PAGE,
    )
