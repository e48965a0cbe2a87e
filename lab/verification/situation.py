"""Find the cause of large errors in a verification: another setup or tool, another arm, another unit.

The errors of a calibrated arm are a small part of a millimetre. Errors of many millimetres are mostly no change of the
arm: base, tool or both were set up anew, the file is of another arm, or its numbers are in another unit or frame. Each
is tried by trimmed least squares (``other_numbers``), and named where it brings the errors back to what the run
predicts.
"""

from collections.abc import Sequence

import numpy as np

from lab.calibration.gauss_newton import Observations
from lab.core.checks import Check
from lab.core.se3 import Array
from lab.verdict.other_numbers import PLACED, in_other_numbers, trimmed_error
from lab.verification.predicted_points import CalibrationPrediction

__all__ = ["another_unit", "situation"]

_LARGE_M = 2e-3  # errors that are no change of an arm in use
_LARGE = 10.0  # times the predicted errors
_NORMAL = 3.0  # times the predicted errors: as predicted
_ALIEN = 5.0  # times the predicted errors, which no new base and tool bring down
_LIKE_NOMINAL = 0.25  # of the nominal model's errors: a calibration of this arm leaves far less
_MOST_POSES = 200


def situation(
    prediction: CalibrationPrediction,
    observed: Observations,
    values: Array,
    expected_m: float,
    refit: Sequence[str],
) -> Check | None:
    """Return the check that names the cause of large errors; None where they are small, or nothing explains them.

    Args:
        values: ``(p,)`` the arm's, with what was fitted anew.
        expected_m: root mean square error that the run predicts.
    """
    arm, some = prediction.arm, observed.thinned(_MOST_POSES)

    def left(groups: Sequence[str], start: Array = values) -> float:
        return trimmed_error(arm, some.inputs, some.points, start, groups)

    if left(()) <= max(_LARGE_M, _LARGE * expected_m):
        return None
    # another base, another tool, or both
    for kind, groups in (("setup", {"base"}), ("tool", {"tool"}), ("setup_and_tool", set(PLACED))):
        placed = groups | set(refit)
        named = tuple(group for group in PLACED if group in placed)
        if placed != set(refit) and (left_m := left(named)) <= _NORMAL * expected_m:
            return Check(f"situation.{kind}", "failed", data={"refit": named, "left_m": left_m})
    # another unit, or another arm
    if check := in_other_numbers(arm, arm.rigid.chain.prismatic, some.inputs, some.points, values):
        return check
    left_m = left(PLACED)
    by_nominal = left(PLACED, arm.nominal({target: np.zeros(3) for target in arm.targets}))
    if not np.isfinite(left_m) or left_m < max(_ALIEN * expected_m, _LIKE_NOMINAL * by_nominal):
        return None
    return Check("situation.another_arm", "failed", data={"left_m": left_m, "by_nominal_m": by_nominal})


def another_unit(prediction: CalibrationPrediction, observed: Observations) -> Check | None:
    """Return the unit in which measured points, or joint positions, are those of the arm; None if there is none."""
    arm, some = prediction.arm, observed.thinned(_MOST_POSES)
    return in_other_numbers(arm, arm.rigid.chain.prismatic, some.inputs, some.points, prediction.values)
