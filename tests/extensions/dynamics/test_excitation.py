"""Motions that show a load: what is predicted comes out, limits are kept, and the determinant is what counts."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from helpers.robots import VERSATRAN

from lab.core.errors import LabError
from lab.core.se3 import Array
from lab.extensions.dynamics.arm_simulation import CarryingArm, RigidLoad
from lab.extensions.dynamics.payload.excitation import (
    Box,
    FourierPath,
    Limits,
    PathSearch,
    _Walls,
    design_path,
    design_poses,
    random_path,
)
from lab.kinematics.dynamics.rigid_body import hand_motion, torque_regressor, wrench_regressor
from lab.kinematics.serial.serial_arm import SerialArm
from lab.pose_selection.criteria import criterion
from lab.pose_selection.exchange import information
from lab.robots.load_robot import load_virtual
from lab.simulation.collisions import collides, random_poses

TX40 = load_virtual("tx40").model
ARM = SerialArm(TX40.chain)
VALUES, DOWN = ARM.nominal(), np.array([0.0, 0.0, -9.81])
PEAK_NM = np.array([131.8, 131.8, 103.5, 46.1, 43.2, 30.7])
SIGMA_NM = np.sqrt(2) * 0.005 * PEAK_NM  # of a difference of two readings
LOAD = RigidLoad(1.5, np.array([0.010, -0.005, 0.060]), np.diag([22.5e-4, 26e-4, 12.5e-4]))
LIMITS = Limits.of(TX40.chain)
SENSOR = np.repeat([0.05, 0.002], 3)


def torques(joints: Array, speeds: Array, accelerations: Array) -> Array:
    return torque_regressor(ARM, VALUES, joints, speeds, accelerations, DOWN)


def static_torques(joints: Array, speeds: Array, accelerations: Array) -> Array:
    return torques(joints, speeds, accelerations)[:, :, :4]


def wrenches(joints: Array, speeds: Array, accelerations: Array) -> Array:
    """The ten parameters and a sensor's six offsets."""
    shown = wrench_regressor(hand_motion(ARM, VALUES, joints, speeds, accelerations), DOWN)
    return np.concatenate([shown, np.broadcast_to(np.eye(6), (len(joints), 6, 6))], axis=2)


def static_wrenches(joints: Array, speeds: Array, accelerations: Array) -> Array:
    return np.delete(wrenches(joints, speeds, accelerations), np.arange(4, 10), axis=2)


def touches_nothing(joints: Array) -> np.ndarray:
    return ~collides(TX40, joints)


def shown(path: FourierPath) -> float:
    """What a toy's path shows: the logarithm of the determinant of its information."""
    states = path.at(path.period_s * np.arange(1000) / 1000)
    return float(np.linalg.slogdet(information(toy_regressor(*states)))[1])


# Paths and limits


def test_a_path_derives_as_it_says() -> None:
    path = FourierPath(np.random.default_rng(0).normal(size=(11, 3)), 4.0)
    times = np.linspace(0, 9, 50)
    np.testing.assert_allclose(path.at(times)[0], path.at(times + 4.0)[0], atol=1e-12)
    stepped = path.at(times + 1e-30j)
    for order in (0, 1):
        np.testing.assert_allclose(path.at(times)[order + 1], stepped[order].imag / 1e-30, atol=1e-12)


@pytest.mark.parametrize("seed", range(5))
def test_random_paths_use_their_limits_and_keep_them(seed: int) -> None:
    path = random_path(LIMITS, np.random.default_rng(seed))
    joints, speeds, accelerations = path.at(np.linspace(0, 5, 1777))  # other times than the search looks at
    assert (joints >= LIMITS.lower - 1e-4).all() and (joints <= LIMITS.upper + 1e-4).all()
    largest = np.array(
        [np.abs(speeds).max(axis=0) / LIMITS.speed, np.abs(accelerations).max(axis=0) / LIMITS.acceleration]
    )
    assert (largest <= 1).all()
    span = np.ptp(joints, axis=0) / (LIMITS.upper - LIMITS.lower)
    np.testing.assert_allclose(np.maximum(span, largest.max(axis=0)), 1.0, atol=2e-3)


