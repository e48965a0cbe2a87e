"""Draw pictures of pages as charts, into SVG that refers to nothing outside.

A chart takes the calls of ``Axes``, with matplotlib's defaults. matplotlib is slow to import, so it is imported where
it draws something.
"""

import re
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, NamedTuple, Self

import numpy as np
from markupsafe import Markup
from numpy.typing import ArrayLike

from lab.core.se3 import Array
from lab.report.charts import marks as svg
from lab.report.charts.marks import Axes, ChartAxis, Entry, Legend, Scale
from lab.report.document import Picture
from lab.report.style import FIGURE_STYLE, rgb

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = [
    "Chart", "Sheet", "axes_picture", "cube", "inline_svg", "log_ticks", "name_points", "save_figure", "shades", "view",
]  # fmt: skip

_POINTS = 72  # per inch
_SPACE = 3 * svg.FONT_SIZE, 2 * svg.FONT_SIZE  # that a step along x, along y needs for its words
_HATCH = 6.0  # points between the lines of a hatched area
_LEGEND = 5.0  # what is drawn later than others: as matplotlib's zorder
_Draw = Callable[[Scale, Scale], str]
_Coordinates = str | tuple[str, str]


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
        self.labels: list[_Draw] = []  # which may lie beyond the axes
        self.shown_legend: Legend | None = None
        self.title, self.equal, self.hidden = "", False, False
        self.named: list[_NamedSeries] = []
        self._insets: list[tuple[tuple[float, float, float, float], Sheet]] = []
        self._marks: list[tuple[float, _Draw]] = []
        self._entries: list[Entry] = []
        self._patterns: dict[str, str] = {}

    def add(
        self, order: float, draw: _Draw, label: str = "", sample: Callable[[float, float, float], str] | None = None
    ) -> None:
        """Something to be drawn, over what has a lower order; with a label it has an entry in the legend."""
        self._marks.append((order, draw))
        if label and sample is not None:
            self._entries.append(Entry(label, sample))

    def reach(self, x: Any, y: Any) -> None:
        """Values that are drawn."""
        self.x.reach(x)
        self.y.reach(y)

    def hatched(self, data: str, hatch: str, tint: str, alpha: float) -> str:
        """An area hatched with rising lines; nothing without a hatch."""
        if not hatch:
            return ""
        name = f"{self.name}-hatch{list(self._patterns).index(tint) if tint in self._patterns else len(self._patterns)}"
        self._patterns[tint] = (
            f'<pattern id="{name}" width="{_HATCH}" height="{_HATCH}" patternUnits="userSpaceOnUse">'
            f'<path d="M-1 1L1 -1M0 {_HATCH}L{_HATCH} 0M{_HATCH - 1} {_HATCH + 1}L{_HATCH + 1} {_HATCH - 1}" '
            f'stroke="{tint}"/></pattern>'
        )
        return svg.path(data, fill=f"url(#{name})", alpha=alpha)

    def svg(self) -> str:
        """The elements of the picture, without the one around them."""
        across, up = self.scales()
        ticks = self.x.found_ticks(across, _SPACE[0]), self.y.found_ticks(up, _SPACE[1])
        inside = "".join(draw(across, up) for _, draw in sorted(self._marks, key=lambda each: each[0]))
        area = svg.rectangle((across.start, across.end), (up.start, up.end))
        clip = f"{self.name}-area"
        parts = [
            f'<defs><clipPath id="{clip}"><path d="{area}"/></clipPath>{"".join(self._patterns.values())}</defs>',
            f'<g font-family="{self.font}">',
        ]
        if not self.hidden:
            parts.append(
                svg.grid_lines(
                    across,
                    ticks[0][0][: len(ticks[0][0]) * self.x.grid],
                    up,
                    ticks[1][0][: len(ticks[1][0]) * self.y.grid],
                )
            )
        parts.append(f'<g clip-path="url(#{clip})">{inside}</g>')
        if not self.hidden:
            middle = (self.left + self.width - self.right) / 2, (self.top + self.height - self.bottom) / 2
            parts.append(svg.axis_lines(across, up))
            parts.append(svg.below(self.x, across, ticks[0], up.start, middle[0]))
            parts.append(svg.beside(self.y, up, ticks[1], across.start, middle[1]))
        parts.append(svg.heading(self.title, across, up))
        parts += [draw(across, up) for draw in self.labels]
        parts += [inset.within(bounds, across, up) for bounds, inset in self._insets]
        if self.shown_legend is not None and self._entries:
            parts.append(self.shown_legend.drawn(self._entries, across, up, self._drawn_points(across, up)))
        return "".join([*parts, "</g>"])

    def inset_axes(self, bounds: tuple[float, float, float, float]) -> Self:
        """Axes beside or in these: left, bottom, width and height as shares of these."""
        name, size = f"{self.name}-inset{len(self._insets)}", (self.width / _POINTS, self.height / _POINTS)
        made = type(self)(name, size, (0.0, 0.0, 0.0, 0.0), self.font)
        self._insets.append((bounds, made))
        return made

    def within(self, bounds: tuple[float, float, float, float], across: Scale, up: Scale) -> str:
        """The elements of these axes in a part of those of the scales."""
        wide, tall = across.end - across.start, up.start - up.end
        self.left, self.bottom = across.start + bounds[0] * wide, self.height - up.start + bounds[1] * tall
        self.right, self.top = self.width - self.left - bounds[2] * wide, self.height - self.bottom - bounds[3] * tall
        return self.svg()

    def named_points(self) -> list[tuple[float, float, str, str, str]]:
        """Places of the points within the axes that have a name, with thing, name and text of each."""
        across, up = self.scales()
        found = []
        for each in self.named:
            at = across(np.asarray(each.x, float)), up(np.asarray(each.y, float))
            inside = (at[0] >= across.start) & (at[0] <= across.end) & (at[1] <= up.start) & (at[1] >= up.end)
            found += [
                (float(at[0][i]), float(at[1][i]), each.thing, each.names[i], each.texts[i])
                for i in np.flatnonzero(inside).tolist()
            ]
        return found

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
            left, right = left + per * more[0] / 2, right - per * more[0] / 2
            top, bottom = top + per * more[1] / 2, bottom - per * more[1] / 2
        x = Scale(low, high, left, right, self.x.logarithmic)
        return x, Scale(under, over, bottom, top, self.y.logarithmic)


