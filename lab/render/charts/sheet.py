"""The sheet that a chart is drawn on: what was drawn, where it is, and all of it as SVG."""

from collections.abc import Callable
from typing import Any

import numpy as np

from lab.core.se3 import Array
from lab.render.charts.frame import (
    FONT_SIZE,
    ChartAxis,
    Entry,
    Legend,
    axis_lines,
    below,
    beside,
    grid_lines,
    heading,
)
from lab.render.charts.marks import colour, path, rectangle, shown_number
from lab.render.charts.ticks import Scale

__all__ = ["Coordinates", "Sheet", "arrow", "place"]

_POINTS = 72  # per inch
_SPACE = 3 * FONT_SIZE, 2 * FONT_SIZE  # that a step along x, along y needs for its words
_HATCH = 6.0  # points between the lines of a hatched area
_HEAD = 7.0  # of an arrow, points
_LEGEND = 5.0  # what is drawn later than others: as matplotlib's zorder
Draw = Callable[[Scale, Scale], str]
Coordinates = str | tuple[str, str]


class Sheet:
    """Axes, and what is drawn in them; sizes are points."""

    def __init__(
        self, name: str, size: tuple[float, float], margins: tuple[float, float, float, float], font: str
    ) -> None:
        """Empty axes.

        Args:
            name: begins the ids of what the picture refers to.
            size: width and height, inches.
            margins: left, bottom, right and top of the axes, inches.
            font: families of the words.
        """
        self.name, self.font = name, font
        self.width, self.height = (_POINTS * edge for edge in size)
        self.left, self.bottom, self.right, self.top = (_POINTS * each for each in margins)
        self.x, self.y = ChartAxis(), ChartAxis()
        self.points: list[tuple[Array, Array]] = []  # that a legend should not hide
        self.words: list[Draw] = []  # which may lie beyond the axes
        self.shown_legend: Legend | None = None
        self.title, self.equal, self.hidden = "", "", False
        self._marks: list[tuple[float, Draw]] = []
        self._entries: list[Entry] = []
        self._patterns: dict[str, str] = {}

    def add(
        self, order: float, draw: Draw, label: str = "", sample: Callable[[float, float, float], str] | None = None
    ) -> None:
        """Something to be drawn, over what has a lower order; with a label it has an entry in the legend."""
        self._marks.append((order, draw))
        if label and sample is not None:
            self._entries.append(Entry(label, sample))

    def reach(self, x: Any, y: Any) -> None:
        """Values that are drawn."""
        self.x.reach(x)
        self.y.reach(y)

    def hatched(self, said: str, hatch: str, tint: str, alpha: float) -> str:
        """An area hatched with rising lines; nothing without a hatch."""
        if not hatch:
            return ""
        name = f"{self.name}-hatch{list(self._patterns).index(tint) if tint in self._patterns else len(self._patterns)}"
        self._patterns[tint] = (
            f'<pattern id="{name}" width="{_HATCH}" height="{_HATCH}" patternUnits="userSpaceOnUse">'
            f'<path d="M-1 1L1 -1M0 {_HATCH}L{_HATCH} 0M{_HATCH - 1} {_HATCH + 1}L{_HATCH + 1} {_HATCH - 1}" '
            f'stroke="{tint}"/></pattern>'
        )
        return path(said, fill=f"url(#{name})", alpha=alpha)

    def svg(self) -> str:
        """The elements of the picture, without the one around them."""
        across, up = self.scales()
        ticks = self.x.found_ticks(across, _SPACE[0]), self.y.found_ticks(up, _SPACE[1])
        inside = "".join(draw(across, up) for _, draw in sorted(self._marks, key=lambda each: each[0]))
        area = rectangle((across.start, across.end), (up.start, up.end))
        clip = f"{self.name}-area"
        parts = [
            f'<defs><clipPath id="{clip}"><path d="{area}"/></clipPath>{"".join(self._patterns.values())}</defs>',
            path(rectangle((0, self.width), (0, self.height)), fill="#ffffff"),
            f'<g font-family="{self.font}">',
        ]
        if not self.hidden:
            parts.append(
                grid_lines(
                    across,
                    ticks[0][0][: len(ticks[0][0]) * self.x.grid],
                    up,
                    ticks[1][0][: len(ticks[1][0]) * self.y.grid],
                )
            )
        parts.append(f'<g clip-path="url(#{clip})">{inside}</g>')
        if not self.hidden:
            middle = (self.left + self.width - self.right) / 2, (self.top + self.height - self.bottom) / 2
            parts.append(axis_lines(across, up))
            parts.append(below(self.x, across, ticks[0], up.start, middle[0]))
            parts.append(beside(self.y, up, ticks[1], across.start, middle[1]))
        parts.append(heading(self.title, across, up))
        parts += [draw(across, up) for draw in self.words]
        if self.shown_legend is not None and self._entries:
            parts.append(self.shown_legend.drawn(self._entries, across, up, self._drawn_points(across, up)))
        return "".join([*parts, "</g>"])

    def _drawn_points(self, across: Scale, up: Scale) -> Array:
        if not self.points:
            return np.empty((0, 2))
        x, y = (np.concatenate(each) for each in zip(*self.points, strict=True))
        return np.stack([across(x), up(y)], axis=-1)

    def scales(self) -> tuple[Scale, Scale]:
        """The axes' scales: in the area within the margins, or a smaller one where one scale is for both."""
        left, right = self.left, self.width - self.right
        top, bottom = self.top, self.height - self.bottom
        (low, high), (under, over) = self.x.found_limits(), self.y.found_limits()
        if self.equal:
            wide, tall = (right - left) / abs(high - low), (bottom - top) / abs(over - under)
            per = min(wide, tall)  # points per unit
            more = (right - left) / per - abs(high - low), (bottom - top) / per - abs(over - under)
            if self.equal == "datalim":
                low, high = low - more[0] / 2, high + more[0] / 2
                under, over = under - more[1] / 2, over + more[1] / 2
            else:
                left, right = left + per * more[0] / 2, right - per * more[0] / 2
                top, bottom = top + per * more[1] / 2, bottom - per * more[1] / 2
        x = Scale(low, high, left, right, self.x.logarithmic)
        return x, Scale(under, over, bottom, top, self.y.logarithmic)


def place(at: Any, coordinates: Coordinates, across: Scale, up: Scale) -> tuple[float, float]:
    """A place whose parts are values of the axes (``data``), or shares of them (``axes fraction``)."""
    kinds = (coordinates, coordinates) if isinstance(coordinates, str) else coordinates
    x, y = (
        float(scale(value)) if kind == "data" else scale.start + value * (scale.end - scale.start)
        for scale, value, kind in zip((across, up), at, kinds, strict=True)
    )
    return x, y


def arrow(across: Scale, up: Scale, tail: Any, tip: Any, *, color: str, linewidth: float, arrowstyle: str) -> str:
    """A line from one place to another with a filled head."""
    ends = [np.array(place(at, "data", across, up)) for at in (tail, tip)]
    along = (ends[1] - ends[0]) / max(float(np.linalg.norm(ends[1] - ends[0])), 1e-9)
    base, aside = ends[1] - _HEAD * along, _HEAD / 2 * np.array([-along[1], along[0]])
    tint = colour(color)
    points = [ends[1], base + aside, base - aside]
    head = "M" + "L".join(f"{shown_number(x)} {shown_number(y)}" for x, y in points) + "z"
    shaft = f"M{ends[0][0]:.2f} {ends[0][1]:.2f}L{base[0]:.2f} {base[1]:.2f}"
    return path(shaft, tint, linewidth) + path(head, fill=tint)
