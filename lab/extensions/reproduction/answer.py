"""Compare printed answers of a source with the lab's: numbers, formulas, random numbers, bounds and words.

A printed number agrees within one unit of its last digit, a whole number within half of one. A printed formula agrees
if its values are the lab's at random positions. A random number agrees if it lies in the range of many draws here.

The value "here" is always computed by the lab: of a formula, the value at the first of the random positions. A formula
or a value that the source leaves to the reader, or prints wrongly, has a solution, which must agree in its place.

Formulas are read as textbooks print them: ``c1 c4 s5 − s1 c5``, ``atan2(y, x)``, ``L2 c2 + L3 c23``. c and s with the
numbers of joints are the cosine and sine of the sum of these joints' positions: c1 of q1, s23 of q2 + q3. ``C1``,
``cθ1`` and ``cos θ1`` are c1, too, since a source's θ1 is the lab's q1; numbers may be subscripts: ``c₁``. Lengths have
the letters of the source's table, a3 and r4 for 0.5. Factors stand side by side. ``^`` is a power, ``√`` or ``sqrt`` a
root; ``±`` is not supported.
"""

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from lab.core.errors import LabError
from lab.core.limits import BRACKETS
from lab.core.se3 import Array

__all__ = [
    "Answer",
    "Kind",
    "Place",
    "State",
    "Variables",
    "at_least",
    "drawn",
    "evaluated",
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

Variables = Mapping[str, Array]
"""The variables of a formula by their names: sampled values ``(n,)``."""
_FUNCTIONS: dict[str, Callable[..., Array]] = {
    "atan2": np.arctan2, "atan": np.arctan, "acos": np.arccos, "asin": np.arcsin, "cos": np.cos, "sin": np.sin,
    "tan": np.tan, "sqrt": np.sqrt, "abs": np.abs, "arctan2": np.arctan2, "arctan": np.arctan,
    "arctg": np.arctan, "arccos": np.arccos, "arcsin": np.arcsin, "tg": np.tan,
}  # fmt: skip
_TWO = ("atan2", "arctan2")  # functions of two arguments
_SAME = {"−": "-", "–": "-", "·": "*", "×": "*", "√": "sqrt", "²": "^2", "³": "^3", "π": "pi", "[": "(", "]": ")"}
_SAME |= {chr(0x2080 + digit): str(digit) for digit in range(10)}  # subscripts
_NUMBER = re.compile(r"\d+(\.\d+)?")
_TURN = re.compile(r"([csCS])(?:θ|theta)?(\d+)")
_JOINT = re.compile(r"q(\d+)")


def evaluated(text: str, variables: Variables) -> Array:
    """Evaluate a formula at sampled values of its variables, ``(n,)``.

    Raises:
        LabError: the text is no formula of these variables.
    """
    plain = text
    for odd, usual in _SAME.items():
        plain = plain.replace(odd, usual)
    turns = {f"{name}{joint[1]}": values for key, values in variables.items() if (joint := _JOINT.fullmatch(key))
             for name in ("θ", "theta")}  # fmt: skip
    reader = _Reader(text, " ".join(plain.split()), variables, {**turns, **variables})
    with np.errstate(all="ignore"):
        found = reader.sum()
    if reader.at < len(reader.plain):
        raise reader.error()
    return np.asarray(found + np.zeros_like(next(iter(variables.values()), np.zeros(1))), dtype=np.float64)


@dataclass
class _Reader:
    """Reader of a formula, by descent through sums, products and powers.

    Attributes:
        text: as written.
        plain: the same with usual signs.
        variables: letters that an error names.
        letters: these and other names of the joints.
    """

    text: str
    plain: str
    variables: Variables
    letters: Variables
    at: int = 0
    depth: int = 0

    def sum(self) -> Array:
        """Read a sum of products."""
        self.depth += 1
        if self.depth > BRACKETS.most:
            raise LabError(f"formula '{self.text}': more than {BRACKETS.most} brackets in each other")
        total: Array = np.zeros(1)
        sign = -1 if self._skip("-") else 1
        self._skip("+")
        while True:
            total = total + sign * self._product()
            if self._next() not in ("+", "-"):
                break
            sign = -1 if self._skip("-") else 1
            self._skip("+")
        self.depth -= 1
        return total

    def error(self) -> LabError:
        """Return the syntax error at the position where parsing stopped."""
        known = ", ".join((*self.variables, "c1, s1, c12 … of joints"))
        rest = self.plain[self.at :] or "its end"
        return LabError(f"formula '{self.text}': cannot be read from '{rest}' on; its letters are {known}")

    def _product(self) -> Array:
        product = self._power()
        while self._next() not in ("", "+", "-", ")", ","):
            over = self._skip("/")
            if not over:
                self._skip("*")
            factor = self._power()
            product = product / factor if over else product * factor
        return product

    def _power(self) -> Array:
        base = self._factor()
        if not self._skip("^"):
            return base
        self._next()
        found = _NUMBER.match(self.plain, self.at)
        if found is None:
            raise self.error()
        self.at = found.end()
        return np.asarray(base ** float(found[0]))

    def _factor(self) -> Array:
        if self._skip("-"):
            return -self._power()
        if self._skip("("):
            inner = self.sum()
            self._closed()
            return inner
        for name in sorted((*self.letters, *_FUNCTIONS, "pi"), key=len, reverse=True):
            if self._skip(name):
                return self._named(name)
        if found := _TURN.match(self.plain, self.at):
            joints = [f"q{digit}" for digit in found[2]]
            if all(joint in self.variables for joint in joints):
                self.at = found.end()
                angle = sum((self.variables[joint] for joint in joints), start=np.zeros(1))
                return np.asarray(np.cos(angle) if found[1] in "cC" else np.sin(angle))
        if found := _NUMBER.match(self.plain, self.at):
            self.at = found.end()
            return np.array(float(found[0]))
        raise self.error()

    def _named(self, name: str) -> Array:
        """Read a variable, a constant, or a function with its arguments."""
        if name == "pi":
            return np.array(np.pi)
        if name in self.letters:
            return self.letters[name]
        if not self._skip("("):
            return _FUNCTIONS[name](self._power())
        arguments = [self.sum()]
        while self._skip(","):
            arguments.append(self.sum())
        self._closed()
        if len(arguments) != (2 if name in _TWO else 1):
            raise self.error()
        return np.asarray(_FUNCTIONS[name](*arguments))

    def _closed(self) -> None:
        if not self._skip(")"):
            raise self.error()

    def _next(self) -> str:
        """Return the next character that is no space; "" at the end."""
        while self.plain.startswith(" ", self.at):
            self.at += 1
        return self.plain[self.at : self.at + 1]

    def _skip(self, text: str) -> bool:
        self._next()
        if not self.plain.startswith(text, self.at):
            return False
        self.at += len(text)
        return True


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

    def near(text: str, like: str) -> bool:
        decimals = _decimals(like) if like else digits
        last = 10.0**-decimals if decimals else 0.5  # a whole number is rounded
        return abs(error(_read(text))) <= last * (1 + _EDGE)

    def check(text: str) -> bool:
        return near(text, right or printed)

    decimals = _decimals(shown) if shown else digits
    more = 1 if shown and (decimals or not abs(ours - np.round(ours)) <= _EDGE * max(1.0, abs(ours))) else 0
    return Answer(
        name, printed, _written(ours, decimals + more), unit, _small(error(_read(shown)), "+") if shown else "",
        near(printed, printed) if printed else None, erratum, check, "trivial" if shown in _TRIVIAL else "number",
        right, near(right, right) if right else True,
    )  # fmt: skip


def formula(
    name: str, printed: str, exact: Array, variables: Variables, *, right: str = "", erratum: str = ""
) -> Answer:
    """Compare a formula with the robot's model at random positions.

    Args:
        exact: values ``(n,)`` of the model.
        variables: values of the letters.
        right: the correct formula, where the printed one is wrong or missing.
    """

    def missed(text: str) -> float:
        values = evaluated(text, variables)
        wrong = float(np.abs(values - exact).max()) / max(1.0, float(np.abs(exact).max()))
        return wrong if np.isfinite(wrong) else np.inf

    def check(text: str) -> bool:
        return missed(text) <= _EXACT

    shown, size = printed or right, max(1.0, float(np.abs(exact).max()))
    ours = float(exact[0]) if abs(exact[0]) > _EXACT * size else 0.0
    return Answer(
        name, printed, f"{ours:.{_DIGITS}g}".replace("-", _MINUS), "", _small(missed(shown)),
        check(printed) if printed else None, erratum, check,
        "trivial" if shown in _TRIVIAL else "formula", right, check(right) if right else True,
    )  # fmt: skip


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


def word(name: str, printed: str, ours: str, *, right: str = "", erratum: str = "") -> Answer:
    """Compare a word, or a list of names in any order, ignoring case."""

    def parts(text: str) -> list[str]:
        return sorted(part.strip().casefold() for part in text.replace(";", ",").split(","))

    def check(text: str) -> bool:
        return parts(text) == parts(ours)

    agrees = check(printed) if printed else None
    return Answer(
        name, printed, ours, "", "" if agrees is not False else "another", agrees, erratum, check, "word",
        right, check(right) if right else True,
    )  # fmt: skip


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
