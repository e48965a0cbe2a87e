"""The poses of a task, at which the error of a plan is predicted: all over the workspace, in a box, or at targets."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from lab.core.errors import LabError
from lab.core.random import rng_for
from lab.core.se3 import Array
from lab.core.units import MM
from lab.kinematics.model import RigidArm
from lab.options.virtual_campaign import DesignOptions
from lab.prediction.regions import region_of_points
from lab.prediction.task_region import TaskRegion
from lab.robots.robot import Robot
from lab.simulation.collisions import random_poses

__all__ = ["TEST_POSES", "task_poses"]

TEST_POSES = 500  # random poses of the workspace
_BRANCHES = 4  # configurations of each point of a task, where the arm has so many
_MOST_NAMED = 5  # targets that are not reached


def task_poses(
    options: DesignOptions,
    region: TaskRegion,
    points: Array,
    robot: Robot,
    arm: RigidArm,
    values: Array,
    candidates: Array,
) -> tuple[Array, tuple[str, ...]]:
    """Return joint positions ``(t, joints)`` at which the error is predicted, and warnings on points without any.

    In a box or at targets these are some configurations for each point, found from candidates ``(m, joints)`` of which
    the target is near, or from the joint positions of the file.

    Args:
        points: ``(n, 3)`` m of the region, in the frame of the measurements.

    Raises:
        LabError: the arm reaches none of the points.
    """
    chain = robot.chain
    if region.kind == "workspace":
        return random_poses(robot.model, TEST_POSES // len(arm.targets), rng_for(options.seed, "fresh")), ()
    stated = region.joints(chain.joint_names, chain.prismatic)
    starts = [stated] if len(stated) else [candidates[i::_BRANCHES] for i in range(min(_BRANCHES, len(candidates)))]
    joints, reached = [], np.zeros(len(points), bool)
    for start in starts:
        try:
            task = region_of_points(
                region.kind, points, model=arm, values=values, inputs=start, joints=chain, name=_option(region)
            )
        except LabError:  # none of them from these configurations
            continue
        joints.append(task.inputs)
        reached |= task.reached if task.reached is not None else False
    frame = _frame_of_points(region, arm, values)
    if not joints:
        raise LabError(f"{_option(region)}: the arm reaches none of its {len(points)} points, {frame}; name another")
    return np.concatenate(joints), _missed(region, region.names(chain.joint_names, chain.prismatic), reached, frame)


def _frame_of_points(region: TaskRegion, arm: RigidArm, values: Array) -> str:
    """Describe the frame of a region's coordinates, and of targets where the arm stands in it."""
    if region.file is None:
        return "whose coordinates are in the robot's frame 0"
    base = ", ".join(f"{MM.of(part):.0f}".replace("-", "−") for part in arm.T_tracker_frame0(values)[:3, 3] + 0.0)
    return f"whose coordinates are in the instrument's frame (the robot's base is at {base} mm there)"


def _missed(region: TaskRegion, names: Sequence[str], reached: NDArray[np.bool_], frame: str) -> tuple[str, ...]:
    """Warn of the points of a task that no pose reaches."""
    count = int((~reached).sum())
    if not count:
        return ()
    what = f"{count} of the {len(reached)} points drawn from the box"
    if names:
        missed = [name for name, is_reached in zip(names, reached, strict=True) if not is_reached]
        more = f" and {count - _MOST_NAMED} more" if count > _MOST_NAMED else ""
        what = f"target{'s' * (count > 1)} {', '.join(missed[:_MOST_NAMED])}{more} ({count} of {len(reached)})"
    return (f"{_option(region)}: no pose reaches {what}, {frame}; the error is predicted at the others alone",)


def _option(region: TaskRegion) -> str:
    return "--region" if region.file is None else f"--region {region.file}"