def test_limits_of_a_chain() -> None:
    np.testing.assert_allclose(LIMITS.speed, np.deg2rad([287, 287, 430, 410, 320, 700]))
    np.testing.assert_allclose(LIMITS.acceleration, LIMITS.speed / 0.3)
    assert np.isinf(LIMITS.torque).all()
    np.testing.assert_allclose(LIMITS.upper - LIMITS.lower, 0.96 * (TX40.chain.upper - TX40.chain.lower))
    given = replace(TX40.chain, acceleration=np.array([1.0, np.nan, 3, 4, 5, 6]))
    np.testing.assert_allclose(Limits.of(given).acceleration[:2], [1, LIMITS.acceleration[1]])
    assert (Limits.of(VERSATRAN).speed > 0).all()  # representative ones, where a robot says none
    with pytest.raises(LabError, match=r"a path's largest torque is .* give a number above zero"):
        Limits.of(TX40.chain, np.zeros(6))


# What is predicted


# The search


def toy_regressor(joints: Array, speeds: Array, accelerations: Array) -> Array:
    """Two rows, three parameters, nothing but made up."""
    (x, y), (v, w), (a, b) = joints.T, speeds.T, accelerations.T
    return np.stack([a + np.cos(x), v * w, np.sin(y), b, x * y + v, w + np.cos(x)], axis=1).reshape(-1, 2, 3)


TWO = np.ones(2)
TOY = Limits(-2 * TWO, 2 * TWO, 3 * TWO, 10 * TWO, np.inf * TWO)


def anywhere(joints: Array) -> np.ndarray:
    return np.ones(len(joints), dtype=bool)


def outside_a_disc(joints: Array) -> np.ndarray:
    return np.hypot(*(joints - 0.3).T) > 0.8


def toy(seed: int = 0, limits: Limits = TOY, feasible=anywhere, **options):
    rng = np.random.default_rng(seed)
    return design_path(toy_regressor, TWO, limits, feasible, rng, starts=2, rounds=8, **options)


@cache
def usual():
    """What most tests look at."""
    return toy()


@pytest.mark.parametrize("name", ["O1", "condition"])
def test_the_slope_of_the_score(name: str) -> None:
    allowed = lambda states: (np.ones(len(states), bool),) * 2  # noqa: E731
    whitened = lambda *motion: torques(*motion) / SIGMA_NM[:, None]  # noqa: E731
    search = PathSearch(whitened, criterion(name, 10), LIMITS.box, allowed, 5.0, np.eye(11))
    path = random_path(LIMITS, np.random.default_rng(4)).coefficients
    score, slope = search._slope(path)
    assert score == pytest.approx(search.score(path), rel=1e-12)
    for cell in ((0, 1), (2, 0), (5, 3), (7, 4), (10, 5)):
        step = np.zeros_like(path)
        step[cell] = 1e-5
        numeric = (search.score(path + step) - search.score(path - step)) / 2e-5
        assert slope[cell] == pytest.approx(numeric, rel=1e-4, abs=1e-4 * np.abs(slope).max())


def test_the_slope_of_the_walls() -> None:
    rng = np.random.default_rng(0)
    search = PathSearch(
        toy_regressor,
        criterion("O1", 3),
        Box(rng.normal(size=(3, 2)), rng.uniform(0.5, 2.0, (3, 2))),
        lambda s: s,
        5.0,
        np.eye(11),
    )
    walls = _Walls()
    for _ in range(2):
        walls.add(rng.integers(0, 1000, 7), rng.normal(size=(7, 3, 2)), rng.normal(size=7))
    path = rng.normal(size=(11, 2))
    slope = search._penalty(path, walls)[1]
    for cell in np.ndindex(path.shape):
        step = np.zeros_like(path)
        step[cell] = 1e-6
        numeric = (search._penalty(path + step, walls)[0] - search._penalty(path - step, walls)[0]) / 2e-6
        assert slope[cell] == pytest.approx(numeric, rel=1e-5, abs=1e-3)


