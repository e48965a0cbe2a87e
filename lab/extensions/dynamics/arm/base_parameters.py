"""Find the base dynamic parameters of an arm: the combinations of standard parameters that its torques determine.

The regressor at random states has columns that depend on others, whatever the motion. By an orthogonal factorization
of its columns, in an order that prefers the parameters of SYMORO+ (XX XY XZ YZ ZZ MX MY, then Ia; Khalil & Creusot
1997), a column whose diagonal of R vanishes depends on those before it (Gautier 1991): W2 = W1 K, and the base
parameters are X1 + K X2. Parameters with a column of zeros affect no torque.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations_with_replacement

import numpy as np
from numpy.typing import NDArray

from lab.core.errors import LabError
from lab.core.se3 import Array
from lab.kinematics.dynamics.rigid_body import ArmDynamics
from lab.kinematics.serial.chain import COLUMNS

__all__ = ["BaseParameters", "Formula", "base_parameters", "random_states", "regrouping_formulas"]

_STATES = 24  # random ones, each with a row a joint: half as many rows again as six joints have parameters
_DEPENDS = 1e-8  # of a column's norm: largest residual of a dependent column
_GROUPED_FIRST = ("Ia", "M", "MZ", "YY")  # kinds, into the others where possible
_ZERO_M = 1e-9
_SAME = 1e-6  # of an arm's largest coefficient: largest error of the formulas
_ZERO = 1e-7


@dataclass(frozen=True)
class BaseParameters:
    """A base set of the standard parameters.

    Attributes:
        names: of the standard parameters, p of them.
        independent: ``(b,)`` indices of the independent columns; ``grouped`` ``(g,)`` of those that depend on them.
        without_effect: indices of parameters that affect no torque.
        regrouping: K ``(b, g)``.
    """

    names: tuple[str, ...]
    independent: NDArray[np.int_]
    grouped: NDArray[np.int_]
    without_effect: NDArray[np.int_]
    regrouping: Array

    @property
    def size(self) -> int:
        """Number of base parameters."""
        return len(self.independent)

    @property
    def labels(self) -> tuple[str, ...]:
        """Names: of the standard parameter, with R where others are grouped into it."""
        with_others = np.abs(self.regrouping).max(axis=1, initial=0.0) > 0
        kinds = [(self.names[i], self.names[i].rstrip("0123456789")) for i in self.independent.tolist()]
        return tuple(
            f"{kind}R{name[len(kind) :]}" if grouped else name
            for (name, kind), grouped in zip(kinds, with_others.tolist(), strict=True)
        )

    @property
    def inertial(self) -> int:
        """Number of base parameters of links and motors, without friction and offsets."""
        return sum(self.names[i][0] not in "Fo" for i in self.independent.tolist())

    @property
    def projection(self) -> Array:
        """Matrix ``(b, p)`` from standard to base parameters."""
        matrix = np.zeros((self.size, len(self.names)))
        matrix[np.arange(self.size), self.independent] = 1.0
        matrix[:, self.grouped] = self.regrouping
        return matrix


def random_states(arm: ArmDynamics, count: int, rng: np.random.Generator) -> tuple[Array, Array, Array]:
    """Draw joint positions over a whole turn (1 m of slides), speeds and accelerations ``(count, J)``."""
    shape = (count, arm.chain.size)
    joints = rng.uniform(-1.0, 1.0, shape) * np.where(arm.chain.prismatic, 1.0, np.pi)
    return joints, rng.uniform(-2.0, 2.0, shape), rng.uniform(-5.0, 5.0, shape)


def base_parameters(arm: ArmDynamics, rng: np.random.Generator) -> BaseParameters:
    """Find the base parameters of an arm, at random states."""
    columns = arm.regressor(*random_states(arm, _STATES, rng)).reshape(-1, len(arm.names))
    size = np.linalg.norm(columns, axis=0)
    effect = size > _DEPENDS * size.max()
    order = np.array([i for i in _preferred(arm.names) if effect[i]])
    triangle = np.linalg.qr(columns[:, order] / size[order], mode="r")
    independent = np.abs(np.diag(triangle)) > _DEPENDS
    chosen, rest = np.sort(order[independent]), np.sort(order[~independent])
    regrouping = np.linalg.lstsq(columns[:, chosen] / size[chosen], columns[:, rest], rcond=None)[0]
    regrouping = regrouping / size[chosen][:, None]
    regrouping[np.abs(regrouping) < _DEPENDS] = 0.0
    return BaseParameters(arm.names, chosen, rest, np.flatnonzero(~effect), regrouping)


def _preferred(names: tuple[str, ...]) -> list[int]:
    """Return indices of the standard parameters, preferred base parameters first, each kind from the base outward."""
    kinds = [name.rstrip("0123456789") for name in names]
    rank = [_GROUPED_FIRST.index(kind) + 1 if kind in _GROUPED_FIRST else 0 for kind in kinds]
    numbers = [int(name[len(kind) :]) for name, kind in zip(names, kinds, strict=True)]
    return sorted(range(len(names)), key=lambda i: (rank[i], numbers[i]))


@dataclass(frozen=True)
class _Term:
    """Parameters that are grouped with one coefficient.

    Attributes:
        coefficient: monomials: the letters multiplied, with their factors.
        names: of the standard parameters.
    """

    coefficient: tuple[tuple[tuple[str, ...], float], ...]
    names: tuple[str, ...]

    def value(self, letters: dict[str, float]) -> float:
        """Return the coefficient for these lengths (m)."""
        return sum(factor * float(np.prod([letters[each] for each in word])) for word, factor in self.coefficient)

    def text(self) -> str:
        """Return the term as text with a leading sign, for use in a formula."""
        if len(self.coefficient) == 1 and not self.coefficient[0][0] and abs(self.coefficient[0][1]) == 1:
            sign = "−" if self.coefficient[0][1] < 0 else "+"
            return " ".join(f"{sign} {name}" for name in self.names)
        names = self.names[0] if len(self.names) == 1 else f"({' + '.join(self.names)})"
        if len(self.coefficient) == 1:
            return f"{_monomial(*self.coefficient[0])} {names}"
        sums = " ".join(_monomial(*each) for each in sorted(self.coefficient, key=lambda each: each[1] < 0))
        return f"+ ({sums.removeprefix('+ ')}) {names}"


@dataclass(frozen=True)
class Formula:
    """A base parameter: a standard parameter and the terms grouped into it."""

    label: str
    name: str
    terms: tuple[_Term, ...]

    def text(self) -> str:
        """Return the right side of the formula."""
        return " ".join([self.name, *(term.text() for term in self.terms)])


def regrouping_formulas(arm: ArmDynamics, base: BaseParameters, rng: np.random.Generator) -> tuple[Formula, ...]:
    """Return the formulas of base parameters.

    Raises:
        LabError: the regrouping of the arm is no polynomial of its lengths.
    """
    letters = {name: float(arm.chain.table[place]) for name, place in _places(arm).items()}
    products = [word for degree in range(3) for word in combinations_with_replacement(sorted(letters), degree)]
    # K of arms of random lengths, and its factors by least squares; the first arm is a check
    lengths = rng.uniform(0.5, 1.5, (len(products) + 2, len(letters)))
    samples = [dict(zip(letters, row, strict=True)) for row in lengths.tolist()]
    flat = np.array([_regrouping(arm, base, sample, rng) for sample in samples]).reshape(len(samples), -1)
    monomials = np.array([_monomials(products, sample) for sample in samples])
    factors = np.linalg.lstsq(monomials[1:], flat[1:], rcond=None)[0]
    factors = np.where(np.abs(factors - np.round(factors)) < _ZERO, np.round(factors), factors)
    # the polynomial is that of the first arm, and of the nominal one
    nominal = _monomials(products, letters) @ factors
    size = max(1.0, float(np.abs(flat).max(initial=0.0)))
    wrong = max(
        float(np.abs(monomials[0] @ factors - flat[0]).max(initial=0.0)),
        float(np.abs(nominal - base.regrouping.ravel()).max(initial=0.0)),
    )
    if wrong > _SAME * size:
        raise LabError(f"robot '{arm.chain.name}': its regrouping is no polynomial of its lengths (off by {wrong:.2g})")
    table = factors.reshape(len(products), *base.regrouping.shape)
    grouped = [base.names[j] for j in base.grouped]
    return tuple(
        Formula(label, base.names[own], _terms(products, table[:, i], grouped))
        for i, (label, own) in enumerate(zip(base.labels, base.independent.tolist(), strict=True))
    )


def _monomials(products: Sequence[tuple[str, ...]], letters: Mapping[str, float]) -> Array:
    """Return the products of lengths (m)."""
    return np.array([np.prod([letters[letter] for letter in word]) for word in products])


def _places(arm: ArmDynamics) -> dict[str, tuple[int, int]]:
    """Return row and column of nonzero lengths by letter; the constant of a slide is part of its position."""
    places, chain = {}, arm.chain
    for i, row in enumerate(chain.table):
        for symbol in ("d", "a"):
            column = COLUMNS.index(symbol)
            if abs(row[column]) > _ZERO_M and not (symbol == "d" and chain.prismatic[i]):
                places[arm.letter(symbol, i + 1)] = (i, column)
    return places


def _regrouping(arm: ArmDynamics, base: BaseParameters, letters: dict[str, float], rng: np.random.Generator) -> Array:
    """Return K of the arm with other lengths, by the same columns."""
    table = arm.chain.table.copy()
    for letter, place in _places(arm).items():
        table[place] = letters[letter]
    other = base_parameters(replace(arm, chain=arm.chain.with_table(table)), rng)
    if not (np.array_equal(other.independent, base.independent) and np.array_equal(other.grouped, base.grouped)):
        raise LabError(f"robot '{arm.chain.name}': its base parameters depend on its lengths beyond their letters")
    return other.regrouping


def _terms(products: Sequence[tuple[str, ...]], factors: Array, names: Sequence[str]) -> tuple[_Term, ...]:
    """Return the terms of a formula, parameters with equal coefficients together; ``factors`` ``(products, names)``."""
    grouped: dict[tuple[tuple[tuple[str, ...], float], ...], list[str]] = {}
    for column, name in zip(factors.T, names, strict=True):
        pairs = zip(products, column.tolist(), strict=True)
        coefficient = tuple((word, round(factor, 9)) for word, factor in pairs if abs(factor) > _ZERO)
        if coefficient:
            grouped.setdefault(coefficient, []).append(name)
    terms = [_Term(coefficient, tuple(each)) for coefficient, each in grouped.items()]
    return tuple(sorted(terms, key=lambda term: len(term.coefficient[0][0])))


def _monomial(letters: tuple[str, ...], factor: float) -> str:
    """Return the monomial as text with a leading sign."""
    size = abs(factor)
    number = f"{size:.0f}" if abs(size - round(size)) < _ZERO else f"{size:.6g}"
    if letters and abs(size - 1) < _ZERO:
        number = ""
    product = f"{letters[0]}²" if len(letters) == 2 and letters[0] == letters[1] else " ".join(letters)
    return " ".join(("−" if factor < 0 else "+", *filter(None, (number, product))))
