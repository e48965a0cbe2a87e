"""Search for the errors that measurements share, and for outliers, each with the other.

Student's t with n degrees of freedom stands for noise whose variance changes by chance (Lange, Little & Taylor 1989).
Its shape is fitted to the residuals within several times their median alone, so that outliers do not look like tails.
"""

from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import Protocol

import numpy as np
import scipy  # its parts are loaded at their first use, which not every process comes to

from lab.calibration.gauss_newton import Observations
from lab.calibration.identification import Identification
from lab.calibration.observation import Observation, ReadingsInWholes, observation_of, only_positions
from lab.calibration.prior import ActingPrior
from lab.calibration.statistics.goodness_of_fit import goodness_beside_shared_errors, is_doubted
from lab.calibration.statistics.joint_rounding import by_joint_positions, counting
from lab.calibration.statistics.linearized import LinearizedFit, NoiseDistribution, linearized
from lab.calibration.statistics.outliers import LEAST_SIGMA_M, HeldOut, Outliers, find_outliers, held_out_outliers
from lab.calibration.statistics.whole_outliers import find_whole_outliers, held_out_whole_outliers
from lab.calibration.weights import Noise, error_shapes, joined, weigh, weighted_constraints
from lab.core.errors import LabError
from lab.core.linear_model import unit_columns
from lab.core.measurements import Measurements, seen_mask
from lab.core.random import rng_for
from lab.core.se3 import Array
from lab.kinematics.joints import Encoders
from lab.kinematics.model import Model
from lab.noise.error_model import Clock, ErrorModel, row_times
from lab.noise.error_term import Components, ErrorShapes, correlation_of, terms_with
from lab.noise.variance_components import (
    ComponentErrors,
    ComponentTrial,
    RestrictedProblem,
    SmallSample,
    VarianceEstimate,
    chosen_components,
    small_sample,
)

__all__ = [
    "NOTABLE",
    "NoiseSearch",
    "counted",
    "noise_of",
    "outliers_among_fitted",
    "outliers_among_held_out",
    "search_noise",
    "tail_dof",
    "tail_of",
]

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
    observation, noise = observation_of(found.model), noise.independent
    given_errors = noise.shared
    nothing = NoiseSearch(given_errors, (), float("nan"))
    if not only_positions(observation) or len(data) < _LEAST_POSES or found.dof < _LEAST_DOF:
        return nothing
    # the linear problem, whose residuals are tested
    model = observation.model
    observed, known = weigh(observation, data, noise)
    linear = linearized(model, observed, found.values, found.fit.free, found.extra_residuals)
    exact = not known and float((linear.residual**2).sum()) < _FLOOR_M**2 * found.dof
    if exact or not linear.everywhere().full_rank:
        return nothing
    # the variance components of the likeliest kinds of shared errors
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
    sigma_m = found.sigma_m if known else None
    shared = _error_model(found, estimate, clock, sigma_m, given_errors)
    return NoiseSearch(shared, trials, estimate.deviance, linear, estimate)


def _error_model(
    found: Identification,
    estimate: VarianceEstimate,
    clock: Clock | None,
    sigma_m: float | None,
    given_errors: ErrorModel | None,
) -> ErrorModel:
    """Return the error model of estimated variance components.

    Args:
        sigma_m: the noise that was given; None where it is estimated, too.
        given_errors: whole counts of the encoders, where these are known.
    """
    parts, scale = estimate.components, estimate.likelihood.scale
    return ErrorModel(
        sigma_m=float(np.sqrt(scale)) if sigma_m is None else sigma_m,
        independent_share=1.0 if sigma_m is None else scale,
        sizes={term.name: float(np.sqrt(parts[term.name] * scale)) for term in terms_with(parts.variances)},
        carry=parts.carry,
        clock=clock,
        values=dict(zip(found.model.names, found.values.tolist(), strict=True)),
        counts_rad=None if given_errors is None else given_errors.counts_rad,
    )


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


_FELT = 1e-9  # of the squares of what a prior changes: less in the readings is rounding
_ROUNDS = 3  # of outliers and the noise that they are judged by


