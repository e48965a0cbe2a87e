"""A document as one HTML file that needs nothing but itself: no script, no network, the same bytes each time.

It is made for wide screens, phones, dark screens and paper. The template escapes whatever is not markup already:
names of robots, targets, files and poses are a user's.
"""

import gc
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from pathlib import Path

from jinja2 import Environment, FileSystemLoader, StrictUndefined
from markupsafe import Markup

from lab.render import style
from lab.render.document import Badge, Code, Document, Picture, inlines, shown

__all__ = ["to_html"]


def to_html(document: Document) -> str:
    """The whole page; its heading is the document's title."""
    blocks = list(shown(document.blocks, "page"))
    with _collector_paused():
        return _environment().get_template("page.html.jinja").render(title=document.title, blocks=blocks)


@contextmanager
def _collector_paused() -> Iterator[None]:
    """Without garbage collections: a figure makes so many objects that each would walk through all of them anew."""
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
    environment.filters |= {"inlines": inlines, "svg": _svg}
    environment.tests |= {"badge": lambda part: isinstance(part, Badge), "code": lambda part: isinstance(part, Code)}
    environment.globals |= {
        "light": style.PAGE_LIGHT,
        "dark": style.PAGE_DARK,
        "sans": Markup(style.FONT_SANS),
        "mono": Markup(style.FONT_MONO),
    }
    return environment


def _svg(picture: Picture) -> Markup:
    from lab.render.svg import inline_svg  # slow to import, as all that draws

    return inline_svg(picture)
