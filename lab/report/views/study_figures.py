"""Figures of a study by matplotlib (the extra ``plots``): means, pairs and ranks of every factor that is compared."""

from collections.abc import Callable, Iterable, Sequence
from functools import lru_cache, partial
from math import ceil, isfinite
from pathlib import Path
from textwrap import fill
from typing import Any, Literal, TypeVar

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import LinearSegmentedColormap, Normalize
from matplotlib.figure import Figure as Drawing
from matplotlib.layout_engine import ConstrainedLayoutEngine
from matplotlib.patches import Rectangle

from lab.core.errors import LabError
from lab.core.number_text import capital
from lab.report import document as doc
from lab.report.charts.chart import log_ticks, save_figure
from lab.report.charts.marks import round_numbers
from lab.report.style import FIGURE_STYLE, MUTED, PREDICTED, REFERENCE, SERIES
from lab.report.views.study_document import behind_best, effect_text, factor_sentence, factor_text, metric_text, varying
from lab.studies.analysis import Analysis, CellGroup, Comparison, Mean, groups
from lab.studies.grid import ANY, Cell, is_any
from lab.studies.study import StudyResult, circumstances, level_text, plain_level, shown_metrics

__all__ = ["first_picture", "pictures_of", "study_pictures", "write_pictures"]

_KINDS = {
    "means": "with 95 % intervals over the robots",
    "pairs": "each level against the best one, with 95 % intervals",
    "ranks": "in how many of 100 resamples of the robots each level has each rank",
}
_FAR = 3.0  # a ratio from which the axis of ratios is logarithmic
_GREYS = LinearSegmentedColormap.from_list("certainty", ["#ffffff", "#a3a3a3"])  # on which figures can be read
_SHOWN = 0.005  # of the resamples: less is not written
_MOST_ACROSS = 3  # panels side by side
_LETTERS_AN_INCH = 11  # of a title
_TITLE = 22  # letters in a line above a panel
_APART = 0.035  # of the axis, between the lines' marks at one level
_LEAST_TICKS = 3  # of a logarithmic axis


def study_pictures(analysis: Analysis, metric: str) -> dict[str, doc.Picture]:
    """A metric's means, pairs and ranks by every factor that is compared, by the names of their files."""
    by_factor: dict[tuple[str, ...], list[Comparison]] = {}
    for each in analysis.comparisons:
        if each.metric == metric and each.ranks:
            by_factor.setdefault(each.group.free, []).append(each)
    made: dict[str, doc.Picture] = {}
    for free, comparisons in by_factor.items():
        draw: dict[str, Callable[[], Drawing]] = {
            "means": partial(_means_figure, analysis, metric, free[0]),
            "pairs": partial(_pairs_figure, comparisons, analysis.cells),
        }
        if any(rank.lowest < rank.highest for each in comparisons for rank in each.ranks):
            draw["ranks"] = partial(_ranks_figure, comparisons, analysis.cells)  # none where each rank is certain
        answers = capital(factor_sentence(comparisons, analysis.cells))
        for kind, figure in draw.items():
            name = f"{metric}-{'-'.join(free)}-{kind}"
            shown = f"{capital(metric_text(metric, unit=False))} by {' and '.join(map(factor_text, free))}"
            made[name] = doc.Picture(name.replace("_", "-"), f"{shown}, {_KINDS[kind]}. {answers}.", figure)
    return made


def write_pictures(result: StudyResult, folder: Path) -> None:
    """Write the figures of a study, each as PNG and SVG."""
    for name, picture in pictures_of(result).items():
        save_figure(folder, name, picture.draw())


