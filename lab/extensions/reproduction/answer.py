"""Compare printed answers of a source with the lab's: numbers, formulas, random numbers, bounds and words.

A printed number agrees within one unit of its last digit, a whole number within half of one. A printed formula agrees
if its values are the lab's at random positions. A random number agrees if it lies in the range of many draws here.

The value "here" is always computed by the lab: of a formula, the value at the first of the random positions. A formula
or a value that the source leaves to the reader, or prints wrongly, has a solution, which must agree in its place.
"""

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from lab.core.errors import LabError
from lab.core.se3 import Array
from lab.extensions.reproduction.formulas import (
    FormulaError,
    Variables,
    evaluated,
    exchanged,
    of_other_joints,
    terms,
)
from lab.extensions.reproduction.quantities import quantity

__all__ = [
    "Answer",
    "Kind",
    "Place",
    "State",
    "at_least",
    "drawn",
    "formula",
    "given",
    "holds",
    "number",
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
class Answer:
    """A printed value with the one computed here.

    Attributes:
        name: of the value, unique in its item.
        printed: by the source; "" where it is left to the reader.
        ours: the value that the lab computes.
        unit: of both.
        difference: between them, as text; "" where there is nothing to compare.
        agrees: True if the printed value equals the lab's; None where nothing is printed.
        erratum: reason why the printed value is wrong; "" where it is right.
        check: decides whether a reader's answer is right; a LabError where it cannot be read.
        kind: of the answer.
        right: the correct answer in the source's letters, where the source does not print it.
        confirmed: False if the correct answer is not what the lab computes.
        in_exercise: True if exercises contain it.
        conversion: reason why the printed value cannot be read in the converted text; "" where it can.
        is_given: True if the lab takes the printed value as it is, so that nothing is compared.
        place: of an entry of a matrix.
        advice: describes an answer that is nearly right, or right in another way, in a sentence; "" of any other.
        any_order: name of a set of rows that may be given in any order; "" where the order matters.
        decimals: number of digits after the point that a reader is asked for; None of what is no number.
    """

    name: str
    printed: str
    ours: str
    unit: str
    difference: str
    agrees: bool | None
    erratum: str
    check: Callable[[str], bool]
    kind: Kind
    right: str = ""
    confirmed: bool = True
    in_exercise: bool = True
    conversion: str = ""
    is_given: bool = False
    place: Place | None = None
    advice: Callable[[str], str] = lambda text: ""
    any_order: str = ""
    decimals: int | None = None

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
        """The correct answer, as a reader writes it."""
        return self.right or (self.printed if self.agrees and self.kind in ("formula", "trivial") else self.ours)


def number(
    name: str, printed: str, ours: float, unit: str = "", *, right: str = "", erratum: str = "", digits: int = 4
) -> Answer:
    """Compare a number; angles in degrees are equal after whole turns.

    Args:
        right: the correct number, from elsewhere, where the printed one is wrong or missing.
        digits: after the point, of ours where nothing is printed.
    """
    shown = printed or right

    def error(value: float) -> float:
        return (value - ours + 180) % 360 - 180 if unit == "°" else value - ours

    def last_digit(like: str) -> float:
        decimals = _decimals(like) if like else digits
        return 10.0**-decimals if decimals else 0.5  # a whole number is rounded

    def near(text: str, like: str) -> bool:
        return abs(error(_read(text))) <= last_digit(like) * (1 + _EDGE)

    def check(text: str) -> bool:
        return abs(error(quantity(text, unit))) <= last_digit(right or printed) * (1 + _EDGE)

    def advice(text: str) -> str:
        last = last_digit(right or printed)
        return "" if check(text) else _advice_on_number(quantity(text, unit), ours, unit, last)

    decimals = _decimals(shown) if shown else digits
    more = 1 if shown and (decimals or not abs(ours - np.round(ours)) <= _EDGE * max(1.0, abs(ours))) else 0
    return Answer(
        name, printed, _written(ours, decimals + more), unit, _small(error(_read(shown)), "+") if shown else "",
        near(printed, printed) if printed else None, erratum, check, "trivial" if shown in _TRIVIAL else "number",
        right, near(right, right) if right else True, advice=advice,
        decimals=_decimals(right or printed) if right or printed else digits,
    )  # fmt: skip


def formula(
    name: str,
    printed: str,
    exact: Array,
    variables: Variables,
    *,
    right: str = "",
    erratum: str = "",
    also: Sequence[str] = (),
    angle: bool = False,
    unknown: Sequence[str] = (),
) -> Answer:
    """Compare a formula with the robot's model at random positions.

    A letter w is the sign of one of two roots. A reader may choose one of them for good.

    Args:
        exact: values ``(n,)`` of the model.
        variables: values of the letters.
        right: the correct formula, where the printed one is wrong or missing.
        also: other valid solutions, such as the other sign of a root.
        angle: values that differ by whole turns are equal.
        unknown: letters that a reader may not use, besides those that the name asks for.
    """

    def distance(values: Array, other: Array) -> float:
        gap = np.remainder(values - other + np.pi, 2 * np.pi) - np.pi if angle else values - other
        wrong = float(np.abs(gap).max()) / max(1.0, float(np.abs(other).max()))
        return wrong if np.isfinite(wrong) else np.inf

    def missed(text: str) -> float:
        return distance(evaluated(text, variables), exact)

    def equal(text: str) -> bool:
        return missed(text) <= _EXACT

    solution = right or printed
    letters = _without_unknowns(name, solution, variables, unknown)

    def read(text: str) -> Array:
        try:
            return evaluated(text, letters)
        except FormulaError:
            if used := _used(text, letters, variables):
                raise LabError(f"{used} cannot be used in this answer: it is sought, or follows from that") from None
            raise

    def by_exact(text: str) -> bool:
        return distance(read(text), exact) <= _EXACT

    def by_other_root(text: str) -> bool:
        values = read(text)
        others = [evaluated(other, variables) for other in also]
        if "w" in variables:
            others += [evaluated(solution, {**variables, "w": np.full(exact.shape, sign)}) for sign in (1.0, -1.0)]
        return any(distance(values, other) <= _EXACT for other in others)

    def check(text: str) -> bool:
        return by_exact(text) or by_other_root(text)

    def advice(text: str) -> str:
        if by_exact(text):
            return ""
        if by_other_root(text):
            return "one of two solutions: the other root is one as well"
        return _advice_on_formula(text, exact, letters)

    shown, size = printed or right, max(1.0, float(np.abs(exact).max()))
    ours = float(exact[0]) if abs(exact[0]) > _EXACT * size else 0.0
    return Answer(
        name, printed, f"{ours:.{_DIGITS}g}".replace("-", _MINUS), "", _small(missed(shown)),
        equal(printed) if printed else None, erratum, check,
        "trivial" if shown in _TRIVIAL else "formula", right, equal(right) if right else True, advice=advice,
    )  # fmt: skip


def _without_unknowns(name: str, solution: str, variables: Variables, more: Sequence[str]) -> Variables:
    """Return the letters that a reader may use: not those that the name asks for, such as q2 of "q2 of x, y"."""
    words = re.findall(r"[cs]\d+|[A-Za-zα-ω]+\d*", name.partition(" of ")[0])
    unknown = {*more, *(variable for word in words for variable in _meant(word))}
    left = {key: values for key, values in variables.items() if key not in unknown}
    try:
        evaluated(solution, left)
    except LabError:  # the solution has them
        return variables
    return left


def _used(text: str, letters: Variables, variables: Variables) -> str:
    """Return the letter that a formula of all variables uses beyond the permitted ones; "" where it cannot be read."""
    try:
        evaluated(text, variables)
    except LabError:
        return ""
    for name in variables:
        if name not in letters:
            try:
                evaluated(text, {key: values for key, values in variables.items() if key != name})
            except LabError:
                return name
    return ""


def _meant(word: str) -> tuple[str, ...]:
    """Return the variables that a word of a name stands for: θ2, s2 and c2 stand for q2."""
    digits = re.search(r"\d+$", word)
    return (word, f"q{digits[0]}") if digits and word[0] in "csθ" else (word,)


def drawn(name: str, printed: str, draws: Array, unit: str = "", *, right: str = "", erratum: str = "") -> Answer:
    """Compare a number of one draw of the noise with the range of many draws ``(n,)`` of ours."""
    decimals = _decimals(printed)
    low, high = (float(value) for value in (draws.min(), draws.max()))
    slack = 10.0**-decimals / 2

    def check(text: str) -> bool:
        return low - slack <= _read(text) <= high + slack

    middle = float(np.median(draws))
    return Answer(
        name, printed, f"{_written(low, decimals)} to {_written(high, decimals)}", unit,
        f"{_small(_read(printed) - middle, '+')} of the median", check(printed), erratum, check, "number",
        right, check(right) if right else True, False,
    )  # fmt: skip


def at_least(name: str, printed: str, ours: float, unit: str = "") -> Answer:
    """Compare the best of a search: the lab's agrees if it is at least as good, in the printed digits."""
    decimals, value = _decimals(printed), _read(printed)

    def check(text: str) -> bool:
        return abs(_read(text) - ours) <= 2e-3 * abs(ours)

    enough = bool(ours >= value - 10.0**-decimals / 2)
    return Answer(name, printed, _written(ours, decimals), unit, _small(ours - value, "+"), enough, "", check, "number")


def holds(name: str, gap: float, *, within: float = _EXACT, erratum: str = "") -> Answer:
    """Check an identity of the source, by the difference of its two sides at random positions."""
    true = bool(gap <= within)  # NumPy's booleans are none of JSON
    ours = f"{'holds' if true else 'does not hold'}, to {_small(gap)}"
    return Answer(name, "holds", ours, "", _small(gap), true, erratum, lambda text: False, "check", in_exercise=False)


def word(name: str, printed: str, ours: str, *, right: str = "", erratum: str = "", also: Sequence[str] = ()) -> Answer:
    """Compare a word, or a list of names in any order, ignoring case, spaces and the spelling of letters.

    Args:
        also: other words for the same.
    """

    def check(text: str) -> bool:
        return _parts(text) in [_parts(each) for each in (ours, *also)]

    def advice(text: str) -> str:
        wanted, found = set(_parts(ours)), set(_parts(text))
        if check(text) or len(wanted) < 2 or not wanted & found:
            return ""
        more = len(found) - len(wanted)
        size = f", and {abs(more)} too {'many' if more > 0 else 'few'}" if more else ""
        return f"{len(wanted & found)} of {len(wanted)} are right{size}"

    agrees = _parts(printed) == _parts(ours) if printed else None
    return Answer(
        name, printed, ours, "", "" if agrees is not False else "another", agrees, erratum, check, "word",
        right, check(right) if right else True, advice=advice,
    )  # fmt: skip


_SPELLED = {
    "θ": "theta", "α": "alpha", "β": "beta", "ρ": "rho", "δ": "d", "delta": "d", "⁻": "-", "¹": "1", "^": "", "ᵗ": "t",
    "'": "t", "−": "-", "*": "", " or ": ",", ";": ",",
}  # fmt: skip


def _parts(text: str) -> list[str]:
    """Return the names of a list in a standard spelling, sorted."""
    plain = " ".join(text.casefold().split())
    for odd, usual in _SPELLED.items():
        plain = plain.replace(odd, usual)
    return sorted(part.replace(" ", "") for part in plain.split(","))


def given(name: str, printed: str, unit: str = "") -> Answer:
    """Return a printed value that the lab takes as it is: an input, which nothing is compared with."""
    return Answer(
        name, printed, printed.replace("-", _MINUS), unit, "", None, "", lambda text: False, "number",
        in_exercise=False, is_given=True,
    )  # fmt: skip


def unreadable(answer: Answer, conversion: str) -> Answer:
    """Return an answer that is left to the reader, as one that is printed and cannot be read in the converted text."""
    return replace(answer, conversion=conversion)


def _decimals(text: str) -> int:
    return len(text.partition(".")[2])


def _read(text: str) -> float:
    """Read a number as a person writes it, with a comma or another minus too."""
    try:
        value = float(text.strip().replace(_MINUS, "-").replace("–", "-").replace(",", "."))
    except ValueError as error:
        raise LabError(f"'{text}' is not a number") from error
    if not np.isfinite(value):
        raise LabError(f"'{text}' is not a finite number")
    return value


def _small(value: float, sign: str = "-") -> str:
    """Write a difference with one digit, and a minus without line breaks."""
    return format(value, f"{sign}.1g").replace("-", _MINUS) if value else "0"


def _written(value: float, decimals: int) -> str:
    rounded = round(value, decimals) + 0.0
    return f"{rounded:.{decimals}f}".replace("-", _MINUS)


_CLOSE = 0.02  # of a number: rounded, or mistyped


def _advice_on_number(value: float, ours: float, unit: str, last: float) -> str:
    """Describe how a wrong number is related to the right one; "" where it is not."""
    reasons = [
        ("the sign is the other one", -value), ("it is a thousand times too small: mm and m are mixed", 1000 * value),
        ("it is a thousand times too large: mm and m are mixed", value / 1000), ("it is half of it", 2 * value),
        ("it is twice that", value / 2),
    ]  # fmt: skip
    if unit.startswith("°"):
        turns = float(np.rad2deg(1.0))
        reasons += [
            ("radians, where degrees are asked", value * turns), ("it is half a turn from this one", value + 180),
            ("its supplement: 180° less the angle", 180 - value), ("its complement: 90° less the angle", 90 - value),
        ]  # fmt: skip
    if value:
        reasons.append(("its reciprocal", 1 / value))

    def gap(found: float) -> float:
        return abs((found - ours + 180) % 360 - 180) if unit == "°" else abs(found - ours)

    slack = max(last, 1e-3 * abs(ours))  # a near miss may be rounded
    if abs(ours) > last:
        for reason, found in reasons:
            if gap(found) <= slack:
                return reason
    if gap(value) <= max(_CLOSE * abs(ours), 2 * last):
        decimals = round(-np.log10(last)) if last < 0.5 else 0
        return f"close: {decimals} decimals are asked, so round last" if decimals else "close: check the last digit"
    return ""


def _advice_on_formula(text: str, exact: Array, variables: Variables) -> str:
    """Describe how the values of a wrong formula are related to the right ones; "" where they are not."""
    values = evaluated(text, variables)
    if not np.isfinite(values).all():
        return "it has no value at some positions: check roots and divisions"
    scale = _EXACT * max(1.0, float(np.abs(exact).max()))
    if np.abs(exact).max() <= scale:
        return ""

    def same(found: Array) -> bool:
        return bool(np.isfinite(found).all() and np.abs(found - exact).max() <= scale)

    if same(-values):
        return "the sign is the other one"
    parts = terms(text, variables)
    if len(parts) > 1 and any(same(values - 2 * part) for part in parts):
        return "the sign of one term is the other one"
    if same(exchanged(text, variables)):
        return "sine and cosine have changed places, or two angles"
    if same(-exchanged(text, variables)):
        return "sine and cosine have changed places, and the sign is the other one"
    with np.errstate(all="ignore"):
        if same(1 / values):
            return "it is the reciprocal"
        ratio = exact / values
    if np.isfinite(ratio).all() and np.ptp(ratio) <= _EXACT * abs(float(ratio[0])):
        return f"a constant factor is missing or too much: the right one is {float(ratio[0]):.4g} times as large"
    for written, found in of_other_joints(text, variables):
        if same(found):
            return f"look at '{written}': another joint belongs there"
    turned = (values - exact) / np.pi
    if np.abs(turned - np.round(turned)).max() <= 1e-6:
        return "right at some positions, else half a turn off: which quadrant? atan2 of two numbers tells"
    hits = int((np.abs(values - exact) <= scale).sum())
    if hits:
        return f"right at {hits} of {len(exact)} random positions: a sign or a root has another choice at the rest"
    return ""
