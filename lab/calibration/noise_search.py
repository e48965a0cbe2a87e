"""Search for correlated measurement errors, and their effect on the fit's covariance."""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import scipy  # its parts are loaded at their first use, which not every process comes to

from lab.calibration.identification import Identification
from lab.calibration.observation import observation_of, only_positions
from lab.calibration.statistics.goodness_of_fit import goodness_beside_shared_errors, is_doubted
from lab.calibration.statistics.joint_rounding import by_joint_positions, counting
from lab.calibration.statistics.linearized import LinearizedFit, linearized
from lab.calibration.weights import Noise, error_shapes, weigh
from lab.core.linear_model import unit_columns
from lab.core.measurements import Measurements, seen_mask
from lab.core.se3 import Array
from lab.core.units import short_length
from lab.kinematics.joints import Encoders
from lab.kinematics.model import Model
from lab.noise.change_points import rows_around
from lab.noise.error_model import Clock, ErrorModel, row_times
from lab.noise.error_term import TERMS, Components, ErrorShapes, SuddenMove, correlation_of, terms_with
from lab.noise.variance_components import (
    ComponentErrors,
    ComponentTrial,
    RestrictedProblem,
    SmallSample,
    VarianceEstimate,
    chosen_components,
    small_sample,
)

__all__ = ["NOTABLE", "NoiseSearch", "counted", "in_stretches", "search_noise"]

NOTABLE = 0.1  # of the noise: what whole counts of the encoders make beside it
_LEAST_ALONE = 0.1  # of a noise that was estimated with the counts in it: what it is at least without them
_LEAST_POSES = 10  # fewer do not show shared errors
_LEAST_DOF = 20
_MOST_POSES, _STRETCHES = 4_000, 8  # rows used of very many, and the stretches that they are in
_FLOOR_M = 1e-7  # an estimated sigma below is what arithmetic leaves, or the models of each other


@dataclass(frozen=True)
class NoiseSearch:
    """Errors that the residuals of a fit show.

    Attributes:
        shared: beside the instrument's; None where there are none, or where they are the arm's: they come back.
        trials: every kind that was tried, with its p-value.
        deviance: minus twice the restricted log-likelihood of what was chosen.
        undecided: whether errors are shared that come back with the joints: what is drawn anew at each pose, and what
            the model lacks, are confounded.
    """

    shared: ErrorModel | None
    trials: tuple[ComponentTrial, ...]
    deviance: float
    linear: LinearizedFit | None = None
    estimate: VarianceEstimate | None = None
    undecided: bool = False

    def corrected(self, found: Identification) -> Identification:
        """Return an identification with the covariance and intervals of the estimated variances."""
        small = self._small_sample
        if small is None or self.linear is None:
            return found
        factor = small.factor / self.linear.scale[:, None] * self.linear.scale
        return replace(found, covariance=factor @ found.covariance @ factor.T, dof_each=small.dof)

    @property
    def component_errors(self) -> ComponentErrors | None:
        """Errors of the variance components; None where none were estimated."""
        return None if self._small_sample is None else self._small_sample.components

    @cached_property
    def _small_sample(self) -> SmallSample | None:
        if self.shared is None or self.estimate is None:
            return None
        return small_sample(self.estimate.problem, self.estimate)


def search_noise(found: Identification, data: Measurements, noise: Noise) -> NoiseSearch:
    """Choose the errors that the rows of an identification share, by restricted likelihood on its linear problem.

    Args:
        noise: of the instrument, and of whole counts where these are known; what was estimated of shared errors is left
            aside.
    """
    observation = observation_of(found.model)
    noise = noise.independent
    given_errors = noise.shared
    nothing = NoiseSearch(given_errors, (), float("nan"))
    if not only_positions(observation) or len(data) < _LEAST_POSES or found.dof < _LEAST_DOF:
        return nothing
    model = observation.model
    observed, known = weigh(observation, data, noise)
    linear = linearized(model, observed, found.values, found.fit.free, found.extra_residuals)
    if not linear.everywhere().full_rank:
        return nothing
    if not known and float((linear.residual**2).sum()) < _FLOOR_M**2 * found.dof:
        return nothing
    clock = Clock.of(data)
    times = row_times(data, clock)
    shapes = error_shapes(model, observed, found.values, data.joints.shape[1], times, clock)
    problem = RestrictedProblem(
        np.concatenate([linear.jacobian, linear.residual[..., None]], axis=2),
        int(linear.mask.sum()),
        _padded(shapes, len(linear.mask)),
        known,
        noise.error_terms,
    )
    estimate, trials = chosen_components(problem)
    if not estimate.kinds:
        return NoiseSearch(given_errors, trials, estimate.deviance)
    if _varies_with_joints(linear, estimate, data):
        return NoiseSearch(given_errors, trials, problem.likelihood(Components()).deviance, undecided=True)
    parts, scale = estimate.components, estimate.likelihood.scale
    shared = ErrorModel(
        sigma_m=found.sigma_m if known else float(np.sqrt(scale)),
        independent_share=scale if known else 1.0,
        sizes={term.name: float(np.sqrt(parts[term.name] * scale)) for term in terms_with(parts.variances)},
        carry=parts.carry,
        clock=clock,
        values=dict(zip(model.names, found.values.tolist(), strict=True)),
        counts_rad=None if given_errors is None else given_errors.counts_rad,
        moves=_moves(estimate, data, times),
    )
    return NoiseSearch(shared, trials, estimate.deviance, linear, estimate)


