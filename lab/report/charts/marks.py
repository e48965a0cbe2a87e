"""Axes, ticks and marks of a chart, as SVG.

A picture is drawn into matplotlib's axes, or into a chart that becomes a part of a page in a hundredth of the time.
Both understand the calls of ``Axes``, with matplotlib's names, units and defaults, so a picture is described once.
matplotlib makes the figures that are saved as PNG or shown in a notebook.
"""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from html import escape
from textwrap import wrap
from typing import Any, Final, Protocol

import numpy as np
from numpy.typing import NDArray

from lab.core.se3 import Array
from lab.report.style import FIGURE_STYLE, TICK

__all__ = [
    "FONT_SIZE", "LINE", "ROUND", "Axes", "ChartAxis", "Entry", "Legend", "Scale", "axis_lines", "backdrop", "below",
    "beside", "broken", "cells", "colour", "dashes", "grid_lines", "heading", "line", "line_sample", "marks", "path",
    "rectangle", "round_numbers", "shown_number", "text_width", "tick_labels", "words",
]  # fmt: skip

_STEPS = (1.0, 2.0, 2.5, 5.0, 10.0)
_LEAST, _MOST = 1e-4, 1e6  # between them, numbers are written without a power of ten


@dataclass(frozen=True)
class Scale:
    """Values from ``low`` to ``high`` along places from ``start`` to ``end``, linear or by the logarithm."""

    low: float
    high: float
    start: float
    end: float
    logarithmic: bool = False

    def __call__(self, values: Array | float) -> Array:
        """The places of values ``(...)``; NaN where a logarithm has none."""
        given, low, high = np.asarray(values, dtype=float), self.low, self.high
        if self.logarithmic:
            given, low, high = np.log(np.where(given > 0, given, np.nan)), np.log(low), np.log(high)
        return np.asarray(self.start + (given - low) / (high - low) * (self.end - self.start))


def round_numbers(low: float, high: float, most: int) -> Array:
    """Round numbers from ``low`` to ``high``, at most about ``most`` steps and at least two numbers."""
    raw = (high - low) / max(1, most)
    power = 10.0 ** np.floor(np.log10(raw))
    sizes = [power * each for each in _STEPS if power * each >= raw * (1 - 1e-9)]
    smaller = [power / 10 * each for each in _STEPS[::-1]] + [power * each for each in _STEPS[::-1]]
    for step in (sizes[0], *(each for each in sorted(smaller, reverse=True) if each < sizes[0])):
        count = np.arange(np.ceil(low / step - 1e-9), np.floor(high / step + 1e-9) + 1)
        if len(count) >= 2:
            break
    return np.asarray(count * step)


def tick_labels(values: Sequence[float] | Array) -> list[str]:
    """Format numbers with as many decimals as distinguish them."""
    given = np.asarray(values, dtype=float)
    largest = float(np.abs(given).max(initial=0.0))
    if largest and not _LEAST <= largest < _MOST:
        return [f"{value:g}".replace("-", "−") for value in given]
    size = max(largest, 1e-9)
    digits = next((d for d in range(10) if np.abs(given - given.round(d)).max(initial=0.0) < 1e-6 * size), 10)
    return [f"{value + 0.0:.{digits}f}".replace("-", "−") for value in given.round(digits)]


ROUND: Final = ' style="stroke-linecap:round;stroke-linejoin:round"'  # a style: matplotlib's apply to the whole page
_SHADES = 31  # the largest of the steps of a colour's part
_FARTHEST = 2e4  # a picture's edge is nearer
_MOST_PATHS = 300  # of marks that one sees through: more share a path, where they do not darken each other
_DASHES: Final = {"--": (3.7, 1.6), ":": (1.0, 1.65), "-.": (6.4, 1.6, 1.0, 1.6)}  # of the line's width
_PLUS: Final = "m{a} {h}v-{b}h-{b}v-{b}h{b}v-{b}h{b}v{b}h{b}v{b}h-{b}v{b}z"
_NARROW, _WIDE = frozenset("iljt.,:;|'!()[]f "), frozenset("mwMW%@—…±σ")


