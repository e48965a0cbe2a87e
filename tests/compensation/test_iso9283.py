"""ISO 9283: the test cube, accuracy and repeatability by hand."""

import numpy as np
import pytest
from iso_cube import circle_positions, cube_positions, line_positions

from lab.compensation.iso9283 import accuracy, repeatability


def test_the_poses_of_the_cube() -> None:
    """P1 is the centre; P2 to P5 are a tenth of the plane's diagonal from its corners, in one plane."""
    positions = cube_positions(0.4)
    corner = np.array([0.2, 0.2, 0.2])
    assert not positions[0].any() and np.linalg.matrix_rank(positions) == 2
    np.testing.assert_allclose(np.linalg.norm(positions[1:], axis=1), 0.8 * np.linalg.norm(corner))
    assert np.linalg.norm(corner - positions[1]) == pytest.approx(0.1 * 2 * np.linalg.norm(corner))
    np.testing.assert_allclose(positions[1:].sum(axis=0), 0, atol=1e-15)


def test_paths_are_in_the_same_plane() -> None:
    circle, line = circle_positions(0.4, 36), line_positions(0.4, 11)
    np.testing.assert_allclose(np.linalg.norm(circle, axis=1), 0.16)
    np.testing.assert_allclose(line[[0, -1]], cube_positions(0.4)[[1, 2]])
    together = np.concatenate([circle, line, cube_positions(0.4)])
    assert np.linalg.matrix_rank(together, tol=1e-12) == 2


def test_accuracy_and_repeatability_by_hand() -> None:
    wanted = np.zeros((1, 3))
    points = np.array([[[3.0, 0, 0]], [[5.0, 0, 0]]])  # the mean is 4, each 1 away from it
    assert accuracy(points, wanted) == pytest.approx([4.0])
    assert repeatability(points) == pytest.approx([1.0])  # no scatter of the distances
    spread = np.array([[[0.0, 0, 0]], [[0.0, 0, 0]], [[3.0, 0, 0]]])  # distances 1, 1, 2: deviation sqrt(1 / 3)
    assert repeatability(spread) == pytest.approx([4 / 3 + 3 * np.sqrt(1 / 3)])
