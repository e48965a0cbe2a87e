"""A motion as a rerun recording: the robot on the timeline ``time``, the tool's path, and the joints over time."""

import hashlib
from pathlib import Path

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from lab.commands.trajectory.result import TrajectoryResult
from lab.commands.values import joint_values
from lab.render.markdown import to_markdown
from lab.render.recording_layout import FAR, SUMMARY, eye, layout, main_view
from lab.render.rerun_primitives import Times, draw_legs, draw_shells, markdown, recording_to
from lab.render.scene import drawn_rows, moved, world_legs
from lab.render.skeleton import skeleton
from lab.render.style import RGB_PATH
from lab.simulation.meshes import body_poses, shells

__all__ = ["record_trajectory"]


def record_trajectory(path: Path, result: TrajectoryResult) -> None:
    """Write the recording of ``lab trajectory``, with the blueprint that shows it."""
    arm, model, sampled = result.robot.arm(("p1",)), result.robot.model, result.sampled
    values = arm.nominal({"p1": result.options.tool_m})
    rows = drawn_rows(len(sampled.times))
    joints = sampled.joints[rows]
    digest = hashlib.sha256(result.robot.sha256.encode() + sampled.joints.tobytes() + sampled.times.tobytes())
    at: Times = [rr.TimeColumn("time", duration=sampled.times[rows])]
    with recording_to(path, result.robot.name, digest.hexdigest()[:32]) as recording:
        origins = moved(model.T_world_frame0, skeleton(arm, values, joints).origins)
        reach = float(np.linalg.norm(origins - origins[:, :1], axis=2).max())
        draw_shells(recording, at, shells(model), body_poses(model, arm, values, joints))
        draw_legs(recording, at, world_legs(model.T_world_frame0, arm, values, joints), reach)
        tool = moved(model.T_world_frame0, sampled.Ts_base_tool[:, :3, 3])
        recording.log("world/path", rr.LineStrips3D([tool], colors=RGB_PATH, radii=0.002 * reach), static=True)
        every: Times = [rr.TimeColumn("time", duration=sampled.times)]
        for name, column in zip(
            arm.chain.joint_names, joint_values(arm.chain.prismatic, sampled.joints).T, strict=True
        ):
            recording.send_columns(f"joints/{name}", every, rr.Scalars.columns(scalars=column))
            recording.log(f"joints/{name}", rr.SeriesLines(names=name, widths=1.5), static=True)
        recording.log(SUMMARY, markdown(to_markdown(result.document())), static=True)
        ahead = origins[0, 0] + FAR * reach * np.array([1.0, -1.0, 0.0])
        view = main_view("Robot and path", eye(origins, tool, reach, ahead))
        curves = rrb.TimeSeriesView(origin="joints", name="Joints, ° or mm")
        text = rrb.TextDocumentView(origin=SUMMARY, name="Summary")
        recording.send_blueprint(layout(rrb.Vertical(view), rrb.Vertical(text, curves), "time"))
