"""Fill the numbers of a check into the template of its phrase."""

from collections.abc import Callable
from string import Formatter
from typing import Any

from lab.core.checks import Check
from lab.core.errors import be, counted
from lab.core.units import DEGREES, MICRONS, MM, MRAD, short_length

__all__ = ["PRIOR", "Phrase", "worded"]

PRIOR = "--prior on (without the group residual)"  # as an advice: beside that group it is refused

Phrase = str | Callable[[Check], str]
_UNITS = {"mm": MM, "µm": MICRONS, "deg": DEGREES, "mrad": MRAD}


class _Filled(Formatter):
    """Templates with the lab's formats: ``{off_m:mm 2}`` is a length in mm to two digits (three where none is given).

    ``{count:be}`` is "is" or "are", ``{count:n pose}`` is "1 pose" or "2 poses", ``{names:list}`` has commas between,
    ``{size_m:short}`` is a length in µm or mm, ``{share:%}`` is in whole per cent, ``{share:% 3}`` to three digits.
    """

    def format_field(self, value: Any, spec: str) -> str:
        kind, _, more = spec.partition(" ")
        if kind in _UNITS:
            return _UNITS[kind].text(value, int(more or 3))
        match kind:
            case "be":
                return be(value)
            case "n":
                return counted(value, more)
            case "list":
                return ", ".join(value)
            case "short":
                return short_length(value)
            case "%":
                return f"{100 * value:.{more}g} %" if more else f"{100 * value:.0f} %"
        return str(super().format_field(value, spec))


def worded(phrase: Phrase, check: Check) -> str:
    """Return the clause of a check, by a function or by a template of the check's data."""
    if callable(phrase):
        return phrase(check)
    return _Filled().vformat(phrase, (), {"p": check.p, "statistic": check.statistic, **check.data})
