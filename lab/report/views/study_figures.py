"""Figures of a study: means and pairs of every factor that is compared, a panel a group of cells."""

from collections.abc import Callable, Iterable, Sequence
from functools import partial
from math import ceil
from pathlib import Path
from textwrap import fill
from typing import Any, Literal, TypeVar

import numpy as np

from lab.core.errors import LabError
from lab.core.number_text import capital
from lab.report.charts.chart import axes_picture, log_ticks, save_figure
from lab.report.charts.marks import Axes, text_width
from lab.report.document import Picture
from lab.report.style import INK, MUTED, PREDICTED, REFERENCE, SERIES
from lab.report.views.study_texts import behind_best, effect_text, factor_sentence, factor_text, metric_text, varying
from lab.studies.analysis import Analysis, CellGroup, Comparison, Mean, Pair, groups
from lab.studies.grid import ANY, GridCell, is_any
from lab.studies.study import StudyResult, circumstances, level_text, plain_level, shown_metrics

__all__ = ["first_picture", "pictures_of", "study_pictures", "write_pictures"]

_KINDS = {
    "means": "with 95 % intervals over the robots",
    "pairs": "each level against the best one, with 95 % intervals",
}
_FAR = 3.0  # a ratio from which the axis of ratios is logarithmic
_MOST_ACROSS = 3  # panels side by side
_TITLE = 22  # letters in a line above a panel
_LINE = 0.18  # inches: a line of a title
_FOOT = 0.62  # inches below a panel: its ticks, and the axis's label
_LEAST_REACH = 0.01  # of an axis of ratios beyond its ends: levels may be equal to rounding
_APART = 0.035  # of the axis, between the lines' marks at one level
_SMALL = 8.0  # points: letters beside rows

_Shown = TypeVar("_Shown", CellGroup, Comparison)


def study_pictures(analysis: Analysis, metric: str) -> dict[str, Picture]:
    """A metric's means and pairs by every factor that is compared, by the names of their files."""
    by_factor: dict[tuple[str, ...], list[Comparison]] = {}
    for each in analysis.comparisons:
        if each.metric == metric and each.ranks:
            by_factor.setdefault(each.group.free, []).append(each)
    made: dict[str, Picture] = {}
    for free, comparisons in by_factor.items():
        kinds: dict[str, Callable[[str, str], Picture]] = {
            "means": partial(_means_picture, analysis, metric, free[0]),
            "pairs": partial(_pairs_picture, comparisons, analysis.cells),
        }
        answers = capital(factor_sentence(comparisons, analysis.cells))
        for kind, picture in kinds.items():
            name = f"{metric}-{'-'.join(free)}-{kind}"
            shown = f"{capital(metric_text(metric, unit=False))} by {' and '.join(map(factor_text, free))}"
            made[name] = picture(name.replace("_", "-"), f"{shown}, {_KINDS[kind]}. {answers}.")
    return made


def write_pictures(result: StudyResult, folder: Path) -> None:
    """Write the figures of a study, each as PNG and SVG."""
    for name, picture in pictures_of(result).items():
        save_figure(folder, name, picture.draw())


def _means_picture(analysis: Analysis, metric: str, factor: str, name: str, label: str) -> Picture:
    """A metric against a factor with 95 % intervals, a line a level of another one, a panel where the rest agrees."""
    cells = analysis.cells
    line = _line_factor(cells, factor)
    means = {mean.cell: mean for mean in analysis.means if mean.metric == metric}
    shown = groups(cells, [factor, line] if line else [factor])
    shown_cells = [i for group in shown for i in group.cells]
    names = list(dict.fromkeys(_line_name(cells[i], line) for i in shown_cells))
    levels = {i: _axis_level(cells[i], factor) for i in shown_cells}
    positions = _positions(list(levels.values()))
    low, high = _range_of(means[i] for i in shown_cells)

    last = shown[min(len(shown), _MOST_ACROSS) - 1]  # of the first row of panels

    def draw(axes: Axes, group: CellGroup) -> None:
        for k, series in enumerate(names):
            mine = [i for i in group.cells if _line_name(cells[i], line) == series]
            places = [(positions[levels[i]], means[i]) for i in mine]
            _line(axes, places, k, len(names), label=series, joined=not _named(positions))
        _reach(axes, "y", low, high, is_logarithmic=low > 0)
        axes.set_xticks(list(positions.values()), [str(level) for level in positions])
        axes.set(xlim=(-0.1, 1.1), xlabel=factor_text(factor))
        axes.set(ylabel=metric_text(metric) if group is shown[0] else "")
        if line and group is last:
            axes.legend(loc="upper left", bbox_to_anchor=(1.02, 1.0))

    legend = 0.5 + _inches(names) if line else 0.1
    return _panels(name, label, shown, draw, (2.9, 3.3), (0.7, legend))


