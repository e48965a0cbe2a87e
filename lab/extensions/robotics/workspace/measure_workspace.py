"""Run ``lab workspace``: measure and compare the workspaces of robots within their limits."""

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lab.core.progress import Stage, stages
from lab.core.random import rng_for
from lab.core.se3 import Array
from lab.extensions.robotics.workspace.measure import workspace_of
from lab.extensions.robotics.workspace.membership import anyhow
from lab.extensions.robotics.workspace.workspace_options import WorkspaceOptions
from lab.extensions.robotics.workspace.workspace_result import RobotWorkspace, WorkspaceResult
from lab.kinematics.reach import reach_from_axis
from lab.options.call_options import options_of, takes
from lab.robots.load_robot import load_robot
from lab.robots.robot import Robot
from lab.simulation.collisions import collides

__all__ = ["workspace"]

_PLACES, _PLACES_BY_SEARCH, _PLACES_WITH_LOOPS = 200, 60, 20  # at which orientations are tried
_PLACES_IN_CELL = 400  # that are tested for collisions


@takes(WorkspaceOptions)
def workspace(
    robots: str | Path | Robot | Sequence[str | Path | Robot] | WorkspaceOptions = ("irb120",), **options: Any
) -> WorkspaceResult:
    """Measure what robots reach within their limits, and in how many orientations; write it if requested.

    Args:
        robots: one or several robots: names, paths, or loaded robots; or all options in one object.
        options: those of ``lab workspace``, by name: ``cell``, ``tool_mm``, ``places``, ``orientations`` and so on.

    Returns:
        Volumes, sections, voids and shares of orientations of each robot.

    Raises:
        LabError: there is no such robot, or its point stays on a line or a surface, which has no volume.

    Example:
        >>> import lab
        >>> found = lab.workspace("carrier/cartesian", places=200)
        >>> found.robots[0].robot.name
        'carrier-cartesian'
    """
    loaded = dict[str, Robot]()
    if isinstance(robots, WorkspaceOptions):
        requested = robots
    else:
        given = (robots,) if isinstance(robots, str | Path | Robot) else robots
        loaded = {each.source: each for each in given if isinstance(each, Robot)}
        names = tuple(each.source if isinstance(each, Robot) else str(each) for each in given)
        requested = options_of("lab.workspace", WorkspaceOptions, {"robots": names, **options})
    requested.check()
    with stages("measuring") as stage:
        found = tuple(
            _robot_workspace(load_robot(loaded.get(name, name), requested.cell), requested, stage)
            for name in requested.named
        )
    result = WorkspaceResult(replace(requested, out=None, overwrite=False), found)  # the folder is no part of it
    if requested.out is not None:
        result.save(requested.out, overwrite=requested.overwrite)
    return result


def _robot_workspace(robot: Robot, options: WorkspaceOptions, stage: Stage) -> RobotWorkspace:
    arm = robot.arm(("p1",))
    values = arm.nominal({"p1": options.tool_m})
    progress = partial(stage, f"{robot.name}, 1 of 2, places")
    space = workspace_of(arm, values, options.places, rng_for(options.seed, "poses"), progress)
    stage(f"{robot.name}, 2 of 2, reach and orientations")
    chain, reach = arm.dh_chain(values), None
    if chain is not None:
        reach = (reach_from_axis(chain, options.tool_m, least=True), reach_from_axis(chain, options.tool_m))
    shared, shares = np.empty((0, 3)), np.empty(0)
    rng = rng_for(options.seed, "poses", 1)
    if space.orientations is not None:
        count = _PLACES if space.by_pose.exact else _PLACES_WITH_LOOPS if arm.chain.has_loops else _PLACES_BY_SEARCH
        shared = space.domain.spread(space.measured.drawn(count, rng), rng)
        shares = space.shares(shared, options.orientations)
    requested, free = np.empty((0, 3)), np.zeros(0, dtype=np.bool_)
    if robot.cell is not None:
        requested = space.domain.spread(space.measured.drawn(_PLACES_IN_CELL, rng), rng)
        free = _free(robot, space.by_place.solutions(anyhow(requested)))
    return RobotWorkspace(robot, options, space, reach, shared, shares, requested, free)


def _free(robot: Robot, solutions: Array) -> NDArray[np.bool_]:
    """Decide whether a place has a collision-free IK solution among ``(n, k, joints)``, NaN where there are fewer."""
    there = np.isfinite(solutions[:, :, 0])
    free = np.zeros(there.shape, dtype=np.bool_)
    free[there] = ~collides(robot.model, solutions[there])
    return np.asarray(free.any(axis=1))
