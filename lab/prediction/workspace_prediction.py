"""Predict errors of a calibrated arm over regions of the workspace, and compare them with errors at validation poses.

Errors of the identified parameters are normal, with the covariance C that the fit gives: at a pose with derivatives J
the position error is normal with covariance J C J'. What the tolerances of manufacture alone would make of an arm that
was never calibrated is the same with their variances, after base and tool are fitted.

Over a region two more things count. What the fit left of the measured positions is an error of the arm at new
configurations too, the instrument's noise aside where it is given. And no covariance, however far it is extrapolated,
makes a calibrated arm worse than one within its tolerances that was never calibrated; where the calibration moved the
measured points farther than tolerances do, the arm's own tolerances are that much wider.

At validation poses the errors of the parameters, and where measured points judge those of the noise, are drawn many
times, with one draw of the parameters for all poses: so the 95 % error of these poses is known with its chance. Poses
in regions that were not measured are left out where enough others remain, as the model discrepancy there is wide.
"""

from dataclasses import dataclass, replace
from functools import cache

import numpy as np
import scipy  # its parts are loaded at their first use, which not every process comes to
from numpy.typing import NDArray

from lab.calibration.identification import Identification
from lab.calibration.observation import observation_of, only_positions
from lab.calibration.prior import Tolerance, alias_matrix, standard_deviations
from lab.calibration.row_groups import FOLDS, configurations
from lab.calibration.weights import Noise, weigh
from lab.core.checks import Check
from lab.core.errors import LabError
from lab.core.linear_model import covariance_root, matched_dof, p_value_of_squares
from lab.core.measurements import Measurements, evenly
from lab.core.probability import beta_ppf, chi2_isf, f_isf
from lab.core.random import rng_for
from lab.core.se3 import Array
from lab.core.significance import PREDICTION_EXCEEDED
from lab.kinematics.gauge import BaseSet
from lab.kinematics.model import Model
from lab.kinematics.parameter import indices_of_groups
from lab.prediction.extrapolation import MeasuredRange, model_covariances, position_covariances
from lab.prediction.regions import (
    Region,
    first_targets,
    of_first_targets,
    slopes_placed_anew,
    without_columns,
    workspace_region,
)
from lab.prediction.residual_spread import ResidualSpread
from lab.prediction.task_region import RegionKind
from lab.prediction.validation import Validation

__all__ = [
    "MEAN_OF_RMS",
    "Distance",
    "PredictedErrors",
    "RegionPrediction",
    "ValidationBounds",
    "WorkspacePrediction",
    "bounds_at",
    "check_prediction",
    "distances_from_nominal",
    "length_not_exceeded",
    "own_tolerance",
    "predict_elsewhere",
    "predict_over_region",
    "predict_over_workspace",
    "predicted_errors",
    "predicted_errors_at",
    "prediction_check",
    "tolerance_rms",
]

MEAN_OF_RMS = float(np.sqrt(8 / (3 * np.pi)))  # of the lengths of isotropic normal errors (Maxwell)
_SHARE = 0.95


@dataclass(frozen=True)
class WorkspacePrediction:
    """Predicted position errors (m) over random poses of the workspace; NaN where unknown.

    Attributes:
        rms_m: root mean square, by the parameters' covariance.
        mean_m, p95_m: the mean, and the length that 95 % of the errors do not exceed, over poses and over campaigns
            like this one; scaled by the residuals where these exceed the noise.
        tolerance_rms_m: root mean square error of an arm within the tolerances that was never calibrated.
        beyond_share: the share of the poses that are beyond the measured joint positions, where the model is known to
            be worse than its covariance; zero if unknown.
        uncovered_share: the share of the poses that no measured pose is near, where the model is known to lack
            something; zero if unknown.
    """

    rms_m: float
    mean_m: float
    p95_m: float
    tolerance_rms_m: float
    beyond_share: float = 0.0
    uncovered_share: float = 0.0


