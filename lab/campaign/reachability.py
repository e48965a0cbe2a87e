"""Where an arm may be, and on what ways it gets there without touching anything."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray

from lab.core.kept_pieces import Columns, Keep, at_once
from lab.core.progress import Progress, no_progress
from lab.core.se3 import Array
from lab.kinematics.joints import JointSpec
from lab.pose_selection.exchange import Feasible
from lab.pose_selection.tour import FreePath, fastest_way
from lab.simulation.collisions import collides, collisions_in_words
from lab.simulation.free_path import path_check
from lab.simulation.model import RobotModel

__all__ = ["HUBS", "ReachabilityGraph", "free_home", "reachability", "refusals", "stops_in_order"]

_BLOCK = 500  # ways that are looked at, and kept, together
HUBS = 20  # candidates tried as poses to pass through on the way to others


@dataclass(frozen=True)
class ReachabilityGraph:
    """Where the arm may be, and go.

    Inputs are joint positions, with further columns that say how a pose is measured, where there are such.

    Attributes:
        hubs: ``(h, joints)``, home (zero joint positions, or what is nearest and touches nothing) and poses with a
            free way to it.
        free: whether the joint path between two poses is free of collisions.
        reachable: whether a free way leads from a hub to inputs ``(n, joints + further)``.
        feasible: whether they are feasible as well.
    """

    hubs: Array
    free: FreePath
    reachable: Feasible
    feasible: Feasible


def free_home(model: RobotModel, candidates: Array) -> Array:
    """The robot's home ``(joints,)``; where it touches something there, the nearest of free poses ``(m, joints)``."""
    home = model.chain.home
    if not collides(model, home[None])[0]:
        return home
    return np.asarray(candidates[np.argmin(np.abs(candidates - home).max(axis=1))])


def reachability(
    model: RobotModel, home: Array, candidates: Array, allowed: Feasible, most: int = HUBS
) -> ReachabilityGraph:
    """Hubs among the first of the candidates ``(m, joints)``, and what can be reached from them.

    Args:
        allowed: inputs ``(n, joints + further)`` to ``(n,)``, whether the arm may be there and is measured there.
    """
    free = path_check(model)
    found = [home]
    for pose in candidates[:most]:
        if any(free(hub, pose) for hub in found):
            found.append(pose)

    known: dict[bytes, bool] = {}  # designs of other sizes ask for the same candidates again

    def leads_to(pose: Array) -> bool:
        key = pose.tobytes()
        if key not in known:
            known[key] = any(free(hub, pose) for hub in found)
        return known[key]

    def reachable(joints: Array) -> NDArray[np.bool_]:
        return np.array([leads_to(pose) for pose in joints[:, : model.chain.size]], dtype=bool)

    def feasible(joints: Array) -> NDArray[np.bool_]:
        fine = allowed(joints)
        fine[fine] = reachable(joints[fine])
        return fine

    return ReachabilityGraph(np.array(found), free, reachable, feasible)


def refusals(model: RobotModel, access: ReachabilityGraph | None) -> Callable[[Array], list[str]]:
    """A callable: why the arm may not go to joint positions ``(n, joints)``, in words; "" where it may.

    Args:
        access: to which a free way has to lead; None where the ways are given, and each place is judged by itself.
    """

    def refused(joints: Array) -> list[str]:
        said = [f"collision: {words}" if words else "" for words in collisions_in_words(model, joints)]
        for i, words in enumerate(said):
            if access is not None and not words and not access.reachable(joints[i : i + 1])[0]:
                said[i] = "no way that is free of collisions was found from home to it"
        return said

    return refused


def stops_in_order(
    chain: JointSpec,
    access: ReachabilityGraph,
    joints: Array,
    progress: Progress = no_progress,
    keep: Keep = at_once,
) -> tuple[Array, NDArray[np.int_]]:
    """A free way from home through poses in the order in which they are given, and home again.

    Args:
        chain: with known rates.
        joints: ``(n, joints)``, to each of which a free way leads.
        progress: told how many ways were looked at.
        keep: how the ways that were looked at are kept.

    Returns:
        Joint positions ``(s, joints)`` to move to one after the other, each in a straight line of all joints, and
        ``(s,)`` which of the poses each one is, -1 for home and for what is only passed.
    """
    home, known = access.hubs[0], dict[bytes, bool]()

    def free(start: Array, end: Array) -> bool:
        key = start.tobytes() + end.tobytes()
        if key not in known:
            known[key] = access.free(start, end)
        return known[key]

    nodes = np.concatenate([home[None], joints, home[None]])

    def ways(first: int, last: int) -> Columns:
        stops, which = [], []
        for i in range(first, last):
            progress(i, len(joints) + 1)
            way = fastest_way(nodes[i], nodes[i + 1], access.hubs, chain, free)[1:]
            stops.append(way)
            which.append(np.append(np.full(len(way) - 1, -1), i if i < len(joints) else -1))
        return {"stops": np.concatenate(stops), "which": np.concatenate(which)}

    stops, which = [home[None]], [np.array([-1])]
    for first in range(0, len(joints) + 1, _BLOCK):
        last = min(first + _BLOCK, len(joints) + 1)
        piece = keep("ways", [np.array([first]), nodes[first : last + 1], access.hubs], partial(ways, first, last))
        stops.append(piece["stops"])
        which.append(piece["which"])
    return np.concatenate(stops), np.concatenate(which)
