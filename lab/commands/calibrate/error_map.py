"""Where a calibration's errors and its arm are in the world, for the pictures of its report.

The world is the model's where there is one; for a robot given as a table it is frame 0.
"""

from dataclasses import dataclass, replace

import numpy as np

from lab.calibration.observation import observation_of
from lab.calibration.stations import in_first_frame
from lab.calibration.validation import Errors, JudgedBy, errors_of
from lab.commands.calibrate.result import CalibrationResult
from lab.commands.calibrate.scene import world_of
from lab.core.measurements import Measurements, rows_called
from lab.core.se3 import Array, transform
from lab.render.plots import SizeMap, spread_by_size
from lab.render.scene import moved
from lab.render.skeleton import skeleton

__all__ = ["ArmPoses", "ErrorMap", "arm_poses", "error_maps"]

_MOST_ARMS = 12  # drawn in a picture
_WHICH: dict[JudgedBy, str] = {
    "fresh": "the validation poses, without noise",
    "holdout": "the poses of the hold-out set",
    "cross-validation": "the poses of the cross-validation, each by the fit without it",
    "file": "the poses of the validation file",
}
_FITTED = "the fitted poses, with the residuals of the fit"


@dataclass(frozen=True)
class ErrorMap:
    """Errors where they are.

    Attributes:
        sizes: the errors that are drawn: before calibration and after it, by one scale.
        which: the poses that they are of, in words.
        all_shown: whether they are all drawn.
    """

    sizes: tuple[SizeMap, SizeMap]
    which: str
    all_shown: bool


@dataclass(frozen=True)
class ArmPoses:
    """The arm at some of its fitted poses, in the world.

    Attributes:
        first: the id of the first of them: it stretches farthest along x, so that it is seen from both sides.
        strips: lines ``(m, c, 3)`` m, along the chain or each leg.
        joints: ``(m, f, 3)`` m, the frames on them.
        tips: ``(m, k, 3)`` m, the targets at these poses.
        points: ``(q, 3)`` m: targets at all fitted poses, as measured where they are.
        measured: whether they are.
        head: ``(3,)`` m, the instrument; None where nothing is measured in its frame.
    """

    first: str
    strips: tuple[Array, ...]
    joints: Array
    tips: Array
    points: Array
    measured: bool
    head: Array | None


def error_maps(result: CalibrationResult, error: str) -> ErrorMap | None:
    """The errors of the validation, or the residuals where its poses' places are not known; None where there are none.

    Args:
        error: what the errors are.
    """
    data, errors, which = _validated(result)
    points = _predicted(result, data)
    count = min(points.shape[1], errors.after.shape[1])  # the orientation of a measured pose has errors of its own
    points = points[:, :count].reshape(-1, 3)
    before, after = (each[:, :count].reshape(-1) for each in (errors.before, errors.after))
    known = np.flatnonzero(np.isfinite(after) & np.isfinite(before))
    if not len(known):
        return None
    rows = known[spread_by_size(after[known])]
    outliers = rows_called(result.measurements, [pose.id for pose in result.fit.outliers])
    crosses = _predicted(result, result.measurements.take(outliers)).reshape(-1, 3) if outliers else np.empty((0, 3))
    both = np.concatenate([before[rows], after[rows]])
    largest = max(float(np.percentile(both, 99)), 1e-12)
    scale = max(float(np.percentile(both, 1)), 1e-5 * largest), 1.001 * largest
    shown = SizeMap(points[rows], after[rows], f"{error} after calibration", crosses, range_m=scale, from_one_side=True)
    earlier = f"{error} before calibration"
    no_crosses = np.empty((0, 3))
    start = replace(shown, sizes=before[rows], size_means=earlier, crosses=no_crosses, name="before", with_scale=False)
    return ErrorMap((start, shown), which, len(rows) == len(known))


def _validated(result: CalibrationResult) -> tuple[Measurements, Errors, str]:
    """Poses, the errors ``(n, things)`` there, and which poses they are."""
    validation = result.validation
    rows, errors, judged_by = validation.rows, validation.errors, validation.judged_by
    if rows is not None and errors is not None and judged_by is not None:
        return rows, errors, _WHICH[judged_by]
    return result.fitted, errors_of(result.identification, result.fitted), _FITTED


def _predicted(result: CalibrationResult, data: Measurements) -> Array:
    """Targets ``(n, k, 3)`` in the world, of the calibrated geometry."""
    arm, values = result.rigid(result.identification.values)
    return moved(world_of(result), arm.points(data.joints, values))


def arm_poses(result: CalibrationResult) -> ArmPoses:
    """The calibrated arm at up to twelve of its fitted poses, evenly spaced, with the points of all of them."""
    fitted, identification = result.fitted, result.identification
    rows = np.unique(np.round(np.linspace(0, len(fitted) - 1, _MOST_ARMS)).astype(np.int_))
    arm, values = result.rigid(identification.values)
    T_world_frame0 = result.robot.model.T_world_frame0
    shown = skeleton(arm, values, fitted.joints[rows])
    lines = [moved(T_world_frame0, line) for line in shown.lines]
    joints = moved(T_world_frame0, shown.frames)
    tips = _predicted(result, fitted.take(rows))
    first = int(np.argmax(np.abs(joints[:, -1, 0] - joints[:, 0, 0])))
    order = [first, *(i for i in range(len(rows)) if i != first)]
    shape = fitted.ids[rows[first]], tuple(line[order] for line in lines), joints[order], tips[order]
    positions = observation_of(identification.model).positions
    if not positions:
        return ArmPoses(*shape, _predicted(result, fitted).reshape(-1, 3), measured=False, head=None)
    T_world_instrument = world_of(result)
    model, inputs = identification.model, fitted.inputs(identification.model.conditions)
    points = in_first_frame(model, identification.values, inputs, fitted.points[:, :positions]).reshape(-1, 3)
    points = points[np.isfinite(points).all(axis=1)]
    return ArmPoses(*shape, transform(T_world_instrument, points), True, T_world_instrument[:3, 3])
