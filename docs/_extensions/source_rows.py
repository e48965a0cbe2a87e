"""The directive `source-rows`: a table of what the four sources ask for, made of docs/reference/source_rows.toml."""

import tomllib
from dataclasses import dataclass
from pathlib import Path

from docutils import nodes
from docutils.parsers.rst import Directive
from sphinx.application import Sphinx

from lab.extensions.reproduction.item import Item, source_named

ROWS = Path(__file__).parents[1] / "reference" / "source_rows.toml"
ITEMS = "tests/extensions/reproduction/test_sources.py::test_every_printed_value_agrees_or_is_an_erratum"
HEADINGS = ("source", "row", "command", "test")
FURTHER = "further"  # rows of any of the sources that are not numbered in the texts


@dataclass(frozen=True)
class SourceRow:
    """One row: what a source asks for, the command that shows it, and the test that holds it.

    Attributes:
        item: number of the item of `lab reproduce` that computes it, or "".
        test: node id; "" where the lab does not have it.
    """

    source: str
    row: str
    command: str = ""
    test: str = ""
    item: str = ""

    @property
    def found(self) -> Item | None:
        """The item of `lab reproduce`."""
        if not self.item:
            return None
        return next(item for item in source_named(self.source).items if item.number == self.item)

    @property
    def shown_by(self) -> str:
        """The command: the row's own, else the item's, else `lab reproduce` of that item."""
        own = self.command or (self.found.command if self.found else "")
        if own or self.found is None:
            return own
        return f'lab reproduce {self.source} --item "{self.item}"'

    @property
    def held_by(self) -> str:
        """The test's node id, else the one of the item's test."""
        return self.test or (f"{ITEMS}[{self.source}-{self.item}]" if self.item else "")


def source_rows(path: Path = ROWS) -> list[SourceRow]:
    """Read the rows in their order."""
    return [SourceRow(**row) for row in tomllib.loads(path.read_text(encoding="utf-8"))["row"]]


class SourceRows(Directive):
    """Show the rows as a table."""

    def run(self) -> list[nodes.Node]:
        """Return one table, a row without a test as missing."""
        self.state.document.settings.record_dependencies.add(str(ROWS))
        table, group = nodes.table(), nodes.tgroup(cols=len(HEADINGS))
        group += [nodes.colspec(colwidth=width) for width in (8, 36, 28, 28)]
        head, body = nodes.thead(), nodes.tbody()
        head += _row([nodes.Text(heading) for heading in HEADINGS])
        for row in source_rows():
            shown = nodes.literal(text=row.shown_by) if row.shown_by else nodes.Text("")
            held = nodes.literal(text=row.held_by) if row.held_by else nodes.Text("missing")
            body += _row([nodes.Text(row.source), nodes.Text(row.row), shown, held])
        group += [head, body]
        table += group
        return [table]


def _row(cells: list[nodes.Node]) -> nodes.row:
    row = nodes.row()
    for cell in cells:
        row += nodes.entry("", nodes.paragraph("", "", cell))
    return row


def setup(app: Sphinx) -> dict[str, bool]:
    """Register the directive."""
    app.add_directive("source-rows", SourceRows)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
