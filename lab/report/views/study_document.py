"""Document of a study: the answers, means, ranks, figures, and its settings."""

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict
from math import ceil, floor, isfinite, log10
from typing import Any

import numpy as np

from lab.core.number_text import capital, sentence, short
from lab.extension_points import load_reference
from lab.report import document as doc
from lab.report.charts.chart import axes_picture, log_ticks
from lab.report.charts.marks import Axes
from lab.report.comparison_plots import ColourScale, heat_map
from lab.report.style import COLOUR_SCALE, PREDICTED
from lab.studies.analysis import LEAST_ROBOTS, Analysis, Comparison, Kind, Mean, Pair, Rank
from lab.studies.campaigns import origin_of
from lab.studies.grid import FACTORS, RANKED, Cell, is_any
from lab.studies.study import (
    StudyResult,
    circumstances,
    failures_text,
    level_text,
    plain_level,
    shown_metrics,
)

__all__ = [
    "analysis_sections", "behind_best", "comparison_sentence", "effect_text", "factor_sentence", "factor_text",
    "metric_text", "provenance_of", "sentences", "study_document", "varying",
]  # fmt: skip

_MOST_ROWS = 12  # of a picture of levels
_METRICS = {
    "fresh_mean_mm": ("mean error on validation poses", "mm"),
    "fresh_p95_mm": ("95 % of the errors on validation poses", "mm"),
    "fresh_worst_mm": ("worst error on validation poses", "mm"),
    "length_rms_mm": ("RMS error of the lengths", "mm"),
    "angle_rms_mrad": ("RMS error of the angles", "mrad"),
    "link_length_rms_mm": ("RMS error of the arm's own lengths", "mm"),
    "link_angle_rms_mrad": ("RMS error of the arm's own angles", "mrad"),
    "mixed_rms": ("RMS error of all parameters", "mm and rad"),
    "nees": ("NEES per parameter, 1 expected", ""),
    "before_mm": ("mean error on validation poses before the calibration", "mm"),
    "steps": ("Gauss-Newton steps", ""),
}
_AXES = {
    "poses": "number of poses",
    "position_sigma_mm": "position σ of the arm, mm",
    "sampler": "sampler of the arms",
    "rotation_sigma_mrad": "rotation σ of the arm, mrad",
    "model": "fitted model",
    "robust": "robust fit",
    "prior": "prior of the tolerances",
    "observe": "what is measured",
    "plan": "poses of a plan",
    "targets": "number of targets",
    "payload_kg": "payload, kg",
}
_WORDS = {
    "observe": "what is measured",
    "targets": "number of targets",
    "payload_kg": "payload",
    "model": "fitted model",
}
_PRICED = {"poses", "targets", "instrument", "noise", "observe", "position_sigma_mm", "rotation_sigma_mrad"}
_WIDE = 10  # a ratio's upper end over its lower
_EQUAL = 1e-5  # ratios are equal within this, as fits end so near to their minimum
_TOO_FEW = "too few robots for an interval"
_MOST_DIGITS = 9  # after the point, to show a bound that is not zero


def metric_text(metric: str, unit: bool = True) -> str:
    """A metric as people read it, e.g. "mean error on validation poses, mm"."""
    text, its_unit = _METRICS.get(metric, (metric, ""))
    return f"{text}, {its_unit}" if unit and its_unit else text


def factor_text(factor: str) -> str:
    """A factor as an axis names it."""
    return _AXES.get(factor, factor)


def varying(cells: Sequence[Cell]) -> tuple[str, ...]:
    """The factors of which there is more than one level."""
    return tuple(
        name for name in FACTORS if len({level for cell in cells if not is_any(name, level := getattr(cell, name))}) > 1
    )


def effect_text(pair: Pair, kind: Kind, *, note: bool = True) -> str:
    """Format the excess of a pair's second cell over the first, e.g. "4.1 % (3.7 to 4.6)".

    A ratio from 2 on, or one with a wide interval, is printed as "2.1 times (2.0 to 2.2)".

    Args:
        note: whether the text says that robots are too few for an interval.
    """
    ends = (pair.effect, pair.lower, pair.upper)
    if not isfinite(pair.effect):
        return "not known"
    if _is_equal(pair, kind):
        return f"equal (within {100 * _EQUAL:g} %)"
    if kind == "difference":
        return _with_interval(ends, "", note=note)
    if pair.upper > _WIDE * pair.lower:  # few robots: hardly the order of magnitude is known
        value, lower, upper = (f"{float(f'{end:.2g}'):,.10g}" for end in ends)
        return f"{value} times ({lower} to {upper})"
    if pair.effect >= 2:
        return _with_interval(ends, " times", note=note)
    return _with_interval([100 * (end - 1) for end in ends], " %", note=note)


