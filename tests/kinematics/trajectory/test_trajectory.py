"""Time laws of the joints: against the course, against ruckig, against brute force, and within every limit."""

import math
from dataclasses import replace

import numpy as np
import pytest
import ruckig
from helpers.robots import chain_of

from lab.core.errors import LabError
from lab.core.se3 import Array
from lab.kinematics.serial.chain import Chain
from lab.kinematics.trajectory.profiles import (
    Axis,
    Trajectory,
    joined,
    possible_spans,
    quickest_ramps,
    rest_to_rest,
    rest_to_rest_seconds,
)
from lab.kinematics.trajectory.trajectory import (
    blended,
    common_phases,
    own_phases,
    through,
)

WIDE = 1e4  # rad: limits that no overshoot reaches


def arm(speed, acceleration, lower=-WIDE, upper=WIDE, kinds: str | None = None) -> Chain:
    """A chain of which only the limits matter."""
    n = len(speed)
    chain = chain_of(
        "arm", "craig", kinds or "R" * n, [0] * n, [0.1] * n, [0] * n, [0] * n, np.full(n, lower), np.full(n, upper)
    )
    return replace(chain, speed=np.array(speed, float), acceleration=np.array(acceleration, float))


LIMITED = arm([1.0, 2.0], [3.0, 4.0], -1.0, 1.0, "RP")


def random_limits(rng: np.random.Generator, n: int) -> tuple[Array, Array]:
    """Largest speeds and accelerations over two and two and a half decades."""
    return 10 ** rng.uniform(-1, 1, n), 10 ** rng.uniform(-1, 1.5, n)


def random_speeds(rng: np.random.Generator, speed: Array) -> Array:
    """Any, standing still, or as fast as a joint goes."""
    kind, free = rng.uniform(size=speed.shape), rng.uniform(-1, 1, speed.shape)
    return speed * np.where(kind < 0.2, 0.0, np.where(kind > 0.9, np.sign(free), free))


def random_moves(rng: np.random.Generator, n: int) -> Array:
    return rng.normal(size=n) * 10 ** rng.uniform(-2, 0.5, n)


def assert_arrives(chain: Chain, found: Trajectory, end: Array, end_speed: Array) -> None:
    """It ends where and how it should, and no limit is broken."""
    np.testing.assert_allclose(found.end, end, rtol=0, atol=1e-9)
    np.testing.assert_allclose(found.end_speed, end_speed, rtol=0, atol=1e-9)
    assert (found.peaks[0] <= chain.speed * (1 + 1e-9)).all()
    assert (np.abs(found.accelerations) <= chain.acceleration * (1 + 1e-9)).all()
    assert found.durations.min() > 1e-12 * found.seconds  # no phase that only rounding has made


# Example 10.3 of the course


def two_hinges() -> Chain:
    return arm(np.radians([171.9, 171.9]), np.radians([50.0, 50.0]), -np.pi, np.pi)


def by_place(x: float, y: float, z: float) -> tuple[float, float]:
    """Readings of the two hinges: x = L2 c2 c1, y = L2 c2 s1, z = L1 + L2 s2, with L1 = 0.5 m and L2 = 1 m."""
    return math.atan2(y, x), math.asin(z - 0.5)


def by_velocity(joints: tuple[float, float], velocity: Array) -> Array:
    (c1, c2), (s1, s2) = np.cos(joints), np.sin(joints)
    jacobian = np.array([[-c2 * s1, -s2 * c1], [c2 * c1, -s2 * s1], [0.0, c2]])
    return np.linalg.lstsq(jacobian, velocity, rcond=None)[0]


