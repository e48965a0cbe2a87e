"""A study's analysis as tables: on the terminal for one metric, as CSV for all."""

import csv
from collections.abc import Iterable, Sequence
from math import isfinite
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.table import Table

from lab.commands.study.text import (
    behind_words,
    circumstances,
    level_words,
    mean_words,
    metric_words,
    rank_words,
    sentences,
    varying,
)
from lab.core.errors import LabError
from lab.studies.analysis import Analysis, Comparison, Mean
from lab.studies.grid import FACTORS, Cell


def print_analysis(analysis: Analysis, metric: str, console: Console | None = None) -> None:
    """Means, ranks by each factor and what they say, by one metric."""
    console = console or Console(highlight=False)
    shown = [mean for mean in analysis.means if mean.metric == metric]
    if not shown:
        known = ", ".join(dict.fromkeys(mean.metric for mean in analysis.means))
        raise LabError(f"metric '{metric}' is unknown; there are {known}")
    robots, campaigns = max(mean.robots for mean in shown), sum(mean.campaigns for mean in shown)
    console.print(f"{metric_words(metric)}: mean (95 % interval), {robots} robots, {campaigns:,} campaigns")
    console.print(_means_table(shown, analysis.cells))
    compared = [each for each in analysis.comparisons if each.metric == metric]
    for free in dict.fromkeys(each.group.free for each in compared):
        by = " and ".join(free)
        console.print(
            f"by {by}: rank (95 % set), in how many resamples first, against the first of the same robots and noise"
        )
        console.print(_ranks_table([each for each in compared if each.group.free == free], analysis.cells))
    for line in sentences(analysis, metric):
        console.print(f"- {line}")


def _means_table(means: Sequence[Mean], cells: Sequence[Cell]) -> Table:
    names = varying(cells)
    table = Table()
    for heading in (*names, "mean", "not converged"):
        table.add_column(heading, justify="right", no_wrap=True)
    for mean in means:
        levels = [str(getattr(cells[mean.cell], name)) for name in names]
        table.add_row(*levels, mean_words(mean), f"{mean.not_converged:,} of {mean.campaigns:,}")
    return table


def _ranks_table(comparisons: Sequence[Comparison], cells: Sequence[Cell]) -> Table:
    """Groups by the same factor, a section each, its best cell first."""
    free = comparisons[0].group.free
    table = Table()
    for heading in ("", "rank (95 %)", "first", "worse by"):
        table.add_column(heading, justify="right", no_wrap=bool(heading))
    for each in comparisons:
        if where := circumstances(each.group.shared):
            table.add_row(f"{where}:")
        for rank in each.ranks:
            cell, chance = level_words(cells[rank.cell], free), f"{100 * rank.chances[0]:.0f} %"
            table.add_row(cell, rank_words(rank), chance, behind_words(each, rank))
        table.add_section()
    return table


def write_csv(folder: Path, analysis: Analysis) -> None:
    """Write ``means.csv``, ``pairs.csv`` and ``ranks.csv``; an empty cell is a number that there is not."""
    _write(folder / "means.csv", _MEANS, _mean_rows(analysis))
    _write(folder / "pairs.csv", _PAIRS, _pair_rows(analysis))
    most = max((len(each.group.cells) for each in analysis.comparisons), default=0)
    _write(folder / "ranks.csv", [*_RANKS, *(f"chance_{k}" for k in range(1, most + 1))], _rank_rows(analysis))


_COUNTS = ("campaigns", "not_converged", "used", "robots")
_MEANS = ("cell", *FACTORS, "metric", "mean", "lower_95", "upper_95", *_COUNTS)
_GROUP = ("metric", "factor", "group")
_PAIRS = (*_GROUP, "first_cell", "second_cell", "first", "second", "kind", "second_to_first", "lower_95", "upper_95",
          "p", "p_holm", "used", "left_out")  # fmt: skip
_RANKS = (*_GROUP, "cell", "level", "rank", "lowest_95", "highest_95")


def _mean_rows(analysis: Analysis) -> Iterable[list[Any]]:
    for mean in analysis.means:
        levels = [getattr(analysis.cells[mean.cell], name) for name in FACTORS]
        counts = [getattr(mean, name) for name in _COUNTS]
        yield [mean.cell, *levels, mean.metric, mean.mean, mean.lower, mean.upper, *counts]


def _pair_rows(analysis: Analysis) -> Iterable[list[Any]]:
    for each in analysis.comparisons:
        for pair in each.pairs:
            levels = [level_words(analysis.cells[cell], each.group.free) for cell in (pair.first, pair.second)]
            numbers = [pair.effect, pair.lower, pair.upper, pair.p, pair.p_holm, pair.used, pair.left_out]
            yield [*_group(each), pair.first, pair.second, *levels, each.kind, *numbers]


def _rank_rows(analysis: Analysis) -> Iterable[list[Any]]:
    for each in analysis.comparisons:
        for rank in each.ranks:
            level = level_words(analysis.cells[rank.cell], each.group.free)
            yield [*_group(each), rank.cell, level, rank.rank, rank.lowest, rank.highest, *rank.chances]


def _group(comparison: Comparison) -> list[str]:
    return [comparison.metric, " and ".join(comparison.group.free), circumstances(comparison.group.shared)]


def _write(path: Path, header: Sequence[str], rows: Iterable[list[Any]]) -> None:
    """Numbers in full, so that they are the same again when they are read."""
    with path.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(header)
        for row in rows:
            cells = ["" if isinstance(each, float) and not isfinite(each) else each for each in row]
            writer.writerow(cells + [""] * (len(header) - len(cells)))
