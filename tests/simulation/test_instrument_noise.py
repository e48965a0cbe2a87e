"""Noise that is correlated, or has heavy tails, keeps its variance; the rest of a campaign stays as it is."""

import numpy as np
import pytest

import lab
from lab.core.errors import LabError
from lab.kinematics.effects.instrument_noise import ShapedNoise


def test_correlated_noise_has_its_correlation_and_variance() -> None:
    rng = np.random.default_rng(0)
    made = ShapedNoise(0.9, np.inf).shaped(rng.standard_normal((4000, 2, 3)), rng)
    assert made.std() == pytest.approx(1.0, abs=0.1)
    assert np.mean(made[1:] * made[:-1]) / made.var() == pytest.approx(0.9, abs=0.02)


def test_stretched_noise_has_the_tails_of_student_and_its_variance() -> None:
    rng = np.random.default_rng(1)
    made = ShapedNoise(0.0, 3.0).shaped(rng.standard_normal((30_000, 1, 3)), rng)
    expected = rng.standard_t(3, made.size) / np.sqrt(3)
    for level in (0.5, 0.9, 0.99):
        assert np.quantile(np.abs(made), level) == pytest.approx(np.quantile(np.abs(expected), level), rel=0.05)


def test_the_arm_and_its_poses_stay() -> None:
    plain, shaped = (
        lab.simulate("irb120", poses=5, seed=3, noise_correlation=rho, noise_tail_dof=dof)
        for rho, dof in ((0.0, 0.0), (0.9, 3.0))
    )
    assert np.array_equal(plain.measurements.joints, shaped.measurements.joints)
    assert not np.array_equal(plain.measurements.points, shaped.measurements.points)
    assert np.abs(plain.measurements.points - shaped.measurements.points).max() < 1e-3


@pytest.mark.parametrize(("option", "value"), [("noise_correlation", 1.0), ("noise_tail_dof", 2.0)])
def test_impossible_noise_is_refused(option: str, value: float) -> None:
    with pytest.raises(LabError, match="--" + option.replace("_", "-")):
        lab.simulate("irb120", poses=5, **{option: value})
