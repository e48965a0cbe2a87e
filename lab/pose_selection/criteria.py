"""Compute observability indices and variance criteria of a set of poses.

A Jacobian stacks r rows of positions (whitened or in m) for each of n poses over p parameters. O1 to O5 and
the condition number are as in Mahdadi & Bouafia (2020), after Borm & Menq, Driels & Pathre, Nahvi
& Hollerbach, and Sun & Hollerbach; A, G and I are those of optimal design (Pukelsheim 1993).
O1 is D-optimality: a column scaling multiplies every design's O1 by the same factor, so that its
ranking of designs is independent of units. So are those of G and I, variances of positions; O2 to O5, the
condition number and A depend on the scaling.
"""

import copy
from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Literal, Self

import numpy as np
from numpy.typing import NDArray

from lab.core.errors import LabError
from lab.core.se3 import Array
from lab.core.units import MM, MRAD
from lab.extension_points import Part, PartKind
from lab.kinematics.parameter import Parameter

__all__ = [
    "CRITERIA",
    "Criterion",
    "DesignTask",
    "Indices",
    "Scaling",
    "criterion",
    "indices",
    "is_singular",
    "refuse_unknown",
    "weighted_slope",
    "worst_tests",
]

CRITERIA = ("O1", "O2", "O3", "O4", "O5", "condition", "A", "G", "I")
_CHARACTERISTIC_LENGTH_M = 0.300
_TINY = 1e-300
_ROUNDING = 1e-14  # of the largest singular value: taken as zero
_STEP = 1e-5  # of the information, for differences of a score
_UNKNOWN = 1e200  # variance of a parameter of singular information
_SINGULAR = 1e-13  # smallest eigenvalue of an information matrix of unit diagonal


@dataclass(frozen=True)
class Scaling:
    """Units of each parameter and of a position.

    ``raw``: millimetres and radians. ``unit``: each column has norm √m over the m candidates, whatever their number:
    a mean square of one for each pose. ``length``: millimetres, and angles times a characteristic length.
    ``whitened``: tolerances (one standard deviation of each parameter's manufacture) and the instrument's noise. An
    effect's parameter that is neither a length nor an angle counts in its typical size.
    """

    kind: Literal["raw", "unit", "length", "whitened"] = "raw"
    length_m: float = _CHARACTERISTIC_LENGTH_M
    tolerance_m: float = 0.5e-3
    tolerance_rad: float = 1.5e-3

    def columns(self, parameters: Sequence[Parameter], candidates: Array) -> Array:
        """Return factors ``(p,)`` for the columns of a Jacobian in m, m and rad.

        Args:
            parameters: of the columns.
            candidates: ``(m, r, p)``, over which ``unit`` columns have norm √m.
        """
        angular = np.array([parameter.is_angle for parameter in parameters])
        other = np.array([parameter.kind not in ("length", "angle") for parameter in parameters])
        size = np.array([parameter.scale for parameter in parameters])  # of an effect: a ratio, a compliance, a mass
        if self.kind == "raw":
            return np.where(other, 1e3 * size, np.where(angular, 1e3, 1.0))
        if self.kind == "length":
            return np.where(other, 1e3 * size, np.where(angular, 1 / self.length_m, 1.0))
        if self.kind == "whitened":
            return np.where(other, size, np.where(angular, self.tolerance_rad, self.tolerance_m))
        factors: Array = 1 / np.sqrt((candidates**2).sum(axis=(0, 1)) / len(candidates))
        return factors

    def units(self, parameters: Sequence[Parameter], candidates: Array) -> Array:
        """Return the size ``(p,)`` of one unit of each scaled parameter: in m, rad, or the SI unit of an effect's."""
        per_mm = 1e-3 if self.kind in ("raw", "length") else 1.0  # these count readings in mm
        return per_mm * self.columns(parameters, candidates)

    def tolerances(self, parameters: Sequence[Parameter]) -> Array:
        """Return one standard deviation ``(p,)`` of each parameter's manufacture, in its SI unit."""
        return replace(self, kind="whitened").columns(parameters, np.empty(0))

    def describe(self) -> str:
        """Describe the scaling."""
        return {
            "raw": "millimetres and radians",
            "unit": "columns of root mean square one per pose over the candidates",
            "length": f"millimetres, angles times {MM.text(self.length_m, 6)}",
            "whitened": f"tolerances of {MM.text(self.tolerance_m, 6)} and {MRAD.text(self.tolerance_rad, 6)}, noise σ",
        }[self.kind]


@dataclass(frozen=True)
class Indices:
    """Indices of designs, each of shape ``(...)``: larger is better but for condition, a, g and i.

    ``a`` is the sum of 1/σ²; ``g`` and ``i`` are the worst and the mean predicted variance of a
    position over the test poses, in the units of their Jacobian's rows; NaN without test poses.
    """

    o1: Array
    o2: Array
    o3: Array
    o4: Array
    o5: Array
    condition: Array
    a: Array
    g: Array
    i: Array