@dataclass(frozen=True)
class RegionPrediction:
    """Predicted position errors (m) over the poses of a region; NaN where unknown.

    Attributes:
        poses: how many poses stand for it.
        rms_m: root mean square, by the parameters' covariance.
        mean_m, p95_m: the mean, and the length that 95 % of the errors do not exceed, over poses and over campaigns
            like this one, with what the fit left of the measurements.
        uncalibrated_rms_m: root mean square error of an arm within its own tolerances that was never calibrated, base
            and tool fitted to the region; no error of the calibrated model is predicted above it.
        extrapolated_share: the share of the poses that are farther from the measured ones than these are from each
            other.
        lacks: whether the model is known to lack something there.
        anew: groups that are placed anew before errors are counted: the base, where nothing was observed in a frame.
    """

    kind: RegionKind
    poses: int
    rms_m: float
    mean_m: float
    p95_m: float
    uncalibrated_rms_m: float
    extrapolated_share: float = 0.0
    lacks: bool = False
    anew: tuple[str, ...] = ()


@dataclass(frozen=True)
class PredictedErrors:
    """Predicted position errors at some poses.

    Attributes:
        covariances: ``(n, k, 3, 3)`` m^2; NaN where they are not known.
        dof: degrees of freedom of their size; None where it is known.
    """

    covariances: Array
    dof: int | None

    @property
    def lengths_95(self) -> Array:
        """``(n, k)`` the length (m) that 95 % of each one's errors do not exceed (Satterthwaite 1946)."""
        mean = np.trace(self.covariances, axis1=2, axis2=3)
        numbers = matched_dof(mean, np.maximum(2 * (self.covariances**2).sum(axis=(2, 3)), 1e-300))
        if self.dof is None:
            return np.asarray(np.sqrt(mean * chi2_isf(1 - _SHARE, numbers) / numbers))
        return np.asarray(np.sqrt(mean * f_isf(1 - _SHARE, numbers, self.dof)))

    def among(self, seen: NDArray[np.bool_]) -> float:
        """Return the length (m) that 95 % of the errors of ``(n, k)`` seen ones, taken together, do not exceed."""
        return length_not_exceeded(self.covariances[seen], self.dof)


@dataclass(frozen=True)
class Distance:
    """Distance of a link's parameter from its nominal value.

    Attributes:
        size: the distance (m, or rad and then half a turn at most).
        tolerances: ``size`` in the standard deviations that the tolerances of all links give this parameter.
        sure_tolerances: ``sure`` in these.
        felt_m: root mean square error (m) of the measured points if it were nominal and the others refitted.
    """

    name: str
    size: float
    sure: float
    tolerances: float
    sure_tolerances: float
    is_angle: bool
    felt_m: float = float("inf")


def predict_over_workspace(
    identification: Identification,
    tolerance: Tolerance,
    *,
    lack_of_fit: bool = False,
    measured: MeasuredRange | None = None,
) -> WorkspacePrediction:
    """Predict the errors of the first target, or of the first of each tip, over the workspace.

    Args:
        lack_of_fit: whether the residuals are more than the noise that was given.
        measured: the joint positions that were measured, and what the model may lack beyond them.
    """
    model, nothing = identification.model, float("nan")
    if not observation_of(model).positions:
        return WorkspacePrediction(nothing, nothing, nothing, nothing)
    # the nominal arm, by the tolerances of its manufacture
    inputs, jacobian = _target_jacobian(model, identification.values)
    placed = indices_of_groups(model.parameters, ("base", "tool"))
    of_tolerances = float(np.sqrt(np.mean(tolerance_rms(model, jacobian, tolerance, placed) ** 2)))
    # the identified arm, by its covariance and by what may be lacking beyond the measured range
    squares = _stacked(model, position_covariances(identification, measured, inputs, 1 + max(first_targets(model))))
    if not np.isfinite(squares).all():
        return WorkspacePrediction(nothing, nothing, nothing, of_tolerances)
    rms = float(np.sqrt(np.trace(squares, axis1=1, axis2=2).mean()))
    dof = None if identification.sigma_given and not lack_of_fit else max(identification.dof, 1)
    # residuals beyond the given noise make it larger, unless the poses' own intervals have them
    by_noise = identification.sigma_given and identification.dof_each is None
    exceeded = identification.residual_sigma_m / identification.sigma_m if lack_of_fit and by_noise else 1.0
    mean, most = (max(exceeded, 1.0) * size for size in (MEAN_OF_RMS * rms, length_not_exceeded(squares, dof)))
    return WorkspacePrediction(rms, mean, most, of_tolerances, *_shares_beyond(identification, measured, inputs))


