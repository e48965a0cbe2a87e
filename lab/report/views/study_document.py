"""Document of a study: the answers, means, ranks, figures, and its settings."""

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict
from math import ceil, floor, isfinite, log10
from typing import Any

import numpy as np

from lab.core.number_text import capital, sentence, short
from lab.core.se3 import Array
from lab.report import document as doc
from lab.report.charts.marks import Axes
from lab.report.comparison_plots import ColourScale, heat_map, rows_picture
from lab.report.style import COLOUR_SCALE, PREDICTED
from lab.report.views.study_figures import pictures_of
from lab.report.views.study_texts import (
    METRICS,
    effect_text,
    factor_sentence,
    factor_text,
    metric_text,
    varying,
    with_interval,
)
from lab.studies.analysis import LEAST_ROBOTS, Analysis, Comparison, Mean, Rank
from lab.studies.campaigns import origin_of
from lab.studies.grid import RANKED, GridCell, is_any
from lab.studies.study import (
    StudyResult,
    circumstances,
    failures_text,
    level_text,
    plain_level,
    shown_metrics,
)

__all__ = ["analysis_sections", "answers", "provenance_of", "study_document"]

_MOST_ROWS = 12  # of a picture of levels
_PRICED = {"poses", "targets", "instrument", "noise", "observe", "position_sigma_mm", "rotation_sigma_mrad"}


def _mean_text(mean: Mean) -> str:
    """A mean with its interval, e.g. "0.00512 (0.00498 to 0.00526)"."""
    return with_interval((mean.mean, mean.lower, mean.upper), "")


def _rank_text(rank: Rank) -> str:
    """A rank with its 95 % set, where that has more than one."""
    return f"{rank.rank} ({rank.lowest} to {rank.highest})" if rank.lowest < rank.highest else str(rank.rank)


def _behind_text(comparison: Comparison, rank: Rank) -> str:
    """Format the excess of a cell over the first of its comparison; empty for the first."""
    first = comparison.ranks[0].cell
    return "" if rank.cell == first else effect_text(comparison.against(first, rank.cell), comparison.kind)


def _failures(means: Sequence[Mean], cells: Sequence[GridCell]) -> list[str]:
    campaigns, lost = sum(each.campaigns for each in means), sum(each.not_converged for each in means)
    if not lost:
        return []
    worst = max(means, key=lambda each: each.not_converged / max(each.campaigns, 1))
    where = circumstances({name: getattr(cells[worst.cell], name) for name in varying(cells)})
    reasons: Counter[str] = Counter()
    for each in means:
        reasons.update(dict(each.failures))
    if set(reasons) <= {"not converged"}:
        what = "did not converge"
    else:
        what = f"failed ({failures_text(sorted(reasons.items(), key=lambda pair: (-pair[1], pair[0])))})"
    return [
        f"{lost:,} of {campaigns:,} simulated calibrations {what} and are left out, as are pairs with one "
        f"of them. If many fail, the results are too favourable; the most are {worst.not_converged:,} of "
        f"{worst.campaigns:,}{f' ({where})' if where else ''}"
    ]


def study_document(result: StudyResult) -> doc.Document:
    """Build the document of a study: the best cell, answers, means, ranks, figures, and how to repeat it."""
    done, study = result.done, result.done.study
    speed = f" in {done.seconds:,.0f} s" if done.computed else ""
    return doc.Document(
        study.name,
        (
            *_card(result).everywhere,
            doc.Paragraph(
                f"{study.campaigns:,} simulated calibrations: {len(study.cells)} cells, each with the same "
                f"{study.robots} robots, measured {study.draws} times each with the same noise.",
                "note",
            ),
            *analysis_sections(result.analysis, shown_metrics(study)),
            _figures(result),
            doc.Paragraph(
                f"{done.computed:,} of {study.campaigns:,} simulated calibrations computed{speed}.",
                shown_in=doc.TERMINAL,
            ),
            doc.Paragraph(f"study: {done.folder}", shown_in=doc.TERMINAL),
            doc.Paragraph(f"page: {done.folder / 'report.html'}", shown_in=doc.TERMINAL),
        ),
    )


