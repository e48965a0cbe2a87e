"""Record a motion for rerun: the robot on the timeline ``time``, the tool's path, and the joints over time."""

from pathlib import Path

import numpy as np
import rerun as rr
import rerun.blueprint as rrb
from numpy.typing import NDArray

from lab.core.units import MM
from lab.extensions.robotics.trajectory.path_errors import Tracking, bent_links
from lab.extensions.robotics.trajectory.trajectory_result import TrajectoryResult
from lab.kinematics.dynamics.gravity import link_loads
from lab.library.result import joint_values
from lab.report.recording import (
    Times,
    draw_legs,
    draw_shells,
    eye_on_arm,
    identity_of,
    layout,
    log_texts,
    magnified_view,
    main_view,
    recording_to,
    text_tabs,
)
from lab.report.scene import drawn_rows, magnification, moved, skeleton, world_legs
from lab.report.style import RGB_CURRENT, RGB_LINKS, RGB_PATH, RGB_ROD
from lab.report.view import document_of
from lab.simulation.meshes import arm_shells, body_poses

__all__ = ["record_trajectory"]

_MAGNIFIED = 0.15  # of the reach: the largest deflection as drawn


def record_trajectory(path: Path, result: TrajectoryResult) -> None:
    """Write the recording of ``lab trajectory``, with the blueprint that shows it."""
    arm, model, sampled = result.robot.arm(("p1",)), result.robot.model, result.sampled
    values = arm.nominal({"p1": result.options.tool_m})
    rows = drawn_rows(len(sampled.times))
    joints = sampled.joints[rows]
    at: Times = [rr.TimeColumn("time", duration=sampled.times[rows])]
    identity = identity_of(result.robot.sha256, sampled.joints, sampled.times)
    with recording_to(path, result.robot.name, identity) as recording:
        origins = moved(model.T_world_frame0, skeleton(arm, values, joints).origins)
        reach = float(np.linalg.norm(origins - origins[:, :1], axis=2).max())
        draw_shells(recording, at, arm_shells(model), body_poses(model, arm, values, joints))
        draw_legs(recording, at, world_legs(model.T_world_frame0, arm, values, joints), reach)
        tool = moved(model.T_world_frame0, sampled.Ts_base_tool[:, :3, 3])
        recording.log("world/path", rr.LineStrips3D([tool], colors=RGB_PATH, radii=0.002 * reach), static=True)
        factor = _draw_bent_links(recording, at, result, rows, reach)
        every: Times = [rr.TimeColumn("time", duration=sampled.times)]
        columns = joint_values(arm.chain.prismatic, sampled.joints).T
        for i, (name, column) in enumerate(zip(arm.chain.joint_names, columns, strict=True)):
            recording.send_columns(f"joints/{name}", every, rr.Scalars.columns(scalars=column))
            lines = rr.SeriesLines(names=name, widths=1.5, colors=RGB_LINKS[i % len(RGB_LINKS)])
            recording.log(f"joints/{name}", lines, static=True)
        curves = [rrb.TimeSeriesView(origin="joints", name="Joints, ° or mm")]
        if result.tracking is not None:
            curves.append(rrb.TimeSeriesView(origin="errors", name="Errors of the tool, mm"))
            _draw_errors(recording, every, result.tracking)
        log_texts(recording, document_of(result))
        views = [main_view("Robot and path", eye_on_arm(origins, tool, reach))]
        if factor is not None:
            views.append(magnified_view(f"Links: rigid in grey, deflection x {factor:g}", origins, reach))
        text = text_tabs()
        recording.send_blueprint(layout(rrb.Vertical(*views), rrb.Vertical(text, *curves), "time"))


def _draw_errors(recording: rr.RecordingStream, at: Times, found: Tracking) -> None:
    for i, (name, error) in enumerate({"in all": found.total, **found.parts}.items()):
        entity = f"errors/{name.replace(' ', '_')}"
        lengths = MM.of(np.linalg.norm(error[:, :3], axis=1))
        recording.send_columns(entity, at, rr.Scalars.columns(scalars=lengths))
        colour = RGB_LINKS[(i - 1) % len(RGB_LINKS)] if i else RGB_CURRENT
        recording.log(entity, rr.SeriesLines(names=name, widths=1.5, colors=colour), static=True)


def _draw_bent_links(
    recording: rr.RecordingStream, at: Times, result: TrajectoryResult, rows: NDArray[np.int_], reach: float
) -> float | None:
    """Draw the links of a compliant arm as lines: rigid in grey, and deflected, magnified, each in its own colour.

    Returns:
        The magnification; None for a rigid arm, for which nothing is drawn.
    """
    found, loads = result.tracking, result.robot.loads
    if found is None or loads is None:
        return None
    bent = sum((part for name, part in found.parts.items() if name != "geometry"), np.zeros_like(found.total))
    largest = float(np.linalg.norm(bent[:, :3], axis=1).max())
    if not largest > 0:
        return None
    factor = magnification(largest, _MAGNIFIED * reach)
    links, joints = link_loads(loads), result.sampled.joints[rows]
    sag, torsors = found.standing[rows] - joints, {link: each[rows] for link, each in found.torsors.items()}
    for name, scale, size in (("rigid", 0.0, 0.002), ("bent", factor, 0.005)):
        for link, lines in bent_links(links, joints, sag, torsors, scale).items():
            entity = f"world/magnified/{name}/link{link + 1}"
            colour = RGB_LINKS[link % len(RGB_LINKS)] if scale else RGB_ROD
            style = rr.LineStrips3D.from_fields(colors=[colour], radii=[size * reach])
            recording.log(entity, style, static=True)
            placed = moved(result.robot.T_world_frame0, lines)
            recording.send_columns(entity, at, rr.LineStrips3D.columns(strips=list(placed)))
    return factor
