"""Pictures that compare: intervals in rows, heat maps with their scale, and axes of dates."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from datetime import date, timedelta

import numpy as np
from numpy.typing import NDArray

from lab.core.se3 import Array
from lab.report.charts.chart import axes_picture, log_ticks, shades
from lab.report.charts.marks import Axes
from lab.report.document import Picture
from lab.report.style import EQUAL_CONTRAST, INK, MUTED, OUTLIER, PREDICTED, luminance

__all__ = [
    "ColourScale", "Intervals", "bars_picture", "date_axis", "heat_map", "interval_chart", "rows_picture",
    "signed_place", "signed_ticks",
]  # fmt: skip

_MONTHS = (1, 2, 3, 6, 12, 24, 60, 120)  # between ticks
_DAYS = (1, 2, 7, 14)
_MOST_DATES = 4  # along an axis: their labels do not touch
_FEW_DAYS = 75  # whose ticks name days
_BESIDE = 0.04  # of the width of a time axis, left free on either side


def date_axis(axes: Axes, first: date, last: date, right: float = _BESIDE) -> None:
    """Set the lower axis to the dates from ``first`` to ``last``, of which a picture's x is the ordinal.

    Args:
        right: share of the width that is left free after the last date.
    """
    span = max((last - first).days, 10)
    ticks, labels = _days(first, span) if span <= _FEW_DAYS else _months(first, last)
    axes.set_xticks([each.toordinal() for each in ticks], labels)
    axes.set(xlim=(first.toordinal() - _BESIDE * span, first.toordinal() + (1 + right) * span))


def _days(first: date, span: int) -> tuple[list[date], list[str]]:
    """Return days of a few weeks, and their labels."""
    step = next((each for each in _DAYS if span / each < _MOST_DATES), span // _MOST_DATES)
    ticks = [first + timedelta(i) for i in range(0, span + 1, step)]
    return ticks, [f"{each:%m-%d}" for each in ticks]


def _months(first: date, last: date) -> tuple[list[date], list[str]]:
    """Return first days of months from one date to another, and their labels."""
    begin, end = (each.year * 12 + each.month - 1 for each in (first, last))
    step = next((each for each in _MONTHS if (end - begin) / each < _MOST_DATES), _MONTHS[-1])
    starts = (date(at // 12, at % 12 + 1, 1) for at in range(-(-begin // step) * step, end + 1, step))
    ticks = [each for each in starts if each >= first]
    return ticks, [f"{each:%Y-%m}" for each in ticks]


def rows_picture(
    name: str, label: str, rows: Sequence[str], draw: Callable[[Axes, Array], None], axis: str, *,
    ends: tuple[float, float] | None = None, step: float = 0.24, width: float = 3.8, above: float = 0.1,
    title: str = "",
) -> Picture:  # fmt: skip
    """A picture with a row for each name, the first on top.

    Args:
        draw: draws into the axes, given the places ``(n,)`` of the rows.
        axis: what is along the rows.
        ends: of a logarithmic axis; None for a linear one.
        step: from a row to the next, inches.
        above: inches above the axes; where there is a title, it takes more.
    """
    at = np.arange(len(rows))[::-1].astype(float)

    def drawn(axes: Axes) -> None:
        if ends is not None:
            log_ticks(axes, "x", *ends)
        axes.set_yticks(at, list(rows))
        axes.set(ylim=(-0.65, len(rows) - 0.35), xlabel=axis, title=title)
        axes.grid(visible=False, axis="y")
        draw(axes, at)

    beside, head = 0.3 + 0.078 * max(map(len, rows), default=0), 0.3 if title else above
    size = (width, 0.5 + head + 0.15 + step * len(rows))
    return axes_picture(name, label, size, drawn, (beside, 0.5, 0.15, head))


def bars_picture(
    name: str, label: str, rows: Sequence[str], values: Sequence[float], texts: Sequence[str], axis: str
) -> Picture:
    """A bar in a row for each name, with its text beside it."""

    def draw(axes: Axes, at: Array) -> None:
        axes.barh(at, values, color=PREDICTED, height=0.6)
        for place, value, text in zip(at, values, texts, strict=True):
            axes.annotate(f" {text}", (value, place), va="center", fontsize=8)
        axes.set(xlim=(0, 1.25 * (max(values) or 1.0)))

    return rows_picture(name, label, rows, draw, axis, step=0.28, width=5.0)


@dataclass(frozen=True)
class Intervals:
    """Numbers with half-widths of their intervals, one in each row of a chart.

    Attributes:
        distinct: which rows differ from zero.
    """

    label: str
    values: Array  # (n,)
    halves: Array  # (n,)
    distinct: NDArray[np.bool_]  # (n,)


_SET_MARKS = "os^vD"


def interval_chart(
    name: str, label: str, rows: Sequence[str], sets: Sequence[Intervals], axis: str, band: float = 0.0
) -> Picture:
    """A row for each name: a dot and an interval of each set, bold and coloured where it differs from zero.

    Args:
        axis: what the numbers are.
        band: where dotted lines are drawn on either side of zero; 0 for none.
    """
    apart = np.linspace(0.26, -0.26, len(sets)) if len(sets) > 1 else np.zeros(1)

    def draw(axes: Axes, at: Array) -> None:
        axes.axvline(0, color=INK, linewidth=1)
        for edge in (-band, band) if band else ():
            axes.axvline(edge, color=MUTED, linewidth=1, linestyle=":")
        for each, offset, mark in zip(sets, apart, _SET_MARKS, strict=False):
            for which, colour, width, size in ((~each.distinct, MUTED, 1.2, 13), (each.distinct, OUTLIER, 2.0, 26)):
                if which.any():
                    ends = each.values[which] - each.halves[which], each.values[which] + each.halves[which]
                    axes.hlines(at[which] + offset, *ends, color=colour, linewidth=width)
                    axes.scatter(each.values[which], at[which] + offset, c=colour, s=size, marker=mark)

    return rows_picture(name, label, rows, draw, axis, step=0.2 if len(sets) < 3 else 0.3)


@dataclass(frozen=True)
class ColourScale:
    """Colours of a heat map.

    Attributes:
        colours: from the share 0 of the scale to 1, evenly spaced.
        ticks: shares of the scale with their labels.
        title: what the colours mean.
    """

    colours: tuple[str, ...]
    ticks: Sequence[tuple[float, str]]
    title: str


def signed_place(sizes: Array, most: float) -> Array:
    """Return the places of sizes ``(...)`` on a colour scale from ``-most`` to ``most``, 0 to 1.

    The scale is linear from -1 to 1 and logarithmic beyond; ``most`` is at least 1.
    """
    reach = np.where(np.abs(sizes) <= 1, np.abs(sizes), 1 + np.log(np.maximum(np.abs(sizes), 1)))
    return np.asarray(0.5 + np.sign(sizes) * reach / (1 + np.log(most)) / 2)


def signed_ticks(most: float) -> list[tuple[float, str]]:
    """Return places and labels of such a scale: 0, and 1 and 3 times powers of ten on either side."""
    ends = [each for power in range(_POWERS) for each in (10.0**power, 3 * 10.0**power) if each <= most]
    sizes = np.array([0.0, *ends, *(-each for each in ends)])
    labels = ["0", *(f"+{each:g}" for each in ends), *(f"−{each:g}" for each in ends)]
    return list(zip(signed_place(sizes, most).tolist(), labels, strict=True))


def heat_map(
    name: str, label: str, rows: Sequence[str], columns: Sequence[str], shares: Array, scale: ColourScale,
    texts: Sequence[Sequence[str]] = (), lines: Sequence[int] = (), height: float = 0.2,
    titles: tuple[str, str] = ("", ""),
) -> Picture:  # fmt: skip
    """A matrix of colours with its scale attached.

    Args:
        shares: ``(rows, columns)`` places on the scale, 0 to 1; NaN for none.
        texts: written in the cells, by row, where they fit.
        lines: columns before which a line is drawn.
        height: of a row, inches.
        titles: what the rows and the columns are.
    """
    m, n = shares.shape
    widest = max(map(len, rows))
    below = (0.8 if max(map(len, columns)) * n > _MOST_ACROSS else 0.3) + 0.22 * bool(titles[1])
    beside = 0.2 + 0.078 * widest + 0.22 * bool(titles[0])
    cell = (_MAP_WIDTH - beside - 0.1) / (1.26 * n)  # inches
    if max((len(text) for line in texts for text in line), default=0) * _LETTER > cell:
        texts = ()  # the colours alone
    bar = (1.04 * n, 1.09 * n)

    def draw(axes: Axes) -> None:
        tints = shades(shares[::-1], scale.colours)
        axes.pcolormesh(np.arange(n + 1.0), np.arange(m + 1.0), tints)
        axes.pcolormesh(bar, np.linspace(0, m, 65), shades(np.linspace(0, 1, 64), scale.colours)[:, None])
        for share, text in scale.ticks:
            axes.hlines([share * m], bar[1], bar[1] + 0.015 * n, color=INK, linewidth=0.8)
            axes.annotate(text, (bar[1] + 0.025 * n, share * m), va="center")
        for at in lines:
            axes.vlines([at], 0, m, color=OUTLIER, linewidth=2)
        _write_in_cells(axes, texts, tints)
        axes.set_yticks(np.arange(m) + 0.5, list(rows[::-1]))
        slanted = max(map(len, columns)) * n > _MOST_ACROSS
        axes.set_xticks(np.arange(n) + 0.5, list(columns), rotation=30 if slanted else 0)
        axes.annotate(scale.title, (1, 1), (0, 5), xycoords="axes fraction", textcoords="offset points", ha="right")
        axes.tick_params(length=0)
        axes.grid(visible=False)
        axes.set(xlim=(0, 1.26 * n), ylim=(0, m), ylabel=titles[0], xlabel=titles[1])

    return axes_picture(name, label, (_MAP_WIDTH, below + 0.4 + height * m), draw, (beside, below, 0.1, 0.35))


def _write_in_cells(axes: Axes, texts: Sequence[Sequence[str]], tints: Array) -> None:
    """Write texts into the cells of a map, the first row on top, dark or light by the cells' colours."""
    for i, line in enumerate(texts):
        row = len(tints) - 1 - i
        for j, text in enumerate(line):
            colour = "#ffffff" if luminance(tints[row, j]) < EQUAL_CONTRAST else "#000000"
            if text:
                axes.annotate(text, (j + 0.5, row + 0.5), ha="center", va="center", color=colour)


_MAP_WIDTH, _LETTER = 4.6, 0.082  # inches
_POWERS = 9  # of ten, of the ticks of a signed scale
_MOST_ACROSS = 36  # letters under a heat map that are not slanted
