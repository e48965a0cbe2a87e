"""Angles first, lengths after: exact for exact poses, and worse than the global fit as facts-robots.md says."""

from dataclasses import replace

import numpy as np
import pytest
from helpers.pose_data import measured_poses
from helpers.robots import IRB120, RX130, data_file

from lab.calibration.gauss_newton import Fit, fit
from lab.calibration.identify import IdentifyOptions, identify
from lab.calibration.sequential import fit_sequentially, split_of
from lab.calibration.statistics.goodness_of_fit import goodness_of_fit
from lab.calibration.weights import Noise, weigh
from lab.campaign.robot import load_robot
from lab.core.errors import LabError
from lab.core.se3 import Array
from lab.formats.measurement_csv import read_measurements
from lab.kinematics.serial.arm import SerialArm
from lab.sensors.full_pose import Poses, PoseSensor

ARM = SerialArm(RX130)
SIGMA = 1e-4
TABLE = {  # of 40 robots: global in mm, ratio; and where the ratio of twelve lies
    1e-5: (0.0476, 1.000, 0.002),
    1e-4: (0.0497, 1.043, 0.03),
    3e-4: (0.0550, 1.54, 0.3),
    1e-3: (0.0586, 3.9, 1.0),
}


def both_ways(seed: int, sigma_m: float, sigma_rad: float, arm: SerialArm = ARM) -> tuple[Poses, Fit, Fit, Array]:
    """The observation, the global and the sequential fit, and the truth."""
    observation, data, true = measured_poses(arm, 60, seed, sigma_m, sigma_rad)
    observation = Poses(arm, "p1", sigma_rad / sigma_m if sigma_m else 1.0)
    noise = Noise(sigma_m=sigma_m or None)
    found = identify(observation, data, arm.nominal(), noise)
    seen, _ = weigh(observation, data, noise)
    return observation, found.fit, fit_sequentially(observation, seen, found.fit.free, found.nominal_aligned), true


def fresh_mm(values: Array, true: Array, seed: int) -> float:
    joints = RX130.random_joints(500, np.random.default_rng(seed + 1000))
    off = ARM.points(joints, values[:-3]) - ARM.points(joints, true[:-3])
    return 1e3 * float(np.linalg.norm(off, axis=2).mean())


@pytest.mark.thorough
@pytest.mark.parametrize("arm", [ARM, SerialArm(IRB120.chain)], ids=["craig", "distal"])
def test_exact_poses_come_out_exactly(arm: SerialArm) -> None:
    """Where the literal 16 angles and then 14 lengths leave 0.22 mm."""
    for seed in range(3):
        _, _, found, true = both_ways(seed, 0.0, 0.0, arm)
        assert found.status == "converged" and found.iterations <= 12
        assert np.abs(found.values - true).max() < 1e-11


def test_orientations_see_fifteen_angles_and_not_the_sixteenth() -> None:
    observation, data, _ = measured_poses(ARM, 60, 0)
    found = identify(observation, data, ARM.nominal())
    seen, _ = weigh(observation, data, Noise())
    split = split_of(observation, seen, found.fit.free, found.nominal_aligned)
    assert len(split.angles) == 15 == 7 * 3 - 6 and split.rest.shape == (37, 15)
    hidden = [column for column in split.rest.T if (column != 0).sum() > 1]
    assert len(hidden) == 1
    moved = {observation.names[i]: hidden[0][i] for i in np.flatnonzero(hidden[0])}
    assert set(moved) == {"link2.theta", "link3.theta"}
    assert moved["link2.theta"] == pytest.approx(-moved["link3.theta"], abs=1e-9)


@pytest.mark.thorough
@pytest.mark.parametrize("sigma_rad", [pytest.param(each, marks=[pytest.mark.slow] * (each != 1e-3)) for each in TABLE])
def test_the_table_of_noises(sigma_rad: float) -> None:
    """Global against sequential, 60 poses, 0.1 mm: facts-robots.md, section 3, from fewer robots."""
    exact, ratio, about = TABLE[sigma_rad]
    together, apart, repaired = [], [], []
    for seed in range(12):
        observation, data, true = measured_poses(ARM, 60, seed, SIGMA, sigma_rad)
        observation = Poses(ARM, "p1", sigma_rad / SIGMA)
        seen, _ = weigh(observation, data, Noise(sigma_m=SIGMA))
        found = identify(observation, data, ARM.nominal(), Noise(sigma_m=SIGMA))
        first = fit_sequentially(observation, seen, found.fit.free, found.nominal_aligned)
        assert first.status == "converged" and first.rank == 30
        after = fit(observation, seen, found.fit.free, first.values, tolerance_m=np.inf).values  # one global step
        together.append(fresh_mm(found.values, true, seed))
        apart.append(fresh_mm(first.values, true, seed))
        repaired.append(fresh_mm(after, true, seed))
    assert np.mean(together) == pytest.approx(exact, rel=0.15)
    assert np.mean(apart) / np.mean(together) == pytest.approx(ratio, abs=about)
    np.testing.assert_allclose(repaired, together, rtol=1e-3)


