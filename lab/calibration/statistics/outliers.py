"""Find outlying poses: a robust start, then a test with a level.

Redescending weights find a clean majority whatever a few poses are. From there on it is least squares and a test:
every pose is compared with its prediction by the accepted others, and is accepted unless it fails. The level is that of
a whole campaign: the chance that any outlier is reported where there is noise alone.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from lab.calibration.gauss_newton import ExtraResiduals, Fit, Observations, fit
from lab.calibration.statistics.linearized import (
    LinearizedFit,
    Mask,
    NoiseDistribution,
    SubsetFit,
    linearized,
    smallest_p,
)
from lab.core.linear_model import p_value_of_squares
from lab.core.probability import chi2_isf, chi2_ppf, normal_sf
from lab.core.se3 import Array
from lab.core.significance import CAMPAIGN_OUTLIERS
from lab.kinematics.model import Model

__all__ = [
    "LEAST_SIGMA_M",
    "HeldOut",
    "Outliers",
    "find_outliers",
    "held_out_outliers",
    "leave_out",
    "residual_lengths",
    "would_matter",
]

_MISFIT = 1.5  # times the known sigma: from there on the residuals of most poses are not its noise
LEAST_SIGMA_M = 1e-6  # an estimated sigma below is no instrument's, but what models leave of each other
_DRAWS = 999  # (draws + 1) x level is a whole number: the test of Monte Carlo draws is then exact (Barnard 1963)
_TUKEY_TAIL = 2 * normal_sf(4.685)  # weight zero where noise is as rare as at Tukey's 4.685 sigma of one number
_ROUNDS = 30
_FIRST_POSES = 4_000  # of very many, on which the search begins
_HALVINGS, _WORSE = 10, 1.5  # of a robust step after which half of the poses are missed by so many times the least

_SETTLED = 0.01  # sigma: a robust step below ends its iteration


def _no_wholes() -> NDArray[np.int_]:
    return np.empty(0, dtype=np.int_)


@dataclass(frozen=True)
class Outliers:
    """Outliers among the poses, and least squares on the others.

    Attributes:
        rows: of the outliers, the largest first.
        sizes_m: ``(o,)`` distance of the pose's farthest target from its prediction by the other poses.
        p_values: ``(o,)`` of the whole campaign: the chance that noise alone makes any pose stand out as far.
        fit: least squares on all other poses.
        weights: ``(n,)`` Tukey's, where the search started; 1 is a pose like the others, 0 one far out.
        sigma_given: whether the given sigma was the test's measure. It is not where most residuals are beyond it.
        level: the chance that a campaign of noise alone has an outlier.
        needed: rows that fail the test, but without which the others do not identify the parameters: they are fitted,
            and end the search.
        wholes: ``(o,)`` number of the picture with which each is off; -1 where it is off alone. Empty where rows are
            poses.
    """

    rows: NDArray[np.int_]
    sizes_m: Array
    p_values: Array
    fit: Fit
    weights: Array
    sigma_given: bool
    level: float
    needed: NDArray[np.int_]
    wholes: NDArray[np.int_] = field(default_factory=_no_wholes)


def find_outliers(
    model: Model,
    observed: Observations,
    free: Sequence[int],
    start: Array,
    *,
    sigma_given: bool,
    rng: np.random.Generator,
    shape: NoiseDistribution = NoiseDistribution(),  # noqa: B008
    level: float = CAMPAIGN_OUTLIERS,
    extra_residuals: ExtraResiduals | None = None,
    things: int | None = None,
) -> Outliers:
    """Find the poses that are off, and fit the others.

    Args:
        start: ``(p,)``, links near the nominal ones, base and targets located.
        sigma_given: whether the weights of ``observed`` stand on a known sigma.
        rng: for the distribution of the largest residual where noise is not Gaussian.
        things: how many of the observed things, from the first, are lengths; all where None.
        extra_residuals: what else is known of the parameters, as for ``fit``.
    """
    values, weights, scale = _robust(
        model, observed, free, start, extra_residuals, 0.01 if sigma_given else LEAST_SIGMA_M
    )
    plausible = bool(sigma_given and scale <= _MISFIT)
    inside, linear = weights > 0, linearized(model, observed, values, free, extra_residuals)
    applies = plausible == sigma_given or shape.kind == "student"
    test = _test(linear, shape if applies else NoiseDistribution(), plausible, level, rng)
    for _ in range(_ROUNDS):
        settled, needed = _settle(linear, inside, test)
        solution = fit(
            model, leave_out(observed, np.flatnonzero(~settled)), free, values, extra_residuals=extra_residuals
        )
        values, before, inside = solution.values, inside, settled
        linear = linearized(model, observed, values, free, extra_residuals)
        if (inside == before).all():
            break
    p, _ = test.judge(linear.within(inside), linear.residual)
    rows, sizes = np.flatnonzero(~inside), residual_lengths(model, observed, values, things)
    rows = rows[np.argsort(-sizes[rows], kind="stable")]
    return Outliers(
        rows, sizes[rows], test.campaign(p[rows]), solution, weights[: linear.poses], plausible, level, needed
    )


@dataclass(frozen=True)
class HeldOut:
    """Poses that were not fitted, and are off; as ``Outliers`` has them."""

    rows: NDArray[np.int_]
    sizes_m: Array
    p_values: Array
    wholes: NDArray[np.int_] = field(default_factory=_no_wholes)


def held_out_outliers(
    model: Model,
    observed: Observations,
    fitted: int,
    solution: Fit,
    *,
    sigma_given: bool,
    level: float = CAMPAIGN_OUTLIERS,
    extra_residuals: ExtraResiduals | None = None,
    things: int | None = None,
    tail_dof: float = np.inf,
) -> HeldOut:
    """Test poses held out against the prediction from the fitted ones: F or chi squared, with Bonferroni.

    Args:
        observed: the fitted poses, then those held out.
        fitted: how many of them were.
        sigma_given: whether the weights are from a given sigma; where most residuals are beyond it, it is estimated.
        level, extra_residuals, things: as for ``find_outliers``.
    """
    linear = linearized(model, observed, solution.values, solution.free, extra_residuals)
    inside = np.ones(len(linear.mask), dtype=bool)
    inside[fitted : linear.poses] = False
    within = linear.within(inside)
    distance, total = within.squares(within.residuals(linear.residual))
    plausible = sigma_given and float(total) <= _MISFIT**2 * max(within.dof, 1)
    p = within.p_values(distance, total, plausible, 0.0 if sigma_given else LEAST_SIGMA_M)
    if np.isfinite(tail_dof):  # a pose's squared distance is then distributed as F
        sizes, scale = np.maximum(within.count, 1), 1.0 if plausible else float(total) / max(within.dof, 1)
        p = np.maximum(p, p_value_of_squares(distance, sizes, tail_dof, scale * (tail_dof - 2) / tail_dof))
    campaign = np.minimum(1.0, p * max(linear.poses - fitted, 1))
    rows, sizes = (
        np.flatnonzero(~inside & (campaign < level)),
        residual_lengths(model, observed, solution.values, things),
    )
    rows = rows[np.argsort(-sizes[rows], kind="stable")]
    return HeldOut(rows - fitted, sizes[rows], campaign[rows])


def leave_out(observed: Observations, rows: NDArray[np.int_]) -> Observations:
    """Return the observations without some rows."""
    return observed.take(np.setdiff1d(np.arange(len(observed.inputs)), rows))


def would_matter(model: Model, observed: Observations, fitted: Array, without: Array) -> float:
    """Return the change (m, root mean square over the observed points) of the prediction between two ``(p,)``.

    For a plain fit and one without its outliers it is the effect of leaving them out.
    """
    moved = model.points(observed.inputs, fitted) - model.points(observed.inputs, without)
    return float(np.sqrt((moved[observed.seen] ** 2).sum(axis=-1).mean()))


@dataclass(frozen=True)
class _Test:
    """Outlier test of single poses, at the level of a campaign.

    Attributes:
        critical: a pose is an outlier where its own p-value is at most this.
        reference: ``(b,)`` smallest p-values of campaigns of nothing but noise; empty if Gaussian.
        floor: least sigma, whitened.
    """

    sigma_given: bool
    critical: float
    reference: Array
    poses: int
    floor: float

    def judge(self, within: SubsetFit, errors: Array) -> tuple[Array, Array]:
        distance, total = within.squares(within.residuals(errors))
        return within.p_values(distance, total, self.sigma_given, self.floor), distance

    def campaign(self, p: Array) -> Array:
        """Return p-values of a whole campaign: Bonferroni's, or the share of draws with as small a one."""
        if not len(self.reference):
            return np.minimum(1.0, p * self.poses)
        below = np.searchsorted(self.reference, p, side="right")
        return np.asarray((1 + below) / (1 + len(self.reference)))


