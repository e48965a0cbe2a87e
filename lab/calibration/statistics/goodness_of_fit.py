"""Whether a model says all there is in the measurements, and by what that can be told.

A known sigma, repeats of one configuration, or poses held out are each something to hold the residuals against;
the fit's own residuals are not. What is said comes with the test that says it.
"""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from lab.calibration.gauss_newton import ExtraResiduals, Fit, Observations
from lab.calibration.statistics.joint_rounding import by_joint_positions
from lab.calibration.statistics.linearized import LinearizedFit, NoiseDistribution, linearized
from lab.core.linear_model import LinearModel, matched_dof, p_value_of_squares
from lab.core.measurements import evenly
from lab.core.probabilities import f_cdf, f_sf
from lab.core.se3 import Array
from lab.core.significance import LACK_OF_FIT, UNSOLICITED_WARNING, VERDICT_LACK_OF_FIT
from lab.kinematics.model import Model

__all__ = [
    "NOT_TESTED",
    "By",
    "GoodnessOfFit",
    "Isotropy",
    "Sandwich",
    "goodness_beside_shared_errors",
    "goodness_of_fit",
    "isotropy",
    "sandwich",
]

_TOLD = 1e-3  # of a column that the model does not say already
_TOO_SMALL = 1 - 1e-4  # a p-value that says that the given noise is too large
_MOST_POSES = 8_000  # by which residuals are held against the joints

By = Literal["chi2", "repeats", "holdout", "joints", "distances", "nothing"]


@dataclass(frozen=True)
class GoodnessOfFit:
    """Whether the model fits what was measured, as far as the noise allows to see.

    Attributes:
        adequate: None where it cannot be said.
        p: the chance of residuals as large as these if it were; NaN if nothing tells.
        by: chi squared against a known sigma, F against repeats, F of held-out errors, F of what varies with the
            joints' positions, or F against distances between targets.
        words: a sentence for the report, with its figures.
    """

    adequate: bool | None
    p: float
    by: By
    words: str

    @property
    def is_doubted(self) -> bool:
        """Whether lack of fit is sure enough to make a verdict doubtful."""
        return self.adequate is False and self.p < VERDICT_LACK_OF_FIT


NOT_TESTED = GoodnessOfFit(
    None,
    float("nan"),
    "nothing",
    "lack of fit is not tested: the group residual follows what was measured; errors at other poses judge it",
)


def goodness_of_fit(
    model: Model,
    observed: Observations,
    fit: Fit,
    *,
    known: bool,
    shape: NoiseDistribution = NoiseDistribution(),  # noqa: B008
    labels: NDArray[np.int_] | None = None,
    held: Observations | None = None,
    extra_residuals: ExtraResiduals | None = None,
) -> GoodnessOfFit:
    """The best test that there is something for: a known sigma, then repeats, then poses held out.

    It tests the model, with the residuals that least squares leaves, also where the estimate is another.

    Args:
        observed: what was fitted, weighted as it was.
        known: whether its weights stand on a known sigma.
        shape: of the noise.
        labels: ``(n,)`` one a configuration; rows that share one are repeats.
        held: poses that were not fitted.
        extra_residuals: what else was known of the parameters when they were fitted.
    """
    linear = linearized(model, observed, fit.least_squares, fit.free, extra_residuals)
    if known:
        return _by_noise(linear, shape)
    if labels is not None and (found := _by_repeats(linear, labels)).by != "nothing":
        return found
    by_holdout = None if held is None else _by_holdout(linear, linearized(model, held, fit.least_squares, fit.free))
    return _by_signs(by_holdout, _by_joints(model, observed, fit, extra_residuals))