@doc.guarded
def _card(result: StudyResult) -> doc.Card:
    study, cells = result.done.study, result.analysis.cells
    metric = study.metric
    means = [mean for mean in result.analysis.means if mean.metric == metric and isfinite(mean.mean)]
    about = f"{capital(metric_text(metric, unit=False))} of {study.robot}, mean over {study.robots} robots."
    if not means:
        return doc.Card(doc.Badge("none converged", "bad"), (), about, "See why in the table of means.")
    best, worst = min(means, key=lambda each: each.mean), max(means, key=lambda each: each.mean)
    called = circumstances({name: getattr(cells[best.cell], name) for name in varying(cells)}) or "one cell"
    interval = f" (95 %: {short(best.lower)} to {short(best.upper)})" if isfinite(best.lower) else ""
    unit = METRICS.get(metric, ("", ""))[1]
    what = "mean error" if metric == RANKED[0] else "mean"
    numbers = [(f"lowest {what}{interval}", short(best.mean, unit), "")]
    if len(means) > 1:
        numbers.append((f"highest {what}", short(worst.mean, unit), ""))
    return doc.Card(
        ("Best: ", doc.Badge(called, "good")),
        tuple(numbers),
        about,
        _next_step(result.analysis, metric, study.robots, called),
        _overview(result.analysis, metric, best),
    )


def _overview(analysis: Analysis, metric: str, best: Mean) -> tuple[doc.Figure, ...]:
    picture = _overview_picture(analysis, metric, best)
    others = circumstances(_others(analysis.cells, best.cell))
    caption = f"Means over the robots; the scale is logarithmic.{f' Other factors: {others}.' if others else ''}"
    return () if picture is None else (doc.Figure("overview-figure", (picture,), caption),)


def _next_step(analysis: Analysis, metric: str, robots: int, best: str) -> str:
    lost = sum(mean.not_converged for mean in analysis.means if mean.metric == metric)
    if lost:
        return f"Find out why {lost:,} calibrations failed (table of means) before the means are compared."
    if robots < LEAST_ROBOTS:
        return f"Give {LEAST_ROBOTS} robots or more: of {robots} no difference is certain."
    pairs = [pair for each in analysis.comparisons if each.metric == metric for pair in each.pairs]
    has_price = bool(_PRICED & set(varying(analysis.cells)))
    if any(not pair.is_significant for pair in pairs):
        which = "the cheaper level" if has_price else "either"
        return f"Use {best}. Where a difference is not significant, choose {which}, or study more robots."
    others = "a cheaper level is" if has_price else "the others are"
    return f"Use {best}. The answers below say how much worse {others}."


def _plane(cells: Sequence[GridCell]) -> tuple[str, str] | None:
    """Return two factors of which all levels are combined; None where fewer vary."""
    names = [name for name in varying(cells) if not any(is_any(name, getattr(cell, name)) for cell in cells)]
    return (names[0], names[1]) if len(names) > 1 else None


def _others(cells: Sequence[GridCell], best: int) -> dict[str, Any]:
    """Return the levels of the best cell of the factors that the map does not show; none where there is no map."""
    plane = _plane(cells)
    return {} if plane is None else {n: getattr(cells[best], n) for n in varying(cells) if n not in plane}


def _overview_picture(analysis: Analysis, metric: str, best: Mean) -> doc.Picture | None:
    """Draw the means of all levels: of two factors as a map, the others as in the best cell; of one in a row each."""
    cells = analysis.cells
    means = {mean.cell: mean for mean in analysis.means if mean.metric == metric}
    lowest = circumstances({name: getattr(cells[best.cell], name) for name in varying(cells)})
    label = f"{capital(metric_text(metric))}: lowest with {lowest}"
    if any(mean.mean <= 0 for mean in means.values()) or not varying(cells):
        return None
    if (plane := _plane(cells)) is None:
        return _rows_picture(cells, means, metric, label)
    values = _map_of_means(cells, means, plane, _others(cells, best.cell))
    if not np.nanmax(values) > np.nanmin(values):
        return None
    shares, scale = _logarithmic(values, metric_text(metric))
    texts = [[short(value) if isfinite(value) else "" for value in line] for line in values.tolist()]
    names = [[plain_level(name, level) for level in _levels(cells, name)] for name in plane]
    titles = factor_text(plane[0]), factor_text(plane[1])
    return heat_map("overview", label, names[0], names[1], shares, scale, texts, height=0.4, titles=titles)


