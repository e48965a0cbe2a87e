"""The load's regressor against MuJoCo, against differences of the kinematics, and against energy."""

from dataclasses import replace

import numpy as np
import pytest
from helpers.dynamics import inverse_dynamics
from helpers.robots import RX130, chain_of
from numpy.testing import assert_allclose

from lab.core import se3
from lab.core.errors import LabError
from lab.core.se3 import Array
from lab.kinematics.dynamics.gravity import Loads
from lab.kinematics.dynamics.rigid_body import (
    LOAD,
    hand_jacobian,
    hand_motion,
    inertia_about_centre,
    is_physical,
    load_of,
    pseudo_inertia,
    symmetric,
    torque_regressor,
)
from lab.kinematics.serial.chain import Chain
from lab.kinematics.serial.serial_arm import SerialArm
from lab.robots.load_robot import load_robot, load_virtual

GRAVITY = np.array([0.0, 0.0, -9.81])
OBLIQUE = np.array([1.5, -4.0, -8.8])
STEP = 1e-3  # s, of five-point differences: truncated at 1e-10 of the fourth derivative, rounded at 1e-10
SLIDES = chain_of("slides", "craig", "PRPRRP", [0, 80, -90, 0, 70, -50], [0, 0.1, 0.2, -0.3, 0.1, 0.05],
                  [10, -20, 30, 40, -50, 60], [0.1, 0.2, 0.3, -0.2, 0.1, 0.15])  # fmt: skip
CHAINS = {
    "distal": load_robot("irb120").chain,
    "craig": RX130,
    "slides": replace(SLIDES, sign=np.array([1.0, -1, -1, 1, -1, 1])),
    "slides, distal": replace(SLIDES, convention="distal", sign=np.array([-1.0, 1, 1, -1, 1, -1])),
}


def arm_of(name: str) -> tuple[SerialArm, Array]:
    """An arm whose table, with Hayati's angles, and whose base are off the drawing."""
    arm = SerialArm(CHAINS[name])
    return arm, arm.nominal() + np.random.default_rng(3).normal(0, 0.05, len(arm.names))


def moving(chain: Chain, count: int, seed: int) -> tuple[Array, Array, Array]:
    rng = np.random.default_rng(seed)
    return chain.random_joints(count, rng), *rng.normal(0, 2, (2, count, chain.size))


def along(motion: tuple[Array, Array, Array], time: float) -> tuple[Array, Array]:
    """Readings and speeds a moment later, at constant accelerations."""
    q, speed, acceleration = motion
    return q + time * (speed + time / 2 * acceleration), speed + time * acceleration


def rate(function, motion: tuple[Array, Array, Array]) -> Array:
    """The derivative in time of a function of readings and speeds, by five-point differences."""
    ahead, behind, far, away = (function(*along(motion, k * STEP)) for k in (1, -1, 2, -2))
    return (8 * (ahead - behind) - (far - away)) / (12 * STEP)


def test_ten_unit_loads_through_mujoco_give_the_regressor():
    robot = load_virtual("tx40").model
    arm = SerialArm(robot.chain)
    motion = moving(robot.chain, 50, 1)
    regressor = torque_regressor(arm, arm.nominal(), *motion, GRAVITY)
    body = load_of(1.0, np.zeros(3), 2 * np.eye(3))
    base, without = (inverse_dynamics(robot, load, motion) for load in (body, None))
    assert_allclose(base - without, regressor @ body, rtol=0, atol=1e-12)
    for unit, name in enumerate(LOAD):
        more = body + np.eye(10)[unit]
        more_torque = inverse_dynamics(robot, more, motion) - base
        assert_allclose(more_torque, regressor[:, :, unit], rtol=0, atol=1e-12, err_msg=name)


