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
from dataclasses import dataclass
from typing import Literal, Self

import numpy as np
from numpy.typing import NDArray

from lab.core.errors import LabError
from lab.core.se3 import Array
from lab.core.units import MM, MRAD
from lab.extension_points import Part, PartKind, own_errors
from lab.kinematics.parameter import Parameter

__all__ = [
    "CRITERIA",
    "Criterion",
    "Indices",
    "PredictedAccuracy",
    "Scaling",
    "criterion",
    "indices",
    "is_singular",
    "predict",
    "prepared",
    "refuse_unknown",
    "smallest_count",
    "worst_tests",
]

CRITERIA = ("O1", "O2", "O3", "O4", "O5", "condition", "A", "G", "I")
_CHARACTERISTIC_LENGTH_M = 0.300
_TINY = 1e-300
_ROUNDING = 1e-14  # of the largest singular value: taken as zero
_STEP = 1e-5  # of the information, for differences of a score
_UNKNOWN = 1e200  # variance of a parameter of singular information
_TRIED_SETS = 8  # random sets of poses by which an own criterion is checked
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


_KIND = PartKind("lab.criteria", "criterion", "criterion", CRITERIA, method="score")


class Criterion(Part, ABC, kind=_KIND):
    """A criterion of pose selection: a score of the information matrix, larger is better.

    Your own is a subclass with a ``name`` and a ``score``. Every call with an option ``criterion`` takes an object of
    it; if a package registers it as an entry point of ``lab.criteria``, ``--criterion`` takes it by name.

    The information M ``(p, p)`` is the sum of J'J over the poses, J ``(r, p)`` the derivatives of a pose's readings by
    the identifiable parameters. With the scaling ``whitened`` (the usual one), readings count in standard deviations
    of the instrument's noise, and parameters in tolerances (0.5 mm, 1.5 mrad): M^-1 is the covariance of the parameters
    in tolerances. With ``raw``, ``length`` and ``unit`` readings of points count in mm (``unit``: m) without the noise,
    and parameters in the units of the scaling.

    Targets, models and the arm change p. Choose parameters by ``names``, not by numbers of rows.

    Attributes:
        name: in options and results.
        names: of the parameters, one for each row of M; set before a search, empty before that.
        weight: W ``(p, p)`` of a score -log tr(W M^-1); None for others. It changes the search, not the goal: every
            candidate is tried in place of a pose, by updates of M^-1; without it, 256 random ones by whole scores.
        growth: by how much the score grows where the information grows e-fold, of a score that is concave and smooth
            (G: the least of such), 1 for one with a ``weight``. With it, ``certificate`` bounds the efficiency; None
            for others, of which no bound is known.

    Example:
        >>> import lab, numpy as np
        >>> class Lengths(lab.Criterion):
        ...     name = "lengths"
        ...     def score(self, information):
        ...         links = [n.startswith("link") and n.endswith((".a", ".d")) for n in self.names]
        ...         return -np.log(self.covariance(information)[..., links, links].sum(axis=-1))
        >>> plan = lab.design("irb120", poses=14, candidates=100, starts=1)  # by O1; by it with criterion=Lengths()
        >>> bool(np.isfinite(Lengths().with_names(plan.parameter_names).score(plan.information)))
        True
        >>> [name for name in plan.parameter_names if name.endswith((".a", ".d"))]
        ['link1.a', 'link2.a', 'link3.d', 'link3.a', 'link4.d', 'link4.a', 'link5.d', 'link5.a']
    """

    name: str
    names: tuple[str, ...] = ()
    weight: Array | None = None
    growth: float | None = None

    @abstractmethod
    def score(self, information: Array) -> Array:
        """Return the scores of information matrices, worse than any other where singular.

        Args:
            information: ``(..., p, p)``, in the units of the scaling.

        Returns:
            The scores ``(...)``.
        """

    def with_names(self, names: Sequence[str]) -> Self:
        """Return a copy for the parameters of these names, one for each row of the information.

        A search does so before its first score; ``plan.parameter_names`` are those of a design.
        """
        named = copy.copy(self)
        object.__setattr__(named, "names", tuple(names))  # of a frozen dataclass, too
        return named

    def covariance(self, information: Array) -> Array:
        """Return the inverses of information matrices ``(..., p, p)``; 1e200 times the identity where singular."""
        scaled, size, singular = _unit_diagonal(information)
        scaled[singular] = np.eye(information.shape[-1])
        inverse: Array = np.linalg.inv(scaled) / size[..., :, None] / size[..., None, :]
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


