"""Older names of public things, which work with a warning until the release that removes them.

A name of ``lab``, a command or an option that is renamed gets a line in a table here; ``docs/developers/stability.md``
says for how long.
"""

import sys
import warnings
from collections.abc import Mapping
from dataclasses import dataclass

from lab.core.errors import option_name

__all__ = ["COMMANDS", "NAMES", "OPTIONS", "Renamed", "with_present_flags", "with_present_name", "with_present_options"]


@dataclass(frozen=True)
class Renamed:
    """What replaces an older name.

    Attributes:
        present: the name that replaces it.
        removed_in: the release that removes the older one, e.g. ``0.3.0``.
    """

    present: str
    removed_in: str


NAMES: dict[str, Renamed] = {}  # of ``lab``
COMMANDS: dict[str, Renamed] = {}
OPTIONS: dict[str, Renamed] = {}  # of all commands, as arguments: ``noise_mm``


def with_present_name(table: Mapping[str, Renamed], name: str, prefix: str, stacklevel: int) -> str:
    """Return the present name of an older one, with a warning; any other name as it is.

    Args:
        prefix: stands before both names in the warning, e.g. ``lab.``
        stacklevel: of the line that the warning names, seen from the caller.
    """
    if name not in table:
        return name
    found = table[name]
    _warn(f"{prefix}{name}", f"{prefix}{found.present}", found.removed_in, stacklevel + 1)
    return found.present


def with_present_options(given: Mapping[str, object], stacklevel: int) -> dict[str, object]:
    """Return the arguments of a call by their present names; an older one beside the present one stays, to be refused.

    Args:
        stacklevel: of the line that the warning names, seen from the caller.
    """
    found = dict(given)
    for name in [each for each in given if each in OPTIONS and OPTIONS[each].present not in given]:
        found[with_present_name(OPTIONS, name, "", stacklevel + 1)] = found.pop(name)
    return found


def with_present_flags(arguments: list[str]) -> list[str]:
    """Return the arguments of a command with the present flags."""
    return [_present_flag(each) for each in arguments]


def _present_flag(argument: str) -> str:
    flag, equals, value = argument.partition("=")
    found = OPTIONS.get(flag[2:].replace("-", "_")) if flag.startswith("--") else None
    if found is None:
        return argument
    present = "--" + found.present.replace("_", "-")
    _warn(flag, present, found.removed_in, 1)
    return f"{present}{equals}{value}"


def _warn(old: str, present: str, removed_in: str, stacklevel: int) -> None:
    """Warn in a line of standard error on the command line, else as Python does."""
    message = f"{old} is deprecated, and lab {removed_in} removes it; use {present}"
    if option_name("").startswith("-"):
        print(f"lab: warning: {message}", file=sys.stderr)
    else:
        warnings.warn(message, DeprecationWarning, stacklevel + 2)
