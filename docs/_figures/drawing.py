"""What all drawn figures share: their register, their colours and their style."""

from collections.abc import Callable
from contextlib import AbstractContextManager

import matplotlib as mpl
import matplotlib.pyplot as plt
from matplotlib.figure import Figure

INK = "#010203"  # becomes the colour of the page's text
BLUE, ORANGE, GREEN, RED = "#2f7fd1", "#d9822b", "#3c9d5b", "#d1495b"

WIDE = 5.0  # inches: on a phone the letters have the size of the text

FIGURES: dict[str, Callable[[], Figure]] = {}


def style() -> AbstractContextManager[None]:
    """Return the settings of all figures: lines and letters in ``INK``, no background."""
    plain = {"text.color": INK, "axes.edgecolor": INK, "axes.labelcolor": INK, "xtick.color": INK, "ytick.color": INK}
    plain |= {"svg.fonttype": "none", "svg.hashsalt": "lab", "font.size": 12, "font.family": "sans-serif"}
    plain |= {"axes.spines.top": False, "axes.spines.right": False, "legend.frameon": False, "lines.linewidth": 2}
    return mpl.rc_context(plain)


def drawn(draw: Callable[[], Figure]) -> Callable[[], Figure]:
    """Register a figure under the name of its function."""

    def closed() -> Figure:
        figure = draw()
        plt.close(figure)
        return figure

    FIGURES[draw.__name__] = closed
    return closed


def panels(columns: int = 1, width: float = WIDE, height: float = 3.4) -> tuple[Figure, list[plt.Axes]]:
    """Return a figure with panels side by side."""
    figure, axes = plt.subplots(1, columns, figsize=(width, height), squeeze=False, layout="constrained")
    return figure, list(axes[0])
