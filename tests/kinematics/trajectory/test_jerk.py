"""Moves within limits of jerk: closed forms, ruckig's durations, a linear programme's bound, and every limit kept."""

import math
from dataclasses import replace

import numpy as np
import pytest
import ruckig
from scipy.optimize import linprog

from lab.core.se3 import Array
from lab.kinematics.joints import JointSpec
from lab.kinematics.trajectory.profiles import Trajectory, check_within
from lab.kinematics.trajectory.trajectory import (
    SmoothAxis,
    blended,
    common_phases,
    independent,
    own_phases,
    possible_seconds,
)


def arm(speed, acceleration, jerk) -> JointSpec:
    """Joints of which only the rates matter."""
    n, wide = len(speed), np.full(len(speed), 1e4)
    rates = [None if each is None else np.array(each, float) for each in (speed, acceleration, jerk)]
    return JointSpec(
        name="arm", joint_names=tuple(f"q{i + 1}" for i in range(n)), prismatic=(False,) * n, sign=np.ones(n),
        lower=-wide, upper=wide, speed=rates[0], acceleration=rates[1], jerk=rates[2],
    )  # fmt: skip


def random_case(rng: np.random.Generator, n: int, *, at_rest: bool = False) -> tuple[JointSpec, Array, Array, Array]:
    """Limits over decades, how far each joint moves, and its speeds at the ends: any, none or the largest."""
    chain = arm(10 ** rng.uniform(-1, 1, n), 10 ** rng.uniform(-1, 1.5, n), 10 ** rng.uniform(-1, 2.5, n))
    kind, free = rng.uniform(size=(2, n)), rng.uniform(-1, 1, (2, n))
    ends = chain.speed * np.where(kind < 0.2, 0.0, np.where(kind > 0.9, np.sign(free), free)) * (not at_rest)
    return chain, rng.normal(size=n) * 10 ** rng.uniform(-2.5, 1, n), *ends


def ruckigs(chain: JointSpec, moved: Array, v0: Array, v1: Array) -> float:
    n = chain.size
    generator, asked, found = ruckig.Ruckig(n), ruckig.InputParameter(n), ruckig.Trajectory(n)
    asked.current_position, asked.target_position = [0.0] * n, moved.tolist()
    asked.current_velocity, asked.target_velocity = v0.tolist(), v1.tolist()
    asked.max_velocity, asked.max_acceleration = chain.speed.tolist(), chain.acceleration.tolist()
    asked.max_jerk = [math.inf] * n if chain.jerk is None else chain.jerk.tolist()
    assert generator.calculate(asked, found).value >= 0
    return float(found.duration)


def assert_smooth(chain: JointSpec, found: Trajectory, end: Array, end_speed: Array) -> None:
    """It arrives, keeps all limits at its knots and between them, and its accelerations never jump."""
    assert chain.jerk is not None and found.jerks is not None
    size = 1 + np.abs(end).max()
    np.testing.assert_allclose(found.end, end, rtol=0, atol=1e-9 * size)
    np.testing.assert_allclose(found.end_speed, end_speed, rtol=0, atol=1e-9)
    speeds, accelerations = found.peaks
    for peak, limit in ((speeds, chain.speed), (accelerations, chain.acceleration), (found.peak_jerk, chain.jerk)):
        assert (peak <= limit * (1 + 1e-9)).all()
    inside = found.at(np.linspace(0, found.seconds, 300))
    assert (np.abs(inside[1]) <= speeds + 1e-9).all() and (np.abs(inside[2]) <= accelerations + 1e-9).all()
    ends = found.accelerations + found.jerk * found.durations[:, None]
    jumps = np.abs(np.vstack([found.accelerations, 0 * end]) - np.vstack([0 * end, ends]))
    assert (jumps <= 1e-7 * chain.acceleration).all()


