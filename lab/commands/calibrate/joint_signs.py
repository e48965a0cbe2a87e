"""Whether measurements that do not fit would fit with one joint counted the other way.

A joint that a controller counts in the other direction than the nominal model need not spoil the fit: with the fifth
joint of a wrist negated, the arm whose fourth and sixth zeros are half a turn away is the same arm. So each joint is
negated in turn, and the geometry identified again from the nominal one.
"""

from dataclasses import replace

import numpy as np

from lab.calibration.identify import Identification
from lab.calibration.prior import Tolerance
from lab.calibration.workspace_prediction import distances_from_nominal
from lab.commands.calibrate.fit import Fitter
from lab.core.errors import LabError
from lab.core.measurements import Measurements, thinned
from lab.kinematics.serial.arm import SerialArm

__all__ = ["of_joint_signs"]

_MOST_ROWS = 200  # by which signs are tried
_CLEARLY = 5.0  # times as small, the residuals or the distance from the nominal model
_NO_WORSE = 1.5  # times the residuals: the same arm in another pose of its wrist fits as well
_NEAR = 100.0  # tolerances from the nominal model: beyond, it is not that robot either


def of_joint_signs(fitter: Fitter, rows: Measurements) -> list[str]:
    """That with one joint negated the geometry fits, near the nominal model, as it does not as it is; mostly nothing.

    Args:
        fitter: of a calibration that is bad.
        rows: that were fitted.
    """
    if not fitter.kind.in_instrument_frame or not isinstance(fitter.robot.arm(fitter.targets), SerialArm):
        return []
    rows = thinned(rows, _MOST_ROWS)
    tolerance, given = fitter.tolerance, _identified(fitter, rows)
    tried = []
    for j, name in enumerate(rows.joint_names):
        signs = np.where(np.arange(rows.joints.shape[1]) == j, -1.0, 1.0)
        found = _identified(fitter, replace(rows, joints=rows.joints * signs))
        if found is not None and _explains(found, given, tolerance):
            tried.append((found.residual_sigma_m, name))
    if not tried:
        return []
    sigma_m, name = min(tried)
    return [
        f"with joint {name} negated these measurements fit to {1e3 * sigma_m:.2g} mm (1σ per axis), near the nominal "
        f"model: does the controller count {name} in the other direction? Change its sign in the file, or in the model"
    ]


def _identified(fitter: Fitter, rows: Measurements) -> Identification | None:
    """The geometry from these rows; None where they do not identify it."""
    try:
        return fitter.identified_with(rows, (), ())
    except LabError:
        return None


def _explains(found: Identification, given: Identification | None, tolerance: Tolerance) -> bool:
    """Whether one fit is of the nominal robot, and the other, of the rows as they are given, is not."""
    if found.status != "converged" or not found.plausible or _tolerances(found, tolerance) > _NEAR:
        return False
    if given is None or given.status != "converged" or not given.plausible:
        return given is None or found.residual_sigma_m * _CLEARLY < given.residual_sigma_m
    if found.residual_sigma_m * _CLEARLY < given.residual_sigma_m:
        return True
    nearer = _tolerances(found, tolerance) * _CLEARLY < _tolerances(given, tolerance)
    return nearer and found.residual_sigma_m < _NO_WORSE * given.residual_sigma_m


def _tolerances(found: Identification, tolerance: Tolerance) -> float:
    """How many tolerances the link that is farthest from its nominal value is from it."""
    return max((each.tolerances for each in distances_from_nominal(found, tolerance)), default=0.0)
