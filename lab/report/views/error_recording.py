"""Record position errors with rerun, pose by pose: arrows of one magnification, and one closer view.

What moves is on the timelines ``pose`` and ``time``, as in ``lab.report.recording``.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import rerun as rr
import rerun.blueprint as rrb
from numpy.typing import NDArray

from lab.core import se3
from lab.core.number_text import format_magnification
from lab.core.se3 import Array
from lab.kinematics.model import RigidArm
from lab.library.compensation_result import CompensationResult
from lab.library.point_verification import VerificationResult
from lab.report import recording as rec
from lab.report.document import Bullets, Document, Section, Strong, Text
from lab.report.scene import (
    LARGEST_FACTOR,
    drawn_rows,
    error_factor,
    magnification,
    mean_lengths,
    moved,
    reach_of,
    skeleton,
    world_legs,
)
from lab.report.style import RGB_AFTER, RGB_BEFORE, RGB_MEASURED, RGB_UNCERTAINTY
from lab.report.view import document_of
from lab.report.views.verification_document import drawn_poses
from lab.simulation.meshes import arm_shells, body_poses
from lab.simulation.robot_model import RobotModel

__all__ = ["ErrorScene", "PointErrors", "record_compensation", "record_errors", "record_verification"]

_SPHERE = 0.08  # of the reach: how long the median radius is to be drawn


@dataclass(frozen=True)
class PointErrors:
    """Errors of one kind at every pose."""

    name: str  # of the kind, a word
    description: str  # what an arrow leads from and to
    colour: rec.Colour
    colour_name: str  # its colour, in words
    vectors: Array  # (m, k, 3) m in the instrument's frame, NaN where there are none


@dataclass(frozen=True)
class ErrorScene:
    """An arm that goes through poses, and what it misses points by.

    Attributes:
        arm, values: the arm's geometry, with the base ``(p,)`` that the instrument sees.
    """

    model: RobotModel  # what is drawn
    arm: RigidArm
    values: Array
    joints: Array  # (m, joints) of the poses, in their order
    names: Sequence[str]  # of the poses
    points: Array  # (m, k, 3) m in the instrument's frame: where the errors are drawn from; NaN where there is none
    points_label: str  # what these points are
    errors: Sequence[PointErrors]  # of each kind, all drawn with one magnification
    expected: Array  # (m,) m, how long an error is to be expected (RMS), drawn as a sphere in a view of its own

    @property
    def T_world_instrument(self) -> Array:
        """Pose ``(4, 4)`` of the instrument's frame in the world."""
        return self.model.T_world_frame0 @ se3.inverse(self.arm.T_tracker_frame0(self.values))

    @property
    def numbers(self) -> NDArray[np.int_]:
        """``(m,)`` the poses' numbers, from 0."""
        return np.arange(len(self.joints))


def record_errors(path: Path, robot: str, identity: str, scene: ErrorScene, document: Document) -> None:
    """Write the recording of a scene, with its blueprint and the document of its command."""
    model, arm, values, joints = scene.model, scene.arm, scene.values, scene.joints
    at, T_world_frame0 = rec.pose_times(scene.numbers), model.T_world_frame0
    legs = world_legs(T_world_frame0, arm, values, joints)
    points = moved(scene.T_world_instrument, scene.points)
    there = np.isfinite(points).all(axis=2)
    origins = moved(T_world_frame0, skeleton(arm, values, joints).origins)
    reach = max(reach_of(T_world_frame0, points[there], legs), reach_of(T_world_frame0, origins, legs))
    with rec.recording_to(path, robot, identity) as recording:
        recording.send_blueprint(_blueprint(scene, origins, points[there], reach))
        rec.draw_shells(recording, at, arm_shells(model), body_poses(model, arm, values, joints))
        rec.draw_legs(recording, at, legs, reach)
        rec.draw_frames(recording, at, model, arm, values, joints, reach)
        rec.draw_moves(recording, model, arm, values, scene.numbers, joints)
        rec.draw_instrument(recording, "instrument's frame", scene.T_world_instrument)
        _draw_points(recording, scene, points, reach)
        factor = _draw_arrows(recording, scene, points, reach)
        sphere = _draw_expected(recording, scene, points, reach)
        for each in scene.errors:
            rec.draw_error_curve(recording, scene.numbers, each.name, mean_lengths(each.vectors), each.colour)
        rec.draw_error_curve(recording, scene.numbers, "expected", scene.expected, RGB_UNCERTAINTY)
        rec.log_texts(recording, document, _legend(scene, factor, sphere))


def _draw_points(recording: rr.RecordingStream, scene: ErrorScene, points: Array, reach: float) -> None:
    there, at = np.asarray(np.isfinite(points).all(axis=2)), rec.pose_times(scene.numbers)
    every = rr.Points3D(points[there], colors=RGB_MEASURED, radii=0.004 * reach)
    recording.log("world/targets/all", every, static=True)
    rec.draw_points(recording, "world/targets/measured", at, points, RGB_MEASURED, 0.009 * reach)
    seen = np.flatnonzero(there[:, 0])
    focus = rr.Transform3D.columns(translation=points[seen, 0])
    recording.send_columns("world/focus", rec.pose_times(seen), focus)
    labels = [str(scene.names[i]) for i in seen.tolist()]
    below = points[seen, 0] - np.array([0.0, 0.0, 1.4 * _SPHERE * reach])
    names = rr.Points3D.columns(positions=below, labels=labels)
    recording.send_columns("world/magnified/name", rec.pose_times(seen), names)
    recording.log("world/magnified/name", rr.Points3D.from_fields(radii=0.0005, show_labels=True), static=True)


