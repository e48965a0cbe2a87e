"""The loop closed: ISO 9283, and corrected targets run on a virtual arm."""

from types import SimpleNamespace

import numpy as np
import pytest
from helpers.robots import IRB120
from helpers.run_script import answer_in_processes, answer_of
from iso_cube import circle_positions, cube_positions, line_positions

from lab.compensation.iso9283 import accuracy, repeatability
from lab.simulation.collisions import random_poses


def test_the_poses_are_those_of_the_standard() -> None:
    """P2 to P5 are a tenth of the diagonal away from the corners of a plane through two opposite edges."""
    side = 0.4
    places = cube_positions(side)
    assert (places[0] == 0).all()
    corners = side / 2 * np.array([[1, 1, 1], [-1, -1, -1], [1, 1, -1], [-1, -1, 1]])
    diagonal = np.sqrt(3) * side
    np.testing.assert_allclose(np.linalg.norm(corners - places[1:], axis=1), 0.1 * diagonal, rtol=1e-12)
    normal = np.array([1, -1, 0]) / np.sqrt(2)
    circle, line = circle_positions(side, 36), line_positions(side, 11)
    for points in (places, circle, line):
        assert np.abs(points @ normal).max() < 1e-15
    np.testing.assert_allclose(np.linalg.norm(circle, axis=1), 0.4 * side, rtol=1e-12)
    np.testing.assert_allclose(line[[0, -1]], places[[1, 2]], atol=1e-15)


def test_accuracy_and_repeatability_of_a_known_scatter() -> None:
    """On a sphere of radius r about a mean that is off by d: AP = d and RP = r."""
    rng = np.random.default_rng(0)
    directions = rng.normal(size=(15, 2, 3))
    directions /= np.linalg.norm(directions, axis=2)[..., None]
    scatter = np.concatenate([directions, -directions])  # the mean stays
    wanted, off = rng.normal(size=(2, 3)), np.array([[3e-3, 0, 4e-3], [0, 0, 0]])
    points = wanted + off + 1e-5 * scatter
    np.testing.assert_allclose(accuracy(points, wanted), [5e-3, 0], atol=1e-15)
    np.testing.assert_allclose(repeatability(points), 1e-5, rtol=1e-9)
    gaussian = repeatability(wanted + 1e-5 * rng.normal(size=(200_000, 2, 3)))
    np.testing.assert_allclose(gaussian, 1e-5 * (1.5958 + 3 * 0.6734), rtol=0.01)  # Maxwell's mean and deviation


@pytest.mark.thorough
def test_a_compensated_arm_that_bends_hits(monkeypatch: pytest.MonkeyPatch) -> None:
    poses = SimpleNamespace(joints=random_poses(IRB120.model, 40, np.random.default_rng(0)))  # without any choice
    monkeypatch.setattr("closed_loop.pose_problem", lambda asked: None)
    monkeypatch.setattr("closed_loop.best_design", lambda *_: poses)
    monkeypatch.setattr("closed_loop.POSES", 40)
    bent = answer_of("closed_loop.py", "--arms", 1, "--targets", 20, "--stiffness-nm-per-rad", 1e5, "--payload-kg", 3)
    assert 1 <= bent["ap_before_mm"] <= 4 and 0.002 < bent["rp_mm"] < 0.02
    assert bent["model"] == "compliance" and bent["ap_after_mm"] <= 0.015 and bent["targets_after_mm"] <= 0.015
    assert bent["ap_after_mm_without_compliance"] > bent["ap_after_mm"] + 0.03


@pytest.mark.slow
def test_compensated_arms_hit() -> None:
    found = answer_in_processes("closed_loop.py")
    assert 1 <= found["ap_before_mm"] <= 4 and found["ap_after_mm"] <= 0.010
    assert found["targets_before_mm"] > 1 and found["targets_after_mm"] <= 0.012
    assert 0.002 < found["rp_mm"] < 0.02
    bent = answer_in_processes("closed_loop.py", "--stiffness-nm-per-rad", 1e5, "--payload-kg", 3)
    assert bent["model"] == "compliance" and bent["ap_after_mm"] <= 0.03
    assert bent["ap_after_mm_without_compliance"] > bent["ap_after_mm"] + 0.03
