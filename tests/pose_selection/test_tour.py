"""The order of measuring: short tours against exact ones, and moves that have to go around something."""

import itertools
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from helpers.robots import IRB120, SCARA

from lab.core.errors import LabError
from lab.core.random import rng_for
from lab.kinematics.trajectory.profiles import rest_to_rest_seconds
from lab.pose_selection.tour import (
    DEFAULT_SLIDE_SPEED,
    DEFAULT_SPEED,
    FULL_SPEED_S,
    RoadmapGraph,
    Tour,
    lengths,
    move_seconds,
    plan_tour,
    rated,
    tour_trajectory,
    with_reference,
)

RATES = IRB120.chain.speed, IRB120.chain.acceleration
FLAT = np.ones(2), np.full(2, 4.0)  # speeds and accelerations of a point in a plane


def anywhere(start: np.ndarray, end: np.ndarray) -> bool:
    return True


def around_a_disc(start: np.ndarray, end: np.ndarray) -> bool:
    """Free if the segment keeps 0.5 from (1, 1)."""
    way = end - start
    along = np.clip((np.array([1.0, 1.0]) - start) @ way / max(way @ way, 1e-12), 0, 1)
    return bool(np.hypot(*(start + along * way - 1)) > 0.5)


def held_karp(cost: np.ndarray) -> float:
    """Length of the shortest closed tour (Held & Karp 1962)."""
    n = len(cost) - 1
    best = {(1 << k, k): cost[0, k + 1] for k in range(n)}
    for size in range(2, n + 1):
        layer = {}
        for chosen in itertools.combinations(range(n), size):
            bits = sum(1 << k for k in chosen)
            for k in chosen:
                rest = bits ^ (1 << k)
                layer[bits, k] = min(best[rest, j] + cost[j + 1, k + 1] for j in chosen if j != k)
        best = layer
    return min(value + cost[k + 1, 0] for (_, k), value in best.items())


def true_costs(roads: RoadmapGraph, free) -> np.ndarray:
    """All moves looked at, and shortest ways over all of them (Floyd 1962)."""
    cost = move_seconds(roads.nodes, *(RATES if roads.nodes.shape[1] == 6 else FLAT))
    for a, b in itertools.combinations(range(len(cost)), 2):
        if not free(roads.nodes[a], roads.nodes[b]):
            cost[a, b] = cost[b, a] = np.inf
    for via in range(len(cost)):
        cost = np.minimum(cost, cost[:, via, None] + cost[None, via])
    return cost[: roads.count, : roads.count]


def assert_consistent(tour: Tour, joints: np.ndarray, rates: tuple[np.ndarray, np.ndarray], free) -> None:
    """Every pose once, home at both ends, every move free, and the time that of the stops."""
    np.testing.assert_array_equal(np.sort(tour.order), np.arange(len(joints)))
    np.testing.assert_array_equal(tour.measured[tour.measured >= 0], tour.order)
    np.testing.assert_array_equal(tour.waypoints[tour.measured >= 0], joints[tour.order])
    np.testing.assert_array_equal(tour.waypoints[[0, -1]], 0)
    moves = list(itertools.pairwise(tour.waypoints))
    assert all(free(a, b) for a, b in moves)
    assert tour.seconds == pytest.approx(sum(rest_to_rest_seconds(b - a, *rates) for a, b in moves))


def test_a_move_lasts_as_long_as_its_slowest_joint() -> None:
    """Speed / acceleration of every joint of the IRB 120 is 0.3 s: the time at full speed, and one ramp."""
    joints = np.deg2rad([[0, 0, 0, 0, 0, 0], [100, -50, 0, 0, 0, 0], [0, 0, 0, 0, 128, 420]])
    seconds = move_seconds(joints, *RATES)
    np.testing.assert_allclose(seconds, [[0, 0.7, 1.3], [0.7, 0, 1.3], [1.3, 1.3, 0]], rtol=1e-3)


def test_the_day_moves_the_joints_through_all_stops() -> None:
    """Straight between the stops, at rest there as long as is asked, and as quick as the tour says."""
    chain, _ = rated(SCARA)
    joints = np.array([[0.3, 0.5, 0.5, 0], [-1, 0.2, 0.3, 1], [1, -2, 0.9, 0.5]])
    tour = plan_tour(joints, chain.speed, chain.acceleration, anywhere, rng_for(0, "tour"), np.array([0, 0, 0.3, 0]))
    waiting = np.where(tour.measured >= 0, 3.0, 0.0)
    day, arrivals = tour_trajectory(chain, tour.waypoints, waiting)
    assert day.seconds == pytest.approx(tour.seconds + 9) and arrivals[-1] == pytest.approx(day.seconds)
    for times in (arrivals, arrivals + waiting):
        readings, speeds, _ = day.at(times)
        np.testing.assert_allclose(readings, tour.waypoints, atol=1e-12)
        np.testing.assert_allclose(speeds, 0.0, atol=1e-12)
    between = day.at(0.7 * (arrivals[:-1] + waiting[:-1]) + 0.3 * arrivals[1:])[0]
    for at, start, end in zip(between, tour.waypoints, tour.waypoints[1:], strict=False):
        share = (at - start) @ (end - start) / ((end - start) @ (end - start))
        np.testing.assert_allclose(at, start + share * (end - start), atol=1e-12)


