"""Read formulas as textbooks and students write them, and evaluate them at sampled values of their letters.

Examples are ``c1 c4 s5 − s1 c5``, ``atan2(y, x)``, ``L1*cos(q1) + L2*cos(q1 + q2)``. c and s with the numbers of
joints are the cosine and sine of the sum of these joints' positions: c1 of q1, s23 of q2 + q3. ``C1``, ``cθ1``,
``cos θ1`` and ``cos(theta_1)`` are c1, too, since a source's θ1 is the lab's q1; numbers may be subscripts: ``c₁``. A
Greek letter may be written by its name, and a length in the other case. Factors stand side by side. ``^`` and ``**``
are powers, ``√`` or ``sqrt`` a root, ``°`` a factor π/180, and ``±`` the letter w where a formula has one.

The reader knows these functions, the letters of the question and nothing else. Lengths, nesting and powers are bounded.
"""

import re
from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np

from lab.core.errors import LabError
from lab.core.limits import BRACKETS, FORMULA
from lab.core.se3 import Array

__all__ = ["FormulaError", "Variables", "evaluated", "exchanged", "of_other_joints", "terms"]

Variables = Mapping[str, Array]
"""The variables of a formula by their names: sampled values ``(n,)``."""
_FUNCTIONS: dict[str, Callable[..., Array]] = {
    "atan2": np.arctan2, "atan": np.arctan, "acos": np.arccos, "asin": np.arcsin, "cos": np.cos, "sin": np.sin,
    "tan": np.tan, "sqrt": np.sqrt, "abs": np.abs, "arctan2": np.arctan2, "arctan": np.arctan,
    "arctg": np.arctan, "arccos": np.arccos, "arcsin": np.arcsin, "tg": np.tan,
}  # fmt: skip
_TWO = ("atan2", "arctan2")  # functions of two arguments
_SAME = {
    "−": "-", "–": "-", "—": "-", "·": "*", "×": "*", "⋅": "*", "∙": "*", "√": "sqrt", "½": "(1/2)", "π": "pi",
    "ϕ": "φ", "ϑ": "θ", "[": "(", "]": ")", "**": "^", "$": "",
}  # fmt: skip
_SAME |= {chr(0x2080 + digit): str(digit) for digit in range(10)}  # subscripts
_SUPERSCRIPTS = str.maketrans("⁰¹²³⁴⁵⁶⁷⁸⁹⁻", "0123456789-")
_RAISED = re.compile("[⁰¹²³⁴⁵⁶⁷⁸⁹⁻]+")
_LATEX = (
    (re.compile(r"\\dot\s*\{\s*(\\?\w+)\s*\}|\\dot\s*(\\?[^\W\d_]+)"), r"d\1\2"),
    (re.compile(r"(\w)\u0307"), r"d\1"), (re.compile(r"\\var(theta|phi|rho)"), r"\\\1"),
    (re.compile(r"\\(left|right|quad|[,;!])"), " "), (re.compile(r"\\(cdot|times)"), "*"),
    (re.compile(r"_\{(\w+)\}"), r"\1"), (re.compile(r"[\\_]"), ""), (re.compile(r"\{"), "("), (re.compile(r"\}"), ")"),
)  # fmt: skip
_GREEK = {
    "α": "alpha", "β": "beta", "γ": "gamma", "δ": "delta", "θ": "theta", "ρ": "rho", "σ": "sigma", "φ": "phi",
    "ψ": "psi", "ω": "omega", "τ": "tau",
}  # fmt: skip
_NUMBER = re.compile(r"\d+(\.\d*)?|\.\d+")
_TURN = re.compile(r"([csCS])(?:(?:θ|theta)\s?)?(\d+)")
_TURN_OF_LETTER = re.compile(r"[csCS] ?(?=[α-ω]|alpha|beta|gamma|delta|theta|rho|phi|psi)")
_OF_JOINT = re.compile(r"(?<=[csqθCSQ])(?:_?\{?)(\d+)|(?<=theta)(?:_?\{?)(\d+)")
_SUM = re.compile(r"(?:q|θ|theta)(\d\d+)")
_JOINT = re.compile(r"q(\d+)")
_MAX_POWER = 20
_MOST_CHANGED = 30  # sines, cosines and angles that are tried with other joints
_SHOWN = 60  # letters of a formula in an error


