"""What is said of a study's campaigns: intervals that hold, pairs, ranks, and how they are shown."""

import csv
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from scipy import stats

from lab.core.errors import LabError
from lab.core.se3 import Array
from lab.core.significance import STUDY_COMPARISON
from lab.report.views.study_document import answers
from lab.report.views.study_texts import comparison_sentence, effect_text
from lab.studies.analysis import (
    Analysis,
    CampaignArray,
    CellGroup,
    Comparison,
    analysed,
    compared,
    groups,
    holm,
    means,
    resampled,
)
from lab.studies.grid import GridCell, Study
from lab.studies.study import write_csv

METRIC = "fresh_mean_mm"
CRITERIA = ("O1", "O5", "O3", "random")


def columns(values: Array, converged: Array | None = None) -> dict[str, Array]:
    """Rows of an array (cells, robots, draws)."""
    cell, robot, draw = (index.ravel() for index in np.indices(values.shape))
    good = np.ones(values.size, dtype=bool) if converged is None else converged.ravel()
    return {"cell": cell, "robot": robot, "draw": draw, "converged": good, METRIC: values.ravel()}


def arranged(values: Array, resamples: int = 999, converged: Array | None = None) -> CampaignArray:
    return CampaignArray.of(columns(values, converged), [GridCell()] * len(values), resamples=resamples)


def one_group(number: int) -> CellGroup:
    return CellGroup(("criterion",), {}, tuple(range(number)))


def compare(values: Array, converged: Array | None = None, **more) -> Comparison:
    return compared(arranged(values, converged=converged), one_group(len(values)), METRIC, **more)


def two_levels(cells: int, robots: int, draws: int, seed: int) -> Array:
    """A robot's effect and each campaign's noise, both of variance one and mean zero."""
    rng = np.random.default_rng(seed)
    return rng.normal(size=(cells, robots, 1)) + rng.normal(size=(cells, robots, draws))


def study(robots: int = 12, draws: int = 5, seed: int = 0) -> tuple[dict[str, Array], tuple[GridCell, ...]]:
    """Criteria, of which O1 is best and O5 is O3's equal, two scalings and two numbers of poses."""
    cells = Study(factors={"criterion": CRITERIA, "scaling": ("raw", "whitened"), "poses": (10, 20)}).cells
    rng = np.random.default_rng(seed)
    size = {"O1": 1.0, "O5": 1.2, "O3": 1.2, "random": 1.8}
    shared = 0.1 * rng.normal(size=(1, robots, 1)) + 0.3 * rng.normal(size=(1, robots, draws))
    own = 0.05 * rng.normal(size=(len(cells), robots, draws))
    base = np.array([0.01 * size[cell.criterion] * (10 / cell.poses) ** 0.5 for cell in cells])
    return columns(base[:, None, None] * np.exp(shared + own)), cells


@cache
def analysis(robots: int = 12, draws: int = 5, factors: tuple[str, ...] | None = None) -> Analysis:
    return analysed(*study(robots, draws), metrics=(METRIC,), factors=factors)


def test_intervals_over_robots_hold_where_those_over_campaigns_do_not() -> None:
    """200 means: 95 % (3 sigma 4.6 %) hold; of campaigns taken for independent 2 Phi(1.96 x 0.31) - 1 = 45 %."""
    values = two_levels(200, 30, 20, 1)
    by_robots = means(arranged(values), METRIC)
    naive = means(arranged(values.reshape(200, 600, 1)), METRIC)
    held, held_naively = (np.mean([m.lower <= 0 <= m.upper for m in found]) for found in (by_robots, naive))
    assert held == pytest.approx(0.95, abs=0.046)
    assert held_naively == pytest.approx(0.45, abs=0.106)


def test_intervals_of_few_skewed_robots_hold_better_than_percentiles() -> None:
    """Log-normal, sigma 0.7, 12 robots, 600 times: percentiles cover some 87 %, and these some 93 %."""
    truth = np.exp(0.7**2 / 2)
    values = np.exp(0.7 * np.random.default_rng(2).normal(size=(600, 12, 1)))
    ours = arranged(values)
    held = np.mean([m.lower <= truth <= m.upper for m in means(ours, METRIC)])
    lower, upper = np.quantile(ours.weights @ values[:, :, 0].T / 12, [0.025, 0.975], axis=0)
    assert held > 0.91
    assert held > np.mean((lower <= truth) & (truth <= upper)) + 0.03


