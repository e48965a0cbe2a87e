"""The elastic arm along a trajectory: what is corrected is hit by a chain of pieces that bears the same motion."""

import numpy as np
from helpers.robots import IRB120

from lab.compensation.elastic import elastic_errors
from lab.compensation.elastic_tracking import tracking
from lab.kinematics.dynamics.link_loads import link_loads
from lab.kinematics.trajectory.trajectory import through
from lab.simulation.beam_chain import BeamChain
from lab.simulation.elastic import AT_REST, JointMotion

TUBE = np.array([2.067e-5, 2.067e-5, 2.79e-5, 0.0])
SECTIONS = np.zeros((6, 4))
SECTIONS[[1, 3]] = TUBE


def test_a_circle_at_full_speed_is_met_by_the_chain_of_pieces() -> None:
    """3 kg, the joints' full speed: a tenth of a millimetre before, microns after; at rest it would be another one."""
    assert IRB120.loads is not None
    chain, model, arm = IRB120.chain, IRB120.model, IRB120.serial_arm(("p1",))
    links, values, angles = link_loads(IRB120.loads), arm.nominal(IRB120.tool), np.linspace(0, 2 * np.pi, 9)
    middle = np.deg2rad([0.0, 35.0, -10.0, 10.0, 40.0, 0.0])
    points = middle + 0.25 * np.array([np.cos(angles), np.sin(angles), -np.sin(angles), *[0 * angles] * 3]).T
    path = through(chain, points, np.zeros_like(points))
    when = np.linspace(0.05, 0.95, 12) * path.seconds
    found = tracking(arm, values, links, SECTIONS, path, when, payload_kg=3.0)
    assert np.abs(found.accelerations).max() > 5 and np.abs(found.corrected.left).max() < 1e-10
    motion, load = JointMotion(found.speeds, found.accelerations), np.full(12, 3.0)
    real = BeamChain(model.model, model, SECTIONS, 16)
    wanted = arm.points(found.joints, values)[:, 0] @ IRB120.T_world_frame0[:3, :3].T + IRB120.T_world_frame0[:3, 3]
    before, after = (
        np.linalg.norm(real.positions(q, ("p1",), load, motion)[:, 0] - wanted, axis=1)
        for q in (found.joints, found.corrected.joints)
    )
    assert before.mean() > 5e-5 and after.max() < 2e-6
    still = np.linalg.norm(real.positions(found.corrected.joints, ("p1",), load, AT_REST)[:, 0] - wanted, axis=1)
    assert still.max() > 5 * after.max()  # inertia counts


def test_errors_at_rest_are_those_of_gravity_alone() -> None:
    assert IRB120.loads is not None
    arm, links = IRB120.serial_arm(("p1",)), link_loads(IRB120.loads)
    values, there = arm.nominal(IRB120.tool), np.deg2rad([[0.0, 30.0, 0.0, 0.0, 30.0, 0.0]])
    path = through(IRB120.chain, np.concatenate([there, there + 0.1]), np.zeros((2, 6)))
    found = tracking(arm, values, links, SECTIONS, path, np.array([path.seconds + 1.0]), payload_kg=1.0)
    loads = links.at_rest(found.joints, np.ones(1))
    torsors = {link: links.beams[link].torsor(loads[:, link], SECTIONS[link]) for link in (1, 3)}
    expected = elastic_errors(arm, values, found.joints, torsors)
    np.testing.assert_allclose(found.errors.total, expected.total, atol=1e-15)
    assert found.errors.links == (1, 3)