def _levels(cells: Sequence[GridCell], factor: str) -> list[Any]:
    return list(dict.fromkeys(getattr(cell, factor) for cell in cells))


def _map_of_means(
    cells: Sequence[GridCell], means: Mapping[int, Mean], plane: tuple[str, str], others: Mapping[str, Any]
) -> Array:
    """Return the means by the levels of two factors, the other factors as given; NaN where there is none."""
    rows, columns = (_levels(cells, name) for name in plane)
    values = np.full((len(rows), len(columns)), np.nan)
    for i, cell in enumerate(cells):
        if all(getattr(cell, name) == level for name, level in others.items()):
            values[rows.index(getattr(cell, plane[0])), columns.index(getattr(cell, plane[1]))] = means[i].mean
    return values


def _logarithmic(values: Array, title: str) -> tuple[Array, ColourScale]:
    """Return the places of positive values on a logarithmic scale of colours, and the scale with round ticks."""
    low, high = float(np.nanmin(values)), float(np.nanmax(values))
    ticks = [tick for tick in _round_ticks(low, high) if low <= tick <= high]
    marked = [(float(np.log(tick / low) / np.log(high / low)), f"{tick:g}") for tick in ticks]
    scale = ColourScale(COLOUR_SCALE, marked or [(0.0, short(low)), (1.0, short(high))], title)
    return np.log(values / low) / np.log(high / low), scale


def _round_ticks(low: float, high: float) -> list[float]:
    powers = range(floor(log10(low)), ceil(log10(high)) + 1)
    return [digit * 10.0**power for power in powers for digit in (1, 2, 5)]


def _rows_picture(cells: Sequence[GridCell], means: Mapping[int, Mean], metric: str, label: str) -> doc.Picture:
    order = sorted((i for i in means if isfinite(means[i].mean)), key=lambda i: means[i].mean)[:_MOST_ROWS]
    names = [level_text(cells[i], varying(cells)) for i in order]
    ends = np.array([(means[i].lower, means[i].mean, means[i].upper) for i in order])
    known = np.isfinite(ends[:, 0])

    def draw(axes: Axes, at: Array) -> None:
        axes.hlines(at[known], ends[known, 0], ends[known, 2], color=PREDICTED, linewidth=2)
        axes.plot(ends[:, 1], at, "o", color=PREDICTED, markersize=6)

    limits = float(np.nanmin(ends)) / 1.2, float(np.nanmax(ends)) * 1.2
    return rows_picture("overview", label, names, draw, metric_text(metric), ends=limits, step=0.28)


@doc.guarded
def analysis_sections(analysis: Analysis, metrics: Sequence[str]) -> tuple[doc.Section, ...]:
    """Answers, means and ranks by the metrics; a page alone shows those after the first."""
    media = [doc.EVERYWHERE if i == 0 else doc.PAGE for i in range(len(metrics))]
    results = [
        doc.Section(
            capital(metric_text(metric, unit=False)),
            (doc.Bullets(tuple(map(sentence, answers(analysis, metric)))),),
            shown_in=media[i],
        )
        for i, metric in enumerate(metrics)
    ]
    ranks = [
        doc.Section(f"By {metric_text(metric)}", tuple(_ranks(analysis, metric)), shown_in=media[i])
        for i, metric in enumerate(metrics)
    ]
    note = (
        "Pairs are of the same robots and the same noise, with Holm's correction. First: in how many of 100 resamples "
        "of the robots the level has rank 1."
    )
    return (
        doc.Section("Results", tuple(results)),
        doc.Section("Means", (_means(analysis, metrics),)),
        doc.Section("Ranks", (*ranks, doc.Paragraph(note if analysis.comparisons else "", "note"))),
    )


