"""Moves of plans and of corrected targets in cells: what the lab calls free is, by other code, ten times as densely."""

from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path

import numpy as np
from helpers.cells import between_table_and_post
from helpers.dense_check import DenseCheck

from lab.core.random import rng_for
from lab.core.se3 import Array
from lab.planning.reachability import free_home, reachability
from lab.pose_selection.tour import plan_tour, rated, waypoints_in_order
from lab.simulation.collisions import collides, random_poses
from lab.simulation.free_path import path_check
from lab.simulation.robot_model import RobotModel

TOUR = 12  # poses of a plan; a correction goes through twice as many targets in their order


def moves(model: RobotModel, count: int) -> Iterator[tuple[Array, Array]]:
    """So many moves, by turns of a plan's tour and of a way through targets in their order."""
    made, seed, chain = 0, 0, rated(model.chain)[0]
    while True:
        rng = rng_for(seed, "poses")
        poses = random_poses(model, 3 * TOUR, rng)
        access = reachability(model, free_home(model, poses), poses, lambda joints: ~collides(model, joints))
        poses = poses[access.reachable(poses)]
        if seed % 2:
            home, safe = access.hubs[0], access.hubs[1:]
            stops = plan_tour(poses[:TOUR], chain.speed, chain.acceleration, access.free, rng, home, safe).waypoints
        else:
            stops = waypoints_in_order(poses[: 2 * TOUR], access.hubs, chain, access.free)[0]
        for move in pairwise(stops):
            yield move
            made += 1
            if made == count:
                return
        seed += 1


def test_moves_are_free_by_other_code(tmp_path: Path) -> None:
    model = between_table_and_post("tx40", tmp_path)
    dense = DenseCheck(model)
    found = [dense.closest(start, end) for start, end in moves(model, 8)]
    touching = [each for each in found if each.apart_m < 0]
    assert len(found) == 8 and not touching, touching[:3]
    # between two of the lab's looks a shape may come nearer than its clearance by less than half a step
    assert min(each.kept_m for each in found) > -0.005


def test_both_find_what_collides(tmp_path: Path) -> None:
    """Random moves without a look at collisions: where one of the two finds a contact, so does the other."""
    model = between_table_and_post("scara", tmp_path)
    dense, free = DenseCheck(model), path_check(model)
    poses = model.chain.random_joints(30, np.random.default_rng(1))
    agreed = [(free(start, end), dense.closest(start, end).kept_m > 0) for start, end in pairwise(poses)]
    assert set(agreed) == {(True, True), (False, False)}