@pytest.mark.parametrize("law", [common_phases, own_phases])
def test_example_through_a_point_at_a_speed(law) -> None:
    side = math.sqrt(3) / 2
    points = np.array([by_place(side, 0, 0), by_place(0, 1, 0.5), by_place(side, 0, 1)])
    np.testing.assert_allclose(np.degrees(points), [[0, -30], [90, 0], [0, 30]], atol=1e-12)
    speeds = np.array([np.zeros(2), by_velocity(points[1], np.array([0, 0, 0.2])), np.zeros(2)])
    assert np.degrees(speeds[1]) == pytest.approx([0, 11.459], abs=1e-3)
    found = through(two_hinges(), points, speeds, law)
    assert found.seconds == pytest.approx(5.36656, abs=1e-5)
    assert np.degrees(found.peaks[0][0]) == pytest.approx(67.08, abs=5e-3)
    readings, passing, _ = found.at(np.array([found.seconds / 2]))
    np.testing.assert_allclose([readings[0], passing[0]], [points[1], speeds[1]], atol=1e-12)
    assert_arrives(two_hinges(), found, points[2], speeds[2])
    if law is common_phases:
        np.testing.assert_allclose(found.durations, 4 * [1.34164], atol=1e-5)
        printed = [[50, 12.3961], [-50, -3.8549], [-50, 3.8549], [50, -12.3961]]
        np.testing.assert_allclose(np.degrees(found.accelerations), printed, atol=5e-5)


# Phases of each joint's own


def ruckig_seconds(moved: Array, start_speed: Array, end_speed: Array, speed: Array, acceleration: Array) -> float:
    """The duration that ruckig finds without a limit of jerk."""
    n = len(moved)
    generator, asked, found = ruckig.Ruckig(n), ruckig.InputParameter(n), ruckig.Trajectory(n)
    asked.current_position, asked.target_position = [0.0] * n, moved.tolist()
    asked.current_velocity, asked.target_velocity = start_speed.tolist(), end_speed.tolist()
    asked.max_velocity, asked.max_acceleration, asked.max_jerk = speed.tolist(), acceleration.tolist(), [math.inf] * n
    assert generator.calculate(asked, found).value >= 0
    return found.duration


def test_moves_of_six_joints_last_as_long_as_ruckigs() -> None:
    rng = np.random.default_rng(1)
    waited = 0
    for i in range(100):
        chain, moved = arm(*random_limits(rng, 6)), random_moves(rng, 6)
        ends = random_speeds(rng, chain.speed), random_speeds(rng, chain.speed)
        if i % 2:  # all in one direction, where gaps between the possible durations are common
            moved, ends = abs(moved), (abs(ends[0]), abs(ends[1]))
        found = own_phases(chain, np.zeros(6), moved, *ends)
        assert found.seconds == pytest.approx(ruckig_seconds(moved, *ends, chain.speed, chain.acceleration), abs=1e-9)
        alone = [own_phases(chain_j, *move).seconds for chain_j, *move in each_joint(chain, moved, *ends)]
        waited += found.seconds > max(alone) + 1e-9
    assert waited > 2  # the slowest joint's own time was impossible for another one


def each_joint(chain: Chain, moved: Array, *ends: Array) -> list:
    """The same move, joint by joint."""
    return [
        (arm(chain.speed[[j]], chain.acceleration[[j]]), np.zeros(1), moved[[j]], *(end[[j]] for end in ends))
        for j in range(chain.size)
    ]


def test_possible_durations_of_the_example() -> None:
    """A distance of 1 from speed 2 to speed 2, within speed 3 and acceleration 1."""
    spans = possible_spans([Axis(1.0, 2.0, 2.0, 3.0, 1.0)])
    expected = [(-4 + math.sqrt(20), 4 - math.sqrt(12)), (4 + math.sqrt(12), math.inf)]
    np.testing.assert_allclose(spans, expected, rtol=1e-14)


