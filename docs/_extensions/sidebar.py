"""The sidebar without the pages of single objects and commands: their lists are on the pages above them."""

import os
import re
from pathlib import Path
from typing import Any

from sphinx.application import Sphinx

HIDDEN = ("reference/interface/", "reference/commands/")


def without_hidden(tree: str, page: str) -> str:
    """Return a page's navigation tree without the entries of the hidden folders.

    Args:
        tree: as Sphinx renders it, with addresses relative to the page.
        page: the page's name.
    """
    for folder in HIDDEN:
        way = os.path.relpath(folder, Path(page).parent) + "/"
        start = "" if way == "./" else re.escape(way)
        entry = rf'<li class="toctree-l3[^"]*"><a [^>]*href="{start}[^"/]*"[^>]*>.*?</a></li>\s*'
        tree = re.sub(entry, "", tree, flags=re.DOTALL)
    return re.sub(r"<ul[^>]*>\s*</ul>", "", tree)


def prune(app: Sphinx, pagename: str, templatename: str, context: dict[str, Any], doctree: object) -> None:
    """Let the theme have a tree without them."""
    if whole := context.get("toctree"):
        context["toctree"] = lambda **options: without_hidden(whole(**options), pagename)


def setup(app: Sphinx) -> dict[str, bool]:
    """Connect before the theme asks for the tree."""
    app.connect("html-page-context", prune, priority=400)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
