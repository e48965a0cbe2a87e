"""The next pose: as an exhaustive search finds it; the noise: no false alarm although it is looked at often."""

import numpy as np
import pytest
from scipy import stats

from lab.pose_selection.criteria import criterion
from lab.pose_selection.sequential_choice import best_candidates, noise_check

RNG = np.random.default_rng(3)
POOL = RNG.standard_normal((300, 3, 8)) * np.geomspace(0.1, 3.0, 8)
INFORMATION = np.einsum("mrp,mrq->pq", POOL[:6], POOL[:6])
TEST = RNG.standard_normal((40, 3, 8))


@pytest.mark.parametrize("name", ["O1", "I", "A", "O3"])
def test_the_best_candidate_is_that_of_an_exhaustive_search(name: str) -> None:
    goal = criterion(name, 8, TEST)
    rows, gains = best_candidates(goal, INFORMATION, POOL)
    every = np.array([float(goal.score(INFORMATION + part.T @ part)) for part in POOL]) - goal.score(INFORMATION)
    assert rows[0] == np.argmax(every)
    np.testing.assert_allclose(gains, every[rows], rtol=1e-9, atol=1e-12)
    assert (np.diff(gains) <= 0).all()


def sessions(times: float, count: int = 1000, looks: int = 30) -> float:
    """Share of sessions in which the noise is found larger at one of the looks, three residuals more at each."""
    squares = times**2 * RNG.standard_normal((count, looks, 3)) ** 2
    sums = squares.sum(axis=2).cumsum(axis=1)
    found = np.zeros(count, dtype=bool)
    for look in range(looks):
        dof = 3 * (look + 1)
        found |= [noise_check(float(ratio), dof, look + 1).larger for ratio in np.sqrt(sums[:, look] / dof)]
    return float(found.mean())


def test_looking_often_finds_no_noise_that_is_not_there() -> None:
    assert sessions(1.0) <= 0.05


def test_noise_of_twice_the_stated_size_is_found() -> None:
    assert sessions(2.0, count=300) > 0.99


def test_predicted_errors_count_with_the_larger_noise() -> None:
    """Never with less than the stated noise; with an upper confidence bound where the noise is shown to be larger."""
    assert noise_check(0.7, 30, 1).factor == 1.0
    assert noise_check(1.1, 30, 1).factor == 1.1
    found = noise_check(2.0, 30, 1)
    level = 0.05 * 6 / np.pi**2
    assert found.larger and found.factor == pytest.approx(2.0 * np.sqrt(30 / stats.chi2.ppf(level, 30)))
