"""Test the lack of fit of a model, and choose the intervals of its parameters.

Each is a ``Check`` named ``lack_of_fit.`` and the test: ``chi2`` (against a given sigma), ``repeats`` (F against pure
error), ``holdout`` (F of held-out errors), ``joints`` (F of what varies with the joints' positions), ``distances`` (F
against distances between targets) or ``nothing``. It failed where there is lack of fit, passed where there is none, and
is not tested where neither is known. Intervals are those of the weights, or cluster-robust ones of whole poses.
"""

from dataclasses import dataclass, replace

import numpy as np
import scipy  # its statistics are loaded at their first use
from numpy.typing import NDArray

from lab.calibration.gauss_newton import ExtraResiduals, Fit, Observations
from lab.calibration.identification import Identification
from lab.calibration.observation import observation_of, only_positions
from lab.calibration.row_groups import configurations
from lab.calibration.statistics.joint_rounding import by_joint_positions
from lab.calibration.statistics.linearized import LinearizedFit, NoiseDistribution, linearized
from lab.calibration.statistics.outliers import LEAST_SIGMA_M
from lab.calibration.weights import Noise, weigh
from lab.core.checks import Check, Outcome
from lab.core.linear_model import LinearModel, matched_dof, p_value_of_squares
from lab.core.measurements import FIXTURE, Measurements, evenly, seen_mask
from lab.core.probability import binomial_cdf, f_cdf, f_isf, f_sf, normal_ppf
from lab.core.se3 import Array
from lab.core.significance import LACK_OF_FIT, UNSOLICITED_WARNING, VARIANCE_COMPONENTS, VERDICT_LACK_OF_FIT
from lab.kinematics.model import Model
from lab.noise.error_model import ErrorModel
from lab.noise.instruments import is_isotropic
from lab.noise.rigid_distances import goodness_by_distances, instrument_noise

__all__ = [
    "adequacy_of",
    "goodness_beside_shared_errors",
    "goodness_of_fit",
    "is_doubted",
    "isotropy",
    "lack_of_fit_not_tested",
    "repeats",
    "sandwich",
    "upper_tolerance_bound",
    "with_intervals_between_poses",
    "with_intervals_of_poses",
    "with_own_intervals",
]

_MIN_INDEPENDENT = 1e-3  # of a column that the model does not explain
_TOO_SMALL = 1 - 1e-4  # a p-value above: the given noise is too large
_MOST_POSES = 8_000  # by which residuals are held against the joints


def lack_of_fit_not_tested(why: str) -> Check:
    """Return the check of a fit that nothing can test, for a reason that its phrase names."""
    return Check("lack_of_fit.nothing", "not tested", level=LACK_OF_FIT, data={"why": why})


def is_doubted(check: Check) -> bool:
    """Return True where lack of fit is sure enough to make a verdict doubtful."""
    return check.outcome == "failed" and check.p < VERDICT_LACK_OF_FIT


def goodness_of_fit(
    model: Model,
    observed: Observations,
    fit: Fit,
    *,
    sigma_given: bool,
    shape: NoiseDistribution = NoiseDistribution(),  # noqa: B008
    labels: NDArray[np.int_] | None = None,
    held_out: Observations | None = None,
    extra_residuals: ExtraResiduals | None = None,
) -> Check:
    """Test by the best means that the data allow: a given sigma, then repeats, then poses held out.

    It tests the model, with the residuals that least squares leaves, also where the estimate is another.

    Args:
        sigma_given: whether its weights stand on a known sigma.
        labels: ``(n,)`` one a configuration; rows that share one are repeats.
        extra_residuals: what else was known of the parameters when they were fitted.
    """
    linear = linearized(model, observed, fit.least_squares, fit.free, extra_residuals)
    if sigma_given:
        return _by_noise(linear, shape)
    if labels is not None and (found := _by_repeats(linear, labels)) is not None:
        return found
    by_holdout = (
        None if held_out is None else _by_holdout(linear, linearized(model, held_out, fit.least_squares, fit.free))
    )
    return _by_signs(by_holdout, _by_joints(model, observed, fit, extra_residuals))


