"""Rerun recordings of ``lab payload`` and ``lab dynamics``: the arm, its payload, and its torques or wrench.

What moves is on the timeline ``time`` (of static poses on ``pose``).
"""

import hashlib
from pathlib import Path

import numpy as np
import rerun as rr
import rerun.blueprint as rrb
from numpy.typing import NDArray

from lab.campaign.robot import Robot
from lab.core import se3
from lab.core.se3 import Array
from lab.extensions.dynamics.arm.result import DynamicsResult
from lab.extensions.dynamics.payload.estimate import equivalent_ellipsoid
from lab.extensions.dynamics.payload.result import PayloadResult, channels_of
from lab.render.recording import Times, draw_shells, eye_on_arm, layout, log_texts, main_view, recording_to, text_tabs
from lab.render.scene import drawn_rows, moved, skeleton
from lab.render.style import RGB_MUTED, RGB_PAYLOAD, RGB_WEIGHT
from lab.simulation.meshes import arm_shells, body_poses

__all__ = ["record_dynamics", "record_payload"]

_MOST_DRAWN = 300  # rows of a run
_WEIGHT_M_PER_N = 0.01


def record_dynamics(path: Path, result: DynamicsResult) -> None:
    """Write the recording of ``lab dynamics``, with the blueprint that shows it."""
    assert result.samples is not None and result.samples.time_s is not None and result.estimate is not None
    run = result.samples.run(bool(result.samples.loaded.all()))
    assert run.time_s is not None
    rows = drawn_rows(len(run))
    joints, at = run.joints[rows], _times(run.time_s[rows], len(rows))
    identity = _identity(result.robot, run.joints, np.nan_to_num(result.estimate.values))
    with recording_to(path, result.robot.name, identity) as recording:
        _draw_arm(recording, at, result.robot, joints)
        _draw_torques(recording, result)
        log_texts(recording, result.document())
        curves = [rrb.TimeSeriesView(origin=f"torques/{name}", name=name) for name in result.robot.chain.joint_names]
        recording.send_blueprint(_blueprint(result.robot, "The arm on its path", joints, curves, "time"))


def _draw_torques(recording: rr.RecordingStream, result: DynamicsResult) -> None:
    """Draw each drive's torque in the first run, decimated: measured and fitted."""
    found = result.estimate
    assert found is not None
    later = np.flatnonzero(np.diff(found.time_s) <= 0)
    first = slice(0, int(later[0]) + 1 if later.size else None)
    at: Times = [rr.TimeColumn("time", duration=found.time_s[first])]
    explained = found.measured - found.residual
    for j, name in enumerate(result.robot.chain.joint_names):
        for kind, torques, colour in (("measured", found.measured, RGB_MUTED), ("explained", explained, RGB_PAYLOAD)):
            _draw_curve(recording, at, f"torques/{name}/{kind}", torques[first, j], kind, colour)


def record_payload(path: Path, result: PayloadResult) -> None:
    """Write the recording of ``lab payload``, with the blueprint that shows it."""
    samples, found = result.samples, result.estimate
    assert samples is not None
    loaded = samples.run(True)
    shown = loaded.take(np.unique(np.linspace(0, len(loaded) - 1, _MOST_DRAWN).round().astype(int)))
    at = _times(shown.time_s, len(shown))
    curves = [
        rrb.TimeSeriesView(origin=f"channels/{name}", name=f"{name}, {unit}", plot_legend=rrb.PlotLegend(visible=False))
        for name, unit in channels_of(result)
    ]
    identity = _identity(result.robot, samples.joints, samples.loaded, found.phi)
    with recording_to(path, result.robot.name, identity) as recording:
        timeline = "pose" if shown.time_s is None else "time"
        recording.send_blueprint(_blueprint(result.robot, "Arm and load", shown.joints, curves, timeline))
        _draw_arm(recording, at, result.robot, shown.joints)
        if np.isfinite(found.com_m).all():
            _draw_load(recording, at, result, shown.joints)
        _draw_channels(recording, result)
        log_texts(recording, result.document())


