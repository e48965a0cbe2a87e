"""Forward kinematics and its derivatives: against MuJoCo, the literature's numbers, and complex steps."""

import numpy as np
import pytest
from helpers.robots import (
    IRB120,
    RX130,
    SCARA,
    SCEMI,
    TX40,
    VERSATRAN,
    assert_derivatives,
    perturbed,
    somewhere,
)

from lab.core import se3
from lab.core.errors import LabError
from lab.core.se3 import Array
from lab.kinematics.serial.chain import Chain
from lab.kinematics.serial.serial_arm import SerialArm
from lab.robots.load_robot import load_robot

CHAINS = {chain.name: chain for chain in (IRB120.chain, RX130, TX40, SCEMI, VERSATRAN, SCARA)}


def chain_named(name: str) -> Chain:
    return CHAINS[name] if name in CHAINS else load_robot(name).chain


NAMES = [*CHAINS, "panda", "ur10"]


def test_forward_kinematics_as_printed() -> None:
    """Thesis, section III.2: both cases hold exactly."""
    arm = SerialArm(IRB120.chain)
    poses = arm.flange(np.deg2rad([[0, 0, 0, 0, 0, 0], [0, 0, -90, -90, 90, -90]]), arm.nominal())
    np.testing.assert_allclose(poses[0, :3, 3], [0.374, 0, 0.630], atol=1e-15)
    np.testing.assert_allclose(poses[0, :3, :3], [[0, 0, 1], [0, 1, 0], [-1, 0, 0]], atol=1e-15)
    np.testing.assert_allclose(poses[1, :3, 3], [-0.070, -0.072, 0.862], atol=1e-15)
    np.testing.assert_allclose(poses[1, :3, :3], [[-1, 0, 0], [0, 0, -1], [0, -1, 0]], atol=1e-15)


@pytest.mark.parametrize("name", NAMES)
def test_kinematics_is_the_product_of_its_matrices(name: str) -> None:
    """An independent second way: 4x4 matrices multiplied in the order that each convention states."""
    chain = chain_named(name)
    arm = SerialArm(chain, ("p1", "p2"))
    rng = np.random.default_rng(1)
    values = perturbed(arm, somewhere(arm, rng), rng, 0.01, 0.02)
    base, table, tool = arm.split(values)
    for joints in chain.random_joints(20, rng):
        T = se3.pose(se3.exp(base[3:]), base[:3])
        for i, (theta, d, a, alpha, beta) in enumerate(table):
            turn, slide = (0.0, joints[i]) if chain.prismatic[i] else (joints[i], 0.0)
            z = _screw(2, theta + turn * chain.sign[i], d + slide * chain.sign[i])
            x, y = _screw(0, alpha, a), _screw(1, beta, 0.0)
            T = T @ (z @ x @ y if chain.convention == "distal" else x @ y @ z)
        np.testing.assert_allclose(arm.flange(joints[None], values)[0], T, atol=1e-14)
        np.testing.assert_allclose(arm.points(joints[None], values)[0], se3.transform(T, tool), atol=1e-14)


def _screw(axis: int, angle: float, length: float) -> Array:
    return se3.pose(se3.exp(angle * np.eye(3)[axis]), length * np.eye(3)[axis])


@pytest.mark.parametrize("name", NAMES)
def test_derivatives(name: str) -> None:
    """By all parameters and by the joints, at a base anywhere and links off nominal."""
    chain = chain_named(name)
    arm = SerialArm(chain, ("p1", "p2"))
    rng = np.random.default_rng(2)
    values = perturbed(arm, somewhere(arm, rng), rng, 0.01, 0.02)
    joints = chain.random_joints(5, rng)
    points, jacobian = arm.observe(joints, values)
    np.testing.assert_array_equal(points, arm.points(joints, values))
    assert_derivatives(lambda v: arm.points(joints, v), jacobian, values)
    for pose, reading in enumerate(joints):
        derivative = arm.joint_jacobian(joints, values)[pose]
        assert_derivatives(lambda q: arm.points(q[None], values)[0], derivative, reading)


def test_derivatives_of_a_joint_that_counts_backwards() -> None:
    chain = Chain(**{**RX130.__dict__, "sign": np.array([1.0, -1, 1, -1, 1, 1])})
    arm = SerialArm(chain)
    values, joints = arm.nominal(), chain.random_joints(3, np.random.default_rng(3))
    derivative = arm.joint_jacobian(joints, values)[0]
    assert_derivatives(lambda q: arm.points(q[None], values)[0], derivative, joints[0])
    mirrored = SerialArm(RX130).points(joints * chain.sign, values)
    np.testing.assert_array_equal(arm.points(joints, values), mirrored)


def test_batches_do_not_depend_on_their_size() -> None:
    """Chunks are an inner matter: the same bits for one pose and for thousands."""
    arm = SerialArm(IRB120.chain, ("p1", "p2", "p3"))
    values, joints = arm.nominal(), IRB120.chain.random_joints(3000, np.random.default_rng(5))
    points, jacobian = arm.observe(joints, values)
    for pose in (0, 682, 683, 2999):
        one, rate = arm.observe(joints[pose : pose + 1], values)
        np.testing.assert_array_equal(one[0], points[pose])
        np.testing.assert_array_equal(rate[0], jacobian[pose])


def test_joints_of_another_arm_are_refused() -> None:
    with pytest.raises(LabError, match=r"\(poses, 6\)"):
        SerialArm(IRB120.chain).points(np.zeros((3, 7)), SerialArm(IRB120.chain).nominal())