def _test(
    linear: LinearizedFit, shape: NoiseDistribution, sigma_given: bool, level: float, rng: np.random.Generator
) -> _Test:
    poses = int(linear.mask[: linear.poses].any(axis=1).sum())
    floor = 0.0 if sigma_given else LEAST_SIGMA_M
    if shape.kind == "gaussian":
        return _Test(sigma_given, level / poses, np.empty(0), poses, floor)
    draws = int(np.ceil((_DRAWS + 1) * max(1.0, CAMPAIGN_OUTLIERS / level))) - 1
    reference = smallest_p(linear.everywhere(), linear.mask, shape, sigma_given, draws, rng)
    rank = int(np.floor((draws + 1) * level + 1e-9)) - 1
    return _Test(sigma_given, np.nextafter(reference[rank], 0.0), reference, poses, floor)


def _settle(linear: LinearizedFit, inside: Mask, test: _Test) -> tuple[Mask, NDArray[np.int_]]:
    """Return the poses that are accepted, from a first guess, and those that fail but are needed.

    All outside that pass come back; only when none does, the worst inside that fails leaves. It ends where
    neither happens (Hadi & Simonoff 1993 go forward alike), and where the worst cannot be done without: every
    other pose then stands out because of it. Of very many poses, none of which moves the fit much, all leave together
    that fail half as far away as the worst.
    """
    within = linear.within(inside)
    if not (within.full_rank and within.dof > 0):  # too few to determine the parameters and sigma
        within = linear.everywhere()
    inside, tried = within.inside, set[bytes]()
    while inside.tobytes() not in tried:
        tried.add(inside.tobytes())
        within = within if within.inside is inside else linear.within(inside)
        p, distance = test.judge(within, linear.residual)
        passed = p > test.critical
        if (back := ~inside & passed).any():
            inside = inside | back
            continue
        failed = inside & ~passed
        if not failed.any():
            break
        without = inside.copy()
        off = np.where(failed, distance, -1.0)
        without[off >= off.max() / 2 if linear.poses > _FIRST_POSES else np.argmax(off, keepdims=True)] = False
        others = linear.within(without)
        if not others.full_rank:
            return inside, np.flatnonzero(failed & (within.count < linear.mask.sum(axis=1)))
        inside, within = without, others
    return inside, np.empty(0, dtype=np.int_)