class _NamedSeries(NamedTuple):
    thing: str
    x: ArrayLike
    y: ArrayLike
    names: Sequence[str]
    texts: Sequence[str]


def name_points(axes: Axes, thing: str, x: ArrayLike, y: ArrayLike, names: Sequence[str], texts: Sequence[str]) -> None:
    """Name the points ``(n,)`` of a page's chart for those who point at them; on paper nothing changes.

    Args:
        thing: what each is, as ``pose``: the heading of the column of a table in which its name stands.
        names: the name of each.
        texts: what is known of each, as ``0.031 mm``.
    """
    if isinstance(axes, Sheet):
        axes.named.append(_NamedSeries(thing, x, y, names, texts))


def _place(at: Any, coordinates: _Coordinates, across: Scale, up: Scale) -> tuple[float, float]:
    """A place whose parts are values of the axes (``data``), or shares of them (``axes fraction``)."""
    kinds = (coordinates, coordinates) if isinstance(coordinates, str) else coordinates
    x, y = (
        float(scale(value)) if kind == "data" else scale.start + value * (scale.end - scale.start)
        for scale, value, kind in zip((across, up), at, kinds, strict=True)
    )
    return x, y


_MARKS = ".os^vDP|x"
_FIRST = "#1f77b4"  # where no colour is given
_WHITE = "#ffffff"  # that of the paper, except on a dark page