def _is_equal(pair: Pair, kind: Kind) -> bool:
    """Decide whether a ratio differs from one by rounding alone: of fits that end in the same minimum."""
    ends = [end for end in (pair.effect, pair.lower, pair.upper) if isfinite(end)]
    return kind == "ratio" and all(abs(end - 1) < _EQUAL for end in ends)


def _mean_text(mean: Mean) -> str:
    """A mean with its interval, e.g. "0.00512 (0.00498 to 0.00526)"."""
    return _with_interval((mean.mean, mean.lower, mean.upper), "")


def _with_interval(ends: Sequence[float], unit: str, *, note: bool = True) -> str:
    """A value and its interval, to the digits that it leaves, and that show on which side of zero it ends."""
    value, lower, upper = ends
    if not isfinite(lower):
        return f"{value:.3g}{unit}{f' ({_TOO_FEW})' if note else ''}".replace("-", "−")
    half = (upper - lower) / 2
    size = 10.0 ** floor(log10(half)) if half > 0 else 1e-3
    digits = max(0, round(-log10(size)) + (half < 2 * size))
    while digits < _MOST_DIGITS and any(end and not float(f"{end:.{digits}f}") for end in ends):
        digits += 1
    shown = [f"{end + 0:.{digits}f}" for end in ends]
    return f"{shown[0]}{unit} ({shown[1]} to {shown[2]})".replace("-", "−")


def _rank_text(rank: Rank) -> str:
    """A rank with its 95 % set, where that has more than one."""
    return f"{rank.rank} ({rank.lowest} to {rank.highest})" if rank.lowest < rank.highest else str(rank.rank)


def _behind_text(comparison: Comparison, rank: Rank) -> str:
    """Format the excess of a cell over the first of its comparison; empty for the first."""
    first = comparison.ranks[0].cell
    return "" if rank.cell == first else effect_text(comparison.against(first, rank.cell), comparison.kind)


def sentences(analysis: Analysis, metric: str) -> list[str]:
    """Return a sentence for each comparison by a metric, and one for simulated calibrations that did not converge."""
    found = [comparison_sentence(each, analysis.cells) for each in analysis.comparisons if each.metric == metric]
    return [*found, *_failures([mean for mean in analysis.means if mean.metric == metric], analysis.cells)]


def comparison_sentence(comparison: Comparison, cells: Sequence[Cell]) -> str:
    """Describe which cell of a group is best, by how much, and which do not differ significantly."""
    group = comparison.group
    names = {i: level_text(cells[i], group.free) for i in group.cells}
    where = circumstances(group.shared)
    head = f"{where + ', ' if where else ''}by {' and '.join(_WORDS.get(name, name) for name in group.free)}"
    if not comparison.ranks:
        return f"{head}: no simulated calibration converged in two of them, so nothing can be compared"
    ranked = [each.cell for each in comparison.ranks]
    behind = [comparison.against(ranked[0], cell) for cell in ranked[1:]]
    messages = [f"best is {names[ranked[0]]}"]
    for pair in behind:
        size = effect_text(pair, comparison.kind, note=False)
        if not _is_equal(pair, comparison.kind):
            size += " as much" if comparison.kind == "ratio" and pair.effect >= 2 else " worse"
            size += ", not significantly" if isfinite(pair.lower) and not pair.is_significant else ""
        messages.append(f"{names[pair.second]} {size}")
    same = [(p.first, p.second) for p in comparison.pairs if not p.is_significant and isfinite(p.lower)]
    apart = [f"{names[i]} and {names[j]}" for i, j in same if ranked[0] not in (i, j)]
    messages += [f"no significant difference: {', '.join(apart)}"] if apart else []
    if few := [pair.robots for pair in behind if not isfinite(pair.lower)]:
        messages.append(f"{_TOO_FEW}: {min(few)}, and {LEAST_ROBOTS} or more are needed")
    messages += [f"{names[i]} never converged where another did" for i in group.cells if i not in ranked]
    return f"{head}: {'; '.join(messages)}"


