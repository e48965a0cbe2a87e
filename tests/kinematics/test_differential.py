"""Differential models: the Jacobian, the shortest rates, what a singularity takes away, and how near one is."""

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

from lab.core.se3 import Array
from lab.kinematics.differential import (
    ROTATION_M,
    WEIGHTS,
    manipulability,
    pseudo_inverse,
    rates,
    singular_distance,
)
from lab.kinematics.inverse.closed_form import closed_form_of
from lab.kinematics.serial.chain import Chain
from lab.kinematics.serial.serial_arm import SerialArm

DECOUPLED = {chain.name: chain for chain in (IRB120.chain, RX130, TX40, SCEMI, VERSATRAN)}


def jacobian_of(chain: Chain, joints: Array) -> Array:
    arm = SerialArm(chain)
    return arm.tool(joints, arm.nominal())[1]


# The direct model


@pytest.mark.parametrize("chain", [IRB120.chain, RX130, SCARA, VERSATRAN], ids=lambda chain: chain.name)
def test_the_jacobian_is_the_derivative_of_the_pose(chain: Chain) -> None:
    rng = np.random.default_rng(6)
    arm = SerialArm(chain, ("p1", "p2"))
    values = perturbed(arm, somewhere(arm, rng), rng, 1e-3, 3e-3)
    for joints in chain.random_joints(5, rng):
        Ts, jacobian = arm.tool(joints[None], values, 1)
        np.testing.assert_allclose(Ts[0, :3, 3], arm.points(joints[None], values)[0, 1], atol=1e-15)
        assert_derivatives(lambda q: arm.points(q[None], values)[0, 1], jacobian[0, :3], joints)

        def turned(q: Array, R=Ts[0, :3, :3]) -> Array:
            spin = arm.flange(q[None], values)[0, :3, :3] @ R.T  # I + [w]x to first order
            return np.array([spin[2, 1] - spin[1, 2], spin[0, 2] - spin[2, 0], spin[1, 0] - spin[0, 1]]) / 2

        assert_derivatives(turned, jacobian[0, 3:], joints)


# The inverse model


@pytest.mark.parametrize("name", DECOUPLED)
def test_away_from_singularities_the_rates_make_the_twist(name: str) -> None:
    chain, rng = DECOUPLED[name], np.random.default_rng(0)
    joints = chain.random_joints(1000, rng)
    jacobian = jacobian_of(chain, joints)
    jacobian = jacobian[singular_distance(jacobian)[0] > 0.05]
    wanted = rng.normal(size=(len(jacobian), 6))
    found = rates(jacobian, wanted)
    np.testing.assert_allclose((jacobian @ found.joints[:, :, None])[:, :, 0], wanted, atol=1e-12)
    np.testing.assert_allclose(found.joints, np.linalg.solve(jacobian, wanted[:, :, None])[:, :, 0], rtol=1e-9)
    assert not found.missing.any() and not found.free.any() and not found.lost.any() and (found.rank == 6).all()


def at_singularity(kind: str, count: int) -> Array:
    """Joints of the RX 130, by its det J = -0.625 0.625 sin q3 sin q5 (0.625 sin q2 + 0.625 sin(q2 + q3))."""
    joints = RX130.random_joints(count, np.random.default_rng(1))
    if kind == "wrist":
        joints[:, 4] = 0.0
    elif kind == "elbow":
        joints[:, 2] = 0.0
    else:
        joints[:, 1] = -joints[:, 2] / 2
    return joints


def assert_inverse_of(jacobian: Array, wanted: Array, rank: int) -> None:
    """All that a pseudo-inverse promises, with radians weighed."""
    found, n = rates(jacobian, wanted), jacobian.shape[2]
    assert (found.rank == rank).all()
    got = (jacobian @ found.joints[:, :, None])[:, :, 0]
    np.testing.assert_allclose(got, wanted - found.missing, atol=1e-12)
    free, lost = found.free[:, : n - rank], found.lost[:, : 6 - rank]
    assert not found.free[:, n - rank :].any() and not found.lost[:, 6 - rank :].any()
    np.testing.assert_allclose(free @ free.swapaxes(1, 2), np.tile(np.eye(n - rank), (len(free), 1, 1)), atol=1e-12)
    np.testing.assert_allclose(jacobian @ free.swapaxes(1, 2), 0.0, atol=1e-12)  # they move nothing
    np.testing.assert_allclose(
        free @ found.joints[:, :, None], 0.0, atol=1e-11
    )  # so the shortest rates have none of them
    np.testing.assert_allclose((lost * WEIGHTS**2) @ jacobian, 0.0, atol=1e-12)  # and no joint moves in these
    weighed = lost * WEIGHTS
    np.testing.assert_allclose(
        weighed @ weighed.swapaxes(1, 2), np.tile(np.eye(6 - rank), (len(lost), 1, 1)), atol=1e-12
    )
    part = np.einsum("nki,nk->ni", lost, np.einsum("nki,ni->nk", weighed, WEIGHTS * wanted))
    np.testing.assert_allclose(found.missing, part, atol=1e-12)