class Chart(Sheet):
    """Chart of one set of axes; ``svg`` returns it as SVG."""

    def plot(
        self, x: ArrayLike, y: ArrayLike, fmt: str = "", *, color: str = _FIRST, linewidth: float = 1.5,
        linestyle: Any = None, marker: str = "", markersize: float = 6.0, alpha: float = 1.0, label: str = "",
        zorder: float = 2.0, drawstyle: str = "default", solid_capstyle: str = "round",
    ) -> None:  # fmt: skip
        """Lines and marks through points ``(n,)``; NaN parts a line."""
        dash, mark = _dash_and_mark(fmt, linestyle, marker)
        tint, xs, ys = svg.colour(color), np.atleast_1d(np.asarray(x, float)), np.atleast_1d(np.asarray(y, float))
        if drawstyle == "steps-post":
            xs, ys = np.repeat(xs, 2)[1:], np.repeat(ys, 2)[:-1]
        ends = svg.dashes(dash, linewidth) or svg.ROUND
        self.reach(xs, ys)
        self.points.append((xs, ys) if mark or len(xs) < 2 else _between(xs, ys))

        def draw(across: Scale, up: Scale) -> str:
            at = across(xs), up(ys)
            drawn = svg.path(svg.line(*at), tint, linewidth, alpha=alpha, more=ends) if dash else ""
            return drawn + (svg.marks(*at, mark, markersize, [tint], alpha=alpha) if mark else "")

        def sample(left: float, middle: float, width: float) -> str:
            drawn = svg.line_sample(left, middle, width, tint, linewidth, ends) if dash else ""
            place = np.array([left + width / 2]), np.array([middle])
            return drawn + (svg.marks(*place, mark, markersize, [tint], alpha=alpha) if mark else "")

        self.add(zorder, draw, label, sample)

    def scatter(
        self, x: ArrayLike, y: ArrayLike, s: float = 36.0, c: Any = None, *, color: Any = None, marker: str = "o",
        edgecolors: str = "", linewidths: float = 0.0, label: str = "", zorder: float = 1.0,
    ) -> None:  # fmt: skip
        """A mark at each point ``(n,)``; ``c`` is one colour or one for each, ``s`` the square of the size."""
        given = c if c is not None else color if color is not None else _FIRST
        tints = [svg.colour(given)] if isinstance(given, str) else [svg.colour(each) for each in given]
        xs, ys, size = np.asarray(x, float), np.asarray(y, float), float(np.sqrt(s))
        if edgecolors and svg.colour(edgecolors) == _WHITE:  # which parts them from each other, on any paper
            edgecolors, tints = _kept(_WHITE), list(map(_kept, tints))
        self.reach(xs, ys)
        self.points.append((xs, ys))

        def at(places: tuple[Array, Array], shades: Sequence[str]) -> str:
            return svg.marks(*places, marker, size, shades, edgecolors, linewidths)

        def sample(left: float, middle: float, width: float) -> str:
            return at((np.array([left + width / 2]), np.array([middle])), tints[:1])

        self.add(zorder, lambda across, up: at((across(xs), up(ys)), tints), label, sample)

    def stairs(
        self, values: ArrayLike, edges: ArrayLike, *, fill: bool = False, color: str = _FIRST, alpha: float = 1.0,
        hatch: str = "", linewidth: float = 1.5,
    ) -> None:  # fmt: skip
        """A histogram of values ``(n,)`` between edges ``(n+1,)``, as an area or as its outline."""
        heights, ends = np.asarray(values, float), np.asarray(edges, float)
        xs, ys = np.repeat(ends, 2), np.concatenate([[0.0], np.repeat(heights, 2), [0.0]])
        self.reach(xs, ys)
        self.y.bases.add(0.0)
        tint = svg.colour(color)

        def draw(across: Scale, up: Scale) -> str:
            data = svg.line(across(xs), up(ys))
            if not fill:
                return svg.path(data, tint, linewidth)
            return svg.path(data, fill=tint, alpha=alpha) + self.hatched(data, hatch, tint, alpha)

        self.add(1.0 if fill else 2.0, draw)

    def barh(self, y: ArrayLike, width: ArrayLike, *, height: float = 0.8, color: str = _FIRST) -> None:
        """Bars that lie, at places ``(n,)``, from zero on as long as they are wide."""
        at, lengths = (np.atleast_1d(np.asarray(values, float)) for values in (y, width))
        self.reach(np.append(lengths, 0.0), np.concatenate([at - height / 2, at + height / 2]))
        self.x.bases.add(0.0)
        tint = svg.colour(color)

        def draw(across: Scale, up: Scale) -> str:
            edges = zip(up(at - height / 2).tolist(), up(at + height / 2).tolist(), strict=True)
            ends = zip(across(lengths).tolist(), edges, strict=True)
            start = float(across(0.0))
            return "".join(svg.path(svg.rectangle((start, end), both), fill=tint) for end, both in ends)

        self.add(1.0, draw)

    def hlines(
        self, y: ArrayLike, xmin: ArrayLike, xmax: ArrayLike, *, color: Any = _FIRST,
        linewidth: float = 1.5, alpha: float = 1.0,
    ) -> None:  # fmt: skip
        """Horizontal lines."""
        at, low, high = np.broadcast_arrays(*(np.asarray(v, float) for v in (y, xmin, xmax)))
        ends = np.stack([low, high], axis=-1), np.stack([at, at], axis=-1)
        self._segments(*ends, color, linewidth, alpha)

    def vlines(
        self, x: ArrayLike, ymin: ArrayLike, ymax: ArrayLike, *, color: Any = _FIRST,
        linewidth: float = 1.5, alpha: float = 1.0,
    ) -> None:  # fmt: skip
        """Vertical lines."""
        at, low, high = np.broadcast_arrays(*(np.asarray(v, float) for v in (x, ymin, ymax)))
        ends = np.stack([at, at], axis=-1), np.stack([low, high], axis=-1)
        self._segments(*ends, color, linewidth, alpha)

    def axhline(
        self, y: float, *, color: str = _FIRST, linewidth: float = 1.5, linestyle: Any = "-", zorder: float = 2.0
    ) -> None:
        """A horizontal line from edge to edge."""
        self.y.reach(y)
        self._edge_to_edge(lambda across, up: ([across.start, across.end], [float(up(y))] * 2),
                           color, linewidth, linestyle, zorder)  # fmt: skip

    def axvline(
        self, x: float, *, color: str = _FIRST, linewidth: float = 1.5, linestyle: Any = "-", zorder: float = 2.0
    ) -> None:
        """A vertical line from edge to edge."""
        self.x.reach(x)
        self._edge_to_edge(lambda across, up: ([float(across(x))] * 2, [up.start, up.end]),
                           color, linewidth, linestyle, zorder)  # fmt: skip

    def axhspan(
        self, ymin: float, ymax: float, *, color: str = _FIRST, alpha: float = 1.0, linewidth: float = 0.0
    ) -> None:
        """A horizontal band from edge to edge."""
        self.y.reach([ymin, ymax])
        tint = svg.colour(color)

        def draw(across: Scale, up: Scale) -> str:
            box = svg.rectangle((across.start, across.end), (float(up(ymin)), float(up(ymax))))
            return svg.path(box, tint, linewidth, tint, alpha)

        self.add(1.0, draw)

    def fill_between(
        self, x: ArrayLike, y1: ArrayLike, y2: ArrayLike, *, color: str = _FIRST, alpha: float = 1.0,
        linewidth: float = 0.0,
    ) -> None:  # fmt: skip
        """The area between two curves."""
        low, high, tint = np.asarray(y1, float), np.asarray(y2, float), svg.colour(color)
        xs, ys = np.concatenate([np.asarray(x, float), np.asarray(x, float)[::-1]]), np.concatenate([low, high[::-1]])
        self.reach(xs, ys)
        self.add(1.0, lambda across, up: svg.path(svg.line(across(xs), up(ys)) + "z", tint, linewidth, tint, alpha))

    def quiver(
        self, x: ArrayLike, y: ArrayLike, u: ArrayLike, v: ArrayLike, *, color: str = _FIRST, alpha: float = 1.0,
        width: float = 0.005, angles: str = "xy", scale_units: str = "xy", scale: float = 1.0, zorder: float = 2.0,
    ) -> None:  # fmt: skip
        """Arrows at points ``(n,)``; ``u`` and ``v`` are by the axes' scales, ``width`` is a share of their width."""
        xs, ys, right, over = (np.asarray(each, float).ravel() for each in (x, y, u, v))
        tint = svg.colour(color)
        self.reach(xs, ys)
        self.points.append((xs, ys))

        def draw(across: Scale, up: Scale) -> str:
            tails = np.stack([across(xs), up(ys)], axis=-1)
            tips = np.stack([across(xs + right / scale), up(ys + over / scale)], axis=-1)
            along = tips - tails
            length = np.linalg.norm(along, axis=1, keepdims=True)
            thick = max(width * (across.end - across.start), 0.6)
            head = np.minimum(5 * thick, 0.6 * length) * along / np.maximum(length, 1e-9)
            aside = 0.45 * head[:, ::-1] * [-1, 1]
            known = np.isfinite(tips).all(axis=1) & np.isfinite(tails).all(axis=1)
            steps = np.concatenate([tails, along, aside - head, head - aside, -aside - head], axis=1)[known]
            text = "M{:.0f} {:.0f}l{:.1f} {:.1f}m{:.1f} {:.1f}l{:.1f} {:.1f} {:.1f} {:.1f}"
            data = "".join(text.format(*each) for each in steps.tolist())
            return svg.path(data, tint, thick, alpha=alpha, more=svg.ROUND)

        self.add(zorder, draw)

    def pcolormesh(self, x: ArrayLike, y: ArrayLike, colours: ArrayLike) -> None:
        """A matrix of colours ``(m, n, 3)`` from 0 to 1 between edges ``(n+1,)`` and ``(m+1,)``."""
        self.reach(x, y)
        self._cells(np.asarray(x, float), np.asarray(y, float), np.asarray(colours, float))

    def annotate(
        self, text: str, xy: Any, xytext: Any = None, *, xycoords: _Coordinates = "data",
        textcoords: Literal["offset points"] | None = None, color: str = "#000000", fontsize: float = svg.FONT_SIZE,
        fontweight: str = "", ha: str = "left", va: str = "baseline", bbox: Any = None,
        zorder: float = 3.0,
    ) -> None:  # fmt: skip
        """Words at a point, or so many points from it, on an area of their own with ``bbox``."""
        tint = svg.colour(color)
        right, over = (0.0, 0.0) if textcoords is None else xytext
        behind_colour = _WHITE if bbox is None else svg.colour(bbox["facecolor"])
        if behind_colour != _WHITE:  # words on a coloured area are not read on the paper
            tint, behind_colour = _kept(tint), _kept(behind_colour)

        def draw(across: Scale, up: Scale) -> str:
            x, y = _place(xy, xycoords, across, up)
            at = x + right, y - over
            behind = "" if bbox is None else svg.backdrop(text, *at, fontsize, ha, va, behind_colour, bbox["boxstyle"])
            return behind + svg.words(text, *at, fontsize, tint, ha, va, bold=fontweight == "bold")

        self.labels.append(draw)

    def legend(self, **options: Any) -> None:
        """Show a legend of the labelled marks; the options are those of ``Legend``."""
        self.shown_legend = Legend(**options)

    def set(self, **values: Any) -> None:
        """Limits, ticks, scales, labels and the title, by matplotlib's names."""
        for name, value in values.items():
            if name == "title":
                self._set_title(value)
                continue
            axis, what = {"x": self.x, "y": self.y}[name[0]], name[1:]
            if what == "lim":
                axis.limits = (float(value[0]), float(value[1]))
            elif what == "scale":
                axis.logarithmic = value == "log"
            elif what == "ticks":
                self._set_ticks(axis, value, None, 0.0)
            elif what == "label":
                axis.label = value
            else:
                raise ValueError(f"axes have no {name!r}")

    def set_xticks(
        self, ticks: ArrayLike, labels: Sequence[str] | None = None, *, rotation: float = 0.0, minor: bool = False
    ) -> None:
        """Ticks and their words along x; there are no minor ones."""
        if not minor:
            self._set_ticks(self.x, ticks, labels, rotation)

    def set_yticks(self, ticks: ArrayLike, labels: Sequence[str] | None = None, *, minor: bool = False) -> None:
        """Ticks and their words along y; there are no minor ones."""
        if not minor:
            self._set_ticks(self.y, ticks, labels, 0.0)

    def tick_params(self, *, axis: str = "both", length: float = 3.5) -> None:
        """Set the length of ticks, points."""
        for each in self._axes(axis):
            each.tick_length = length

    def locator_params(self, *, nbins: int, axis: str = "both") -> None:
        """Set the largest number of steps between ticks."""
        for each in self._axes(axis):
            each.most = nbins

    def grid(self, *, visible: bool, axis: str = "both") -> None:
        """Set whether lines run through the ticks."""
        for each in self._axes(axis):
            each.grid = visible

    def margins(self, *, x: float | None = None, y: float | None = None) -> None:
        """Set the margins of axes beyond what is drawn, as a share of it."""
        for axis, share in ((self.x, x), (self.y, y)):
            axis.margin = axis.margin if share is None else share

    def set_aspect(self, aspect: Literal["equal"]) -> None:
        """Set one scale for both axes: the axes become narrower."""
        self.equal = True

    def axis(self, which: Literal["off"]) -> None:
        """Hides the axes."""
        self.hidden = which == "off"

    def _set_title(self, title: str) -> None:
        """Break a title that the picture would cut; each line more makes the picture higher."""
        middle = (self.left + self.width - self.right) / 2
        lines = svg.broken(title, 2 * min(middle, self.width - middle))
        more = svg.LINE * (lines.count("\n") - self.title.count("\n"))
        self.height, self.top, self.title = self.height + more, self.top + more, lines

    def _axes(self, which: str) -> tuple[ChartAxis, ...]:
        return {"x": (self.x,), "y": (self.y,), "both": (self.x, self.y)}[which]

    def _set_ticks(self, axis: ChartAxis, ticks: ArrayLike, labels: Sequence[str] | None, turned: float) -> None:
        axis.ticks, axis.tick_labels, axis.turned = np.asarray(ticks, float), labels, turned
        axis.reach(axis.ticks)

    def _segments(self, x: Array, y: Array, colours: Any, linewidth: float, alpha: float) -> None:
        """Lines between two points each ``(n, 2)``, of one colour or one each."""
        tints = [svg.colour(colours)] if isinstance(colours, str) else [svg.colour(each) for each in colours]
        self.reach(x, y)

        def draw(across: Scale, up: Scale) -> str:
            drawn, gap = "", np.full((len(x), 1), np.nan)
            at = (np.concatenate([places, gap], axis=1) for places in (across(x), up(y)))
            ends = tuple(at)
            for tint in dict.fromkeys(tints):
                of = [len(tints) == 1 or each == tint for each in (tints if len(tints) > 1 else tints * len(x))]
                drawn += svg.path(svg.line(ends[0][of].ravel(), ends[1][of].ravel()), tint, linewidth, alpha=alpha)
            return drawn

        self.add(2.0, draw)

    def _edge_to_edge(self, ends: Any, color: str, linewidth: float, linestyle: Any, zorder: float) -> None:
        tint, more = svg.colour(color), svg.dashes(linestyle, linewidth)

        def draw(across: Scale, up: Scale) -> str:
            x, y = ends(across, up)
            return svg.path(svg.line(np.array(x), np.array(y)), tint, linewidth, more=more)

        self.add(zorder, draw)

    def _cells(self, x: Array, y: Array, colours: Array) -> None:
        self.add(0.0, lambda across, up: svg.cells(across(x), up(y), colours))