def test_possible_durations_are_those_in_which_the_move_can_be_reached() -> None:
    rng = np.random.default_rng(2)
    both = 0
    for _ in range(150):
        moved, (speed, acceleration) = random_moves(rng, 1), random_limits(rng, 1)
        v0, vf = random_speeds(rng, speed), random_speeds(rng, speed)
        chain = arm(speed, acceleration)
        spans = np.array(possible_spans([Axis(*(float(x[0]) for x in (moved, v0, vf, speed, acceleration)))]))
        both += len(spans) == 2
        for T in spans[np.isfinite(spans)].max() * rng.uniform(0, 1.2, 20):
            reach = [reached(T, v0, vf, chain, sign) for sign in (-1, 1)]
            possible = abs(vf - v0) <= acceleration * T and reach[0] <= moved <= reach[1]
            assert ((spans[:, 0] <= T) & (spans[:, 1] >= T)).any() == possible
    assert both > 1


def reached(T: float, v0: Array, vf: Array, chain: Chain, sign: int) -> Array:
    """How far a joint comes at most in T, or back for the sign -1: at the largest cruise speed it has time for."""
    w = np.clip(0.5 * (v0 + vf + sign * chain.acceleration * T), -chain.speed, chain.speed)
    t1, t3 = abs(w - v0) / chain.acceleration, abs(w - vf) / chain.acceleration
    return 0.5 * (v0 + w) * t1 + w * (T - t1 - t3) + 0.5 * (w + vf) * t3


# Phases in common


def lowest_on_a_grid(moved: Array, v0: Array, vf: Array, speed: Array, acceleration: Array, seconds: float) -> float:
    """The least u + tau of a grid at which no limit is broken."""
    tau = np.linspace(0, 0.6 * seconds, 120)[1:, None, None]
    u = np.linspace(0, 1.05 * seconds, 240)[None, 1:, None]
    w = (moved - 0.5 * (v0 + vf) * tau) / u
    kept = (np.abs(w) <= speed) & (np.abs(w - v0) <= acceleration * tau) & (np.abs(w - vf) <= acceleration * tau)
    total = np.where(kept.all(axis=2) & (u >= tau)[..., 0], (tau + u)[..., 0], math.inf)
    return float(total.min())


def test_common_phases_are_the_best() -> None:
    rng = np.random.default_rng(4)
    near = 0
    for _ in range(50):
        n = int(rng.integers(1, 5))
        moved, (speed, acceleration) = random_moves(rng, n), random_limits(rng, n)
        v0, vf = random_speeds(rng, speed), random_speeds(rng, speed)
        found = sum(quickest_ramps(moved, v0, vf, speed, acceleration))
        grid = lowest_on_a_grid(moved, v0, vf, speed, acceleration, found)
        assert found <= grid * (1 + 1e-12)
        near += grid < 1.02 * found
    assert near > 25  # the grid is fine enough to say something


def test_at_rest_the_closed_form_is_the_best() -> None:
    rng = np.random.default_rng(6)
    still = np.zeros(6)
    for _ in range(50):
        moved, (speed, acceleration) = random_moves(rng, 6), random_limits(rng, 6)
        tau, u = rest_to_rest(moved, speed, acceleration)
        assert u == pytest.approx(max((abs(moved) / speed).max(), math.sqrt((abs(moved) / acceleration).max())))
        np.testing.assert_allclose(quickest_ramps(moved, still, still, speed, acceleration), [tau, u], rtol=1e-12)
        chain = arm(speed, acceleration)
        found = common_phases(chain, still, moved)
        slow = common_phases(chain, still, moved, 1e-11 * speed)
        assert found.seconds == pytest.approx(tau + u, rel=1e-12)
        assert slow.seconds == pytest.approx(found.seconds, rel=1e-8)
        times = np.linspace(0, found.seconds, 20)
        share = found.at(times)[0] / moved
        np.testing.assert_allclose(share, np.repeat(share[:, :1], 6, axis=1), atol=1e-12)  # a straight line


def test_seconds_of_many_moves_at_once() -> None:
    rng = np.random.default_rng(7)
    points = rng.uniform(-2, 2, (20, 6))
    speed, acceleration = random_limits(rng, 6)
    chain = arm(speed, acceleration)
    cost = rest_to_rest_seconds(points[:, None] - points, speed, acceleration)
    assert cost.shape == (20, 20) and (np.diag(cost) == 0).all()
    expected = [[common_phases(chain, start, end).seconds for start in points] for end in points]
    np.testing.assert_allclose(cost, expected, rtol=1e-12)
    assert rest_to_rest_seconds(np.zeros(6), speed, acceleration) == 0
    with pytest.raises(LabError, match="joint 2: its largest acceleration is nan"):
        rest_to_rest_seconds(points, speed, np.where(np.arange(6) == 1, np.nan, acceleration))