def indices(jacobian: Array, test: Array | None = None) -> Indices:
    """Compute the indices of designs ``(..., n, r, p)``, in the scaling of the Jacobians.

    Args:
        test: ``(t, r, p)``, Jacobians at the test poses, scaled alike.
    """
    n, rows, p = jacobian.shape[-3:]
    stacked = jacobian.reshape(*jacobian.shape[:-3], n * rows, p)
    s = np.asarray(np.linalg.svd(stacked, compute_uv=False), dtype=np.float64)
    s = np.concatenate([s, np.zeros((*s.shape[:-1], p - s.shape[-1]))], axis=-1)
    s[s < _ROUNDING * s[..., :1]] = 0.0
    first, last = s[..., 0], s[..., -1]
    with np.errstate(divide="ignore"):
        o1: Array = np.exp(np.log(s).mean(axis=-1)) / np.sqrt(n)
        o5, a = 1 / (1 / s).sum(axis=-1), (1 / s**2).sum(axis=-1)
        condition = first / last
    g = i = np.full(o1.shape, np.nan)
    if test is not None:
        variance = _variances(np.swapaxes(stacked, -1, -2) @ stacked, test)
        g, i = variance.max(axis=-1), variance.mean(axis=-1)
    return Indices(o1, last / first, last, last**2 / first, o5, condition, a, g, i)


@dataclass(frozen=True)
class DesignTask:
    """The identification for which poses are chosen, as a criterion needs it.

    Attributes:
        parameters: the p identifiable parameters, one for each row of the information matrix: ``name``, ``kind``
            (``length``, ``angle`` or that of an effect), ``group`` (``link``, ``base``, ``tool`` or an effect's),
            ``joint`` and so on.
        units: ``(p,)`` the size of one unit of each in the matrix: in m, rad, or the SI unit of an effect's parameter.
        tolerances: ``(p,)`` one standard deviation of each in manufacture, in the same SI units.
        jacobians: ``(t, 3, p)`` m per unit, derivatives of the tool's positions where accuracy counts: in the region of
            ``lab.design(region=...)``, else all over the workspace.
    """

    parameters: tuple[Parameter, ...]
    units: Array
    tolerances: Array
    jacobians: Array


_KIND = PartKind("lab.criteria", "criterion", "criterion", CRITERIA, method="score")


