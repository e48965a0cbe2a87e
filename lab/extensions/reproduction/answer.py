"""Compare printed answers of a source with the lab's: numbers, formulas, random numbers, bounds and words.

A printed number agrees within one unit of its last digit, a whole number within half of one. A printed formula agrees
if its values are the lab's at random positions. A random number agrees if it lies in the range of many draws here.

The value "here" is always computed by the lab: of a formula, the value at the first of the random positions. A formula
or a value that the source leaves to the reader, or prints wrongly, has a solution, which must agree in its place.
"""

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from lab.core.se3 import Array
from lab.extensions.reproduction.formulas import Variables, evaluated

__all__ = [
    "ComparedValue",
    "Kind",
    "Place",
    "State",
    "at_least",
    "drawn",
    "formula",
    "given",
    "holds",
    "number",
    "stated",
    "unreadable",
    "word",
]

Kind = Literal["number", "formula", "word", "trivial", "check"]
"""Kind of an answer: ``trivial`` is a bare 0 or ±1, ``check`` an identity that the lab checks by itself."""
State = Literal["agrees", "differs", "erratum", "unreadable", "given", "open"]
"""Result of a comparison; ``open`` where the source leaves the answer to the reader."""
Place = tuple[str, int, int]
"""Name of a matrix, with an entry's row and column from 1."""

_EXACT = 1e-9  # of the largest value of a formula: equal
_EDGE = 1e-9  # of a unit of the last digit: rounding
_MINUS = "−"
_TRIVIAL = frozenset({"0", "1", "-1", "−1"})
_DIGITS = 4  # significant ones, of a formula's value


@dataclass(frozen=True)
class ComparedValue:
    """A printed value with the one computed here.

    Attributes:
        name: of the value, unique in its item.
        printed: by the source; "" where it is left to the reader.
        ours: the value that the lab computes.
        unit: of both.
        difference: between them, as text; "" where there is nothing to compare.
        agrees: True if the printed value equals the lab's; None where nothing is printed.
        erratum: reason why the printed value is wrong; "" where it is right.
        kind: of the answer.
        right: the correct answer in the source's letters, where the source does not print it.
        confirmed: False if the correct answer is not what the lab computes.
        conversion: reason why the printed value cannot be read in the converted text; "" where it can.
        is_given: True if the lab takes the printed value as it is, so that nothing is compared.
        place: of an entry of a matrix.
    """

    name: str
    printed: str
    ours: str
    unit: str
    difference: str
    agrees: bool | None
    erratum: str
    kind: Kind
    right: str = ""
    confirmed: bool = True
    conversion: str = ""
    is_given: bool = False
    place: Place | None = None

    @property
    def state(self) -> State:
        """Result of the comparison; a listed erratum that agrees differs from the list."""
        if self.is_given:
            return "given"
        if not self.confirmed:
            return "differs"
        if self.conversion:
            return "unreadable"
        if self.agrees is None:
            return "open"
        if self.erratum:
            return "differs" if self.agrees else "erratum"
        return "agrees" if self.agrees else "differs"

    @property
    def solution(self) -> str:
        """The correct answer: the formula that the lab confirms, else the value that it computes."""
        confirmed = self.right or (self.printed if self.agrees else "")
        return confirmed if confirmed and self.kind in ("formula", "trivial") and self.confirmed else self.ours


def number(
    name: str, printed: str, ours: float, unit: str = "", *, right: str = "", erratum: str = "", digits: int = 4
) -> ComparedValue:
    """Compare a number; angles in degrees are equal after whole turns.

    Args:
        right: the correct number, from elsewhere, where the printed one is wrong or missing.
        digits: after the point, of ours where nothing is printed.
    """
    shown = printed or right

    def error(text: str) -> float:
        return (_read(text) - ours + 180) % 360 - 180 if unit == "°" else _read(text) - ours

    def near(text: str) -> bool:
        decimals = _decimals(text)
        last_digit = 10.0**-decimals if decimals else 0.5  # a whole number is rounded
        return abs(error(text)) <= last_digit * (1 + _EDGE)

    written = _written(ours, _digits_beside(shown, ours) if shown else digits)
    return ComparedValue(
        name, printed, written, unit, _small(error(shown), "+") if shown else "",
        near(printed) if printed else None, erratum, "trivial" if shown in _TRIVIAL else "number",
        right, near(right) if right else True,
    )  # fmt: skip


def _digits_beside(shown: str, ours: float) -> int:
    """Return the digits of ours beside a printed number: one more, but for whole numbers."""
    decimals = _decimals(shown)
    whole = abs(ours - np.round(ours)) <= _EDGE * max(1.0, abs(ours))
    return decimals + (1 if decimals or not whole else 0)


