"""Record a plan with rerun: the arm on its tour, the targets in order, and the ellipsoids of each pose.

Motion is on the timeline ``stop``: 0 is home, then every waypoint of the tour, measured or via, and home again; and on
``time``, where the arm moves from one to the next at its full speed.
"""

from pathlib import Path

import numpy as np
import rerun as rr
import rerun.blueprint as rrb
from numpy.typing import NDArray

from lab.core.number_text import format_magnification
from lab.core.se3 import Array
from lab.core.units import MICRONS
from lab.library.design import DesignResult
from lab.library.result import joint_values
from lab.report import recording as rec
from lab.report.document import Bullets, Section, Strong
from lab.report.scene import legs_legend
from lab.report.style import RGB_CURRENT, RGB_FIRST, RGB_LAST, RGB_MAPPING, RGB_MUTED, RGB_PATH, RGB_UNCERTAINTY
from lab.report.view import document_of
from lab.report.views.design_document import PlanScene, plan_scene

__all__ = ["record_plan"]

_TIMELINE = "stop"
_BOUND, _O1 = "curve/bound_um", "curve/o1"
_PATH, _HERE, _PASSED = RGB_PATH, RGB_CURRENT, RGB_MUTED
_TALLEST = 8.0  # bars of the curve, in times the last one
_FIRST, _LAST = np.array(RGB_FIRST), np.array(RGB_LAST)  # colours of the targets, by the order of the tour


def record_plan(path: Path, plan: DesignResult) -> None:
    """Write a plan's recording, with the blueprint that shows it, to ``path``."""
    shown = plan_scene(plan)
    at = [rr.TimeColumn(_TIMELINE, sequence=np.arange(len(shown.measured))), _seconds(shown.arrivals)]
    digest = plan.problem.robot.sha256 + repr(plan.options)
    identity = rec.identity_of(digest, plan.tour.waypoints, plan.prediction.rms, plan.problem.values)
    with rec.recording_to(path, plan.problem.robot.name, identity) as recording:
        model, arm, values = plan.problem.robot.model, plan.problem.arm, plan.problem.values
        recording.send_blueprint(_blueprint(shown, designed=plan.options.curve))
        rec.draw_shells(recording, at, shown.shells, shown.bodies)
        rec.draw_moving(recording, [_seconds(shown.times)], shown.moving)
        rec.draw_frames(recording, at, model, arm, values, plan.tour.waypoints, shown.reach_m)
        rec.draw_moving_tool(recording, [_seconds(shown.times)], model, arm, values, shown.moving_joints)
        rec.draw_legs(recording, at, shown.legs, shown.reach_m)
        rec.draw_moving_legs(recording, [_seconds(shown.times)], shown.moving_legs)
        for i, (name, T_world_station) in enumerate(zip(shown.stations, shown.Ts_world_station, strict=True)):
            rec.draw_instrument(recording, name, T_world_station, name if i else "")
        rec.draw_beams(recording, at, shown.heads, np.where(shown.measured[:, None, None], shown.points, np.nan))
        gone = rr.LineStrips3D.columns(strips=[]).partition([0] * len(shown.departures))
        recording.send_columns("world/instrument/beam", [_seconds(shown.departures)], gone)
        _targets(recording, at, shown)
        recording.send_columns("world/focus", at, rr.Transform3D.columns(translation=shown.points[:, 0]))
        rec.draw_ellipsoid(recording, "mapping", at, shown.mapping, RGB_MAPPING)
        rec.draw_ellipsoid(recording, "uncertainty", at, shown.uncertainty, RGB_UNCERTAINTY)
        _curve(recording, plan)
        rec.draw_program(recording, at, _program(plan, shown))
        rec.log_texts(recording, document_of(plan), _legend(shown))


def _seconds(times: Array) -> rr.TimeColumn:
    return rr.TimeColumn("time", duration=times)


def _targets(recording: rr.RecordingStream, at: rec.Times, shown: PlanScene) -> None:
    points = shown.points[shown.measured]  # (n, k, 3)
    n, k = points.shape[:2]
    share = np.repeat(np.linspace(0, 1, n), k)[:, None]
    colours = (_FIRST + share * (_LAST - _FIRST)).astype(np.uint8)
    radius = 0.012 * shown.reach_m
    cloud = rr.Points3D(points.reshape(-1, 3), colors=colours, radii=radius)
    recording.log("world/targets/all", cloud, static=True)
    numbers = rr.Points3D(points[:, 0], labels=list(shown.ids), colors=colours[::k], radii=0.0005, show_labels=True)
    recording.log("world/targets/number", numbers, static=True)
    path = rr.LineStrips3D([shown.path], colors=_PATH, radii=0.0008 * shown.reach_m)
    recording.log("world/way", path, static=True)
    rec.draw_points(recording, "world/targets/here", at, shown.points, _HERE, 1.2 * radius)
    underway = rr.Points3D.columns(positions=shown.moving_points.reshape(-1, 3)).partition([k] * len(shown.times))
    recording.send_columns("world/targets/here", [_seconds(shown.times)], underway)
    if (passed := _passed(shown)).any():
        place = shown.points[passed, 0]
        rec.draw_tag(recording, "world/targets/passed", [rr.TimeColumn(_TIMELINE, sequence=np.flatnonzero(passed))],
                 place, "passed only", _PASSED)  # fmt: skip
        gone = np.flatnonzero(passed[:-1] & ~passed[1:]) + 1
        cleared = rr.Points3D.columns(positions=np.empty((0, 3))).partition([0] * len(gone))
        recording.send_columns("world/targets/passed", [rr.TimeColumn(_TIMELINE, sequence=gone)], cleared)


