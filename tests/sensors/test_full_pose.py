"""Full poses: derivatives, ranks, exact recovery, the ratio of the two noises, a measured arm."""

from dataclasses import replace

import numpy as np
import pytest
from helpers.fixture_data import many, measured_fixtures
from helpers.pose_data import measured_poses
from helpers.robots import IRB120, RX130, assert_derivatives

from lab.calibration.identification import identify
from lab.calibration.observation import Observation, observation_of
from lab.calibration.weights import Noise
from lab.core import se3
from lab.core.errors import LabError
from lab.core.se3 import Array
from lab.kinematics.gauge import base_set
from lab.kinematics.serial.serial_arm import SerialArm
from lab.noise.instruments import INSTRUMENTS
from lab.sensors.cable import Cable
from lab.sensors.full_pose import Poses, balanced

ARM = SerialArm(IRB120.chain)


def log_of_small(rotation: Array) -> Array:
    """Rotation vector of a rotation by less than a quarter turn, written so that a complex step passes."""
    odd = (rotation - np.swapaxes(rotation, -1, -2)) / 2
    sine = np.stack([odd[..., 2, 1], odd[..., 0, 2], odd[..., 1, 0]], axis=-1)
    size = np.sqrt((sine * sine).sum(axis=-1, keepdims=True))
    return np.arcsin(size) / size * sine


@pytest.mark.parametrize("arm", [ARM, SerialArm(RX130), SerialArm(IRB120.chain, ("p1", "p2"))], ids=["1", "craig", "2"])
def test_derivatives_of_poses(arm: SerialArm) -> None:
    """The residual's own formula, complex, at rotations by up to a radian: not the code's."""
    observation, data, true = (
        measured_poses(arm, 6, 0, sigma_rad=0.3) if len(arm.targets) == 1 else (Poses(arm, "p1"), None, None)
    )
    rng = np.random.default_rng(1)
    if data is None:
        true = observation.nominal(arm.nominal()) + 0.1 * rng.normal(size=len(observation.names))
        joints = arm.chain.random_joints(6, rng)
        near = arm.flange(joints, true[:-3])[:, :3, :3] @ se3.exp(true[-3:] + 0.2)
        inputs = np.column_stack([joints, se3.quaternion_from_rotation(near)])
    else:
        inputs = data.inputs(observation.conditions)
    measured_back = np.swapaxes(se3.rotation_from_quaternion(inputs[:, -4:]), 1, 2)

    def rotation(values: Array) -> Array:
        predicted = arm.flange(inputs[:, :-4], values[:-3])[:, :3, :3] @ se3.exp(values[-3:])
        return log_of_small(measured_back @ predicted)

    observed, jacobian = observation.observe(inputs, true)
    np.testing.assert_allclose(observed[:, -1], rotation(true), atol=1e-14)
    assert 0.1 < np.abs(observed[:, -1]).max() < 1.2
    assert_derivatives(rotation, jacobian[:, -1], true, relative=1e-12)
    assert_derivatives(lambda v: arm.points(inputs[:, :-4], v[:-3]), jacobian[:, :-1], true)


def test_ranks_of_poses() -> None:
    """4 R + 6 of a pose (facts.md, section 2), and the same ones whatever the numbers."""
    for chain in (IRB120.chain, RX130):
        observation = Poses(SerialArm(chain), "p1")
        kept = base_set(observation, observation.nominal(SerialArm(chain).nominal())).identifiable
        assert len(kept) == 30 and len(observation.names) == 37
        assert {"tool.rx", "tool.ry", "tool.rz"} <= {observation.names[i] for i in kept}
    three = SerialArm(IRB120.chain, ("p1", "p2", "p3"))
    observation = Poses(three, "p2")
    assert len(base_set(observation, observation.nominal(three.nominal())).identifiable) == 33 + 3


def test_exact_poses_give_the_truth() -> None:
    for seed, arm in enumerate([ARM, SerialArm(RX130)]):
        observation, data, true = measured_poses(arm, 30, seed)
        assert isinstance(observation, Observation) and observation_of(observation) is observation
        found = identify(observation, data, arm.nominal())
        assert found.status == "converged" and len(found.fit.free) == 30 and found.spread == pytest.approx(1, abs=0.2)
        assert np.abs(found.values - true).max() < 1e-11


@pytest.mark.thorough
def test_the_ratio_of_the_noises_is_found() -> None:
    """From 60 poses 2 (180 - 15) numbers: one part in 18 or so for each; and from either side."""
    ratios = []
    for seed in range(6):
        observation, data, _ = measured_poses(ARM, 60, seed, 1e-4, 3e-4)
        found = [balanced(replace(observation, ratio=start), data, ARM.nominal()).ratio for start in (0.1, 30.0)]
        assert found[0] == pytest.approx(found[1], rel=0.02)
        ratios.append(found[0])
    assert np.mean(ratios) == pytest.approx(3.0, rel=0.08)
    assert np.std(ratios) < 0.5


def test_a_trackers_weights_are_for_positions() -> None:
    observation, data, true = measured_poses(ARM, 40, 0, 1e-5, 1e-5)
    found = identify(observation, data, ARM.nominal(), Noise(INSTRUMENTS["leica-at960"]))
    assert found.status == "converged" and np.abs(found.values - true).max() < 1e-3
    cable = many(Cable, 2)
    with pytest.raises(LabError, match=r"leica-at960 measures points.*--noise-mm"):
        identify(cable, measured_fixtures(cable, 80, np.random.default_rng(0))[0], ARM.nominal(),
                 Noise(INSTRUMENTS["leica-at960"]))  # fmt: skip


def test_rows_without_an_orientation_still_give_a_position() -> None:
    observation, data, true = measured_poses(ARM, 30, 2)
    points = data.points.copy()
    points[::3, 1] = np.nan
    points[1::3, 0] = np.nan
    found = identify(observation, replace(data, points=points), ARM.nominal())
    assert np.abs(found.values - true).max() < 1e-11
    assert np.isnan(observation.errors(replace(data, points=points), true)[1::3]).all()
