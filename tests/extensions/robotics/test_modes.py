"""Modes of mechanisms: all assembly modes hold the loops, and all working modes reach the pose."""

import numpy as np
import pytest

from lab.core import se3
from lab.extensions.robotics.closed.recognition import (
    assembly_modes,
    classical_model_of,
    measured_legs_of,
    passive_values_of,
    working_modes,
)
from lab.kinematics.closed.loop_closure import Configuration
from lab.kinematics.closed.mechanism import Mechanism, platform_poses
from lab.robots.load_robot import load_robot

MODES = {"delta": (2, 8), "rpr3": (2, 1), "rpr2": (2, 1)}  # of assembly and of work, of most poses


def gaps(mechanism: Mechanism, joints: np.ndarray, passive: np.ndarray) -> np.ndarray:
    """What of the closures stays open (m)."""
    dimensions = mechanism.dimensions(mechanism.nominal_values)
    return np.abs(Configuration.of(mechanism.tree, dimensions, joints[None], passive[:, None]).closures()[0])


@pytest.mark.parametrize("name", MODES)
def test_every_mode_closes_the_loops_and_the_drawn_one_is_among_them(name: str) -> None:
    mechanism = load_robot(name).chain
    course, (assembled, working) = classical_model_of(mechanism), MODES[name]
    for joints in mechanism.random_joints(20, np.random.default_rng(0)):
        drawn = mechanism.assembled(joints[None], mechanism.nominal_values).configuration.passive[:, 0]
        T = platform_poses(mechanism, joints[None], drawn[None])[0]
        poses = assembly_modes(mechanism, course, joints)
        assert len(poses) >= assembled and np.abs(poses - T).max(axis=(1, 2)).min() < 1e-9
        passive, missed = passive_values_of(mechanism, T)
        assert missed < 1e-12
        np.testing.assert_allclose(passive, drawn, atol=1e-12)
        ways = working_modes(mechanism, course, passive)
        assert len(ways) == working and len({way.branches for way in ways}) == working
        assert min(np.abs(way.joints - joints).max() for way in ways) < 1e-9
        for way in ways:
            assert gaps(mechanism, way.joints, passive).max() < 1e-12


def test_a_pose_that_the_platform_cannot_take_is_missed_by_as_much() -> None:
    mechanism = load_robot("rpr3").chain
    _, missed = passive_values_of(mechanism, se3.pose(se3.exp(np.array([0.0, 0.0, 0.4])), np.array([0.01, 0.02, 0.3])))
    assert missed == pytest.approx(0.3, abs=1e-12)
    delta = load_robot("delta").chain
    turned = se3.pose(se3.exp(np.array([0.0, 0.1, 0.0])), np.array([0.0, 0.0, -0.9]))
    assert passive_values_of(delta, turned)[1] == pytest.approx(0.1, abs=1e-12)
    assert not working_modes(delta, classical_model_of(delta), np.array([3.0, 0.0, 0.0]))


def test_legs_of_measured_lengths_are_those_of_a_hexapod_alone() -> None:
    """Their lengths at random poses close the loops there; a Delta's joints, or a planar arm's legs, are others."""
    hexapod, rng = load_robot("hexapod").chain, np.random.default_rng(1)
    legs = measured_legs_of(hexapod)
    assert legs is not None
    for _ in range(5):
        passive = np.append(rng.uniform(-0.05, 0.05, 2), rng.uniform(0.6, 0.65)).tolist()
        passive = np.array(passive + rng.uniform(-0.15, 0.15, 3).tolist())
        T = platform_poses(hexapod, hexapod.home[None], passive[None])[0]
        assert gaps(hexapod, legs.joints(T), passive).max() < 1e-12
    for name in ("delta", "rpr3", "models/delta/irb340.toml"):
        assert measured_legs_of(load_robot(name).chain) is None
