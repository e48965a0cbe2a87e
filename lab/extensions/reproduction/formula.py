"""Formulas as textbooks print them, evaluated at numbers: ``c1 c4 s5 − s1 c5``, ``atan2(y, x)``, ``L2 c2 + L3 c23``.

c and s with the numbers of joints are the cosine and sine of the sum of these joints' positions: c1 of q1, s23 of
q2 + q3. What stands side by side is multiplied. ``^`` is a power, ``√`` or ``sqrt`` a root, ``±`` is not known.
"""

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from lab.core.errors import LabError
from lab.core.limits import BRACKETS
from lab.core.se3 import Array

__all__ = ["Variables", "evaluated"]

Variables = Mapping[str, Array]
"""The variables of a formula by their names: sampled values ``(n,)``."""
_FUNCTIONS: dict[str, Callable[..., Array]] = {
    "atan2": np.arctan2, "atan": np.arctan, "acos": np.arccos, "asin": np.arcsin, "cos": np.cos, "sin": np.sin,
    "tan": np.tan, "sqrt": np.sqrt, "abs": np.abs,
}  # fmt: skip
_SAME = {"−": "-", "–": "-", "·": "*", "×": "*", "√": "sqrt", "²": "^2", "³": "^3", "π": "pi", "[": "(", "]": ")"}
_NUMBER = re.compile(r"\d+(\.\d+)?")
_TURN = re.compile(r"([cs])(\d+)")


def evaluated(text: str, variables: Variables) -> Array:
    """A formula at sampled values of its variables, ``(n,)``.

    Raises:
        LabError: the text is no formula of these variables.
    """
    plain = text
    for odd, usual in _SAME.items():
        plain = plain.replace(odd, usual)
    reader = _Reader(text, " ".join(plain.split()), variables)
    with np.errstate(all="ignore"):
        found = reader.sum()
    if reader.at < len(reader.plain):
        raise reader.error()
    return np.asarray(found + np.zeros_like(next(iter(variables.values()), np.zeros(1))), dtype=np.float64)


@dataclass
class _Reader:
    """A formula that is being read, by descent through sums, products and powers."""

    text: str
    plain: str
    variables: Variables
    at: int = 0
    depth: int = 0

    def sum(self) -> Array:
        """A sum of products."""
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
        """What is wrong with the text, where reading stopped."""
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
        for name in sorted((*self.variables, *_FUNCTIONS, "pi"), key=len, reverse=True):
            if self._skip(name):
                return self._named(name)
        if found := _TURN.match(self.plain, self.at):
            joints = [f"q{digit}" for digit in found[2]]
            if all(joint in self.variables for joint in joints):
                self.at = found.end()
                angle = sum((self.variables[joint] for joint in joints), start=np.zeros(1))
                return np.asarray(np.cos(angle) if found[1] == "c" else np.sin(angle))
        if found := _NUMBER.match(self.plain, self.at):
            self.at = found.end()
            return np.array(float(found[0]))
        raise self.error()

    def _named(self, name: str) -> Array:
        """A variable, a constant, or a function of what follows."""
        if name == "pi":
            return np.array(np.pi)
        if name in self.variables:
            return self.variables[name]
        if not self._skip("("):
            return _FUNCTIONS[name](self._power())
        arguments = [self.sum()]
        while self._skip(","):
            arguments.append(self.sum())
        self._closed()
        if len(arguments) != (2 if name == "atan2" else 1):
            raise self.error()
        return np.asarray(_FUNCTIONS[name](*arguments))

    def _closed(self) -> None:
        if not self._skip(")"):
            raise self.error()

    def _next(self) -> str:
        """The next sign that is no space; "" at the end."""
        while self.plain.startswith(" ", self.at):
            self.at += 1
        return self.plain[self.at : self.at + 1]

    def _skip(self, text: str) -> bool:
        self._next()
        if not self.plain.startswith(text, self.at):
            return False
        self.at += len(text)
        return True
