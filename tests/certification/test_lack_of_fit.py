"""Validation against a budget: closed forms, and what chance allows."""

from dataclasses import replace

import numpy as np
import pytest

from lab.certification.lack_of_fit import ValidationErrors, lack_of_fit
from lab.core.se3 import Array
from lab.prediction.workspace_prediction import length_not_exceeded

SIGMA_M, POSES = 10e-6, 40
OWN = np.broadcast_to(SIGMA_M**2 * np.eye(3), (POSES, 3, 3))
NOTHING = np.zeros((POSES, 3, 0))


def validated(errors: Array, own: Array = OWN, shared: Array = NOTHING) -> ValidationErrors:
    lengths = np.linalg.norm(errors, axis=1)
    rms, p95 = float(np.sqrt((lengths**2).mean())), float(np.quantile(lengths, 0.95))
    return ValidationErrors(rms, p95, len(errors), own, shared)


def test_errors_that_a_budget_predicts_add_nothing_to_it() -> None:
    """At a level of 5 %, of the mean square and of the largest: of 400 campaigns 40 at most, by three sigma 58."""
    rng = np.random.default_rng(0)
    found = [lack_of_fit(validated(SIGMA_M * rng.standard_normal((POSES, 3)))) for _ in range(400)]
    assert sum(each.sigma_m > 0 for each in found) <= 58
    assert np.mean([each.p < 0.05 for each in found]) == pytest.approx(0.05, abs=3 * np.sqrt(0.0475 / 400))
    assert found[0].expected_rms_m == pytest.approx(np.sqrt(3) * SIGMA_M)


def test_an_excess_is_the_variance_that_is_missing() -> None:
    rng = np.random.default_rng(1)
    found = lack_of_fit(validated(5 * SIGMA_M * rng.standard_normal((POSES, 3))))
    whole = found.observed_rms_m**2 / 3
    assert found.p < 1e-6 and found.sigma_m >= np.sqrt(whole - SIGMA_M**2) * (1 - 1e-9)
    contained = length_not_exceeded((SIGMA_M**2 + found.sigma_m**2) * np.eye(3)[None], None)
    assert contained >= found.observed_95_m * (1 - 1e-5)
    assert 3 <= found.dof <= POSES


def test_what_all_points_share_may_be_large_once() -> None:
    """One shift of all points: three numbers, whose square may be three times what it is on average."""
    shared = 10 * SIGMA_M * np.broadcast_to(np.eye(3), (POSES, 3, 3))
    moved = np.tile([20 * SIGMA_M, 0, 0], (POSES, 1))
    assert lack_of_fit(validated(moved, 1e-6 * OWN, shared)).sigma_m == 0
    alone = np.broadcast_to((10 * SIGMA_M) ** 2 * np.eye(3), (POSES, 3, 3))
    assert lack_of_fit(validated(1.3 * moved, alone)).sigma_m > 0  # as many draws of it are not


def test_long_tails_are_contained_where_the_mean_square_says_nothing() -> None:
    """Three poses in forty are off by six sigma, the others by less than they are on average."""
    errors = np.tile([0.8 * SIGMA_M, 0, 0], (POSES, 1))
    errors[:3] = [6 * SIGMA_M, 0, 0]
    found = lack_of_fit(validated(errors))
    assert found.p > 0.05 and found.sigma_m > 0
    contained = length_not_exceeded((SIGMA_M**2 + found.sigma_m**2) * np.eye(3)[None], None)
    assert contained == pytest.approx(found.observed_95_m, rel=1e-4)


def test_residuals_taken_for_noise_are_given_no_chance() -> None:
    rng = np.random.default_rng(2)
    slightly = validated(1.05 * SIGMA_M * rng.standard_normal((POSES, 3)))
    slightly = replace(slightly, rms_m=1.05 * np.sqrt(3) * SIGMA_M)
    assert lack_of_fit(slightly).sigma_m == 0
    found = lack_of_fit(replace(slightly, all_given=False))
    assert found.sigma_m >= SIGMA_M * np.sqrt(1.05**2 - 1) * (1 - 1e-9)