@pytest.mark.parametrize("name", CHAINS)
def test_the_motion_of_the_hand_is_what_differences_of_its_pose_say(name):
    arm, values = arm_of(name)
    alone = np.concatenate([np.zeros(6), values[6:]])  # frame 0 is the tracker's
    motion = moving(arm.chain, 30, 2)
    hand = hand_motion(arm, values, *motion)
    poses = arm.flange(motion[0], alone)
    assert_allclose(hand.rotation, poses[:, :3, :3], atol=1e-14)

    def turned(q: Array, _: Array) -> Array:
        return se3.log(np.swapaxes(poses[:, :3, :3], 1, 2) @ arm.flange(q, alone)[:, :3, :3])

    def velocity(q: Array, speed: Array) -> Array:
        jacobian = hand_jacobian(arm, values, q)
        return np.einsum("nij,nj->ni", jacobian, speed)

    def in_frame0(q: Array, speed: Array) -> Array:
        halves = velocity(q, speed).reshape(-1, 2, 3)
        return np.einsum("nij,nhj->nhi", arm.flange(q, alone)[:, :3, :3], halves)

    assert_allclose(hand.omega, rate(turned, motion), atol=1e-8)
    assert_allclose(hand.omega, velocity(*motion[:2])[:, 3:], atol=1e-13)
    speed = np.einsum("nji,nj->ni", hand.rotation, rate(lambda q, _: arm.flange(q, alone)[:, :3, 3], motion))
    assert_allclose(velocity(*motion[:2])[:, :3], speed, atol=1e-8)
    felt = np.einsum("nji,nhj->nhi", hand.rotation, rate(in_frame0, motion))
    assert_allclose(hand.acceleration, felt[:, 0], atol=1e-7)
    assert_allclose(hand.alpha, felt[:, 1], atol=1e-7)


@pytest.mark.parametrize("name", CHAINS)
def test_the_work_of_the_joints_is_what_the_load_gains_in_energy(name):
    arm, values = arm_of(name)
    motion = moving(arm.chain, 30, 4)
    phi = load_of(1.5, np.array([0.1, -0.05, 0.2]), symmetric(np.array([0.02, 0.03, 0.025, 0.004, -0.003, 0.002])))

    def energy(q: Array, speed: Array) -> Array:
        hand = hand_motion(arm, values, q, speed, np.zeros_like(q))
        v = np.einsum("nij,nj->ni", hand_jacobian(arm, values, q), speed)[:, :3]
        poses = arm.flange(q, np.concatenate([np.zeros(6), values[6:]]))
        kinetic = phi[0] * (v * v).sum(1) / 2 + (v * np.cross(hand.omega, phi[1:4])).sum(1)
        kinetic += np.einsum("ni,ij,nj->n", hand.omega, symmetric(phi[4:]), hand.omega) / 2
        return kinetic - (phi[0] * poses[:, :3, 3] + poses[:, :3, :3] @ phi[1:4]) @ OBLIQUE

    power = (torque_regressor(arm, values, *motion, OBLIQUE) @ phi * motion[1]).sum(axis=1)
    assert_allclose(power, rate(energy, motion), atol=1e-6)


def test_a_point_mass_at_rest_weighs_what_gravity_s_own_equations_say():
    chain = CHAINS["slides"]
    arm, loads = SerialArm(chain), Loads(chain, np.zeros(6), np.zeros((6, 3)), OBLIQUE)
    joints = chain.random_joints(20, np.random.default_rng(5))
    still = np.zeros_like(joints)
    regressor = torque_regressor(arm, arm.nominal(), joints, still, still, OBLIQUE)
    assert_allclose(regressor[:, :, 0], -loads.forces(joints, np.ones(20))[0], atol=1e-13)
    assert not regressor[:, :, 4:].any()


def test_a_pseudo_inertia_is_positive_for_bodies_alone():
    rng = np.random.default_rng(7)
    for _ in range(100):
        points, masses = rng.normal(0, 0.1, (5, 3)), rng.uniform(0.1, 1, 5)
        centre = masses @ points / masses.sum()
        inner = sum(m * ((p @ p) * np.eye(3) - np.outer(p, p)) for m, p in zip(masses, points - centre, strict=True))
        phi = load_of(masses.sum(), centre, inner)
        assert is_physical(phi)
        assert_allclose(inertia_about_centre(phi), inner, atol=1e-14)
        assert_allclose(pseudo_inertia(phi)[:3, :3], (masses * points.T) @ points, atol=1e-14)
        longest = np.linalg.eigvalsh(inner)[-1]
        flat = load_of(masses.sum(), centre, inner - 1.01 * (np.trace(inner) / 2 - longest) * np.eye(3) * 2)
        assert not is_physical(flat)
    assert not is_physical(-phi)


def test_shapes_that_do_not_fit_are_refused():
    arm = SerialArm(RX130)
    zero = np.zeros((4, 6))
    with pytest.raises(LabError, match=r"joints of shape \(4, 5\)"):
        hand_motion(arm, arm.nominal(), zero[:, :5], zero, zero)
    with pytest.raises(LabError, match="a row a sample"):
        hand_motion(arm, arm.nominal(), zero, zero[:2], zero)