def goodness_beside_shared_errors(linear: LinearizedFit, slopes: Array, joints: Array, shared: str) -> GoodnessOfFit:
    """Whether residuals that shared errors explain vary with the joints' positions all the same.

    Errors that are estimated from the residuals always explain their size. But they are drawn anew at each pose, and
    what a model lacks comes back where the joints do: F of the sine and cosine of each joint's position, acting on
    that joint, under the covariance with the shared errors.

    Args:
        linear: of the fit, whitened by that covariance.
        slopes: ``(n, m, joints)`` derivatives by the joints' positions, whitened alike.
        joints: ``(n, joints)`` rad or m.
        shared: what they are, for a person.
    """
    sign = _varying(linear, slopes, joints)
    if sign is None:
        return GoodnessOfFit(None, float("nan"), "nothing", f"{shared}: lack of fit cannot be tested beside that")
    if sign.p < LACK_OF_FIT:
        return GoodnessOfFit(False, sign.p, sign.by, f"lack of fit: beside errors at random ({shared}) {sign.seen}")
    words = f"{shared}: {sign.not_seen}; only repeats could show that nothing is lacking"
    return GoodnessOfFit(None, sign.p, sign.by, words)


def _by_noise(linear: LinearizedFit, shape: NoiseDistribution) -> GoodnessOfFit:
    """Chi squared of the whitened residuals, of which noise of a known sigma explains one each.

    Noise that is not Gaussian has another variance of r'r: with M = I - H and excess kurtosis k it is
    2 nu + k sum M_ii^2 (Seber & Lee 2003, theorem 1.6); chi squared is scaled to have it.
    """
    within = linear.everywhere()
    if within.dof < 1:
        return _nothing_left()
    total, nu = float((linear.residual**2).sum()), within.dof
    left = within.left()[linear.mask]
    variance = 2 * nu + shape.excess_kurtosis * float((left**2).sum())
    p = float(p_value_of_squares(total, matched_dof(nu, variance), variance=variance / (2 * nu)))
    ratio = np.sqrt(total / nu)
    test = f"(chi2 test, {nu} degrees of freedom, p = {p:.2g})"
    if p < LACK_OF_FIT:
        return GoodnessOfFit(False, p, "chi2", f"lack of fit: the residuals are {ratio:.3g} times the noise {test}")
    if p > _TOO_SMALL:
        words = f"the residuals are only {ratio:.2g} times the noise, which is given too large to test the fit {test}"
        return GoodnessOfFit(None, p, "chi2", words)
    return GoodnessOfFit(
        True, p, "chi2", f"no lack of fit detected: the residuals are consistent with the instrument's noise {test}"
    )