@pytest.mark.parametrize("seed", range(3))
def test_twelve_poses_around_an_obstacle_are_ordered_exactly(seed: int) -> None:
    """A quarter of the moves in the plane are blocked; the optimum is over true costs, detours included."""
    joints = np.random.default_rng(seed).uniform(0, 2, (60, 2))
    joints = joints[np.hypot(*(joints - 1).T) > 0.5][:12]
    tour = plan_tour(joints, *FLAT, around_a_disc, rng_for(seed, "tour"))
    roads = RoadmapGraph(joints, *FLAT, around_a_disc)
    cost = true_costs(roads, around_a_disc)
    assert (cost > move_seconds(roads.nodes, *FLAT) + 1e-9).mean() > 0.1
    assert_consistent(tour, joints, FLAT, around_a_disc)
    assert tour.seconds == pytest.approx(held_karp(cost), abs=1e-9)


def test_the_fastest_detour_is_taken_and_costs_what_it_takes() -> None:
    """Across the disc from (0.2, 1) to (1.8, 1): by way of (1, 1.7), not (1, 3); largest-coordinate times."""
    joints, safe = np.array([[0.2, 1.0], [1.8, 1.0]]), np.array([[1.0, 3.0], [0.2, 1.8], [1.8, 1.8]])
    roads = RoadmapGraph(joints, *FLAT, around_a_disc, home=np.array([-2.0, 1.0]), safe=safe)
    roads.settle(2, 1)
    assert roads.cost[1, 2] == pytest.approx(0.8 + 1.6 + 0.8 + 3 * 0.25)  # by two safe poses; (1, 3) takes 4.5
    tour = roads.tour(np.array([1, 0]))
    np.testing.assert_array_equal(tour.waypoints[-5:-1], [[1.8, 1.0], [1.8, 1.8], [0.2, 1.8], [0.2, 1.0]])
    assert tour.measured[-5:].tolist() == [1, -1, -1, 0, -1]


@pytest.mark.parametrize("count", [0, 1, 2, 3, 4])
def test_few_poses_are_toured_too(count: int) -> None:
    joints = np.random.default_rng(count).uniform(-1, 1, (count, 2))
    tour = plan_tour(joints, *FLAT, anywhere, np.random.default_rng(0))
    assert_consistent(tour, joints, FLAT, anywhere)
    cost = move_seconds(np.concatenate([np.zeros((1, 2)), joints]), *FLAT)
    rows = [np.array([0, *order]) for order in itertools.permutations(range(1, count + 1))]
    assert tour.seconds == pytest.approx(lengths(cost, np.array(rows)).min())


def test_a_pose_measured_twice_is_no_trouble() -> None:
    joints = np.array([[0.2, 1.0], [1.8, 1.0], [0.2, 1.0], [0.2, 1.8], [1.8, 1.8]])
    assert_consistent(plan_tour(joints, *FLAT, around_a_disc, np.random.default_rng(0)), joints, FLAT, around_a_disc)


@pytest.mark.parametrize(
    ("count", "every", "visits"),
    [(5, 2, [0, 1, 0, 2, 3, 0, 4, 0]), (4, 2, [0, 1, 0, 2, 3, 0]), (3, 10, [0, 1, 2, 0]), (1, 2, [0])],
)
def test_the_first_pose_is_measured_again(count: int, every: int, visits: list[int]) -> None:
    """After every so many poses and last, and every way between is free: around a disc in a plane."""
    chain = SimpleNamespace(speed=FLAT[0], acceleration=FLAT[1])  # of a point in a plane
    poses, safe = np.random.default_rng(3).uniform(1.6, 2.4, (count, 2)), np.array([[0.0, 2.4], [2.4, 0.0]])
    tour = plan_tour(poses, *FLAT, around_a_disc, rng_for(0, "tour"), safe=safe)
    found = with_reference(tour, every, safe, chain, around_a_disc)
    order = list(tour.order)
    assert [order.index(pose) for pose in found.measured[found.measured >= 0]] == visits
    np.testing.assert_allclose(found.waypoints[found.measured >= 0], poses[found.measured[found.measured >= 0]])
    assert not found.waypoints[[0, -1]].any() and len(found.waypoints) == len(found.measured)
    assert all(around_a_disc(a, b) for a, b in itertools.pairwise(found.waypoints))
    assert found.seconds == pytest.approx(
        sum(move_seconds(np.array(m), *FLAT)[0, 1] for m in itertools.pairwise(found.waypoints))
    )
    assert found.order.tolist() == order


def test_what_cannot_be_reached_or_timed_is_refused() -> None:
    joints = np.array([[0.2, 0.1], [1.0, 1.0]])  # the second one is in the disc
    with pytest.raises(LabError, match=r"no free way to pose 1, .*safe poses.*leave that pose out"):
        plan_tour(joints, *FLAT, around_a_disc, np.random.default_rng(0))
    with pytest.raises(LabError, match=r"no free way to home, .*another home"):
        plan_tour(joints[:1], *FLAT, around_a_disc, np.random.default_rng(0), home=joints[1])
    with pytest.raises(LabError, match="joint 2: its largest speed is nan"):
        plan_tour(joints, np.array([1.0, np.nan]), np.ones(2), anywhere, np.random.default_rng(0))


def test_unknown_rates_are_assumed_and_said() -> None:
    chain, warnings = rated(SCARA)
    np.testing.assert_array_equal(chain.speed, [DEFAULT_SPEED, DEFAULT_SPEED, DEFAULT_SLIDE_SPEED, DEFAULT_SPEED])
    np.testing.assert_allclose(chain.acceleration, chain.speed / FULL_SPEED_S)
    assert len(warnings) == 1 and "no speed for any joint" in warnings[0] and "180 deg/s" in warnings[0]
    known, warnings = rated(IRB120.chain)
    assert warnings == () and np.array_equal(known.speed, RATES[0])
    slow = replace(IRB120.chain, acceleration=np.array([1.0, np.nan, 1, 1, np.nan, 1]))
    assert rated(slow)[1] == ("robot irb120 gives no acceleration for q2, q5: full speed in 0.3 s is assumed",)