def _failures(means: Sequence[Mean], cells: Sequence[Cell]) -> list[str]:
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


def behind_best(comparison: Comparison) -> list[Pair]:
    """Return each level that is not the best one, as its pair with the best."""
    return [comparison.against(comparison.ranks[0].cell, rank.cell) for rank in comparison.ranks[1:]]


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
    names = varying(cells)
    called = circumstances({name: getattr(cells[best.cell], name) for name in names}) or "one cell"
    interval = f" (95 %: {short(best.lower)} to {short(best.upper)})" if isfinite(best.lower) else ""
    unit = _METRICS.get(metric, ("", ""))[1]
    what = "mean error" if metric == RANKED[0] else "mean"
    numbers = [(f"lowest {what}{interval}", short(best.mean, unit), "")]
    if len(means) > 1:
        numbers.append((f"highest {what}", short(worst.mean, unit), ""))
    picture = _overview_picture(result.analysis, metric, best)
    others = circumstances(_others(cells, best.cell))
    caption = f"Means over the robots; the scale is logarithmic.{f' Other factors: {others}.' if others else ''}"
    return doc.Card(
        ("Best: ", doc.Badge(called, "good")),
        tuple(numbers),
        about,
        _next_step(result.analysis, metric, study.robots, called),
        () if picture is None else (doc.Figure("overview-figure", (picture,), caption),),
    )


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


def _plane(cells: Sequence[Cell]) -> tuple[str, str] | None:
    """Return two factors of which all levels are combined; None where fewer vary."""
    names = [name for name in varying(cells) if not any(is_any(name, getattr(cell, name)) for cell in cells)]
    return (names[0], names[1]) if len(names) > 1 else None


def _others(cells: Sequence[Cell], best: int) -> dict[str, Any]:
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
    others = _others(cells, best.cell)
    rows, columns = (list(dict.fromkeys(getattr(cell, name) for cell in cells)) for name in plane)
    values = np.full((len(rows), len(columns)), np.nan)
    for i, cell in enumerate(cells):
        if all(getattr(cell, name) == level for name, level in others.items()):
            values[rows.index(getattr(cell, plane[0])), columns.index(getattr(cell, plane[1]))] = means[i].mean
    low, high = float(np.nanmin(values)), float(np.nanmax(values))
    if high <= low:
        return None
    shares = np.log(values / low) / np.log(high / low)
    ticks = [m * 10.0**p for p in range(floor(log10(low)), ceil(log10(high)) + 1) for m in (1, 2, 5)]
    marked = [(float(np.log(tick / low) / np.log(high / low)), f"{tick:g}") for tick in ticks if low <= tick <= high]
    scale = ColourScale(COLOUR_SCALE, marked or [(0.0, short(low)), (1.0, short(high))], metric_text(metric))
    texts = [[short(value) if isfinite(value) else "" for value in line] for line in values.tolist()]
    names = [[plain_level(name, level) for level in of] for name, of in zip(plane, (rows, columns), strict=True)]
    titles = factor_text(plane[0]), factor_text(plane[1])
    return heat_map("overview", label, names[0], names[1], shares, scale, texts, height=0.4, titles=titles)


def _rows_picture(cells: Sequence[Cell], means: Mapping[int, Mean], metric: str, label: str) -> doc.Picture:
    order = sorted((i for i in means if isfinite(means[i].mean)), key=lambda i: means[i].mean)[:_MOST_ROWS]
    names = [level_text(cells[i], varying(cells)) for i in order]
    at = np.arange(len(order))[::-1]
    ends = np.array([(means[i].lower, means[i].mean, means[i].upper) for i in order])

    def draw(axes: Axes) -> None:
        log_ticks(axes, "x", float(np.nanmin(ends)) / 1.2, float(np.nanmax(ends)) * 1.2)
        known = np.isfinite(ends[:, 0])
        axes.hlines(at[known], ends[known, 0], ends[known, 2], colors=PREDICTED, linewidth=2)
        axes.plot(ends[:, 1], at, "o", color=PREDICTED, markersize=6)
        axes.set_yticks(at, names)
        axes.set(ylim=(-0.6, len(order) - 0.4), xlabel=metric_text(metric))
        axes.grid(visible=False, axis="y")

    size = (3.8, 0.8 + 0.28 * len(order))
    return axes_picture("overview", label, size, draw, (0.3 + 0.078 * max(map(len, names)), 0.5, 0.2, 0.1))