def outliers_among_fitted(
    start: Identification, rows: Measurements, noise: Noise, shape: NoiseDistribution, seed: int
) -> Outliers:
    """Find outliers, by a search that starts from an identification.

    Args:
        shape: of the noise, where it has no heavy tails.
    """
    # a search that weighs each pose alone
    observation = observation_of(start.model)
    observations, sigma_given = weigh(observation, rows, noise)
    alone, extra = observations.pose_by_pose(), start.extra_residuals
    searched = partial(
        find_outliers,
        start.model,
        alone,
        start.fit.free,
        start.nominal_aligned,
        sigma_given=sigma_given,
        things=observation.positions or None,
    )
    if (prior := _felt_prior(start)) is not None:  # the fit weighs it by a sigma that outliers inflate
        beside, sigma = weighted_constraints(observation, observations), 1.0
        if not sigma_given:
            unweighted = joined(beside, prior.rows(LEAST_SIGMA_M))
            sigma = _sigma_without(searched(extra_residuals=unweighted, rng=rng_for(seed, "null"), shape=shape), alone)
        extra = joined(beside, prior.rows(sigma))
    if isinstance(observation, ReadingsInWholes):
        search_wholes = partial(find_whole_outliers, start.model, alone, observation.wholes(alone.inputs))
        places = (start.fit.free, start.nominal_aligned, start.values)
        return _sized(search_wholes(*places, rng=rng_for(seed, "null"), extra_residuals=extra), observation, rows)
    # with the tails that the noise has without them, where these are heavy
    search = partial(searched, extra_residuals=extra)
    found = search(rng=rng_for(seed, "null"), shape=shape)
    if not len(found.rows):
        return found
    if not observation.positions:
        return _sized(found, observation, rows)
    if not only_positions(observation):
        return found
    tail = tail_dof(linearized(start.model, alone, found.fit.values, start.fit.free, extra))
    if np.isinf(tail):
        return found
    return search(rng=rng_for(seed, "null"), shape=NoiseDistribution("student", dof=tail))


def _felt_prior(found: Identification) -> ActingPrior | None:
    """Return an automatic prior that determines some directions together with the readings; None without such a one.

    Along directions that no reading shows (the size of an arm at a printed board) its weight changes no residual.
    """
    if found.prior is None or not found.prior.automatic:
        return None
    # how the prior moves the parameters, and by how much that changes all rows and the rows that are no readings
    rows = found.extra_residuals(found.values)[1][:, list(found.fit.free)]
    moves = found.fit.unit_covariance() @ rows[-found.prior.acts_in :].T
    of_all, beside = (float(np.sum((each @ moves) ** 2)) for each in (found.fit.triangle * found.fit.scale, rows))
    return found.prior if of_all - beside > _FELT * beside else None


def _sized(found: Outliers, observation: Observation, rows: Measurements) -> Outliers:
    """Return the outliers with the lengths of their errors, as the observation counts them, the largest first."""
    sizes = np.nan_to_num(observation.errors(rows[found.rows], found.fit.values)).max(axis=1)
    order = np.argsort(-sizes, kind="stable")
    wholes = found.wholes[order] if len(found.wholes) else found.wholes
    return replace(found, rows=found.rows[order], sizes_m=sizes[order], p_values=found.p_values[order], wholes=wholes)


def _sigma_without(found: Outliers, observations: Observations) -> float:
    inside = np.ones(len(observations.inputs), dtype=np.bool_)
    inside[found.rows] = False
    dof = int(observations.seen[inside].sum()) * observations.points.shape[2] - found.fit.rank
    return max(float(np.sqrt(2 * found.fit.cost_trace[-1] / max(dof, 1))), LEAST_SIGMA_M)


def outliers_among_held_out(
    found: Identification, rows: Measurements, held_out: Measurements, noise: Noise, tail: float
) -> HeldOut:
    """Find outliers among poses held out, by an identification from ``rows``."""
    observation = observation_of(found.model)
    parts = [weigh(observation, part, noise) for part in (rows, held_out)]
    if isinstance(observation, ReadingsInWholes):
        before, after = ((part, observation.wholes(part.inputs)) for part in (each.pose_by_pose() for each, _ in parts))
        off = held_out_whole_outliers(found.model, before, after, found.fit, found.extra_residuals)
        sizes = np.nan_to_num(observation.errors(held_out[off.rows], found.values)).max(axis=1, initial=0.0)
        return replace(off, sizes_m=sizes)
    both = parts[0][0].pose_by_pose().joined(parts[1][0].pose_by_pose())
    return held_out_outliers(
        found.model,
        both,
        len(rows),
        found.fit,
        sigma_given=parts[0][1],
        extra_residuals=found.extra_residuals,
        things=observation.positions,
        tail_dof=tail,
    )


