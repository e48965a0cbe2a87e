"""Pictures of pages: drawn with matplotlib, and put into a page as SVG that refers to nothing outside.

matplotlib is slow to import, so it is imported where something is drawn, and not before.
"""

import io
import re
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import numpy as np
from markupsafe import Markup

from lab.core.se3 import Array
from lab.render.document import Picture
from lab.render.style import FIGURE_STYLE

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

__all__ = ["axes_picture", "cube", "inline_svg", "log_ticks", "save_figure", "view"]

_PROLOGUE = re.compile(r"^.*?(?=<svg\b)|<metadata>.*?</metadata>", re.DOTALL)
_NAMESPACES = re.compile(r' (xmlns(:xlink)?|version|width|height)="[^"]*"')
_NAMES = re.compile(r'(\bid="|url\(#|href="#)')
_POINTS_PER_INCH, _PX_PER_INCH = 72, 96
_DOTS_PER_INCH = 130  # of a PNG
_HALF_PX = 480  # a picture no wider than this has room for another beside it


def axes_picture(
    name: str,
    label: str,
    size: tuple[float, float],
    draw: "Callable[[Axes], None]",
    margins: tuple[float, float, float, float] = (0.7, 0.5, 0.15, 0.3),
) -> Picture:
    """A picture of one set of axes.

    Args:
        name: of the picture in its document; no other may have it.
        label: what it shows, for those who do not see it.
        size: width and height, inches.
        draw: draws into the axes.
        margins: left, bottom, right and top of the axes, inches.
    """

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
    import matplotlib

    text = io.StringIO()
    with matplotlib.rc_context(FIGURE_STYLE):
        picture.draw().savefig(text, format="svg", metadata={"Date": None}, dpi=_DOTS_PER_INCH)
    svg = _NAMES.sub(rf"\g<1>{picture.name}-", _PROLOGUE.sub("", text.getvalue()))
    opening, rest = svg.split(">", 1)
    width = re.search(r'width="([\d.]+)pt"', opening)
    assert width is not None
    pixels = round(float(width[1]) * _PX_PER_INCH / _POINTS_PER_INCH)
    form = Markup('{} class="{}" role="img" aria-label="{}" style="max-width: {}px"><title>{}</title>{}')
    kind = "half" if pixels <= _HALF_PX else "wide"
    markup = Markup(_NAMESPACES.sub("", opening)), Markup(rest)  # matplotlib escapes what it is given
    return form.format(markup[0], kind, picture.label, pixels, picture.label, markup[1])


def save_figure(folder: Path, name: str, figure: "Figure") -> None:
    """Write a figure as PNG and SVG, the same bytes for the same figure."""
    import matplotlib

    with matplotlib.rc_context(FIGURE_STYLE):
        figure.savefig(folder / f"{name}.png", dpi=_DOTS_PER_INCH)
        figure.set_layout_engine("none")  # what the first one found, which takes as long as drawing
        figure.savefig(folder / f"{name}.svg", metadata={"Date": None})


def log_ticks(axes: "Axes", which: Literal["x", "y"], low: float, high: float) -> None:
    """A logarithmic axis from ``low`` to ``high``, with plain numbers at up to nine powers of ten."""
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


def view(axes: "Axes", plane: tuple[int, int], middle: Array, half: float, frame: str) -> None:
    """Equal axes in mm for a view on a plane of the frame (0 is x, 2 is z)."""
    i, j = plane
    title = "from above" if plane == (0, 1) else "from the side"
    axes.set(xlim=(middle[i] - half, middle[i] + half), ylim=(middle[j] - half, middle[j] + half))
    axes.set(xlabel=f"{'xyz'[i]} of the {frame}, mm", ylabel=f"{'xyz'[j]}, mm", title=title)
    axes.set_aspect("equal")
    axes.locator_params(nbins=6)