def prepared(own: Criterion, names: Sequence[str], pool: Array, measured: Array | float = 0.0) -> Criterion:
    """Return a user's criterion for a search: with the names of the parameters, its errors in one line.

    It is tried on some random sets of poses.

    Args:
        names: ``(p,)`` of the parameters.
        pool: ``(m, r, p)``, Jacobians of the candidates.
        measured: information ``(p, p)`` of poses measured before.

    Raises:
        LabError: it raises an error, returns no scores, scores all sets alike, scores twice the information lower,
            or has a weight that is not that of its score.
    """
    goal = _Own.of(own, names)
    m, rows, p = pool.shape
    count = min(m, 2 * -(-p // rows))
    rng = np.random.default_rng(0)
    sets = np.stack([pool[rng.choice(m, count, replace=False)].reshape(-1, p) for _ in range(_TRIED_SETS)])
    matrices = np.swapaxes(sets, 1, 2) @ sets + measured
    matrices = matrices[~is_singular(matrices)]
    if len(matrices) < 2:  # the search says what is missing
        return goal
    scores, twice = goal.score(matrices), goal.score(2 * matrices)
    goal.score(matrices[0])
    margin = 1e-9 * np.maximum(1.0, np.abs(scores))
    if (scores == scores[0]).all():
        raise LabError(
            f"criterion '{own.name}' gives {len(scores)} random sets of {count} poses the same score, {scores[0]:g}: "
            "it cannot choose; return a number that depends on the information"
        )
    if (np.isfinite(scores) & (twice < scores - margin)).all():
        raise LabError(
            f"criterion '{own.name}' gives {count} poses {scores[0]:.4g}, and {twice[0]:.4g} if each is measured twice"
            "; larger is better: turn the sign of its score"
        )
    if goal.weight is not None:
        stated = -np.log(np.einsum("pq,nqp->n", goal.weight, np.linalg.inv(matrices)))
        if not np.allclose(np.diff(stated), np.diff(scores), rtol=1e-3, atol=1e-6):
            raise LabError(
                f"criterion '{own.name}' has a weight W, but its score is not -log tr(W M^-1); set weight to None"
            )
    return goal


@dataclass(frozen=True)
class _Own(Criterion):
    """A user's criterion, whose errors name it.

    Attributes:
        inner: it, with the names of the parameters.
    """

    inner: Criterion
    name: str
    names: tuple[str, ...]
    weight: Array | None
    growth: float | None

    @classmethod
    def of(cls, own: Criterion, names: Sequence[str]) -> "_Own":
        """Return a criterion with these names.

        Raises:
            LabError: it cannot be copied, or its weight is none.
        """
        with own_errors("criterion", own.name):
            inner = own.with_names(names)
            weight = None if inner.weight is None else np.asarray(inner.weight, dtype=np.float64)
            growth = inner.growth
        if weight is not None and weight.shape != (len(names), len(names)):
            raise LabError(
                f"criterion '{own.name}' has a weight of shape {weight.shape} for {len(names)} parameters; give "
                f"({len(names)}, {len(names)})"
            )
        return cls(inner, own.name, tuple(names), weight, growth)

    def score(self, information: Array) -> Array:
        with own_errors("criterion", self.name):
            scores = np.asarray(self.inner.score(information), dtype=np.float64)
        if scores.shape != (wanted := information.shape[:-2]):
            raise LabError(
                f"criterion '{self.name}' returns scores of shape {scores.shape} for information of shape "
                f"{information.shape}; return {wanted}"
            )
        if np.isnan(scores).any():
            raise LabError(
                f"criterion '{self.name}' returns NaN; return a finite score, and -inf where information is singular"
            )
        return scores

    def slope(self, information: Array) -> Array:
        with own_errors("criterion", self.name, np.linalg.LinAlgError):  # a search goes on from an impossible step
            slope = np.asarray(self.inner.slope(information), dtype=np.float64)
        if slope.shape != information.shape:
            raise LabError(
                f"criterion '{self.name}' returns a slope of shape {slope.shape}; return {information.shape}"
            )
        return slope


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
        inverse = np.linalg.inv(information)
        slope: Array = inverse @ self.weight @ inverse / np.trace(self.weight @ inverse)
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
    return _unit_diagonal(information)[2]


def _unit_diagonal(information: Array) -> tuple[Array, Array, NDArray[np.bool_]]:
    """Return the information scaled to unit diagonal, the roots of its diagonal, and whether it is singular."""
    size = np.sqrt(np.maximum(np.diagonal(information, axis1=-2, axis2=-1), _TINY))
    scaled: Array = information / size[..., :, None] / size[..., None, :]
    return scaled, size, np.asarray(np.linalg.eigvalsh(scaled)[..., 0] < _SINGULAR, dtype=np.bool_)


def _variances(information: Array, test: Array) -> Array:
    """Return predicted variances ``(..., t)`` at test poses ``(t, r, p)``; infinite where information is singular."""
    scaled, size, singular = _unit_diagonal(information)
    scaled[singular] = np.eye(information.shape[-1])
    inverse = np.linalg.inv(scaled) / size[..., :, None] / size[..., None, :]
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


_DRAWS = 2000  # of the parameter error
_SHARE = 0.95  # of the validation poses, and of the calibrations


@dataclass(frozen=True)
class PredictedAccuracy:
    """Predicted position errors over the test poses, as lengths of the 3D error (m).

    Attributes:
        rms: ``(t,)`` sqrt(tr J C J') at each test pose.
        coverage_radius: bound of the error at 95 % of the validation poses in 95 % of the calibrations.
    """

    rms: Array
    coverage_radius: float

    def repeated(self, times: float) -> "PredictedAccuracy":
        """Return the prediction for ``times`` the information: every error is smaller by its root."""
        return PredictedAccuracy(self.rms / np.sqrt(times), float(self.coverage_radius / np.sqrt(times)))


def predict(information: Array, test: Array, rng: np.random.Generator) -> PredictedAccuracy:
    """Predict accuracy from an information matrix ``(p, p)`` and Jacobians at test poses ``(t, 3, p)`` (m).

    The coverage radius x is the strict one: P(Q95 over poses of |J d| <= x) = 95 % over draws d ~ N(0, C). The
    marginal 95 % of all pose-draws would hold in too few calibrations.
    """
    size = np.sqrt(np.diag(information))
    factor = np.linalg.inv(np.linalg.cholesky(information / np.outer(size, size))) / size  # C = factor' factor
    spread = test @ factor.T
    rms = np.sqrt((spread**2).sum(axis=(1, 2)))
    draws = rng.standard_normal((_DRAWS, len(information)))
    squared = np.zeros((_DRAWS, len(test)))
    for axis in spread.transpose(1, 2, 0):
        squared += np.square(draws @ axis)
    kept = np.quantile(np.sqrt(squared, out=squared), _SHARE, axis=1, overwrite_input=True)
    return PredictedAccuracy(rms, float(np.quantile(kept, _SHARE)))


def smallest_count(coverage_radius: Callable[[int], float], wanted: float, least: int, most: int) -> int:
    """Find the smallest number of poses whose coverage radius is within ``wanted`` (m).

    Args:
        coverage_radius: number of poses to the coverage radius (m) of a design of that size.
        least, most: bounds of the number.

    Raises:
        LabError: even ``most`` poses do not reach it.
    """
    most = max(most, least)
    low, high = least, least
    while (error := coverage_radius(high)) > wanted:
        if high == most:
            raise LabError(
                f"{MM.text(wanted, 6)} is out of reach: {most} poses predict {MM.text(error)}; "
                "allow more candidates, add targets, average readings, or take a better instrument"
            )
        low, high = high + 1, min(2 * high, most)
    while low < high:
        middle = (low + high) // 2
        if coverage_radius(middle) <= wanted:
            high = middle
        else:
            low = middle + 1
    return high