def _kept(colour: str) -> str:
    """A colour that a dark page keeps: ``inline_svg`` makes variables of the others, ``#rrggbb``."""
    return "rgb({},{},{})".format(*rgb(colour)) if colour.startswith("#") else colour


def _parsed(style: str) -> tuple[str | None, str]:
    """The dashes and the mark of matplotlib's short form, as ``"o-"``."""
    mark = "" if style in ("-", "--", "-.", ":") else style[:1]
    if mark and mark not in _MARKS:
        raise ValueError(f"no marks and lines {style!r}; marks are {' '.join(_MARKS)}, then - -- -. or :")
    return style[len(mark) :] or None, mark


def _dash_and_mark(fmt: str, linestyle: Any, marker: str) -> tuple[Any, str]:
    """Return the dashes and the mark of a line: those that are given, else those of the short form; "" for none."""
    dash, mark = _parsed(fmt)
    dash, mark = (linestyle if linestyle is not None else dash), marker or mark
    return ("" if mark else "-") if dash is None else dash, mark


def _between(x: Array, y: Array) -> tuple[Array, Array]:
    """Points along a line, also between those that it is drawn through."""
    at = np.linspace(0, len(x) - 1, min(8 * len(x), 2000))
    rows = np.arange(len(x))
    return np.interp(at, rows, x), np.interp(at, rows, y)


