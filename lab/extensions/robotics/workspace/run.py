"""Measure and compare the workspaces of robots within their limits."""

from dataclasses import replace

from lab.campaign.robot import load_robot
from lab.extensions.robotics.workspace.measured import robot_workspace
from lab.extensions.robotics.workspace.options import WorkspaceOptions
from lab.extensions.robotics.workspace.result import WorkspaceResult
from lab.render.terminal import status

__all__ = ["measure_workspaces"]


def measure_workspaces(options: WorkspaceOptions) -> WorkspaceResult:
    """Measure what robots reach within their limits, and in how many orientations; write it where asked.

    Raises:
        LabError: there is no such robot, or its point stays on a line or a surface, which has no volume.
    """
    options.check()
    with status("measuring") as stage:
        found = tuple(robot_workspace(load_robot(name, options.cell), options, stage) for name in options.named)
    result = WorkspaceResult(replace(options, out=None, overwrite=False), found)  # where it goes is no part of it
    if options.out is not None:
        result.save(options.out, overwrite=options.overwrite)
    return result