# Limits and ends of every kind of move


@pytest.mark.parametrize("law", [common_phases, own_phases])
def test_via_points_are_passed_at_their_speeds(law) -> None:
    rng = np.random.default_rng(9)
    chain, points = arm(*random_limits(rng, 6)), rng.uniform(-3, 3, (30, 6))
    speeds = random_speeds(rng, np.tile(chain.speed, (30, 1)))
    found = through(chain, points, speeds, law)
    assert_arrives(chain, found, points[-1], speeds[-1])
    parts = [law(chain, *points[i : i + 2], *speeds[i : i + 2]).seconds for i in range(29)]
    readings, passing, _ = found.at(np.append(0.0, np.cumsum(parts)))
    np.testing.assert_allclose(readings, points, atol=1e-9)
    np.testing.assert_allclose(passing, speeds, atol=1e-9)


def test_readings_speeds_and_accelerations_fit() -> None:
    rng = np.random.default_rng(10)
    chain, points = arm(*random_limits(rng, 6)), rng.uniform(-3, 3, (5, 6))
    found = through(chain, points, random_speeds(rng, np.tile(chain.speed, (5, 1))), own_phases)
    knots, times = found.knots[0], rng.uniform(0, found.seconds, 2000)
    h = 1e-5 * found.seconds
    times = times[np.abs(times[:, None] - knots).min(axis=1) > h]
    assert len(times) > 1000
    (before, slow, _), (_, speed, acceleration), (after, fast, _) = (found.at(times + k * h) for k in (-1, 0, 1))
    np.testing.assert_allclose((after - before) / (2 * h), speed, rtol=0, atol=1e-8 * chain.speed.max())
    np.testing.assert_allclose((fast - slow) / (2 * h), acceleration, rtol=0, atol=1e-8 * chain.acceleration.max())
    outside = found.at(np.array([-1.0, 0.0, found.seconds, found.seconds + 1]))
    for values in outside:
        np.testing.assert_array_equal(values[0], values[1])
        np.testing.assert_array_equal(values[2], values[3])
    np.testing.assert_array_equal(outside[0][[0, 2]], [found.start, found.end])
    lowest, highest = found.extremes
    sampled = found.at(np.linspace(0, found.seconds, 20_000))[0]
    assert (lowest <= sampled).all() and (highest >= sampled).all()
    np.testing.assert_allclose([sampled.min(axis=0), sampled.max(axis=0)], [lowest, highest], atol=1e-5)


# Blends


def test_a_blend_misses_its_via_point_by_what_is_allowed() -> None:
    chain = arm([1.0, 2.0], [50.0, 50.0])
    points = np.array([[0.0, 0.0], [1.0, 1.0], [2.0, -1.0], [1.0, -3.0]])
    allowed = np.array([0.01, 0.02])
    found = blended(chain, points, allowed)
    knots, _, speeds = found.knots
    assert len(found.durations) == 7  # blends and stretches in turns
    for i in (1, 2):
        middle = 0.5 * (knots[2 * i] + knots[2 * i + 1])
        miss = np.abs(found.at(np.array([middle]))[0][0] - points[i]) / allowed
        assert miss.max() == pytest.approx(1.0, rel=1e-12)
        change = np.abs(speeds[2 * i + 1] - speeds[2 * i])
        assert found.durations[2 * i] == pytest.approx((8 * allowed / change).min(), rel=1e-12)
    np.testing.assert_array_equal(found.accelerations[1::2], 0.0)
    np.testing.assert_array_equal(speeds[0], 0.0)
    assert_arrives(chain, found, points[-1], np.zeros(2))