def goodness_beside_shared_errors(linear: LinearizedFit, slopes: Array, joints: Array) -> Check:
    """Test whether residuals that shared errors explain vary with the joints' positions all the same.

    Errors that are estimated from the residuals always explain their size. But they are drawn anew at each pose, and
    what a model lacks comes back where the joints do: F of the sine and cosine of each joint's position, acting on
    that joint, under the covariance with the shared errors.

    Args:
        linear: of the fit, whitened by that covariance.
        slopes: ``(n, m, joints)`` derivatives by the joints' positions, whitened alike.
        joints: ``(n, joints)`` rad or m.
    """
    sign = _varying(linear, slopes, joints)
    if sign is None:
        return lack_of_fit_not_tested("shared errors")
    return replace(sign, name="lack_of_fit.joints", outcome="failed" if sign.outcome == "failed" else "not tested")


def _by_noise(linear: LinearizedFit, shape: NoiseDistribution) -> Check:
    """Test chi squared of the whitened residuals, of which noise of a given sigma explains one each.

    Noise that is not Gaussian has another variance of r'r: with M = I - H and excess kurtosis k it is
    2 nu + k sum M_ii^2 (Seber & Lee 2003, theorem 1.6); chi squared is scaled to have it.
    """
    within = linear.everywhere()
    if within.dof < 1:
        return lack_of_fit_not_tested("too few")
    total, nu = float((linear.residual**2).sum()), within.dof
    left = within.left()[linear.mask]
    variance = 2 * nu + shape.excess_kurtosis * float((left**2).sum())
    p = float(p_value_of_squares(total, matched_dof(nu, variance), variance=variance / (2 * nu)))
    outcome: Outcome = "failed" if p < LACK_OF_FIT else "not tested" if p > _TOO_SMALL else "passed"
    return Check("lack_of_fit.chi2", outcome, float(np.sqrt(total / nu)), p, LACK_OF_FIT, {"dof": (nu,)})


def _by_repeats(linear: LinearizedFit, labels: NDArray[np.int_]) -> Check | None:
    """F of lack of fit against pure error: scatter between configurations and within their repeats; None without.

    Residuals are compared, not points, so that readings that differ a little do not count (Draper & Smith 1998,
    section 2.1). Repeats show the noise of one setup alone.

    Args:
        labels: ``(n,)`` one a configuration (and session).
    """
    within = linear.everywhere()
    _, group = np.unique(
        np.append(labels, labels.max() + 1 + np.arange(len(linear.mask) - linear.poses)), return_inverse=True
    )
    count, total_of = np.zeros((2, group.max() + 1, linear.mask.shape[1]))  # (groups, m)
    np.add.at(count, group, linear.mask)
    np.add.at(total_of, group, linear.residual)
    mean = total_of / np.maximum(count, 1)
    scatter = np.where(linear.mask, linear.residual - mean[group], 0.0)
    pure = int(np.maximum(count - 1, 0).sum())
    lack = within.dof - pure
    if pure < 1 or lack < 1:
        return None
    error, total = float((scatter**2).sum()), float((linear.residual**2).sum())
    variance = max(error / pure, 1e-300)
    ratio = (total - error) / lack / variance
    p = float(p_value_of_squares(total - error, lack, pure, variance))
    return _lack_of_fit("lack_of_fit.repeats", float(np.sqrt(ratio)), p, (lack, pure))


def _lack_of_fit(name: str, statistic: float, p: float, dof: tuple[int, int]) -> Check:
    return Check(name, "failed" if p < LACK_OF_FIT else "passed", statistic, p, LACK_OF_FIT, {"dof": dof})