def answers(analysis: Analysis, metric: str) -> list[str]:
    """Return a sentence for each factor, over all settings of the others, and one for what did not converge."""
    by_factor: dict[tuple[str, ...], list[Comparison]] = {}
    for each in analysis.comparisons:
        if each.metric == metric:
            by_factor.setdefault(each.group.free, []).append(each)
    sentences = [factor_sentence(comparisons, analysis.cells) for comparisons in by_factor.values()]
    return [*sentences, *_failures([mean for mean in analysis.means if mean.metric == metric], analysis.cells)]


def _means(analysis: Analysis, metrics: Sequence[str]) -> doc.Table:
    """Tabulate all cells' means with 95 % intervals over the robots; only the first metric if space is short."""
    names = varying(analysis.cells)
    of = {(mean.cell, mean.metric): mean for mean in analysis.means}
    more = [metric for metric in (*metrics[1:], "nees", "before_mm") if (0, metric) in of]
    rows = []
    for i, cell in enumerate(analysis.cells):
        first = of[i, metrics[0]]
        rows.append(
            (
                *(plain_level(name, getattr(cell, name)) for name in names),
                _mean_text(first),
                *(_mean_text(of[i, metric]) for metric in more),
                f"{first.not_converged:,} of {first.campaigns:,}",
            )
        )
    columns: tuple[str | doc.Column, ...] = (
        *names,
        metric_text(metrics[0]),
        *(doc.Column(metric_text(metric), doc.PAGE) for metric in more),
        "failed",
    )
    robots = max(mean.robots for mean in analysis.means if mean.metric == metrics[0])
    caption = f"Means with 95 % intervals over {robots} robots, each with all its draws; means.csv has every metric."
    return doc.Table(columns, tuple(rows), caption)


def _ranks(analysis: Analysis, metric: str) -> Iterable[doc.Table]:
    """A table for each factor: the groups that share all other factors, each with its best level first."""
    compared = [each for each in analysis.comparisons if each.metric == metric]
    for free in dict.fromkeys(each.group.free for each in compared):
        rows: list[doc.Row] = []
        for each in (one for one in compared if one.group.free == free):
            if where := circumstances(each.group.shared):
                rows.append((f"{where}:", "", "", ""))
            rows += [
                (
                    level_text(analysis.cells[rank.cell], free),
                    _rank_text(rank),
                    f"{100 * rank.chances[0]:.0f}",
                    _behind_text(each, rank),
                )
                for rank in each.ranks
            ]
        factors = " and ".join(free)
        columns = (factors, "rank (95 % set)", "first", "worse than the first by")
        yield doc.Table(columns, tuple(rows), f"Ranks by {factors}", folded=True)


@doc.guarded
def _figures(result: StudyResult) -> doc.Section:
    figures = [
        doc.Figure(f"{picture.name}-figure", (picture,), f"{picture.label} Files: {name}.png, {name}.svg.", wide=True)
        for name, picture in pictures_of(result).items()
    ]
    return doc.Section("Figures", tuple(figures), shown_in=doc.PAGE)


def provenance_of(result: StudyResult) -> doc.Section:
    """Tabulate the settings of a study; a run that goes on with one has the same."""
    study = result.done.study
    origin = origin_of(study.robot)
    versions = ", ".join(f"{library} {version}" for library, version in origin["versions"].items())
    named = ("parameters", "effects")
    single = {name: value for name, value in asdict(study).items() if name not in ("factors", *named)}
    factors = {name: ", ".join(plain_level(name, level) for level in levels) for name, levels in study.factors.items()}
    sets = {f"{kind}.{name}": str(each) for kind in named for name, each in getattr(study, kind).items()}
    rows: list[doc.Row] = [(name, _plain(value)) for name, value in (single | factors | sets).items()]
    rows += [("versions", versions), ("model (SHA-256)", doc.Code(origin["model_sha256"]))]
    again = "config.json holds all settings; the same study gives the same simulated calibrations."
    return doc.Section("What was done", (doc.Table(("", ""), tuple(rows)), doc.Paragraph(again)), shown_in=doc.PAGE)


def _plain(value: Any) -> str:
    """A setting as a person reads it."""
    if value is None or isinstance(value, bool):
        return {None: "–", True: "yes", False: "no"}[value]
    return ", ".join(map(_plain, value)) if isinstance(value, tuple | list) else str(value)