def _moves(estimate: VarianceEstimate, data: Measurements, times: Array) -> tuple[SuddenMove, ...]:
    """Change points with their sizes, between the last row before and the first one after, in the order of time."""
    found, (scanned,) = [], (term for term in TERMS if term.scanned)
    shifts = estimate.problem.predicted(estimate.components, scanned)
    for change, shift in zip(estimate.problem.shapes.changes, shifts, strict=True):
        (last, first), size_m = rows_around(times, change.time), float(np.linalg.norm(shift))
        before, after = data.ids[last], data.ids[first]
        text = f"the base or the instrument moved by {short_length(size_m)} between poses {before} and {after}"
        found.append(SuddenMove(change, before, after, size_m, text))
    return tuple(sorted(found, key=lambda move: move.change.time))


def in_stretches(data: Measurements) -> Measurements:
    """Select rows that suffice to estimate the noise: all, or of over 4,000 eight stretches of consecutive ones."""
    if len(data) <= _MOST_POSES:
        return data
    length = _MOST_POSES // _STRETCHES
    starts = np.linspace(0, len(data) - length, _STRETCHES).round().astype(np.int_)
    return data[(starts[:, None] + np.arange(length)).ravel()]


def _varies_with_joints(linear: LinearizedFit, estimate: VarianceEstimate, data: Measurements) -> bool:
    """Test whether residuals beside the components repeat with joint position: then they were not drawn anew."""
    shapes = estimate.problem.shapes
    correlation = correlation_of(shapes, estimate.components)
    white = correlation.white(estimate.problem.rows)
    columns, scale = unit_columns(white[..., :-1].reshape(-1, white.shape[2] - 1))
    whitened = LinearizedFit(white[..., -1], columns.reshape(*linear.mask.shape, -1), scale, linear.mask, linear.poses)
    left = whitened.everywhere().residuals(whitened.residual)  # of the fit with these errors, not of the one without
    whitened = replace(whitened, residual=left)
    slopes = correlation.white(shapes.scatter)[: linear.poses]
    return is_doubted(goodness_beside_shared_errors(whitened, slopes, data.joints))


def _padded(shapes: ErrorShapes, blocks: int) -> ErrorShapes:
    more = blocks - len(shapes.times)
    if not more:
        return shapes
    rows = [(0, more), (0, 0), (0, 0)]
    after = shapes.times.max() + 1.0 + np.arange(more)
    scatter, shift = (np.pad(each, rows) for each in (shapes.scatter, shapes.shift))
    return ErrorShapes(scatter, shift, np.pad(shapes.along, (0, more)), np.concatenate([shapes.times, after]))


def counted(
    model: Model, data: Measurements, values: Array, encoders: Encoders, sigma_m: float, dof: int | None = None
) -> ErrorModel | None:
    """Return the error model of known encoders' rounding to whole counts; None where it is small beside the noise.

    Errors in variables: a count is off by half of one at most, uniformly, and through the derivatives by the joints
    all numbers of a pose share that.

    Args:
        values: ``(p,)`` of a fit; the derivatives are taken there.
        sigma_m: the noise of a coordinate; where it was estimated, with the counts in it.
    """
    if not counting(model, data, values, encoders) > NOTABLE * sigma_m > 0:
        return None
    root = np.asarray(np.linalg.cholesky(encoders.covariance))
    alone_m = sigma_m if dof is None else _without_counts(model, data, values, root, dof, sigma_m)
    named = dict(zip(model.names, values.tolist(), strict=True))
    return ErrorModel(alone_m, 1.0, {}, None, named, counts_rad=root)


def _without_counts(model: Model, data: Measurements, values: Array, root: Array, dof: int, sigma_m: float) -> float:
    """Return sigma beside encoder counts, so that sum r' (sigma^2 + S S')^-1 r of residuals r equals dof.

    Where even a small one explains the residuals, that is it.
    """
    inputs = data.inputs(model.conditions)
    mask, n = seen_mask(data.points)[..., None], len(data)
    residual = np.where(mask, data.points - model.points(inputs, values), 0.0).reshape(n, -1, 1)
    slopes = np.where(mask[..., None], by_joint_positions(model, inputs, values, len(root)), 0.0)
    made = slopes.reshape(n, -1, len(root)) @ root
    variances, axes = np.linalg.eigh(made @ made.swapaxes(1, 2))
    squares = (axes.swapaxes(1, 2) @ residual)[..., 0] ** 2

    def excess(log_sigma: float) -> float:
        return float((squares / (np.exp(2 * log_sigma) + np.maximum(variances, 0.0))).sum()) - dof

    low, high = np.log(_LEAST_ALONE * sigma_m), np.log(sigma_m)
    if excess(low) <= 0:
        return float(np.exp(low))
    return float(np.exp(scipy.optimize.brentq(excess, low, high + 1.0)))
