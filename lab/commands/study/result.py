"""Result of a study: typed, and as the files of its folder."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import cached_property
from math import isfinite
from pathlib import Path
from typing import TYPE_CHECKING, Any

from lab.commands.result import Result
from lab.commands.study.format import (
    behind_words,
    circumstances,
    effect_words,
    level_words,
    mean_words,
    metric_words,
    rank_words,
    varying,
)
from lab.commands.study.options import StudyOptions
from lab.core.errors import LabError
from lab.render.document import (
    EVERYWHERE,
    PAGE,
    TERMINAL,
    Block,
    Bullets,
    Code,
    Column,
    Document,
    Figure,
    Paragraph,
    Picture,
    Row,
    Section,
    Table,
    capital,
    sentence,
)
from lab.studies.analysis import Analysis, Comparison, Mean
from lab.studies.campaigns import origin_of
from lab.studies.grid import Cell, Study
from lab.studies.run import StudyDone

if TYPE_CHECKING:
    from matplotlib.figure import Figure as MatplotlibFigure

    from lab.render.document import Document, Picture

__all__ = ["METRICS", "StudyResult", "analysis_sections", "comparison_sentence", "sentences"]

METRICS = ("fresh_mean_mm", "fresh_worst_mm")  # of the figures and the page; the CSV files have all


@dataclass(frozen=True, repr=False, eq=False)
class StudyResult(Result):
    """A study that is finished, and the analysis of its simulated calibrations.

    Attributes:
        options: what was asked.
        done: where the simulated calibrations are, and what this run added to them.
        analysis: means, comparisons and ranks.
    """

    options: StudyOptions
    done: StudyDone
    analysis: Analysis

    @property
    def warnings(self) -> tuple[str, ...]:
        """Warnings of a study, always empty: what did not converge is in the analysis."""
        return ()

    @property
    def exit_code(self) -> int:
        """Always 0: a study that cannot be finished is an error."""
        return 0

    @cached_property
    def pictures(self) -> "dict[str, Picture]":
        """Figures of the study, by the names of their files."""
        from lab.commands.study.figures import study_pictures

        return {name: made for metric in METRICS for name, made in study_pictures(self.analysis, metric).items()}

    def to_dict(self) -> dict[str, Any]:
        """Return the values that ``--json`` prints."""
        return self.done.summary

    def document(self) -> "Document":
        """Build the document: the answers, means, ranks and figures."""
        return _study_document(self)

    def columns(self) -> Mapping[str, Sequence[Any]]:
        """The columns of ``means.csv``: a row for each cell and metric; NaN where there is no interval."""
        from lab.commands.study.run import mean_columns

        return mean_columns(self.analysis)

    def plot(self) -> "MatplotlibFigure":
        """Draw the means of the first factor that varies.

        Raises:
            LabError: nothing varies.
        """
        if not self.pictures:
            raise LabError("no factor of the study can be compared: there is nothing to draw; give a factor two levels")
        return next(iter(self.pictures.values())).draw()

    def write(self, folder: Path) -> None:
        """Write the analysis: means, pairs and ranks as CSV, the figures, and ``report.html``."""
        from lab.commands.study.figures import write_figures
        from lab.commands.study.run import write_csv

        write_csv(folder, self.analysis)
        write_figures(folder, self.pictures)
        self.report(folder / "report.html")


def _study_document(result: StudyResult) -> Document:
    """Build the document of a study: setup, answers, means, ranks, figures, and how to repeat it."""
    done, study = result.done, result.done.study
    speed = f" in {done.seconds:,.0f} s" if done.computed else ""
    return Document(
        study.name,
        (
            Paragraph(
                f"{study.campaigns:,} simulated calibrations: {len(study.cells)} cells, each with the same "
                f"{study.robots} robots, measured {study.draws} times each with the same noise.",
                "lead",
            ),
            *analysis_sections(result.analysis, METRICS),
            Section("Figures", tuple(_figures(result.pictures)), shown_in=PAGE),
            _provenance(study),
            Paragraph(
                f"{done.computed:,} of {study.campaigns:,} simulated calibrations computed{speed}.", shown_in=TERMINAL
            ),
            Paragraph(f"study: {done.folder}", shown_in=TERMINAL),
            Paragraph(f"page: {done.folder / 'report.html'}", shown_in=TERMINAL),
        ),
    )


def analysis_sections(analysis: Analysis, metrics: Sequence[str]) -> tuple[Section, ...]:
    """Answers, means and ranks by the metrics; a page alone shows those after the first."""
    media = [EVERYWHERE if i == 0 else PAGE for i in range(len(metrics))]
    answers = [
        Section(
            capital(metric_words(metric, unit=False)),
            (Bullets(tuple(map(sentence, sentences(analysis, metric)))),),
            shown_in=media[i],
        )
        for i, metric in enumerate(metrics)
    ]
    ranks = [
        Section(f"By {metric_words(metric)}", tuple(_ranks(analysis, metric)), shown_in=media[i])
        for i, metric in enumerate(metrics)
    ]
    note = (
        "Pairs are of the same robots and the same noise, with Holm's correction. First: in how many of 100 resamples "
        "of the robots the level has rank 1."
    )
    return (
        Section("Results", tuple(answers)),
        Section("Means", (_means(analysis, metrics),)),
        Section("Ranks", (*ranks, Paragraph(note if analysis.comparisons else "", "note"))),
    )


def _means(analysis: Analysis, metrics: Sequence[str]) -> Table:
    """Tabulate all cells' means with 95 % intervals over the robots; only the first metric if space is short."""
    names = varying(analysis.cells)
    of = {(mean.cell, mean.metric): mean for mean in analysis.means}
    more = [metric for metric in (*metrics[1:], "nees", "before_mm") if (0, metric) in of]
    rows = []
    for i, cell in enumerate(analysis.cells):
        first = of[i, metrics[0]]
        rows.append(
            (
                *(str(getattr(cell, name)) for name in names),
                mean_words(first),
                *(mean_words(of[i, metric]) for metric in more),
                f"{first.not_converged:,} of {first.campaigns:,}",
            )
        )
    columns: tuple[str | Column, ...] = (
        *names,
        metric_words(metrics[0]),
        *(Column(metric_words(metric), PAGE) for metric in more),
        "not converged",
    )
    robots = max(mean.robots for mean in analysis.means if mean.metric == metrics[0])
    caption = f"Means with 95 % intervals over {robots} robots, each with all its draws; means.csv has every metric."
    return Table(columns, tuple(rows), caption)


