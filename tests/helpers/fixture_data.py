"""Virtual measurements at fixtures, for the tests of what is observed."""

from dataclasses import replace

import numpy as np

from helpers.pose_data import off_by
from helpers.robots import IRB120
from lab.core.measurements import FIXTURE, Measurements, measured
from lab.core.se3 import Array
from lab.kinematics.serial.serial_arm import SerialArm
from lab.sensors.cable import Cable
from lab.sensors.fixtures import Fixtures

ARM = SerialArm(IRB120.chain)
NAMES = IRB120.chain.joint_names


def many(kind: type[Fixtures], places: int, arm: SerialArm = ARM, **more) -> Fixtures:
    """An arm at some fixtures, without data."""
    labels = [f"l{i // 2}.{i % 2}" for i in range(places)]
    return kind(arm, arm.nominal(), tuple(range(places)), tuple(labels), **more)


def true_values(observation: Fixtures, rng: np.random.Generator) -> Array:
    """True values: the base at the origin, links and tool off, fixtures that the arm can touch."""
    true = off_by(observation, observation.nominal(observation.nominal_arm), rng)
    joints = observation.arm.structure_joints(len(observation.numbers), rng)
    points = observation.arm.points(joints, true[: len(observation.arm.names)])[:, 0]
    if isinstance(observation, Cable):
        points = points + np.array([0.1, -0.9, -0.6])
        true[len(observation.arm.names) : observation.first] = -0.012
    true[observation.first :] = observation.random_fixtures(points, rng).ravel()
    return true


def measured_fixtures(observation: Fixtures, rows: int, rng: np.random.Generator) -> tuple[Measurements, Array]:
    """Exact measurements of each fixture in turn, and the truth."""
    true = true_values(observation, rng)
    numbers = np.resize(np.array(observation.numbers, float), 20 * rows)
    inputs = np.column_stack([observation.arm.structure_joints(20 * rows, rng), numbers])
    if observation.contact:
        inputs = observation.inputs_in_contact(inputs, true)
    inputs = inputs[:rows]
    observed = np.zeros((len(inputs), 1, observation.points(inputs, true).shape[2]))
    if not observation.contact:
        observed = observation.points(inputs, true)
    data = measured(NAMES, inputs[:, :-1], observation.targets, observed)
    assert len(data) == rows
    return replace(data, conditions={FIXTURE: inputs[:, -1]}), true
