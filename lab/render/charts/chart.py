"""One set of axes with what is drawn in it, as SVG. It takes the calls of ``Axes``, with matplotlib's defaults."""

from collections.abc import Sequence
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike

from lab.core.se3 import Array
from lab.render.charts.frame import FONT_SIZE, ChartAxis, Legend, line_sample
from lab.render.charts.marks import ROUND, backdrop, cells, colour, dashes, line, marks, path, rectangle, words
from lab.render.charts.sheet import Coordinates, Sheet, arrow, place
from lab.render.charts.ticks import Scale

__all__ = ["Chart"]

_MARKS = ".os^vDP|x"
_FIRST = "#1f77b4"  # where no colour is given


class Chart(Sheet):
    """One set of axes; ``svg`` says it as SVG."""

    def plot(
        self, x: ArrayLike, y: ArrayLike, fmt: str = "", *, color: str = _FIRST, linewidth: float = 1.5,
        linestyle: Any = None, marker: str = "", markersize: float = 6.0, alpha: float = 1.0, label: str = "",
        zorder: float = 2.0, drawstyle: str = "default", solid_capstyle: str = "round", rasterized: bool = False,
    ) -> None:  # fmt: skip
        """Lines and marks through points ``(n,)``; NaN parts a line."""
        dash, mark = _parsed(fmt)
        dash, mark = (linestyle if linestyle is not None else dash), marker or mark
        if dash is None:
            dash = "" if mark else "-"
        tint, xs, ys = colour(color), np.atleast_1d(np.asarray(x, float)), np.atleast_1d(np.asarray(y, float))
        if drawstyle == "steps-post":
            xs, ys = np.repeat(xs, 2)[1:], np.repeat(ys, 2)[:-1]
        ends = dashes(dash, linewidth) or ROUND
        self.reach(xs, ys)
        self.points.append((xs, ys) if mark or len(xs) < 2 else _between(xs, ys))

        def draw(across: Scale, up: Scale) -> str:
            at = across(xs), up(ys)
            drawn = path(line(*at), tint, linewidth, alpha=alpha, more=ends) if dash else ""
            return drawn + (marks(*at, mark, markersize, [tint], alpha=alpha) if mark else "")

        def sample(left: float, middle: float, width: float) -> str:
            drawn = line_sample(left, middle, width, tint, linewidth, ends) if dash else ""
            place = np.array([left + width / 2]), np.array([middle])
            return drawn + (marks(*place, mark, markersize, [tint], alpha=alpha) if mark else "")

        self.add(zorder, draw, label, sample)

    def scatter(
        self, x: ArrayLike, y: ArrayLike, s: float = 36.0, c: Any = None, *, color: Any = None, marker: str = "o",
        edgecolors: str = "", linewidths: float = 0.0, label: str = "", zorder: float = 1.0, rasterized: bool = False,
    ) -> None:  # fmt: skip
        """A mark at each point ``(n,)``; ``c`` is one colour or one for each, ``s`` the square of the size."""
        given = c if c is not None else color if color is not None else _FIRST
        tints = [colour(given)] if isinstance(given, str) else [colour(each) for each in given]
        xs, ys, size = np.asarray(x, float), np.asarray(y, float), float(np.sqrt(s))
        self.reach(xs, ys)
        self.points.append((xs, ys))

        def at(places: tuple[Array, Array], shades: Sequence[str]) -> str:
            return marks(*places, marker, size, shades, edgecolors, linewidths)

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
        tint = colour(color)

        def draw(across: Scale, up: Scale) -> str:
            said = line(across(xs), up(ys))
            if not fill:
                return path(said, tint, linewidth)
            return path(said, fill=tint, alpha=alpha) + self.hatched(said, hatch, tint, alpha)

        self.add(1.0 if fill else 2.0, draw)

    def barh(
        self, y: ArrayLike, width: ArrayLike, *, height: float = 0.8, left: ArrayLike = 0.0, color: Any = _FIRST,
        alpha: float = 1.0, hatch: str = "",
    ) -> None:  # fmt: skip
        """Bars that lie, at places ``(n,)``, from ``left`` on as long as they are wide."""
        at, starts, lengths = np.broadcast_arrays(*(np.atleast_1d(np.asarray(v, float)) for v in (y, left, width)))
        tints = [colour(color)] * len(at) if isinstance(color, str) else [colour(each) for each in color]
        self.reach(np.concatenate([starts, starts + lengths]), np.concatenate([at - height / 2, at + height / 2]))
        self.x.bases |= set(starts.tolist())

        def draw(across: Scale, up: Scale) -> str:
            drawn = ""
            for middle, start, length, tint in zip(at, starts, lengths, tints, strict=True):
                ends = (
                    across(np.array([start, start + length])),
                    up(np.array([middle - height / 2, middle + height / 2])),
                )
                box = rectangle(tuple(ends[0].tolist()), tuple(ends[1].tolist()))
                drawn += path(box, fill=tint, alpha=alpha) + self.hatched(box, hatch, "#000000", alpha)
            return drawn

        self.add(1.0, draw)

    def hlines(
        self, y: ArrayLike, xmin: ArrayLike, xmax: ArrayLike, *, colors: Any = _FIRST, color: Any = None,
        linewidth: float = 1.5, alpha: float = 1.0,
    ) -> None:  # fmt: skip
        """Horizontal lines."""
        at, low, high = np.broadcast_arrays(*(np.asarray(v, float) for v in (y, xmin, xmax)))
        ends = np.stack([low, high], axis=-1), np.stack([at, at], axis=-1)
        self._segments(*ends, colors if color is None else color, linewidth, alpha)

    def vlines(
        self, x: ArrayLike, ymin: ArrayLike, ymax: ArrayLike, *, colors: Any = _FIRST, color: Any = None,
        linewidth: float = 1.5, alpha: float = 1.0,
    ) -> None:  # fmt: skip
        """Vertical lines."""
        at, low, high = np.broadcast_arrays(*(np.asarray(v, float) for v in (x, ymin, ymax)))
        ends = np.stack([at, at], axis=-1), np.stack([low, high], axis=-1)
        self._segments(*ends, colors if color is None else color, linewidth, alpha)

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
        tint = colour(color)

        def draw(across: Scale, up: Scale) -> str:
            box = rectangle((across.start, across.end), (float(up(ymin)), float(up(ymax))))
            return path(box, tint, linewidth, tint, alpha)

        self.add(1.0, draw)

    def fill_between(
        self, x: ArrayLike, y1: ArrayLike, y2: ArrayLike, *, color: str = _FIRST, alpha: float = 1.0,
        linewidth: float = 0.0,
    ) -> None:  # fmt: skip
        """The area between two curves."""
        low, high, tint = np.asarray(y1, float), np.asarray(y2, float), colour(color)
        xs, ys = np.concatenate([np.asarray(x, float), np.asarray(x, float)[::-1]]), np.concatenate([low, high[::-1]])
        self.reach(xs, ys)
        self.add(1.0, lambda across, up: path(line(across(xs), up(ys)) + "z", tint, linewidth, tint, alpha))

    def imshow(self, colours: ArrayLike) -> None:
        """A matrix of colours ``(m, n, 3)`` from 0 to 1, its first row on top, cells as wide as high."""
        given = np.asarray(colours, float)
        self.equal = "box"
        self.x.limits, self.y.limits = (-0.5, given.shape[1] - 0.5), (given.shape[0] - 0.5, -0.5)
        self._cells(np.arange(given.shape[1] + 1) - 0.5, np.arange(given.shape[0] + 1) - 0.5, given)

    def pcolormesh(self, x: ArrayLike, y: ArrayLike, colours: ArrayLike, *, rasterized: bool = False) -> None:
        """A matrix of colours ``(m, n, 3)`` from 0 to 1 between edges ``(n+1,)`` and ``(m+1,)``."""
        self.reach(x, y)
        self._cells(np.asarray(x, float), np.asarray(y, float), np.asarray(colours, float))

    def annotate(
        self, text: str, xy: Any, xytext: Any = None, *, xycoords: Coordinates = "data",
        textcoords: Literal["offset points"] | None = None, color: str = "#000000", fontsize: float = FONT_SIZE,
        fontweight: str = "", ha: str = "left", va: str = "baseline", arrowprops: Any = None, bbox: Any = None,
        zorder: float = 3.0,
    ) -> None:  # fmt: skip
        """Words at a point, or so many points from it, on an area of their own with ``bbox``.

        With ``arrowprops`` an arrow from ``xytext`` to the point.
        """
        tint = colour(color)
        if arrowprops is not None:
            self.add(zorder, lambda across, up: arrow(across, up, xytext, xy, **arrowprops))
            return
        right, over = (0.0, 0.0) if textcoords is None else xytext

        def draw(across: Scale, up: Scale) -> str:
            x, y = place(xy, xycoords, across, up)
            at = x + right, y - over
            behind = "" if bbox is None else backdrop(text, *at, fontsize, ha, va, bbox["facecolor"], bbox["boxstyle"])
            return behind + words(text, *at, fontsize, tint, ha, va, bold=fontweight == "bold")

        self.words.append(draw)

    def legend(self, **options: Any) -> None:
        """What the labelled marks mean; the options of ``Legend``."""
        self.shown_legend = Legend(**options)

    def set(self, **values: Any) -> None:
        """Limits, ticks, scales, labels and the title, by matplotlib's names."""
        for name, value in values.items():
            if name == "title":
                self.title = value
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
        """How long ticks are, points."""
        for each in self._axes(axis):
            each.tick_length = length

    def locator_params(self, *, nbins: int, axis: str = "both") -> None:
        """How many steps there are between ticks, at most."""
        for each in self._axes(axis):
            each.most = nbins

    def grid(self, *, visible: bool, axis: str = "both") -> None:
        """Whether lines run through the ticks."""
        for each in self._axes(axis):
            each.grid = visible

    def margins(self, *, x: float | None = None, y: float | None = None) -> None:
        """How far axes reach beyond what is drawn, as a share of it."""
        for axis, share in ((self.x, x), (self.y, y)):
            axis.margin = axis.margin if share is None else share

    def set_aspect(self, aspect: Literal["equal"], *, adjustable: Literal["box", "datalim"] = "box") -> None:
        """One scale for both axes: the axes become narrower, or their limits wider."""
        self.equal = adjustable

    def axis(self, which: Literal["off"]) -> None:
        """Hides the axes."""
        self.hidden = which == "off"

    def _axes(self, which: str) -> tuple[ChartAxis, ...]:
        return {"x": (self.x,), "y": (self.y,), "both": (self.x, self.y)}[which]

    def _set_ticks(self, axis: ChartAxis, ticks: ArrayLike, labels: Sequence[str] | None, turned: float) -> None:
        axis.ticks, axis.tick_words, axis.turned = np.asarray(ticks, float), labels, turned
        axis.reach(axis.ticks)

    def _segments(self, x: Array, y: Array, colours: Any, linewidth: float, alpha: float) -> None:
        """Lines between two points each ``(n, 2)``, of one colour or one each."""
        tints = [colour(colours)] if isinstance(colours, str) else [colour(each) for each in colours]
        self.reach(x, y)

        def draw(across: Scale, up: Scale) -> str:
            drawn, gap = "", np.full((len(x), 1), np.nan)
            at = (np.concatenate([places, gap], axis=1) for places in (across(x), up(y)))
            ends = tuple(at)
            for tint in dict.fromkeys(tints):
                of = [len(tints) == 1 or each == tint for each in (tints if len(tints) > 1 else tints * len(x))]
                drawn += path(line(ends[0][of].ravel(), ends[1][of].ravel()), tint, linewidth, alpha=alpha)
            return drawn

        self.add(2.0, draw)

    def _edge_to_edge(self, ends: Any, color: str, linewidth: float, linestyle: Any, zorder: float) -> None:
        tint, more = colour(color), dashes(linestyle, linewidth)

        def draw(across: Scale, up: Scale) -> str:
            x, y = ends(across, up)
            return path(line(np.array(x), np.array(y)), tint, linewidth, more=more)

        self.add(zorder, draw)

    def _cells(self, x: Array, y: Array, colours: Array) -> None:
        self.add(0.0, lambda across, up: cells(across(x), up(y), colours))


def _parsed(said: str) -> tuple[str | None, str]:
    """The dashes and the mark of matplotlib's short form, as ``"o-"``."""
    mark = "" if said in ("-", "--", "-.", ":") else said[:1]
    if mark and mark not in _MARKS:
        raise ValueError(f"no marks and lines {said!r}; marks are {' '.join(_MARKS)}, then - -- -. or :")
    return said[len(mark) :] or None, mark


def _between(x: Array, y: Array) -> tuple[Array, Array]:
    """Points along a line, also between those that it is drawn through."""
    at = np.linspace(0, len(x) - 1, min(8 * len(x), 2000))
    rows = np.arange(len(x))
    return np.interp(at, rows, x), np.interp(at, rows, y)