# What is refused


@pytest.mark.parametrize(
    ("move", "said"),
    [
        (([0, 0], [0.5, 1.2]), r"the end: joint q2 is at 1200 mm, beyond its limits of −1000 mm to 1000 mm"),
        (([-1.5, 0], [0, 0]), r"the start: joint q1 is at −85.9437°, beyond its limits of −57.2958° to 57.2958°"),
        (([0, 0, 0], [0, 0]), r"the start: readings have shape \(3,\); give 2 of them"),
        (([0, 0], [math.nan, 0]), r"the end: readings are not all finite"),
        (([0, 0], [0, 0], [1.1, 0]), r"the start: joint q1 is to move at 63.0254°/s; its largest speed is 57.2958°/s"),
        (([0, 0], [0, 0], [0, 0], [0, -3]), r"the end: joint q2 is to move at −3000 mm/s; .* 2000 mm/s"),
        (([0, 0], [0, 0], [0, 0], [0]), r"the end: speeds have shape \(1,\)"),
        (([0, 0], [0, 0], [0, math.inf]), r"the start: speeds are not all finite"),
        (([0, 0.9], [0, 0.9], [0, 1], [0, -1]), r"on its way from 900 mm to 900 mm joint q2 is at 1025 mm, beyond"),
    ],
)  # fmt: skip
@pytest.mark.parametrize("law", [common_phases, own_phases])
def test_a_move_that_cannot_be_is_refused(law, move, said: str) -> None:
    with pytest.raises(LabError, match=said) as refused:
        law(LIMITED, *(np.array(values, float) for values in move))
    assert "\n" not in str(refused.value)


@pytest.mark.parametrize("what", ["speed", "acceleration"])
@pytest.mark.parametrize("value", [0.0, -1.0, math.nan, math.inf])
def test_a_rate_that_cannot_be_is_refused(what: str, value: float) -> None:
    chain = replace(LIMITED, **{what: np.array([1.0, value])})
    points = np.array([[0.0, 0.0], [0.5, 0.5]])
    for law in (common_phases, own_phases, lambda chain, *points: blended(chain, points, 0.1)):
        with pytest.raises(LabError, match=f"joint q2: its largest {what} is {value:g}; give a finite one above zero"):
            law(chain, *points)


def test_paths_that_cannot_be_are_refused() -> None:
    points = np.array([[0.0, 0.0], [0.5, 0.5], [0.5, 0.5]])
    with pytest.raises(LabError, match="1 points and 1 speeds"):
        through(LIMITED, points[:1], points[:1])
    with pytest.raises(LabError, match="3 points and 2 speeds"):
        through(LIMITED, points, points[:2])
    with pytest.raises(LabError, match=r"via point 1: joint q1 is at 114.592°"):
        through(LIMITED, points * [[1], [4], [1]], 0 * points)
    with pytest.raises(LabError, match="via point 1 and the end are the same; leave one out"):
        blended(LIMITED, points, 0.1)
    for error in (0.0, -1.0, math.nan, math.inf, np.ones(3)):
        with pytest.raises(LabError, match="the error at via points is"):
            blended(LIMITED, points[:2], error)


def test_trajectories_that_do_not_fit_are_not_joined() -> None:
    first = own_phases(LIMITED, np.zeros(2), np.array([0.5, 0.2]))
    back = own_phases(LIMITED, np.array([0.5, 0.2]), np.zeros(2))
    both = joined([first, back])
    assert both.seconds == pytest.approx(first.seconds + back.seconds)
    np.testing.assert_allclose(both.end, 0, atol=1e-12)
    with pytest.raises(LabError, match=r"trajectory 2 begins where joint 1 has a reading of 0, but .* ends at 0.5"):
        joined([first, first])
    moving = replace(back, start_speed=np.array([0.0, 0.1]))
    with pytest.raises(LabError, match=r"trajectory 2 begins where joint 2 has a speed of 0.1"):
        joined([first, moving])