def _ranks(analysis: Analysis, metric: str) -> Iterable[Table]:
    """A table for each factor: the groups that share all other factors, each with its best level first."""
    compared = [each for each in analysis.comparisons if each.metric == metric]
    for free in dict.fromkeys(each.group.free for each in compared):
        rows: list[Row] = []
        for each in (one for one in compared if one.group.free == free):
            if where := circumstances(each.group.shared):
                rows.append((f"{where}:", "", "", ""))
            rows += [
                (
                    level_words(analysis.cells[rank.cell], free),
                    rank_words(rank),
                    f"{100 * rank.chances[0]:.0f}",
                    behind_words(each, rank),
                )
                for rank in each.ranks
            ]
        yield Table((" and ".join(free), "rank (95 % set)", "first", "worse than the first by"), tuple(rows))


def _figures(pictures: Mapping[str, Picture]) -> Iterable[Figure]:
    for name, picture in pictures.items():
        yield Figure(f"{picture.name}-figure", (picture,), f"{picture.label} Files: {name}.png, {name}.svg.")


def _provenance(study: Study) -> Section:
    """Enough to do it again."""
    origin = origin_of(study.robot)
    versions = ", ".join(f"{library} {version}" for library, version in origin["versions"].items())
    named = ("parameters", "effects")
    single = {name: value for name, value in asdict(study).items() if name not in ("factors", *named)}
    factors = {name: ", ".join(map(str, levels)) for name, levels in study.factors.items()}
    sets = {f"{kind}.{name}": str(each) for kind in named for name, each in getattr(study, kind).items()}
    rows: list[Row] = [(name, _plain(value)) for name, value in (single | factors | sets).items()]
    rows += [("versions", versions), ("model (SHA-256)", Code(origin["model_sha256"]))]
    again = "config.json holds all of it; the same study gives the same simulated calibrations."
    blocks: tuple[Block, ...] = (Table(("", ""), tuple(rows)), Paragraph(again))
    return Section("What was done", blocks, shown_in=PAGE)