def test_a_mean_is_over_robots_of_their_means_and_of_normal_ones_like_students() -> None:
    values = two_levels(1, 60, 5, 3)
    values[0, 0, 1:] = np.nan  # a robot with one draw left weighs as much as another
    (found,) = means(arranged(values, 9999), METRIC)
    own = np.nanmean(values[0], axis=1)
    assert found.mean == pytest.approx(own.mean(), rel=1e-12)
    half = stats.t.ppf(0.975, 59) * own.std(ddof=1) / np.sqrt(60)
    assert (found.upper - found.lower) / 2 == pytest.approx(half, rel=0.05)
    assert (found.campaigns, found.not_converged, found.used, found.robots) == (300, 0, 296, 60)


def test_a_ratio_that_is_the_same_everywhere_is_exact() -> None:
    values = np.exp(two_levels(1, 8, 3, 5)) * np.array([1.0, 1.05])[:, None, None]
    (pair,) = compare(values).pairs
    assert [pair.effect, pair.lower, pair.upper] == pytest.approx([1.05] * 3, rel=1e-9)
    assert pair.p < 1e-9 and pair.robots == 8
    (apart,) = compare(values, kind="difference").pairs
    assert apart.effect == pytest.approx((values[1] - values[0]).mean(), rel=1e-12)


@pytest.mark.thorough
def test_holm_keeps_the_error_of_the_family() -> None:
    """Four equal cells, 400 times: one of six pairs told in 5 % (3 sigma 3.3 %) at most; uncorrected in 20 %."""
    rng = np.random.default_rng(6)
    told, uncorrected = 0, 0
    for _ in range(400):
        values = rng.normal(size=(1, 20, 1)) + 0.5 * rng.normal(size=(4, 20, 1)) + 0.5 * rng.normal(size=(4, 20, 2))
        found = compare(np.exp(values))
        told += any(pair.is_significant for pair in found.pairs)
        uncorrected += any(pair.p <= STUDY_COMPARISON for pair in found.pairs)
        assert all((pair.p <= STUDY_COMPARISON) == (not pair.lower <= 1 <= pair.upper) for pair in found.pairs)
    assert told / 400 <= 0.05 + 0.033
    assert uncorrected / 400 > 0.1


def test_holm_by_hand() -> None:
    found = holm(np.array([0.01, 0.04, np.nan, 0.03, 0.005]))
    np.testing.assert_allclose(found, [0.03, 0.06, np.nan, 0.06, 0.02])
    assert holm(np.array([0.6, 0.7])).tolist() == [1.0, 1.0]


def test_ranks_of_equal_cells_are_uncertain_and_of_others_certain() -> None:
    rng = np.random.default_rng(7)
    values = np.exp(0.1 * rng.normal(size=(4, 30, 5)) + np.log([1.5, 1.0, 1.0, 2.0])[:, None, None])
    found = {rank.cell: rank for rank in compare(values).ranks}
    assert found[0].rank == found[0].lowest == found[0].highest == 3 and found[0].chances == (0, 0, 1, 0)
    assert found[3].chances[3] == 1
    for cell in (1, 2):
        assert (found[cell].lowest, found[cell].highest) == (1, 2)
        assert 0.02 < found[cell].chances[0] < 0.98
    assert [rank.rank for rank in compare(values).ranks] == [1, 2, 3, 4]


def test_the_same_poses_share_a_rank() -> None:
    values = np.exp(two_levels(1, 10, 4, 9)) * np.array([2.0, 1.0, 1.0])[:, None, None]
    found = compare(values)
    assert [(rank.cell, rank.rank, rank.lowest, rank.highest) for rank in found.ranks] == [
        (1, 1, 1, 2),
        (2, 1, 1, 2),
        (0, 3, 3, 3),
    ]
    assert found.against(1, 2).p == 1.0 and found.ranks[0].chances[0] == 1.0


def test_a_pair_can_be_read_from_either_end() -> None:
    found = compare(np.exp(two_levels(3, 10, 4, 10)))
    there, back = found.against(0, 2), found.against(2, 0)
    assert (back.first, back.second) == (2, 0)
    assert there.effect * back.effect == pytest.approx(1) and there.lower * back.upper == pytest.approx(1)