_PX_PER_INCH = 96
_FONT = "DejaVu Sans, Arial, sans-serif"
_SEEN_FROM = {(0, 1): "from above", (0, 2): "from the side"}
_MARGINS = (0.7, 0.5, 0.15, 0.3)
_DOTS_PER_INCH = 130  # of a PNG
_SMALL_PX, _HALF_PX = 240, 480  # the widest of which a phone has room for one, a sheet of paper for two


def axes_picture(
    name: str,
    label: str,
    size: tuple[float, float],
    draw: Callable[[Axes], None],
    margins: tuple[float, float, float, float] = _MARGINS,
) -> Picture:
    """A picture of one set of axes, which is a chart on a page.

    Args:
        name: of the picture in its document; no other may have it.
        label: what it shows, for those who do not see it.
        size: width and height, inches.
        draw: draws into the axes.
        margins: left, bottom, right and top of the axes, inches.
    """

    def chart() -> Chart:
        made = Chart(name, size, margins, _FONT)
        draw(made)
        return made

    def figure() -> "Figure":
        import matplotlib
        from matplotlib.figure import Figure

        (width, height), (left, bottom, right, top) = size, margins
        with matplotlib.rc_context(FIGURE_STYLE):
            made = Figure(figsize=size)
            area = (left / width, bottom / height, 1 - (left + right) / width, 1 - (bottom + top) / height)
            draw(made.add_axes(area))
        return made

    return Picture(name, label, figure, chart)


