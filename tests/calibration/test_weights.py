"""Weights by an instrument's noise: what they weigh, and what they leave alone."""

from dataclasses import replace

import numpy as np
import pytest
from helpers.pose_data import measured_poses
from helpers.robots import IRB120
from helpers.truths import truth_of

from lab.calibration.identification import Identification, identify
from lab.calibration.observation import observation_of
from lab.calibration.weights import Noise, weigh
from lab.core.measurements import Measurements, measured
from lab.kinematics.serial.serial_arm import SerialArm
from lab.noise.instruments import INSTRUMENTS, Instrument, TrackerErrors
from lab.sensors.full_pose import Poses

ARM = SerialArm(IRB120.chain, ("p1", "p2"))
TRACKER = INSTRUMENTS["leica-at960"]
RAY_ONLY = replace(TRACKER, name="interferometer alone", errors=TrackerErrors())  # 0.65 µm beside 15 µm at 2.6 m


def session(seed: int, sigma_m: float = 0.0, poses: int = 40) -> Measurements:
    """Points of an arm that differs from its nominal model by half a millimetre a link, about 2.6 m away."""
    rng = np.random.default_rng(seed)
    truth = truth_of(ARM, rng)
    truth.values[:3] = 2.0, -1.5, 0.5
    joints = IRB120.chain.random_joints(poses, rng)
    points = ARM.points(joints, truth.values)
    return measured(IRB120.chain.joint_names, joints, ARM.targets, points + sigma_m * rng.normal(size=points.shape))


def before_m(found: Identification, data: Measurements) -> float:
    """Root mean square residual of the nominal links with base and tool fitted, over positions."""
    residuals = data.points - found.model.points(data.inputs(found.model.conditions), found.nominal_aligned)
    return float(np.sqrt(np.mean(residuals[:, : observation_of(found.model).positions] ** 2)))


@pytest.mark.parametrize("named", ["leica-at960", "uniform-8um", "krypton-k600"])
def test_the_nominal_model_does_not_depend_on_the_instrument_that_is_named(named: str) -> None:
    data = session(1, 5e-6)
    found, plain = (identify(ARM, data, ARM.nominal(), each) for each in (Noise(INSTRUMENTS[named]), Noise()))
    np.testing.assert_allclose(found.nominal_aligned, plain.nominal_aligned, atol=1e-12)


def test_the_nominal_model_has_the_least_errors_that_its_base_and_tool_allow() -> None:
    """Weights of a range 20 times better than directions made them half as large again."""
    data = session(2, 5e-6)
    found = identify(ARM, data, ARM.nominal(), Noise(RAY_ONLY))
    inputs = data.inputs(ARM.conditions)
    columns = [i for i, name in enumerate(ARM.names) if name.startswith(("base", "tool"))]
    residual, slopes = (
        data.points - ARM.points(inputs, found.nominal_aligned),
        ARM.observe(inputs, found.nominal_aligned)[1],
    )
    rows = slopes[..., columns].reshape(-1, len(columns))
    gradient = rows.T @ residual.ravel() / np.linalg.norm(rows, axis=0)
    assert np.abs(gradient).max() < 1e-6 * np.linalg.norm(residual)  # stationary: residuals are across all columns
    white = weigh(observation_of(ARM), data, Noise(RAY_ONLY))[0].in_units_of_noise(slopes)[..., columns]
    weighted = white.reshape(-1, len(columns)).T @ weigh(observation_of(ARM), data, Noise(RAY_ONLY))[0].apply(residual)
    assert (
        np.abs(weighted / np.linalg.norm(white.reshape(-1, len(columns)), axis=0)).max() > 1.0
    )  # where weights differ


@pytest.mark.parametrize("ratio", [0.1, 1.0, 10.0])
def test_the_nominal_model_of_full_poses_weighs_a_milliradian_as_a_millimetre(ratio: float) -> None:
    """Whatever the ratio of the noises is; a position's errors stay those of a nominal arm."""
    arm = SerialArm(IRB120.chain)
    observation, data, _ = measured_poses(arm, 40, 4, 1e-5, 1e-5)
    assert isinstance(observation, Poses)
    found = identify(replace(observation, ratio=ratio), data, arm.nominal(), Noise(TRACKER))
    plain = identify(observation, data, arm.nominal())
    np.testing.assert_allclose(found.nominal_aligned, plain.nominal_aligned, atol=1e-11)
    assert before_m(found, data) < 3e-3


@pytest.mark.parametrize("readings", [1, 25])
def test_points_are_weighed_by_readings_nest_and_range(readings: int) -> None:
    """Whitened by the covariance of each point: along the ray by the constants, which no number of readings reduces."""
    data = session(5)
    observed, known = weigh(observation_of(ARM), data, Noise(TRACKER, readings=readings))
    ray = data.points / np.linalg.norm(data.points, axis=-1, keepdims=True)
    reach = np.linalg.norm(data.points, axis=-1)
    white = observed.in_units_of_noise(ray[..., None])[..., 0]
    along_m = np.sqrt((0.25e-6 * reach) ** 2 / readings + 5e-6**2 + 3e-6**2)
    np.testing.assert_allclose(1 / np.linalg.norm(white, axis=-1), along_m, rtol=1e-9)
    assert known and along_m.min() > 5.8e-6


@pytest.mark.parametrize("device", [TRACKER, INSTRUMENTS["uniform-8um"]], ids=lambda device: device.name)
def test_rows_come_back_from_units_of_noise(device: Instrument) -> None:
    observed = weigh(observation_of(ARM), session(7), Noise(device))[0]
    vectors = np.random.default_rng(0).normal(size=(*observed.points.shape, 6))
    back = observed.in_units_of_points(observed.in_units_of_noise(vectors))
    np.testing.assert_allclose(back, vectors, atol=1e-12)
    one = observed.in_units_of_points(observed.in_units_of_noise(vectors[..., 0]))
    np.testing.assert_allclose(one, vectors[..., 0], atol=1e-12)
