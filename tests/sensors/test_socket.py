"""A ball in sockets: a known distance, locations, a measured arm."""

from dataclasses import replace

import numpy as np
import pytest
from helpers.fixture_data import many, measured_fixtures
from helpers.robots import IRB120, data_file

import lab
from lab.calibration.identification import identify
from lab.calibration.row_groups import cv_groups_of
from lab.calibration.weights import Noise
from lab.core.measurements import FIXTURE, Measurements
from lab.formats.measurement_csv import read_measurements
from lab.kinematics.serial.serial_arm import SerialArm
from lab.prediction.validation import errors_of
from lab.robots.load_robot import load_robot
from lab.sensors.sensor_registry import sensor_named
from lab.sensors.socket import Sockets, SocketSensor

ARM = SerialArm(IRB120.chain)


def test_a_known_distance_is_the_scale() -> None:
    """Sockets of an arm 1 % too long: without the distance it is not seen, with it every length comes out."""
    rng = np.random.default_rng(0)
    observation = many(Sockets, 4)
    data, true = measured_fixtures(observation, 80, rng)
    centres = true[observation.first :].reshape(2, 2, 3)
    apart = np.linalg.norm(centres[:, 1] - centres[:, 0], axis=1)
    scaled = replace(observation, distance_m=float(apart[0] * 1.01))
    data = data[data.conditions[FIXTURE] < 2]  # one location, one distance
    found = identify(scaled, data, ARM.nominal())
    assert found.status == "converged"
    assert found.values[observation.names.index("link4.d")] == pytest.approx(0.302 * 1.01, abs=1e-9)
    free = identify(replace(observation, distance_m=None), data, ARM.nominal())
    assert free.values[observation.names.index("link4.d")] == 0.302


def test_known_noise_leaves_the_distance_its_weight() -> None:
    rng = np.random.default_rng(1)
    observation = many(Sockets, 2)
    data, true = measured_fixtures(observation, 60, rng)
    apart = float(np.linalg.norm(np.diff(true[observation.first :].reshape(2, 3), axis=0)))
    noisy = replace(data, points=data.points + 1e-4 * rng.normal(size=data.points.shape))
    values = []
    for noise in (Noise(), Noise(sigma_m=1e-4)):
        found = identify(replace(observation, distance_m=apart), noisy, ARM.nominal(), noise)
        values.append(found.values)
    np.testing.assert_allclose(values[0], values[1], atol=1e-9)


def test_locations_are_held_out_whole() -> None:
    data, _ = measured_fixtures(many(Sockets, 6), 60, np.random.default_rng(0))
    labels = cv_groups_of(many(Sockets, 6), data)
    np.testing.assert_array_equal(labels, data.conditions[FIXTURE] // 2)
    few = data[data.conditions[FIXTURE] < 4]
    assert many(Sockets, 4).cv_groups(few) is None  # two locations: by configuration


def sockets_file(distance: float | None) -> tuple[SerialArm, Sockets, Measurements]:
    robot = load_robot("panda")
    file = data_file("panda_sockets_mukca_3.csv")
    data = read_measurements(
        file, robot.chain.joint_names, robot.chain.prismatic, columns=sensor_named("socket").columns
    )
    assert not data.warnings
    arm = robot.arm(("p1",))
    observation, seen = SocketSensor(distance, 0.0).observation(arm, data, arm.nominal())
    assert isinstance(observation, Sockets)
    return arm, observation, seen


def test_balls_in_sockets() -> None:
    """The last location held out, its centres from its own rows: at most 0.25 mm, 2.90 before."""
    arm, observation, seen = sockets_file(0.05)
    location = cv_groups_of(observation, seen)
    assert sorted(set(location)) == list(range(6))
    last = location == 5
    found = identify(observation, seen[~last], arm.nominal())
    errors = errors_of(found, seen[last])
    assert found.status == "converged" and len(found.fit.free) == 25 + 30
    assert errors.after.size == 60 and 1e3 * errors.before.mean() == pytest.approx(2.90, abs=0.02)
    assert 0.15 < 1e3 * errors.after.mean() <= 0.25
    centres = found.values[found.model.first :].reshape(-1, 2, 3)
    np.testing.assert_allclose(np.linalg.norm(np.diff(centres, axis=1), axis=2), 0.05, atol=5e-6)


@pytest.mark.thorough
def test_the_uncertain_distance_of_sockets_hides_no_effect_of_a_real_arm() -> None:
    file, options = data_file("panda_sockets_mukca_3.csv"), {"robot": "panda", "observe": "socket"}
    plain, chosen = (
        lab.identify(file, model=model, socket_distance_mm=50, **options) for model in ("geometric", "auto")
    )
    assert chosen.after.mean < 0.8 * plain.after.mean
