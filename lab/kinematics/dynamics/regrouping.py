"""The formulas of base parameters in letters, as SYMORO+ prints them: which parameter is grouped into which, and how.

A coefficient of the regrouping is a polynomial of degree two at most in the lengths of the Denavit-Hartenberg table
(Gautier & Khalil 1990): a2, d4 and so on, with the number of their row; Khalil and Kleinfinger write d for a and r
for d. It is found by the base sets of arms whose lengths are drawn at random, and verified on the arm itself and on
another that took no part. Angles, and gravity, enter as numbers.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import combinations_with_replacement

import numpy as np

from lab.core.errors import LabError
from lab.core.se3 import Array
from lab.kinematics.dynamics.arm_dynamics import ArmDynamics
from lab.kinematics.dynamics.base_parameters import BaseParameters, base_parameters
from lab.kinematics.serial.chain import COLUMNS, Chain

__all__ = ["Formula", "Term", "regrouping_formulas"]

_LENGTHS = ("d", "a")
_ZERO_M = 1e-9
_SAME = 1e-6  # of the largest coefficient of an arm: what the formulas and its own regrouping may differ by
_NOTHING = 1e-7


@dataclass(frozen=True)
class Term:
    """Parameters that are grouped with one coefficient.

    Attributes:
        coefficient: monomials, each the letters that are multiplied, with their factors.
        names: of the standard parameters.
    """

    coefficient: tuple[tuple[tuple[str, ...], float], ...]
    names: tuple[str, ...]

    def value(self, letters: dict[str, float]) -> float:
        """The coefficient where the letters stand for these lengths (m)."""
        return sum(factor * float(np.prod([letters[each] for each in word])) for word, factor in self.coefficient)

    def words(self) -> str:
        """As it stands in a formula, with its sign before it."""
        if len(self.coefficient) == 1 and not self.coefficient[0][0] and abs(self.coefficient[0][1]) == 1:
            sign = "−" if self.coefficient[0][1] < 0 else "+"
            return " ".join(f"{sign} {name}" for name in self.names)
        names = self.names[0] if len(self.names) == 1 else f"({' + '.join(self.names)})"
        if len(self.coefficient) == 1:
            return f"{_monomial(*self.coefficient[0])} {names}"
        sums = " ".join(_monomial(*each) for each in sorted(self.coefficient, key=_positive_first))
        return f"+ ({sums.removeprefix('+ ')}) {names}"


@dataclass(frozen=True)
class Formula:
    """A base parameter: what it is named after, and what is grouped into that."""

    label: str
    name: str
    terms: tuple[Term, ...]

    def words(self) -> str:
        """The right side of its formula."""
        return " ".join([self.name, *(term.words() for term in self.terms)])


def regrouping_formulas(arm: ArmDynamics, base: BaseParameters, rng: np.random.Generator) -> tuple[Formula, ...]:
    """The formulas of a base set.

    Raises:
        LabError: the regrouping of this arm is no polynomial of its lengths.
    """
    letters = _letters(arm.chain)
    words = [word for degree in range(3) for word in combinations_with_replacement(sorted(letters), degree)]
    lengths = rng.uniform(0.5, 1.5, (len(words) + 2, len(letters)))
    samples = [dict(zip(letters, row, strict=True)) for row in lengths.tolist()]
    found = [_regrouping(arm, base, each, rng) for each in samples]
    monomials = np.array([[np.prod([each[letter] for letter in word]) for word in words] for each in samples])
    flat = np.array(found).reshape(len(samples), -1)
    factors = np.linalg.lstsq(monomials[1:], flat[1:], rcond=None)[0]  # the first takes no part
    factors = np.where(np.abs(factors - np.round(factors)) < _NOTHING, np.round(factors), factors)
    own = np.array([np.prod([letters[letter] for letter in word]) for word in words]) @ factors
    size = max(1.0, float(np.abs(flat).max(initial=0.0)))
    wrong = max(
        float(np.abs(monomials[0] @ factors - flat[0]).max(initial=0.0)),
        float(np.abs(own - base.regrouping.ravel()).max(initial=0.0)),
    )
    if wrong > _SAME * size:
        raise LabError(f"robot '{arm.chain.name}': its regrouping is no polynomial of its lengths (off by {wrong:.2g})")
    table = factors.reshape(len(words), *base.regrouping.shape)
    return tuple(
        Formula(label, base.names[kept], _terms(words, table[:, i], [base.names[j] for j in base.grouped]))
        for i, (label, kept) in enumerate(zip(base.labels, base.kept.tolist(), strict=True))
    )


def _letters(chain: Chain) -> dict[str, float]:
    """The lengths of a table that are not zero, by their letter; the constant of a slide is part of its position."""
    found = {}
    for i, row in enumerate(chain.table):
        for kind in _LENGTHS:
            value = float(row[COLUMNS.index(kind)])
            if abs(value) > _ZERO_M and not (kind == "d" and chain.prismatic[i]):
                found[f"{kind}{i + 1}"] = value
    return found


def _regrouping(arm: ArmDynamics, base: BaseParameters, letters: dict[str, float], rng: np.random.Generator) -> Array:
    """K of the arm with other lengths, by the same columns."""
    table = arm.chain.table.copy()
    for letter, value in letters.items():
        table[int(letter[1:]) - 1, COLUMNS.index(letter[0])] = value
    other = base_parameters(replace(arm, chain=arm.chain.with_table(table)), rng)
    if not (np.array_equal(other.kept, base.kept) and np.array_equal(other.grouped, base.grouped)):
        raise LabError(f"robot '{arm.chain.name}': its base parameters depend on its lengths beyond their letters")
    return other.regrouping


def _terms(words: Sequence[tuple[str, ...]], factors: Array, names: Sequence[str]) -> tuple[Term, ...]:
    """Terms of one formula, parameters with one coefficient together; ``factors`` ``(words, names)``."""
    grouped: dict[tuple[tuple[tuple[str, ...], float], ...], list[str]] = {}
    for column, name in zip(factors.T, names, strict=True):
        pairs = zip(words, column.tolist(), strict=True)
        coefficient = tuple((word, round(factor, 9)) for word, factor in pairs if abs(factor) > _NOTHING)
        if coefficient:
            grouped.setdefault(coefficient, []).append(name)
    terms = [Term(coefficient, tuple(each)) for coefficient, each in grouped.items()]
    return tuple(sorted(terms, key=lambda term: len(term.coefficient[0][0])))


def _positive_first(monomial: tuple[tuple[str, ...], float]) -> bool:
    return monomial[1] < 0


def _monomial(letters: tuple[str, ...], factor: float) -> str:
    """With its sign before it."""
    number = "" if letters and abs(abs(factor) - 1) < _NOTHING else _number(abs(factor))
    return " ".join(("−" if factor < 0 else "+", *filter(None, (number, _product(letters)))))


def _product(letters: tuple[str, ...]) -> str:
    if len(letters) == 2 and letters[0] == letters[1]:
        return f"{letters[0]}²"
    return " ".join(letters)


def _number(value: float) -> str:
    return f"{value:.0f}" if abs(value - round(value)) < _NOTHING else f"{value:.6g}"
