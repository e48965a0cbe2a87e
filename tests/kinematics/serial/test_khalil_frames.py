"""Base and tool in Khalil and Kleinfinger's six parameters, there and back."""

import numpy as np
import pytest

from lab.core import se3
from lab.kinematics.serial.khalil_frames import khalil_frame, pose_of


def test_six_parameters_come_back() -> None:
    low, high = np.array([-3.1, -2, 0.05, -2, -3.1, -2]), np.array([3.1, 2, 3.09, 2, 3.1, 2])
    for values in np.random.default_rng(0).uniform(low, high, (50, 6)):
        found = khalil_frame(pose_of(values))
        np.testing.assert_allclose(found.values, values, atol=1e-13 / np.sin(values[2]) ** 2)
        assert found.note == ""


def test_the_definition() -> None:
    """Each of the six alone is what it is called."""
    z, x = np.array([0, 0, 1.0]), np.array([1.0, 0, 0])
    for i, (turn, move) in enumerate(
        [(0.3 * z, 0), (0, 0.3 * z), (0.3 * x, 0), (0, 0.3 * x), (0.3 * z, 0), (0, 0.3 * z)]
    ):
        expected = se3.pose(se3.exp(turn * np.ones(3)), move * np.ones(3))
        np.testing.assert_allclose(pose_of(0.3 * np.eye(6)[i]), expected, atol=1e-16)


PARALLEL = {
    "one axis": (np.array([0, 0, 0.4]), np.array([0, 0, 0.7]), "only gamma + theta and b + r are determined"),
    "two axes": (np.array([0, 0, 0.4]), np.array([0.1, -0.2, 0.7]), "only b + r is determined"),
    "opposite": (np.pi * np.array([1.0, 0, 0]), np.array([0.1, -0.2, 0.7]), "only b - r is determined"),
    "a point": (np.zeros(3), np.array([0.03, 0.02, 0.1]), "only b + r is determined"),
    "nothing": (np.zeros(3), np.zeros(3), "only gamma + theta and b + r are determined"),
}


@pytest.mark.parametrize(("turn", "position", "word"), PARALLEL.values(), ids=PARALLEL)
def test_parallel_axes_are_told(turn, position, word) -> None:
    pose = se3.pose(se3.exp(turn), position)
    found = khalil_frame(pose)
    assert word in found.note and found.values[5] == 0
    np.testing.assert_allclose(pose_of(found.values), pose, atol=1e-13)


def test_nearly_parallel_axes_are_told() -> None:
    pose = se3.pose(se3.exp(np.array([0.01, 0, 0])), np.array([0.1, 0.2, 0.3]))
    found = khalil_frame(pose)
    assert "nearly parallel (0.57°)" in found.note
    np.testing.assert_allclose(pose_of(found.values), pose, atol=1e-12)
