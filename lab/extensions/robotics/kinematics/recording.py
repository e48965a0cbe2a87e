"""Record a robot's placements for rerun: one after the other on the timeline ``pose``, and side by side."""

import hashlib
from pathlib import Path

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from lab.core.se3 import Array
from lab.extensions.robotics.kinematics.result import MOST_DRAWN, KinematicsResult, frames_of
from lab.kinematics.model import RigidArm
from lab.render.recording import (
    Times,
    backdrop,
    draw_legs,
    draw_shells,
    eye_on_arm,
    layout,
    log_texts,
    main_view,
    recording_to,
    text_tabs,
)
from lab.render.scene import drawn_rows, moved, skeleton, world_legs
from lab.render.style import RGB_AXES, RGB_CURRENT, RGB_LEG, RGB_ROD
from lab.simulation.meshes import arm_shells, body_poses

__all__ = ["record_kinematics"]

_GALLERY = "gallery"
_APART = 1.25  # reaches between placements that stand side by side
_AXIS = 0.12  # of the reach: how long a frame's axes are


def record_kinematics(path: Path, result: KinematicsResult) -> None:
    """Write the recording of ``lab kinematics``, with the blueprint that shows it."""
    reached = [each for each in result.placements if np.isfinite(each.T_base_tool).all()]
    shown = [reached[i] for i in drawn_rows(len(reached))]
    arm, model = result.robot.arm(("p1",)), result.robot.whole.model
    values = arm.nominal({"p1": result.options.tool_m})
    joints = np.array([each.joints for each in shown]).reshape(-1, arm.chain.size)
    digest = hashlib.sha256(result.robot.sha256.encode() + joints.tobytes() + values.tobytes()).hexdigest()[:32]
    with recording_to(path, result.robot.name, digest) as recording:
        log_texts(recording, result.document())
        if not shown:
            return
        at: Times = [rr.TimeColumn("pose", sequence=np.arange(len(shown)))]
        origins = moved(model.T_world_frame0, skeleton(arm, values, joints).origins)
        reach = float(np.linalg.norm(origins - origins[:, :1], axis=2).max())
        bodies, legs = body_poses(model, arm, values, joints), world_legs(model.T_world_frame0, arm, values, joints)
        draw_shells(recording, at, arm_shells(model), bodies)
        draw_legs(recording, at, legs, reach)
        frames = model.T_world_frame0 @ frames_of(arm, values, joints)
        _draw_frames(recording, "world/frames", at, frames, _AXIS * reach)
        names = [each.name for each in shown[:MOST_DRAWN]]  # its configuration stands in the summary
        for i, name in enumerate(names):
            _draw_beside(recording, result, arm, i, name, reach, {k: T[i] for k, T in bodies.items()}, legs.ends[i])
            _draw_frames(recording, f"{_GALLERY}/placement{i + 1}/frames", [], frames[i : i + 1], _AXIS * reach)
        recording.send_blueprint(_blueprint(origins, reach, len(names)))


def _draw_beside(
    recording: rr.RecordingStream,
    result: KinematicsResult,
    arm: RigidArm,
    i: int,
    name: str,
    reach: float,
    bodies: dict[str, Array],
    legs: Array,
) -> None:
    """Draw one placement in its row of the gallery, with its name above it."""
    under = f"{_GALLERY}/placement{i + 1}"
    recording.log(under, rr.Transform3D(translation=(0.0, _APART * reach * i, 0.0)), static=True)
    draw_shells(recording, [], arm_shells(result.robot.whole.model), {k: T[None] for k, T in bodies.items()}, under)
    measured = arm.skeleton(arm.chain.home[None], arm.nominal()).measured
    if measured:
        colours = [RGB_LEG if each else RGB_ROD for each in measured]
        recording.log(
            f"{under}/rods_and_legs", rr.LineStrips3D(list(legs), colors=colours, radii=0.006 * reach), static=True
        )
    above = result.robot.whole.T_world_frame0[:3, 3] + np.array([0.0, 0.0, -0.15 * reach])
    recording.log(f"{under}/name", rr.Points3D([above], labels=[name], colors=RGB_CURRENT, radii=0.0005), static=True)


def _draw_frames(recording: rr.RecordingStream, entity: str, at: Times, Ts: Array, length: float) -> None:
    """Draw the axes of frames ``(m, f, 4, 4)``; without a timeline those of one placement."""
    count, radius = Ts.shape[1], 0.03 * length
    vectors = length * Ts[..., :3, :3].swapaxes(2, 3).reshape(-1, 3)
    origins = np.repeat(Ts[..., :3, 3].reshape(-1, 3), 3, axis=0)
    colours = np.tile(np.array(RGB_AXES, dtype=np.uint8), (count, 1))
    if not at:
        recording.log(entity, rr.Arrows3D(origins=origins, vectors=vectors, colors=colours, radii=radius), static=True)
        return
    arrows = rr.Arrows3D.columns(origins=origins, vectors=vectors).partition([3 * count] * len(Ts))
    recording.send_columns(entity, at, arrows)
    recording.log(entity, rr.Arrows3D.from_fields(colors=colours, radii=radius), static=True)


def _blueprint(origins: Array, reach: float, count: int) -> rrb.Blueprint:
    single = main_view("One after the other", eye_on_arm(origins, origins[:, -1], reach))
    beside = np.concatenate([origins[:1] + np.array([0.0, _APART * reach * i, 0.0]) for i in range(count)])
    middle = beside.reshape(-1, 3).mean(axis=0)
    controls = rrb.EyeControls3D(
        kind=rrb.Eye3DKind.Orbital, position=middle + np.array([max(2.2, 0.75 * count) * reach, 0.0, 0.8 * reach]),
        look_target=middle, eye_up=(0.0, 0.0, 1.0),
    )  # fmt: skip
    gallery = rrb.Spatial3DView(origin=_GALLERY, name="Side by side", eye_controls=controls, background=backdrop())
    text = text_tabs()
    return layout(rrb.Vertical(single, gallery), rrb.Vertical(text), "pose")