def shown_number(value: float) -> str:
    """A coordinate, to a hundredth of a point."""
    return f"{value:.2f}".rstrip("0").rstrip(".") if value else "0"


def colour(given: Any) -> str:
    """A colour as SVG has it: ``#rrggbb`` and most words as they are, ``"0.85"`` a grey, parts from 0 to 1 ``(3,)``.

    Parts are rounded to 32 steps: shades of a scale are few colours, each of which the page gives its dark one.
    """
    if not isinstance(given, str):
        steps = (round(_SHADES * min(max(float(part), 0.0), 1.0)) for part in given[:3])
        return "#{:02x}{:02x}{:02x}".format(*(round(255 * step / _SHADES) for step in steps))
    if given[0].isdigit():
        return "#" + 3 * f"{round(255 * float(given)):02x}"
    return {"white": "#ffffff", "black": "#000000"}.get(given, given)  # which change places on a dark page


def dashes(style: Any, width: float) -> str:
    """The attribute of a dashed line; nothing for a solid one."""
    parts = style[1] if isinstance(style, tuple) else _DASHES.get(style, ())
    shown = " ".join(shown_number(part * width) for part in parts)
    return f' stroke-dasharray="{shown}"' if shown else ""


def line(x: Array, y: Array) -> str:
    """Return the path data of a line through points ``(n,)``, interrupted where one of them is not finite."""
    known = np.isfinite(x) & np.isfinite(y)
    starts = known & ~np.concatenate([[False], known[:-1]])
    x, y = np.clip(x[known], -_FARTHEST, _FARTHEST), np.clip(y[known], -_FARTHEST, _FARTHEST)
    letters = np.where(starts[known], "M", "L").tolist()
    return "".join(f"{c}{a:.1f} {b:.1f}" for c, a, b in zip(letters, x.tolist(), y.tolist(), strict=True))


def path(
    data: str, stroke: str = "none", width: float = 0.0, fill: str = "none", alpha: float = 1.0, more: str = ""
) -> str:
    """Return a path element; empty without data."""
    if not data:
        return ""
    pen = f' stroke="{stroke}" stroke-width="{shown_number(width)}"' if stroke != "none" and width else ""
    seen = f' opacity="{shown_number(alpha)}"' if alpha < 1 else ""
    return f'<path d="{data}" fill="{fill}"{pen}{seen}{more}/>'


def rectangle(x: tuple[float, float], y: tuple[float, float]) -> str:
    """Return the path data of the rectangle between two corners."""
    (left, right), (top, bottom) = sorted(x), sorted(y)
    return f"M{left:.2f} {top:.2f}H{right:.2f}V{bottom:.2f}H{left:.2f}z"


def _shape(mark: str, size: float) -> str:
    """Return the path data of a mark after its position; empty for a disc, which is the end of a thick line."""
    h, n = size / 2, shown_number
    if mark == "s":
        return f"m{n(-h)} {n(-h)}h{n(size)}v{n(size)}h{n(-size)}z"
    if mark == "^":
        return f"m0 {n(-h)}l{n(h)} {n(size)}h{n(-size)}z"
    if mark == "v":
        return f"m0 {n(h)}l{n(-h)} {n(-size)}h{n(size)}z"
    if mark == "D":
        d = n(0.7 * size)
        return f"m0 -{d}l{d} {d}l-{d} {d}l-{d} -{d}z"
    if mark == "P":
        return _PLUS.format(a=n(size / 6), h=n(h), b=n(size / 3))
    if mark == "|":
        return f"m0 {n(-h)}v{n(size)}"
    if mark == "x":
        return f"m{n(-h)} {n(-h)}l{n(size)} {n(size)}m{n(-size)} 0l{n(size)} {n(-size)}"
    raise ValueError(f"no mark {mark!r}; there are o . s ^ v D P | x")


