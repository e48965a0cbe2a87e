"""Anchors that were moved are found from the lengths alone."""

from dataclasses import replace

import numpy as np
import pytest
from helpers.fixture_data import many, true_values
from helpers.observed_files import cable_file
from helpers.robots import IRB120

from lab.calibration.observations.anchor_changepoints import found_sessions
from lab.calibration.observations.cable import Cable, CableKind
from lab.calibration.observations.fixtures import FIXTURE, Fixtures
from lab.core.measurements import Measurements, measured
from lab.kinematics.serial.arm import SerialArm

ARM = SerialArm(IRB120.chain)
NAMES = IRB120.chain.joint_names


@pytest.mark.thorough
def test_anchors_that_moved_are_found() -> None:
    """From residuals alone, with rows 201 and 950 among them; and nothing is found where nothing moved."""
    arm, data = cable_file()
    observation, seen = CableKind().observation(arm, data, arm.nominal())
    starts = found_sessions(observation, seen, arm.nominal())
    assert len(starts) == 3 and starts[0] == 0 and abs(starts[1] - 140) <= 2 and abs(starts[2] - 506) <= 2
    spoilt = seen.points.copy()
    spoilt[[60, 300, 301, 900]] += 0.05
    again = found_sessions(observation, replace(seen, points=spoilt), arm.nominal())
    assert len(again) == 3 and np.abs(np.subtract(again, starts)).max() <= 3
    still = found_sessions(observation, seen.take(range(140, 506)), arm.nominal())
    assert still == (0,)


def wire_readings(seed: int, marks: list[int], move_m: float) -> tuple[Fixtures, Measurements]:
    """A wrong arm's wire lengths with 0.3 mm of noise, three of them bad; the anchor moves at these rows."""
    rng = np.random.default_rng(seed)
    observation = many(Cable, 1)
    true = true_values(observation, rng)
    joints = 0.6 * IRB120.chain.random_joints(300, rng)
    anchors = np.array([0.3, -1.0, -0.3]) + move_m * rng.normal(size=(len(marks) + 1, 3))
    there = anchors[np.searchsorted(marks, np.arange(300), side="right")]
    lengths = np.linalg.norm(ARM.points(joints, true[: len(ARM.names)])[:, 0] - there, axis=1)
    lengths += 0.3e-3 * rng.normal(size=300)
    lengths[[50, 155, 250]] += 0.08
    data = measured(NAMES, joints, observation.targets, lengths[:, None, None])
    return observation, replace(data, conditions={FIXTURE: np.zeros(300)})


@pytest.mark.slow
def test_moved_anchors_of_a_virtual_wire() -> None:
    """Moves of centimetres beside links off by 0.5 mm and 1 mrad; none where there was none."""
    right = 0
    for seed in range(8):
        marks = [80, 150, 220]
        observation, data = wire_readings(seed, marks, 20e-3)
        found = found_sessions(observation, data, ARM.nominal())
        right += len(found) == 4 and np.abs(np.subtract(found[1:], marks)).max() <= 3
    assert right >= 7
    for seed in range(5):
        assert found_sessions(*wire_readings(seed, [], 0.0), ARM.nominal()) == (0,)
