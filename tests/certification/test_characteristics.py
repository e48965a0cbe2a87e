"""ISO 9283 by hand, and distances that need no base."""

import numpy as np
import pytest

from lab.certification.characteristics import conformity_of, distance_errors, pose_accuracy, repeats_of
from lab.core.se3 import exp


def test_accuracy_and_repeatability_by_hand() -> None:
    """A pose visited twice, 2 µm apart about 3 µm off; another once, 4 µm off."""
    errors, labels = 1e-6 * np.array([[[3, 1, 0]], [[3, -1, 0]], [[0, 0, 4]]], dtype=float), np.array([0, 0, 1])
    found, repeated = pose_accuracy(errors, labels), repeats_of(errors, labels, np.array([0.0, 0.6, 1.0]))
    assert (found.accuracy.mean_m, found.accuracy.largest_m) == pytest.approx((3.5e-6, 4e-6))
    assert (found.poses, found.cycles) == (2, (1, 2))
    assert repeated is not None and repeated.repeatability.mean_m == pytest.approx(1e-6)
    assert (repeated.poses, repeated.cycles, repeated.dof, repeated.span) == (1, (2, 2), 3, 0.6)
    assert repeated.scatter_m == pytest.approx(np.sqrt(2e-12 / 3))


def test_scatter_is_that_of_the_draws() -> None:
    rng = np.random.default_rng(0)
    errors = rng.normal(size=(20, 1, 2, 3)) + 5e-6 * rng.normal(size=(20, 30, 2, 3))
    found = repeats_of(errors.reshape(600, 2, 3), np.repeat(np.arange(20), 30), np.linspace(0, 1, 600))
    assert found is not None and found.scatter_m == pytest.approx(5e-6, rel=0.05) and found.dof == 3 * 29 * 40
    assert found.repeatability.mean_m == pytest.approx(3.615 * 5e-6, rel=0.05) and found.poses == 20


def test_repeatability_does_not_depend_on_what_the_model_is_off_by() -> None:
    rng = np.random.default_rng(3)
    errors, labels, places = rng.normal(size=(20, 1, 3)), np.repeat(np.arange(5), 4), np.linspace(0, 1, 20)
    shifted = errors + 100 * rng.normal(size=(5, 1, 3))[labels]
    first, second = (repeats_of(each, labels, places) for each in (errors, shifted))
    assert first is not None and second is not None
    assert second.repeatability.mean_m == pytest.approx(first.repeatability.mean_m, rel=1e-9)


def test_without_repeats_there_is_no_repeatability() -> None:
    assert repeats_of(np.full((4, 1, 3), 1e-6), np.arange(4), np.linspace(0, 1, 4)) is None


@pytest.mark.parametrize("count", [30, 500])
def test_distances_are_the_same_in_any_frame(count: int) -> None:
    """All pairs of few poses, random pairs of many."""
    rng = np.random.default_rng(0)
    points = rng.normal(size=(count, 2, 3))
    moved = points @ exp(np.array([0.3, -0.2, 1.0])).T + np.array([1.0, 2.0, 3.0])
    labels = np.arange(count)
    found = distance_errors(moved, points, labels, np.random.default_rng(1))
    assert np.abs(found).max() < 1e-12 and found.size == (30 * 29 if count == 30 else 100_000)
    grown = distance_errors((1 + 1e-4) * points, points, labels, np.random.default_rng(1))
    assert grown.min() > 0 and grown.mean() == pytest.approx(1e-4 * 2.26, rel=0.1)


def test_visits_to_one_pose_have_no_distance() -> None:
    points = np.random.default_rng(0).normal(size=(3, 1, 3))
    assert distance_errors(points, points, np.array([0, 0, 1]), np.random.default_rng(1)).size == 2


@pytest.mark.parametrize(
    ("value", "rule", "decision"),
    [
        (0.7, "guard-band", "conforms"),
        (0.9, "guard-band", "not decided"),
        (1.1, "guard-band", "not decided"),
        (1.3, "guard-band", "does not conform"),
        (0.9, "simple", "conforms"),
        (1.1, "simple", "does not conform"),
    ],
)
def test_a_tolerance_of_one_with_an_uncertainty_of_a_fifth(value: float, rule, decision: str) -> None:
    found = conformity_of(value, 1.0, 0.2, rule)
    assert found.decision == decision and "JCGM 106" in found.rule_text
