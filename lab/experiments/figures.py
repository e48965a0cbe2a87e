"""The pictures that answer a question: which criterion, which instrument, what costs most; as PNG and SVG.

matplotlib is slow to import: import this module where a picture is asked for.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from lab.experiments.which_criterion import REFERENCE as REFERENCE_CRITERION
from lab.experiments.which_criterion import CriterionComparison
from lab.render.style import AXIS, BETTER, FIGURE_STYLE, GRID, PREDICTED, REFERENCE, SCALINGS, SERIES
from lab.studies.analysis import Mean, Pair
from lab.studies.grid import ANY

__all__ = ["Cost", "costs_figure", "criteria_figure", "instruments_figure"]

_MARKS = {**SCALINGS, ANY: (REFERENCE, "X")}
_SCALING_WORDS = {
    "raw": "mm and rad",
    "unit": "unit columns",
    "length": "angles × 300 mm",
    "whitened": "tolerances, noise",
    ANY: "the same in each",
}


def criteria_figure(answer: CriterionComparison, metrics: Sequence[str], titles: Sequence[str], title: str) -> Figure:
    """Errors against those of O1's poses: a row of panels a metric, a column a number of poses, a mark a scaling."""
    numbers = list(dict.fromkeys(poses for _, poses in answer.compared))
    order = _by_error(answer)
    with matplotlib.rc_context(FIGURE_STYLE):
        size = (max(8.5, 2.2 + 3.1 * len(numbers)), 1.5 + 2.6 * len(metrics))
        figure = Figure(figsize=size, layout="constrained")
        grid = figure.subplots(len(metrics), len(numbers), squeeze=False, sharex=True, sharey=True)
        for i, metric in enumerate(metrics):
            for j, poses in enumerate(numbers):
                axes = grid[i, j]
                _criteria_panel(axes, answer, metric, poses, order)
                mean = answer.means[metric][answer.reference(answer.compared[metric, poses])].mean
                micro = "µrad" if metric.endswith("mrad") else "µm"
                axes.set_title(
                    f"{poses} poses: {titles[i]},\n{REFERENCE_CRITERION} {1e3 * mean:.3g} {micro}", fontsize=10
                )
        axes = grid[0, 0]
        _times(axes, *axes.get_xlim())
        handles = [
            axes.plot(
                [], [], mark, color=colour, markeredgecolor=REFERENCE, linestyle="", label=_SCALING_WORDS[scaling]
            )[0]
            for scaling, (colour, mark) in _MARKS.items()
            if any(cell.scaling == scaling for cell in answer.cells)
        ]
        if any(answer.searches.values()):
            handles += axes.plot(
                [], [], "|", color=REFERENCE, markersize=8, linestyle="", label="poses of other searches"
            )
        words = f"error, times that of {REFERENCE_CRITERION}'s poses; 95 % intervals, mostly within the marks"
        figure.supxlabel(words, fontsize=10)
        figure.legend(handles=handles, title="scaling", loc="outside right center", fontsize=9)
        figure.suptitle(title)
    return figure


def _by_error(answer: CriterionComparison) -> list[str]:
    """The criteria, best on top: by the mean logarithm of their error on validation poses."""
    logs: dict[str, list[float]] = {}
    for cell, mean in zip(answer.cells, answer.means["fresh_mean_mm"], strict=True):
        logs.setdefault(cell.criterion, []).append(float(np.log(mean.mean)))
    return sorted(logs, key=lambda name: (name != REFERENCE_CRITERION, np.mean(logs[name])))


def _criteria_panel(axes: Axes, answer: CriterionComparison, metric: str, poses: int, order: Sequence[str]) -> None:
    comparison = answer.compared[metric, poses]
    scalings = [scaling for scaling in _MARKS if scaling != ANY]
    pairs = [pair for each in answer.compared.values() for pair in each.pairs]
    farthest = 1.15 * max(max(pair.effect, 1 / pair.effect) for pair in pairs if _with_reference(answer, pair))
    axes.axvline(1.0, color=REFERENCE, linewidth=1)
    axes.set_xscale("log")
    for number in comparison.group.cells:
        cell = answer.cells[number]
        pair = answer.against_reference(comparison, number)
        ends = (1.0, 1.0, 1.0) if pair is None else (pair.effect, pair.lower, pair.upper)
        aside = 0.0 if cell.scaling == ANY else 0.19 * (scalings.index(cell.scaling) - 1.5)
        row = order.index(cell.criterion) + aside
        colour, mark = _MARKS[cell.scaling]
        axes.hlines(row, ends[1], ends[2], color=REFERENCE, linewidth=1.5)
        axes.plot(ends[0], row, mark, color=colour, markeredgecolor=REFERENCE, markeredgewidth=0.6, markersize=6.5)
        if metric.startswith("fresh") and pair is not None:
            others = np.array(answer.searches.get(cell, ()))
            inside = others[others <= farthest]
            axes.plot(inside, np.full(len(inside), row), "|", color=REFERENCE, markersize=7, zorder=1.5)
            for k, far in enumerate(others[others > farthest]):
                axes.text(farthest, row + 0.25 * (k + 1), f"{far:.1f} ▸", ha="right", va="center", fontsize=8)
    names = ["O2, condition number" if name == "O2" else name for name in order]
    axes.set_yticks(range(len(order)), names)
    axes.set_ylim(len(order) - 0.5, -0.5)
    axes.grid(visible=False, axis="y")
    for row in range(1, len(order)):
        axes.axhline(row - 0.5, color=GRID, linewidth=0.8)
    axes.tick_params(axis="y", length=0)