_PAINT = re.compile(r'((?:fill|stroke|stop-color)(?:="|: ?))#([0-9a-f]{6})\b')
_LETTERS = re.compile(r'font-size(?:="|: ?)([\d.]+)|font: (?:bold )?([\d.]+)px')
_LEAST_PX = 10.0  # the height of letters on a page, however narrow it is


def inline_svg(picture: Picture) -> Markup:
    """A picture as a part of a page: without prologue and metadata, its ids its own, with a title.

    Its colours are variables, ``--c-rrggbb``, to which the page gives a light and a dark value. It is not shown so
    small that a letter is less than 10 px high.
    """
    chart = picture.chart()
    drawn = chart.svg() + "</svg>"
    width, height, named = chart.width, chart.height, chart.named_points()
    smallest = min((float(a or b) for a, b in _LETTERS.findall(drawn)), default=_LEAST_PX) * _PX_PER_INCH / _POINTS
    narrowest = int(width * _PX_PER_INCH / _POINTS * _LEAST_PX / smallest) + 1
    pixels = max(round(width * _PX_PER_INCH / _POINTS), narrowest)
    form = Markup(
        '<svg viewBox="0 0 {:g} {:g}" class="{}" role="img" aria-label="{}" style="width: {}px; min-width: {}px"{}>'
        "<title>{}</title>{}"
    )
    kind = "small" if pixels <= _SMALL_PX else "half" if pixels <= _HALF_PX else "wide"
    points = "\n".join("\t".join((f"{x:.0f}", f"{y:.0f}", *map(_in_one_line, rest))) for x, y, *rest in named)
    data = Markup(' data-points="{}"').format(points) if points else ""
    drawn = _PAINT.sub(r"\1var(--c-\2)", drawn)
    # all escape what they are given
    return form.format(width, height, kind, picture.label, pixels, narrowest, data, picture.label, Markup(drawn))


