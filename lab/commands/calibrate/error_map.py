"""Where a campaign's errors and its arm are in the world, for the pictures of its report.

The world is the model's where there is one; for a robot given as a table it is frame 0.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lab.calibration.observations.protocol import observation_of
from lab.calibration.validation import errors_of
from lab.campaign.options import VirtualCampaign
from lab.campaign.virtual_robot import asked_conditions, fresh_poses
from lab.commands.calibrate.options import MeasuredCampaign
from lab.commands.calibrate.result import rigid
from lab.commands.calibrate.run import CalibrationResult
from lab.commands.calibrate.scene import world_of
from lab.core.measurements import Measurements
from lab.core.se3 import Array, transform
from lab.render.scene import moved
from lab.render.skeleton import joint_places, strips

MOST_POINTS = 400  # drawn in a picture
MOST_ARMS = 12


@dataclass(frozen=True)
class ErrorMap:
    """Where lengths (errors, corrections) are.

    Attributes:
        points: ``(m, 3)`` m.
        sizes: ``(m,)`` m.
        off: ``(o, 3)`` m, marked beside them.
        words: which poses these are.
        size_means, off_means: what the lengths and the marks are.
        frame: whose the points are.
        thinned: whether only some of the poses are here.
    """

    points: Array
    sizes: Array
    off: Array
    words: str
    size_means: str = "position error after calibration"
    off_means: str = "pose that is off"
    frame: str = "base"
    thinned: bool = False


@dataclass(frozen=True)
class ArmPlaces:
    """The arm at some of its fitted poses, in the world.

    Attributes:
        first: what the first of them is called: it stretches farthest along x, so that it is seen from both sides.
        strips: lines ``(m, c, 3)`` m, along the chain or each leg.
        joints: ``(m, f, 3)`` m, the frames on them.
        tips: ``(m, k, 3)`` m, the targets at these poses.
        points: ``(q, 3)`` m: targets at all fitted poses, as measured where they are.
        measured: whether they are.
        head: ``(3,)`` the instrument; None where nothing is measured in its frame.
    """

    first: str
    strips: tuple[Array, ...]
    joints: Array
    tips: Array
    points: Array
    measured: bool
    head: Array | None


def error_places(outcome: CalibrationResult, options: VirtualCampaign | MeasuredCampaign) -> ErrorMap:
    """The errors of the poses that were judged by; of the fitted ones where nobody wrote down where those are."""
    data, errors, words = _judged(outcome, options)
    points = _predicted(outcome, data)
    count = min(points.shape[1], errors.shape[1])  # of a measured pose the orientation is a further thing
    points, errors = points[:, :count].reshape(-1, 3), errors[:, :count].reshape(-1)
    seen = np.flatnonzero(np.isfinite(errors))
    rows = seen[thinned(errors[seen])]
    everything = outcome.measurements
    named = [everything.ids.index(pose.id) for pose in outcome.fit.outliers]
    off = _predicted(outcome, everything.take(named)).reshape(-1, 3) if named else np.empty((0, 3))
    return ErrorMap(points[rows], errors[rows], off, words, thinned=len(rows) < len(seen))


def _judged(outcome: CalibrationResult, options: VirtualCampaign | MeasuredCampaign) -> tuple[Measurements, Array, str]:
    """Poses, the errors ``(n, things)`` after calibration there, and which poses they are."""
    validation, fitted = outcome.validation, outcome.fitted
    if validation.errors is not None:
        found = validation.errors.after
        if outcome.real is not None and isinstance(options, VirtualCampaign):
            fresh = fresh_poses(outcome.real, options, asked_conditions(outcome.robot, options))
            return fresh, found, "the fresh poses, without noise"
        if validation.judged_by == "cross-validation":
            return fitted, found, "the poses of the cross-validation, each by the fit without it"
        if validation.judged_by == "holdout" and (held := _held(outcome, found)) is not None:
            return held, found, "the poses held out"
    errors = errors_of(outcome.identification, fitted).after
    return fitted, errors, "the fitted poses: what the fit leaves over there"


def _held(outcome: CalibrationResult, errors: Array) -> Measurements | None:
    """The rows that were judged by, found again among those not fitted; None where their errors are others."""
    data, left_out = outcome.measurements, outcome.fit.outliers if outcome.fit.left_out else ()
    if data.points.shape[1:] != outcome.fitted.points.shape[1:]:
        return None
    others = data.without([*outcome.fitted.ids, *(pose.id for pose in left_out)])
    others = others.take(np.flatnonzero(others.seen.any(axis=1)))
    for use in ("test", "calibrate"):
        rows = others.only(use)
        if len(rows) == len(errors) and np.allclose(
            errors_of(outcome.identification, rows).after, errors, rtol=1e-6, atol=1e-12, equal_nan=True
        ):
            return rows
    return None


def thinned(errors: Array) -> NDArray[np.int_]:
    """Rows to draw, the largest error last: evenly spaced through the errors by size where they are many."""
    order = np.argsort(errors, kind="stable")
    if len(order) <= MOST_POINTS:
        return order
    return order[np.round(np.linspace(0, len(order) - 1, MOST_POINTS)).astype(np.int_)]


def _predicted(outcome: CalibrationResult, data: Measurements) -> Array:
    """Targets ``(n, k, 3)`` in the world, of the calibrated geometry."""
    arm, values = rigid(outcome, outcome.identification.values)
    return moved(world_of(outcome), arm.points(data.joints, values))


def arm_places(outcome: CalibrationResult) -> ArmPlaces:
    """The calibrated arm at up to twelve of its fitted poses, evenly spaced, with the points of all of them."""
    fitted, identification = outcome.fitted, outcome.identification
    rows = np.unique(np.round(np.linspace(0, len(fitted) - 1, MOST_ARMS)).astype(np.int_))
    arm, values = rigid(outcome, identification.values)
    T_world_frame0 = outcome.robot.model.T_world_frame0
    lines = [moved(T_world_frame0, line) for line in strips(arm, values, fitted.joints[rows])]
    joints = moved(T_world_frame0, joint_places(arm, values, fitted.joints[rows]))
    tips = _predicted(outcome, fitted.take(rows))
    first = int(np.argmax(np.abs(joints[:, -1, 0] - joints[:, 0, 0])))
    order = [first, *(i for i in range(len(rows)) if i != first)]
    shape = fitted.ids[rows[first]], tuple(line[order] for line in lines), joints[order], tips[order]
    positions = observation_of(identification.model).positions
    if not positions:
        return ArmPlaces(*shape, _predicted(outcome, fitted).reshape(-1, 3), measured=False, head=None)
    T_world_instrument = world_of(outcome)
    points = fitted.points[:, :positions].reshape(-1, 3)
    points = points[np.isfinite(points).all(axis=1)]
    return ArmPlaces(*shape, transform(T_world_instrument, points), True, T_world_instrument[:3, 3])