def _shares_beyond(
    identification: Identification, measured: MeasuredRange | None, inputs: Array
) -> tuple[float, float]:
    """Return the shares of poses beyond a joint's measured range, and of those that no fitted pose is near."""
    if measured is None or not (measured.is_worse_beyond or identification.process is not None):
        return 0.0, 0.0
    joints = inputs[:, : len(measured.lower)]
    return float((measured.beyond(joints) > 0).any(axis=1).mean()), float(measured.uncovered(joints).mean())


def predict_over_region(
    identification: Identification,
    tolerance: Tolerance,
    region: Region,
    left: ResidualSpread,
    *,
    measured: MeasuredRange | None = None,
) -> RegionPrediction:
    """Predict the errors of the first target, or of the first of each tip, over a region.

    Args:
        tolerance: the arm's own (``own_tolerance``).
        measured: the joint positions that were measured, and what the model may lack beyond them.
    """
    model, nothing = identification.model, float("nan")
    unknown = RegionPrediction(region.kind, 0, nothing, nothing, nothing, nothing)
    anew = slopes_placed_anew(identification, region.inputs)
    if anew is not None and not identification.lacks_size:
        model, jacobian, reached = anew.arm, anew.jacobian, anew.reached
        inputs = region.inputs[reached]
    elif not observation_of(model).positions:
        return unknown
    else:
        inputs, jacobian, reached = _reached(model, identification.values, region.inputs)
    if not len(inputs):
        return unknown
    # the nominal arm, and how much of the region is beyond the measured poses
    factors = None if region.factors is None else np.repeat(region.factors[reached], len(jacobian) // len(inputs))
    squares = tolerance_rms(model, jacobian, tolerance, indices_of_groups(model.parameters, ("base", "tool"))) ** 2
    known = replace(unknown, poses=len(inputs), uncalibrated_rms_m=float(np.sqrt(squares.mean())))
    if measured is not None and measured.cover is not None:
        share = float(measured.uncovered(inputs[:, : len(measured.lower)]).mean())
        lacks = measured.is_worse_beyond or identification.process is not None
        known = replace(known, extrapolated_share=share, lacks=lacks)
    # the model's errors, no larger than an arm's that was never calibrated
    if anew is None:
        of_model = _stacked(model, model_covariances(identification, measured, inputs, left))
    else:
        known, slopes = replace(known, anew=anew.groups), anew.by_free.reshape(*anew.jacobian.shape[:2], -1)
        of_model = left.widened * (slopes @ identification.covariance @ np.swapaxes(slopes, 1, 2))
    if factors is not None:
        of_model = of_model * factors[:, None, None]
    if not np.isfinite(of_model).all():
        return known
    of_model = _at_most(of_model, squares)
    # with what differs from the model
    whole = of_model + np.nan_to_num(left.of_arm_m) ** 2 * np.eye(3)  # no reading is a position: not known
    rms, everything = (float(np.sqrt(np.trace(each, axis1=1, axis2=2).mean())) for each in (of_model, whole))
    return replace(known, rms_m=rms, mean_m=MEAN_OF_RMS * everything, p95_m=length_not_exceeded(whole, left.dof))


def _at_most(covariances: Array, squares: Array) -> Array:
    """Shrink covariances ``(n, 3, 3)`` to mean squares ``(n,)`` of arms never calibrated, or to the mean of these."""
    traces = np.trace(covariances, axis1=1, axis2=2)
    most = np.maximum(squares, squares.mean())
    return np.asarray(covariances * np.minimum(1.0, most / np.maximum(traces, 1e-300))[:, None, None])


def predict_elsewhere(
    identification: Identification, tolerance: Tolerance, left: ResidualSpread, measured: MeasuredRange
) -> RegionPrediction | None:
    """Predict the errors over the rest of the workspace, which lies beyond the measured range or between its poses.

    The share is that of the workspace, hinges taken modulo a turn where the model is. None where no pose of it is
    extrapolated, or the measured poses are not known.
    """
    if measured.cover is None or not observation_of(identification.model).positions:
        return None
    model, values, size = identification.model, identification.values, len(measured.lower)
    inputs = workspace_region(model, values, np.stack([measured.lower, measured.upper]), measured.turning).inputs
    far = measured.outside(inputs[:, :size])
    if not far.any():
        return None
    found = predict_over_region(identification, tolerance, Region("workspace", inputs[far]), left, measured=measured)
    return replace(found, extrapolated_share=float(far.mean()))


def own_tolerance(identification: Identification, tolerance: Tolerance, region: Region) -> Tolerance:
    """Estimate an arm's own tolerances, at least those of manufacture.

    They are as much larger as calibration moved the first target (of each tip) over the measured region farther than
    tolerances do.
    """
    model = identification.model
    if not observation_of(model).positions:
        return tolerance
    inputs, jacobian, _ = _reached(model, identification.values, region.inputs)
    nominal, calibrated = (
        _stacked(model, model.points(inputs, values))
        for values in (identification.nominal_aligned, identification.values)
    )
    expected = tolerance_rms(model, jacobian, tolerance, indices_of_groups(model.parameters, ("base", "tool"))) ** 2
    moved = ((calibrated - nominal) ** 2).sum(axis=1)
    both = np.isfinite(moved)
    if not (both.any() and expected[both].mean() > 0):
        return tolerance
    scale = float(np.sqrt(max(moved[both].mean() / expected[both].mean(), 1.0)))
    return Tolerance(scale * tolerance.length_m, scale * tolerance.angle_rad)


def predicted_errors_at(
    identification: Identification,
    left: ResidualSpread,
    inputs: Array,
    measured: MeasuredRange | None = None,
    *,
    noise: bool = True,
    tolerance: Tolerance | None = None,
) -> PredictedErrors:
    """Predict the errors of all targets at some poses.

    Args:
        left: what the fit left of the measurements that it comes from.
        inputs: ``(n, joints + conditions)`` the poses.
        measured: the joint positions that were measured, and what the model may lack beyond them.
        noise: whether the errors are measured ones, with the noise of the instrument in them.
        tolerance: the arm's own (``own_tolerance``), beyond which no model's errors are predicted; None for no limit.
    """
    model, positions = identification.model, observation_of(identification.model).positions
    squares = model_covariances(identification, measured, inputs, left)[:, :positions]
    if tolerance is not None:
        placed, jacobian = (
            indices_of_groups(model.parameters, ("base", "tool")),
            model.observe(inputs, identification.values)[1],
        )
        for k in range(positions):
            squares[:, k] = _at_most(squares[:, k], tolerance_rms(model, jacobian[:, k], tolerance, placed) ** 2)
    return PredictedErrors(squares + (left.total_m if noise else left.of_arm_m) ** 2 * np.eye(3), left.dof)


def predicted_errors(
    identification: Identification, measured: MeasuredRange | None = None
) -> tuple[Array, Array] | None:
    """Return random poses ``(n, joints + conditions)`` and the predicted RMS error ``(n,)`` (m) at each.

    It is that of the first target (of each tip, root mean square), by the parameters' covariance and what the model may
    lack beyond the measured joint positions. None where the covariance is not known, or no position is measured.
    """
    model = identification.model
    if not observation_of(model).positions:
        return None
    inputs, _ = _target_jacobian(model, identification.values)
    whole = position_covariances(identification, measured, inputs, 1 + max(first_targets(model)))
    each = of_first_targets(model, whole)
    squares = np.trace(each, axis1=2, axis2=3).mean(axis=1)
    known = np.isfinite(squares)
    return (inputs[known], np.sqrt(np.maximum(squares[known], 0.0))) if known.any() else None


def tolerance_rms(model: Model, jacobian: Array, tolerance: Tolerance, placed: tuple[int, ...] = ()) -> Array:
    """Return the root mean square position error ``(n,)`` (m) of arms within the tolerances, at each pose.

    Args:
        jacobian: ``(n, 3, p)`` of positions.
        placed: columns that are fitted whatever the links are (base, tool); none where nothing is.
    """
    links = [i for i, each in enumerate(model.parameters) if each.is_link]
    rows = jacobian[..., links] * standard_deviations(model, tolerance)[links]
    if placed:
        rows = without_columns(rows, jacobian[..., list(placed)])
    return np.asarray(np.sqrt((rows**2).sum(axis=(1, 2))))


def distances_from_nominal(identification: Identification, tolerance: Tolerance) -> tuple[Distance, ...]:
    """Return the identified link parameters, farthest from nominal first, counted in tolerances.

    An error of a link that is fixed goes into those that it is aliased with, so their tolerances are wider.
    """
    model, structure = identification.model, identification.base_set
    free, std = list(identification.fit.free), identification.std
    spread = _spread_of_retained(model, structure, tolerance)
    felt = _felt_per_unit(identification)
    found = []
    for i, deviation, effect in zip(free, np.nan_to_num(std), felt, strict=True):
        parameter = model.parameters[i]
        if not parameter.is_link:
            continue
        size = float(identification.values[i] - identification.nominal_aligned[i])
        if parameter.is_angle:
            size = float(np.remainder(size + np.pi, 2 * np.pi) - np.pi)
        sure = max(abs(size) - 2 * float(deviation), 0.0)
        wide = spread[structure.identifiable.index(i)]
        far = abs(size) / wide, sure / wide
        found.append(Distance(parameter.name, abs(size), sure, *far, parameter.is_angle, abs(size) * float(effect)))
    return tuple(sorted(found, key=lambda each: -each.tolerances))


def _felt_per_unit(identification: Identification) -> Array:
    """Root mean square error (m) of the points ``(f,)`` by a unit of each free parameter, the others refitted.

    It is one over the parameter's standard deviation, where the noise is one and the points are as many as there are.
    """
    found = identification
    numbers = max(found.dof + len(found.fit.free), 1)
    sigma = found.sigma_m if found.sigma_given else 1.0
    unit = np.sqrt(np.maximum(np.diag(found.fit.unit_covariance()), np.finfo(float).tiny))
    return np.asarray(np.sqrt(3 / numbers) * sigma / unit)


def _spread_of_retained(model: Model, structure: BaseSet, tolerance: Tolerance) -> Array:
    sigma = standard_deviations(model, tolerance)
    drawn = np.isfinite(sigma)
    wide = alias_matrix(structure, len(model.names))[:, drawn] * sigma[drawn]
    return np.asarray(np.maximum(np.sqrt((wide**2).sum(axis=1)), np.finfo(float).tiny))


def _target_jacobian(model: Model, values: Array) -> tuple[Array, Array]:
    """Random poses of the workspace, and derivatives ``(n t, 3, p)`` of the first target (of each of t tips) there."""
    inputs, jacobian, _ = _reached(model, values, workspace_region(model, values).inputs)
    return inputs, jacobian


def _reached(model: Model, values: Array, inputs: Array) -> tuple[Array, Array, NDArray[np.bool_]]:
    """Return the poses that the arm takes, derivatives ``(n t, 3, p)`` of the first target of each tip, and a mask."""
    jacobian = of_first_targets(model, model.observe(inputs, values)[1])
    reached = np.asarray(np.isfinite(jacobian).all(axis=(1, 2, 3)))
    return inputs[reached], jacobian[reached].reshape(-1, *jacobian.shape[2:]), reached


def _stacked(model: Model, each: Array) -> Array:
    """Return what ``(n, k, ...)`` holds of the first target of each of t tips, ``(n t, ...)``."""
    first = of_first_targets(model, each)
    return first.reshape(-1, *first.shape[2:])


def length_not_exceeded(squares: Array, dof: float | None, share: float = _SHARE) -> float:
    """Return the length below which 95 % of normal errors with covariances ``(n, d, d)`` lie, taken together.

    Or another ``share`` of them. A sum of squares of correlated normal numbers is taken for a scaled chi squared
    (Satterthwaite 1946), an F where the variance was estimated with ``dof`` degrees of freedom.
    """
    mean = np.trace(squares, axis1=1, axis2=2)
    if not mean.max() > 0:
        return 0.0
    mean = np.maximum(mean, 1e-12 * mean.max())
    numbers = matched_dof(mean, np.maximum(2 * (squares**2).sum(axis=(1, 2)), 1e-300))

    # the logarithm of the exceeded share bends little along the length: a secant needs few steps
    @cache  # the bracket's ends are tried twice
    def exceeded(length: float) -> float:
        chances = p_value_of_squares(length**2 * np.ones_like(mean), numbers, dof, mean / numbers)
        return float(np.log(max(chances.mean(), 1e-300) / (1 - share)))

    # bracket the length: 95 % of three equal components lie below 1.61 of their root sum of squares, of one below 1.96
    first = low = high = 1.5 * float(np.sqrt(mean.mean()))
    if exceeded(first) > 0:
        while exceeded(high) > 0:
            low, high = high, 1.4 * high
    else:
        while low > 1e-12 * first and exceeded(low) <= 0:
            low, high = low / 1.4, low
    return float(scipy.optimize.brentq(exceeded, low, high, xtol=1e-9 * high))


@dataclass(frozen=True)
class ValidationBounds:
    """Predicted and observed errors at the validation poses, the noise of the measurements in both.

    Attributes:
        predicted_95_m: the length that 95 % of these errors are predicted not to exceed.
        observed_95_m: the length that 95 % of them do not exceed.
        inside_share: the share of the errors that are below their own pose's predicted 95 % length.
        inside_low, inside_high: its 95 % interval, with poses as clusters.
        extrapolated_share: of the poses, that no fitted pose is near.
    """

    predicted_95_m: float
    observed_95_m: float
    inside_share: float
    inside_low: float
    inside_high: float
    extrapolated_share: float


def bounds_at(
    found: Identification,
    left: ResidualSpread,
    validation: Validation,
    measured: MeasuredRange | None,
    tolerance: Tolerance,
) -> ValidationBounds | None:
    """Compare predictions and errors at the validation poses; None where no pose has both.

    Args:
        measured: the joint positions that were measured, and what the model may lack beyond them.
    """
    rows, errors, positions = validation.rows, validation.errors, observation_of(found.model).positions
    if rows is None or errors is None or not positions or not np.isfinite(left.total_m):
        return None
    try:
        inputs = rows.inputs(found.model.conditions)
    except LabError:  # exact points of a virtual arm have no measured orientation
        return None
    # the errors beside the predicted ones
    lengths = errors.after[:, :positions]
    noise = validation.judged_by != "fresh"
    predicted = predicted_errors_at(found, left, inputs, measured, noise=noise, tolerance=tolerance)
    both = np.isfinite(lengths) & np.isfinite(predicted.lengths_95)
    if not both.any():
        return None
    # the share inside, with its interval by poses (Clopper & Pearson 1934)
    inside = (lengths <= predicted.lengths_95)[both]
    clusters = len(np.unique(configurations(rows.joints[both.any(axis=1)])))
    share = float(inside.mean())
    low, high = (
        float(beta_ppf(chance, share * clusters + more, (1 - share) * clusters + 1 - more))
        for chance, more in ((0.025, 0), (0.975, 1))
    )
    return ValidationBounds(
        predicted.among(both),
        float(np.quantile(lengths[both], 0.95)),
        share,
        low if share > 0 else 0.0,
        high if share < 1 else 1.0,
        0.0 if measured is None else float(measured.uncovered(rows.joints).mean()),
    )


_DRAWS = 999
_MAX_COMPARED = 300
_PERCENT = 95.0  # percent
_ROUNDING_M = 1e-7  # errors below are those of the arithmetic
_LEAST_POSES = 10  # in the measured region: of fewer, those beyond it are compared too


def prediction_check(
    observed_p95_m: float, predicted_p95_m: float, allowed_p95_m: float, extrapolated: int = 0
) -> Check:
    """Return the check of the 95 % error (m) at poses that were not fitted: failed where it exceeds what is allowed.

    Args:
        predicted_p95_m: the median of what was predicted for these poses.
        allowed_p95_m: what chance exceeds in 1 % of campaigns like this one.
        extrapolated: poses beyond the measured region that were left out.
    """
    return Check(
        "accuracy.prediction",
        "failed" if observed_p95_m > allowed_p95_m + _ROUNDING_M else "passed",
        observed_p95_m / max(allowed_p95_m, _ROUNDING_M),
        level=PREDICTION_EXCEEDED,
        data={
            "observed_p95_m": observed_p95_m,
            "predicted_p95_m": predicted_p95_m,
            "allowed_p95_m": allowed_p95_m,
            "extrapolated": extrapolated,
        },
    )


def check_prediction(
    identification: Identification,
    validation: Validation,
    noise: Noise,
    measured: MeasuredRange | None = None,
    *,
    seed: int = 0,
) -> Check | None:
    """Compare observed and predicted 95 % errors; None where there is nothing to compare.

    Args:
        validation: errors of points at poses whose rows are known.
        noise: of the measurements that judge, with the errors that they share.
    """
    rows, errors = validation.rows, validation.errors
    if rows is None or errors is None or not only_positions(observation_of(identification.model)):
        return None
    after = errors.after
    if after.shape != rows.points.shape[:2] or validation.fitted_share > 0:
        return None
    compared = _rows_in_measured_region(measured, rows)
    extrapolated = len(rows) - len(compared)
    if (some := evenly(len(compared), _MAX_COMPARED)) is not None:
        compared = compared[some]
    rows, after = rows[compared], after[compared]
    seen = np.isfinite(after)
    if not seen.any() or not np.isfinite(identification.covariance).all():
        return None
    # draw the 95 % error of as many poses, by the covariance and the noise
    rng = rng_for(seed, "bootstrap")
    inflation = FOLDS / (FOLDS - 1) if validation.judged_by == "cross-validation" else 1.0
    scale = _sigma_ratio(identification, rng)
    drawn = _errors_of_parameters(identification, measured, rows, rng)
    drawn *= np.sqrt(inflation)  # in place: arrays of all draws are large
    if validation.judged_by != "fresh":
        drawn += _errors_of_noise(identification, noise, rows, rng)
    drawn *= scale
    lengths = np.linalg.norm(drawn, axis=2)[seen]  # (points, draws)
    p95 = np.percentile(lengths, _PERCENT, axis=0)
    return prediction_check(
        float(np.percentile(after[seen], _PERCENT)),
        float(np.median(p95)),
        float(np.quantile(p95, 1 - PREDICTION_EXCEEDED)),
        extrapolated,
    )


def _rows_in_measured_region(measured: MeasuredRange | None, rows: Measurements) -> NDArray[np.int_]:
    """Return the rows in the measured region; all where the model is not worse beyond, or too few are in it."""
    every = np.arange(len(rows))
    if measured is None or not measured.is_worse_beyond:
        return every
    inside = np.flatnonzero(~measured.outside(rows.joints))
    return inside if len(inside) >= _LEAST_POSES else every


def _errors_of_parameters(
    found: Identification, measured: MeasuredRange | None, rows: Measurements, rng: np.random.Generator
) -> Array:
    inputs = rows.inputs(found.model.conditions)
    n, k = rows.points.shape[:2]
    if found.process is not None:
        root = covariance_root(found.process.covariance(inputs))
        return np.asarray((root @ rng.standard_normal((len(root), _DRAWS))).reshape(n, k, 3, _DRAWS))
    slopes = found.model.observe(inputs, found.values)[1][..., list(found.fit.free)]
    drawn = slopes @ (covariance_root(found.covariance) @ rng.standard_normal((slopes.shape[-1], _DRAWS)))
    if measured is not None and measured.is_worse_beyond:
        unknown = measured.unknown(found.model, inputs, found.values)
        drawn = drawn + unknown @ rng.standard_normal((unknown.shape[-1], _DRAWS))
    return np.asarray(drawn)


def _errors_of_noise(found: Identification, noise: Noise, rows: Measurements, rng: np.random.Generator) -> Array:
    observed, known = weigh(observation_of(found.model), rows, noise)
    drawn = np.zeros((*observed.points.shape, _DRAWS))
    white = rng.standard_normal((3 * int(observed.seen.sum()), _DRAWS))
    drawn[observed.seen] = observed.in_metres(white).reshape(-1, 3, _DRAWS)
    if known:
        return drawn
    drawn *= found.sigma_m if noise.shared is None else noise.shared.sigma_m
    return drawn


def _sigma_ratio(found: Identification, rng: np.random.Generator) -> Array:
    """Draw the true over the estimated standard deviation ``(draws,)``: one where it was given."""
    if found.sigma_given:
        return np.ones(_DRAWS)
    dof = max(found.dof, 1)
    return np.asarray(np.sqrt(dof / np.maximum(rng.chisquare(dof, _DRAWS), 1e-300)))
