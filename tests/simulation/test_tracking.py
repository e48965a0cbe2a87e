"""What a tracker reads of a virtual arm's targets."""

import numpy as np
from helpers.robots import IRB120

from lab.noise.instruments import INSTRUMENTS
from lab.simulation.effects import BUMPED
from lab.simulation.tracking import VirtualMeasurement, recorded, track, track_with_errors
from lab.simulation.true_robot import random_perturbation, random_tracker, true_robot

TARGETS = ("p1", "p2")
RNG = np.random.default_rng(3)
MODEL = IRB120.model
REAL = true_robot(MODEL, random_perturbation(MODEL, 5e-4, 1.5e-3, RNG), random_tracker(MODEL, RNG))
JOINTS = IRB120.chain.random_joints(60, np.random.default_rng(8))


def test_points_are_where_the_arm_is_plus_the_noise() -> None:
    device = INSTRUMENTS["uniform-8um"]
    data, bad = track_with_errors(VirtualMeasurement(REAL, JOINTS, TARGETS, device, np.random.default_rng(0)))[:2]
    off = data.points - REAL.points(JOINTS, TARGETS)
    assert data.points.shape == (60, 2, 3) and data.targets == TARGETS and not bad.any()
    assert 0 < np.abs(off).max() <= 8e-6 * (1 + 1e-9)
    again = track(REAL, JOINTS, TARGETS, device, np.random.default_rng(0))
    np.testing.assert_array_equal(again.points, data.points)
    mean = track(REAL, JOINTS, TARGETS, device, np.random.default_rng(0), readings=16)
    assert np.std(mean.points - REAL.points(JOINTS, TARGETS)) < 0.4 * np.std(off)


def test_what_follows_a_bump_is_another_session() -> None:
    points = REAL.points(JOINTS, TARGETS)
    conditions = {"payload_kg": np.ones(60), BUMPED: (np.arange(60) >= 20).astype(float)}
    data = recorded(REAL, JOINTS, TARGETS, points, conditions)
    assert data.sessions == ("1",) * 20 + ("2",) * 40 and set(data.conditions) == {"payload_kg"}
    assert set(recorded(REAL, JOINTS, TARGETS, points, {}).sessions) == {""}
