"""A motion of a robot through points, within the limits of its joints."""

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from lab.campaign.robot import Robot, load_robot, load_virtual
from lab.commands.calibrate.load_run import CalibrationRun, calibrated_by, folder_of
from lab.commands.command_line import options_of, takes
from lab.core import se3
from lab.core.errors import LabError
from lab.core.limits import MOMENTS
from lab.core.se3 import Array
from lab.extensions.robotics.trajectory.motion import planned
from lab.extensions.robotics.trajectory.options import TrajectoryOptions
from lab.extensions.robotics.trajectory.path_csv import read_path
from lab.extensions.robotics.trajectory.result import (
    TrajectoryResult,
    refuse_collisions,
    tracked_arm,
    tracking_along,
    tracking_warnings,
)
from lab.formats.programs.postures import postures_of
from lab.formats.programs.protocol import MoveKind, PathMoves
from lab.pose_selection.tour import rated

if TYPE_CHECKING:
    from lab import CalibrationResult

__all__ = ["path_moves", "trajectory"]


@takes(TrajectoryOptions)
def trajectory(
    points: str | Path | TrajectoryOptions, run: "str | Path | CalibrationResult | None" = None, **options: Any
) -> TrajectoryResult:
    r"""Move a nominal robot through points: by its joints, or along lines and circles of its tool.

    Args:
        points: a CSV file with a row for each point; or all options in one object.
        run: what calibrated the robot: a result of ``calibrate`` or ``identify``, or the folder of a run; then what it
            misses along the way is worked out, and joint positions that make up for that.
        options: those of ``lab trajectory``, by name: ``robot``, ``law``, ``speeds`` and so on.

    Returns:
        The motion: joint positions, speeds and accelerations at any time.

    Raises:
        LabError: a point cannot be reached or passed like that; the message names it.

    Example:
        >>> import lab, pathlib, tempfile
        >>> file = pathlib.Path(tempfile.mkdtemp()) / "points.csv"
        >>> _ = file.write_text("q1_deg,q2_deg\n0,-30\n90,0\n")
        >>> round(lab.trajectory(file, robot="course2r").to_dict()["seconds"], 4)
        2.6833
    """
    if not isinstance(points, TrajectoryOptions):
        points = options_of("lab.trajectory", TrajectoryOptions, {"points": str(points), **folder_of(run), **options})
    points.check()
    known = _calibrated(points, run)
    robot = known.robot if known is not None else _robot(points)
    chain, said = rated(points.rated(robot.chain))
    rows = read_path(points.points, chain.joint_names, chain.prismatic, points.orientation)
    arm = robot.arm(("p1",))
    legs = planned(points, arm, arm.nominal({"p1": points.tool_m}), chain, rows)
    tracked = tracked_arm(points, robot, known)
    found = TrajectoryResult(points, robot, chain, tuple(legs), (*robot.warnings, *said, *rows.warnings), tracked)
    MOMENTS(points.points, int(min(found.motion.seconds / (points.step_ms / 1e3), 1e18)))
    refuse_collisions(found)
    if tracked is None or found.tracking is None:
        return found
    more = tracking_warnings(tracked, found.tracking, found.sampled.joints)
    return replace(found, warnings=tuple(dict.fromkeys((*found.warnings, *more))))


def _calibrated(options: TrajectoryOptions, run: "str | Path | CalibrationResult | None") -> CalibrationRun | None:
    """The run that is asked for; None without one."""
    if options.run is None:
        return None
    found = calibrated_by(run, options.run, options.load, options.cell, accept_edited=options.accept_edited)
    if options.robot not in (TrajectoryOptions.robot, found.robot.name, found.robot.source):
        raise LabError(f"--robot {options.robot}: the run {options.run} is of {found.robot.name}; leave out --robot")
    if not options.force:
        found.refuse_unfit("a corrected trajectory")
    return found


def _robot(options: TrajectoryOptions) -> Robot:
    """The nominal robot; elastic links without masses take the assumed ones."""
    robot = load_robot(options.robot, options.cell)
    return load_virtual(robot) if robot.link_compliances is not None and robot.loads is None else robot


def path_moves(result: TrajectoryResult) -> PathMoves:
    """The stops of all moves of a motion, and of circles the points that they pass.

    With a run these are the joint positions at which the calibrated arm, at rest, is where the nominal one would be.
    """
    first = result.legs[0]
    ids, kinds = [first.points[0]], list[MoveKind](["joint"])
    stops, seconds, shares, speeds = [first.stops[0]], [np.nan], [0.0], [np.nan]
    for leg in result.legs:
        share = float((leg.move.peaks[0] / _rated(result)).max())
        count = len(leg.points) - 1
        reached: list[MoveKind] = ["via", "circle"] if leg.kind == "circle" else [leg.kind] * count
        for name, kind, stop in zip(leg.points[1:], reached, leg.stops[1:], strict=True):
            ids.append(name)
            kinds.append(kind)
            stops.append(stop)
            seconds.append(np.nan if kind == "via" else leg.move.seconds / (1 if kind == "circle" else count))
            shares.append(share)
            speeds.append(leg.speed_m_s)
    return _moves(result, ids, kinds, np.array(stops), np.array([seconds, shares, speeds]))


def _rated(result: TrajectoryResult) -> Array:
    """The largest speeds ``(n,)`` of the robot's table; of joints without one those that are kept here."""
    known = result.robot.chain.speed
    return np.where(np.isfinite(known), known, result.chain.speed)


def _moves(result: TrajectoryResult, ids: list[str], kinds: list[MoveKind], stops: Array, rates: Array) -> PathMoves:
    tracked, options = result.tracked, result.options
    if tracked is None:
        arm, corrected = result.robot.arm(("p1",)), stops
        values = arm.nominal({"p1": options.tool_m})
    else:
        arm, values, still = tracked.arm.rigid, tracked.nominal, np.zeros_like(stops)
        corrected = tracking_along(tracked, stops, still, still, np.arange(float(len(stops)))).corrected.joints
    T_last_tool = se3.pose(np.eye(3), values[-3 * len(arm.targets) :][:3])
    return PathMoves(
        robot=result.robot.name,
        ids=ids,
        kinds=kinds,
        stops=corrected,
        Ts_base_tool=arm.tool(corrected, values)[0],
        seconds=rates[0],
        shares=rates[1],
        speeds_m_s=rates[2],
        T_last_tool=T_last_tool,
        T_frame0_base=se3.inverse(arm.T_tracker_frame0(values)),
        checked=result.checked,
        corrected=tracked is not None,
        postures=postures_of(arm, values, corrected),
    )
