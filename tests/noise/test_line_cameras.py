"""The noise of three line cameras, against their triangulation from noisy angles."""

import numpy as np
import pytest

from lab.noise.instruments import INSTRUMENTS

KRYPTON = INSTRUMENTS["krypton-k600"]


def triangulated(point: np.ndarray, noise: np.ndarray) -> np.ndarray:
    """Points ``(n, 3)`` that cameras on a bar along y see by noisy azimuths from both ends, and an elevation."""
    half = KRYPTON.baseline_m / 2
    first = np.arctan2(point[1] + half, point[0]) + noise[:, 0]
    second = np.arctan2(point[1] - half, point[0]) + noise[:, 1]
    x = 2 * half / (np.tan(first) - np.tan(second))
    y = x * np.tan(first) - half
    return np.stack([x, y, np.hypot(x, y) * np.tan(np.arctan2(point[2], np.hypot(*point[:2])) + noise[:, 2])], axis=1)


@pytest.mark.parametrize("reach", [1.5, 2.5, 5.0])
def test_the_covariance_is_that_of_a_triangulation(reach: float) -> None:
    noise = KRYPTON.angle_rad * np.random.default_rng(0).standard_normal((40_000, 3))
    found = np.cov(triangulated(np.array([reach, 0.0, 0.0]), noise).T)
    np.testing.assert_allclose(found, KRYPTON.covariance(np.array([reach, 0, 0])), atol=0.03 * found.max(), rtol=0.03)
