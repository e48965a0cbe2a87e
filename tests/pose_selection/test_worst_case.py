"""Designs for the worst of several arms and models, and the bound of all of them."""

from functools import partial
from itertools import combinations

import numpy as np
import pytest

from lab.core.se3 import Array
from lab.pose_selection.criteria import Criterion, criterion
from lab.pose_selection.exchange import Design, OneCriterion, Sensitivity, climb, exchange, information
from lab.pose_selection.worst_case import Case, WorstCase, certify_worst, exchange_worst

CONCAVE = ("O1", "A", "G", "I", "O5")


def lengths_2r(offset: float, joints: Array) -> Array:
    """Derivatives ``(n, 2, 2)`` of a planar 2R arm's tip by its two link lengths; joint 2 is off by ``offset``."""
    first, both = joints[:, 0], joints[:, 0] + joints[:, 1] + offset
    return np.stack([np.stack([np.cos(first), np.cos(both)], 1), np.stack([np.sin(first), np.sin(both)], 1)], axis=1)


def case(sensitivity: Sensitivity, joints: Array, goal: Criterion, arm: int = 0) -> Case:
    pool = sensitivity(joints)
    p = pool.shape[2]
    return Case(arm, "geometric", pool, sensitivity, goal, np.empty((0, pool.shape[1], p)), sensitivity, pool)


def arms_2r(offsets: tuple[float, ...], joints: Array, name: str = "O1") -> list[Case]:
    return [
        case(partial(lengths_2r, offset), joints, criterion(name, 2, lengths_2r(offset, joints[::7])), arm)
        for arm, offset in enumerate(offsets)
    ]


def random_cases(name: str, size: int = 60, sizes: tuple[int, ...] = (4, 4, 5), seed: int = 0) -> list[Case]:
    """Cases of unlike models: whatever the joints are, the pool's rows are looked up by the first of them."""
    rng, made = np.random.default_rng(seed), []
    for arm, p in enumerate(sizes):
        pool = rng.normal(size=(size, 3, p)) * rng.uniform(0.2, 3, (size, 1, 1))
        goal = criterion(name, p, rng.normal(size=(12, 3, p)))
        look_up = partial(lambda pool, joints: pool[joints[:, 0].astype(int)], pool)
        made.append(Case(arm, "", pool, look_up, goal, np.empty((0, 3, p)), look_up, pool[:5]))
    return made


GRID = np.column_stack([np.zeros(360), np.deg2rad(np.arange(360.0))])
NUMBERS = np.column_stack([np.arange(60.0), np.zeros(60)])


def test_one_pose_of_a_2r_arm_is_midway_between_the_arms() -> None:
    """det J'J = sin²(q2 + offset), so with offsets 0 and d the best single angle is 90° - d/2, worth cos²(d/2)."""
    offset = np.deg2rad(40.0)
    tens = GRID[::10]
    aim = WorstCase(arms_2r((0.0, offset), tens))
    found = exchange_worst(tens, aim, np.random.default_rng(0), 1)
    assert np.rad2deg(found.joints[0, 1]) % 180 == pytest.approx(70.0)
    assert found.score == pytest.approx(np.log(np.cos(offset / 2)), abs=1e-3)  # log sqrt(det), against sqrt(det) = 1
    alone = exchange(tens, lengths_2r(0.0, tens), 1, criterion("O1", 2), np.random.default_rng(0))
    assert np.rad2deg(alone.joints[0, 1]) % 180 == pytest.approx(90.0)
    assert aim.score(aim.seen(alone.joints)) == pytest.approx(np.log(np.cos(offset)), abs=1e-3)


def test_two_poses_of_a_2r_arm_lose_nothing_for_any_offset() -> None:
    """With q2 and q2 + 180° the lengths are uncorrelated whatever the offset: efficiency one, and the bound says so."""
    cases = arms_2r((0.0, 0.5, -0.9), GRID)
    found = exchange_worst(GRID, WorstCase(cases), np.random.default_rng(1), 2)
    apart = np.rad2deg(found.joints[1, 1] - found.joints[0, 1])
    assert abs(apart) == pytest.approx(180.0)
    bound = certify_worst(cases)
    assert bound is not None and bound.efficiency(found.score, 2) == pytest.approx(1.0, abs=2e-3)
    twice = WorstCase(cases).score(lengths_of_all(cases, np.deg2rad([90.0, 90.0])))
    assert bound.efficiency(twice, 2) == pytest.approx(np.cos(0.9), abs=2e-3)  # the nominal arm's best


def lengths_of_all(cases: list[Case], angles: Array) -> Array:
    return WorstCase(cases).seen(np.column_stack([np.zeros(len(angles)), angles]))