def _robust(
    model: Model,
    observed: Observations,
    free: Sequence[int],
    start: Array,
    extra_residuals: ExtraResiduals | None,
    floor: float,
) -> tuple[Array, Array, float]:
    """Values, Tukey's weights ``(n,)`` and scale that a minority of poses cannot spoil.

    Tukey's biweight of the poses' residual lengths, one weight a pose, with a scale from their median that falls
    as the fit comes nearer to the majority (Huber & Ronchetti 2009, section 7.8; reweighted least squares).
    Lowering the sum of lengths first was tried: it brought nothing, up to 45 % of the poses off.

    The loop is its own: the weights follow the residuals, and a step that leads to where a model has no answer, or most
    poses are missed by more than before, is halved.
    """
    few = observed.thinned(_FIRST_POSES)
    if few is not observed:
        values, _, _ = _robust(model, few, free, start, extra_residuals, floor)
        return values, *_weights_at(model, observed, values, extra_residuals, floor)
    values, linear = start, linearized(model, observed, start, free, extra_residuals)
    least = _missed(linear)
    for _ in range(_ROUNDS):
        basis, triangle = np.linalg.qr(linear.jacobian.reshape(-1, len(free)))
        step, weights, scale = _reweighted(linear, basis, floor)
        change = np.linalg.lstsq(triangle, step, rcond=None)[0] / linear.scale
        settled = np.linalg.norm(step) < _SETTLED * scale * np.sqrt(len(step))
        for part in 0.5 ** np.arange(_HALVINGS):
            ahead = values.copy()
            ahead[list(free)] += part * change
            if settled:
                return ahead, weights, scale
            there = linearized(model, observed, ahead, free, extra_residuals)
            if (missed := _missed(there)) <= _WORSE * least:
                break
        else:
            break
        values, linear, least = ahead, there, min(missed, least)
    return values, weights, scale