def _in_one_line(text: str) -> str:
    return " ".join(text.split())


def save_figure(folder: Path, name: str, figure: "Figure") -> None:
    """Write a figure as PNG and SVG, the same bytes for the same figure."""
    import matplotlib

    with matplotlib.rc_context(FIGURE_STYLE):
        figure.savefig(folder / f"{name}.png", dpi=_DOTS_PER_INCH)
        figure.set_layout_engine("none")  # what the first one found, which takes as long as drawing
        figure.savefig(folder / f"{name}.svg", metadata={"Date": None})


def log_ticks(axes: Axes, which: Literal["x", "y"], low: float, high: float) -> None:
    """A logarithmic axis from ``low`` to ``high``, with plain numbers at up to nine powers of ten, or round ones."""
    axes.set(**{f"{which}scale": "log", f"{which}lim": (low, high)})
    first, last = int(np.ceil(np.log10(low) - 1e-9)), int(np.floor(np.log10(high) + 1e-9))
    step = max(1, -(-(last - first) // 8))
    ticks = [10.0**power for power in range(first, last + 1, step)]
    if len(ticks) < 3:
        ticks = [m * 10.0**power for power in range(first - 1, last + 1) for m in (1, 2, 5)]
        ticks = [tick for tick in ticks if low <= tick <= high]
    if len(ticks) < 2:
        ticks = svg.round_numbers(low, high, 4).tolist()
    set_ticks = axes.set_xticks if which == "x" else axes.set_yticks
    set_ticks(ticks, [f"{tick:g}".replace("-", "−") for tick in ticks])
    set_ticks([], minor=True)


def shades(values: Array, colours: Sequence[str]) -> Array:
    """Colours ``(..., 3)`` from 0 to 1 of values ``(...)`` from 0 (the first) to 1 (the last); NaN has none.

    Args:
        colours: evenly spaced along the values, as ``#rrggbb``.
    """
    knots = np.array([rgb(each) for each in colours]) / 255
    at = np.linspace(0, 1, len(knots))
    return np.stack([np.interp(values, at, knots[:, part]) for part in range(3)], axis=-1)


def cube(points: Sequence[Array], share: float = 0.06) -> tuple[Array, float]:
    """The middle ``(3,)`` and half the edge of the cube around arrays of points ``(…, 3)``, NaN left out."""
    every = np.concatenate([np.reshape(each, (-1, 3)) for each in points])
    low, high = np.nanmin(every, axis=0), np.nanmax(every, axis=0)
    return (low + high) / 2, max(float((high - low).max()) * (0.5 + share), 1e-6)


def view(axes: Axes, plane: tuple[int, int], middle: Array, half: float, frame: str, shown: str = "") -> None:
    """Equal axes in mm for a view on a plane of the frame (0 is x, 2 is z).

    Args:
        shown: what is seen, for the title.
    """
    i, j = plane
    title = f"{_SEEN_FROM[plane]}, {shown}" if shown else _SEEN_FROM[plane]
    axes.set(xlim=(middle[i] - half, middle[i] + half), ylim=(middle[j] - half, middle[j] + half))
    axes.set(xlabel=f"{'xyz'[i]} of the {frame}, mm", ylabel=f"{'xyz'[j]}, mm", title=title)
    axes.set_aspect("equal")
    axes.locator_params(axis="x", nbins=4)
    axes.locator_params(axis="y", nbins=6)
