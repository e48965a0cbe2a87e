"""Heavy tails: told from Gaussian noise, not from bad readings, and weighed by the tests of outliers and of change."""

import numpy as np
import pytest

from lab.calibration.noise_search import tail_dof
from lab.calibration.statistics.linearized import LinearizedFit, NoiseDistribution
from lab.core.significance import VERIFICATION
from lab.verification.predicted_points import CalibrationPrediction


def residuals(rng: np.random.Generator, errors: np.ndarray) -> LinearizedFit:
    """What least squares of 20 random columns leaves of errors ``(n, m)``."""
    columns = rng.standard_normal((errors.size, 20))
    columns /= np.linalg.norm(columns, axis=0)
    left = errors.ravel() - columns @ np.linalg.lstsq(columns, errors.ravel(), rcond=None)[0]
    mask = np.ones(errors.shape, dtype=bool)
    return LinearizedFit(left.reshape(errors.shape), columns.reshape(*errors.shape, 20), np.ones(20), mask, len(errors))


def test_heavy_tails_are_told_and_gaussian_ones_are_not() -> None:
    rng = np.random.default_rng(0)
    heavy = [tail_dof(residuals(rng, rng.standard_t(3, (80, 3)))) for _ in range(15)]
    light = [tail_dof(residuals(rng, rng.standard_normal((80, 3)))) for _ in range(15)]
    assert sum(np.isfinite(heavy)) >= 13 and np.median(heavy) <= 4.0
    assert sum(np.isfinite(light)) <= 4


def test_bad_readings_are_no_tails() -> None:
    """They lie beyond what the shape is fitted to, however many there are."""
    rng = np.random.default_rng(1)
    found = []
    for _ in range(15):
        errors = rng.standard_normal((80, 3))
        errors[rng.random(80) < 0.1] += 100.0
        columns = LinearizedFit(errors, np.zeros((80, 3, 1)), np.ones(1), np.ones((80, 3), dtype=bool), 80)
        found.append(tail_dof(columns))
    assert sum(np.isfinite(found)) <= 4


def test_the_draws_have_unit_variance() -> None:
    drawn = NoiseDistribution("student", dof=6.0).draw((200_000,), np.random.default_rng(2))
    assert drawn.var() == pytest.approx(1.0, abs=0.03)
    assert NoiseDistribution("student", dof=6.0).excess_kurtosis == pytest.approx(3.0)


def test_a_verification_against_heavy_tails_keeps_its_level() -> None:
    """One that takes the noise for Gaussian does not."""
    rng, numbers, dof = np.random.default_rng(3), 24, 200
    tailed, gaussian = (
        CalibrationPrediction(None, np.zeros(1), (), np.zeros((0, 0)), dof, tail_dof=tail)  # type: ignore[arg-type]
        for tail in (3.0, None)
    )
    alarms = np.zeros(2)
    for _ in range(600):
        new, old = rng.standard_t(3, numbers), rng.standard_t(3, dof)
        square = float((new**2).sum() / (old**2).mean())
        alarms += [tailed.p(square, numbers) < VERIFICATION, gaussian.p(square, numbers) < VERIFICATION]
    assert alarms[0] <= 14 < alarms[1]  # 6 expected; more than 14 in one of 700 studies
