"""Elastic errors by segment and in sum, Greville's pseudo-inverse, and corrected joint positions of many arms."""

from collections.abc import Callable

import numpy as np
import pytest
from beam_chain import BeamChain
from helpers.robots import IRB120, chain_of

from lab.core.se3 import Array
from lab.extensions.robotics.trajectory.path_errors import Correction, compensated, elastic_errors, greville
from lab.kinematics.dynamics.gravity import LinkLoads, Loads, link_loads
from lab.kinematics.serial.serial_arm import SerialArm
from lab.kinematics.serial.walk import Torsors
from lab.robots.load_robot import load_virtual

TUBE = np.array([2.067e-5, 2.067e-5, 2.79e-5, 1.5e-8])


def torsors(links: LinkLoads, joints: Array, payload_kg: float, section: Array, bending: tuple[int, ...]) -> Torsors:
    loads = links.at_rest(joints, np.full(len(joints), payload_kg))
    return {link: links.beams[link].torsor(loads[:, link], section) for link in bending}


def corrected(arm: SerialArm, values: Array, joints: Array, torsors_at: Callable[[Array], Torsors]) -> Correction:
    return compensated(
        lambda q: arm.tool(q, values), joints, lambda q: arm.tool(q, values, 0, torsors_at(q)), arm.chain
    )


def test_grevilles_pseudo_inverse_is_that_of_the_svd() -> None:
    rng = np.random.default_rng(0)
    for rows, columns, rank in ((6, 6, 6), (6, 6, 4), (3, 6, 3), (6, 2, 2), (2, 2, 1), (6, 7, 5)):
        matrix = rng.normal(size=(rows, rank)) @ rng.normal(size=(rank, columns))
        np.testing.assert_allclose(greville(matrix), np.linalg.pinv(matrix, rcond=1e-9), atol=1e-9)
    lost = np.array([[0.0, 1.0, 2.0], [0.0, 0.0, 0.0]])
    np.testing.assert_allclose(greville(lost), np.linalg.pinv(lost), atol=1e-14)
    assert not greville(np.zeros((2, 3))).any()
    arm, joints = IRB120.serial_arm(("p1",)), IRB120.chain.random_joints(20, rng)
    for jacobian in arm.tool(joints, arm.nominal(IRB120.tool))[1]:
        np.testing.assert_allclose(greville(jacobian), np.linalg.pinv(jacobian), rtol=1e-6, atol=1e-8)


@pytest.mark.parametrize("name", ["irb120", "tx40"])
def test_the_deformed_arm_gets_where_the_rigid_one_was_sent(name: str) -> None:
    """X_D(q_C) = X_R(q), all six components, and on a chain of rigid pieces that knows no beam theory, to 1 µm."""
    robot = load_virtual(name)
    assert robot.loads is not None
    arm, links, model = robot.serial_arm(("p1",)), link_loads(robot.loads), robot.serial_model
    values, bending = arm.nominal(robot.tool), (1, 3)
    joints = robot.chain.random_joints(20, np.random.default_rng(2))
    found = corrected(arm, values, joints, lambda q: torsors(links, q, 2.0, TUBE, bending))
    well = np.abs(found.joints - joints).max(axis=1) < 5e-3  # away from singularities
    assert (
        well.sum() >= 15
        and found.directions == (3, 3)
        and found.complete[well].all()
        and np.abs(found.left[well]).max() < 1e-11
    )
    sections = np.zeros((6, 4))
    sections[list(bending)] = TUBE
    some = np.flatnonzero(well)[:3]
    truth = BeamChain(model.model, model, sections, 32)
    frame0 = robot.T_world_frame0
    wanted = arm.points(joints[some], values)[:, 0] @ frame0[:3, :3].T + frame0[:3, 3]
    load = np.full(3, 2.0)
    before, after = (
        np.linalg.norm(truth.positions(q[some], ("p1",), load)[:, 0] - wanted, axis=1) for q in (joints, found.joints)
    )
    assert after.max() < 1e-6 and before.max() > 3e-5


def planar() -> tuple[SerialArm, LinkLoads]:
    """Two links of 0.5 m in a vertical plane."""
    chain = chain_of("planar", "distal", "RR", [0, 0], [0.5, 0.5], [0, 0], [0, 0])
    loads = Loads(chain, np.array([4.0, 2.0]), np.array([[-0.25, 0, 0], [-0.25, 0, 0.0]]), np.array([0.0, -9.81, 0.5]))
    return SerialArm(chain), link_loads(loads)


def test_a_planar_arm_leaves_out_what_its_joints_cannot_make() -> None:
    """Gravity a little out of its plane: x and y are met to rounding, z and the rotations stay as they are."""
    arm, links = planar()
    joints, values = np.deg2rad([[20.0, 60.0], [80.0, -50.0], [-30.0, 100.0]]), arm.nominal({"p1": np.zeros(3)})
    found = corrected(arm, values, joints, lambda q: torsors(links, q, 1.0, 1e2 * TUBE, (0, 1)))
    assert found.directions == (2, 0) and found.complete.all()
    before = elastic_errors(arm, values, joints, torsors(links, joints, 1.0, 1e2 * TUBE, (0, 1))).total
    assert np.abs(before[:, :2]).max() > 1e-3 and np.abs(found.left[:, :2]).max() < 1e-11
    assert np.abs(found.left[:, 2]).max() == pytest.approx(np.abs(before[:, 2]).max(), rel=0.05)
