"""A motion of a robot through points, within the limits of its joints."""

from pathlib import Path
from typing import Any

from lab.campaign.robot import load_robot
from lab.commands.keywords import options_of, takes
from lab.commands.trajectory.motion import planned
from lab.commands.trajectory.options import TrajectoryOptions
from lab.commands.trajectory.result import TrajectoryResult
from lab.formats.path_csv import read_path
from lab.pose_selection.tour import rated

__all__ = ["trajectory"]


@takes(TrajectoryOptions)
def trajectory(points: str | Path | TrajectoryOptions, **options: Any) -> TrajectoryResult:
    r"""Move a nominal robot through points: by its joints, or along lines and circles of its tool.

    Args:
        points: a CSV file with a row for each point; or all options in one object.
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
        points = options_of("lab.trajectory", TrajectoryOptions, {"points": str(points), **options})
    points.check()
    robot = load_robot(points.robot)
    chain, said = rated(points.rated(robot.chain))
    rows = read_path(points.points, chain.joint_names, chain.prismatic, points.orientation)
    arm = robot.arm(("p1",))
    legs = planned(points, arm, arm.nominal({"p1": points.tool_m}), chain, rows)
    return TrajectoryResult(points, robot, chain, tuple(legs), (*robot.warnings, *said, *rows.warnings))
