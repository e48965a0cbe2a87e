"""The bound of all designs by a criterion."""

import numpy as np
import pytest

from lab.core.se3 import Array
from lab.pose_selection.certificate import certify_criterion
from lab.pose_selection.criteria import Criterion, criterion
from lab.pose_selection.exchange import information

CONCAVE = ("O1", "A", "G", "I", "O5")


def random_pool(name: str, size: int = 60, parameters: int = 4, seed: int = 0) -> tuple[Criterion, Array, Array]:
    """A criterion, candidates of unlike sizes, and no poses measured before."""
    rng = np.random.default_rng(seed)
    pool = rng.normal(size=(size, 3, parameters)) * rng.uniform(0.2, 3, (size, 1, 1))
    return criterion(name, parameters, rng.normal(size=(12, 3, parameters))), pool, pool[:0]


def value(goal: Criterion, total: Array) -> float:
    assert goal.growth is not None
    return float(goal.score(total)) / goal.growth


def test_two_poses_of_a_2r_arm_reach_the_bound_and_one_pose_twice_does_not() -> None:
    """With q2 and q2 + 180° the two lengths are uncorrelated; at q2 alone their correlation is cos q2."""
    q2 = np.deg2rad(np.arange(360.0))
    pool = np.stack([np.stack([np.ones(360), np.cos(q2)], 1), np.stack([np.zeros(360), np.sin(q2)], 1)], axis=1)
    goal = criterion("O1", 2)
    found = certify_criterion(goal, pool, pool[:0])
    assert found is not None
    assert found.efficiency(value(goal, information(pool[[40, 220]])), 2) == pytest.approx(1.0, abs=2e-3)
    assert found.efficiency(value(goal, information(pool[[40, 40]])), 2) == pytest.approx(np.sin(q2[40]), abs=2e-3)


@pytest.mark.parametrize("name", CONCAVE)
def test_no_design_exceeds_the_bound_and_the_bound_is_tight(name: str) -> None:
    goal, pool, before = random_pool(name)
    found = certify_criterion(goal, pool, before, gap=1e-3)
    assert found is not None
    assert 0 <= found.gap <= 2e-3 and found.value <= found.bound + 1e-12
    assert found.weights.sum() == pytest.approx(1) and (found.weights >= 0).all()
    weighted = information(np.sqrt(found.weights)[:, None, None] * pool)
    assert value(goal, weighted) == pytest.approx(found.value, abs=1e-9)
    rng = np.random.default_rng(2)
    for count in (5, 12, 60):
        for _ in range(20):
            chosen = information(pool[rng.choice(60, count, replace=False)])
            assert found.efficiency(value(goal, chosen), count) <= 1 + 1e-12
    repeated = np.repeat(pool, np.round(2000 * found.weights).astype(int), axis=0)  # so often as the weights say
    assert 0.99 < found.efficiency(value(goal, information(repeated)), len(repeated)) <= 1


def test_the_bound_counts_the_poses_measured_before() -> None:
    goal, pool, _ = random_pool("I")
    found = certify_criterion(goal, pool, pool[:6], share=0.5)
    assert found is not None and 0 <= found.gap < 1e-2
    rng = np.random.default_rng(0)
    for _ in range(20):
        total = information(pool[:6]) + information(pool[rng.choice(60, 6, replace=False)])
        assert found.efficiency(value(goal, total), 12) <= 1 + 1e-12


@pytest.mark.parametrize("name", ["O2", "O3"])
def test_a_criterion_without_a_smooth_concave_score_has_no_bound(name: str) -> None:
    assert certify_criterion(*random_pool(name)) is None
