"""The graph of collision-free poses and the paths between them: which poses a free path leads to."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lab.core.se3 import Array
from lab.pose_selection.exchange import Feasible
from lab.pose_selection.tour import FreePath
from lab.simulation.collisions import collides, describe_collisions
from lab.simulation.free_path import path_check
from lab.simulation.robot_model import RobotModel

__all__ = ["HUBS", "ReachabilityGraph", "free_home", "reachability", "refusals"]

HUBS = 20  # candidates tried as waypoints to others


@dataclass(frozen=True)
class ReachabilityGraph:
    """Collision-free poses of the arm and the paths between them.

    Inputs are joint positions, with further columns, if any, on how a pose is measured.

    Attributes:
        hubs: ``(h, joints)``, home or the nearest pose without contact, which comes first, and candidates with a free
            path to one of those before.
        free: whether the joint path between two poses is free of collisions.
        reachable: whether a free path leads from a hub to inputs ``(n, joints + further)``.
        feasible: whether they are feasible as well.
    """

    hubs: Array
    free: FreePath
    reachable: Feasible
    feasible: Feasible


def free_home(model: RobotModel, candidates: Array) -> Array:
    """Return the robot's home ``(joints,)``; if in collision, the nearest of free poses ``(m, joints)``."""
    home = model.chain.home
    if not collides(model, home[None])[0]:
        return home
    return np.asarray(candidates[np.argmin(np.abs(candidates - home).max(axis=1))])


def reachability(
    model: RobotModel, home: Array, candidates: Array, allowed: Feasible, most: int = HUBS
) -> ReachabilityGraph:
    """Find hubs among the first of the candidates ``(m, joints)``, and build the tests of reachability from them.

    Args:
        allowed: test of inputs ``(n, joints + further)``: allowed for the arm, and measurable.
    """
    free = path_check(model)
    reached = [home]
    for pose in candidates[:most]:
        if any(free(hub, pose) for hub in reached):
            reached.append(pose)

    stored: dict[bytes, bool] = {}  # designs of other sizes test the same candidates again

    def leads_to(pose: Array) -> bool:
        key = pose.tobytes()
        if key not in stored:
            stored[key] = any(free(hub, pose) for hub in reached)
        return stored[key]

    def reachable(joints: Array) -> NDArray[np.bool_]:
        return np.array([leads_to(pose) for pose in joints[:, : model.chain.size]], dtype=bool)

    def feasible(joints: Array) -> NDArray[np.bool_]:
        fine = allowed(joints)
        fine[fine] = reachable(joints[fine])
        return fine

    return ReachabilityGraph(np.array(reached), free, reachable, feasible)


def refusals(model: RobotModel, access: ReachabilityGraph | None) -> Callable[[Array], list[str]]:
    """Return a function of joint positions ``(n, joints)``: the reasons against each, "" for none.

    Args:
        access: from which a free path is required; None if paths are given, and each pose is checked alone.
    """

    def refused(joints: Array) -> list[str]:
        messages = [f"collision: {message}" if message else "" for message in describe_collisions(model, joints)]
        for i, message in enumerate(messages):
            if access is not None and not message and not access.reachable(joints[i : i + 1])[0]:
                messages[i] = "no way that is free of collisions was found from home to it"
        return messages

    return refused
