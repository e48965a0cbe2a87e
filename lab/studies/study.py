"""Run and analyse studies of many simulated calibrations, and write the files of their folder."""

import csv
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from math import isfinite
from pathlib import Path
from typing import Any

from lab.core.errors import LabError, error_context
from lab.core.progress import stages
from lab.formats.csv_table import text_cell
from lab.library.result import Result, number
from lab.library.run_folder import free_name
from lab.options.call_options import options_of, takes
from lab.options.command_options import StudyOptions
from lab.studies.analysis import COMPARED, Analysis, Comparison, Mean, analysed
from lab.studies.campaigns import refuse_impossible
from lab.studies.executors import StoppedError, cluster_executor, local_executor
from lab.studies.grid import FACTORS, NONE, RANKED, GridCell, Study, is_any, read_study, study_from
from lab.studies.run_study import StudyDone, read_campaigns, run_study

__all__ = ["StudyResult", "circumstances", "failures_text", "level_text", "plain_level", "shown_metrics", "study",
           "write_csv"]  # fmt: skip

_UNITS = {"poses": " poses", "position_sigma_mm": " mm", "rotation_sigma_mrad": " mrad", "noise": " times the noise",
          "payload_kg": " kg"}  # fmt: skip
_NAMED = {"position_sigma_mm": "σ ", "rotation_sigma_mrad": "σ ", "scaling": "scaling ", "model": "model ",
          "prior": "prior ", "observe": "measured ", "payload_kg": "payload "}  # fmt: skip
_MOST_REASONS = 3


def circumstances(shared: Mapping[str, Any]) -> str:
    """Describe levels shared by a group's cells, e.g. "10 poses, scaling whitened"; empty if nothing else varies."""
    shown = [(name, level) for name, level in shared.items() if not is_any(name, level)]
    return ", ".join(f"{_NAMED.get(name, '')}{_with_unit(name, level)}" for name, level in shown)


def level_text(cell: GridCell, factors: Sequence[str]) -> str:
    """A cell's levels of some factors, e.g. "10 poses"."""
    return " ".join(_with_unit(name, getattr(cell, name)) for name in factors)


def plain_level(factor: str, level: Any) -> str:
    """A level as a table shows it, e.g. "0 or 3" of payloads."""
    if isinstance(level, bool):
        return "yes" if level else "no"
    if isinstance(level, tuple):
        return " or ".join(f"{each:g}" for each in level) or "that of the effects"
    if isinstance(level, float):
        return f"{level:g}"
    return "any" if is_any(factor, level) else str(level)


def _with_unit(factor: str, level: Any) -> str:
    if factor == "robust":
        return "robust" if level else "not robust"
    if factor == "plan":
        return "chosen poses" if level == NONE else Path(level).name
    if factor == "targets":
        return f"{level} target{'s' * (level > 1)}"
    unit = "" if level == () or is_any(factor, level) else _UNITS.get(factor, "")
    return f"{plain_level(factor, level)}{unit}"


def failures_text(failures: Sequence[tuple[str, int]]) -> str:
    """Describe reasons of failures with their numbers, the most frequent first: "3 not converged; 2 rank deficient"."""
    named = [f"{count:,} {reason}" for reason, count in failures[:_MOST_REASONS]]
    rest = sum(count for _, count in failures[_MOST_REASONS:])
    return "; ".join([*named, *([f"{rest:,} for other reasons"] if rest else [])])


@dataclass(frozen=True, repr=False, eq=False)
class StudyResult(Result):
    """A study that is finished, and the analysis of its simulated calibrations.

    Attributes:
        done: where the simulated calibrations are, and what this run added to them.
        analysis: ``means`` of each cell and metric, and ``comparisons`` of each metric and factor, with ``pairs`` and
            ``ranks``; ``cells`` are the combinations of the factors.
    """

    command = "study"

    options: StudyOptions
    done: StudyDone
    analysis: Analysis

    @property
    def warnings(self) -> tuple[str, ...]:
        """Warnings of a study, always empty: what did not converge is in the analysis."""
        return ()

    def to_dict(self) -> dict[str, Any]:
        """Return the values that ``--json`` prints: pairs and ranks by the metrics that terminal and page show."""
        failed = [(mean.not_converged, mean.failures) for mean in self.analysis.means if mean.metric == _COUNTED]
        cells = [
            cell | {"failed": count, "failures": dict(failures)}
            for cell, (count, failures) in zip(self.done.summary["cells"], failed, strict=True)
        ]
        shown = shown_metrics(self.done.study)
        means = ([mean.cell, mean.metric, *_mean_numbers(mean)] for mean in self.analysis.means)
        pairs = (row for row in _pair_rows(self.analysis) if row[0] in shown)
        ranks = ([*row[: len(_RANKS)], row[len(_RANKS) :]] for row in _rank_rows(self.analysis) if row[0] in shown)
        return self.done.summary | {
            "cells": cells,
            "metric": self.done.study.metric,
            "means": _objects(("cell", "metric", *_MEAN_NUMBERS), means),
            "pairs": _objects(_PAIRS, pairs),
            "ranks": _objects((*_RANKS, "chances"), ranks),
        }

    def columns(self) -> Mapping[str, Sequence[Any]]:
        """The columns of ``means.csv``: a row for each cell and metric; NaN where there is no interval."""
        return _mean_columns(self.analysis)

    def write(self, folder: Path) -> None:
        """Write the analysis: means, pairs and ranks as CSV."""
        write_csv(folder, self.analysis)


def shown_metrics(known: Study) -> tuple[str, ...]:
    """Return the metrics of the page and the figures, that of the study first, which the terminal shows."""
    return tuple(dict.fromkeys((known.metric, RANKED[0], "fresh_worst_mm")))


