"""Differences between two calibrations: the level of the test, and what it names."""

import numpy as np
import pytest
from scipy import stats

from lab.calibration.estimate import IdentifiedSubset
from lab.core.significance import VERIFICATION
from lab.verification.change_points import difference_of

COUNT = 12
SCALE = np.geomspace(1e-6, 1e-3, COUNT)
NAMES = tuple(f"link{i}.theta" for i in range(COUNT))


def covariance(rng: np.random.Generator) -> np.ndarray:
    root = rng.normal(size=(COUNT, 2 * COUNT)) / np.sqrt(2 * COUNT)
    return SCALE[:, None] * (root @ root.T) * SCALE


def pair(rng: np.random.Generator, moved: np.ndarray | float = 0.0, dof: int | None = None) -> tuple:
    """Two estimates of one arm; with ``dof`` their covariance stands on an estimated noise."""
    true, found = rng.normal(size=COUNT), []
    for shift in (0.0, moved):
        own = covariance(rng)
        draw = rng.multivariate_normal(true + shift, own, method="cholesky")
        share = 1.0 if dof is None else rng.chisquare(dof) / dof
        found.append(IdentifiedSubset(NAMES, draw, share * own, (True,) * COUNT, dof))
    return tuple(found)


def test_p_values_are_uniform_and_few_are_named_where_nothing_moved() -> None:
    rng = np.random.default_rng(0)
    found = [difference_of(*pair(rng)) for _ in range(500)]
    assert stats.kstest([each.p for each in found], "uniform").pvalue > 0.01
    named = np.mean([bool(each.moved) for each in found])
    assert named <= VERIFICATION + 3 * np.sqrt(VERIFICATION / 500)
    inside = np.array([np.abs(each.changes) <= each.half_widths for each in found])
    assert inside.mean() == pytest.approx(0.95, abs=0.01)


def test_an_estimated_noise_makes_the_test_no_stricter() -> None:
    rng = np.random.default_rng(1)
    rejected = np.mean([difference_of(*pair(rng, dof=30)).changed for _ in range(500)])
    assert rejected <= VERIFICATION + 3 * np.sqrt(
        VERIFICATION / 500
    )  # with the degrees of freedom of one of the two it is near the level


def test_what_moved_is_named_and_whole_turns_are_nothing() -> None:
    rng = np.random.default_rng(2)
    for which in (0, 5, 11):
        shift = np.zeros(COUNT)
        shift[which] = 12 * SCALE[which] + 2 * np.pi
        found = difference_of(*pair(rng, shift))
        assert found.changed and found.moved[0] == NAMES[which]
        assert found.changes[which] == pytest.approx(12 * SCALE[which], abs=6 * SCALE[which])
    assert not difference_of(*pair(rng, 2 * np.pi)).changed
