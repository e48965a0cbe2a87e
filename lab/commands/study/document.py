"""Document and figures of a study: the answers, means, ranks, and its settings."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict
from functools import lru_cache
from typing import Any

from lab.commands.study.figures import study_pictures
from lab.commands.study.format import (
    behind_text,
    circumstances,
    level_text,
    mean_text,
    metric_text,
    rank_text,
    sentences,
    varying,
)
from lab.commands.study.run import StudyResult
from lab.core.errors import LabError
from lab.render.document import (
    EVERYWHERE,
    PAGE,
    TERMINAL,
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
from lab.studies.analysis import Analysis
from lab.studies.campaigns import origin_of

__all__ = ["METRICS", "analysis_sections", "first_picture", "pictures_of", "provenance_of", "study_document"]

METRICS = ("fresh_mean_mm", "fresh_worst_mm")  # of the figures and the page; the CSV files have all


@lru_cache(maxsize=1)
def pictures_of(result: StudyResult) -> dict[str, Picture]:
    """Return the figures of a study, by the names of their files."""
    return {name: made for metric in METRICS for name, made in study_pictures(result.analysis, metric).items()}


def first_picture(result: StudyResult) -> Picture:
    """Return the means of the first factor that varies.

    Raises:
        LabError: nothing varies.
    """
    for picture in pictures_of(result).values():
        return picture
    raise LabError("no factor of the study has two levels, so the page has no figures; give a factor two levels")


def study_document(result: StudyResult) -> Document:
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
            Section("Figures", tuple(_figures(pictures_of(result))), shown_in=PAGE),
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
            capital(metric_text(metric, unit=False)),
            (Bullets(tuple(map(sentence, sentences(analysis, metric)))),),
            shown_in=media[i],
        )
        for i, metric in enumerate(metrics)
    ]
    ranks = [
        Section(f"By {metric_text(metric)}", tuple(_ranks(analysis, metric)), shown_in=media[i])
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
                mean_text(first),
                *(mean_text(of[i, metric]) for metric in more),
                f"{first.not_converged:,} of {first.campaigns:,}",
            )
        )
    columns: tuple[str | Column, ...] = (
        *names,
        metric_text(metrics[0]),
        *(Column(metric_text(metric), PAGE) for metric in more),
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
                    level_text(analysis.cells[rank.cell], free),
                    rank_text(rank),
                    f"{100 * rank.chances[0]:.0f}",
                    behind_text(each, rank),
                )
                for rank in each.ranks
            ]
        yield Table((" and ".join(free), "rank (95 % set)", "first", "worse than the first by"), tuple(rows))


def _figures(pictures: Mapping[str, Picture]) -> Iterable[Figure]:
    for name, picture in pictures.items():
        yield Figure(f"{picture.name}-figure", (picture,), f"{picture.label} Files: {name}.png, {name}.svg.")


def provenance_of(result: StudyResult) -> Section:
    """Tabulate the settings of a study; a run that goes on with one has the same."""
    study = result.done.study
    origin = origin_of(study.robot)
    versions = ", ".join(f"{library} {version}" for library, version in origin["versions"].items())
    named = ("parameters", "effects")
    single = {name: value for name, value in asdict(study).items() if name not in ("factors", *named)}
    factors = {name: ", ".join(map(str, levels)) for name, levels in study.factors.items()}
    sets = {f"{kind}.{name}": str(each) for kind in named for name, each in getattr(study, kind).items()}
    rows: list[Row] = [(name, _plain(value)) for name, value in (single | factors | sets).items()]
    rows += [("versions", versions), ("model (SHA-256)", Code(origin["model_sha256"]))]
    again = "config.json holds all settings; the same study gives the same simulated calibrations."
    return Section("What was done", (Table(("", ""), tuple(rows)), Paragraph(again)), shown_in=PAGE)


def _plain(value: Any) -> str:
    """A setting as a person reads it."""
    if value is None or isinstance(value, bool):
        return {None: "–", True: "yes", False: "no"}[value]
    return ", ".join(map(_plain, value)) if isinstance(value, tuple | list) else str(value)