def _by_signs(by_holdout: Check | None, by_joints: Check | None) -> Check:
    """Combine the tests of held-out errors and of the joints' positions, without a given noise (Bonferroni).

    Errors at held-out poses hardly grow where the same small part of the joints' ranges was fitted; there the second
    test sees what the first one does not. Alone it shows a lack of fit that is sure, never that there is none.
    """
    signs = tuple(each for each in (by_holdout, by_joints) if each is not None)
    if not signs:
        return lack_of_fit_not_tested("too few")
    strongest = min(signs, key=lambda each: each.p)
    p, level = min(1.0, len(signs) * strongest.p), VERDICT_LACK_OF_FIT if by_holdout is None else LACK_OF_FIT
    if p < level:
        return Check(strongest.name, "failed", strongest.statistic, p, level, {"tests": (strongest,)})
    if by_holdout is None:
        return lack_of_fit_not_tested("unknown noise")
    return Check(by_holdout.name, "not tested", by_holdout.statistic, p, level, {"tests": signs})


def _by_holdout(linear: LinearizedFit, held_out: LinearizedFit) -> Check | None:
    """Test held-out errors by F against their predicted covariance sigma^2 (I + J C J') (Chow 1960).

    e' (I + J C J')^-1 e is how much the sum of squares of all poses rises above that of those fitted.
    """
    within = linear.everywhere()
    numbers = int(held_out.mask.sum())
    if within.dof < 1 or not numbers:
        return None
    moved = (held_out.jacobian * held_out.scale @ within.back).reshape(-1, within.back.shape[1])
    errors = held_out.residual.ravel()
    pull = moved.T @ errors
    rise = float(errors @ errors - pull @ np.linalg.solve(np.eye(len(pull)) + moved.T @ moved, pull))
    variance = max(float((linear.residual**2).sum()) / within.dof, 1e-300)
    p = float(p_value_of_squares(rise, numbers, within.dof, variance))
    statistic = float(np.sqrt(rise / numbers / variance))
    return _lack_of_fit("lack_of_fit.holdout", statistic, p, (numbers, within.dof))


def _by_joints(model: Model, observed: Observations, fit: Fit, extra_residuals: ExtraResiduals | None) -> Check | None:
    some = evenly(len(observed.inputs), _MOST_POSES)
    some_poses = observed if some is None else observed.take(some)
    linear = linearized(model, some_poses, fit.least_squares, fit.free, extra_residuals)
    count = some_poses.inputs.shape[1] - len(model.conditions)
    slopes = by_joint_positions(model, some_poses.inputs, fit.least_squares, count)
    return _varying(linear, linear.rows_of(some_poses, slopes), some_poses.inputs[:, :count])


def _varying(linear: LinearizedFit, slopes: Array, joints: Array) -> Check | None:
    """F of the sine and cosine of each joint's position, acting on that joint: what a model lacks comes back there.

    Args:
        slopes: ``(n, m, joints)`` derivatives by the joints' positions, whitened as the fit is.
        joints: ``(n, joints)`` rad or m.
    """
    within = linear.everywhere()
    periodic = np.concatenate([slopes * wave(joints)[:, None, :] for wave in (np.sin, np.cos)], axis=2)
    columns = np.zeros((*linear.mask.shape, periodic.shape[2]))
    columns[: len(periodic)] = periodic
    left = within.residuals(np.moveaxis(columns, 2, 0)).reshape(periodic.shape[2], -1).T
    sizes = np.linalg.norm(columns.reshape(left.shape), axis=0)
    independent = LinearModel.of(left[:, np.linalg.norm(left, axis=0) > _MIN_INDEPENDENT * sizes], _MIN_INDEPENDENT)
    dof = within.dof - independent.rank
    if independent.rank < 1 or dof < 1:
        return None
    residual = within.residuals(linear.residual)  # some of the poses have not their own least squares
    explained = float((independent.coordinates(residual.ravel()) ** 2).sum())
    variance = max((float((residual**2).sum()) - explained) / dof, 1e-300)
    p = float(p_value_of_squares(explained, independent.rank, dof, variance))
    statistic = explained / independent.rank / variance
    return _lack_of_fit("lack_of_fit.joints", statistic, p, (independent.rank, dof))