@pytest.mark.parametrize("kind", ["wrist", "elbow", "shoulder"])
def test_at_a_singularity_one_combination_is_free_and_one_direction_lost(kind: str) -> None:
    joints = at_singularity(kind, 300)
    jacobian = jacobian_of(RX130, joints)
    others = np.linalg.svd(jacobian, compute_uv=False)[:, 4] > 1e-3  # of one singularity alone
    joints, jacobian = joints[others], jacobian[others]
    wanted = np.random.default_rng(2).normal(size=(len(joints), 6))
    assert_inverse_of(jacobian, wanted, rank=5)
    free = rates(jacobian, wanted).free[:, 0]
    if kind == "wrist":  # axes 4 and 6 are one line
        np.testing.assert_allclose(free, np.tile([0, 0, 0, 1, 0, -1] / np.sqrt(2), (len(free), 1)), atol=1e-12)
    elif kind == "elbow":  # the straight arm: the elbow goes out, the shoulder half as much back, the wrist holds still
        assert np.abs(free[:, 0]).max() < 1e-12 and np.abs(free[:, 2]).min() > 1e-3
        np.testing.assert_allclose(free[:, 1], -free[:, 2] / 2, atol=1e-12)
    else:  # the wrist's centre over axis 1, which the wrist takes back
        assert np.abs(free[:, 1:3]).max() < 1e-12 and np.abs(free[:, 0]).min() > 1e-3


def test_just_beside_a_singularity_the_rates_are_cut_off_by_the_tolerance() -> None:
    joints = at_singularity("wrist", 1)
    for bend, rank in ((1e-10, 5), (1e-6, 6)):
        joints[0, 4] = bend
        found = rates(jacobian_of(RX130, joints), np.ones((1, 6)))
        assert found.rank[0] == rank and (np.abs(found.joints).max() < 1e3) == (rank == 5)
    joints[0, 4] = 1e-6
    assert rates(jacobian_of(RX130, joints), np.ones((1, 6)), least_m=1e-3).rank[0] == 5


def test_an_arm_with_four_joints_has_two_directions_less() -> None:
    joints = SCARA.random_joints(300, np.random.default_rng(3))
    jacobian, wanted = jacobian_of(SCARA, joints), np.random.default_rng(4).normal(size=(300, 6))
    assert_inverse_of(jacobian, wanted, rank=4)
    found = rates(jacobian, wanted)
    np.testing.assert_allclose(found.missing[:, :3], 0.0, atol=1e-12)  # all axes upright: places are met
    np.testing.assert_allclose(found.missing[:, 3:], wanted[:, 3:] * [1, 1, 0], atol=1e-12)  # tilts are not
    joints[:, 1] = 0.0
    jacobian = jacobian_of(SCARA, joints)
    assert_inverse_of(jacobian, wanted, rank=3)
    stretched = rates(jacobian, wanted).free[:, 0]  # 0.4 m and 0.25 m in line, and the last joint turns back
    np.testing.assert_allclose(
        stretched / stretched[:, 1:2], np.tile([-0.25 / 0.65, 1, 0, -0.4 / 0.65], (300, 1)), atol=1e-9
    )


def test_damping_makes_the_pseudo_inverse_shorter_and_nothing_else() -> None:
    matrix = np.random.default_rng(9).normal(size=(20, 3, 4))
    np.testing.assert_allclose(pseudo_inverse(matrix), np.linalg.pinv(matrix), atol=1e-12)
    damped = pseudo_inverse(matrix, np.full(20, 0.5))
    T = matrix.swapaxes(1, 2)
    np.testing.assert_allclose(damped, T @ np.linalg.inv(matrix @ T + 0.25 * np.eye(3)), atol=1e-12)
    assert not pseudo_inverse(1e-10 * matrix).any()
    assert ROTATION_M == WEIGHTS[3] == 0.3


# How near


def literature(chain: Chain, q: Array) -> Array:
    form = closed_form_of(chain)  # which the literature's formulas are compared with in test_closed_forms
    assert form is not None
    return form.determinant.at(q)


@pytest.mark.parametrize("name", DECOUPLED)
def test_manipulability_is_the_determinant_and_its_gradient_gives_the_distance(name: str) -> None:
    chain = DECOUPLED[name]
    joints = chain.random_joints(300, np.random.default_rng(7))
    det = literature(chain, joints)
    np.testing.assert_allclose(manipulability(jacobian_of(chain, joints)), np.abs(det), atol=1e-15)
    step = 1e-6 * np.eye(6)
    gradient = np.stack([(literature(chain, joints + s) - literature(chain, joints - s)) / 2e-6 for s in step], axis=1)
    distance, joint = singular_distance(jacobian_of(chain, joints))
    np.testing.assert_allclose(distance, np.abs(det) / np.linalg.norm(gradient, axis=1), rtol=1e-5)
    assert (joint == np.abs(gradient).argmax(axis=1)).mean() > 0.99


@pytest.mark.parametrize("bend", [0.0, 1e-6, 1e-3])
def test_fewer_joints_have_a_distance_too(bend: float) -> None:
    """Also where the SCARA is straight to the last bit, and its tilts are lost as well."""
    joints = SCARA.random_joints(100, np.random.default_rng(10))
    joints[:, 1] = bend
    distance, joint = singular_distance(jacobian_of(SCARA, joints))
    np.testing.assert_allclose(distance, bend, rtol=1e-2, atol=1e-12)
    assert (joint == 1).all()
