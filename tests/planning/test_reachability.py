"""Ways that touch nothing, looked at again more densely and with a reader of contacts of its own."""

from dataclasses import replace
from itertools import pairwise

import mujoco
import numpy as np
from helpers.robots import IRB120

from lab.core.random import rng_for
from lab.core.se3 import Array
from lab.planning.reachability import HUBS, reachability, refusals
from lab.pose_selection.tour import rated, waypoints_in_order
from lab.simulation.collisions import collides, describe_collisions, random_poses, unchecked

MODEL = IRB120.model
LOOKS = 500  # between two stops


def contacts(joints: Array) -> Array:
    """``(n,)`` contacts by MuJoCo's whole forward dynamics."""
    data, found = mujoco.MjData(MODEL.model), []
    for q in joints:
        data.qpos[:6] = q
        mujoco.mj_forward(MODEL.model, data)
        found.append(data.ncon)
    return np.array(found)


def test_all_that_moves_from_stop_to_stop_touches_nothing() -> None:
    """Of random poses that straight moves would join through the floor or the arm itself."""
    poses = random_poses(MODEL, 12, np.random.default_rng(10))
    hubs = random_poses(MODEL, HUBS, rng_for(0, "poses"))
    access = reachability(MODEL, IRB120.chain.home, hubs, lambda joints: ~collides(MODEL, joints))
    poses = poses[access.reachable(poses)]
    assert len(poses) >= 8
    told: list[tuple[int, int]] = []
    rates = rated(IRB120.chain)[0]
    stops, which = waypoints_in_order(poses, access.hubs, rates, access.free, lambda done, of: told.append((done, of)))
    assert told == [(i, len(poses) + 1) for i in range(len(poses) + 1)]
    assert which[which >= 0].tolist() == list(range(len(poses))) and which[0] == which[-1] == -1
    np.testing.assert_array_equal(stops[which >= 0], poses)
    np.testing.assert_array_equal(stops[[0, -1]], np.zeros((2, 6)))
    share = np.linspace(0, 1, LOOKS)[:, None]
    between = [start + share * (end - start) for start, end in pairwise(stops)]
    assert not contacts(np.concatenate(between)).any()
    straight = [start + share * (end - start) for start, end in pairwise(poses)]
    assert contacts(np.concatenate(straight)).any() and len(stops) > len(poses) + 2  # so some go round


def test_a_refusal_names_what_touches_what_and_how_deep() -> None:
    joints = np.deg2rad([[0, 0, 0, 0, 0, 0], [0, 110, -60, 0, 30, 0]])  # the second one is through the floor
    words = describe_collisions(MODEL, joints)
    assert words[0] == "" and "floor" in words[1] and "mm deep" in words[1]
    access = reachability(MODEL, joints[0], joints[:0], lambda q: ~collides(MODEL, q))
    said = refusals(MODEL, access)(joints)
    assert said[0] == "" and said[1] == f"collision: {words[1]}"
    nowhere = replace(access, reachable=lambda q: np.zeros(len(q), dtype=bool))
    assert "no way" in refusals(MODEL, nowhere)(joints)[0] and refusals(MODEL, None)(joints) == said
    assert collides(MODEL, joints).tolist() == [False, True]
    assert not collides(unchecked(MODEL), joints).any()
    assert collides(MODEL, joints)[1]  # the original is as it was