def isotropy(model: Model, observed: Observations, fit: Fit) -> Check:
    """F test of residuals across against along the line from the head, at the origin; for equal weights on x, y, z.

    With A the projection of every point on its line, and M = I - H, the sums r'A r and r'(I - A) r have the means
    tr AM and tr (I - A) M, and the log of their quotient a variance from tr (AM)^2 and its like: the test's
    degrees of freedom are those of an F with that variance (Satterthwaite 1946).
    """
    linear = linearized(model, observed, fit.values, fit.free)
    # A r: residuals along the line of sight
    within = linear.everywhere()
    shape = observed.points.shape
    distance = np.linalg.norm(observed.points, axis=2, keepdims=True)
    sight = np.nan_to_num(observed.points / np.maximum(distance, 1e-300))  # a point at the head has no line
    along = (linear.residual.reshape(shape) * sight).sum(axis=2)
    # tr AM and tr (I - A) M
    rank = within.directions.shape[1]
    taken = np.zeros((rank, rank))
    for part, basis in within.basis():
        hat = (basis.reshape(-1, *shape[1:], rank) * sight[part][..., None]).sum(axis=2).reshape(-1, rank)  # (n k, f)
        taken += hat.T @ hat
    count = int(observed.seen.sum())
    first = count - float(np.trace(taken))  # tr AM
    second = within.dof - first
    if min(first, second) < 1:
        return Check("isotropy", "not tested", level=UNSOLICITED_WARNING)
    # the variance of the log of their quotient, and the F with that variance
    along_square = count - 2 * float(np.trace(taken)) + float((taken**2).sum())  # tr (AM)^2
    mixed = first - along_square
    across_square = within.dof - along_square - 2 * mixed
    variance = along_square / first**2 + across_square / second**2 - 2 * mixed / (first * second)
    gain = (1 / first + 1 / second) / variance
    inner, total = float((along**2).sum()), float((linear.residual**2).sum())
    square = (total - inner) / second / max(inner / first, 1e-300)
    tails = f_sf(square, gain * second, gain * first), f_cdf(square, gain * second, gain * first)
    p = min(1.0, 2 * float(min(tails)))
    ratio = float(np.sqrt(square))
    return Check("isotropy", "failed" if p < UNSOLICITED_WARNING else "passed", ratio, p, UNSOLICITED_WARNING)


@dataclass(frozen=True)
class _Sandwich:
    """Return a covariance that is robust against wrong weights.

    Attributes:
        covariance: ``(f, f)`` of the free parameters (m, rad).
        dof: ``(f,)`` of Student's t for each one's interval.
    """

    covariance: Array
    dof: Array


def sandwich(linear: LinearizedFit) -> _Sandwich:
    """Covariance from each pose's own residuals, whatever their distribution is (CR2).

    V = C (sum J_i' A_i r_i r_i' A_i J_i) C, A_i = (I - H_ii)^-1/2, unbiased where the weights are right after all;
    degrees of freedom by Satterthwaite's rule (Bell & McCaffrey 2002).
    """
    within, numbers = linear.everywhere(), len(linear.scale)
    rank = within.directions.shape[1]
    meat, inner, cross = np.zeros((rank, rank)), np.zeros((numbers, rank, rank)), np.zeros(numbers)
    sums = np.zeros((2, numbers))
    for part, basis in within.basis():
        adjusted = within.root[part] @ basis  # (n, m, f) A_i Q_i
        scores = np.einsum("nmf,nm->nf", adjusted, linear.residual[part])
        meat += scores.T @ scores
        for j, row in enumerate(within.back):
            pulls = adjusted @ row  # (n, m) u_i, of which tr and tr of the square of diag(u_i'u_i) - S S' are needed
            own, shared = (pulls**2).sum(axis=1), np.einsum("nmf,nm->nf", basis, pulls)
            inner[j] += shared.T @ shared
            cross[j] += own @ (shared**2).sum(axis=1)
            sums[:, j] += own.sum(), (own**2).sum()
    means = sums[0] - np.trace(inner, axis1=1, axis2=2)
    squares = sums[1] - 2 * cross + (inner**2).sum(axis=(1, 2))
    return _Sandwich(within.back @ meat @ within.back.T, matched_dof(means, 2 * squares))


