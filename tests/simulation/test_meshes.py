"""Shells of bodies and where they stand."""

import numpy as np
from helpers.robots import IRB120

from lab.robots.load_robot import load_robot
from lab.simulation.closed_robot import random_values, true_mechanism
from lab.simulation.meshes import body_poses, instrument_body, shells


def test_shells_are_closed_triangles_with_unit_normals() -> None:
    found = shells(IRB120.model)
    assert len({shell.body for shell in found}) == len(found) >= 7
    for shell in found:
        assert shell.faces.max() < len(shell.vertices) == len(shell.normals) == len(shell.rgba)
        np.testing.assert_allclose(np.linalg.norm(shell.normals, axis=1), 1, atol=1e-5)


def test_bodies_stand_where_the_equations_put_them() -> None:
    """The last body of the nominal arm at random poses: the flange's frame up to a constant pose."""
    arm, joints = IRB120.serial_arm(("p1",)), IRB120.chain.random_joints(4, np.random.default_rng(0))
    values = IRB120.model.values_before(arm, IRB120.model.T_world_tracker)
    poses = body_poses(IRB120.model, arm, values, joints)
    assert instrument_body(IRB120.model) in poses
    hand = poses[IRB120.serial_model.bodies[-1]]
    flange = IRB120.model.T_world_tracker @ arm.flange(joints, values)
    constant = np.linalg.inv(hand) @ flange
    np.testing.assert_allclose(constant, np.broadcast_to(constant[0], constant.shape), atol=1e-9)


def test_a_mechanism_off_its_nominal_dimensions_stands_elsewhere() -> None:
    robot = load_robot("rpr2")
    mechanism = robot.chain
    off = random_values(mechanism, 1e-3, 1e-3, np.random.default_rng(0))
    assert off.shape == (len(mechanism.names),) and not np.allclose(off, mechanism.nominal_values)
    joints = mechanism.random_joints(3, np.random.default_rng(1))
    place = robot.model.T_world_tracker
    nominal, moved = (true_mechanism(robot.model, values, place).points(joints, ("p1",))
                      for values in (mechanism.nominal_values, off))  # fmt: skip
    distance = np.linalg.norm(moved - nominal, axis=2)
    assert (distance > 1e-6).all() and (distance < 0.05).all()
