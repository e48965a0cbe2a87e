"""What every report says of how it came about: the command, its options, seed, versions and model. No date, no time."""

import shlex
from collections.abc import Iterator
from dataclasses import MISSING, fields, is_dataclass
from typing import TYPE_CHECKING, Any

from lab.commands.run_folder import config
from lab.render.document import PAGE, Code, Command, Paragraph, Row, Section, Table

if TYPE_CHECKING:
    from _typeshed import DataclassInstance

__all__ = ["command_line", "provenance_section"]

_POSITIONAL = {"identify": ("file",), "verify": ("run", "file"), "compensate": ("targets",), "payload": ("file",)}
_SHOWN = ("robot", "instrument", "seed")  # also where they are as usual
_AGAIN = ("calibrate", "identify", "design")  # that take --config


def command_line(name: str, options: "DataclassInstance") -> str:
    """What to type for these options: those that differ from the usual ones."""
    given = dict(_asked(options))
    files = [shlex.quote(given.pop(each)) for each in _POSITIONAL.get(name, ())]
    flags = []
    for option, value in given.items():
        flags.append(f"--{option.replace('_', '-')}" + (f" {shlex.quote(value)}" if value else ""))
    return " ".join(["lab", name, *files, *flags])


def _asked(options: Any) -> Iterator[tuple[str, str]]:
    """Options that are not as usual, those of groups beside the others; no text for one that is only switched on."""
    for field in fields(options):
        value = getattr(options, field.name)
        usual = field.default if field.default_factory is MISSING else field.default_factory()
        if is_dataclass(value):
            yield from _asked(value)
        elif value != usual:
            yield field.name, _written(value)


def _written(value: Any) -> str:
    if value is True:
        return ""
    if isinstance(value, tuple):
        return ",".join(_written(each) for each in value)
    return f"{value:g}" if isinstance(value, float) else str(value)


def provenance_section(name: str, options: "DataclassInstance", model_sha256: str, again: str = "") -> Section:
    """The section on what was done: enough to do it again.

    Args:
        again: how to, in words, for a command that does not take a ``config.json``.
    """
    made = config(name, options, model_sha256)
    versions = ", ".join(f"{library} {version}" for library, version in made["versions"].items())
    rows: list[Row] = [(key, str(made["options"][key])) for key in _SHOWN if made["options"].get(key) is not None]
    rows += [("versions", versions), ("model (SHA-256)", Code(model_sha256))]
    if name in _AGAIN:
        again = f"lab {name} --config config.json gives the same numbers again"
    words = f"All other options were at their defaults; config.json holds every one{'; ' + again if again else ''}."
    return Section(
        "What was done",
        (Command(command_line(name, options)), Paragraph(words), Table(("", ""), tuple(rows))),
        shown_in=PAGE,
    )
