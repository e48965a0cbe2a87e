"""Workspaces as a rerun recording: robots side by side, each within the boundary of what it reaches, cut open."""

import hashlib
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from lab.core.se3 import Array
from lab.extensions.robotics.workspace.result import RobotWorkspace, WorkspaceResult
from lab.render.recording import draw_shells, layout, log_texts, main_view, recording_to, text_tabs
from lab.render.scene import moved, world_legs
from lab.render.style import RGB_CURRENT, RGB_LEG, RGB_MAPPING, RGB_PATH, RGB_ROD
from lab.render.surfaces import halved
from lab.simulation.meshes import arm_shells, body_poses

if TYPE_CHECKING:
    import trimesh

__all__ = ["record_workspaces"]

_APART = 1.15  # widths between robots that stand side by side


def record_workspaces(path: Path, result: WorkspaceResult) -> None:
    """Write the recording of ``lab workspace``, with the blueprint that shows it."""
    digest = hashlib.sha256(result.sha256.encode() + b"".join(mesh.vertices.tobytes() for mesh in result.meshes))
    widths = [float(np.ptp(each.space.domain.extents[0])) for each in result.robots]
    size = max(float(np.ptp(each.space.domain.extents, axis=1).max()) for each in result.robots)
    starts = np.append(0.0, np.cumsum([_APART * max(width, 0.3 * size) for width in widths]))
    with recording_to(path, result.robots[0].robot.name, digest.hexdigest()[:32]) as recording:
        log_texts(recording, result.document())
        ends = []
        for i, (each, mesh) in enumerate(zip(result.robots, result.meshes, strict=True)):
            shift = np.array([starts[i], 0.0, 0.0])
            _draw(recording, f"world/robot{i + 1}", each, mesh, shift, size)
            ends.append(moved(each.robot.model.T_world_frame0, each.space.domain.extents.T) + shift)
        corners = np.concatenate(ends)
        middle, wide = corners.mean(axis=0), float(np.ptp(corners, axis=0).max())
        controls = rrb.EyeControls3D(
            kind=rrb.Eye3DKind.Orbital, position=middle + wide * np.array([0.25, -1.25, 0.5]),
            look_target=middle, eye_up=(0.0, 0.0, 1.0),
        )  # fmt: skip
        view = main_view("What is reached, cut open at y = 0", controls)
        text = text_tabs()
        recording.send_blueprint(layout(rrb.Vertical(view), rrb.Vertical(text), "pose"))


def _draw(
    recording: rr.RecordingStream, under: str, each: RobotWorkspace, mesh: "trimesh.Trimesh", shift: Array, size: float
) -> None:
    """Draw one robot at its nominal position, its boundary, its sections' edges and its name."""
    robot, arm = each.robot, each.space.arm
    model, joints = robot.model, arm.chain.home[None]
    T = model.T_world_frame0
    recording.log(under, rr.Transform3D(translation=shift), static=True)
    draw_shells(recording, [], arm_shells(model), body_poses(model, arm, each.space.values, joints), f"{under}/arm")
    legs = world_legs(T, arm, each.space.values, joints)
    if legs.measured:
        colours = [RGB_LEG if measured else RGB_ROD for measured in legs.measured]
        strips = rr.LineStrips3D(list(legs.ends[0]), colors=colours, radii=0.004 * size)
        recording.log(f"{under}/rods_and_legs", strips, static=True)
    half = halved(mesh)
    if len(half.faces):
        drawn = rr.Mesh3D(
            vertex_positions=moved(T, np.asarray(half.vertices)), triangle_indices=half.faces,
            vertex_normals=np.asarray(half.vertex_normals) @ T[:3, :3].T, albedo_factor=(*RGB_MAPPING, 110),
        )  # fmt: skip
        recording.log(f"{under}/boundary", drawn, static=True)
    for k, section in enumerate(each.sections):
        places = np.full((len(section.vertices), 3), section.level_m)
        places[:, section.axes] = section.vertices
        lines = list(moved(T, places)[section.segments])
        recording.log(
            f"{under}/section{k + 1}", rr.LineStrips3D(lines, colors=RGB_PATH, radii=0.002 * size), static=True
        )
    above = moved(T, np.array([[0.0, 0.0, each.space.domain.extents[2, 1] + 0.08 * size]]))
    tag = rr.Points3D(above, labels=[robot.name], colors=RGB_CURRENT, radii=0.0005, show_labels=True)
    recording.log(f"{under}/name", tag, static=True)