def repeats(rows: Measurements) -> NDArray[np.int_]:
    """Label repeats ``(n,)``: rows of one label differ by noise alone.

    They agree in joints, payload, approach, session, station and place; the time is passed over, or nothing would
    repeat.
    """
    further = [
        column for name, column in rows.conditions.items() if name.startswith(("payload_", "approach_", FIXTURE))
    ]
    columns = [rows.sessions, *(rows.other.get(name, rows.sessions) for name in ("station", "location", "socket"))]
    texts = list(zip(*columns, strict=True))
    kinds = {text: float(i) for i, text in enumerate(dict.fromkeys(texts))}
    group = np.array([kinds[text] for text in texts])
    return configurations(np.column_stack([rows.joints, *(np.nan_to_num(column) for column in further), group]))


_SHARE = _CONFIDENCE = 0.95
_FEWEST = 3
_READINGS = 3  # of a pose, on average, from which on it is tested whether they err together
_FOLLOWED = 1e-7  # of the largest singular value: what a pose's readings follow


def upper_tolerance_bound(lengths: Array) -> float:
    """Return the 95 %/95 % upper tolerance bound of lengths ``(n,)``; infinite of fewer than three.

    From 59 lengths on it is the smallest of them that serves, whatever their distribution is (Wilks 1941). Of fewer,
    the cube root of their squares is taken for normal (Wilson & Hilferty 1931), with the factor of a normal sample
    (Krishnamoorthy & Mathew 2009, equation 2.2.3).
    """
    count = len(lengths)
    if count < _FEWEST:
        return float("inf")
    ranks = np.arange(1, count + 1)
    serves = binomial_cdf(ranks - 1, count, _SHARE) >= _CONFIDENCE
    if serves.any():
        return float(np.sort(lengths)[int(np.argmax(serves))])
    roots = np.cbrt(lengths**2)
    factor = scipy.stats.nct.ppf(_CONFIDENCE, count - 1, normal_ppf(_SHARE) * np.sqrt(count)) / np.sqrt(count)
    return float((roots.mean() + factor * roots.std(ddof=1)) ** 1.5)


def _beside_shared_errors(
    found: Identification,
    observations: Observations,
    rows: Measurements,
    shared: ErrorModel,
    instrument: tuple[Observations, NoiseDistribution] | None = None,
) -> Check:
    """Test whether residuals vary with the joints, beside errors that are independent between poses.

    Where the instrument's noise was given, residuals above it are lack of fit, even where shared errors would explain
    them: without repeats nothing shows that these are not what the model lacks.

    Args:
        instrument: the observations weighted by the instrument alone, and the shape of its noise; None where sigma was
            estimated.
    """
    linear = linearized(found.model, observations, found.values, found.fit.free, found.extra_residuals)
    slopes = by_joint_positions(found.model, observations.inputs, found.values, rows.joints.shape[1])
    judged = goodness_beside_shared_errors(linear, linear.rows_of(observations, slopes), rows.joints)
    judged = replace(judged, data={**judged.data, "shared": shared})
    if judged.outcome == "failed" or instrument is None:
        return judged
    extra = found.extra_residuals
    alone = goodness_of_fit(
        found.model, instrument[0], found.fit, sigma_given=True, shape=instrument[1], extra_residuals=extra
    )
    if alone.outcome != "failed":
        return judged
    return replace(alone, data={**alone.data, "shared": shared})


