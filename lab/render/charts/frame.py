"""What surrounds the marks of a chart: each axis with its limits, ticks, grid and words, and the legend."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np

from lab.core.se3 import Array
from lab.render.charts.marks import ROUND, colour, line, path, rectangle, shown_number, text_width, words
from lab.render.charts.ticks import Scale, round_numbers, tick_words
from lab.render.style import FIGURE_STYLE, TICK

__all__ = [
    "FONT_SIZE",
    "ChartAxis",
    "Entry",
    "Legend",
    "axis_lines",
    "below",
    "beside",
    "grid_lines",
    "heading",
    "line_sample",
]

FONT_SIZE: Final[float] = FIGURE_STYLE["font.size"]
_TITLE: Final[float] = FIGURE_STYLE["axes.titlesize"]
_EDGE, _GRID, _LABEL = (FIGURE_STYLE[f"{of}color"] for of in ("axes.edge", "grid.", "axes.label"))
_THIN, _TICK, _PAD = 0.8, 3.5, 3.5  # points
_MOST_STEPS = 9
_PLACES: Final = ("upper right", "upper left", "lower left", "lower right", "center right", "center left",
                  "lower center", "upper center", "center")  # fmt: skip
_ACROSS, _UP = {"left": 0.0, "center": 0.5, "right": 1.0}, {"upper": 0.0, "center": 0.5, "lower": 1.0}


@dataclass
class ChartAxis:
    """One axis: its limits, where they are given, what was drawn along it, and how it is labelled."""

    limits: tuple[float, float] | None = None
    logarithmic: bool = False
    ticks: Array | None = None
    tick_words: Sequence[str] | None = None
    turned: float = 0.0  # of the ticks' words, degrees
    most: int | None = None  # steps between ticks
    tick_length: float = _TICK
    label: str = ""
    margin: float = 0.05
    grid: bool = True
    drawn: list[tuple[float, float]] = field(default_factory=list)
    bases: set[float] = field(default_factory=set)  # of bars: no margin beyond them

    def reach(self, values: Any) -> None:
        """Values that are drawn: the limits contain them where none are given."""
        given = np.asarray(values, dtype=float).ravel()
        given = given[np.isfinite(given) & (given > 0) if self.logarithmic else np.isfinite(given)]
        if given.size:
            self.drawn.append((float(given.min()), float(given.max())))

    def found_limits(self) -> tuple[float, float]:
        """The limits that are given, or those of what was drawn with a margin."""
        if self.limits is not None:
            return self.limits
        if not self.drawn:
            return (1.0, 10.0) if self.logarithmic else (0.0, 1.0)
        low, high = min(each[0] for each in self.drawn), max(each[1] for each in self.drawn)
        bare = low in self.bases, high in self.bases
        if self.logarithmic:
            low, high = np.log(low), np.log(high)
        more = self.margin * (high - low) or 0.05 * (1 + abs(high))
        low, high = low - (not bare[0]) * more, high + (not bare[1]) * more
        return (float(np.exp(low)), float(np.exp(high))) if self.logarithmic else (low, high)

    def found_ticks(self, scale: Scale, per_step: float) -> tuple[Array, list[str]]:
        """Where ticks are, values, and their words.

        Args:
            per_step: points that a step needs for its words.
        """
        low, high = sorted((scale.low, scale.high))
        if self.ticks is None:
            space = int(abs(scale.end - scale.start) / per_step)
            at = round_numbers(low, high, self.most or min(max(space, 1), _MOST_STEPS))
        else:
            at = self.ticks
        slack = 1e-9 * (high - low)
        inside = (at >= low - slack) & (at <= high + slack)
        said = list(self.tick_words) if self.tick_words is not None else tick_words(at)
        return at[inside], [word for word, shown in zip(said, inside, strict=True) if shown]


def grid_lines(across: Scale, ticks_x: Array, up: Scale, ticks_y: Array) -> str:
    """Lines through the ticks of each axis, from edge to edge."""
    said = "".join(f"M{at:.2f} {up.start:.2f}V{up.end:.2f}" for at in across(ticks_x).tolist())
    said += "".join(f"M{across.start:.2f} {at:.2f}H{across.end:.2f}" for at in up(ticks_y).tolist())
    return path(said, _GRID, _THIN)


def axis_lines(x: Scale, y: Scale) -> str:
    """The axes at the left and at the bottom."""
    return path(f"M{x.start:.2f} {y.end:.2f}V{y.start:.2f}H{x.end:.2f}", _EDGE, _THIN, more=ROUND)


def below(axis: ChartAxis, scale: Scale, ticks: tuple[Array, list[str]], bottom: float, title_at: float) -> str:
    """The ticks of the lower axis with their words, and what the axis is."""
    at, length = scale(ticks[0]).tolist(), axis.tick_length
    marks = "".join(f"M{place:.2f} {bottom:.2f}v{shown_number(length)}" for place in at) if length else ""
    first, height = bottom + length + _PAD, FONT_SIZE
    parts = [path(marks, TICK, _THIN)]
    for place, word in zip(at, ticks[1], strict=True):
        if not axis.turned:
            parts.append(words(word, place, first, FONT_SIZE, TICK, "center", "top"))
        else:
            parts.append(words(word, place, first, FONT_SIZE, TICK, "right", "center", axis.turned))
            height = max(height, text_width(word, FONT_SIZE) * abs(np.sin(np.deg2rad(axis.turned))))
    if axis.label:
        used = height - 0.5 if any(ticks[1]) else 0.0
        parts.append(words(axis.label, title_at, first + used + 4, FONT_SIZE, _LABEL, "center", "top"))
    return "".join(parts)


def beside(axis: ChartAxis, scale: Scale, ticks: tuple[Array, list[str]], left: float, title_at: float) -> str:
    """The ticks of the left axis with their words, and what the axis is."""
    at, length = scale(ticks[0]).tolist(), axis.tick_length
    marks = "".join(f"M{left:.2f} {place:.2f}h-{shown_number(length)}" for place in at) if length else ""
    end = left - length - _PAD
    parts = [path(marks, TICK, _THIN)]
    parts += [
        words(word, end, place, FONT_SIZE, TICK, "right", "center") for place, word in zip(at, ticks[1], strict=True)
    ]
    if axis.label:
        widest = max((text_width(word, FONT_SIZE) for word in ticks[1]), default=0.0)
        place = max(end - widest - 4 - 0.24 * FONT_SIZE, 0.8 * FONT_SIZE + 1)
        parts.append(words(axis.label, place, title_at, FONT_SIZE, _LABEL, "center", turned=90))
    return "".join(parts)


def heading(title: str, x: Scale, y: Scale) -> str:
    """The words above the axes."""
    return words(title, (x.start + x.end) / 2, y.end - 6, _TITLE, "#000000", "center") if title else ""


@dataclass(frozen=True)
class Entry:
    """A labelled mark.

    Attributes:
        sample: draws it from a place ``(x, y)`` on, as wide as it is told; points.
    """

    label: str
    sample: Callable[[float, float, float], str]


@dataclass(frozen=True)
class Legend:
    """What the labelled marks mean, in columns; places and sizes as matplotlib has them."""

    loc: str = "best"
    ncols: int = 1
    frameon: bool = False
    framealpha: float = 0.8
    fontsize: float = FIGURE_STYLE["legend.fontsize"]
    bbox_to_anchor: tuple[float, float] | None = None

    def drawn(self, entries: Sequence[Entry], x: Scale, y: Scale, points: Array) -> str:
        """The legend; ``best`` is the place that hides the fewest of points ``(n, 2)``."""
        size = self.fontsize
        rows = -(-len(entries) // self.ncols)
        columns = [entries[k * rows : (k + 1) * rows] for k in range(self.ncols)]
        widths = [2.8 * size + max(text_width(each.label, size) for each in of) for of in columns if of]
        pad, row = 0.4 * size, 1.5 * size
        width, height = sum(widths) + 2 * size * (len(widths) - 1) + 2 * pad, row * rows - 0.5 * size + 2 * pad
        left, top = self._corner(width, height, x, y, points)
        parts = []
        if self.frameon:
            box = rectangle((left, left + width), (top, top + height))
            parts.append(path(box, colour("0.8"), _THIN, "#ffffff", self.framealpha, ROUND))
        at = left + pad
        for of, wide in zip(columns, widths, strict=False):
            for k, entry in enumerate(of):
                middle = top + pad + (k + 0.5) * row - 0.25 * size
                parts.append(entry.sample(at, middle, 2 * size))
                parts.append(words(entry.label, at + 2.8 * size, middle, size, "#000000", up="center"))
            at += wide + 2 * size
        return "".join(parts)

    def _corner(self, width: float, height: float, x: Scale, y: Scale, points: Array) -> tuple[float, float]:
        space = 0.5 * self.fontsize

        def corner(place: str) -> tuple[float, float]:
            up, across = place.split() if " " in place else ("center", "center")
            share, rise = _ACROSS[across], _UP[up]
            if self.bbox_to_anchor is not None:
                right, over = self.bbox_to_anchor
                at = x.start + right * (x.end - x.start), y.start + over * (y.end - y.start)
                return at[0] - share * width + space * (1 - 2 * share), at[1] - rise * height + space * (1 - 2 * rise)
            free = (x.end - x.start - width - 2 * space, y.start - y.end - height - 2 * space)
            return x.start + space + share * free[0], y.end + space + rise * free[1]

        if self.loc != "best":
            return corner(self.loc)
        corners = [corner(place) for place in _PLACES]
        hidden = [int(((points >= at) & (points <= np.add(at, (width, height)))).all(axis=1).sum()) for at in corners]
        return corners[int(np.argmin(hidden))]


def line_sample(x: float, y: float, width: float, tint: str, thick: float, more: str) -> str:
    """A line of a legend."""
    return path(line(np.array([x, x + width]), np.array([y, y])), tint, thick, more=more)