@pytest.mark.thorough
def test_a_path_goes_around_what_is_forbidden() -> None:
    free, around = usual(), toy(feasible=outside_a_disc)
    times = np.linspace(0, 5, 2000)
    assert not outside_a_disc(free.at(times)[0]).all()  # else there is nothing to go around
    assert outside_a_disc(around.at(times)[0]).all()
    drawn = [random_path(TOY, np.random.default_rng(i)) for i in range(200)]
    allowed = [path for path in drawn if outside_a_disc(path.at(times)[0]).all()]
    assert max(map(shown, allowed)) < shown(around) <= shown(free) + 0.2


@pytest.mark.thorough
def test_torques_are_kept() -> None:
    """A made-up torque that speed and acceleration of both joints raise, below a limit that the free path passes."""

    def torque(joints: Array, speeds: Array, accelerations: Array) -> Array:
        return accelerations + accelerations[:, ::-1] / 2 + speeds**2 + 3 * np.cos(joints)

    times = np.linspace(0, 5, 2000)
    free, held = usual(), toy(limits=replace(TOY, torque=np.array([6.0, 7.0])), torque=torque)
    assert (np.abs(torque(*free.at(times))).max(axis=0) > [6.0, 7.0]).all()
    assert (np.abs(torque(*held.at(times))).max(axis=0) <= np.array([6.0, 7.0]) + 1e-3).all()
    assert shown(held) < shown(free)


def test_limits_are_kept_on_other_times_than_those_looked_at() -> None:
    joints, speeds, accelerations = usual().at(np.linspace(0, 5, 1777))
    assert np.abs(joints).max() <= 2 + 1e-4 and np.abs(speeds).max() <= 3 and np.abs(accelerations).max() <= 10


def test_what_cannot_be_designed() -> None:
    with pytest.raises(LabError, match="torques are limited, but unknown"):
        toy(limits=replace(TOY, torque=TWO))
    with pytest.raises(LabError, match="none of 200 random paths keeps free of contacts and within the torques"):
        toy(feasible=lambda joints: ~anywhere(joints))
    still = np.ones((1, 2, 3)) * np.arange(3)
    with pytest.raises(LabError, match="does not show every parameter; let more joints move"):
        design_path(lambda q, v, a: np.repeat(still, len(q), axis=0), TWO, TOY, anywhere, np.random.default_rng(0))
    with pytest.raises(LabError, match=r"only 0 of 2000 random poses are allowed, 20 asked for"):
        design_poses(static_torques, SIGMA_NM, 20, LIMITS, lambda q: ~anywhere(q), np.random.default_rng(0))
    with pytest.raises(LabError, match="1 poses cannot show 10 parameters: ask for 2 or more"):
        design_poses(static_wrenches, SENSOR, 1, LIMITS, touches_nothing, np.random.default_rng(0))


def test_static_poses_keep_the_torques() -> None:
    arm, rest = CarryingArm(TX40, DOWN, LOAD), np.zeros((1, 6))
    weak = replace(LIMITS, torque=np.array([50.0, 20.0, 50, 50, 50, 50]))
    best = design_poses(
        static_torques, SIGMA_NM, 6, weak, touches_nothing, np.random.default_rng(0), torque=arm.torques
    )
    held = arm.torques(best, *(np.repeat(rest, 6, axis=0),) * 2)
    assert (np.abs(held) <= weak.torque).all()


def test_designed_poses_show_more_than_random_ones() -> None:
    """By the determinant; the mass is known to a tenth of a per cent and better by a sensor with unknown offsets."""
    rng = np.random.default_rng(0)

    def information_of(joints: Array) -> Array:
        return information(static_wrenches(joints, 0 * joints, 0 * joints) / SENSOR[:, None])

    best = design_poses(static_wrenches, SENSOR, 20, LIMITS, touches_nothing, rng)
    drawn = [random_poses(TX40, 20, rng) for _ in range(50)]
    scores = [np.linalg.slogdet(information_of(joints))[1] for joints in (best, *drawn)]
    assert scores[0] > max(scores[1:]) and touches_nothing(best).all()
    assert np.sqrt(np.linalg.inv(information_of(best))[0, 0]) < 0.00085 * LOAD.mass_kg