def _by_distances(found: Identification, observations: Observations, rows: Measurements) -> Check | None:
    """Test residuals against the instrument's noise, estimated from a tool's rigid distances.

    None where there are none, or where the noise is not the same in all directions: then distances, which lie across
    the line of sight as often as not, do not determine it.
    """
    if found.sigma_given or not only_positions(observation_of(found.model)):
        return None
    instrument = instrument_noise(rows.points)
    if instrument is None or not instrument.is_rigid or instrument.sigma_m < LEAST_SIGMA_M:
        return None
    if _is_of_the_instrument(found, observations):
        return None
    return goodness_by_distances(found.residual_sigma_m**2 * found.dof, found.dof, instrument)


def with_own_intervals(
    found: Identification, observations: Observations, noise: Noise, *, searched: bool, plausible: bool
) -> tuple[Identification, list[Check]]:
    """Return the identification with the poses' own intervals, and the test of that, where directions are uneven.

    It is the instrument's only where targets of one pose show it against each other, which the arm moves as one; else
    the arm may be the cause, and the intervals are those of whole poses (cluster-robust).

    Args:
        plausible: whether the weights stand on a known sigma or on a prior.
    """
    device = noise.instrument
    if (device is not None and not is_isotropic(device)) or found.sigma_m < LEAST_SIGMA_M:
        return found, []
    seen = isotropy(found.model, observations, found.fit)
    if seen.outcome != "failed":
        return found, []
    clustered = not plausible and len(np.unique(_clusters(found, observations))) > len(found.fit.free)
    of_instrument = _is_of_the_instrument(found, observations)
    data = {"of_instrument": of_instrument, "clustered": clustered, "searched": searched}
    check = Check("intervals.uneven", "failed", seen.statistic, seen.p, UNSOLICITED_WARNING, data)
    return _of_whole_poses(found, observations) if clustered else found, [check]


def with_intervals_of_poses(
    found: Identification, observations: Observations, *, searched: bool
) -> tuple[Identification, list[Check]]:
    """Return the identification with cluster-robust intervals, and why, where what poses share is undecided."""
    if len(np.unique(_clusters(found, observations))) <= len(found.fit.free):
        return found, []
    return _of_whole_poses(found, observations), [Check("intervals.undecided", "failed", data={"searched": searched})]


def with_intervals_between_poses(
    found: Identification, observations: Observations
) -> tuple[Identification, list[Check]]:
    """Return the identification with the variance between poses, and why, where readings of one pose err together.

    Of many readings of one pose only so many combinations follow the parameters as the pose has degrees of freedom. If
    errors were independent, these would vary as the others do (F test). Where they vary more, because the joints are
    in error or a picture is, intervals are cluster-robust by pose; of fewer poses than parameters the covariance is
    scaled by the variance of the former, with their degrees of freedom, which is too small where they are uneven.
    """
    labels = _clusters(found, observations)
    count = int(labels.max(initial=-1)) + 1
    if len(labels) < _READINGS * count or found.sigma_m < LEAST_SIGMA_M:
        return found, []
    # squares of the combinations of each pose's residuals that follow the parameters
    linear = linearized(found.model, observations, found.values, found.fit.free, found.extra_residuals)
    between, combinations = 0.0, 0
    order = np.argsort(labels, kind="stable")
    for rows in np.split(order, np.flatnonzero(np.diff(labels[order])) + 1):
        seen = linear.mask[rows]
        basis, sizes, _ = np.linalg.svd(linear.jacobian[rows][seen], full_matrices=False)
        basis = basis[:, sizes > _FOLLOWED * sizes[0]]
        between += float(((basis.T @ linear.residual[rows][seen]) ** 2).sum())
        combinations += basis.shape[1]
    # F test of these against all others
    total, numbers = float((linear.residual[: linear.poses] ** 2).sum()), int(linear.mask[: linear.poses].sum())
    dof, within = combinations - len(found.fit.free), numbers - combinations
    if dof < _FEWEST or within < _FEWEST:
        return found, []
    ratio = (between / dof) / max((total - between) / within, 1e-300)
    p = float(f_sf(ratio, dof, within))
    if p >= VARIANCE_COMPONENTS:
        return found, []
    # intervals by poses, or by the variance between them where these are few
    clustered = count > len(found.fit.free)
    data = {"poses": count, "clustered": clustered}
    check = Check("intervals.between_poses", "failed", float(np.sqrt(ratio)), p, VARIANCE_COMPONENTS, data)
    if clustered:
        return _of_whole_poses(found, observations), [check]
    factor = max(between / dof / (1.0 if found.sigma_given else found.sigma_m**2), 1.0)
    return replace(found, covariance=factor * found.covariance, dof_each=np.full(len(found.fit.free), dof)), [check]