@doc.guarded
def analysis_sections(analysis: Analysis, metrics: Sequence[str]) -> tuple[doc.Section, ...]:
    """Answers, means and ranks by the metrics; a page alone shows those after the first."""
    media = [doc.EVERYWHERE if i == 0 else doc.PAGE for i in range(len(metrics))]
    answers = [
        doc.Section(
            capital(metric_text(metric, unit=False)),
            (doc.Bullets(tuple(map(sentence, _answers(analysis, metric)))),),
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
        doc.Section("Results", tuple(answers)),
        doc.Section("Means", (_means(analysis, metrics),)),
        doc.Section("Ranks", (*ranks, doc.Paragraph(note if analysis.comparisons else "", "note"))),
    )


def _answers(analysis: Analysis, metric: str) -> list[str]:
    """Return a sentence for each factor, over all settings of the others, and one for what did not converge."""
    by_factor: dict[tuple[str, ...], list[Comparison]] = {}
    for each in analysis.comparisons:
        if each.metric == metric:
            by_factor.setdefault(each.group.free, []).append(each)
    found = [factor_sentence(comparisons, analysis.cells) for comparisons in by_factor.values()]
    return [*found, *_failures([mean for mean in analysis.means if mean.metric == metric], analysis.cells)]


def factor_sentence(comparisons: Sequence[Comparison], cells: Sequence[Cell]) -> str:
    """Describe over all settings of the other factors which level is best, and how much worse the others are."""
    ranked = [each for each in comparisons if each.ranks]
    if len(comparisons) == 1 or not ranked:
        return comparison_sentence(comparisons[0], cells)
    free, count = comparisons[0].group.free, len(ranked)
    best = Counter(level_text(cells[each.ranks[0].cell], free) for each in ranked)
    head = f"by {' and '.join(_WORDS.get(name, name) for name in free)}, in {count} settings of the other factors"
    (first, times), *rest = best.most_common()
    messages = [f"best is {first}{'' if times == count else f' in {times}'}"]
    messages += [f"{name} is best in {number}" for name, number in rest]
    behind: dict[str, list[Pair]] = {}
    for each in ranked:
        if level_text(cells[each.ranks[0].cell], free) == first:
            for pair in behind_best(each):
                behind.setdefault(level_text(cells[pair.second], free), []).append(pair)
    for name, pairs in sorted(behind.items(), key=lambda item: min(pair.effect for pair in item[1])):
        tied = sum(not pair.is_significant for pair in pairs if isfinite(pair.lower))
        equal = f", not significantly in {tied}" if tied else ""
        messages.append(f"{name} {_range_text([pair.effect for pair in pairs], comparisons[0].kind)}{equal}")
    if few := [pair.robots for pairs in behind.values() for pair in pairs if not isfinite(pair.lower)]:
        messages.append(f"{_TOO_FEW}: {min(few)}, and {LEAST_ROBOTS} or more are needed")
    return f"{head}: {'; '.join(messages)}"


def _range_text(effects: Sequence[float], kind: Kind) -> str:
    """Format by how much a level is worse, from the least to the most over some settings."""
    known = [effect for effect in effects if isfinite(effect)]
    if not known:
        return "not known"
    low, high = min(known), max(known)
    if kind == "difference":
        text, unit = [f"{end:.3g}" for end in (low, high)], " more"
    elif high < 2:
        text, unit = [f"{100 * (end - 1):.2g}" for end in (low, high)], " % worse"
    else:
        text, unit = [f"{end:.2g}" for end in (low, high)], " times as much"
    return f"{' to '.join(dict.fromkeys(text))}{unit}".replace("-", "−")


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
        doc.Figure(f"{made.name}-figure", (made,), f"{made.label} Files: {name}.png, {name}.svg.", wide=True)
        for name, made in load_reference("lab.report.views.study_figures:pictures_of")(result).items()
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
