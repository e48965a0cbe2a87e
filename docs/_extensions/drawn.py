"""The directive `drawn`: a figure that a function of docs/_figures draws while the pages are built."""

import io
import re
import sys
from collections.abc import Callable
from functools import cache
from importlib import import_module
from pathlib import Path
from typing import ClassVar

from docutils import nodes
from docutils.parsers.rst import directives
from sphinx.application import Sphinx
from sphinx.util.docutils import SphinxDirective

FIGURES = Path(__file__).parents[1] / "_figures"
SOURCES = sorted(FIGURES.glob("*.py"))


@cache
def svg_of(name: str) -> str:
    """Return the figure as SVG whose lines and letters have the colour of the page's text.

    Args:
        name: of the function in a module of docs/_figures.
    """
    sys.path[:0] = [str(FIGURES)]
    try:
        drawing = import_module("drawing")
        for source in SOURCES:
            import_module(source.stem)
    finally:
        sys.path.remove(str(FIGURES))
    written = io.StringIO()
    with drawing.style():
        drawing.FIGURES[name]().savefig(written, format="svg", transparent=True, metadata={"Date": None})
    svg = written.getvalue()[written.getvalue().index("<svg") :]
    svg = re.sub(
        r'(<svg[^>]*?) height="[^"]*"', r"\1", re.sub(r'(<svg[^>]*?) width="[^"]*"', r"\1", svg, count=1), count=1
    )
    return re.sub(r'(\bid="|href="#|url\(#)', rf"\1{name}-", svg.replace(drawing.INK, "currentColor"))


class Drawn(SphinxDirective):
    """Show a figure with the caption that is the directive's content."""

    required_arguments = 1
    has_content = True
    option_spec: ClassVar[dict[str, Callable[[str], str]]] = {"alt": directives.unchanged_required}

    def run(self) -> list[nodes.Node]:
        """Return the figure inline, so that it follows the colours of the page."""
        for source in SOURCES:
            self.env.note_dependency(str(source))
        svg = svg_of(self.arguments[0])
        width = float(svg.partition('viewBox="0 0 ')[2].split()[0]) / 12  # in letters of 12 points
        style = f'style="--wide: {width:.0f}em"'
        picture = f'<div class="drawn" role="img" {style} aria-label="{self.options["alt"]}">{svg}</div>'
        figure = nodes.figure("", nodes.raw("", picture, format="html"))
        caption = nodes.caption()
        self.state.nested_parse(self.content, self.content_offset, paragraphs := nodes.Element())
        caption += paragraphs.children[0].children
        figure += caption
        return [figure]


def setup(app: Sphinx) -> dict[str, bool]:
    """Register the directive."""
    app.add_directive("drawn", Drawn)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
