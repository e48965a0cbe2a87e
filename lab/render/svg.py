"""Pictures for pages: drawn with matplotlib, and put into HTML as SVG that refers to nothing outside.

matplotlib is slow to import: import this module, and what uses it, where a page is written.
"""

import io
import re
from collections.abc import Callable, Sequence
from html import escape
from typing import Any

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from lab.core.se3 import Array
from lab.render.html import Html

INK, QUIET, GRID = "#1f2937", "#6b7280", "#e5e7eb"
_STYLE: Any = {
    "font.size": 9,
    "font.sans-serif": ["DejaVu Sans", "Arial"],
    "axes.titlesize": 10,
    "axes.labelcolor": INK,
    "axes.edgecolor": "#9ca3af",
    "axes.grid": True,
    "grid.color": GRID,
    "axes.axisbelow": True,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "xtick.color": "#374151",
    "ytick.color": "#374151",
    "legend.frameon": False,
    "legend.fontsize": 8,
    "text.parse_math": False,  # names are a user's: a dollar sign is one
    "svg.hashsalt": "lab",  # the same picture, the same bytes
    "svg.fonttype": "none",
}
_PROLOGUE = re.compile(r"^.*?(?=<svg\b)|<metadata>.*?</metadata>", re.DOTALL)
_NAMESPACES = re.compile(r' (xmlns(:xlink)?|version|width|height)="[^"]*"')
_NAMES = re.compile(r'(\bid="|url\(#|href="#)')
_POINTS_PER_INCH, _PX_PER_INCH = 72, 96
_HALF_PX = 480  # a picture no wider than this has room for another beside it


def panel(
    name: str,
    label: str,
    size: tuple[float, float],
    draw: Callable[[Axes], None],
    margins: tuple[float, float, float, float] = (0.7, 0.5, 0.15, 0.3),
) -> Html:
    """One set of axes as inline SVG.

    Args:
        name: of the picture in its page; no other may have it.
        label: what it shows, for those who do not see it.
        size: width and height, inches.
        margins: left, bottom, right and top of the axes, inches.
    """
    (width, height), (left, bottom, right, top) = size, margins
    with matplotlib.rc_context(_STYLE):
        figure = Figure(figsize=size)
        place = (left / width, bottom / height, 1 - (left + right) / width, 1 - (bottom + top) / height)
        draw(figure.add_axes(place))
        text = io.StringIO()
        figure.savefig(text, format="svg", metadata={"Date": None})
    return inline(text.getvalue(), name, label)


def inline(svg: str, name: str, label: str) -> Html:
    """An SVG file as a part of a page: without prologue and metadata, its names its own, with a title."""
    svg = _NAMES.sub(rf"\g<1>{name}-", _PROLOGUE.sub("", svg))
    opening, rest = svg.split(">", 1)
    width = re.search(r'width="([\d.]+)pt"', opening)
    assert width is not None
    pixels = round(float(width[1]) * _PX_PER_INCH / _POINTS_PER_INCH)
    opening = _NAMESPACES.sub("", opening)
    words = escape(label, quote=True)
    kind = "half" if pixels <= _HALF_PX else "wide"
    told = f'class="{kind}" role="img" aria-label="{words}" style="max-width: {pixels}px"'
    return Html(f"{opening} {told}><title>{words}</title>{rest}")


def log_ticks(axes: Axes, which: str, low: float, high: float) -> None:
    """A logarithmic axis (``x`` or ``y``) from ``low`` to ``high``, with plain numbers at up to nine powers of ten."""
    axes.set(**{f"{which}scale": "log", f"{which}lim": (low, high)})
    first, last = int(np.ceil(np.log10(low) - 1e-9)), int(np.floor(np.log10(high) + 1e-9))
    step = max(1, -(-(last - first) // 8))
    ticks = [10.0**power for power in range(first, last + 1, step)]
    if len(ticks) < 3:
        ticks = [m * 10.0**power for power in range(first - 1, last + 1) for m in (1, 2, 5)]
        ticks = [tick for tick in ticks if low <= tick <= high]
    axis = axes.xaxis if which == "x" else axes.yaxis
    axis.set_ticks(ticks, [f"{tick:g}".replace("-", "−") for tick in ticks])
    axis.set_ticks([], minor=True)


def cube(points: Sequence[Array], share: float = 0.06) -> tuple[Array, float]:
    """The middle ``(3,)`` and half the edge of the cube around arrays of points ``(…, 3)``, NaN left out."""
    every = np.concatenate([np.reshape(each, (-1, 3)) for each in points])
    low, high = np.nanmin(every, axis=0), np.nanmax(every, axis=0)
    return (low + high) / 2, max(float((high - low).max()) * (0.5 + share), 1e-6)


def view(axes: Axes, plane: tuple[int, int], middle: Array, half: float, frame: str) -> None:
    """Equal axes in mm for a view on a plane of the frame (0 is x, 2 is z)."""
    i, j = plane
    title = "from above" if plane == (0, 1) else "from the side"
    axes.set(xlim=(middle[i] - half, middle[i] + half), ylim=(middle[j] - half, middle[j] + half))
    axes.set(xlabel=f"{'xyz'[i]} of the {frame}, mm", ylabel=f"{'xyz'[j]}, mm", title=title)
    axes.set_aspect("equal")
    axes.locator_params(nbins=6)