def _of_whole_poses(found: Identification, observations: Observations) -> Identification:
    """Return the identification with the covariance of each configuration's own residuals: repeats are one cluster."""
    linear = linearized(found.model, observations, found.values, found.fit.free)
    own = sandwich(linear.by_cluster(_clusters(found, observations)))
    return replace(found, covariance=own.covariance, dof_each=own.dof)


def _clusters(found: Identification, observations: Observations) -> NDArray[np.int_]:
    joints = observations.inputs.shape[1] - len(found.model.conditions)
    return configurations(observations.inputs[:, :joints])


def _is_of_the_instrument(found: Identification, observations: Observations) -> bool:
    """Test whether residuals of targets about their pose's mean differ across and along the line of sight."""
    mask = seen_mask(observations.points)
    several = mask.sum(axis=1) > 1
    if not several.any():
        return False
    residuals = np.where(
        mask[..., None], observations.points - found.model.points(observations.inputs, found.values), 0
    )
    middle = residuals.sum(axis=1, keepdims=True) / np.maximum(mask.sum(axis=1), 1)[:, None, None]
    apart = np.where(mask[..., None], residuals - middle, 0.0)[several]
    points = np.nan_to_num(observations.points[several])
    sight = points / np.maximum(np.linalg.norm(points, axis=2, keepdims=True), 1e-300)
    along = (apart * sight).sum(axis=2)
    across = float((apart**2).sum() - (along**2).sum()) / 2
    numbers = float(mask[several].sum() - several.sum())
    ratio = across / max(float((along**2).sum()), 1e-300)
    level = UNSOLICITED_WARNING / 2
    uneven = max(f_isf(level, 2 * numbers, numbers), f_isf(level, numbers, 2 * numbers))
    return max(ratio, 1 / max(ratio, 1e-300)) > float(uneven)


def adequacy_of(
    found: Identification, rows: Measurements, held_out: Measurements | None, noise: Noise, shape: NoiseDistribution
) -> Check:
    """Test whether a model fits its rows, by the best test that the data allow.

    Args:
        held_out: poses that were not fitted; None, or without rows, where there are none to test by.
    """
    observation = observation_of(found.model)
    observations, sigma_given = weigh(observation, rows, noise)
    estimated = None if noise.shared is None or noise.shared.is_given else noise.shared
    # with an independent noise that is given, a chi squared test; else by the repeats of configurations, if there are
    labels = repeats(rows) if estimated is not None or not sigma_given else None
    if labels is not None and len(np.unique(labels)) == len(labels):
        beside = _without_repeats(found, rows, observations, noise, shape, estimated)
        if beside is not None:
            return beside
    judging = held_out if held_out is not None and len(held_out) and observation.positions else None
    return goodness_of_fit(
        found.model,
        observations,
        found.fit,
        sigma_given=sigma_given and estimated is None,
        shape=shape,
        labels=labels,
        held_out=None if judging is None else weigh(observation, judging, noise)[0],
        extra_residuals=found.extra_residuals,
    )


def _without_repeats(
    found: Identification,
    rows: Measurements,
    observations: Observations,
    noise: Noise,
    shape: NoiseDistribution,
    estimated: ErrorModel | None,
) -> Check | None:
    """Test without repeats: beside estimated shared errors, else by distances between targets; None without either."""
    if estimated is None:
        return _by_distances(found, observations, rows)
    alone, sigma_given = weigh(observation_of(found.model), rows, replace(noise, shared=None))
    return _beside_shared_errors(found, observations, rows, estimated, (alone, shape) if sigma_given else None)