def _plain(value: Any) -> str:
    """A setting as a person reads it."""
    if value is None or isinstance(value, bool):
        return {None: "–", True: "yes", False: "no"}[value]
    return ", ".join(map(_plain, value)) if isinstance(value, tuple | list) else str(value)


def sentences(analysis: Analysis, metric: str) -> list[str]:
    """Return a sentence for each comparison by a metric, and one for simulated calibrations that did not converge."""
    found = [comparison_sentence(each, analysis.cells) for each in analysis.comparisons if each.metric == metric]
    return [*found, *_failures([mean for mean in analysis.means if mean.metric == metric], analysis.cells)]


def comparison_sentence(comparison: Comparison, cells: Sequence[Cell]) -> str:
    """Describe which cell of a group is best, by how much, and which do not differ significantly."""
    group = comparison.group
    names = {i: level_words(cells[i], group.free) for i in group.cells}
    where = circumstances(group.shared)
    head = f"{where + ', ' if where else ''}by {' and '.join(group.free)}"
    if not comparison.ranks:
        return f"{head}: no simulated calibration converged in two of them, so nothing can be compared"
    ranked = [each.cell for each in comparison.ranks]
    leaders = [each.cell for each in comparison.ranks if each.lowest == 1]
    said = [_leading([names[i] for i in leaders])]
    than = f" than {names[ranked[0]]}" if len(leaders) > 1 else ""
    for cell in ranked[1:]:
        pair = comparison.against(ranked[0], cell)
        many = comparison.kind == "ratio" and pair.effect >= 2
        said.append(f"{names[cell]} {effect_words(pair, comparison.kind)} {'as much' if many else 'worse'}{than}")
    same = [(p.first, p.second) for p in comparison.pairs if not p.told and isfinite(p.effect)]
    apart = [f"{names[i]} and {names[j]}" for i, j in same if not {i, j} <= set(leaders)]
    said += [f"no significant difference: {', '.join(apart)}"] if apart else []
    said += [f"{names[i]} never converged where another did" for i in group.cells if i not in ranked]
    return f"{head}: {'; '.join(said)}"


def _leading(names: Sequence[str]) -> str:
    if len(names) == 1:
        return f"best is {names[0]}"
    return f"best are {', '.join(names[:-1])} and {names[-1]}, which do not differ significantly"


def _failures(means: Sequence[Mean], cells: Sequence[Cell]) -> list[str]:
    """Simulated calibrations that were left out, and in which cells."""
    campaigns, lost = sum(each.campaigns for each in means), sum(each.not_converged for each in means)
    if not lost:
        return []
    worst = max(means, key=lambda each: each.not_converged / max(each.campaigns, 1))
    where = circumstances({name: getattr(cells[worst.cell], name) for name in varying(cells)})
    return [
        f"{lost:,} of {campaigns:,} simulated calibrations did not converge and are left out, in a pair where either "
        f"did not: where there are many, the rest is too favourable; the most are {worst.not_converged:,} of "
        f"{worst.campaigns:,}"
        f"{f' ({where})' if where else ''}"
    ]