def _range_of(means: Iterable[Mean]) -> tuple[float, float]:
    """Return the smallest and the largest of means and ends of their intervals."""
    ends = np.array([(mean.mean, mean.lower, mean.upper) for mean in means])
    ends = ends[np.isfinite(ends)]
    return (float(ends.min()), float(ends.max())) if len(ends) else (0.0, 1.0)


def _reach(axes: Axes, which: Literal["x", "y"], low: float, high: float, *, is_logarithmic: bool) -> None:
    """Let an axis reach a little beyond its ends; levels that are equal to rounding stay beside each other."""
    if is_logarithmic:
        log_ticks(axes, which, low / 1.1, high * 1.1)
        return
    more = max(0.05 * (high - low), _LEAST_REACH * max(abs(low), abs(high))) or 0.5
    axes.set(**{f"{which}lim": (low - more, high + more)})


def _inches(texts: Iterable[str]) -> float:
    """Return the width of the longest of texts in inches, in small letters."""
    return max(text_width(text, _SMALL) for text in texts) / 72


def _line_factor(cells: Sequence[GridCell], factor: str) -> str | None:
    """The factor of the lines: preferably one whose every level is a level of its own."""
    others = [name for name in varying(cells) if name != factor]
    whole = (n for n in others if not any(is_any(n, getattr(cell, n)) for cell in cells))
    return next(whole, others[0] if others else None)


def _line_name(cell: GridCell, line: str | None) -> str:
    return level_text(cell, [line]) if line else ""


def _axis_level(cell: GridCell, factor: str) -> Any:
    """A level as an axis orders it: a number, or its text."""
    level = getattr(cell, factor)
    is_number = isinstance(level, int | float) and not isinstance(level, bool) and not is_any(factor, level)
    return level if is_number else plain_level(factor, level)


def _positions(levels: Sequence[Any]) -> dict[Any, float]:
    """Return the axis positions of a factor's levels, 0 to 1: numbers by their logarithm, names side by side."""
    levels = sorted(dict.fromkeys(levels), key=lambda level: level == ANY)
    if _named(levels):
        return {level: k / max(1, len(levels) - 1) for k, level in enumerate(levels)}
    low, span = min(levels), max(np.log(max(levels) / min(levels)), 1e-9)
    return {level: float(np.log(level / low) / span) for level in sorted(levels)}


def _named(levels: Iterable[Any]) -> bool:
    return any(isinstance(level, str) for level in levels)


def _line(axes: Axes, mine: Sequence[tuple[float, Mean]], number: int, lines: int, *, label: str, joined: bool) -> None:
    """Draw the means of one level, offset a little so that intervals do not hide each other."""
    colour, mark, dash = SERIES[number % len(SERIES)]
    ordered = sorted(mine, key=lambda each: each[0])
    x = np.array([place for place, _ in ordered]) + _APART * (number - (lines - 1) / 2)
    y, lower, upper = np.array([(mean.mean, mean.lower, mean.upper) for _, mean in ordered]).reshape(-1, 3).T
    axes.vlines(x, lower, upper, color=colour, linewidth=1.6)
    dashed = dash if joined else ""
    axes.plot(x, y, color=colour, marker=mark, linestyle=dashed, label=label, markersize=5, linewidth=1.1)