def _draw_arrows(recording: rr.RecordingStream, scene: ErrorScene, points: Array, reach: float) -> float:
    """The errors of all kinds, magnified by one factor, which is given back; each names itself at its tip."""
    lengths = np.concatenate([np.linalg.norm(each.vectors, axis=2).ravel() for each in scene.errors])
    factor = error_factor(lengths, reach)
    rotation = scene.T_world_instrument[:3, :3]
    for each in scene.errors:
        ends, entity = (points, each.vectors @ rotation.T), f"world/errors/{each.name}"
        rec.draw_arrows(recording, entity, scene.numbers, ends, factor, each.name, each.colour, reach)
    return factor


def _draw_expected(recording: rr.RecordingStream, scene: ErrorScene, points: Array, reach: float) -> float:
    """The error to expect as a sphere round the first point, in the close view; its magnification."""
    there = np.flatnonzero(np.isfinite(points[:, 0]).all(axis=1) & np.isfinite(scene.expected) & (scene.expected > 0))
    if not len(there):
        return 1.0
    factor = min(magnification(float(np.median(scene.expected[there])), _SPHERE * reach), LARGEST_FACTOR)
    at, radii, centers = rec.pose_times(there), factor * scene.expected[there], points[there, 0]
    shape = rr.Ellipsoids3D.columns(half_sizes=np.repeat(radii[:, None], 3, axis=1), centers=centers)
    recording.send_columns("world/magnified/expected", at, shape)
    style = rr.Ellipsoids3D.from_fields(
        colors=RGB_UNCERTAINTY, fill_mode="TransparentFillMajorWireframe", line_radii=0.0008
    )
    recording.log("world/magnified/expected", style, static=True)
    above = centers + np.array([0.0, 0.0, 1.1]) * radii[:, None]
    text = f"expected {format_magnification(factor)}"
    rec.draw_tag(recording, "world/magnified/expected/factor", at, above, text, RGB_UNCERTAINTY)
    return factor


def _legend(scene: ErrorScene, factor: float, sphere: float) -> Section:
    arrows = format_magnification(factor)
    lines: list[Text] = [(Strong("yellow"), f": {scene.points_label}")]
    lines += [(Strong(each.colour_name), f": {each.description}, {arrows}") for each in scene.errors]
    lines.append((Strong("violet"), f": the error to expect (RMS) as a sphere, {format_magnification(sphere)}"))
    return Section("What is shown", (Bullets(tuple(lines)),))


def _blueprint(scene: ErrorScene, origins: Array, points: Array, reach: float) -> rrb.Blueprint:
    """The arm large, the errors by pose below it; the target from near by and the text beside it."""
    controls = rec.eye(origins, points, reach, scene.T_world_instrument[:3, 3])
    plot = rec.error_plot()
    left = rrb.Vertical(rec.main_view("Arm, targets, errors", controls), plot, row_shares=[3, 1])
    close = rec.close_view("magnified", "The error to expect, magnified apart", reach)
    return rec.layout(left, rrb.Vertical(close, rec.text_tabs(), row_shares=[1.0, 1.5]), rec.TIME)


def record_verification(path: Path, result: VerificationResult) -> None:
    """Write the recording of ``lab verify``; of many rows an evenly spaced part."""
    calibrated, verified = result.calibrated, result.verified
    data, rigid, values, predicted = drawn_poses(result)
    colour, colour_name = (RGB_AFTER, "light blue") if verified.good else (RGB_BEFORE, "vermilion")
    text = "measured less predicted"
    scene = ErrorScene(
        calibrated.robot.model,
        rigid,
        values,
        data.joints,
        data.ids,
        predicted,
        "where the calibrated arm is predicted to have its targets",
        [PointErrors("observed", text, colour, colour_name, data.points - predicted)],
        np.full(len(data), verified.expected_m),
    )
    identity = rec.identity_of(calibrated.robot.sha256, verified.values, data.joints, data.points)
    record_errors(path, calibrated.robot.name, identity, scene, document_of(result))


def record_compensation(path: Path, result: CompensationResult) -> None:
    """Write the recording of ``lab compensate``: the stops in their order; of many an evenly spaced part.

    Only targets that are reached are among the stops; there has to be one.
    """
    run, rows = result.run, result.reached
    waypoints = drawn_rows(len(result.waypoints.joints))
    every = result.waypoints.names
    joints, names = result.waypoints.joints[waypoints], [every[i] for i in waypoints]
    which = result.waypoints.which[waypoints]
    at_target = np.flatnonzero(which >= 0)
    aimed = rows[which[at_target]]
    wanted = result.wanted.positions[aimed]
    rigid, values = run.estimate.geometry
    scene = ErrorScene(
        run.robot.model,
        rigid,
        values,
        joints,
        names,
        _at_waypoints(wanted, at_target, len(waypoints))[:, None],
        "the targets, wanted",
        [
            PointErrors(
                "uncorrected",
                "from the target to the arm's position with the nominal joint positions",
                RGB_BEFORE,
                "vermilion",
                _at_waypoints(result.uncorrected_errors[aimed], at_target, len(waypoints))[:, None],
            )
        ],
        _at_waypoints(result.predicted_m[aimed], at_target, len(waypoints)),
    )
    identity = rec.identity_of(run.robot.sha256, joints, wanted, values)
    record_errors(path, run.robot.name, identity, scene, document_of(result))


def _at_waypoints(values: Array, at_target: NDArray[np.int_], count: int) -> Array:
    """Values ``(t, …)`` of targets at their stops ``(count, …)``; NaN at those that are only passed."""
    spread = np.full((count, *values.shape[1:]), np.nan)
    spread[at_target] = values
    return spread
