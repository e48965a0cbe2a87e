"""Verdicts on poses and fixtures."""

from dataclasses import replace

import numpy as np
import pytest
from helpers.fixture_data import many, measured_fixtures
from helpers.pose_data import measured_poses
from helpers.robots import IRB120

from lab.calibration.identification import identify
from lab.calibration.weights import Noise
from lab.core.measurements import measured
from lab.kinematics.serial.serial_arm import SerialArm
from lab.phrases.phrase import in_one_line
from lab.prediction.validation import Errors, Validation
from lab.sensors.cable import Cable
from lab.sensors.fixtures import Fixtures
from lab.sensors.full_pose import balanced
from lab.sensors.plane import Planes
from lab.sensors.socket import Sockets
from lab.verdict.verdict import rotation_noise_rad, verdict

ARM = SerialArm(IRB120.chain)
NAMES = IRB120.chain.joint_names
KINDS: dict[str, type[Fixtures]] = {"cable": Cable, "socket": Sockets, "plane": Planes}


FITS = Validation("holdout", Errors(np.zeros((1, 1)), np.zeros((1, 1))))


@pytest.mark.thorough
@pytest.mark.parametrize("kind", KINDS.values(), ids=KINDS)
def test_poses_at_fixtures_are_good(kind) -> None:
    observation = many(kind, 3)
    data, true = measured_fixtures(observation, 120, np.random.default_rng(0))
    found = identify(observation, data, ARM.nominal())
    assert verdict(found, FITS, 1e-3).word == "good"
    off = found.values.copy()
    off[observation.names.index("link4.a")] += 19e-3 - true[observation.names.index("link4.a")]
    assert verdict(replace(found, values=off), FITS, 1e-3).word == "doubtful"  # 38 tolerances from nominal
    off[observation.names.index("link4.a")] += 2e-3
    assert "do not determine link4.a" in in_one_line(verdict(replace(found, values=off), FITS, 1e-3).reasons)


@pytest.mark.thorough
def test_orientations_that_do_not_fit_are_bad() -> None:
    """A constant quaternion beside good positions, whether the noise is given or not; a poor probe is no such thing."""
    for sigma_rad, word in ((1e-4, "good"), (30e-3, "good"), (90e-3, "bad")):
        observation, data, _ = measured_poses(ARM, 60, 0, 1e-4, sigma_rad)
        found = identify(balanced(observation, data, ARM.nominal()), data, ARM.nominal())
        assert rotation_noise_rad(found) == pytest.approx(sigma_rad, rel=0.15)
        assert verdict(found, FITS, 1e-3).word == word
    same = {name: np.full(60, float(name == "p1_qw")) for name in data.conditions}
    constant = replace(data, conditions=same)
    found = identify(balanced(observation, constant, ARM.nominal()), constant, ARM.nominal())
    given = identify(found.model, constant, ARM.nominal(), Noise(sigma_m=1e-4))
    for each in (found, given):
        judged = verdict(each, FITS, 1e-3)
        assert judged.word == "bad" and "measured orientations do not fit" in in_one_line(judged.reasons)


def test_points_have_no_noise_of_rotations() -> None:
    _, data, _ = measured_poses(ARM, 40, 0, 1e-4)
    points = measured(NAMES, data.joints, ("p1",), data.points[:, :1])
    found = identify(ARM, points, ARM.nominal())
    assert np.isnan(rotation_noise_rad(found)) and verdict(found, FITS, 1e-3).word == "good"
    wire = many(Cable, 2)
    found = identify(wire, measured_fixtures(wire, 80, np.random.default_rng(0))[0], ARM.nominal())
    assert np.isnan(rotation_noise_rad(found))