class Criterion(Part, ABC, kind=_KIND):
    """A criterion of pose selection: a score of the information matrix, larger is better.

    Your own is a function of the matrix, or of the matrix and the ``DesignTask``; or a subclass with a ``name`` and a
    ``score``. Every call with an option ``criterion`` takes the function or an object of the class; if a package
    registers an object as an entry point of ``lab.criteria``, ``--criterion`` takes it by name.

    The information M ``(p, p)`` is the sum of J'J over the poses, J ``(r, p)`` the derivatives of a pose's readings by
    the identifiable parameters. With the scaling ``whitened`` (the usual one), readings count in standard deviations
    of the instrument's noise, and parameters in tolerances (0.5 mm, 1.5 mrad): M^-1 is the covariance of the parameters
    in tolerances. With ``raw``, ``length`` and ``unit`` readings of points count in mm (``unit``: m) without the noise,
    and parameters in the units of the scaling.

    Targets, models and the arm change p. Choose parameters by ``task.parameters``, not by numbers of rows.

    The slope of a score is found by differences: of the singular values alone where the score is a function of these,
    then exact to rounding; else of each entry of M. With a ``weight`` it is exact. A ``slope`` of your own replaces
    it; before a search its values are compared with differences.

    Attributes:
        name: in options and results.
        task: what the rows of M are, their units and tolerances, and where accuracy counts; set before a search, None
            before that.
        weight: W ``(p, p)`` of a score -log tr(W M^-1); None for others. It changes the search, not the goal: every
            candidate is tried in place of a pose, by updates of M^-1; without it, those that the slope prefers.
        growth: by how much the score grows where the information grows e-fold, of a score that is concave and smooth
            (G: the least of such), 1 for one with a ``weight``. With it, ``certificate`` bounds the efficiency; None
            for others, of which no bound is known.

    Example:
        >>> import lab, numpy as np
        >>> class Lengths(lab.Criterion):
        ...     name = "lengths"
        ...     def score(self, information):
        ...         lengths = [p.group == "link" and p.kind == "length" for p in self.task.parameters]
        ...         return -np.log(self.covariance(information)[..., lengths, lengths].sum(axis=-1))
        >>> plan = lab.design("irb120", poses=14, candidates=100, starts=1, criterion=Lengths())
        >>> [p.name for p in plan.task.parameters if p.group == "link" and p.kind == "length"]
        ['link1.a', 'link2.a', 'link3.d', 'link3.a', 'link4.d', 'link4.a', 'link5.d', 'link5.a']
    """

    name: str
    task: DesignTask | None = None
    weight: Array | None = None
    growth: float | None = None

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the parameters, one for each row of M; empty before a search."""
        return () if self.task is None else tuple(parameter.name for parameter in self.task.parameters)

    @abstractmethod
    def score(self, information: Array) -> Array:
        """Return the scores of information matrices, worse than any other where singular.

        Args:
            information: ``(..., p, p)``, in the units of the scaling.

        Returns:
            The scores ``(...)``.
        """

    def for_task(self, task: DesignTask) -> Self:
        """Return a copy for this task.

        A search does so before its first score; ``plan.task`` is that of a design.
        """
        prepared = copy.copy(self)
        object.__setattr__(prepared, "task", task)  # of a frozen dataclass, too
        return prepared

    def covariance(self, information: Array) -> Array:
        """Return the inverses of information matrices ``(..., p, p)``; 1e200 times the identity where singular."""
        inverse, singular = _inverted(information)
        inverse[singular] = _UNKNOWN * np.eye(information.shape[-1])
        return inverse

    def slope(self, information: Array) -> Array:
        """Return the symmetric derivative ``(p, p)`` of the score by the information ``(p, p)``.

        Here by central differences, in coordinates in which the information is the identity.
        """
        root = np.linalg.cholesky(information)  # the information is root root'
        rows, columns = np.triu_indices(len(root))
        one, other = root.T[rows], root.T[columns]
        moved = _STEP * (one[:, :, None] * other[:, None, :] + other[:, :, None] * one[:, None, :]) / 2
        by_entry = (self.score(information + moved) - self.score(information - moved)) / (2 * _STEP)
        slope = np.zeros_like(root)
        slope[rows, columns] = slope[columns, rows] = by_entry
        back: Array = np.linalg.inv(root)
        return np.asarray(back.T @ slope @ back)


def refuse_unknown(name: str, *others: str) -> None:
    """Refuse a name that is neither a criterion's nor one of ``others``, with a LabError."""
    names = (*others, *_KIND.names)
    if name not in names:
        if (meant := next((each for each in names if each.casefold() == name.casefold()), None)) is not None:
            raise LabError(f"criterion '{name}' is unknown: write {meant}")
        raise LabError(
            f"criterion '{name}' is unknown: choose one of {', '.join(names)}; for one of your own install the package "
            f"whose entry point of lab.criteria is named '{name}', or give the object"
        )


def criterion(name: str, size: int, test: Array | None = None) -> Criterion:
    """Return the criterion of this name for ``size`` parameters; G and I need ``test`` ``(t, r, p)``.

    Raises:
        LabError: the name is unknown.
    """
    refuse_unknown(name)
    if name not in CRITERIA:
        own: Criterion = _KIND.named(name)
        return own
    if name == "O1":
        return _Determinant(float(size))
    if name == "A":
        return _Trace(name, np.eye(size))
    if name in ("G", "I"):
        assert test is not None
        return _Worst(test) if name == "G" else _Trace(name, np.einsum("trp,trq->pq", test, test) / len(test))
    return _Spectral(name, 0.5 if name == "O5" else None)


@dataclass(frozen=True)
class _Determinant(Criterion):
    """O1."""

    growth: float
    name: str = "O1"

    def score(self, information: Array) -> Array:
        total: Array = np.log(_values(information)).sum(-1)
        return total

    def slope(self, information: Array) -> Array:
        return _inverse(information)


@dataclass(frozen=True)
class _Trace(Criterion):
    """The trace of the weighted inverse: A and I."""

    name: str
    weight: Array
    growth: float = 1.0

    def score(self, information: Array) -> Array:
        values, vectors = np.linalg.eigh(information)
        gains = np.einsum("...pk,pq,...qk->...k", vectors, self.weight, vectors, optimize=True)
        total: Array = -np.log((gains / np.maximum(values, _TINY)).sum(-1))
        return total

    def slope(self, information: Array) -> Array:
        return weighted_slope(self.weight, information)


def weighted_slope(weight: Array, information: Array) -> Array:
    """Return the derivative ``(p, p)`` of -log tr(W M^-1) by the information M: M^-1 W M^-1 / tr(W M^-1)."""
    inverse = np.linalg.inv(information)
    slope: Array = inverse @ weight @ inverse / np.trace(weight @ inverse)
    return slope