def marks(
    x: Array,
    y: Array,
    mark: str,
    size: float,
    colours: Sequence[str],
    edge: str = "",
    edge_width: float = 1.0,
    alpha: float = 1.0,
) -> str:
    """Marks at points ``(n,)`` of one size; of many that one sees through, some share a path.

    Args:
        colours: one for all, or one each.
        edge: its colour where it is not the mark's own.
    """
    known = np.isfinite(x) & np.isfinite(y)
    if not known.any():
        return ""
    if edge:
        shown = [each for each, seen in zip(colours, known, strict=True) if seen] if len(colours) > 1 else colours[0]
        return _discs(x[known], y[known], size, shown, edge, edge_width)
    end = ROUND if mark in "o." else ""
    size = size / 2 if mark == "." else size
    after = "h0" if end else _shape(mark, size)
    width = size + edge_width if end else edge_width
    at = np.clip(np.stack([x, y], axis=-1), -_FARTHEST, _FARTHEST).round(1).tolist()
    parts = []
    for tint, rows in _rows_by_colour(colours, known).items():
        drawn = [f"M{at[i][0]} {at[i][1]}{after}" for i in rows]
        fill = "none" if end or mark in "|x" else tint
        if alpha == 1:
            parts.append(path("".join(drawn), tint, width, fill, alpha, end))
        else:
            parts.append(_see_through(drawn, tint, width, fill, alpha, end))
    return "".join(parts)


def _rows_by_colour(colours: Sequence[str], known: NDArray[np.bool_]) -> dict[str, list[int]]:
    """Return the known rows of each colour; one colour is for all."""
    rows: dict[str, list[int]] = {}
    for i in np.flatnonzero(known).tolist():
        rows.setdefault(colours[i if len(colours) > 1 else 0], []).append(i)
    return rows


def _see_through(drawn: Sequence[str], tint: str, width: float, fill: str, alpha: float, end: str) -> str:
    """Draw marks that one sees through, each in a path of its own to darken others; of many, some share one."""
    count = max(1, min(len(drawn), _MOST_PATHS))
    paths = "".join(f'<path d="{"".join(drawn[first::count])}"/>' for first in range(count))
    pen = f'stroke="{tint}" stroke-width="{shown_number(width)}" stroke-opacity="{shown_number(alpha)}"'
    return f'<g fill="{fill}" fill-opacity="{shown_number(alpha)}" {pen}{end}>{paths}</g>'


def _discs(x: Array, y: Array, size: float, colours: Sequence[str] | str, edge: str, edge_width: float) -> str:
    one = isinstance(colours, str)
    shade = f' fill="{colours}"' if one else ""
    fills: Iterable[str] = [""] * len(x) if one else (f' fill="{each}"' for each in colours)
    discs = "".join(
        f'<circle cx="{a:.1f}" cy="{b:.1f}" r="{shown_number(size / 2)}"{fill}/>'
        for a, b, fill in zip(x.tolist(), y.tolist(), fills, strict=True)
    )
    return f'<g stroke="{edge}" stroke-width="{shown_number(edge_width)}"{shade}>{discs}</g>'


def cells(x: Array, y: Array, colours: Array) -> str:
    """A matrix of colours ``(m, n, 3)`` from 0 to 1 between edges ``(n+1,)`` and ``(m+1,)``; NaN is left out."""
    by_colour: dict[str, list[str]] = {}
    for row, low, high in zip(colours, y[:-1], y[1:], strict=True):
        for tint, left, right in zip(row, x[:-1], x[1:], strict=True):
            if np.isfinite(tint).all():
                by_colour.setdefault(colour(tint), []).append(rectangle((left, right), (low, high)))
    crisp = ' shape-rendering="crispEdges"'
    return "".join(path("".join(data), fill=tint, more=crisp) for tint, data in by_colour.items())


def text_width(text: str, size: float) -> float:
    """About how wide a line is in the pages' figures, points."""
    return size * sum(
        0.36 if c in _NARROW else 0.92 if c in _WIDE else 0.7 if c.isupper() else 0.61 for c in text
    )  # fmt: skip


