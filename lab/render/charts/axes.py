"""What a picture is drawn into: matplotlib's axes, or a chart that becomes a part of a page.

A page has many pictures and matplotlib takes a second or more to be loaded and to draw them; a chart takes a
hundredth. Both understand the calls listed here, with the names, units and defaults that matplotlib gives them, so a
picture is described once. matplotlib makes the figures that are saved as PNG or shown in a notebook.
"""

from typing import Any, Protocol

__all__ = ["Axes"]


class Axes(Protocol):
    """The calls of matplotlib's ``Axes`` that pictures of pages use; ``Chart`` says which keywords each has."""

    def plot(self, *args: Any, **keywords: Any) -> Any:
        """Lines and marks through points; NaN parts a line."""

    def scatter(self, *args: Any, **keywords: Any) -> Any:
        """A mark at each point."""

    def stairs(self, *args: Any, **keywords: Any) -> Any:
        """A histogram."""

    def barh(self, *args: Any, **keywords: Any) -> Any:
        """Bars that lie."""

    def hlines(self, *args: Any, **keywords: Any) -> Any:
        """Horizontal lines."""

    def vlines(self, *args: Any, **keywords: Any) -> Any:
        """Vertical lines."""

    def axhline(self, *args: Any, **keywords: Any) -> Any:
        """A horizontal line from edge to edge."""

    def axvline(self, *args: Any, **keywords: Any) -> Any:
        """A vertical line from edge to edge."""

    def axhspan(self, *args: Any, **keywords: Any) -> Any:
        """A horizontal band from edge to edge."""

    def fill_between(self, *args: Any, **keywords: Any) -> Any:
        """The area between two curves."""

    def imshow(self, *args: Any, **keywords: Any) -> Any:
        """A matrix of colours, its first row on top."""

    def pcolormesh(self, *args: Any, **keywords: Any) -> Any:
        """A matrix of colours between edges."""

    def annotate(self, *args: Any, **keywords: Any) -> Any:
        """Words at a point, or an arrow."""

    def legend(self, *args: Any, **keywords: Any) -> Any:
        """What the labelled marks mean."""

    def set(self, **keywords: Any) -> Any:
        """Limits, ticks, scales, titles."""

    def set_xticks(self, *args: Any, **keywords: Any) -> Any:
        """Ticks and their words along x."""

    def set_yticks(self, *args: Any, **keywords: Any) -> Any:
        """Ticks and their words along y."""

    def tick_params(self, *args: Any, **keywords: Any) -> Any:
        """How ticks look."""

    def locator_params(self, *args: Any, **keywords: Any) -> Any:
        """How many ticks there are at most."""

    def grid(self, *args: Any, **keywords: Any) -> Any:
        """Whether lines run through the ticks."""

    def margins(self, *args: Any, **keywords: Any) -> Any:
        """How far axes reach beyond what is drawn."""

    def set_aspect(self, *args: Any, **keywords: Any) -> Any:
        """One scale for both axes."""

    def axis(self, *args: Any, **keywords: Any) -> Any:
        """Hides the axes."""