def _draw_load(recording: rr.RecordingStream, at: Times, result: PayloadResult, joints: Array) -> None:
    """Draw the load as the solid ellipsoid that has its mass and inertia, and its weight as an arrow."""
    found, robot = result.estimate, result.robot
    arm = robot.serial_arm(("p1",))
    Ts = robot.model.T_world_frame0 @ arm.flange(joints, arm.nominal(robot.tool))
    half, axes = equivalent_ellipsoid(found.mass_kg, found.inertia_com_kgm2)
    centres = se3.transform(Ts, found.com_m[None])[:, 0]
    rotations = se3.quaternion_from_rotation(Ts[:, :3, :3] @ axes)[:, [1, 2, 3, 0]]
    ellipsoids = rr.Ellipsoids3D.columns(half_sizes=np.tile(half, (len(Ts), 1)), centers=centres, quaternions=rotations)
    recording.send_columns("world/load", at, ellipsoids)
    recording.log("world/load", rr.Ellipsoids3D.from_fields(colors=RGB_PAYLOAD, fill_mode="Solid"), static=True)
    down = robot.model.T_world_frame0[:3, :3] @ result.mounting.gravity
    weight = np.tile(_WEIGHT_M_PER_N * found.mass_kg * down, (len(Ts), 1))
    recording.send_columns("world/weight", at, rr.Arrows3D.columns(origins=centres, vectors=weight))
    recording.log("world/weight", rr.Arrows3D.from_fields(colors=RGB_WEIGHT, radii=0.004), static=True)


def _draw_channels(recording: rr.RecordingStream, result: PayloadResult) -> None:
    """Draw torques, or the wrench, with the load and without it."""
    assert result.samples is not None
    for kind, loaded, colour in (("loaded", True, RGB_PAYLOAD), ("unloaded", False, RGB_MUTED)):
        part = result.samples.run(loaded)
        if not len(part):
            continue
        part = part.take(np.unique(np.linspace(0, len(part) - 1, 4 * _MOST_DRAWN).round().astype(int)))
        at = _times(None if part.time_s is None else part.time_s - part.time_s[0], len(part))
        measured = part.wrench if result.estimate.method.startswith("wrench") else part.torques
        assert measured is not None
        for (name, _), values in zip(channels_of(result), measured.T, strict=True):
            _draw_curve(recording, at, f"channels/{name}/{kind}", values, kind, colour)


def _times(time_s: Array | None, count: int) -> Times:
    if time_s is None:
        return [rr.TimeColumn("pose", sequence=np.arange(count))]
    return [rr.TimeColumn("time", duration=time_s)]


def _identity(robot: Robot, *arrays: Array | NDArray[np.bool_]) -> str:
    """Return a hash of the content, so that one file always gives one recording."""
    digest = hashlib.sha256(robot.sha256.encode())
    for array in arrays:
        digest.update(np.ascontiguousarray(array).tobytes())
    return digest.hexdigest()[:32]


def _draw_arm(recording: rr.RecordingStream, at: Times, robot: Robot, joints: Array) -> None:
    arm = robot.serial_arm(("p1",))
    draw_shells(recording, at, arm_shells(robot.model), body_poses(robot.model, arm, arm.nominal(robot.tool), joints))


def _draw_curve(
    recording: rr.RecordingStream, at: Times, entity: str, values: Array, name: str, colour: tuple[int, int, int]
) -> None:
    recording.send_columns(entity, at, rr.Scalars.columns(scalars=values))
    recording.log(entity, rr.SeriesLines(colors=colour, names=name, widths=1.5), static=True)


def _blueprint(
    robot: Robot, title: str, joints: Array, curves: list[rrb.TimeSeriesView], timeline: str
) -> rrb.Blueprint:
    """Lay out the arm large, the curves beside it, and the summary above these."""
    arm = robot.serial_arm(("p1",))
    origins = moved(robot.model.T_world_frame0, skeleton(arm, arm.nominal(robot.tool), joints).origins)
    reach = float(np.linalg.norm(origins - origins[:, :1], axis=2).max())
    view = main_view(title, eye_on_arm(origins, origins[:, -1], reach))
    text = text_tabs()
    right = rrb.Vertical(text, rrb.Grid(*curves, grid_columns=2), row_shares=[1, 1.6])
    return layout(rrb.Vertical(view), right, timeline)