def test_what_did_not_converge_is_left_out_of_its_pairs_and_counted() -> None:
    rng = np.random.default_rng(12)
    values, good = np.exp(rng.normal(size=(3, 10, 6))), np.ones((3, 10, 6), dtype=bool)
    clean = compare(values)
    good[1, :4, :2] = False
    values[1, :4, :2] = 1e9  # whatever a solver left there
    values[2, 9, 5] = np.nan
    found = compare(values, good)
    assert [pair.left_out for pair in found.pairs] == [8, 1, 9] and [p.used for p in found.pairs] == [52, 59, 51]
    log = np.log(np.where(good & np.isfinite(values), values, np.nan))
    by_hand = np.nanmean(np.nanmean(log[1] - log[0], axis=1))
    assert np.log(found.pairs[0].effect) == pytest.approx(by_hand, rel=1e-9)
    assert found.pairs[1].effect == pytest.approx(clean.pairs[1].effect, rel=0.1)
    counts = [(m.not_converged, m.used) for m in means(arranged(values, converged=good), METRIC)]
    assert counts == [(0, 60), (8, 52), (0, 59)]


def test_a_cell_that_never_converged_has_no_rank_and_is_told() -> None:
    given, cells = study()
    given["converged"] = given["cell"] != 0
    found = analysed(given, cells, metrics=(METRIC,))
    comparison = found.comparisons[0]
    assert 0 in comparison.group.cells and 0 not in [rank.cell for rank in comparison.ranks]
    assert "O1" in comparison_sentence(comparison, cells) and "60 of 60" in answers(found, METRIC)[-1]


@pytest.mark.parametrize(("robots", "draws"), [(1, 1), (1, 6), (2, 3), (12, 1)])
def test_few_robots_or_draws(robots: int, draws: int, tmp_path: Path) -> None:
    """Of one or two robots no interval is known, and no difference is significant."""
    found = analysis(robots=robots, draws=draws)
    few = robots < 3
    assert all(np.isfinite(mean.mean) and np.isfinite(mean.lower) != few for mean in found.means)
    pairs = [pair for each in found.comparisons for pair in each.pairs]
    assert all(np.isfinite(pair.lower) != few for pair in pairs)
    assert any(pair.is_significant for pair in pairs) != few
    assert ("too few robots for an interval" in " ".join(answers(found, METRIC))) == few
    write_csv(tmp_path, found)


def test_a_robot_without_campaigns_in_a_cell_counts_for_nothing() -> None:
    values = two_levels(1, 9, 4, 13)
    gone = np.where(np.arange(9)[:, None] < 3, np.nan, values[0])[None]
    weights = arranged(gone).weights
    found = resampled(np.nanmean(gone[:, 3:], axis=2).T, weights[:, 3:], STUDY_COMPARISON)
    (mean,) = means(arranged(gone), METRIC)
    assert (mean.mean, mean.lower) == pytest.approx((found.mean[0], found.lower[0]), rel=1e-12)
    assert mean.robots == 6


def test_groups_agree_in_all_factors_but_one() -> None:
    _, cells = study()
    by_criterion = groups(cells, ["criterion"])
    assert [dict(group.shared) for group in by_criterion] == [
        {"scaling": scaling, "poses": poses} for scaling in ("raw", "whitened") for poses in (10, 20)
    ]
    for group in by_criterion:
        assert [cells[i].criterion for i in group.cells] == list(CRITERIA)
        assert {cells[i].scaling for i in group.cells} == {"any", group.shared["scaling"]}
    by_poses = groups(cells, ["poses"])
    assert len(by_poses) == 6 and all([cells[i].poses for i in group.cells] == [10, 20] for group in by_poses)
    by_scaling = [each.group for each in analysis().comparisons if each.group.free == ("scaling",)]
    assert {cells[i].criterion for group in by_scaling for i in group.cells} == {"O5", "O3"}


