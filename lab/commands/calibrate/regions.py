"""The regions of a run over which errors are predicted, and how the predictions meet the validation's errors."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from lab.calibration.extrapolation import MeasuredRange
from lab.calibration.gauss_newton import Observations
from lab.calibration.identify import Identification
from lab.calibration.observation import observation_of
from lab.calibration.prior import Tolerance
from lab.calibration.regions import Region, measured_region, region_of_points, workspace_region
from lab.calibration.residual_spread import ResidualSpread, for_later_rows
from lab.calibration.validation import Validation, configurations, rows_in_time
from lab.calibration.weights import weighed
from lab.calibration.workspace_prediction import RegionPrediction, predicted_errors_at
from lab.campaign.task_region import task_region
from lab.commands.calibrate.fit import Fitter
from lab.commands.calibrate.fit_result import FitReport
from lab.commands.values import number
from lab.core.errors import LabError
from lab.core.probabilities import beta_ppf

__all__ = ["ValidationBounds", "bounds_at", "region_to_dict", "regions_of", "spread_of_later"]


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

    def to_dict(self) -> dict[str, Any]:
        """What ``result.json`` holds. Lengths in mm."""
        return {
            "predicted_95_mm": number(1e3 * self.predicted_95_m),
            "observed_95_mm": number(1e3 * self.observed_95_m),
            "inside_share": self.inside_share,
            "inside_low": self.inside_low,
            "inside_high": self.inside_high,
            "extrapolated_share": self.extrapolated_share,
        }


def spread_of_later(fitter: Fitter, fit: FitReport, uncalibrated_m: float) -> ResidualSpread:
    """Return what the fit leaves of rows that are measured later, no more than of an arm that was never calibrated."""
    observed, most_m = _weighed_rows(fitter, fit), uncalibrated_m / np.sqrt(3)
    return for_later_rows(fit.residual_spread, fit.identification, observed, rows_in_time(fit.rows), most_m)


def _weighed_rows(fitter: Fitter, fit: FitReport) -> Observations:
    """Return the fitted rows, weighted as they were."""
    noise = fitter.knowing(fit.noise.shared).noise
    return weighed(observation_of(fit.identification.model), fit.rows, noise)[0]


def regions_of(fitter: Fitter, fit: FitReport, option: str) -> tuple[Region, Region]:
    """Return poses like the measured ones, and those of the region that an option names.

    Args:
        option: ``--region``.

    Raises:
        LabError: its file cannot be read, or the arm reaches none of its points.
    """
    found, chain = fit.identification, fitter.robot.chain
    model, values = found.model, found.values
    inputs = fit.rows.inputs(model.conditions)
    turning = ~np.array(chain.prismatic, dtype=np.bool_)
    poses = measured_region(found, _weighed_rows(fitter, fit), turning)
    named = task_region(option)
    if named.kind == "measured":
        return poses, poses
    if named.kind == "workspace":
        return poses, workspace_region(model, values, fit.rows.joints, turning)
    arm = fitter.robot.arm(fitter.targets)
    T_instrument_frame0 = arm.T_tracker_frame0(values[: len(arm.names)])
    points = named.points(T_instrument_frame0, chain.joint_names, chain.prismatic)
    return poses, region_of_points(
        named.kind, points, model=model, values=values, inputs=inputs, joints=chain, name=f"--region {option}"
    )


def bounds_at(
    found: Identification,
    left: ResidualSpread,
    validation: Validation,
    measured: MeasuredRange | None,
    tolerance: Tolerance,
) -> ValidationBounds | None:
    """Compare predictions and errors at the validation poses; None where no pose has both.

    Args:
        left: what the fit left of the measurements.
        measured: the joint positions that were measured, and what the model may lack beyond them.
        tolerance: the arm's own.
    """
    rows, errors, positions = validation.rows, validation.errors, observation_of(found.model).positions
    if rows is None or errors is None or not positions or not np.isfinite(left.total_m):
        return None
    try:
        inputs = rows.inputs(found.model.conditions)
    except LabError:  # exact points of a virtual arm have no measured orientation
        return None
    lengths = errors.after[:, :positions]
    noise = validation.judged_by != "fresh"
    predicted = predicted_errors_at(found, left, inputs, measured, noise=noise, tolerance=tolerance)
    both = np.isfinite(lengths) & np.isfinite(predicted.lengths_95)
    if not both.any():
        return None
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


def region_to_dict(found: RegionPrediction | None) -> dict[str, Any] | None:
    """Return a prediction as ``result.json`` holds it, lengths in mm; None where there is none."""
    if found is None:
        return None
    return {
        "region": found.kind,
        "poses": found.poses,
        "rms_mm": number(1e3 * found.rms_m),
        "mean_mm": number(1e3 * found.mean_m),
        "p95_mm": number(1e3 * found.p95_m),
        "uncalibrated_rms_mm": number(1e3 * found.uncalibrated_rms_m),
        "extrapolated_share": found.extrapolated_share,
    }
