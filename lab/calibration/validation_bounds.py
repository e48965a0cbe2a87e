"""Compare predicted errors with those at the validation poses."""

from dataclasses import dataclass

import numpy as np

from lab.calibration.extrapolation import MeasuredRange
from lab.calibration.identify import Identification
from lab.calibration.observation import observation_of
from lab.calibration.prior import Tolerance
from lab.calibration.residual_spread import ResidualSpread
from lab.calibration.validation import Validation, configurations
from lab.calibration.workspace_prediction import predicted_errors_at
from lab.core.errors import LabError
from lab.core.probabilities import beta_ppf

__all__ = ["ValidationBounds", "bounds_at"]


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
