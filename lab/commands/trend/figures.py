"""The pictures of a trend: errors and parameters over time, with the changes that were found."""

from typing import TYPE_CHECKING, Any

import numpy as np

from lab.commands.trend.result import TrendResult
from lab.core.wording import counted
from lab.render.document import Picture
from lab.render.style import AFTER, BEFORE, GRID, INK, OUTLIER, PREDICTED
from lab.render.svg import figure_picture, log_ticks
from lab.render.units import display_unit

if TYPE_CHECKING:
    from matplotlib.axes import Axes

__all__ = ["errors_picture", "moved_pictures", "parameters_picture"]

_WIDTH = 5.6  # inches
_ROW = 0.2  # inches of a parameter
_REACH = 4.0  # halves of a 95 % interval at which the colours end
_MOST = 6  # parameters with a picture of their own


def errors_picture(result: TrendResult) -> tuple[Picture, ...]:
    """Mean and 95 % of the errors at validation, over time; nothing where fewer than two runs were validated."""
    of = [(each.date, each.run.result.after_mm) for each in result.runs]
    found = [(day, errors["mean"], errors["p95"]) for day, errors in of if errors is not None and errors["mean"] > 0]
    if len(found) < 2:
        return ()
    days, means, ends = zip(*found, strict=True)

    def draw(axes: "Axes") -> None:
        log_ticks(axes, "y", min(means) / 1.6, max(ends) * 1.6)
        axes.plot(days, ends, "s--", color=PREDICTED, markersize=4, linewidth=1, label="95 % of the points")
        axes.plot(days, means, "o-", color=AFTER, markersize=4.5, linewidth=1.3, label="mean")
        _changes(axes, result)
        axes.set(ylabel="validation error, mm (logarithmic)")
        _date_axis(axes)
        axes.legend(loc="best")

    label = f"Validation error of each calibration: mean from {min(means):.3g} to {max(means):.3g} mm"
    return (figure_picture("errors", label, (_WIDTH, 2.6), draw, (0.75, 0.45, 0.2, 0.3)),)


def parameters_picture(result: TrendResult) -> Picture:
    """Every parameter in every calibration: how far it is from the first, in halves of the difference's interval."""
    names, halves = result.estimates[0].names, result.half_widths
    sizes = result.shifts / np.sqrt(halves**2 + halves[0] ** 2)

    def draw(axes: "Axes") -> None:
        from matplotlib.colors import LinearSegmentedColormap

        colours = LinearSegmentedColormap.from_list("shift", [BEFORE, "#ffffff", AFTER])
        grid = axes.pcolormesh(
            np.arange(len(result.runs) + 1), np.arange(len(names) + 1), sizes.T[::-1], cmap=colours, vmin=-_REACH,
            vmax=_REACH, edgecolors=GRID, linewidth=0.5,
        )  # fmt: skip
        for change in result.changes:
            axes.axvline(change.after + 1, color=OUTLIER, linewidth=2)
        axes.set_yticks(np.arange(len(names)) + 0.5, list(names[::-1]))
        step = max(1, -(-len(result.runs) // 8))
        shown = range(0, len(result.runs), step)
        axes.set_xticks([i + 0.5 for i in shown], [result.runs[i].date.isoformat() for i in shown], rotation=30)
        axes.tick_params(length=0)
        axes.grid(visible=False)
        bar = axes.figure.colorbar(grid, ax=axes, pad=0.02, fraction=0.04)
        bar.set_label("difference, in halves of its 95 % interval")

    label = f"Parameters over time, {_said(result)}"
    return figure_picture("parameters", label, (_WIDTH, 1.3 + _ROW * len(names)), draw, (1.2, 0.75, 0.5, 0.15))


def moved_pictures(result: TrendResult) -> tuple[Picture, ...]:
    """Each parameter that changed, over time with its intervals; at most six."""
    names = dict.fromkeys(name for change in result.changes for name in change.named)
    own = [name for name in names if name in result.estimates[0].names][:_MOST]
    return tuple(_over_time(result, name, f"moved-{i + 1}") for i, name in enumerate(own))


def _over_time(result: TrendResult, name: str, called: str) -> Picture:
    at = result.estimates[0].names.index(name)
    factor, unit, _ = display_unit(result.parameters[at])
    factor, unit = (1e3, "mrad") if unit == "°" else (factor, unit)
    shifts, halves = factor * result.shifts[:, at], factor * result.half_widths[:, at]

    def draw(axes: "Axes") -> None:
        days: Any = [each.date for each in result.runs]
        axes.errorbar(days, shifts, halves, fmt="o", color=AFTER, ecolor=AFTER, capsize=3, markersize=4.5)
        axes.axhline(0, color=INK, linewidth=0.8)
        _changes(axes, result)
        axes.set(ylabel=f"{name}, {unit}")
        _date_axis(axes)

    label = f"{name} over time: {shifts[-1]:.3g} {unit} from the first calibration"
    return figure_picture(called, label, (4.5, 2.6), draw, (0.8, 0.45, 0.15, 0.3))


def _changes(axes: "Axes", result: TrendResult) -> None:
    """A line for each change, between the two calibrations."""
    for k, change in enumerate(result.changes):
        before, after = (result.runs[i].date.toordinal() for i in (change.after, change.after + 1))
        at: Any = (before + after) / 2 - 719163  # matplotlib counts days from 1970
        axes.axvline(at, color=OUTLIER, linewidth=1.2, linestyle=":", label="" if k else "change")


def _date_axis(axes: "Axes") -> None:
    from matplotlib import dates

    locator = dates.AutoDateLocator(minticks=3, maxticks=7)  # type: ignore[no-untyped-call]
    axes.xaxis.set_major_locator(locator)
    axes.xaxis.set_major_formatter(dates.ConciseDateFormatter(locator))  # type: ignore[no-untyped-call]


def _said(result: TrendResult) -> str:
    count = len(result.changes)
    return counted(count, "change") if count else "no change"