def _missed(linear: LinearizedFit) -> float:
    """Return the length of the residual that half of the poses exceed; infinite where a model has no answer."""
    lengths = np.linalg.norm(linear.residual[: linear.poses], axis=1)
    return float(np.median(lengths)) if np.isfinite(linear.residual).all() else np.inf


def _reweighted(linear: LinearizedFit, basis: Array, floor: float) -> tuple[Array, Array, float]:
    """Step ``(f,)`` in an orthonormal basis ``(n m, f)``, Tukey's weights ``(n,)`` and the scale."""
    size = linear.mask.sum(axis=1)
    tested = (size > 0) & (np.arange(len(size)) < linear.poses)
    shrunk = np.sqrt(max(1.0 - len(basis[0]) / size.sum(), 0.1))
    step = np.zeros(len(basis[0]))
    for _ in range(_ROUNDS):
        lengths = np.linalg.norm(linear.residual - (basis @ step).reshape(linear.residual.shape), axis=1)
        weights, scale = _biweight(lengths, size, tested, shrunk, floor)
        moved = _weighted_step(linear, basis, weights) - step
        step = step + moved
        if np.linalg.norm(moved) < _SETTLED * scale * np.sqrt(len(step)):
            break
    return step, weights, scale


def _weights_at(
    model: Model, observed: Observations, values: Array, extra_residuals: ExtraResiduals | None, floor: float
) -> tuple[Array, float]:
    """Tukey's weights of very many poses, and the scale, at parameters that are near enough."""
    mask = observed.seen
    n, k, d = observed.points.shape
    residual = np.zeros((n, k, d))
    residual[mask] = observed.apply(observed.points - model.points(observed.inputs, values)).reshape(-1, d)
    lengths, size = np.linalg.norm(residual.reshape(n, -1), axis=1), d * mask.sum(axis=1)
    more = 0 if extra_residuals is None else -(-len(extra_residuals(values)[0]) // (k * d))
    weights, scale = _biweight(lengths, size, size > 0, 1.0, floor)
    return np.concatenate([weights, np.ones(more)]), scale


def _biweight(lengths: Array, size: NDArray[np.int_], tested: Mask, shrunk: float, floor: float) -> tuple[Array, float]:
    """Weights of residuals' lengths ``(n,)`` of so many numbers each, and the scale by their median."""
    numbers, index = np.unique(np.maximum(size, 1), return_inverse=True)
    middle, end = (np.sqrt(each)[index] for each in (chi2_ppf(0.5, numbers), chi2_isf(_TUKEY_TAIL, numbers)))
    scale = max(float(np.median((lengths / middle)[tested])) / shrunk, floor)
    weights = np.maximum(1 - (lengths / (scale * end)) ** 2, 0.0) ** 2
    weights[~tested & (size > 0)] = 1.0
    return weights, scale


def _weighted_step(linear: LinearizedFit, basis: Array, weights: Array) -> Array:
    spread = (np.repeat(weights, linear.mask.shape[1])[:, None] * basis).T
    normal = spread @ basis
    normal.flat[:: len(normal) + 1] += 1e-12 * np.trace(normal)  # weights of zero may leave a direction to nobody
    return np.asarray(np.linalg.solve(normal, spread @ linear.residual.ravel()))


def residual_lengths(model: Model, observed: Observations, values: Array, things: int | None) -> Array:
    """Largest residual length ``(n,)`` of each pose's observed targets (m)."""
    lengths = np.linalg.norm((observed.points - model.points(observed.inputs, values))[:, :things], axis=2)
    return np.asarray(np.where(np.isnan(lengths), 0.0, lengths).max(axis=1))
