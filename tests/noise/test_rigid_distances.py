"""The instrument's noise from distances between targets: its interval, and what does and does not change it."""

import numpy as np
import pytest
from helpers.robots import IRB120
from scipy import stats

from lab.noise.rigid_distances import CoordinateNoise, goodness_by_distances, instrument_noise

SIGMA, POSES, THREE = 8e-6, 40, ("p1", "p2", "p3")
ARM = IRB120.arm(THREE)
NOMINAL = ARM.nominal(IRB120.tool)


def points(seed: int, scatter: float = 0.0, drift: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
    """Joint positions and what an instrument measures of joints that scatter, from a base that drifts."""
    rng = np.random.default_rng(seed)
    joints = IRB120.chain.random_joints(POSES, rng)
    moved = ARM.points(joints + scatter * rng.standard_normal(joints.shape), NOMINAL)
    moved += drift * np.linspace(-1, 1, POSES)[:, None, None] * rng.standard_normal(3)
    return joints, moved + SIGMA * rng.standard_normal(moved.shape)


@pytest.mark.parametrize(("scatter", "drift"), [(0.0, 0.0), (1e-3, 1e-3)])
def test_the_interval_holds_the_noise_whatever_arm_and_base_do(scatter: float, drift: float) -> None:
    """Of 100 intervals of 95 %: fewer than 88 have a chance of 0.1 %; the mean square is sigma^2 to 3 of its own."""
    found = [instrument_noise(points(seed, scatter, drift)[1]) for seed in range(100)]
    assert all(each is not None and each.dof == 3 * (POSES - 1) for each in found)
    assert sum(each.low_m <= SIGMA <= each.high_m for each in found if each) >= 88
    squares = np.array([each.sigma_m**2 for each in found if each])
    assert squares.mean() == pytest.approx(SIGMA**2, rel=3 * np.sqrt(2 / (117 * 100)))
    assert sum(not each.is_rigid for each in found if each) <= 2


def test_four_targets_say_more_than_three_and_targets_in_a_line_nothing() -> None:
    rng = np.random.default_rng(0)
    corners = np.array([[0, 0, 0], [0.1, 0, 0], [0, 0.1, 0], [0, 0, 0.1]])
    made = corners + SIGMA * rng.standard_normal((50, 4, 3))
    four, line = instrument_noise(made), np.linspace(0, 0.1, 3)[:, None] * np.array([1.0, 0, 0])
    assert four is not None and four.dof == 49 * 6 and four.sigma_m == pytest.approx(SIGMA, rel=0.2)
    assert instrument_noise(line + SIGMA * rng.standard_normal((50, 3, 3))) is None
    assert instrument_noise(made[:, :2]) is None and instrument_noise(made[:5]) is None


@pytest.mark.parametrize("how", ["the tool bends", "two trackers drift apart"])
def test_targets_that_move_against_each_other_are_told(how: str) -> None:
    made, along = points(1)[1], np.linspace(0, 60e-6, POSES)
    if how == "the tool bends":
        apart = made[:, 2] - made[:, 0]
        made[:, 2] += along[:, None] * apart / np.linalg.norm(apart, axis=1, keepdims=True)
    else:
        made[:, 2, 0] += along
    found = instrument_noise(made)
    assert found is not None and not found.is_rigid


def test_the_test_of_a_fit_is_an_f_of_what_the_distances_leave() -> None:
    instrument = CoordinateNoise(SIGMA, 0.0, 1.0, 117, 1.0)
    judged = goodness_by_distances((117 + 1.3 * 210) * SIGMA**2, 327, instrument)
    assert judged is not None and judged.p == pytest.approx(stats.f.sf(1.3, 210, 117), rel=1e-9)
    assert goodness_by_distances(117 * SIGMA**2, 117, instrument) is None
