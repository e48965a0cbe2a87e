"""The determinant of an arm's Jacobian as a product whose factors are zero where the arm is singular."""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Literal

import numpy as np

from lab.core.se3 import Array

__all__ = ["Determinant", "Factor", "Term", "determinant", "real_part"]

NONE = 1e-12  # of a coefficient (m): it is left out
DIGITS = 6  # of a number in a text


@dataclass(frozen=True)
class Term:
    """A coefficient times the sine or the cosine of a sum of joint positions, times the joint positions of slides.

    Attributes:
        coefficient: m, or without a unit where there is a slide.
        function: of the angle; empty where there is none.
        angle: how each joint position counts in the angle, by joint: +1 or -1, or a multiple.
        slides: the joints whose joint positions are factors.
    """

    coefficient: float
    function: Literal["", "sin", "cos"] = ""
    angle: tuple[tuple[int, float], ...] = ()
    slides: tuple[int, ...] = ()

    def at(self, joints: Array) -> Array:
        """Values ``(...)`` at joint positions ``(..., n)``."""
        angle = sum((sign * joints[..., joint] for joint, sign in self.angle), start=np.zeros(joints.shape[:-1]))
        turned = np.sin(angle) if self.function == "sin" else np.cos(angle)  # cos 0 where there is no function
        return np.asarray(self.coefficient * turned * joints[..., list(self.slides)].prod(axis=-1))

    def words(self, names: tuple[str, ...]) -> str:
        """Its size for a person, without the coefficient's sign; empty for 1."""
        words = [] if abs(self.size - 1) < NONE and (self.function or self.slides) else [number(self.size)]
        words += [names[joint] for joint in self.slides]
        if self.function:
            parts = [("+" if sign > 0 else "-", "" if abs(sign) == 1 else f"{abs(sign):g} * ", names[joint])
                     for joint, sign in self.angle]  # fmt: skip
            angle = "".join(map("".join, parts)).removeprefix("+")
            alone = len(self.angle) == 1 and abs(self.angle[0][1]) == 1
            words.append(f"{self.function} {angle}" if alone else f"{self.function}({angle})")
        return " ".join(words)

    @property
    def size(self) -> float:
        """Of the coefficient."""
        return abs(self.coefficient)


@dataclass(frozen=True)
class Factor:
    """A sum of terms that is zero at one kind of singularity.

    Attributes:
        name: of the singularity, for people.
        names: the joints'.
    """

    name: str
    terms: tuple[Term, ...]
    names: tuple[str, ...]

    def at(self, joints: Array) -> Array:
        """Values ``(...)`` at joint positions ``(..., n)``: m, or the sine of an angle."""
        return sum((term.at(joints) for term in self.terms), start=np.zeros(joints.shape[:-1]))

    @property
    def text(self) -> str:
        """As one writes it, like ``0.302 cos q3 + 0.07 sin q3``."""
        text = ""
        for term in self.terms:
            sign = ("" if term.coefficient > 0 else "-") if not text else (" + " if term.coefficient > 0 else " - ")
            text += sign + term.words(self.names)
        return text or "0"


@dataclass(frozen=True)
class Determinant:
    """A sign, lengths (m) and factors, whose product it is."""

    sign: float
    lengths: tuple[float, ...]
    factors: tuple[Factor, ...]

    def at(self, joints: Array) -> Array:
        """Values ``(...)`` at joint positions ``(..., n)``."""
        constant = self.sign * np.prod(self.lengths)
        return np.asarray(constant * np.prod([factor.at(joints) for factor in self.factors], axis=0))

    @property
    def text(self) -> str:
        """As one writes it, like ``-0.27 (0.302 cos q3 + 0.07 sin q3) sin q5``."""
        factors = [f"({factor.text})" if len(factor.terms) > 1 else factor.text for factor in self.factors]
        words = [part for part in (" * ".join(number(length) for length in self.lengths), *factors) if part]
        return ("-" if self.sign < 0 else "") + " ".join(words)


def determinant(
    names: tuple[str, ...], sign: float, lengths: Iterable[float], factors: Iterable[tuple[str, Iterable[Term]]]
) -> Determinant:
    """The product tidied: no term without a coefficient, none that begins with a minus, and numbers in front."""
    numbers, tidied = list(lengths), []
    for name, terms in factors:
        kept = tuple(term for term in terms if term.size > NONE)
        if kept:
            scale = np.sign(kept[0].coefficient) * (kept[0].size if len(kept) == 1 else 1.0)
            sign *= np.sign(scale)
            numbers.append(abs(float(scale)))
            kept = tuple(Term(t.coefficient / scale, t.function, t.angle, t.slides) for t in kept)
        tidied.append(Factor(name, kept, names))
    return Determinant(sign, tuple(length for length in numbers if abs(length - 1) > NONE), tuple(tidied))


def real_part(number: complex, turning: Iterable[tuple[int, float]], slides: tuple[int, ...] = ()) -> list[Term]:
    """Re(number exp(i angle)), for an angle that is the sum of some joint positions, each times its sign."""
    angle = tuple(turning)
    if not angle:
        return [Term(number.real, slides=slides)]
    first = angle[0][1]  # the angle's first joint position counts positive, so that texts are alike
    angle = tuple((joint, first * sign) for joint, sign in angle)
    return [Term(-first * number.imag, "sin", angle, slides), Term(number.real, "cos", angle, slides)]


def number(value: float) -> str:
    """A length for a person, m."""
    return f"{value:.{DIGITS}g}"