@pytest.mark.parametrize(
    ("moved", "speed", "acceleration", "jerk", "seconds"),
    [
        (2.0, 1.0, 2.0, 4.0, 2 / 1 + 1 / 2 + 2 / 4),  # all seven phases: D / v + v / a + a / j
        (0.5, 1.0, 1.0, 4.0, 1 / 4 + math.sqrt(1 / 16 + 2)),  # the speed is not reached: v^2 / a + v a / j = D
        (0.1, 10.0, 10.0, 1.0, 4 * (0.1 / 2) ** (1 / 3)),  # nor is the acceleration: four phases of jerk
        (4.0, 0.5, 10.0, 1.0, 4 / 0.5 + 2 * math.sqrt(0.5)),  # the speed is, but not the acceleration
        (0.0, 1.0, 1.0, 1.0, 0.0),
    ],
)
def test_closed_forms_of_a_joint_from_rest_to_rest(moved, speed, acceleration, jerk, seconds: float) -> None:
    chain = arm([speed], [acceleration], [jerk])
    for law in (common_phases, own_phases, independent):
        found = law(chain, np.zeros(1), np.array([moved]))
        assert found.seconds == pytest.approx(seconds, rel=1e-9) and found.end[0] == pytest.approx(moved, abs=1e-12)
    largest = SmoothAxis(moved, 0, 0, speed, acceleration, 1e9).spans()[0][0]
    free = common_phases(arm([speed], [acceleration], None), np.zeros(1), np.array([moved])).seconds
    assert largest == pytest.approx(free, rel=1e-5, abs=1e-6)  # without limits of jerk in the limit


def ramps(chain: JointSpec, v0: Array, v1: Array) -> Array:
    """How far the joints come in changes of speed without a detour."""
    rows = np.stack([0 * v0, v0, v1, chain.speed, chain.acceleration, chain.jerk], axis=1)
    return 0.5 * (v0 + v1) * [SmoothAxis(*row).direct for row in rows.tolist()]


def test_moves_last_as_long_as_ruckigs_and_keep_every_limit() -> None:
    rng, waited = np.random.default_rng(0), 0
    for i in range(60):
        chain, moved, v0, v1 = random_case(rng, 1 if i % 3 else 4)
        if i % 2:  # all in one direction, where gaps between the possible durations are common
            v0, v1 = abs(v0), abs(v1)
            moved = rng.uniform(1, 1.3, chain.size) * ramps(chain, v0, v1)
        found = own_phases(chain, np.zeros(chain.size), moved, v0, v1)
        assert found.seconds == pytest.approx(ruckigs(chain, moved, v0, v1), rel=1e-7, abs=1e-7)
        assert_smooth(chain, found, moved, v1)
        alone = [
            SmoothAxis(*row).spans()[0][0]
            for row in np.stack([moved, v0, v1, chain.speed, chain.acceleration, chain.jerk], 1).tolist()
        ]
        waited += found.seconds > max(alone) * (1 + 1e-9)
    assert waited > 1  # the slowest joint's own time was impossible for another one


def quickest_by_programme(chain: JointSpec, moved: float, v0: float, v1: float, seconds: float, steps: int) -> float:
    """How far a joint comes in a time at most, with a jerk that changes only every so often: at most Dmax."""
    step = seconds / steps
    lower = np.tri(steps)
    speed = step * step * (np.tri(steps) @ np.tri(steps) - 0.5 * np.tri(steps))  # at the ends of the steps
    pull = step * lower
    third = np.array([((steps - k) ** 3 - (steps - k - 1) ** 3) / 6 for k in range(steps)]) * step**3
    rows, limits = [speed, -speed, pull, -pull], [chain.speed - v0, chain.speed + v0, *[chain.acceleration] * 2]
    found = linprog(
        -third, A_ub=np.vstack(rows), b_ub=np.repeat(np.concatenate(limits), steps),
        A_eq=np.stack([pull[-1], speed[-1]]), b_eq=[0.0, v1 - v0], bounds=[(-chain.jerk[0], chain.jerk[0])] * steps,
    )  # fmt: skip
    return v0 * seconds - found.fun if found.success else -math.inf