def _pairs_picture(comparisons: Sequence[Comparison], cells: Sequence[GridCell], name: str, label: str) -> Picture:
    """Draw a forest plot of the excess of each cell over the best, with 95 % intervals, a panel a group."""
    kind = comparisons[0].kind
    pairs = [pair for each in comparisons for pair in behind_best(each)]
    none = 1.0 if kind == "ratio" else 0.0
    ends = np.array([(none, none, none), *((pair.effect, pair.lower, pair.upper) for pair in pairs)])
    ends = np.where(np.isfinite(ends), ends, none)
    low, high = float(ends.min()), float(ends.max())
    is_far = kind == "ratio" and float(ends[:, 0].max()) > _FAR
    measure = "ratio to the best" if kind == "ratio" else f"excess, {metric_text(comparisons[0].metric)}"

    def draw(axes: Axes, each: Comparison) -> None:
        axes.axvline(none, color=REFERENCE, linewidth=1)
        for row, pair in enumerate(behind_best(each), start=1):
            _pair(axes, row, pair, effect_text(pair, kind))
        axes.plot([none], [0], "D", color=REFERENCE, markersize=5)
        _beside(axes, 0, "best")
        _rows(axes, each, cells)
        _reach(axes, "x", low, high, is_logarithmic=is_far)
        axes.locator_params(axis="x", nbins=4)
        axes.set(xlabel=f"{measure}; hollow: not significant")

    texts = ["best", *(effect_text(pair, kind) for pair in pairs)]
    size = (2.4, 0.33 * _most_rows(comparisons))
    return _panels(name, label, comparisons, draw, size, (_names_width(comparisons, cells), 0.15 + _inches(texts)))


def _pair(axes: Axes, row: int, pair: Pair, text: str) -> None:
    """Draw the interval of a pair in its row; hollow where the difference is not significant (Holm, 5 %)."""
    colour = PREDICTED if pair.is_significant else MUTED
    axes.hlines([row], [pair.lower], [pair.upper], color=colour, linewidth=2)
    inside = colour if pair.is_significant else "#ffffff"
    axes.scatter([pair.effect], [row], c=inside, s=25, edgecolors=colour, linewidths=1, zorder=3)
    _beside(axes, row, text)


def _beside(axes: Axes, row: int, text: str) -> None:
    axes.annotate(text, (1.02, row), xycoords=("axes fraction", "data"), va="center", fontsize=_SMALL, color=INK)


def _row_names(comparison: Comparison, cells: Sequence[GridCell]) -> list[str]:
    return [level_text(cells[rank.cell], comparison.group.free) for rank in comparison.ranks]


def _names_width(comparisons: Sequence[Comparison], cells: Sequence[GridCell]) -> float:
    """Return the inches that the names of rows need beside a panel."""
    return 0.25 + 1.15 * _inches(name for each in comparisons for name in _row_names(each, cells))


def _rows(axes: Axes, comparison: Comparison, cells: Sequence[GridCell]) -> None:
    """A row a cell, the best at the top."""
    names = _row_names(comparison, cells)
    axes.set_yticks(range(len(names)), names)
    axes.set(ylim=(len(names) - 0.5, -0.5))


def _most_rows(comparisons: Sequence[Comparison]) -> int:
    return max(len(each.ranks) for each in comparisons)


def _panels(
    name: str,
    label: str,
    shown: Sequence[_Shown],
    draw: Callable[[Axes, _Shown], None],
    size: tuple[float, float],
    beside: tuple[float, float],
) -> Picture:
    """Panels side by side in one picture, each under the circumstances that its cells share.

    Args:
        size: of a panel's axes, inches.
        beside: inches at the left and the right of each.
    """
    across, down = min(len(shown), _MOST_ACROSS), ceil(len(shown) / _MOST_ACROSS)
    cell_groups = [each.group if isinstance(each, Comparison) else each for each in shown]
    titles = [fill(circumstances(group.shared), _TITLE) for group in cell_groups]
    head = 0.12 + _LINE * max(title.count("\n") + bool(title) for title in titles)
    step = beside[0] + size[0] + beside[1], head + size[1] + _FOOT
    width, height = across * step[0], down * step[1]

    def drawn(axes: Axes) -> None:
        axes.axis("off")
        for i, (each, title) in enumerate(zip(shown, titles, strict=True)):
            row, column = divmod(i, across)
            left, top = column * step[0] + beside[0], height - row * step[1] - head
            panel = axes.inset_axes((left / width, (top - size[1]) / height, size[0] / width, size[1] / height))
            draw(panel, each)
            panel.set(title=title)

    return axes_picture(name, label, (width, height), drawn, (0.0, 0.0, 0.0, 0.0))


def pictures_of(result: StudyResult) -> dict[str, Picture]:
    """Return the figures of a study, by the names of their files."""
    return {
        name: made
        for metric in shown_metrics(result.done.study)
        for name, made in study_pictures(result.analysis, metric).items()
    }


def first_picture(result: StudyResult) -> Picture:
    """Return the means of the first factor that varies.

    Raises:
        LabError: nothing varies.
    """
    for picture in pictures_of(result).values():
        return picture
    raise LabError("no factor of the study has two levels, so the page has no figures; give a factor two levels")
