"""The elastic arm along a trajectory: what is corrected is hit by a chain of pieces that bears the same motion."""

import numpy as np
from beam_chain import BeamChain
from helpers.robots import IRB120

from lab.core.se3 import Array
from lab.extensions.robotics.trajectory.path_errors import Tracking, tracking
from lab.kinematics.dynamics.beam import COMPLIANCES
from lab.kinematics.trajectory.trajectory import through
from lab.simulation.elastic_links import AT_REST, JointMotion

TUBE = np.array([2.067e-5, 2.067e-5, 2.79e-5, 0.0])
SECTIONS = np.zeros((6, 4))
SECTIONS[[1, 3]] = TUBE
SPRINGS = {"joint2.compliance": 5e-6, "joint3.compliance": 4e-6}


def tracked(joints: Array, rates: Array, payload_kg: float, springs: bool = False) -> Tracking:
    """An arm with elastic upper arm and forearm, whose compliances are known, and with springs at joints 2 and 3."""
    groups = ("bending", "torsion", *(["compliance"] if springs else []))
    arm = IRB120.arm_with(("p1",), groups, moving=True)
    values, rigid = arm.nominal(IRB120.tool), arm.rigid
    known = {f"link{link}.{symbol}": TUBE[i] for link in (2, 4) for i, symbol in enumerate(COMPLIANCES[:3])}
    for name, value in (known | (SPRINGS if springs else {})).items():
        values[arm.names.index(name)] = value
    rest = np.concatenate([np.full((len(joints), 1), payload_kg), rates], axis=1)
    return tracking(arm, values, rigid.nominal(IRB120.tool), joints, rest, 0)


def test_a_circle_at_full_speed_is_met_by_the_chain_of_pieces() -> None:
    """3 kg, the joints' full speed: a tenth of a millimetre before, microns after; at rest it would be another one."""
    chain, model, arm = IRB120.chain, IRB120.model, IRB120.serial_arm(("p1",))
    values, angles = arm.nominal(IRB120.tool), np.linspace(0, 2 * np.pi, 9)
    middle = np.deg2rad([0.0, 35.0, -10.0, 10.0, 40.0, 0.0])
    points = middle + 0.25 * np.array([np.cos(angles), np.sin(angles), -np.sin(angles), *[0 * angles] * 3]).T
    path = through(chain, points, np.zeros_like(points))
    joints, speeds, accelerations = path.at(np.linspace(0.05, 0.95, 12) * path.seconds)
    found = tracked(joints, np.concatenate([speeds, accelerations], axis=1), 3.0)
    assert np.abs(accelerations).max() > 5 and np.abs(found.corrected.left).max() < 1e-10
    assert list(found.parts) == ["link 2", "link 4"]
    motion, load = JointMotion(speeds, accelerations), np.full(12, 3.0)
    real = BeamChain(model.model, model, SECTIONS, 16)
    wanted = arm.points(joints, values)[:, 0] @ IRB120.T_world_frame0[:3, :3].T + IRB120.T_world_frame0[:3, 3]
    before, after = (
        np.linalg.norm(real.positions(q, ("p1",), load, motion)[:, 0] - wanted, axis=1)
        for q in (joints, found.corrected.joints)
    )
    assert before.mean() > 5e-5 and after.max() < 2e-6
    still = np.linalg.norm(real.positions(found.corrected.joints, ("p1",), load, AT_REST)[:, 0] - wanted, axis=1)
    assert still.max() > 5 * after.max()  # inertia counts


def test_parts_add_up_and_the_whole_is_made_up_for() -> None:
    """Springs and links in motion: to first order the error is the sum of its parts; corrected, none is left."""
    rng = np.random.default_rng(0)
    joints = np.deg2rad([0.0, 30.0, -10.0, 20.0, 50.0, 10.0]) + 0.2 * rng.normal(size=(5, 6))
    rates = np.concatenate([rng.normal(size=(5, 6)), 10 * rng.normal(size=(5, 6))], axis=1)
    found = tracked(joints, rates, 2.0, springs=True)
    assert set(found.parts) == {"joints", "link 2", "link 4"}
    size = np.abs(found.total).max()
    np.testing.assert_allclose(sum(found.parts.values()), found.total, atol=2e-3 * size)
    assert np.abs(found.corrected.left).max() < 1e-11 < size
    np.testing.assert_allclose(found.standing[:, [0, 3, 4, 5]], joints[:, [0, 3, 4, 5]], atol=0)
