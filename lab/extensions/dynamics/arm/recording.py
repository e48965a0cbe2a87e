"""An identification of an arm as a rerun recording: the arm along its path, and its torques, measured and explained."""

import hashlib
from pathlib import Path

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from lab.core.se3 import Array
from lab.extensions.dynamics.arm.result import DynamicsResult
from lab.render.markdown import to_markdown
from lab.render.recording import SUMMARY, Times, draw_shells, eye_on_arm, layout, main_view, markdown, recording_to
from lab.render.scene import drawn_rows, moved, skeleton
from lab.render.style import RGB_MUTED, RGB_PAYLOAD
from lab.simulation.meshes import arm_shells, body_poses

__all__ = ["record_dynamics"]


def record_dynamics(path: Path, result: DynamicsResult) -> None:
    """Write the recording of ``lab dynamics``, with the blueprint that shows it."""
    assert result.samples is not None and result.samples.time_s is not None
    run = result.samples.run(bool(result.samples.loaded.all()))
    assert run.time_s is not None
    rows = drawn_rows(len(run))
    joints, at = run.joints[rows], [rr.TimeColumn("time", duration=run.time_s[rows])]
    model, arm = result.robot.model, result.robot.serial_arm(("p1",))
    values = arm.nominal(result.robot.tool)
    with recording_to(path, result.robot.name, _identity(result, run.joints)) as recording:
        origins = moved(model.T_world_frame0, skeleton(arm, values, joints).origins)
        reach = float(np.linalg.norm(origins - origins[:, :1], axis=2).max())
        draw_shells(recording, at, arm_shells(model), body_poses(model, arm, values, joints))
        _torques(recording, result)
        recording.log(SUMMARY, markdown(to_markdown(result.document())), static=True)
        view = main_view("The arm on its path", eye_on_arm(origins, origins[:, -1], reach))
        curves = [rrb.TimeSeriesView(origin=f"torques/{name}", name=name) for name in arm.chain.joint_names]
        text = rrb.TextDocumentView(origin=SUMMARY, name="Summary")
        right = rrb.Vertical(text, rrb.Grid(*curves, grid_columns=2), row_shares=[1, 1.6])
        recording.send_blueprint(layout(rrb.Vertical(view), right, "time"))


def _identity(result: DynamicsResult, joints: Array) -> str:
    """An identifier made of the content, so that one file always gives one recording."""
    assert result.estimate is not None
    digest = hashlib.sha256(result.robot.sha256.encode())
    for array in (joints, np.nan_to_num(result.estimate.values)):
        digest.update(np.ascontiguousarray(array).tobytes())
    return digest.hexdigest()[:32]


def _torques(recording: rr.RecordingStream, result: DynamicsResult) -> None:
    """Draw each drive's torque in the first run, decimated: measured and fitted."""
    found = result.estimate
    assert found is not None
    later = np.flatnonzero(np.diff(found.time_s) <= 0)
    first = slice(0, int(later[0]) + 1 if later.size else None)
    at: Times = [rr.TimeColumn("time", duration=found.time_s[first])]
    explained = found.measured - found.residual
    for j, name in enumerate(result.robot.chain.joint_names):
        for kind, torques, colour in (("measured", found.measured, RGB_MUTED), ("explained", explained, RGB_PAYLOAD)):
            entity = f"torques/{name}/{kind}"
            recording.send_columns(entity, at, rr.Scalars.columns(scalars=torques[first, j]))
            recording.log(entity, rr.SeriesLines(colors=colour, names=kind, widths=1.5), static=True)
