"""Noise that is correlated, or has heavy tails, keeps its variance; the rest of a campaign stays as it is."""

import numpy as np
import pytest

import lab
from lab.core.errors import LabError
from lab.kinematics.effects.readings import ShapedNoise


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


def test_a_step_is_of_its_size_at_its_pose_and_leaves_the_mean() -> None:
    plain, moved = (
        lab.simulate(
            "irb120", poses=20, seed=3, effects=lab.Effects(step_mm=size, step_after=after)
        ).measurements.points
        for size, after in ((0.0, 0), (0.05, 14))
    )
    apart = (moved - plain)[:, 0]
    np.testing.assert_allclose(apart.mean(axis=0), 0.0, atol=1e-12)
    steps = np.linalg.norm(np.diff(apart, axis=0), axis=1)
    assert steps[13] == pytest.approx(50e-6) and np.delete(steps, 13).max() < 1e-12
    half = ShapedNoise(0.0, np.inf, 1e-3).shaped(np.zeros((9, 1, 3)), np.random.default_rng(0))
    assert np.linalg.norm(half[4] - half[5]) == pytest.approx(1e-3) and np.array_equal(half[0], half[4])


def test_the_time_of_a_step_without_a_size_is_refused() -> None:
    with pytest.raises(LabError, match="--step-after 4: give --step-mm"):
        lab.simulate("irb120", poses=5, effects=lab.Effects(step_after=4))


@pytest.mark.parametrize(("option", "value"), [("noise_correlation", 1.0), ("noise_tail_dof", 2.0)])
def test_impossible_noise_is_refused(option: str, value: float) -> None:
    with pytest.raises(LabError, match="--" + option.replace("_", "-")):
        lab.simulate("irb120", poses=5, **{option: value})