def _means_figure(analysis: Analysis, metric: str, factor: str) -> Drawing:
    """A metric against a factor with 95 % intervals, a line a level of another one, a panel where the rest agrees."""
    cells = analysis.cells
    line = _line_factor(cells, factor)
    means = {mean.cell: mean for mean in analysis.means if mean.metric == metric}
    shown = groups(cells, [factor, line] if line else [factor])
    names = list(dict.fromkeys(_line_name(cells[i], line) for group in shown for i in group.cells))
    positions = _positions([_axis_level(cells[i], factor) for group in shown for i in group.cells])

    def draw(axes: Axes, group: CellGroup) -> None:
        for k, name in enumerate(names):
            mine = [
                (positions[_axis_level(cells[i], factor)], means[i])
                for i in group.cells
                if _line_name(cells[i], line) == name
            ]
            if mine:
                _line(axes, mine, k, len(names), label=name, joined=not _named(positions))
        axes.set_xticks(list(positions.values()), [str(level) for level in positions])
        axes.set_xlim(-0.1, 1.1)
        axes.set_title(fill(circumstances(group.shared), _TITLE), fontsize=10)

    title = f"{metric_text(metric, unit=False)}: means with 95 % intervals over robots"
    figure = _panels(shown, draw, title, (3.6, 3.6), sharey=True)
    drawn = [end for i in {i for group in shown for i in group.cells} for end in (means[i].mean, means[i].lower)]
    is_positive = min((end for end in drawn if isfinite(end)), default=0.0) > 0
    if is_positive:
        _logarithmic(figure.axes[0], "y")
    figure.supxlabel(factor_text(factor), fontsize=10)
    figure.supylabel(metric_text(metric) + (" (log scale)" if is_positive else ""), fontsize=10)
    if line:
        handles = {str(h.get_label()): h for axes in figure.axes for h in axes.get_legend_handles_labels()[0]}
        shown_lines = [handles[name] for name in names]
        figure.legend(
            shown_lines, names, title=factor_text(line), loc="outside right center", fontsize=9, handlelength=3.5
        )
    return figure


def _logarithmic(axes: Axes, which: Literal["x", "y"]) -> None:
    """Make an axis logarithmic, with plain numbers at three ticks or more, also of a range far below a decade."""
    axes.set(**{f"{which}scale": "log"})
    low, high = axes.get_xlim() if which == "x" else axes.get_ylim()
    log_ticks(axes, which, low, high)
    axis = axes.xaxis if which == "x" else axes.yaxis
    if len(axis.get_ticklocs()) < _LEAST_TICKS:
        ticks = [tick for tick in round_numbers(low, high, 4).tolist() if low <= tick <= high]
        axis.set_ticks(ticks, [f"{tick:g}" for tick in ticks])


def _line_factor(cells: Sequence[Cell], factor: str) -> str | None:
    """The factor of the lines: preferably one whose every level is a level of its own."""
    others = [name for name in varying(cells) if name != factor]
    whole = (n for n in others if not any(is_any(n, getattr(cell, n)) for cell in cells))
    return next(whole, others[0] if others else None)


def _line_name(cell: Cell, line: str | None) -> str:
    return level_text(cell, [line]) if line else ""


def _axis_level(cell: Cell, factor: str) -> Any:
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
    y, lower, upper = np.array([(mean.mean, mean.lower, mean.upper) for _, mean in ordered]).T
    axes.errorbar(
        x,
        y,
        [y - lower, upper - y],
        color=colour,
        marker=mark,
        linestyle=dash if joined else "none",
        label=label,
        markersize=5,
        linewidth=1.1,
        elinewidth=1.6,
        capsize=3,
    )


def _pairs_figure(comparisons: Sequence[Comparison], cells: Sequence[Cell]) -> Drawing:
    """Draw a forest plot of the excess of each cell over the best, with 95 % intervals, a panel a group."""
    free, kind = comparisons[0].group.free, comparisons[0].kind
    effects = [pair.effect for each in comparisons for pair in behind_best(each)]
    most = max(filter(isfinite, effects), default=1.0)

    def draw(axes: Axes, each: Comparison) -> None:
        axes.axvline(1.0 if kind == "ratio" else 0.0, color=REFERENCE, linewidth=1)
        for row, pair in enumerate(behind_best(each), start=1):
            colour = PREDICTED if pair.is_significant else MUTED
            axes.hlines(row, pair.lower, pair.upper, color=colour, linewidth=2)
            axes.plot(
                pair.effect,
                row,
                "o",
                color=colour,
                markerfacecolor=colour if pair.is_significant else "white",
                markersize=5,
            )
            axes.text(1.02, row, effect_text(pair, kind), transform=axes.get_yaxis_transform(), va="center", fontsize=8)
        axes.plot(1.0 if kind == "ratio" else 0.0, 0, "D", color=REFERENCE, markersize=5)
        axes.text(1.02, 0, "best", transform=axes.get_yaxis_transform(), va="center", fontsize=8)
        _rows(axes, each, cells)

    text = metric_text(comparisons[0].metric, unit=False)
    title = f"{text} by {factor_text(free[0])}, against the best: same robots, same noise"
    figure = _panels(comparisons, draw, title, (4.6, 0.9 + 0.33 * _most_rows(comparisons)), sharex=True)
    if kind == "ratio" and most > _FAR:
        _logarithmic(figure.axes[0], "x")
    measure = (
        "ratio to the best" if kind == "ratio" else f"difference from the best, {metric_text(comparisons[0].metric)}"
    )
    figure.supxlabel(
        f"{measure}, 95 % interval of each pair; hollow: no significant difference (Holm, 5 %)", fontsize=10
    )
    return figure


