"""Fit parameters by Gauss-Newton, damped where necessary, on whitened positions and unit columns.

The step is solved through an orthogonal factorization of the scaled Jacobian and the singular values of its triangle,
so that a rank-deficient system gives the shortest step, and the fit reports its rank.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from lab.core.linear_model import condition_bound, pseudo_inverse, triangle, triangle_of, unit_columns
from lab.core.measurements import Measurements, evenly, seen_mask
from lab.core.se3 import Array
from lab.kinematics.model import Model
from lab.noise.correlation import Correlation

__all__ = ["RANK_TOLERANCE", "ExtraResiduals", "Fit", "Observations", "OtherEstimate", "Status", "fit", "settled"]

Status = Literal["converged", "in a valley", "not converged"]
ExtraResiduals = Callable[[Array], tuple[Array, Array]]
"""Parameters ``(p,)`` to more whitened residuals ``(r,)``, and the derivatives ``(r, p)`` of what predicts them."""
_MAX_ITERATIONS = 300
_LEAST_DAMPING, _LARGEST_DAMPING = 1e-12, 1e4  # of the largest singular value, squared
_CRAWLED, _STALLED = 1e-3, 25  # steps in a row that each lower the cost by less than this part of it
_BLOCK = 60_000  # numbers whose derivatives are held at a time
_FIRST_POSES = 4_000  # of more than a block, on which a fit begins
_SETTLED_BELOW = 100.0  # a condition up to which a converged fit takes no further steps
_MAX_SETTLING = 8  # steps after convergence of a worse conditioned fit
_PROBE = 0.1  # of a step, at which its curvature is looked for
_LARGEST_ACCELERATION = 0.75  # of a step's length, twice its acceleration: beyond, the second order is not reliable
RANK_TOLERANCE = 1e-10  # of the largest singular value of the column-scaled Jacobian
_ILL_CONDITIONED = 1e3  # a condition above which parameters are weakly observable


@dataclass(frozen=True)
class Observations:
    """Observed points as rows, ready to be fitted.

    Attributes:
        inputs: ``(n, joints + conditions)`` of the model.
        points: ``(n, k, d)``, k things of d numbers each (positions in m, d = 3), NaN where not observed.
        whiten: ``(n, k)`` one over the standard deviation, or ``(n, k, d, d)`` the inverse of
            the covariance's Cholesky factor; ones where the noise is to be estimated.
        correlation: of errors that several of the numbers share, in units of that noise; None where there are none.
    """

    inputs: Array
    points: Array
    whiten: Array
    correlation: Correlation | None = None

    @cached_property
    def seen(self) -> NDArray[np.bool_]:
        """``(n, k)``: which of the points were observed."""
        return seen_mask(self.points)

    @cached_property
    def _all_seen(self) -> bool:
        return bool(self.seen.all())

    @cached_property
    def typical_weight(self) -> float:
        """The root mean square weight of a coordinate."""
        whiten = self.whiten if self._all_seen else self.whiten[self.seen]
        of_each = whiten**2 if self.whiten.ndim == 2 else np.sum(whiten**2, axis=(-2, -1)) / whiten.shape[-1]
        return float(np.sqrt(np.mean(of_each)))

    @staticmethod
    def unweighted(data: Measurements) -> "Observations":
        """Return measurements with weight one, for a model without conditions."""
        return Observations(data.joints, data.points, np.ones(data.points.shape[:2]))

    def apply(self, vectors: Array) -> Array:
        """Whitened rows of the observed points: ``(n, k, d, ...)`` to ``(r, ...)``, r of their numbers."""
        rows = self.in_units_of_noise(vectors)
        if self.correlation is not None:
            shared = np.where(self.seen.reshape(*self.seen.shape, *[1] * (vectors.ndim - 2)), rows, 0.0)
            n, k, d = vectors.shape[:3]
            rows = self.correlation.white(shared.reshape(n, k * d, *vectors.shape[3:])).reshape(vectors.shape)
        picked: Array = (rows if self._all_seen else rows[self.seen]).reshape(-1, *vectors.shape[3:])
        return picked

    def in_units_of_noise(self, vectors: Array) -> Array:
        """Vectors ``(n, k, d, ...)`` by the instrument's noise, what the errors share aside."""
        if self.whiten.ndim == 2:
            return vectors * self.whiten.reshape(*self.whiten.shape, *[1] * (vectors.ndim - 2))
        turned = np.einsum("jikn,...jkn->...ikn", self.whiten.T, vectors.T)  # poses are what lies side by side
        return np.asarray(turned.T)

    def in_units_of_points(self, rows: Array) -> Array:
        """Return vectors ``(n, k, d, ...)`` in the points' units from rows in units of noise: invert the above."""
        if self.whiten.ndim == 2:
            return rows / self.whiten.reshape(*self.whiten.shape, *[1] * (rows.ndim - 2))
        flat = rows.reshape(*rows.shape[:3], -1)
        return np.asarray(np.linalg.solve(self.whiten, flat)).reshape(rows.shape)

    def in_metres(self, rows: Array) -> Array:
        """Return whitened rows ``(N, h)`` of observed positions in metres, with the errors that they share.

        The inverse of ``apply``.
        """
        if self.correlation is not None:
            n, k, d = self.points.shape
            blocks, spread = np.zeros((n, k * d, rows.shape[1])), np.repeat(self.seen, d, axis=1)
            blocks[spread] = rows
            rows = self.correlation.coloured(blocks)[spread]
        whiten, triples = self.whiten[self.seen], rows.reshape(len(rows) // 3, 3, -1)
        metres = triples / whiten[:, None, None] if whiten.ndim == 1 else np.linalg.solve(whiten, triples)
        return np.asarray(metres.reshape(rows.shape))

    def take(self, rows: NDArray[np.int_]) -> "Observations":
        """Select poses."""
        correlation = None if self.correlation is None else self.correlation.take(rows)
        return Observations(self.inputs[rows], self.points[rows], self.whiten[rows], correlation)

    @property
    def in_one_block(self) -> bool:
        """Check whether all derivatives fit in one block: there are few, or errors are correlated between poses."""
        return self.points.size <= _BLOCK or (self.correlation is not None and self.correlation.between_poses)

    def blocks(self) -> Iterator["Observations"]:
        """Yield the poses in parts of a bounded size."""
        if self.in_one_block:
            yield self
            return
        n, size = len(self.inputs), max(_BLOCK // max(self.points[0].size, 1), 1)
        for first in range(0, n, size):
            yield self.take(np.arange(first, min(first + size, n)))

    def thinned(self, poses: int) -> "Observations":
        """Select so many poses, evenly spaced; all where there are no more, or no more than a block."""
        some = None if self.in_one_block else evenly(len(self.inputs), poses)
        return self if some is None else self.take(some)

    def joined(self, other: "Observations") -> "Observations":
        """Append other poses that are weighted by the same noise."""
        pairs = ((self.inputs, other.inputs), (self.points, other.points), (self.whiten, other.whiten))
        inputs, points, whiten = (np.concatenate(pair) for pair in pairs)
        correlation = None
        if self.correlation is not None and other.correlation is not None:
            correlation = self.correlation.joined(other.correlation)
        return Observations(inputs, points, whiten, correlation)

    @property
    def alike(self) -> "Observations":
        """The observations with independent errors, all of weight one (1/m, 1/rad)."""
        return Observations(self.inputs, self.points, np.ones(self.points.shape[:2]))

    def pose_by_pose(self) -> "Observations":
        """Return the observations with the same variances within each pose, and independent poses."""
        return self if self.correlation is None else replace(self, correlation=self.correlation.of_single_poses())


@dataclass(frozen=True)
class OtherEstimate:
    """Estimate other than the least squares of all rows.

    Attributes:
        covariance: ``(f, f)`` of the free parameters where whitened noise has variance one.
        least_squares: all parameters ``(p,)`` by least squares of all rows: residuals are tested there.
    """

    covariance: Array
    least_squares: Array


@dataclass(frozen=True)
class Fit:
    """Result of a Gauss-Newton fit.

    Attributes:
        values: all parameters ``(p,)``.
        free: indices of those that were fitted.
        cost_trace: half the sum of squared whitened residuals, before the first and after each step.
        triangle: ``(f, f)`` R of the whitened Jacobian's free columns, scaled to unit norm.
        scale: ``(f,)`` the norms they had.
        other: where the values are not those of least squares; None where they are.
        aside: positions in ``free`` of parameters that a prior alone determines, and that no condition number is of.
    """

    values: Array
    free: tuple[int, ...]
    status: Status
    cost_trace: tuple[float, ...]
    triangle: Array
    scale: Array
    other: OtherEstimate | None = None
    aside: tuple[int, ...] = ()

    @property
    def least_squares(self) -> Array:
        """Parameters ``(p,)`` by least squares of all rows, whose residuals serve to test noise and lack of fit."""
        return self.values if self.other is None else self.other.least_squares

    @cached_property
    def singular_values(self) -> Array:
        """Singular values of ``triangle`` without the parameters ``aside``, descending."""
        rest = np.delete(self.triangle, self.aside, axis=1)
        return np.asarray(np.linalg.svd(rest, compute_uv=False), dtype=float)

    @property
    def iterations(self) -> int:
        """The number of steps taken."""
        return len(self.cost_trace) - 1

    @property
    def rank(self) -> int:
        """The number of singular values that are not zero; a prior determines the parameters ``aside``."""
        return int((self.singular_values > RANK_TOLERANCE * self.singular_values[0]).sum()) + len(self.aside)

    @property
    def condition(self) -> float:
        """Largest over smallest singular value of the column-scaled Jacobian."""
        smallest = self.singular_values[-1]
        return float(self.singular_values[0] / smallest) if smallest > 0 else float("inf")

    @property
    def ill_conditioned(self) -> bool:
        """Check whether the parameters are weakly observable in these poses: a condition above 1000."""
        return condition_bound(self.triangle) > _ILL_CONDITIONED and self.condition > _ILL_CONDITIONED

    def beside(self, residual: Array, rows: Array) -> tuple["Fit", float]:
        """Return the fit with further rows, to first order, and how far that moves the predictions (whitened norm).

        Args:
            residual: ``(r,)`` of the further rows at ``values``.
            rows: ``(r, p)`` their derivatives by all parameters.
        """
        index, size = list(self.free), len(self.free)
        before = self.triangle * self.scale
        more = np.column_stack([rows[:, index], residual])
        both = triangle(np.concatenate([np.column_stack([before, np.zeros(size)]), more]))
        columns, scale = unit_columns(both[:size, :size])
        step = pseudo_inverse(columns, RANK_TOLERANCE) @ both[:size, size] / scale
        values = self.values.copy()
        values[index] += step
        return replace(self, values=values, triangle=columns, scale=scale), float(np.linalg.norm(before @ step))

    def unit_covariance(self) -> Array:
        """Covariance ``(f, f)`` of the free parameters where whitened noise has variance one."""
        if self.other is not None:
            return self.other.covariance
        inverse = pseudo_inverse(self.triangle, RANK_TOLERANCE) / self.scale[:, None]
        covariance: Array = inverse @ inverse.T
        return covariance


def fit(
    model: Model,
    observed: Observations,
    free: Sequence[int],
    start: Array,
    *,
    tolerance_m: float = 1e-9,
    extra_residuals: ExtraResiduals | None = None,
    most_steps: int = _MAX_ITERATIONS,
) -> Fit:
    """Fit the free parameters by least squares from ``start``, the others fixed.

    Gauss-Newton; where its step does not lower the cost, a damped one. It has converged when a full step would move the
    predicted points by less than ``tolerance_m`` (root mean square, of what is weighted as one metre); that step is
    still taken, so that what remains is its square. It stalls on an ill-conditioned problem ("in a valley") where 25
    damped steps in a row lower the cost by less than a thousandth each.

    Args:
        start: ``(p,)`` all parameters.
        extra_residuals: what else is known of the parameters, e.g. a prior.
    """
    index = list(free)
    metre = observed.typical_weight * np.sqrt(max(len(observed.inputs), 1))
    problem = _Problem(model, observed, index, extra_residuals)
    here, damping = problem.at(_near(problem, start, tolerance_m)), _LEAST_DAMPING
    trace, damped, crawled = [here.cost], False, 0
    status: Status = "not converged"
    while True:
        # the Gauss-Newton step, which ends the iteration where it moves the predicted points by less than the tolerance
        step = pseudo_inverse(here.triangle, RANK_TOLERANCE) @ here.right
        moved = float(np.linalg.norm(here.triangle @ step)) / metre
        values = here.moved(index, step)
        if moved < tolerance_m:
            status = "converged"
            break
        if len(trace) > most_steps:
            values = here.values
            break
        # take it where it lowers the cost, else a damped one
        ahead = problem.lower(here, values) if damped else problem.at(values)
        if damped := ahead is None or not ahead.cost < here.cost:
            ahead, damping = _damped(problem, here, damping)
        if ahead is None:  # nothing lowers it: rounding, if what is left to move is
            values = here.values
            status = "converged" if moved < 1e3 * tolerance_m else "not converged"
            break
        crawled = crawled + 1 if damped and here.cost - ahead.cost < _CRAWLED * here.cost else 0
        here = ahead
        trace.append(here.cost)
        if crawled == _STALLED:
            values, status = here.values, "in a valley"
            break
    return Fit(values, tuple(index), status, tuple(trace), here.triangle, here.scale)


def settled(model: Model, observed: Observations, found: Fit, extra_residuals: ExtraResiduals | None = None) -> Fit:
    """Refine a converged fit that is not well-conditioned: its parameters still move where predicted points do not.

    Full Gauss-Newton steps are taken until rounding ends their decrease. The covariance is then that of the derivatives
    at the solution. Other fits are returned as they are.
    """
    if found.status != "converged" or found.condition <= _SETTLED_BELOW:
        return found
    index, last = list(found.free), np.inf
    problem = _Problem(model, observed, index, extra_residuals)
    for _ in range(_MAX_SETTLING):
        here = problem.at(found.values)
        step = pseudo_inverse(here.triangle, RANK_TOLERANCE) @ here.right
        size = float(np.linalg.norm(step))
        if not size < 0.5 * last:
            break
        found = replace(found, values=here.moved(index, step), triangle=here.triangle, scale=here.scale)
        last = size
    return found


def _near(problem: "_Problem", start: Array, tolerance_m: float) -> Array:
    """Return a start of the fit: for more poses than a block, the fit of a subset, which is near that of all."""
    few = problem.observed.thinned(_FIRST_POSES)
    if few is problem.observed:
        return start.copy()
    first = fit(
        problem.model, few, problem.index, start, tolerance_m=tolerance_m, extra_residuals=problem.extra_residuals
    )
    return first.values if first.status == "converged" and first.rank == len(problem.index) else start.copy()


@dataclass(frozen=True)
class _State:
    """Parameters with the linear problem there.

    Attributes:
        residual: ``(r,)`` whitened, measured less predicted.
        jacobian: ``(r, f)`` of the prediction; None where it is not held.
        triangle: ``(f, f)`` its R, columns of unit norm.
        right: ``(f,)`` Q'r.
        scale: ``(f,)`` the norms that its columns had.
    """

    values: Array
    residual: Array
    jacobian: Array | None
    triangle: Array
    right: Array
    scale: Array

    @property
    def cost(self) -> float:
        return 0.5 * float(self.residual @ self.residual)

    def moved(self, index: list[int], step: Array) -> Array:
        values = self.values.copy()
        values[index] += step / self.scale
        return values


@dataclass(frozen=True)
class _Problem:
    """Problem to fit, block by block: derivatives of more poses than a block are never stored."""

    model: Model
    observed: Observations
    index: list[int]
    extra_residuals: ExtraResiduals | None

    def residual(self, values: Array) -> Array:
        """Return ``(r,)`` whitened, measured less predicted."""
        parts = [each.apply(each.points - self.model.points(each.inputs, values)) for each in self.observed.blocks()]
        more = [] if self.extra_residuals is None else [self.extra_residuals(values)[0]]
        return np.concatenate([*parts, *more])

    def _parts(self, values: Array) -> Iterator[tuple[Array, Array]]:
        for each in self.observed.blocks():
            points, derivative = self.model.observe(each.inputs, values)
            yield each.apply(each.points - points), each.apply(derivative[..., self.index])
        if self.extra_residuals is not None:
            more, rows = self.extra_residuals(values)
            if len(more):
                yield more, rows[:, self.index]

    def at(self, values: Array) -> _State:
        if self.observed.in_one_block:
            parts = list(self._parts(values))
            residual, jacobian = parts[0] if len(parts) == 1 else map(np.concatenate, zip(*parts, strict=True))
            both = triangle(_beside(jacobian, residual), overwrite=True)
        else:
            residuals, jacobian = list[Array](), None

            def added(part: Array, derivatives: Array) -> Array:
                residuals.append(part)
                return _beside(derivatives, part)

            both = triangle_of(added(*each) for each in self._parts(values))
            residual = np.concatenate(residuals)
        size = both.shape[1] - 1
        if len(both) <= size:  # fewer rows than columns
            both = np.concatenate([both, np.zeros((size + 1 - len(both), size + 1))])
        columns, scale = unit_columns(both[:size, :size])
        return _State(values, residual, jacobian, columns, both[:size, size], scale)

    def lower(self, here: _State, values: Array) -> _State | None:
        """Return the linear problem at some parameters if the cost is lower there, else None."""
        residual = self.residual(values)
        return self.at(values) if 0.5 * float(residual @ residual) < here.cost else None

    def pull(self, here: _State, step: Array, ahead: Array) -> Array:
        """Return ``(f,)`` J'f_vv, with the curvature of the prediction along a step from the residual ``ahead``."""
        residual, stored, total, row = here.residual, here.jacobian, np.zeros(len(step)), 0
        for jacobian in (part for _, part in self._parts(here.values)) if stored is None else iter([stored]):
            rows = slice(row, row + len(jacobian))
            curvature = 2 / _PROBE * ((residual[rows] - ahead[rows]) / _PROBE - jacobian @ (step / here.scale))
            total, row = total + jacobian.T @ curvature / here.scale, rows.stop
        return total


def _damped(problem: _Problem, here: _State, damping: float) -> tuple[_State | None, float]:
    """Find a damped step that lowers the cost, with the next damping to begin with; None if none does.

    Levenberg and Marquardt's steps v, each bent by half of a = -(J'J + d)^-1 J'f_vv, with f_vv the prediction's
    curvature along v (geodesic acceleration: Transtrum, Machta & Sethna 2011): a valley that is narrow and
    curved, as that of a target near the last axis, is else followed in hundreds of short steps.
    """
    _, sizes, vt = np.linalg.svd(here.triangle)
    downhill = vt @ (here.triangle.T @ here.right)
    while damping <= _LARGEST_DAMPING:
        weight = 1 / (sizes**2 + damping * max(float(sizes[0]), 1e-300) ** 2)
        step = vt.T @ (weight * downhill)
        probed = problem.residual(here.moved(problem.index, _PROBE * step))
        acceleration = -vt.T @ (weight * (vt @ problem.pull(here, step, probed)))
        if 2 * np.linalg.norm(acceleration) <= _LARGEST_ACCELERATION * np.linalg.norm(step):
            ahead = problem.lower(here, here.moved(problem.index, step + acceleration / 2))
            if ahead is not None:
                return ahead, max(damping / 10, _LEAST_DAMPING)
        damping *= 10
    return None, _LEAST_DAMPING


def _beside(jacobian: Array, residual: Array) -> Array:
    """Join both, columns in a row: one factorization gives R of the Jacobian and Q'r."""
    both = np.empty((jacobian.shape[1] + 1, len(residual)), dtype=np.result_type(jacobian, residual))
    both[:-1], both[-1] = jacobian.T, residual
    return both.T
