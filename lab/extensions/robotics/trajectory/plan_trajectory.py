"""Run ``lab trajectory``: a motion of a robot through points, within the limits of its joints."""

from dataclasses import replace
from pathlib import Path
from typing import Any

from lab.core.errors import LabError
from lab.core.limits import MOMENTS
from lab.extensions.robotics.trajectory.motion import planned, read_path
from lab.extensions.robotics.trajectory.path_errors import tracked_arm, tracking_warnings
from lab.extensions.robotics.trajectory.trajectory_options import TrajectoryOptions
from lab.extensions.robotics.trajectory.trajectory_result import TrajectoryResult, refuse_collisions
from lab.library.load_run import CalibrationRun, RunLike, calibrated_by, folder_of
from lab.options.call_options import options_of, takes
from lab.pose_selection.tour import rated
from lab.robots.load_robot import load_robot, load_virtual
from lab.robots.robot import Robot

__all__ = ["trajectory"]


@takes(TrajectoryOptions)
def trajectory(
    points: str | Path | TrajectoryOptions,
    run: RunLike = None,
    *,
    robot: str | Path | Robot | None = None,
    **options: Any,
) -> TrajectoryResult:
    r"""Move a nominal robot through points: by its joints, or along lines and circles of its tool.

    Args:
        points: a CSV file with a row for each point; or all options in one object.
        run: a result of ``calibrate`` or ``identify``, or the folder of a run: then its robot's path errors are
            computed, and joint positions that correct them.
        robot: the nominal model: a name, a path, or a loaded robot; by default that of ``run``, else ``irb120``.
        options: those of ``lab trajectory``, by name: ``law``, ``speeds`` and so on.

    Returns:
        The motion: joint positions, speeds and accelerations at any time.

    Raises:
        LabError: a point cannot be reached or passed; the message names it.

    Example:
        >>> import lab, pathlib, tempfile
        >>> file = pathlib.Path(tempfile.mkdtemp()) / "points.csv"
        >>> _ = file.write_text("q1_deg,q2_deg\n0,-30\n90,0\n")
        >>> round(lab.trajectory(file, robot="course2r").to_dict()["seconds"], 4)
        2.6833
    """
    if not isinstance(points, TrajectoryOptions):
        given = {} if robot is None else {"robot": load_robot(robot).source}
        given |= {"points": str(points), **folder_of(run), **options}
        points = options_of("lab.trajectory", TrajectoryOptions, given)
    points.check()
    calibrated = _calibrated(points, run)
    if calibrated is not None:
        _refuse_another(points, calibrated, robot)
        robot = calibrated.robot
    else:
        robot = _nominal(load_robot(points.robot if robot is None else robot, points.cell))
    chain, notes = rated(points.rated(robot.chain))
    rows = read_path(points.points, chain.joint_names, chain.prismatic, points.orientation)
    arm = robot.arm(("p1",))
    legs = planned(points, arm, arm.nominal({"p1": points.tool_m}), chain, rows)
    tracked = tracked_arm(points, robot, calibrated)
    found = TrajectoryResult(points, robot, chain, tuple(legs), (*robot.warnings, *notes, *rows.warnings), tracked)
    MOMENTS(points.points, int(min(found.motion.seconds / (points.step_ms / 1e3), 1e18)))
    refuse_collisions(found)
    if tracked is None or found.tracking is None:
        return found
    more = tracking_warnings(tracked, found.tracking, found.sampled.joints, found.sampled.times)
    return replace(found, warnings=tuple(dict.fromkeys((*found.warnings, *more))))


def _calibrated(options: TrajectoryOptions, run: RunLike) -> CalibrationRun | None:
    """Load the requested run; None without one."""
    if options.run is None:
        return None
    found = calibrated_by(run, options.run, options.load, options.cell, accept_edited=options.accept_edited)
    if not options.force:
        found.refuse_unfit("a corrected trajectory")
    return found


def _refuse_another(options: TrajectoryOptions, run: CalibrationRun, robot: str | Path | Robot | None) -> None:
    """Refuse a robot that is not the run's; on the command line, the default one counts as none."""
    known = {run.robot.name, run.robot.source} | ({TrajectoryOptions.robot} if robot is None else set())
    if options.robot not in known:
        raise LabError(f"--robot {options.robot}: the run {options.run} is of {run.robot.name}; leave out --robot")


def _nominal(robot: Robot) -> Robot:
    """Return the nominal robot; elastic links without masses get the assumed ones."""
    return load_virtual(robot) if robot.link_compliances is not None and robot.loads is None else robot