class FormulaError(LabError):
    """A text is no formula of its letters.

    Attributes:
        known: the letters, in words.
    """

    def __init__(self, text: str, rest: str, known: str) -> None:
        super().__init__(f"formula '{_short(text)}': cannot be read from '{rest}' on; its letters are {known}")
        self.known = known


def evaluated(text: str, variables: Variables) -> Array:
    """Evaluate a formula at sampled values of its variables, ``(n,)``.

    Raises:
        LabError: the text is no formula of these variables.
    """
    return _whole(_reader(text, variables))


def exchanged(text: str, variables: Variables) -> Array:
    """Evaluate a formula with each sine as a cosine, and each cosine as a sine."""
    reader = _reader(text, variables)
    reader.functions = {**_FUNCTIONS, "cos": np.sin, "sin": np.cos}
    return _whole(reader)


def of_other_joints(text: str, variables: Variables) -> Iterator[tuple[str, Array]]:
    """Give one sine, cosine or angle of a formula to another joint, or a sum of two, each in turn.

    Yields:
        What was changed, as it is written, and the values of the changed formula.
    """
    joints = [found[1] for found in map(_JOINT.fullmatch, variables) if found]
    others = [*joints, *(one + two for one, two in pairwise(joints))]
    for found in list(_OF_JOINT.finditer(text))[:_MOST_CHANGED]:
        group = 1 if found[1] else 2
        for digits in others:
            if digits != found[group]:
                changed = text[: found.start(group)] + digits + text[found.end(group) :]
                with suppress(LabError):
                    yield text[found.start() - 1 : found.end()], evaluated(changed, variables)


def terms(text: str, variables: Variables) -> tuple[Array, ...]:
    """Return the values ``(n,)`` of the terms that a formula adds up, with their signs."""
    reader = _reader(text, variables)
    whole = _whole(reader)
    return tuple(np.asarray(term + np.zeros_like(whole)) for term in reader.terms)


def _reader(text: str, variables: Variables) -> "_Reader":
    FORMULA(f"formula '{text[:20]}…'", text)
    plain = _RAISED.sub(lambda found: f"^({found[0].translate(_SUPERSCRIPTS)})", text)
    for pattern, usual in _LATEX:
        plain = pattern.sub(usual, plain)
    for odd, usual in _SAME.items():
        plain = plain.replace(odd, usual)
    if "w" in variables:
        plain = plain.replace("±", "w ").replace("+/-", "w ")
    return _Reader(text, " ".join(plain.split()), variables, _letters(variables))


def _short(text: str) -> str:
    return text if len(text) <= _SHOWN else f"{text[:_SHOWN]}…"


def _letters(variables: Variables) -> Variables:
    """Return the variables by all names that a reader may give them; a name of the source comes first."""
    found: dict[str, Array] = {}
    for name, values in variables.items():
        if joint := _JOINT.fullmatch(name):
            found |= {f"{letter}{joint[1]}": values for letter in ("θ", "theta")}
    for name, values in variables.items():
        latin = name
        for greek, word in _GREEK.items():
            latin = latin.replace(greek, word)
        other = name[0].swapcase() + name[1:]
        if other[0] not in "cCsSqQ" and len(other) <= 2 and other.isascii():
            found.setdefault(other, values)
        found.setdefault(latin, values)
    return {**found, **variables}


def _whole(reader: "_Reader") -> Array:
    with np.errstate(all="ignore"):
        found = reader.sum()
    if reader.at < len(reader.plain):
        raise reader.error()
    return np.asarray(found + np.zeros_like(next(iter(reader.variables.values()), np.zeros(1))), dtype=np.float64)