def words(
    text: str, x: float, y: float, size: float, tint: str, across: str = "left", up: str = "baseline",
    turned: float = 0.0, bold: bool = False,
) -> str:  # fmt: skip
    """Words at a place, line below line.

    Args:
        across: ``left``, ``center`` or ``right``: which part of the words is at the place.
        up: ``baseline``, ``top``, ``center`` or ``bottom``.
        turned: degrees, counterclockwise, about the place.
    """
    lines = text.split("\n")
    height = 1.2 * size
    above = {"baseline": 0.0, "top": 0.76 * size, "center": 0.36 * size - (len(lines) - 1) * height / 2,
             "bottom": -0.24 * size - (len(lines) - 1) * height}[up]  # fmt: skip
    anchor = {"left": "", "center": ' text-anchor="middle"', "right": ' text-anchor="end"'}[across]
    weight = ' font-weight="bold"' if bold else ""
    place = f'x="{shown_number(x)}" y="{shown_number(y + above)}"'
    turn = f' transform="rotate({shown_number(-turned)} {shown_number(x)} {shown_number(y)})"' if turned else ""
    text_lines = escape(lines[0], quote=False) + "".join(
        f'<tspan x="{shown_number(x)}" dy="{shown_number(height)}">{escape(each, quote=False)}</tspan>'
        for each in lines[1:]
    )
    return f'<text {place} font-size="{shown_number(size)}" fill="{tint}"{anchor}{weight}{turn}>{text_lines}</text>'


def backdrop(text: str, x: float, y: float, size: float, across: str, up: str, fill: str, style: str) -> str:
    """The area behind a line of words at a place, as ``words`` puts them there.

    Args:
        style: ``circle`` or ``round``, and how far the area reaches beyond the words, as ``"round,pad=0.1"`` (of the
            words' size).
    """
    shape, _, more = style.partition(",pad=")
    pad = float(more or 0.3) * size
    width, height = text_width(text, size) + 2 * pad, size + 2 * pad
    if shape == "circle":
        width = height = max(width, height)
    left = x - {"left": pad, "center": width / 2, "right": width - pad}[across]
    middle = y + {"baseline": -0.36, "top": 0.5, "center": 0.0, "bottom": -0.5}[up] * size
    n, turn = shown_number, width / 2 if shape == "circle" else pad
    place = f'x="{n(left)}" y="{n(middle - height / 2)}" width="{n(width)}" height="{n(height)}"'
    return f'<rect {place} rx="{n(turn)}" fill="{fill}"/>'


FONT_SIZE: Final[float] = FIGURE_STYLE["font.size"]
_TITLE: Final[float] = FIGURE_STYLE["axes.titlesize"]
LINE: Final[float] = 1.2 * _TITLE  # from a line of a title to the next
_EDGE, _GRID, _LABEL = (FIGURE_STYLE[f"{of}color"] for of in ("axes.edge", "grid.", "axes.label"))
_THIN, _TICK, _PAD = 0.8, 3.5, 3.5  # points
_MOST_STEPS = 9
_PLACES: Final = ("upper right", "upper left", "lower left", "lower right", "center right", "center left",
                  "lower center", "upper center", "center")  # fmt: skip
_ACROSS, _UP = {"left": 0.0, "center": 0.5, "right": 1.0}, {"upper": 0.0, "center": 0.5, "lower": 1.0}


@dataclass
class ChartAxis:
    """Axis of a chart: its limits, where they are given, what was drawn along it, and how it is labelled."""

    limits: tuple[float, float] | None = None
    logarithmic: bool = False
    ticks: Array | None = None
    tick_labels: Sequence[str] | None = None
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
        """Return the values of the ticks, and their labels.

        Args:
            per_step: points that a step needs for its label.
        """
        low, high = sorted((scale.low, scale.high))
        if self.ticks is None:
            space = int(abs(scale.end - scale.start) / per_step)
            at = round_numbers(low, high, self.most or min(max(space, 1), _MOST_STEPS))
        else:
            at = self.ticks
        slack = 1e-9 * (high - low)
        inside = (at >= low - slack) & (at <= high + slack)
        labels = list(self.tick_labels) if self.tick_labels is not None else tick_labels(at)
        return at[inside], [word for word, shown in zip(labels, inside, strict=True) if shown]


