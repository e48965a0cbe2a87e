"""Entries of the index by which the search finds a page under words that are not in its title (docs/search.toml)."""

import tomllib
from pathlib import Path

from docutils import nodes
from sphinx import addnodes
from sphinx.application import Sphinx

TERMS = Path(__file__).parents[1] / "search.toml"


def terms() -> dict[str, list[str]]:
    """Return the words by page."""
    found: dict[str, list[str]] = tomllib.loads(TERMS.read_text(encoding="utf-8"))
    return found


def add_entries(app: Sphinx, doctree: nodes.document) -> None:
    """Put the entries of a page at its top."""
    words = terms().get(app.env.docname, [])
    if words:
        app.env.note_dependency(str(TERMS))
        section = next(iter(doctree.findall(nodes.section)), doctree)
        target = nodes.target("", "", ids=["search-terms"])
        entries = [("single", word, "search-terms", "main", None) for word in words]  # main: ranked with titles
        section.insert(1, [addnodes.index(entries=entries), target])


def setup(app: Sphinx) -> dict[str, bool]:
    """Connect before the index is collected."""
    app.connect("doctree-read", add_entries, priority=100)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