@pytest.mark.parametrize("name", CONCAVE)
def test_no_design_exceeds_the_bound_and_the_bound_is_tight(name: str) -> None:
    cases = random_cases(name)
    found = certify_worst(cases, gap=1e-3)
    assert found is not None
    assert 0 <= found.gap <= 2e-3 and found.value <= found.bound + 1e-12
    assert found.weights.sum() == pytest.approx(1) and found.cases.sum() == pytest.approx(1)
    assert (found.weights >= 0).all() and (found.cases >= 0).all()
    aim, rng = WorstCase(cases), np.random.default_rng(2)
    weighted = aim.of([np.sqrt(found.weights)[:, None, None] * each.pool for each in cases])
    assert aim.values(weighted).min() == pytest.approx(found.value, abs=1e-9)
    for count in (5, 12, 60):
        for _ in range(20):
            score = aim.score(aim.seen(NUMBERS[rng.choice(60, count, replace=False)]))
            assert found.efficiency(score, count) <= 1 + 1e-12
    best = exchange_worst(NUMBERS, aim, rng, 20)
    assert 0.75 < found.efficiency(best.score, 20) <= 1  # no candidate twice


def test_the_bound_counts_the_poses_measured_before() -> None:
    cases = random_cases("O1")
    before = [each.pool[:6] for each in cases]
    extended = [
        Case(each.arm, "", each.pool, each.sensitivity, each.goal, done, each.whitened, each.test)
        for each, done in zip(cases, before, strict=True)
    ]
    found = certify_worst(extended, share=0.5)
    assert found is not None and 0 <= found.gap < 1e-2
    aim, rng = WorstCase(extended), np.random.default_rng(0)
    for _ in range(20):
        score = aim.score(aim.seen(NUMBERS[rng.choice(60, 6, replace=False)]))
        assert found.efficiency(score, 12) <= 1 + 1e-12
    np.testing.assert_allclose(aim.earlier[0][:4, :4], information(before[0]))


@pytest.mark.parametrize("name", ["O2", "O3"])
def test_a_criterion_without_a_smooth_concave_score_has_no_bound(name: str) -> None:
    assert certify_worst(random_cases(name)) is None


@pytest.mark.parametrize("name", ["O1", "I", "G", "O2"])
def test_the_exchange_finds_the_best_of_a_small_pool(name: str) -> None:
    """Twelve candidates: all 495 choices of four are tried, by whole matrices of every case."""
    cases = random_cases(name, 12)
    aim = WorstCase(cases)
    best = max(aim.score(aim.seen(NUMBERS[list(chosen)])) for chosen in combinations(range(12), 4))
    rng = np.random.default_rng(3)
    found = max(exchange_worst(NUMBERS[:12], aim, rng, 4).score for _ in range(8))
    assert found == pytest.approx(best, abs=1e-9)


def test_a_design_is_never_worse_than_the_one_it_starts_from() -> None:
    cases = random_cases("I", seed=5)
    aim = WorstCase(cases)
    for seed in range(4):
        alone = exchange(NUMBERS, cases[0].pool, 8, cases[0].goal, np.random.default_rng(seed), starts=1)
        nominal = aim.score(aim.seen(alone.joints))
        found = exchange_worst(NUMBERS, aim, np.random.default_rng(seed), 8, first=alone.rows)
        assert found.score >= nominal
        again = exchange_worst(NUMBERS, aim, np.random.default_rng(seed), 8, first=alone.rows)
        np.testing.assert_array_equal(found.rows, again.rows)
    assert found.score > nominal + 0.01


def test_what_cannot_be_reached_is_not_chosen() -> None:
    cases = random_cases("O1")
    found = exchange_worst(
        NUMBERS, WorstCase(cases), np.random.default_rng(0), 6, reachable=lambda joints: joints[:, 0] % 2 == 0
    )
    assert (found.rows % 2 == 0).all() and len(set(found.rows.tolist())) == 6


@pytest.mark.parametrize("name", ["O1", "I"])
def test_the_ascent_follows_the_slope_and_raises_the_worst_case(name: str) -> None:
    cases = arms_2r((0.0, 0.7), GRID, name)
    aim, joints = WorstCase(cases, sharpness=30), np.array([[0.1, 0.8], [1.0, 1.2]])
    slope = aim.uphill(joints)[1]
    for i, j in np.ndindex(2, 2):
        step = np.zeros_like(joints)
        step[i, j] = 1e-5
        rise = (aim.uphill(joints + step)[0] - aim.uphill(joints - step)[0]) / 2e-5
        assert slope[i, j] == pytest.approx(rise, abs=1e-4)
    rows, aim = np.array([49, 50]), WorstCase(cases)
    seen = aim.seen(GRID[rows])
    start = Design(rows, GRID[rows], seen, aim.score(seen))
    moved = climb(start, aim, lambda q: np.ones(len(q), bool), np.full(2, -4.0), np.full(2, 4.0))
    assert moved.score > start.score and moved.score == pytest.approx(aim.score(aim.seen(moved.joints)))


def test_one_case_is_the_criterion_itself() -> None:
    cases = arms_2r((0.0,), GRID, "I")
    aim, alone = WorstCase(cases), OneCriterion(cases[0].sensitivity, cases[0].goal)
    joints = GRID[[30, 100, 200]]
    assert aim.score(aim.seen(joints)) == pytest.approx(alone.score(alone.seen(joints)))
    np.testing.assert_allclose(aim.uphill(joints)[1], alone.uphill(joints)[1], rtol=1e-9, atol=1e-12)
