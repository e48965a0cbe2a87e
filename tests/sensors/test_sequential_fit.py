"""Angles first, lengths after: exact for exact poses, and worse than the global fit as facts-robots.md says."""

from dataclasses import replace

import numpy as np
import pytest
from helpers.pose_data import measured_poses
from helpers.robots import IRB120, RX130

from lab.calibration.fit_options import FitOptions
from lab.calibration.gauss_newton import Fit, fit
from lab.calibration.identification import identify
from lab.calibration.statistics.goodness_of_fit import goodness_of_fit
from lab.calibration.weights import Noise, weigh
from lab.core.errors import LabError
from lab.core.se3 import Array
from lab.kinematics.serial.serial_arm import SerialArm
from lab.sensors.full_pose import Poses
from lab.sensors.sequential_fit import fit_sequentially, split_of

ARM = SerialArm(RX130)
SIGMA = 1e-4


def both_ways(seed: int, sigma_m: float, sigma_rad: float, arm: SerialArm = ARM) -> tuple[Poses, Fit, Fit, Array]:
    """The observation, the global and the sequential fit, and the truth."""
    observation, data, true = measured_poses(arm, 60, seed, sigma_m, sigma_rad)
    observation = Poses(arm, "p1", sigma_rad / sigma_m if sigma_m else 1.0)
    noise = Noise(sigma_m=sigma_m or None)
    found = identify(observation, data, arm.nominal(), noise)
    seen, _ = weigh(observation, data, noise)
    return observation, found.fit, fit_sequentially(observation, seen, found.fit.free, found.nominal_aligned), true


@pytest.mark.parametrize("arm", [ARM, SerialArm(IRB120.chain)], ids=["craig", "distal"])
def test_exact_poses_come_out_exactly(arm: SerialArm) -> None:
    """Where the literal 16 angles and then 14 lengths leave 0.22 mm."""
    _, _, found, true = both_ways(0, 0.0, 0.0, arm)
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


def test_identify_takes_it_as_a_wish() -> None:
    observation, data, true = measured_poses(ARM, 40, 1)
    found = identify(observation, data, ARM.nominal(), options=FitOptions(solve=fit_sequentially, prior="off"))
    assert found.status == "converged" and np.abs(found.values - true).max() < 1e-11


def test_it_takes_orientations() -> None:
    observation, data, _ = measured_poses(ARM, 40, 0)
    with pytest.raises(LabError, match="--observe pose"):
        identify(ARM, type(data)(**{**data.__dict__, "points": data.points[:, :1], "targets": ("p1",)}),
                 ARM.nominal(), options=FitOptions(solve=fit_sequentially, prior="off"))  # fmt: skip
    blind = data.points.copy()
    blind[:, 1] = np.nan
    seen, _ = weigh(observation, type(data)(**{**data.__dict__, "points": blind}), Noise())
    with pytest.raises(LabError, match="no orientation was seen"):
        fit_sequentially(observation, seen, range(30), observation.nominal(ARM.nominal()))


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
    found = identify(observation, data, ARM.nominal(), noise, FitOptions(solve=fit_sequentially, prior="off"))
    together = identify(observation, data, ARM.nominal(), noise)
    seen, _ = weigh(observation, data, noise)
    assert (seen.apply(found.residuals) ** 2).sum() > 1.5 * (seen.apply(together.residuals) ** 2).sum()
    assert found.residual_sigma_m == pytest.approx(together.residual_sigma_m, rel=1e-3)
    judged = [goodness_of_fit(observation, seen, each.fit, sigma_given=True) for each in (found, together)]
    assert judged[0].outcome == "passed" and judged[0].p == pytest.approx(judged[1].p, abs=5e-3)