def _passed(shown: PlanScene) -> NDArray[np.bool_]:
    passed = ~shown.measured
    passed[[0, -1]] = False
    return passed


def _curve(recording: rr.RecordingStream, plan: DesignResult) -> None:
    """The tolerance bound of any number of poses (µm), and O1 where each number was designed."""
    poses = np.array([step.poses for step in plan.curve])
    bound = np.array([MICRONS.of(step.prediction.coverage_radius) for step in plan.curve])
    near = bound <= _TALLEST * bound[-1]  # the first set that identifies the parameters would hide all others
    recording.log(_BOUND, rr.BarChart(bound[near], abscissa=poses[near], color=RGB_UNCERTAINTY), static=True)
    if plan.options.curve:
        recording.log(
            _O1, rr.BarChart([step.o1 for step in plan.curve], abscissa=poses, color=RGB_MAPPING), static=True
        )


def _legend(shown: PlanScene) -> Section:
    legend = Bullets(
        (
            (Strong("numbered points"), ": targets at the poses, blue first to yellow last; ", Strong("grey"),
             ": the path between them"),
            (Strong("white"), ": the target at this stop; ", Strong("red"),
             ": the tracker's beam, where the stop is measured"),
            ("timeline ", Strong("time"), ": the day as it goes, the arm at full speed, waiting where it is measured"),
            (Strong("teal"), ", sensitivity ellipsoid: how the scaled parameters move the position, "
             f"{format_magnification(shown.mapping.factor)}"),
            (Strong("violet"), ", uncertainty ellipsoid: predicted 1σ of the position after calibration, "
             f"{format_magnification(shown.uncertainty.factor)}"),
            legs_legend(shown.legs),
        )
    )  # fmt: skip
    return Section("What is shown", (legend,))


def _names(shown: PlanScene) -> list[str]:
    """Return the names of the stops: those of poses, ``home``, and ``passed`` of what is not measured."""
    ids, last = iter(shown.ids), len(shown.measured) - 1
    return [
        next(ids) if is_pose else "home" if stop in (0, last) else "passed"
        for stop, is_pose in enumerate(shown.measured)
    ]


def _program(plan: DesignResult, shown: PlanScene) -> list[str]:
    """Return a line for each stop of the tour: what the arm does there, and its joint positions."""
    chain, lines = plan.problem.robot.chain, []
    for joints, name, measured in zip(plan.tour.waypoints, _names(shown), shown.measured, strict=True):
        values = joint_values(chain.prismatic, joints)
        units = ("mm" if slides else "°" for slides in chain.prismatic)
        place = ", ".join(f"{value:.1f}{unit}" for value, unit in zip(values, units, strict=True))
        lines.append(f"{f'measure pose {name}' if measured else name} at {place}")
    return lines


def _blueprint(shown: PlanScene, *, designed: bool) -> rrb.Blueprint:
    """The arm large, the two ellipsoids beside it, text and curves at hand, that of O1 where it is ``designed``."""
    controls = rec.eye(shown.origins, shown.points.reshape(-1, 3), shown.reach_m, shown.Ts_world_station[0, :3, 3])
    factors = [format_magnification(each.factor) for each in (shown.uncertainty, shown.mapping)]
    close = rrb.Tabs(
        rec.close_view("ellipsoid/uncertainty", f"Predicted uncertainty (1σ) {factors[0]}", shown.reach_m),
        rec.close_view("ellipsoid/mapping", f"Sensitivity {factors[1]}", shown.reach_m),
        active_tab=0,
    )
    texts = rec.text_tabs(rec.program_view())
    bound = rec.bars(_BOUND, "Tolerance bound (95 %/95 %), µm, by number of poses")
    charts = rrb.Tabs(bound, rec.bars(_O1, "O1 by number of poses"), active_tab=0) if designed else bound
    left = rrb.Vertical(rec.main_view("Tour", controls))
    return rec.layout(left, rrb.Vertical(close, texts, charts, row_shares=[1.2, 1.2, 0.9]), _TIMELINE)