@dataclass
class _Reader:
    """Reader of a formula, by descent through sums, products and powers.

    Attributes:
        text: as written.
        plain: the same with usual signs.
        variables: letters that an error names.
        letters: these and other names of them.
        functions: by their names.
        terms: of the outermost sum.
    """

    text: str
    plain: str
    variables: Variables
    letters: Variables
    functions: Mapping[str, Callable[..., Array]] = field(default_factory=lambda: _FUNCTIONS)
    terms: list[Array] = field(default_factory=list)
    at: int = 0
    depth: int = 0

    def sum(self) -> Array:
        """Read a sum of products."""
        outermost = self.depth == 0
        total: Array = np.zeros(1)
        sign = self._sign()
        while True:
            term = sign * self._product()
            total = total + term
            if outermost:
                self.terms.append(term)
            if self._next() not in ("+", "-"):
                break
            sign = self._sign()
        return total

    def error(self) -> LabError:
        """Return the syntax error at the position where parsing stopped."""
        joints = ("c1, s1, c12 … of joints",) if any(map(_JOINT.fullmatch, self.variables)) else ()
        known = ", ".join((*self.variables, *joints)) or "none: write a number"
        rest = _short(self.plain[self.at :]) or "its end"
        return FormulaError(self.text, rest, known)

    def _sign(self) -> int:
        """Read the sign of a term; 1 where there is none."""
        negative = self._skip("-")
        self._skip("+")
        return -1 if negative else 1

    def _product(self) -> Array:
        product = self._power()
        while self._next() not in ("", "+", "-", ")", ","):
            over = self._skip("/")
            if not over and not self._skip("*") and self._after_number() and _NUMBER.match(self.plain, self.at):
                raise self.error()  # "1 200" is no product
            factor = self._power()
            product = product / factor if over else product * factor
        return product

    def _after_number(self) -> bool:
        return bool(re.search(r"(^|[^\w.])\d[\d.]*$", self.plain[: self.at].rstrip()))

    def _power(self) -> Array:
        base = self._factor()
        while self._next() in ("^", "°"):
            base = base * np.pi / 180 if self._skip("°") else np.asarray(np.power(base, self._exponent()))
        return base

    def _exponent(self) -> float:
        """Read ``^`` and a power: a number without letters."""
        self._skip("^")
        start = self.at
        sign = -1.0 if self._skip("-") else 1.0
        bare = _Reader(self.text, self.plain, {}, {}, self.functions, at=self.at, depth=self.depth)
        value = bare._factor()
        if value.size != 1 or not abs(float(value.ravel()[0])) <= _MAX_POWER:
            self.at = start
            raise self.error()
        self.at = bare.at
        return sign * float(value.ravel()[0])

    def _factor(self) -> Array:
        self.depth += 1
        if self.depth > BRACKETS.most:
            raise LabError(f"formula '{_short(self.text)}': more than {BRACKETS.most} brackets in each other")
        found = self._one()
        self.depth -= 1
        return found

    def _one(self) -> Array:
        """Read a number, a letter, a function or a bracket."""
        if self._skip("-"):
            return -self._power()
        if self._skip("("):
            inner = self.sum()
            self._closed()
            return inner
        if self._skip("frac"):
            over = self._factor()
            return over / self._factor()
        if (found := _SUM.match(self.plain, self.at)) and found[0] not in self.letters:
            if (angle := self._joints(found[1])) is None:
                raise self.error()  # "q27" is no product of q2 and 7
            self.at = found.end()
            return angle
        for name in sorted((*self.letters, *self.functions, "pi"), key=len, reverse=True):
            if self._skip(name):
                return self._named(name)
        if (found := _TURN.match(self.plain, self.at)) and (angle := self._joints(found[2])) is not None:
            self.at = found.end()
            return self.functions["cos" if found[1] in "cC" else "sin"](angle)
        if found := _TURN_OF_LETTER.match(self.plain, self.at):
            self.at = found.end()
            return self.functions["cos" if found[0][0] in "cC" else "sin"](self._factor())
        if found := _NUMBER.match(self.plain, self.at):
            self.at = found.end()
            return np.array(float(found[0]))
        raise self.error()

    def _joints(self, digits: str) -> Array | None:
        """Return the sum of the positions of some joints; None if one of them is no variable."""
        found = [self.variables.get(f"q{digit}", self.variables.get(f"θ{digit}")) for digit in digits]
        if any(each is None for each in found):
            return None
        return np.asarray(sum((each for each in found if each is not None), start=np.zeros(1)))

    def _named(self, name: str) -> Array:
        """Read a variable, a constant, or a function with its arguments."""
        if name == "pi":
            return np.array(np.pi)
        if name in self.letters:
            return self.letters[name]
        power = self._exponent() if self._next() == "^" else 1.0
        if not self._skip("("):
            if name in _TWO:
                raise self.error()
            return np.asarray(self.functions[name](self._factor()) ** power)
        arguments = [self.sum()]
        while self._skip(","):
            arguments.append(self.sum())
        self._closed()
        if len(arguments) != (2 if name in _TWO else 1):
            raise self.error()
        return np.asarray(self.functions[name](*arguments) ** power)

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