def test_identify_takes_it_as_a_wish() -> None:
    observation, data, true = measured_poses(ARM, 40, 1)
    found = identify(observation, data, ARM.nominal(), request=IdentifyOptions(solve=fit_sequentially))
    assert found.status == "converged" and np.abs(found.values - true).max() < 1e-11


def test_it_takes_orientations() -> None:
    observation, data, _ = measured_poses(ARM, 40, 0)
    with pytest.raises(LabError, match="--observe pose"):
        identify(ARM, type(data)(**{**data.__dict__, "points": data.points[:, :1], "targets": ("p1",)}),
                 ARM.nominal(), request=IdentifyOptions(solve=fit_sequentially))  # fmt: skip
    blind = data.points.copy()
    blind[:, 1] = np.nan
    seen, _ = weigh(observation, type(data)(**{**data.__dict__, "points": blind}), Noise())
    with pytest.raises(LabError, match="no orientation was seen"):
        fit_sequentially(observation, seen, range(30), observation.nominal(ARM.nominal()))


@pytest.mark.thorough
def test_on_a_measured_arm_it_is_worse() -> None:
    """UR10, 632 poses in cubes, where the hand hardly turns: orientations alone do not hold the angles there."""
    robot = load_robot("ur10")
    file = data_file("ur10_ipa_D.csv")
    data = read_measurements(file, robot.chain.joint_names, robot.chain.prismatic, columns=PoseSensor.columns)
    assert not data.warnings
    arm = robot.arm(("p1",))
    observation, seen = PoseSensor("intrinsic-xyz").observation(arm, data, arm.nominal())
    together = identify(observation, seen, arm.nominal())
    apart = identify(observation, seen, arm.nominal(), request=IdentifyOptions(solve=fit_sequentially))
    rms = [float(np.sqrt((found.residuals[:, 0] ** 2).mean())) for found in (together, apart)]
    assert together.status == "converged" and rms[0] < 0.25e-3 < rms[1]


@pytest.mark.thorough
def test_its_covariance_is_that_of_its_own_errors() -> None:
    """Small errors of the measurements change its estimates as its covariance says: by its own derivatives, one by one.

    Each whitened number is moved alone; the estimates' changes K are those of the fit itself, and C = K K'. No other
    linear estimate without bias is better than the global one (Gauss & Markov): C less its covariance is no less than
    zero. The interval of an angle that carries the noise of orientations is wider than the global one.
    """
    sigma_rad = 1e-3
    observation, data, true = measured_poses(ARM, 10, 2)
    observation = Poses(ARM, "p1", sigma_rad / SIGMA)
    seen, _ = weigh(observation, data, Noise(sigma_m=SIGMA))
    free = identify(observation, data, ARM.nominal(), Noise(sigma_m=SIGMA)).fit.free
    found = fit_sequentially(observation, seen, free, true)
    moved = []
    for at in np.ndindex(seen.points.shape):
        points = seen.points.copy()
        points[at] += 1e-3 / seen.whiten[at[:2]]
        moved.append((fit_sequentially(observation, replace(seen, points=points), free, true).values - true) / 1e-3)
    changes = np.array(moved).T[list(free)]
    expected, covariance = changes @ changes.T, found.unit_covariance()
    size = np.sqrt(np.outer(np.diag(expected), np.diag(expected)))
    np.testing.assert_allclose(covariance / size, expected / size, atol=2e-3)
    together = fit(observation, seen, free, true).unit_covariance()
    assert np.linalg.eigvalsh((covariance - together) / size).min() > -1e-9
    assert (np.diag(covariance) > 1.5 * np.diag(together)).any()


def test_noise_and_goodness_are_those_of_least_squares() -> None:
    """What angles from orientations alone leave of the positions is no lack of fit, and no noise of the instrument."""
    sigma_rad = 1e-3
    _, data, _ = measured_poses(ARM, 60, 4, SIGMA, sigma_rad)
    observation, noise = Poses(ARM, "p1", sigma_rad / SIGMA), Noise(sigma_m=SIGMA)
    found = identify(observation, data, ARM.nominal(), noise, IdentifyOptions(solve=fit_sequentially))
    together = identify(observation, data, ARM.nominal(), noise)
    seen, _ = weigh(observation, data, noise)
    assert (seen.apply(found.residuals) ** 2).sum() > 1.5 * (seen.apply(together.residuals) ** 2).sum()
    assert found.residual_sigma_m == pytest.approx(together.residual_sigma_m, rel=1e-3)
    judged = [goodness_of_fit(observation, seen, each.fit, sigma_given=True) for each in (found, together)]
    assert judged[0].outcome == "passed" and judged[0].p == pytest.approx(judged[1].p, abs=5e-3)