def grid_lines(across: Scale, ticks_x: Array, up: Scale, ticks_y: Array) -> str:
    """Lines through the ticks of each axis, from edge to edge."""
    text = "".join(f"M{at:.2f} {up.start:.2f}V{up.end:.2f}" for at in across(ticks_x).tolist())
    text += "".join(f"M{across.start:.2f} {at:.2f}H{across.end:.2f}" for at in up(ticks_y).tolist())
    return path(text, _GRID, _THIN)


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
    """The words above the axes, line above line."""
    above = y.end - 6 - (title.count("\n")) * LINE
    return words(title, (x.start + x.end) / 2, above, _TITLE, "#000000", "center") if title else ""


def broken(title: str, width: float) -> str:
    """A title in lines that are not wider than ``width`` (points)."""
    letters = max(8, int(len(title) * width / max(text_width(title, _TITLE), 1e-9)))
    return "\n".join(wrap(title, letters)) if text_width(title, _TITLE) > width else title


@dataclass(frozen=True)
class Entry:
    """A labelled mark."""

    label: str
    sample: Callable[[float, float, float], str]  # draws it from a place (x, y) on, with a width; points


@dataclass(frozen=True)
class Legend:
    """Legend of the labelled marks, in columns; places and sizes as matplotlib has them."""

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


class Axes(Protocol):
    """The calls of matplotlib's ``Axes`` that pictures of pages use; ``Chart`` describes them."""

    def plot(self, *args: Any, **keywords: Any) -> Any: ...  # noqa: D102
    def scatter(self, *args: Any, **keywords: Any) -> Any: ...  # noqa: D102
    def stairs(self, *args: Any, **keywords: Any) -> Any: ...  # noqa: D102
    def barh(self, *args: Any, **keywords: Any) -> Any: ...  # noqa: D102
    def hlines(self, *args: Any, **keywords: Any) -> Any: ...  # noqa: D102
    def vlines(self, *args: Any, **keywords: Any) -> Any: ...  # noqa: D102
    def axhline(self, *args: Any, **keywords: Any) -> Any: ...  # noqa: D102
    def axvline(self, *args: Any, **keywords: Any) -> Any: ...  # noqa: D102
    def axhspan(self, *args: Any, **keywords: Any) -> Any: ...  # noqa: D102
    def fill_between(self, *args: Any, **keywords: Any) -> Any: ...  # noqa: D102
    def pcolormesh(self, *args: Any, **keywords: Any) -> Any: ...  # noqa: D102
    def annotate(self, *args: Any, **keywords: Any) -> Any: ...  # noqa: D102
    def legend(self, *args: Any, **keywords: Any) -> Any: ...  # noqa: D102
    def quiver(self, *args: Any, **keywords: Any) -> Any: ...  # noqa: D102
    def inset_axes(self, *args: Any, **keywords: Any) -> Any: ...  # noqa: D102
    def set(self, **keywords: Any) -> Any: ...  # noqa: D102
    def set_xticks(self, *args: Any, **keywords: Any) -> Any: ...  # noqa: D102
    def set_yticks(self, *args: Any, **keywords: Any) -> Any: ...  # noqa: D102
    def tick_params(self, *args: Any, **keywords: Any) -> Any: ...  # noqa: D102
    def locator_params(self, *args: Any, **keywords: Any) -> Any: ...  # noqa: D102
    def grid(self, *args: Any, **keywords: Any) -> Any: ...  # noqa: D102
    def margins(self, *args: Any, **keywords: Any) -> Any: ...  # noqa: D102
    def set_aspect(self, *args: Any, **keywords: Any) -> Any: ...  # noqa: D102
    def axis(self, *args: Any, **keywords: Any) -> Any: ...  # noqa: D102
