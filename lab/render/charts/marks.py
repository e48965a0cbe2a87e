"""Lines, marks, areas and words as elements of SVG; positions and sizes are points (1/72 inch), y downwards."""

from collections.abc import Iterable, Sequence
from html import escape
from typing import Any, Final

import numpy as np

from lab.core.se3 import Array

__all__ = [
    "ROUND",
    "backdrop",
    "cells",
    "colour",
    "dashes",
    "line",
    "marks",
    "path",
    "rectangle",
    "shown_number",
    "text_width",
    "words",
]

ROUND: Final = ' style="stroke-linecap:round;stroke-linejoin:round"'  # a style: matplotlib's apply to the whole page
_FARTHEST = 2e4  # a picture's edge is nearer
_MOST_PATHS = 300  # of marks that one sees through: more share a path, where they do not darken each other
_DASHES: Final = {"--": (3.7, 1.6), ":": (1.0, 1.65), "-.": (6.4, 1.6, 1.0, 1.6)}  # of the line's width
_PLUS: Final = "m{a} {h}v-{b}h-{b}v-{b}h{b}v-{b}h{b}v{b}h{b}v{b}h-{b}v{b}z"
_NARROW, _WIDE = frozenset("iljt.,:;|'!()[]f "), frozenset("mwMW%@—…±σ")


def shown_number(value: float) -> str:
    """A coordinate, to a hundredth of a point."""
    return f"{value:.2f}".rstrip("0").rstrip(".") if value else "0"


def colour(given: Any) -> str:
    """A colour as SVG has it: words and ``#rrggbb`` as they are, ``"0.85"`` a grey, parts from 0 to 1 as ``(3,)``."""
    if not isinstance(given, str):
        return "#{:02x}{:02x}{:02x}".format(*(round(255 * float(part)) for part in given[:3]))
    return colour(3 * (float(given),)) if given[0].isdigit() else given


def dashes(style: Any, width: float) -> str:
    """The attribute of a dashed line; nothing for a solid one."""
    parts = style[1] if isinstance(style, tuple) else _DASHES.get(style, ())
    shown = " ".join(shown_number(part * width) for part in parts)
    return f' stroke-dasharray="{shown}"' if shown else ""


def line(x: Array, y: Array) -> str:
    """What a path says of a line through points ``(n,)``; it is parted where one of them is not finite."""
    known = np.isfinite(x) & np.isfinite(y)
    starts = known & ~np.concatenate([[False], known[:-1]])
    x, y = np.clip(x[known], -_FARTHEST, _FARTHEST), np.clip(y[known], -_FARTHEST, _FARTHEST)
    letters = np.where(starts[known], "M", "L").tolist()
    return "".join(f"{c}{a:.1f} {b:.1f}" for c, a, b in zip(letters, x.tolist(), y.tolist(), strict=True))


def path(
    said: str, stroke: str = "none", width: float = 0.0, fill: str = "none", alpha: float = 1.0, more: str = ""
) -> str:
    """A path; nothing where it says nothing."""
    if not said:
        return ""
    pen = f' stroke="{stroke}" stroke-width="{shown_number(width)}"' if stroke != "none" and width else ""
    seen = f' opacity="{shown_number(alpha)}"' if alpha < 1 else ""
    return f'<path d="{said}" fill="{fill}"{pen}{seen}{more}/>'


def rectangle(x: tuple[float, float], y: tuple[float, float]) -> str:
    """What a path says of the rectangle between two corners."""
    (left, right), (top, bottom) = sorted(x), sorted(y)
    return f"M{left:.2f} {top:.2f}H{right:.2f}V{bottom:.2f}H{left:.2f}z"


def _shape(mark: str, size: float) -> str:
    """What follows each place in a path of marks; nothing for a disc, which is the end of a thick line."""
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
    if edge:
        shown = [each for each, seen in zip(colours, known, strict=True) if seen] if len(colours) > 1 else colours[0]
        return _discs(x[known], y[known], size, shown, edge, edge_width)
    end = ROUND if mark in "o." else ""
    size = size / 2 if mark == "." else size
    after = "h0" if end else _shape(mark, size)
    width = size + edge_width if end else edge_width
    at = np.clip(np.stack([x, y], axis=-1), -_FARTHEST, _FARTHEST).round(1).tolist()
    parts = []
    for tint in dict.fromkeys(colours):
        places = [i for i in np.flatnonzero(known).tolist() if len(colours) == 1 or colours[i] == tint]
        count = 1 if alpha == 1 else max(1, min(len(places), _MOST_PATHS))
        said = ["".join(f"M{at[i][0]} {at[i][1]}{after}" for i in places[first::count]) for first in range(count)]
        fill = "none" if end or mark in "|x" else tint
        if count == 1:
            parts.append(path(said[0], tint, width, fill, alpha, end))
            continue
        pen = f'stroke="{tint}" stroke-width="{shown_number(width)}" stroke-opacity="{shown_number(alpha)}"'
        paths = "".join(f'<path d="{each}"/>' for each in said)
        parts.append(f'<g fill="{fill}" fill-opacity="{shown_number(alpha)}" {pen}{end}>{paths}</g>')
    return "".join(parts)


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
    return "".join(path("".join(said), fill=tint, more=crisp) for tint, said in by_colour.items())


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
    said = escape(lines[0], quote=False) + "".join(
        f'<tspan x="{shown_number(x)}" dy="{shown_number(height)}">{escape(each, quote=False)}</tspan>'
        for each in lines[1:]
    )
    return f'<text {place} font-size="{shown_number(size)}" fill="{tint}"{anchor}{weight}{turn}>{said}</text>'


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
