"""The directive `gallery`: thumbnails of the pictures that docs/gallery.toml lists, each with its page and command."""

import tomllib
from html import escape
from pathlib import Path

from docutils import nodes
from drawn import svg_of
from sphinx.application import Sphinx
from sphinx.util.docutils import SphinxDirective

ENTRIES = Path(__file__).parents[1] / "gallery.toml"


def gallery_entries() -> list[dict[str, str]]:
    """Return the entries in their order: title, page, and picture with its command or drawn figure."""
    found: list[dict[str, str]] = tomllib.loads(ENTRIES.read_text(encoding="utf-8"))["entry"]
    return found


class Gallery(SphinxDirective):
    """Show the entries as a grid."""

    def run(self) -> list[nodes.Node]:
        """Return the grid."""
        self.env.note_dependency(str(ENTRIES))
        grid = nodes.container(classes=["gallery"])
        for entry in gallery_entries():
            card = nodes.container(classes=["entry"])
            title, link = escape(entry["title"]), f"{escape(entry['page'])}.html"
            if "drawn" in entry:
                card += nodes.raw(
                    "", f'<div class="drawn" aria-hidden="true">{svg_of(entry["drawn"])}</div>', format="html"
                )
            else:
                (picture,) = (ENTRIES.parent / "pictures").glob(f"{entry['picture']}.*")
                card += nodes.image(uri=f"pictures/{picture.name}", alt=entry["title"])
            card += nodes.raw("", f'<p><a href="{link}">{title}</a></p>', format="html")
            if made := entry.get("command", entry.get("made_by")):
                card += nodes.paragraph("", "", nodes.literal(text=made))
            grid += card
        return [grid]


def setup(app: Sphinx) -> dict[str, bool]:
    """Register the directive."""
    app.add_directive("gallery", Gallery)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
