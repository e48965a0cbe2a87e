"""What a finished study says: its analysis, written into its folder as tables, figures and a page, and printed.

It takes in pictures that matplotlib drew, which is slow to import: import this module where a study is finished.
"""

from dataclasses import asdict
from pathlib import Path

from rich.console import Console

from lab.commands.study.console import print_analysis, write_csv
from lab.commands.study.figures import plot_study
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
from lab.render.html import Html, capital, element, figure, inline, paragraph, section, table, together, write_page
from lab.studies.analysis import Analysis, Comparison, analysed
from lab.studies.grid import Study
from lab.studies.provenance import origin_of
from lab.studies.run import StudyDone
from lab.studies.store import read_campaigns

METRICS = ("fresh_mean_mm", "fresh_worst_mm")  # of the figures and the page; the CSV files have all


def write_study(done: StudyDone) -> Analysis:
    """Write means, pairs and ranks as CSV, the figures, and ``report.html``, into the study's folder."""
    analysis = analysis_of(done)
    write_csv(done.folder, analysis)
    pictures = [name for metric in METRICS for name in plot_study(done.folder, analysis, metric)]
    write_page(done.folder / "report.html", done.study.name, _parts(done, analysis, pictures))
    return analysis


def analysis_of(done: StudyDone) -> Analysis:
    """What the campaigns of a study say."""
    campaigns = read_campaigns(done.folder)
    columns = {name: campaigns[name].to_numpy() for name in campaigns.column_names}
    return analysed(columns, done.study.cells, done.study.seed)


def print_study(done: StudyDone, analysis: Analysis) -> None:
    """The same in a few tables."""
    console = Console(highlight=False, markup=False)
    print_analysis(analysis, METRICS[0], console)
    speed = f" in {done.seconds:,.0f} s" if done.computed else ""
    console.print(f"{done.computed:,} of {done.study.campaigns:,} campaigns worked out{speed}")
    console.print(f"study: {done.folder}", soft_wrap=True)


def _parts(done: StudyDone, analysis: Analysis, pictures: list[str]) -> list[Html]:
    study = done.study
    return [
        paragraph(
            f"{study.campaigns:,} virtual campaigns: {len(study.cells)} cells, each with the same {study.robots} "
            f"robots, measured {study.draws} times each with the same noise.",
            "lead",
        ),
        section("What came out", [_said(analysis, metric) for metric in METRICS]),
        section("Means", [_means(analysis)]),
        section("Ranks", [_ranks(analysis, metric) for metric in METRICS if analysis.comparisons]),
        section("Figures", [_picture(done.folder, name) for name in pictures]),
        section("What was done", _done(study)),
    ]


def _said(analysis: Analysis, metric: str) -> Html:
    """The answers by a metric, a line each."""
    lines = "".join(element("li", f"{capital(line)}.") for line in sentences(analysis, metric))
    return together([element("h3", capital(metric_words(metric, unit=False))), element("ul", Html(lines))])


def _means(analysis: Analysis) -> Html:
    """Every cell's means, with 95 % intervals over the robots."""
    names = varying(analysis.cells)
    shown = (*METRICS, "nees", "before_mm")
    of = {(mean.cell, mean.metric): mean for mean in analysis.means}
    rows = [
        [*(str(getattr(cell, name)) for name in names), *(mean_words(of[i, metric]) for metric in shown)]
        for i, cell in enumerate(analysis.cells)
    ]
    caption = "Means with 95 % intervals over the robots, each with all its draws; means.csv has every column."
    return table([*names, *map(metric_words, shown)], rows, caption)


def _ranks(analysis: Analysis, metric: str) -> Html:
    """Each comparison's cells, the best first."""
    rows = [row for each in analysis.comparisons if each.metric == metric for row in _rank_rows(each, analysis)]
    header = ["where", "", "rank (95 % set)", "first of 100 resamples", "worse than the first by"]
    return table(header, rows, f"By {metric_words(metric)}; pairs of the same robots and noise, Holm's correction.")


def _rank_rows(comparison: Comparison, analysis: Analysis) -> list[list[str]]:
    where, free = circumstances(comparison.group.shared), comparison.group.free
    return [
        [
            where,
            level_words(analysis.cells[rank.cell], free),
            rank_words(rank),
            f"{100 * rank.chances[0]:.0f}",
            behind_words(comparison, rank),
        ]
        for rank in comparison.ranks
    ]


def _picture(folder: Path, name: str) -> Html:
    words = name.replace("-", ", ").replace("_", " ")
    drawing = (folder / f"{name}.svg").read_text(encoding="utf-8")
    return figure(f"{name}-figure", [inline(drawing, name, words)], f"{capital(words)} ({name}.png, {name}.svg).")


def _done(study: Study) -> list[Html]:
    """Enough to do it again."""
    origin = origin_of(study.robot)
    versions = ", ".join(f"{library} {version}" for library, version in origin["versions"].items())
    named = ("parameters", "effects")
    plain = {name: value for name, value in asdict(study).items() if name not in ("factors", *named)}
    factors = {name: ", ".join(map(str, levels)) for name, levels in study.factors.items()}
    sets = {f"{kind}.{name}": str(each) for kind in named for name, each in getattr(study, kind).items()}
    rows = [[name, str(value)] for name, value in (plain | factors | sets).items()]
    rows += [["versions", versions], ["model (SHA-256)", element("code", origin["model_sha256"])]]
    return [table(["", ""], rows), paragraph("config.json holds all of it; the same study gives the same campaigns.")]
