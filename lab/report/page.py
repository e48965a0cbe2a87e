"""Render a document as one HTML file that needs no network; the same document gives the same bytes.

It is made for wide screens, phones, dark screens and paper, and reads without its script, which sorts tables. The
template escapes all text that is not markup: names of robots, targets, files and poses are a user's.
"""

import gc
import re
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from typing import Any

from jinja2 import Environment, FileSystemLoader, StrictUndefined
from markupsafe import Markup, escape

from lab.core.gaps import attempted
from lab.core.number_text import sentence
from lab.report import document as doc
from lab.report import style
from lab.report.document import inlines, plain, shown
from lab.report.style import explained

__all__ = ["to_html"]

_FEWEST_SECTIONS = 4  # of a page that has a table of contents and a glossary
_MOST_ROWS = 15  # of a table that is not folded
_MOST_WARNINGS = 3  # that are not folded


def to_html(document: doc.Document) -> str:
    """The whole page; its heading is the document's title."""
    blocks = list(shown(document.blocks, "page"))
    sections = [each.title for each in blocks if isinstance(each, doc.Section)]
    with _collector_paused():
        return (
            _environment()
            .get_template("page.html.jinja")
            .render(
                title=document.title,
                mark=document.mark,
                blocks=blocks,
                contents=sections if len(sections) >= _FEWEST_SECTIONS else [],
                glossary=explained(_texts(blocks)) if len(sections) >= _FEWEST_SECTIONS else (),
                most_rows=_MOST_ROWS,
                scenes=any(map(_has_scene, blocks)),
                most_warnings=_MOST_WARNINGS,
            )
        )


def _has_scene(block: doc.Block) -> bool:
    return isinstance(block, doc.Scene) or (isinstance(block, doc.Section) and any(map(_has_scene, block.blocks)))


def _texts(blocks: Iterable[doc.Block]) -> Iterator[str]:
    for each in blocks:
        if isinstance(each, doc.Section):
            yield each.title
            yield from _texts(each.blocks)
        elif isinstance(each, doc.Paragraph):
            yield plain(each.text)
        elif isinstance(each, doc.Card):
            yield each.about
            yield from _texts(each.figures)
        elif isinstance(each, doc.Bullets):
            yield from map(plain, each.items)
        elif isinstance(each, doc.Table):
            yield from (each.caption, *each.headings)
            yield from (plain(cell) for row in each.rows for cell in row)
        elif isinstance(each, doc.Figure | doc.Scene):
            yield each.caption


@contextmanager
def _collector_paused() -> Iterator[None]:
    """Pause garbage collection: a figure makes so many objects that each collection would walk through all of them."""
    running = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if running:
            gc.enable()


@cache
def _environment() -> Environment:
    environment = Environment(
        loader=FileSystemLoader(Path(__file__).parent),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters |= {
        "inlines": inlines,
        "svg": _svg,
        "dates": _dates,
        "scene_of": _scene_of,
        "chart_colours": _chart_colours,
    }
    environment.tests |= {
        "badge": lambda part: isinstance(part, doc.Badge),
        "code": lambda part: isinstance(part, doc.Code),
    }
    environment.globals |= {
        "light": style.PAGE_LIGHT,
        "dark": style.PAGE_DARK,
        "dark_charts": style.DARK_CHARTS,
        "sans": Markup(style.FONT_SANS),
        "mono": Markup(style.FONT_MONO),
    }
    return environment


def _dates(text: str) -> Markup:
    """Text with its dates marked as such, which no line breaks in."""
    return Markup(re.sub(r"\b\d{4}-\d\d-\d\d\b", r"<time>\g<0></time>", str(escape(text))))


def _chart_colours(body: str) -> list[str]:
    """The colours ``#rrggbb`` of a page's charts, which are variables of its style."""
    return [f"#{colour}" for colour in sorted(set(re.findall(r"var\(--c-([0-9a-f]{6})\)", body)))]


def _svg(picture: doc.Picture) -> Markup:
    from lab.report.charts.chart import inline_svg  # slow to import, as all that draws

    return attempted(f"the figure '{picture.name}'", lambda: inline_svg(picture), _gap)


def _gap(missing: str) -> Markup:
    return Markup('<p class="note">{}</p>').format(sentence(missing))


def _scene_of(block: doc.Scene) -> tuple[Any, Markup]:
    """The scene of a block, and what a script reads of it; None, and what stands in its place, if it fails."""

    def made() -> tuple[Any, Markup]:
        from lab.report.page_scene import scene_json  # which imports MuJoCo

        scene = block.make()
        return scene, scene_json(scene)

    return attempted(f"the scene '{block.name}'", made, lambda missing: (None, _gap(missing)))