def formula(
    name: str,
    printed: str,
    exact: Array,
    variables: Variables,
    *,
    right: str = "",
    erratum: str = "",
    angle: bool = False,
) -> ComparedValue:
    """Compare a formula with the robot's model at random positions.

    Args:
        exact: values ``(n,)`` of the model.
        variables: values of the letters; w is the sign of one of two roots.
        right: the correct formula, where the printed one is wrong or missing.
        angle: values that differ by whole turns are equal.
    """

    def missed(text: str) -> float:
        values = evaluated(text, variables)
        gap = np.remainder(values - exact + np.pi, 2 * np.pi) - np.pi if angle else values - exact
        wrong = float(np.abs(gap).max()) / max(1.0, float(np.abs(exact).max()))
        return wrong if np.isfinite(wrong) else np.inf

    def equal(text: str) -> bool:
        return missed(text) <= _EXACT

    shown, size = printed or right, max(1.0, float(np.abs(exact).max()))
    ours = float(exact[0]) if abs(exact[0]) > _EXACT * size else 0.0
    return ComparedValue(
        name, printed, f"{ours:.{_DIGITS}g}".replace("-", _MINUS), "", _small(missed(shown)),
        equal(printed) if printed else None, erratum, "trivial" if shown in _TRIVIAL else "formula",
        right, equal(right) if right else True,
    )  # fmt: skip


def drawn(
    name: str, printed: str, draws: Array, unit: str = "", *, right: str = "", erratum: str = ""
) -> ComparedValue:
    """Compare a number of one draw of the noise with the range of many draws ``(n,)`` of ours."""
    decimals = _decimals(printed)
    low, high = (float(value) for value in (draws.min(), draws.max()))
    slack = 10.0**-decimals / 2

    def within(text: str) -> bool:
        return low - slack <= _read(text) <= high + slack

    middle = float(np.median(draws))
    return ComparedValue(
        name, printed, f"{_written(low, decimals)} to {_written(high, decimals)}", unit,
        f"{_small(_read(printed) - middle, '+')} of the median", within(printed), erratum, "number",
        right, within(right) if right else True,
    )  # fmt: skip


def at_least(name: str, printed: str, ours: float, unit: str = "") -> ComparedValue:
    """Compare the best of a search: the lab's agrees if it is at least as good, in the printed digits."""
    decimals, value = _decimals(printed), _read(printed)
    enough = bool(ours >= value - 10.0**-decimals / 2)
    return ComparedValue(name, printed, _written(ours, decimals), unit, _small(ours - value, "+"), enough, "", "number")


def holds(name: str, gap: float, *, within: float = _EXACT, erratum: str = "") -> ComparedValue:
    """Check an identity of the source, by the difference of its two sides at random positions."""
    true = bool(gap <= within)  # NumPy's booleans are none of JSON
    ours = f"{'holds' if true else 'does not hold'}, to {_small(gap)}"
    return ComparedValue(name, "holds", ours, "", _small(gap), true, erratum, "check")


def word(name: str, printed: str, ours: str, *, right: str = "", erratum: str = "") -> ComparedValue:
    """Compare a word, or a list of names in any order."""
    agrees = _parts(printed) == _parts(ours) if printed else None
    return ComparedValue(
        name, printed, ours, "", "" if agrees is not False else "another", agrees, erratum, "word",
        right, _parts(right) == _parts(ours) if right else True,
    )  # fmt: skip


def stated(name: str, printed: str, *, holds: bool | None, found: str, why: str = "") -> ComparedValue:
    """Compare a statement in words.

    Args:
        holds: None where the interval leaves it open.
        why: it does not hold.
    """
    return ComparedValue(name, printed, found, "", "", holds, why if holds is False else "", "word")


def _parts(text: str) -> list[str]:
    """Return the names of a list, sorted."""
    return sorted(part.strip().casefold() for part in text.split(","))


def given(name: str, printed: str, unit: str = "") -> ComparedValue:
    """Return a printed value that the lab takes as it is: an input, which nothing is compared with."""
    ours = printed.replace("-", _MINUS)
    return ComparedValue(name, printed, ours, unit, "", None, "", "number", is_given=True)


def unreadable(answer: ComparedValue, conversion: str) -> ComparedValue:
    """Return an answer that is left to the reader, as one that is printed and cannot be read in the converted text."""
    return replace(answer, conversion=conversion)


def _decimals(text: str) -> int:
    return len(text.partition(".")[2])


def _read(text: str) -> float:
    return float(text.replace(_MINUS, "-"))


def _small(value: float, sign: str = "-") -> str:
    """Write a difference with one digit, and a minus without line breaks."""
    return format(value, f"{sign}.1g").replace("-", _MINUS) if value else "0"


def _written(value: float, decimals: int) -> str:
    rounded = round(value, decimals) + 0.0
    return f"{rounded:.{decimals}f}".replace("-", _MINUS)