def _objects(names: Sequence[str], rows: Iterable[Sequence[Any]]) -> list[dict[str, Any]]:
    """Return rows as objects, with null for a number that is not finite."""
    return [
        {name: number(each) if isinstance(each, float) else each for name, each in zip(names, row, strict=True)}
        for row in rows
    ]


def write_csv(folder: Path, analysis: Analysis) -> None:
    """Write ``means.csv``, ``pairs.csv`` and ``ranks.csv``; an empty cell is a number that there is not."""
    _write(folder / "means.csv", _MEANS, _mean_rows(analysis))
    _write(folder / "pairs.csv", _PAIRS, _pair_rows(analysis))
    most = max((len(each.group.cells) for each in analysis.comparisons), default=0)
    _write(folder / "ranks.csv", [*_RANKS, *(f"chance_{k}" for k in range(1, most + 1))], _rank_rows(analysis))


_COUNTED = "steps"  # the metric of every study by whose means failures are counted
_COUNTS = ("campaigns", "not_converged", "used", "robots")
_MEAN_NUMBERS = ("mean", "lower_95", "upper_95", *_COUNTS)
_MEANS = ("cell", *FACTORS, "metric", *_MEAN_NUMBERS, "failures")
_GROUP = ("metric", "factor", "group")
_PAIRS = (*_GROUP, "first_cell", "second_cell", "first", "second", "kind", "second_to_first", "lower_95", "upper_95",
          "p", "p_holm", "used", "left_out", "robots")  # fmt: skip
_RANKS = (*_GROUP, "cell", "level", "rank", "lowest_95", "highest_95")


def _mean_columns(analysis: Analysis) -> Mapping[str, Sequence[Any]]:
    """The columns of ``means.csv``, each with a value for every cell and metric."""
    rows = list(_mean_rows(analysis))
    return {name: [row[i] for row in rows] for i, name in enumerate(_MEANS)}


def _mean_rows(analysis: Analysis) -> Iterable[list[Any]]:
    for mean in analysis.means:
        levels = [_written(getattr(analysis.cells[mean.cell], name)) for name in FACTORS]
        yield [mean.cell, *levels, mean.metric, *_mean_numbers(mean), failures_text(mean.failures)]


def _mean_numbers(mean: Mean) -> list[float]:
    return [mean.mean, mean.lower, mean.upper, *(getattr(mean, name) for name in _COUNTS)]


def _written(level: Any) -> Any:
    """Write payloads as an option takes them, e.g. "0,3"."""
    return ",".join(f"{each:g}" for each in level) if isinstance(level, tuple) else level


def _pair_rows(analysis: Analysis) -> Iterable[list[Any]]:
    for each in analysis.comparisons:
        for pair in each.pairs:
            levels = [level_text(analysis.cells[cell], each.group.free) for cell in (pair.first, pair.second)]
            numbers = [pair.effect, pair.lower, pair.upper, pair.p, pair.p_holm, pair.used, pair.left_out, pair.robots]
            yield [*_group(each), pair.first, pair.second, *levels, each.kind, *numbers]


def _rank_rows(analysis: Analysis) -> Iterable[list[Any]]:
    for each in analysis.comparisons:
        for rank in each.ranks:
            level = level_text(analysis.cells[rank.cell], each.group.free)
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


@takes(StudyOptions)
def study(config: str | Path | Mapping[str, Any] | Study | StudyOptions, **options: Any) -> StudyResult:
    """Run a study of many simulated calibrations into a folder, or go on with one that stopped.

    Its processes do not import the calling script, which needs no ``if __name__ == "__main__"``.

    Args:
        config: the study: a TOML file, or the same as a mapping, whose factors may be parts of one's own as objects;
            or all options in one object.
        options: those of ``lab study``, by name: ``out``, ``resume``, ``workers``, ``scheduler``, ``timeout_s``.

    Returns:
        Where its simulated calibrations are, and their analysis.

    Raises:
        LabError: the study asks for what there is not, or was stopped; the message says how to go on.
    """
    if isinstance(config, StudyOptions):
        return _run(config, read_study(config.config), config.config)
    if isinstance(config, str | Path):
        file, known = str(config), read_study(Path(config))
    else:
        file, known = "study.toml", config if isinstance(config, Study) else study_from(config)
    where = config if isinstance(config, str | Path) else "lab.study"
    return _run(options_of("lab.study", StudyOptions, {"config": file, **options}), known, where)


def _run(options: StudyOptions, known: Study, where: str | Path) -> StudyResult:
    """Run a study; errors of its factors begin with ``where``: its file, or the call."""
    options.check()
    with error_context(where):
        refuse_impossible(known)
    folder = options.out or free_name(Path("runs"), f"study-{known.name}")
    chosen = local_executor(options.workers) if options.scheduler is None else cluster_executor(options.scheduler)
    run = partial(run_study, known, folder, resume=options.resume, timeout_s=options.timeout_s)
    try:
        with stages("running the study") as progress, chosen as executor:
            done = run(executor, progress=progress)
    except StoppedError as error:
        raise LabError(f"{folder}: {error}") from error
    except KeyboardInterrupt as stop:
        raise KeyboardInterrupt(f"--resume continues the study in {folder}") from stop
    result = StudyResult(options, done, _analysis(done))
    result.write(done.folder)
    result.draw(done.folder)
    return result


def _analysis(done: StudyDone) -> Analysis:
    campaigns = read_campaigns(done.folder)
    columns = {name: campaigns[name].to_numpy() for name in campaigns.column_names}
    metrics = tuple(dict.fromkeys((*COMPARED, done.study.metric)))
    return analysed(columns, done.study.cells, done.study.seed, metrics)
