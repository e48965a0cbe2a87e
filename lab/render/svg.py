"""Pictures of pages: drawn as charts, or with matplotlib, and put into a page as SVG that refers to nothing outside.

matplotlib is slow to import, so it is imported where it draws something, and not before.
"""

import io
import re
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import numpy as np
from markupsafe import Markup

from lab.core.se3 import Array
from lab.render.charts.axes import Axes
from lab.render.charts.chart import Chart
from lab.render.document import Picture
from lab.render.style import FIGURE_STYLE

if TYPE_CHECKING:
    import matplotlib.axes
    from matplotlib.figure import Figure

__all__ = ["axes_picture", "cube", "figure_picture", "inline_svg", "log_ticks", "save_figure", "shades", "view"]

_PROLOGUE = re.compile(r"^.*?(?=<svg\b)|<metadata>.*?</metadata>", re.DOTALL)
_STYLE = re.compile(r'<defs>\s*<style type="text/css">\*\{(.*?)\}</style>\s*</defs>')  # of every element of a page
_NAMES = re.compile(r'(\bid="|url\(#|href="#)')
_POINTS_PER_INCH, _PX_PER_INCH = 72, 96
_FONT = "DejaVu Sans, Arial, sans-serif"
_SEEN_FROM = {(0, 1): "from above", (0, 2): "from the side"}
_MARGINS = (0.7, 0.5, 0.15, 0.3)
_DOTS_PER_INCH = 130  # of a PNG
_HALF_PX = 480  # a picture no wider than this has room for another beside it


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

    return replace(figure_picture(name, label, size, draw, margins), chart=chart)


def figure_picture(
    name: str,
    label: str,
    size: tuple[float, float],
    draw: "Callable[[matplotlib.axes.Axes], None]",
    margins: tuple[float, float, float, float] = _MARGINS,
) -> Picture:
    """A picture of one set of axes that needs what only matplotlib has, as colour bars and dates."""

    def figure() -> "Figure":
        import matplotlib
        from matplotlib.figure import Figure

        (width, height), (left, bottom, right, top) = size, margins
        with matplotlib.rc_context(FIGURE_STYLE):
            made = Figure(figsize=size)
            area = (left / width, bottom / height, 1 - (left + right) / width, 1 - (bottom + top) / height)
            draw(made.add_axes(area))
        return made

    return Picture(name, label, figure)


def inline_svg(picture: Picture) -> Markup:
    """A picture as a part of a page: without prologue and metadata, its ids its own, with a title."""
    if picture.chart is None:
        width, height, drawn = _matplotlib_svg(picture)
    else:
        chart = picture.chart()
        width, height, drawn = chart.width, chart.height, chart.svg() + "</svg>"
    pixels = round(width * _PX_PER_INCH / _POINTS_PER_INCH)
    form = Markup(
        '<svg viewBox="0 0 {:g} {:g}" class="{}" role="img" aria-label="{}" style="max-width: {}px"><title>{}</title>{}'
    )
    kind = "half" if pixels <= _HALF_PX else "wide"
    words = Markup(drawn)  # both escape what they are given
    return form.format(width, height, kind, picture.label, pixels, picture.label, words)


def _matplotlib_svg(picture: Picture) -> tuple[float, float, str]:
    """A picture's width and height (points), and what is within its outermost element, with the end of that."""
    import matplotlib

    text = io.StringIO()
    with matplotlib.rc_context(FIGURE_STYLE):
        figure = picture.draw()
        figure.savefig(text, format="svg", metadata={"Date": None}, dpi=_DOTS_PER_INCH)
    svg = _NAMES.sub(rf"\g<1>{picture.name}-", _PROLOGUE.sub("", text.getvalue()))
    width, height = (_POINTS_PER_INCH * edge for edge in figure.get_size_inches())
    inside, styles = svg.split(">", 1)[1].rpartition("</svg>")[0], _STYLE.search(svg)
    assert styles is not None
    return float(width), float(height), f'<g style="{styles[1]}">{_STYLE.sub("", inside)}</g></svg>'


def save_figure(folder: Path, name: str, figure: "Figure") -> None:
    """Write a figure as PNG and SVG, the same bytes for the same figure."""
    import matplotlib

    with matplotlib.rc_context(FIGURE_STYLE):
        figure.savefig(folder / f"{name}.png", dpi=_DOTS_PER_INCH)
        figure.set_layout_engine("none")  # what the first one found, which takes as long as drawing
        figure.savefig(folder / f"{name}.svg", metadata={"Date": None})


def log_ticks(axes: Axes, which: Literal["x", "y"], low: float, high: float) -> None:
    """A logarithmic axis from ``low`` to ``high``, with plain numbers at up to nine powers of ten."""
    axes.set(**{f"{which}scale": "log", f"{which}lim": (low, high)})
    first, last = int(np.ceil(np.log10(low) - 1e-9)), int(np.floor(np.log10(high) + 1e-9))
    step = max(1, -(-(last - first) // 8))
    ticks = [10.0**power for power in range(first, last + 1, step)]
    if len(ticks) < 3:
        ticks = [m * 10.0**power for power in range(first - 1, last + 1) for m in (1, 2, 5)]
        ticks = [tick for tick in ticks if low <= tick <= high]
    set_ticks = axes.set_xticks if which == "x" else axes.set_yticks
    set_ticks(ticks, [f"{tick:g}".replace("-", "−") for tick in ticks])
    set_ticks([], minor=True)


def shades(values: Array, colours: Sequence[str]) -> Array:
    """Colours ``(..., 3)`` from 0 to 1 of values ``(...)`` from 0 (the first) to 1 (the last); NaN has none.

    Args:
        colours: evenly spaced along the values, as ``#rrggbb``.
    """
    knots = np.array([[int(each[i : i + 2], 16) / 255 for i in (1, 3, 5)] for each in colours])
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
    title = f"{shown}, {_SEEN_FROM[plane]}" if shown else _SEEN_FROM[plane]
    axes.set(xlim=(middle[i] - half, middle[i] + half), ylim=(middle[j] - half, middle[j] + half))
    axes.set(xlabel=f"{'xyz'[i]} of the {frame}, mm", ylabel=f"{'xyz'[j]}, mm", title=title)
    axes.set_aspect("equal")
    axes.locator_params(nbins=6)