def tail_of(found: Identification, rows: Measurements, noise: Noise) -> float:
    """Degrees of freedom of the noise's tails; infinite where they may be Gaussian."""
    if not only_positions(observation := observation_of(found.model)):
        return float("inf")
    alone = weigh(observation, rows, noise)[0].pose_by_pose()
    return tail_dof(linearized(found.model, alone, found.values, found.fit.free, found.extra_residuals))


class _Fits(Protocol):
    """Fits of one model to any rows, with given noise."""

    @property
    def noise(self) -> Noise:
        """Noise of the instrument."""

    @property
    def encoders(self) -> Encoders | None:
        """Whose whole counts the joint positions are; None for ideal ones."""

    def fitted(self, rows: Measurements, shared: ErrorModel | None) -> Identification:
        """Return the identification from all these rows."""

    def outliers(self, found: Identification, rows: Measurements, shared: ErrorModel | None) -> Outliers:
        """Return the outliers."""


@dataclass(frozen=True)
class _Explanation:
    """Errors that are shared, and poses that are off.

    Attributes:
        outliers: ``(o,)`` rows.
        deviance: minus twice the log-likelihood, with outliers anywhere among the residuals.
    """

    search: NoiseSearch
    outliers: frozenset[int]
    deviance: float


def noise_of(fits: _Fits, rows: Measurements) -> NoiseSearch:
    """Estimate the errors that rows share, from those that are no outliers.

    Outliers look like scatter, and scatter looks like outliers. Both are tried first; where the explanations differ,
    that of the larger likelihood is taken, in which an outlier is equally likely everywhere among the residuals.
    Rounding to whole counts of given encoders is weighted before the search. If the fit stalled on an ill-conditioned
    problem, no noise model is searched. Of very many rows some stretches are used.
    """
    rows = in_stretches(rows)
    whole = fits.fitted(rows, None)
    if (counts := _counted(whole, rows, fits.encoders)) is not None:
        whole = fits.fitted(rows, counts)
    if whole.status == "in a valley":
        return NoiseSearch(counts, (), float("nan"))
    search = search_noise(whole, rows, replace(fits.noise, shared=counts))
    outliers = _rows(fits.outliers(whole, rows, counts))
    if not outliers and search.shared is counts:
        return search
    reach = _reach(whole, rows, fits.noise)
    explanations = []
    if search.shared is not counts:
        first = _Explanation(search, frozenset(), search.deviance)
        explanations.append(_settled(fits, rows, first, reach, counts))
    if outliers:
        with suppress(LabError):  # the others are too few for the parameters: they are fitted with the outliers
            explanations.append(_settled(fits, rows, _without(fits, rows, outliers, reach, counts), reach, counts))
    return min(explanations, key=lambda each: each.deviance).search if explanations else search


def _counted(whole: Identification, rows: Measurements, encoders: Encoders | None) -> ErrorModel | None:
    observation = observation_of(whole.model)
    if encoders is None or not only_positions(observation):
        return None
    dof = None if whole.sigma_given else whole.dof
    return counted(observation.model, rows, whole.values, encoders, whole.sigma_m, dof)


def _settled(
    fits: _Fits, rows: Measurements, first: _Explanation, reach: float, counts: ErrorModel | None
) -> _Explanation:
    here = first
    for _ in range(_ROUNDS):
        shared = here.search.shared
        outliers = _rows(fits.outliers(fits.fitted(rows, shared), rows, shared))
        if outliers == here.outliers:
            break
        try:
            here = _without(fits, rows, outliers, reach, counts)
        except LabError:  # the others are too few for the parameters
            break
    return here