def _by_repeats(linear: LinearizedFit, labels: NDArray[np.int_]) -> GoodnessOfFit:
    """F of lack of fit against pure error: scatter between configurations and within their repeats.

    Residuals are compared, not points, so that readings that differ a little do not count (Draper & Smith 1998,
    section 2.1). Repeats tell of the noise of one setup alone.

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
        return _nothing_left()
    error, total = float((scatter**2).sum()), float((linear.residual**2).sum())
    variance = max(error / pure, 1e-300)
    ratio = (total - error) / lack / variance
    p = float(p_value_of_squares(total - error, lack, pure, variance))
    test = f"(F test of lack of fit, {lack} and {pure} degrees of freedom, p = {p:.2g})"
    if p < LACK_OF_FIT:
        words = f"lack of fit: the residuals are {np.sqrt(ratio):.3g} times the repeatability {test}"
        return GoodnessOfFit(False, p, "repeats", words)
    return GoodnessOfFit(
        True, p, "repeats", f"no lack of fit detected: the residuals are consistent with the repeatability {test}"
    )


@dataclass(frozen=True)
class _Sign:
    """What lack of fit would show in where the noise is not known: a test, and what it says in words."""

    p: float
    by: By
    seen: str
    not_seen: str


def _by_signs(by_holdout: _Sign | None, by_joints: _Sign | None) -> GoodnessOfFit:
    """What held-out errors and the joints' positions say, where nothing is known of the noise (Bonferroni).

    Errors at held-out poses hardly grow where the same small part of the joints' ranges was fitted; there the second
    test sees what the first one does not. Alone it shows a lack of fit that is sure, never that there is none.
    """
    signs = [each for each in (by_holdout, by_joints) if each is not None]
    if not signs:
        return _nothing_left()
    strongest = min(signs, key=lambda each: each.p)
    p = min(1.0, len(signs) * strongest.p)
    if p < (VERDICT_LACK_OF_FIT if by_holdout is None else LACK_OF_FIT):
        return GoodnessOfFit(False, p, strongest.by, f"lack of fit: {strongest.seen}")
    if by_holdout is None:
        why = "sigma is estimated from the same residuals; give --instrument or --noise-mm, or measure some poses twice"
        return GoodnessOfFit(None, float("nan"), "nothing", f"lack of fit cannot be tested: {why}")
    words = " and ".join(each.not_seen for each in signs)
    why = "only a known sigma or repeats could show that noise is all that is left"
    return GoodnessOfFit(None, p, by_holdout.by, f"{words}; {why}")


def _by_holdout(linear: LinearizedFit, held: LinearizedFit) -> _Sign | None:
    """F of held-out errors against what the fit says they are: sigma^2 (I + J C J') (Chow 1960).

    e' (I + J C J')^-1 e is how much the sum of squares of all poses rises above that of those fitted.
    """
    within = linear.everywhere()
    numbers = int(held.mask.sum())
    if within.dof < 1 or not numbers:
        return None
    moved = (held.jacobian * held.scale @ within.back).reshape(-1, within.back.shape[1])
    errors = held.residual.ravel()
    pull = moved.T @ errors
    rise = float(errors @ errors - pull @ np.linalg.solve(np.eye(len(pull)) + moved.T @ moved, pull))
    variance = max(float((linear.residual**2).sum()) / within.dof, 1e-300)
    ratio = np.sqrt(rise / numbers / variance)
    p = float(p_value_of_squares(rise, numbers, within.dof, variance))
    test = f"(F test of held-out errors, {numbers} and {within.dof} degrees of freedom, p = {p:.2g})"
    errors_words = "the errors at held-out poses are"
    return _Sign(
        p,
        "holdout",
        f"{errors_words} {ratio:.3g} times their prediction {test}",
        f"{errors_words} consistent with their prediction {test}",
    )


def _by_joints(model: Model, observed: Observations, fit: Fit, extra_residuals: ExtraResiduals | None) -> _Sign | None:
    """Whether a fit's residuals vary with the joints; of very many poses some are looked at, evenly spaced."""
    some = evenly(len(observed.inputs), _MOST_POSES)
    looked_at = observed if some is None else observed.take(some)
    linear = linearized(model, looked_at, fit.least_squares, fit.free, extra_residuals)
    count = looked_at.inputs.shape[1] - len(model.conditions)
    slopes = by_joint_positions(model, looked_at.inputs, fit.least_squares, count)
    return _varying(linear, linear.rows_of(looked_at, slopes), looked_at.inputs[:, :count])


def _varying(linear: LinearizedFit, slopes: Array, joints: Array) -> _Sign | None:
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
    told = LinearModel.of(left[:, np.linalg.norm(left, axis=0) > _TOLD * sizes], _TOLD)
    dof = within.dof - told.rank
    if told.rank < 1 or dof < 1:
        return None
    residual = within.residuals(linear.residual)  # some of the poses have not their own least squares
    explained = float((told.coordinates(residual.ravel()) ** 2).sum())
    variance = max((float((residual**2).sum()) - explained) / dof, 1e-300)
    p = float(p_value_of_squares(explained, told.rank, dof, variance))
    test = f"(F test of each joint's sine and cosine, {told.rank} and {dof} degrees of freedom, p = {p:.2g})"
    return _Sign(
        p, "joints", f"the residuals vary with the joints {test}", f"what is left does not vary with the joints {test}"
    )


@dataclass(frozen=True)
class Isotropy:
    """Whether residuals along the line of sight and across it have one variance.

    Attributes:
        ratio: standard deviation of a number across over that along.
        words: a warning where they do not, else empty.
    """

    ratio: float
    p: float
    words: str