def _with_reference(answer: CriterionComparison, pair: Pair) -> bool:
    return REFERENCE_CRITERION in (answer.cells[pair.first].criterion, answer.cells[pair.second].criterion)


def _times(axes: Axes, low: float, high: float) -> None:
    """Plain numbers on a logarithmic axis of ratios."""
    ticks = [
        t
        for t in (0.2, 0.3, 0.5, 0.7, 0.8, 1, 1.25, 1.5, 2, 3, 5, 7, 10, 20, 30, 50, 100, 200, 500)
        if low <= t <= high
    ]
    if len(ticks) > 7:
        ticks = [t for t in ticks if t not in (0.3, 0.7, 0.8, 1.25, 1.5, 3, 7, 30)]
    axes.set_xticks(ticks, [f"{tick:g}" for tick in ticks])
    axes.set_xticks([], minor=True)


def instruments_figure(curves: Mapping[str, Mapping[str, Sequence[tuple[int, Mean]]]], title: str) -> Figure:
    """Errors on validation poses (µm) against the number of poses, a line an instrument, a panel a metric.

    Args:
        curves: by what the panel shows, then by instrument: poses and means.
    """
    with matplotlib.rc_context(FIGURE_STYLE):
        figure = Figure(figsize=(11, 5), layout="constrained")
        grid = figure.subplots(1, len(curves), squeeze=False, sharey=True)[0]
        for axes, (words, lines) in zip(grid, curves.items(), strict=True):
            for (name, points), (colour, mark, dash) in zip(lines.items(), SERIES, strict=False):
                x = [poses for poses, _ in points]
                y, low, high = 1e3 * np.array([(mean.mean, mean.lower, mean.upper) for _, mean in points]).T
                axes.errorbar(x, y, [y - low, high - y], color=colour, marker=mark, linestyle=dash, markersize=5.5,
                              linewidth=1.5, capsize=3, label=name)  # fmt: skip
            axes.set(xscale="log", yscale="log", xlabel="number of poses", title=words)
            axes.set_xticks(x, [str(each) for each in x])
            axes.set_xticks([], minor=True)
        grid[0].set_ylabel("error on validation poses, µm")
        low, high = grid[0].get_ylim()
        ticks = [t for t in (1, 2, 3, 5, 7, 10, 20, 30, 50, 70, 100, 200, 300, 500, 1000) if low <= t <= high]
        grid[0].set_yticks(ticks, [str(tick) for tick in ticks])
        grid[0].set_yticks([], minor=True)
        handles, labels = grid[0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside right center", handlelength=3.5)
        figure.suptitle(title)
    return figure


@dataclass(frozen=True)
class Cost:
    """What a change adds to the base case's mean error, mm, with its 95 % interval.

    Attributes:
        told: whether it can be told from nothing, among all changes.
        left_out: campaigns that did not converge here or in the base.
    """

    name: str
    extra_mm: float
    lower_mm: float
    upper_mm: float
    base_mm: float
    told: bool
    left_out: int = 0

    @property
    def ends(self) -> tuple[float, float, float]:
        """Times the base's error, with the interval; that of the base itself, much smaller, is not in it."""
        ratio, lower, upper = (1 + each / self.base_mm for each in (self.extra_mm, self.lower_mm, self.upper_mm))
        return ratio, lower, upper

    @property
    def ratio(self) -> float:
        """Times the base's error."""
        return self.ends[0]

    @property
    def words(self) -> str:
        """The ratio with its interval."""
        return "{:.3g} ({:.3g} to {:.3g})".format(*self.ends)


def costs_figure(costs: Sequence[Cost], base: str, title: str) -> Figure:
    """How many times the base case's error each change makes, the dearest on top, with 95 % intervals."""
    with matplotlib.rc_context(FIGURE_STYLE):
        figure = Figure(figsize=(10, 1.6 + 0.33 * len(costs)), layout="constrained")
        axes = figure.add_subplot()
        axes.set_xscale("log")
        lowest = min(0.9, *(max(cost.ends[1], 0.1) for cost in costs))
        axes.set_xlim(lowest / 1.1, 2.2 * max(cost.ends[2] for cost in costs))
        for row, cost in enumerate(costs):
            ratio, lower, upper = cost.ends
            colour = AXIS if not cost.told else PREDICTED if ratio > 1 else BETTER
            axes.barh(row, ratio - 1, left=1, color=colour, height=0.68)
            axes.hlines(row, max(lower, lowest), upper, color=REFERENCE, linewidth=1.5)
            axes.text(1.05 * max(upper, 1.0), row, cost.words, va="center", fontsize=8.5, color=REFERENCE)
        axes.axvline(1.0, color=REFERENCE, linewidth=1)
        axes.set_yticks(range(len(costs)), [cost.name for cost in costs])
        axes.set_ylim(len(costs) - 0.4, -0.6)
        axes.tick_params(axis="y", length=0)
        axes.grid(visible=False, axis="y")
        _times(axes, *axes.get_xlim())
        axes.set_xlabel(f"mean error on validation poses, times that of the base case ({base})")
        axes.set_title(title)
    return figure