def _without(
    fits: _Fits, rows: Measurements, outliers: frozenset[int], reach: float, counts: ErrorModel | None
) -> _Explanation:
    clean = rows[np.setdiff1d(np.arange(len(rows)), sorted(outliers))]
    search = search_noise(fits.fitted(clean, counts), clean, replace(fits.noise, shared=counts))
    numbers = 3 * int(rows.seen[sorted(outliers)].sum())
    return _Explanation(search, outliers, search.deviance + numbers * (2 * np.log(2 * reach) - np.log(2 * np.pi)))


def _rows(found: Outliers) -> frozenset[int]:
    return frozenset(found.rows.tolist())


def _reach(found: Identification, rows: Measurements, noise: Noise) -> float:
    """Return the largest residual of a number, in units of the instrument's noise as it is assumed."""
    observed, _ = weigh(observation_of(found.model), rows, replace(noise, shared=None))
    residuals = observed.points - found.model.points(observed.inputs, found.values)
    white = observed.in_units_of_noise(np.where(seen_mask(observed.points)[..., None], residuals, 0.0))
    return float(max(np.abs(white).max(), 1e-300))


_WITHIN = 7.0  # standard deviations, estimated by the median of the sizes
_MEDIAN = 0.6744897501960817  # of a standard normal's size
_DOFS = np.array([2.2, 2.6, 3.0, 3.5, 4.0, 5.0, 6.0, 8.0, 12.0, 20.0, 40.0, np.inf])
_SCALES = np.linspace(0.6, 1.25, 27)  # of the median's standard deviation
_LEAST_NUMBERS = 50
_BINS = 60_000  # of sizes: with a million numbers they change a log-likelihood by 0.001
_CAUTION = 1.0  # the least degrees of freedom whose log-likelihood is less than the largest by so much


def tail_dof(linear: LinearizedFit) -> float:
    """Return plausible degrees of freedom of Student's t of the noise; infinite where it may be Gaussian.

    The heaviest tails that the residuals do not contradict are taken, unless none are as likely: so the outlier test
    keeps its level.
    """
    within = linear.everywhere()
    left = within.left()
    tested = linear.mask & (left > 0.2) & (np.arange(len(left)) < linear.poses)[:, None]
    numbers = np.abs(linear.residual[tested]) / np.sqrt(left[tested])
    if len(numbers) < _LEAST_NUMBERS or not (middle := float(np.median(numbers))) > 0:
        return float("inf")
    inside = numbers * (_MEDIAN / middle)
    inside, count = _binned(inside[inside < _WITHIN])
    heights = np.array([_heights(inside, count, _WITHIN, dof, _SCALES).max() for dof in _DOFS])
    if heights.max() - heights[-1] < _CAUTION:
        return float("inf")
    return float(_DOFS[np.flatnonzero(heights > heights.max() - _CAUTION)[0]])


def _binned(sizes: Array) -> tuple[Array, Array]:
    """Sizes below the bound and how many there are of each: of very many, the middles of narrow intervals."""
    if len(sizes) <= _BINS:
        return sizes, np.ones(len(sizes))
    count, edges = np.histogram(sizes, _BINS, (0.0, _WITHIN))
    return (edges[:-1] + edges[1:]) / 2, count.astype(np.float64)


def _heights(numbers: Array, count: Array, bound: float, dof: float, scales: Array) -> Array:
    """Return the log-likelihood ``(s,)`` of numbers ``(n,)`` below a bound by Student's t of each scale.

    Args:
        count: ``(n,)`` how many there are of each number.
        dof: its degrees of freedom; infinite for the normal distribution.
    """
    if np.isinf(dof):
        below = scipy.special.ndtr(bound / scales)
        constant = -0.5 * np.log(2 * np.pi)
    else:
        below = scipy.special.stdtr(dof, bound / scales)
        constant = scipy.special.gammaln((dof + 1) / 2) - scipy.special.gammaln(dof / 2) - 0.5 * np.log(dof * np.pi)
    squares = (numbers / scales[:, None]) ** 2
    logs = -0.5 * squares if np.isinf(dof) else -(dof + 1) / 2 * np.log1p(squares / dof)
    return np.asarray((constant + logs) @ count - count.sum() * np.log(scales * (2 * below - 1)))