def isotropy(model: Model, observed: Observations, fit: Fit) -> Isotropy:
    """F test of residuals across against along the line from the head, at the origin; for equal weights on x, y, z.

    With A the projection of every point on its line, and M = I - H, the sums r'A r and r'(I - A) r have the means
    tr AM and tr (I - A) M, and the log of their quotient a variance from tr (AM)^2 and its like: the test's
    degrees of freedom are those of an F with that variance (Satterthwaite 1946).
    """
    linear = linearized(model, observed, fit.values, fit.free)
    within = linear.everywhere()
    shape = observed.points.shape
    distance = np.linalg.norm(observed.points, axis=2, keepdims=True)
    sight = np.nan_to_num(observed.points / np.maximum(distance, 1e-300))  # a point at the head has no line
    along = (linear.residual.reshape(shape) * sight).sum(axis=2)
    rank = within.directions.shape[1]
    taken = np.zeros((rank, rank))
    for part, basis in within.basis():
        hat = (basis.reshape(-1, *shape[1:], rank) * sight[part][..., None]).sum(axis=2).reshape(-1, rank)  # (n k, f)
        taken += hat.T @ hat
    count = int(observed.seen.sum())
    first = count - float(np.trace(taken))  # tr AM
    second = within.dof - first
    if min(first, second) < 1:
        return Isotropy(float("nan"), float("nan"), "")
    own = count - 2 * float(np.trace(taken)) + float((taken**2).sum())  # tr (AM)^2
    shared = first - own
    other = within.dof - own - 2 * shared
    variance = own / first**2 + other / second**2 - 2 * shared / (first * second)
    gain = (1 / first + 1 / second) / variance
    inner, total = float((along**2).sum()), float((linear.residual**2).sum())
    square = (total - inner) / second / max(inner / first, 1e-300)
    tails = f_sf(square, gain * second, gain * first), f_cdf(square, gain * second, gain * first)
    p = min(1.0, 2 * float(min(tails)))
    ratio = float(np.sqrt(square))
    if p >= UNSOLICITED_WARNING:
        return Isotropy(ratio, p, "")
    words = (
        f"residuals across the line of sight are {ratio:.2g} times those along it (F test, p = {p:.1g}): the noise is "
        "not isotropic, so neither intervals nor the level of the outliers' test are right; say whose with --instrument"
    )
    return Isotropy(ratio, p, words)


@dataclass(frozen=True)
class Sandwich:
    """A covariance that does not believe the weights.

    Attributes:
        covariance: ``(f, f)`` of the free parameters (m, rad).
        dof: ``(f,)`` of Student's t for each one's interval.
    """

    covariance: Array
    dof: Array


def sandwich(linear: LinearizedFit) -> Sandwich:
    """Covariance from each pose's own residuals, whatever their distribution is (CR2).

    V = C (sum J_i' A_i r_i r_i' A_i J_i) C, A_i = (I - H_ii)^-1/2, unbiased where the weights are right after all;
    degrees of freedom by Satterthwaite's rule (Bell & McCaffrey 2002).
    """
    within, numbers = linear.everywhere(), len(linear.scale)
    rank = within.directions.shape[1]
    meat, inner, cross = np.zeros((rank, rank)), np.zeros((numbers, rank, rank)), np.zeros(numbers)
    sums = np.zeros((2, numbers))
    for part, basis in within.basis():
        bent = within.root[part] @ basis  # (n, m, f) A_i Q_i
        scores = np.einsum("nmf,nm->nf", bent, linear.residual[part])
        meat += scores.T @ scores
        for j, row in enumerate(within.back):
            pulls = bent @ row  # (n, m) u_i, of which tr and tr of the square of diag(u_i'u_i) - S S' are asked for
            own, shared = (pulls**2).sum(axis=1), np.einsum("nmf,nm->nf", basis, pulls)
            inner[j] += shared.T @ shared
            cross[j] += own @ (shared**2).sum(axis=1)
            sums[:, j] += own.sum(), (own**2).sum()
    means = sums[0] - np.trace(inner, axis1=1, axis2=2)
    squares = sums[1] - 2 * cross + (inner**2).sum(axis=(1, 2))
    return Sandwich(within.back @ meat @ within.back.T, matched_dof(means, 2 * squares))


def _nothing_left() -> GoodnessOfFit:
    why = "the measurements are no more than the parameters need; measure more poses"
    return GoodnessOfFit(None, float("nan"), "nothing", f"lack of fit cannot be tested: {why}")