@dataclass(frozen=True)
class _Worst(Criterion):
    """G: the largest predicted variance over test poses ``(t, r, p)``."""

    test: Array
    name: str = "G"
    growth: float = 1.0

    def score(self, information: Array) -> Array:
        score: Array = -np.log(_variances(information, self.test).max(-1))
        return score

    def slope(self, information: Array) -> Array:
        variances = _variances(information, self.test)
        worst = self.test[np.argmax(variances)] @ _inverse(information)
        slope: Array = worst.T @ worst / variances.max()
        return slope


def worst_tests(goal: Criterion, information: Array, most: int) -> list[tuple[int, Criterion]]:
    """Return the test poses of criterion G with the largest variance, each with the criterion of that variance."""
    assert isinstance(goal, _Worst)
    worst = np.argsort(-_variances(information, goal.test), kind="stable")[:most]
    return [(int(i), _Trace("G", goal.test[i].T @ goal.test[i])) for i in worst]


@dataclass(frozen=True)
class _Spectral(Criterion):
    """A function of the eigenvalues alone: O2 to O5 and the condition number."""

    name: str
    growth: float | None

    def score(self, information: Array) -> Array:
        return _SPECTRAL[self.name][0](_values(information))

    def slope(self, information: Array) -> Array:
        values, vectors = np.linalg.eigh(information)
        slope: Array = (vectors * _SPECTRAL[self.name][1](np.maximum(values, _TINY))) @ vectors.T
        return slope


def _values(information: Array) -> Array:
    return np.asarray(np.maximum(np.linalg.eigvalsh(information), _TINY), dtype=np.float64)


def _inverse(information: Array) -> Array:
    return np.asarray(np.linalg.inv(information), dtype=np.float64)


def is_singular(information: Array) -> NDArray[np.bool_]:
    """Decide whether information matrices ``(..., p, p)`` leave a parameter undetermined, in any units."""
    return np.asarray(np.linalg.eigvalsh(_unit_diagonal(information)[0])[..., 0] < _SINGULAR, dtype=np.bool_)


def _unit_diagonal(information: Array) -> tuple[Array, Array]:
    """Return the information scaled to unit diagonal, and the roots of its diagonal."""
    size = np.sqrt(np.maximum(np.diagonal(information, axis1=-2, axis2=-1), _TINY))
    scaled: Array = information / size[..., :, None] / size[..., None, :]
    return scaled, size


def _inverted(information: Array) -> tuple[Array, NDArray[np.bool_]]:
    """Return the inverses of information matrices ``(..., p, p)``, and which are singular, without a proper inverse."""
    scaled, size = _unit_diagonal(information)
    p = information.shape[-1]
    # The smallest eigenvalue is at least 1 / (p times the largest entry of the inverse): few need their eigenvalues.
    try:
        inverse = np.linalg.inv(scaled)
        singular = np.asarray(~(p * np.abs(inverse).max(axis=(-2, -1)) < 0.1 / _SINGULAR))
    except np.linalg.LinAlgError:
        singular = np.ones(information.shape[:-2], dtype=np.bool_)
    if singular.any():
        singular[singular] = np.linalg.eigvalsh(scaled[singular])[..., 0] < _SINGULAR
        scaled[singular] = np.eye(p)
        inverse = np.linalg.inv(scaled)
    return inverse / size[..., :, None] / size[..., None, :], singular


def _variances(information: Array, test: Array) -> Array:
    """Return predicted variances ``(..., t)`` at test poses ``(t, r, p)``; infinite where information is singular."""
    inverse, singular = _inverted(information)
    flat = test.reshape(-1, test.shape[-1])
    variances: Array = ((flat @ inverse) * flat).sum(-1).reshape(*information.shape[:-2], *test.shape[:2]).sum(-1)
    variances[singular] = np.inf
    return variances


def _ends(low: float, high: float) -> Callable[[Array], Array]:
    """Return derivatives of ``low log(smallest) - high log(largest)`` by the eigenvalues."""

    def slope(values: Array) -> Array:
        out = np.zeros_like(values)
        out[0] += low / values[0]
        out[-1] -= high / values[-1]
        return out

    return slope


# Scores of the eigenvalues (ascending) of the information matrix, the squares of the singular values, as logarithms.
_SPECTRAL: dict[str, tuple[Callable[[Array], Array], Callable[[Array], Array]]] = {
    "O2": (lambda v: 0.5 * np.log(v[..., 0] / v[..., -1]), _ends(0.5, 0.5)),
    "condition": (lambda v: 0.5 * np.log(v[..., 0] / v[..., -1]), _ends(0.5, 0.5)),
    "O3": (lambda v: 0.5 * np.log(v[..., 0]), _ends(0.5, 0.0)),
    "O4": (lambda v: np.log(v[..., 0]) - 0.5 * np.log(v[..., -1]), _ends(1.0, 0.5)),
    "O5": (lambda v: -np.log((v**-0.5).sum(-1)), lambda v: 0.5 * v**-1.5 / (v**-0.5).sum()),
}
