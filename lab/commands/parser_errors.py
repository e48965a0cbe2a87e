"""What the parser of the command line rejects, in one line: what is wrong, where, and where to read on.

tyro prints a box and exits. Its hook ``tyro._errors.on_parse_error`` hands over the same as an event with fields, so no
text is taken out of the box; but the module is private, so it is used here alone, and without it (or for an event that
is not known here) tyro's box is shown as it is.
"""

import re
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from difflib import get_close_matches
from typing import Any

from lab.core.errors import LabError

try:
    from tyro import _errors as events
except ImportError:  # of a later tyro
    events = None  # type: ignore[assignment]

__all__ = ["one_line_errors"]

_NUMBER = re.compile(r"[+-]?[\d.]+,?")
_OF_SEVERAL_TYPES = "no type matching"  # tyro's words of a value that may be left out, with types as it calls them


@contextmanager
def one_line_errors(program: str, flags: Sequence[str], alone: Sequence[str] = ()) -> Iterator[None]:
    """Within the block, what tyro rejects is a LabError.

    Args:
        program: what to ask for help.
        flags: that the command has, for a guess at what was meant.
        alone: those of them that stand without their name.
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
    """What is wrong; "" of an event that is not known here."""
    if isinstance(event, events.UnrecognizedArgs):
        return _unknown(event.tokens, flags, alone)
    if isinstance(event, events.MissingArgs):
        missing = " and ".join(_described(each.arg) for each in event.missing_arguments)
        also = f"; {_unknown(event.unrecognized_tokens, flags, alone)}" if event.unrecognized_tokens else ""
        return f"give {missing}{also}"
    if isinstance(event, events.BadValue):
        if event.argument.is_positional():
            return f"give {_described(event.argument)}"
        return f"{_name(event.argument)}: its value is missing"
    if isinstance(event, events.InvalidChoice):
        valid = str(event.argument.lowered.metavar).strip("{}").replace(",", ", ")
        return f"{_name(event.argument)}: '{event.value}' is unknown; give one of {valid}"
    if isinstance(event, events.InstantiationFailure) and event.argument is not None:
        if str(event.message).startswith(_OF_SEVERAL_TYPES):
            return f"{_name(event.argument)}: not understood; give {event.argument.lowered.metavar}"
        return f"{_name(event.argument)}: {event.message}"
    return ""


def _name(argument: Any) -> str:
    """A flag as it is typed, or what stands for a value without one."""
    return str(argument.lowered.metavar if argument.is_positional() else argument.lowered.name_or_flags[0])


def _described(argument: Any) -> str:
    """A missing argument or flag, and of what kind it is."""
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
