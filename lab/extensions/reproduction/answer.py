"""An answer of a source beside ours: a number, a formula, a number that hangs on chance, a bound, or a word.

Whether a printed number agrees is a matter of its own digits: it may be off by one unit of the last one, a whole
number by half of one. A printed formula agrees if its values are ours at random positions. What is drawn by chance
agrees if it lies in the range of many draws of ours.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from lab.core.errors import LabError
from lab.core.se3 import Array
from lab.extensions.reproduction.formula import Variables, evaluated

__all__ = ["Answer", "at_least", "drawn", "formula", "holds", "number", "word"]

_EXACT = 1e-9  # of the largest value of a formula: it is the same
_EDGE = 1e-9  # of a unit of the last digit: rounding
_MINUS = "−"


@dataclass(frozen=True)
class Answer:
    """One printed value.

    Attributes:
        name: what it is, unique in its item.
        printed: as the source prints it; "" where it leaves it to the reader.
        ours: what is computed here.
        unit: of both.
        difference: between them, in words; "" where nothing is printed.
        agrees: whether the printed value is ours; None where nothing is printed.
        erratum: why the printed value is wrong; "" where it is right.
        check: whether an answer that a reader gives is right; a LabError where it cannot be read.
        asked: whether an exercise asks for it.
    """

    name: str
    printed: str
    ours: str
    unit: str
    difference: str
    agrees: bool | None
    erratum: str
    check: Callable[[str], bool]
    asked: bool = True


def number(name: str, printed: str, ours: float, unit: str = "", *, erratum: str = "", digits: int = 4) -> Answer:
    """A number; angles in degrees are the same after whole turns.

    Args:
        digits: after the point, of ours where nothing is printed.
    """
    decimals = _decimals(printed) if printed else digits
    last = 10.0**-decimals if decimals else 0.5  # a whole number is rounded

    def off(value: float) -> float:
        return (value - ours + 180) % 360 - 180 if unit == "°" else value - ours

    def check(text: str) -> bool:
        return abs(off(_read(text))) <= last * (1 + _EDGE)

    apart = off(_read(printed)) if printed else 0.0
    more = 1 if printed and (decimals or ours != round(ours)) else 0
    return Answer(
        name, printed, _written(ours, decimals + more), unit, _small(apart, "+") if printed else "",
        check(printed) if printed else None, erratum, check,
    )  # fmt: skip


def formula(
    name: str, printed: str, exact: Array, variables: Variables, *, right: str = "", erratum: str = ""
) -> Answer:
    """A formula, beside what the robot's model gives at random positions.

    Args:
        exact: values ``(n,)`` of the model.
        variables: what the letters are there.
        right: the right formula, where the printed one is not, or there is none.
    """

    def missed(text: str) -> float:
        values = evaluated(text, variables)
        wrong = float(np.abs(values - exact).max()) / max(1.0, float(np.abs(exact).max()))
        return wrong if np.isfinite(wrong) else np.inf

    def check(text: str) -> bool:
        return missed(text) <= _EXACT

    shown = right or printed
    if not check(shown):
        raise AssertionError(f"{name}: '{shown}' is not what the model gives, but off by {missed(shown):.2g}")
    apart = missed(printed) if printed else 0.0
    return Answer(
        name, printed, shown, "", f"{'up to ' if apart else ''}{_small(apart)}" if printed else "",
        check(printed) if printed else None, erratum, check,
    )  # fmt: skip


def drawn(name: str, printed: str, draws: Array, unit: str = "", *, erratum: str = "") -> Answer:
    """A number of one draw of the noise, beside the range of many draws ``(n,)`` of ours."""
    decimals = _decimals(printed)
    low, high = (float(value) for value in (draws.min(), draws.max()))
    slack = 10.0**-decimals / 2

    def check(text: str) -> bool:
        return low - slack <= _read(text) <= high + slack

    middle = float(np.median(draws))
    return Answer(
        name, printed, f"{_written(low, decimals)} to {_written(high, decimals)}", unit,
        f"{_small(_read(printed) - middle, '+')} of the median", check(printed), erratum, check, False,
    )  # fmt: skip


def at_least(name: str, printed: str, ours: float, unit: str = "") -> Answer:
    """The best of a search: ours agrees if it is at least as good, within a thousandth."""
    decimals, value = _decimals(printed), _read(printed)

    def check(text: str) -> bool:
        return abs(_read(text) - ours) <= 2e-3 * abs(ours)

    enough = bool(ours >= value * (1 - 1e-3))
    return Answer(name, printed, _written(ours, decimals), unit, _small(ours - value, "+"), enough, "", check)


def holds(name: str, gap: float, *, within: float = _EXACT, erratum: str = "") -> Answer:
    """An identity that the source states, and by how much its two sides differ at random positions."""
    true = bool(gap <= within)  # NumPy's booleans are none of JSON
    ours = f"{'holds' if true else 'does not hold'}, to {_small(gap)}"
    return Answer(name, "holds", ours, "", _small(gap), true, erratum, lambda text: False, False)


def word(name: str, printed: str, ours: str, *, erratum: str = "") -> Answer:
    """A word, or a list of names, each in any case and in any order."""

    def parts(text: str) -> list[str]:
        return sorted(part.strip().casefold() for part in text.replace(";", ",").split(","))

    def check(text: str) -> bool:
        return parts(text) == parts(ours)

    agrees = check(printed) if printed else None
    return Answer(name, printed, ours, "", "" if agrees is not False else "another", agrees, erratum, check)


def _decimals(text: str) -> int:
    return len(text.partition(".")[2])


def _read(text: str) -> float:
    """A number as a person writes it, with a comma or another minus too.

    Raises:
        LabError: it is none.
    """
    try:
        value = float(text.strip().replace(_MINUS, "-").replace("–", "-").replace(",", "."))
    except ValueError as error:
        raise LabError(f"'{text}' is not a number") from error
    if not np.isfinite(value):
        raise LabError(f"'{text}' is not a finite number")
    return value


def _small(value: float, sign: str = "-") -> str:
    """A difference, with one digit; a minus that no line breaks at."""
    return format(value, f"{sign}.1g").replace("-", _MINUS) if value else "0"


def _written(value: float, decimals: int) -> str:
    rounded = round(value, decimals) + 0.0
    return f"{rounded:.{decimals}f}".replace("-", _MINUS)
