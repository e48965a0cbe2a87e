"""Result of a study: typed, and as the files of its folder."""

import csv
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from math import isfinite
from pathlib import Path
from typing import TYPE_CHECKING, Any

from lab.commands.result import Result
from lab.commands.study.format import (
    circumstances,
    level_words,
)
from lab.commands.study.options import StudyOptions
from lab.extension_points import load_reference
from lab.formats.csv_table import text_cell
from lab.studies.analysis import Analysis, Comparison
from lab.studies.campaigns import origin_of
from lab.studies.grid import FACTORS
from lab.studies.run import StudyDone

if TYPE_CHECKING:
    pass

__all__ = ["StudyResult", "write_csv"]


@dataclass(frozen=True, repr=False, eq=False)
class StudyResult(Result):
    """A study that is finished, and the analysis of its simulated calibrations.

    Attributes:
        options: what was asked.
        done: where the simulated calibrations are, and what this run added to them.
        analysis: means, comparisons and ranks.
    """

    command = "study"
    shown_by = "lab.commands.study.document:study_document"
    drawn_by = "lab.commands.study.document:first_picture"

    options: StudyOptions
    done: StudyDone
    analysis: Analysis

    @property
    def warnings(self) -> tuple[str, ...]:
        """Warnings of a study, always empty: what did not converge is in the analysis."""
        return ()

    @property
    def model_sha256(self) -> str:
        """Digest of the robot's description."""
        return str(origin_of(self.done.study.robot)["model_sha256"])

    def to_dict(self) -> dict[str, Any]:
        """Return the values that ``--json`` prints."""
        return self.done.summary

    def columns(self) -> Mapping[str, Sequence[Any]]:
        """The columns of ``means.csv``: a row for each cell and metric; NaN where there is no interval."""
        return _mean_columns(self.analysis)

    def write(self, folder: Path) -> None:
        """Write the analysis: means, pairs and ranks as CSV, the figures, and ``report.html``."""
        write_csv(folder, self.analysis)
        pictures = load_reference("lab.commands.study.document:pictures_of")(self)
        load_reference("lab.commands.study.figures:write_figures")(folder, pictures)
        self.report(folder / "report.html")


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


def _mean_columns(analysis: Analysis) -> Mapping[str, Sequence[Any]]:
    """The columns of ``means.csv``, each with a value for every cell and metric."""
    rows = list(_mean_rows(analysis))
    return {name: [row[i] for row in rows] for i, name in enumerate(_MEANS)}


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
            cells = [text_cell(each) if isinstance(each, str) else each for each in cells]
            writer.writerow(cells + [""] * (len(header) - len(cells)))