def _rows(axes: Axes, comparison: Comparison, cells: Sequence[Cell]) -> None:
    """A row a cell, the best at the top."""
    names = [level_text(cells[rank.cell], comparison.group.free) for rank in comparison.ranks]
    axes.set_yticks(range(len(names)), names)
    axes.set_ylim(len(names) - 0.5, -0.5)
    axes.set_title(fill(circumstances(comparison.group.shared), _TITLE), fontsize=10)


def _most_rows(comparisons: Sequence[Comparison]) -> int:
    return max(len(each.ranks) for each in comparisons)


def _ranks_figure(comparisons: Sequence[Comparison], cells: Sequence[Cell]) -> Drawing:
    """The share of resamples in which each cell has each rank, its 95 % set framed, a panel a group."""
    free = comparisons[0].group.free

    def draw(axes: Axes, each: Comparison) -> None:
        chances = np.array([rank.chances for rank in each.ranks])
        axes.grid(visible=False)
        axes.imshow(100 * chances, cmap=_GREYS, vmin=0, vmax=100, aspect="auto")
        for (row, column), chance in np.ndenumerate(chances):
            if chance >= _SHOWN:
                axes.text(column, row, f"{100 * chance:.0f}", ha="center", va="center", fontsize=8)
        for row, rank in enumerate(each.ranks):
            wide = rank.highest - rank.lowest + 0.9
            corner = (rank.lowest - 1.45, row - 0.43)
            axes.add_patch(Rectangle(corner, wide, 0.86, fill=False, edgecolor=REFERENCE, linewidth=1.6))
        axes.set_xticks(range(len(chances)), [str(1 + k) for k in range(len(chances))])
        _rows(axes, each, cells)

    text = metric_text(comparisons[0].metric, unit=False)
    rows = _most_rows(comparisons)
    title = f"{text}: ranks by {factor_text(free[0])}"
    figure = _panels(comparisons, draw, title, (1.4 + 0.45 * rows, 0.9 + 0.33 * rows))
    figure.supxlabel("rank; framed: 95 % set of ranks", fontsize=10)
    scale = ScalarMappable(Normalize(0, 100), _GREYS)
    figure.colorbar(scale, ax=figure.axes, label="of the resamples of robots, %", pad=0.02, fraction=0.03, aspect=12)
    return figure


_Shown = TypeVar("_Shown")


def _panels(
    shown: Sequence[_Shown],
    draw: Callable[[Axes, _Shown], None],
    title: str,
    size: tuple[float, float],
    sharex: bool = False,
    sharey: bool = False,
) -> Drawing:
    across = min(len(shown), _MOST_ACROSS)
    down = ceil(len(shown) / across)
    with matplotlib.rc_context(FIGURE_STYLE):
        figure = Drawing(
            figsize=(max(6.5, across * size[0] + 1), down * size[1] + 1.2),
            layout=ConstrainedLayoutEngine(w_pad=0.12, h_pad=0.06),
        )
        panels = figure.subplots(down, across, sharex=sharex, sharey=sharey, squeeze=False).ravel()
        for axes, each in zip(panels, shown, strict=False):
            draw(axes, each)
        for axes in panels[len(shown) :]:
            axes.remove()
        figure.suptitle(fill(title, int(_LETTERS_AN_INCH * figure.get_figwidth())), fontsize=11)
    return figure


@lru_cache(maxsize=1)
def pictures_of(result: StudyResult) -> dict[str, doc.Picture]:
    """Return the figures of a study, by the names of their files."""
    return {
        name: made
        for metric in shown_metrics(result.done.study)
        for name, made in study_pictures(result.analysis, metric).items()
    }


def first_picture(result: StudyResult) -> doc.Picture:
    """Return the means of the first factor that varies.

    Raises:
        LabError: nothing varies.
    """
    for picture in pictures_of(result).values():
        return picture
    raise LabError("no factor of the study has two levels, so the page has no figures; give a factor two levels")