@pytest.mark.parametrize(
    ("spoil", "words"),
    [
        (lambda c: c.pop("robot"), "column 'robot' is missing"),
        (lambda c: c.update({name: column[:0] for name, column in c.items()}), "there are none"),
        (lambda c: c.update(cell=c["cell"] + 1), "is unknown; the study has"),
        (lambda c: c.update(draw=0 * c["draw"]), "is there twice"),
        (lambda c: c.pop(METRIC), f"metric '{METRIC}' is unknown"),
    ],
)
def test_columns_that_cannot_be_used(spoil, words: str) -> None:
    given, cells = study()
    spoil(given)
    with pytest.raises(LabError, match=words):
        analysed(given, cells, metrics=(METRIC,))


def test_few_robots_have_a_ratio_without_an_interval_and_a_number_of_robots_that_gives_one() -> None:
    values = np.exp(two_levels(2, 4, 3, 16))
    found = analysed(columns(values), [GridCell(poses=poses) for poses in (10, 20)], metrics=(METRIC,))
    (text,) = answers(found, METRIC)
    assert "too few robots" in text and "(" not in text
    enough = np.exp(two_levels(2, 5, 3, 16))
    (pair,) = compare(enough).pairs
    logs = np.log(enough[1] / enough[0]).mean(axis=1)
    half = stats.t.ppf(0.975, 4) * stats.sem(logs)
    assert [pair.lower, pair.upper] == pytest.approx(np.exp([logs.mean() - half, logs.mean() + half]), rel=1e-9)
    assert pair.p == pytest.approx(stats.ttest_1samp(logs, 0.0).pvalue, rel=1e-9)


def test_reasons_of_failures_are_counted() -> None:
    given, cells = study()
    given["converged"] = (given["cell"] != 0) | (given["draw"] > 1)
    refused = np.array(["refused: too few poses", "rank deficient"], dtype=object)[(given["draw"] > 0).astype(int)]
    given["failure"] = np.where(given["converged"], "", refused)
    found = analysed(given, cells, metrics=(METRIC,))
    mean = next(mean for mean in found.means if mean.cell == 0)
    assert mean.failures == (("rank deficient", 12), ("refused: too few poses", 12)) and mean.not_converged == 24


@pytest.mark.parametrize(
    ("ends", "words"),
    [
        ((1.041, 1.037, 1.046), "4.1 % (3.7 to 4.6)"),
        ((1.0335, 0.9984, 1.0687), "3.4 % (−0.2 to 6.9)"),
        ((2.13, 2.05, 2.21), "2.13 times (2.05 to 2.21)"),
        ((3.1262, 0.00024, 40809.4), "3.1 times (0.00024 to 41,000)"),
        ((1.5, 0.2, 11.0), "1.5 times (0.2 to 11)"),
        ((1.5, np.nan, np.nan), "50 % (too few robots for an interval)"),
    ],
)
def test_effects_are_told_to_the_digits_that_are_known(ends: tuple[float, ...], words: str) -> None:
    (pair,) = compare(np.exp(two_levels(2, 5, 2, 14))).pairs
    assert effect_text(type(pair)(0, 1, *ends, 0.01, 0.01, 10, 0), "ratio") == words


def test_tables_read_back_as_they_were(tmp_path: Path) -> None:
    found = analysis()
    write_csv(tmp_path, found)
    read = {
        name: list(csv.DictReader((tmp_path / f"{name}.csv").read_text().splitlines()))
        for name in ("means", "pairs", "ranks")
    }
    assert [(int(r["cell"]), float(r["mean"]), float(r["lower_95"])) for r in read["means"]] == [
        (mean.cell, mean.mean, mean.lower) for mean in found.means
    ]
    assert [found.cells[int(r["cell"])].criterion for r in read["means"]] == [r["criterion"] for r in read["means"]]
    pairs = [pair for each in found.comparisons for pair in each.pairs]
    assert [(float(r["second_to_first"]), float(r["p_holm"])) for r in read["pairs"]] == [
        (pair.effect, pair.p_holm) for pair in pairs
    ]
    assert read["pairs"][0]["group"] == "scaling raw, 10 poses" and read["pairs"][0]["second"] == "O5"
    ranks = [rank for each in found.comparisons for rank in each.ranks]
    for row, rank in zip(read["ranks"], ranks, strict=True):
        chances = [float(row[f"chance_{k}"] or "nan") for k in range(1, 5)][: len(rank.chances)]
        assert (int(row["cell"]), int(row["rank"]), tuple(chances)) == (rank.cell, rank.rank, rank.chances)
