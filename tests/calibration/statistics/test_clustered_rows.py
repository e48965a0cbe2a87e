"""A test by clusters: its jackknife is that of refits, its level holds, and a plain effect passes in few clusters."""

import numpy as np
import pytest
from scipy.stats import f

from lab.calibration.statistics.linearized import ClusteredRows
from lab.core.se3 import Array

FITTED, ADDED = range(5), range(5, 8)
LABELS = np.repeat(np.arange(14), [1] * 6 + [2] * 4 + [9] * 4)  # things of three numbers: fewer and more than columns


def rows(rng: np.random.Generator, labels: Array = LABELS, columns: int = 8) -> Array:
    """Columns and, last, errors that things of one cluster share by half of their variance."""
    made = rng.normal(size=(3 * len(labels), columns)) * np.exp(0.5 * rng.normal(size=3 * len(labels)))[:, None]
    shared = rng.normal(size=(labels.max() + 1, 3))[labels].ravel()
    return np.column_stack([made, np.sqrt(0.5) * (shared + rng.normal(size=len(shared)))])


def refitted(made: Array, every: Array) -> tuple[Array, Array, Array]:
    """Coefficients ``(3,)`` of the added columns, how leaving out each cluster moves them, and all columns."""
    basis = np.linalg.qr(made[:, FITTED])[0]
    own = np.linalg.svd(made[:, ADDED] - basis @ (basis.T @ made[:, ADDED]), full_matrices=False)[0]
    whole = np.concatenate([basis, own], axis=1)

    def fit(keep: Array) -> Array:
        return np.linalg.lstsq(whole[keep], made[keep, -1], rcond=None)[0][len(FITTED) :]

    found = fit(np.ones(len(made), dtype=bool))
    return found, np.array([found - fit(every != label) for label in np.unique(every)]), whole


def test_the_variance_between_clusters_is_that_of_refits_without_each() -> None:
    """Its degrees of freedom are those of a quadratic form of white errors, of which each cluster's move is linear."""
    made, every = rows(np.random.default_rng(0)), np.repeat(LABELS, 3)
    found, _, whole = refitted(made, every)
    moves = [
        refitted(np.column_stack([made[:, :-1], error]), every)[1].ravel() for error in np.eye(len(made))
    ]  # of unit errors
    form = np.array(moves) @ np.array(moves).T
    dof = np.trace(form) ** 2 / np.trace(form @ form)
    scale = len(ADDED) / np.trace(form)
    covariance = scale * np.einsum("ia,ib->ab", *[refitted(made, every)[1]] * 2)
    test = ClusteredRows.of(made, LABELS, 3).test(FITTED, ADDED)
    assert whole.shape[1] == 8 and test.dof == pytest.approx(dof, rel=1e-9) and test.can_reject

    numbers = np.trace(covariance) ** 2 / np.trace(covariance @ covariance)
    assert test.p == pytest.approx(f.sf(found @ found / np.trace(covariance), numbers, dof), rel=1e-9)


@pytest.mark.thorough
def test_the_level_holds_where_errors_go_together() -> None:
    """1,500 problems of 17 nearly saturated clusters; F of the rows rejects several times as often."""
    rng = np.random.default_rng(1)
    labels = np.repeat(np.arange(17), [3] * 16 + [12])
    p = np.array([ClusteredRows.of(rows(rng, labels), labels, 3).test(FITTED, ADDED).p for _ in range(1500)])
    assert np.mean(p < 0.05) < 0.05 + 2.6 * np.sqrt(0.05 * 0.95 / 1500)
    assert np.mean(p < 0.01) < 0.01 + 2.6 * np.sqrt(0.01 * 0.99 / 1500)
    assert np.mean(p < 0.05) > 0.01  # it is not deaf


def test_an_effect_far_above_the_errors_is_plain_in_few_clusters() -> None:
    """Errors within a cluster are correlated: p falls with the effect, as the effect does not inflate its variance."""
    rng = np.random.default_rng(2)
    labels = np.repeat(np.arange(12), [1] * 11 + [5])
    made = rows(rng, labels)
    found = []
    for size in (0.0, 3.0, 100.0):
        shifted = made.copy()
        shifted[:, -1] += size * made[:, 6]
        found.append(ClusteredRows.of(shifted, labels, 3).test(FITTED, ADDED).p)
    assert found[0] > 0.05 and found[1] < 1e-3 and found[2] < 1e-8


def test_a_cluster_that_alone_shows_a_column_leaves_no_freedom() -> None:
    """However large the effect: without that cluster nothing is known of it."""
    made, every = rows(np.random.default_rng(3)), np.repeat(LABELS, 3)
    made[every != 13, 5] = 0.0
    made[:, -1] += 1e3 * made[:, 5]
    whole = ClusteredRows.of(made, LABELS, 3)
    alone = whole.test(FITTED, [5])
    assert (alone.p, alone.dof, alone.can_reject) == (1.0, 0.0, False)
    assert whole.test([*FITTED, 5], [6]).can_reject  # the others are shown by all


def test_columns_that_the_fitted_ones_hold_are_not_tested() -> None:
    made = rows(np.random.default_rng(4))
    made[:, 5] = made[:, 0] - 2 * made[:, 3]
    assert ClusteredRows.of(made, LABELS, 3).test(FITTED, [5]).dof == 0.0