@pytest.mark.parametrize("seed", range(2))
def test_no_jerk_within_the_limits_comes_as_far_in_less_time(seed: int) -> None:
    """A linear programme over all jerks that change in steps: it comes nearly as far, and in 3 % less time never."""
    chain, moved, v0, v1 = random_case(np.random.default_rng(seed), 1, at_rest=seed % 2 == 0)
    v0, v1, moved = (
        abs(v0),
        abs(v1),
        abs(moved) + chain.speed * own_phases(chain, np.zeros(1), np.zeros(1), 0 * v0).seconds,
    )
    moved = (
        moved + (v0 + v1) / 2 * SmoothAxis(0, v0[0], v1[0], chain.speed[0], chain.acceleration[0], chain.jerk[0]).direct
    )
    seconds = own_phases(chain, np.zeros(1), moved, v0, v1).seconds
    assert quickest_by_programme(chain, moved[0], v0[0], v1[0], 0.97 * seconds, 120) < moved[0]
    assert quickest_by_programme(chain, moved[0], v0[0], v1[0], 1.02 * seconds, 120) > moved[0]


def test_all_joints_in_common_phases_move_straight_and_one_of_them_is_at_a_limit() -> None:
    rng = np.random.default_rng(3)
    for _ in range(20):
        chain, moved, *_ = random_case(rng, 5, at_rest=True)
        found = common_phases(chain, np.zeros(5), moved)
        assert_smooth(chain, found, moved, np.zeros(5))
        way = found.at(np.linspace(0, found.seconds, 50))[0] / moved
        np.testing.assert_allclose(way, np.tile(way[:, :1], 5), atol=1e-9)
        straight = [1 / np.max(np.abs(moved) / limit) for limit in (chain.speed, chain.acceleration, chain.jerk)]
        assert found.seconds == pytest.approx(SmoothAxis(1.0, 0.0, 0.0, *straight).spans()[0][0], rel=1e-9)
        assert found.seconds >= own_phases(chain, np.zeros(5), moved).seconds * (1 - 1e-12)


def test_every_duration_that_is_said_to_be_possible_is() -> None:
    rng, gaps = np.random.default_rng(6), 0
    for _ in range(20):
        chain, _, v0, v1 = random_case(rng, 1)
        v0, v1 = abs(v0), abs(v1)
        move = chain, np.zeros(1), rng.uniform(1, 1.3) * ramps(chain, v0, v1), v0, v1
        spans = possible_seconds(*move)
        gaps += len(spans) > 1
        for low, high in spans:
            for seconds in (low, 0.5 * (low + min(high, low + 1)), min(high, 3 * low + 1)):
                assert_smooth(chain, own_phases(*move, seconds=seconds), move[2], move[4])
    assert gaps > 3


def test_blends_keep_the_limits_of_jerk_and_miss_by_no_more_than_allowed() -> None:
    rng = np.random.default_rng(7)
    for _ in range(2):
        chain = random_case(rng, 3)[0]
        points, allowed = rng.normal(size=(5, 3)), rng.uniform(0.01, 0.3, 3)
        found = blended(chain, points, allowed)
        assert_smooth(chain, found, points[-1], np.zeros(3))
        path = found.at(np.linspace(0, found.seconds, 4000))[0]
        for point in points[1:-1]:
            assert (np.abs(path - point) / allowed).max(axis=1).min() <= 1 + 1e-2
        free = blended(replace(chain, jerk=None), points, allowed)
        assert found.seconds > free.seconds
        assert blended(replace(chain, jerk=np.full(3, 1e12)), points, allowed).seconds == pytest.approx(
            free.seconds, rel=1e-3
        )


def test_a_joint_without_a_limit_beside_others_and_one_that_turns_back_between_its_ends() -> None:
    chain = arm([1.0, 2.0], [2.0, 3.0], [math.inf, 5.0])
    for law in (common_phases, own_phases, independent):
        found = law(chain, np.zeros(2), np.array([1.0, 0.2]))
        np.testing.assert_allclose(found.end, [1.0, 0.2], atol=1e-12)
        assert found.seconds == pytest.approx(1.5 if law is not common_phases else found.seconds)
    narrow = replace(arm([1.0], [1.0], [1.0]), upper=np.array([0.4]))
    back = own_phases(
        replace(narrow, upper=np.array([9.0])), np.zeros(1), np.zeros(1), np.array([0.8]), np.array([-0.8])
    )
    highest = back.at(np.linspace(0, back.seconds, 20001))[0].max()
    assert back.extremes[1][0] == pytest.approx(highest, rel=1e-7)
    with pytest.raises(Exception, match=r"beyond its limits of .* lower its speeds"):
        check_within(narrow, back)
