"""Proposed poses as a rerun recording: the arm at each, what was measured, and the accuracy."""

from pathlib import Path

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from lab.core.measurements import Measurements
from lab.core.units import MICRONS
from lab.library.next_pose import NextPoseResult, proposal_text
from lab.library.pose_planner import PosePlanner, Proposal
from lab.report.recording import (
    bars,
    draw_beams,
    draw_instrument,
    draw_legs,
    draw_shells,
    eye,
    identity_of,
    layout,
    log_texts,
    main_view,
    markdown,
    recording_to,
    text_tabs,
)
from lab.report.scene import moved, reach_of, skeleton, world_legs
from lab.report.style import RGB_CURRENT, RGB_MEASURED, RGB_UNCERTAINTY
from lab.report.view import document_of
from lab.simulation.meshes import body_poses, shells

__all__ = ["record_proposals"]

_TIMELINE, _ACCURACY, _NEXT = "poses_measured", "accuracy_um", "next"


def record_proposals(path: Path, result: NextPoseResult) -> None:
    """Write the recording of the proposals, with the blueprint that shows it."""
    identity = identity_of(result.model_sha256 + repr(result.to_dict()["proposals"]))
    with recording_to(path, result.planner.problem.robot.name, identity) as recording:
        scene = _Scene(recording, result.planner)
        for proposal in result.proposals:
            scene.show(result.data, proposal)
        log_texts(recording, document_of(result))


class _Scene:
    """The arm and its instrument in a recording, to which proposals are added."""

    def __init__(self, recording: rr.RecordingStream, planner: PosePlanner) -> None:
        self._recording, self._planner = recording, planner
        self._accuracy: dict[int, float] = {}
        problem = planner.problem
        model, values, pose = problem.robot.model, problem.values, problem.access.hubs[:1]
        points = moved(model.T_world_tracker, problem.arm.points(problem.candidates.joints[:200], values))
        points = points[np.isfinite(points).all(axis=(1, 2))]
        origins = moved(model.T_world_frame0, skeleton(problem.arm, values, pose).origins)
        self._reach = reach_of(
            model.T_world_frame0, points, world_legs(model.T_world_frame0, problem.arm, values, pose)
        )
        controls = eye(origins, points.reshape(-1, 3), self._reach, model.T_world_tracker[:3, 3])
        texts = rrb.Vertical(
            rrb.TextDocumentView(origin=_NEXT, name="Next pose"),
            bars(_ACCURACY, "Predicted 95 %/95 % error, µm, by poses measured"),
            text_tabs(),
        )
        recording.send_blueprint(layout(rrb.Vertical(main_view("Next pose", controls)), texts, _TIMELINE))
        draw_instrument(recording, "tracker", model.T_world_tracker)

    def show(self, data: Measurements, proposal: Proposal) -> None:
        """Add a proposal."""
        recording, problem = self._recording, self._planner.problem
        model, arm, values = problem.robot.model, problem.arm, problem.values
        at = [rr.TimeColumn(_TIMELINE, sequence=[proposal.measured])]
        recording.set_time(_TIMELINE, sequence=proposal.measured)
        measured = data.joints[data.seen.all(axis=1)][: proposal.measured]
        if len(measured):
            points = moved(model.T_world_tracker, arm.points(measured, values)).reshape(-1, 3)
            recording.log("world/targets/measured", rr.Points3D(points, colors=RGB_MEASURED, radii=0.01 * self._reach))
        pose = problem.access.hubs[0] if proposal.joints is None else proposal.joints
        visible = tuple(shells(model))
        draw_shells(recording, at, visible, body_poses(model, arm, values, pose[None]))
        draw_legs(recording, at, world_legs(model.T_world_frame0, arm, values, pose[None]), self._reach)
        there = moved(model.T_world_tracker, arm.points(pose[None], values))
        if proposal.joints is None:
            there = np.full_like(there, np.nan)
        draw_beams(recording, at, model.T_world_tracker[:3, 3], there)
        shown = there[np.isfinite(there).all(axis=2)]
        recording.log("world/targets/next", rr.Points3D(shown, colors=RGB_CURRENT, radii=0.016 * self._reach))
        if proposal.accuracy_m is not None:
            self._accuracy[proposal.measured] = MICRONS.of(proposal.accuracy_m)
            poses = list(self._accuracy)
            chart = rr.BarChart(list(self._accuracy.values()), abscissa=poses, color=RGB_UNCERTAINTY)
            recording.log(_ACCURACY, chart)
        recording.log(_NEXT, markdown(proposal_text(problem.robot.chain, proposal)))
