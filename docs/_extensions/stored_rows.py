"""Tables of stored rows: `source-rows`, of docs/reference/source_rows.toml, and `stored-rows`, of docs/results/stored.

`source-rows` lists what the four sources ask for. `stored-rows NAME` shows figures that
scripts/experiments/stored_results.py has measured, with their commands (option `commands`), and below them when and on
which machine. `stored-document NAME` shows what scripts/experiments/NAME.py has stored, as that script prints it.
"""

import json
import sys
import tomllib
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from importlib import import_module
from math import floor, log10
from pathlib import Path
from typing import Any, ClassVar

from docutils import nodes
from docutils.parsers.rst import directives
from sphinx.application import Sphinx
from sphinx.util.docutils import SphinxDirective

from lab.extensions.reproduction.item import Item, source_named
from lab.report.markdown import to_markdown

DOCS = Path(__file__).parents[1]
ROWS, STORED = DOCS / "reference" / "source_rows.toml", DOCS / "results" / "stored"
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


class SourceRows(SphinxDirective):
    """Show the rows as a table."""

    def run(self) -> list[nodes.Node]:
        """Return one table, a row without a test as missing."""
        self.env.note_dependency(str(ROWS))
        rows = (
            (
                row.source,
                row.row,
                row.shown_by and f"`{row.shown_by}`",
                f"`{row.held_by}`" if row.held_by else "missing",
            )
            for row in source_rows()
        )
        return [table_of(HEADINGS, rows, (8, 32, 26, 34), "reference sources")]


def table_of(
    titles: Sequence[str], rows: Iterable[Sequence[str]], widths: Sequence[int], kind: str = "reference"
) -> nodes.table:
    """Return a table of texts; what is between backticks is code."""
    table, group = nodes.table(classes=kind.split()), nodes.tgroup(cols=len(titles))
    group += [nodes.colspec(colwidth=width) for width in widths]
    head, body = nodes.thead(), nodes.tbody()
    head += _row(titles)
    body += [_row(row) for row in rows]
    group += [head, body]
    table += group
    return table


def _row(texts: Sequence[str]) -> nodes.row:
    row = nodes.row()
    for text in texts:
        parts = text.split("`")
        cell = [nodes.literal(text=part) if i % 2 else nodes.Text(part) for i, part in enumerate(parts) if part]
        row += nodes.entry("", nodes.paragraph("", "", *cell))
    return row


def stored_table(name: str) -> dict[str, Any]:
    """Return the columns and rows of a stored table."""
    found: dict[str, Any] = json.loads((STORED / f"{name}.json").read_text(encoding="utf-8"))
    return found


def shown(value: Any, form: str) -> str:
    """Return a stored value as a table shows it; a list is a value and its range, or a range."""
    if value is None or isinstance(value, str | int):
        return "" if value is None else str(value)
    if isinstance(value, list):
        *middle, low, high = (shown(each, form) for each in value)
        return f"{middle[0]} ({low} to {high})" if middle else f"{low} to {high}"
    if form.endswith("g"):  # so many digits, the last ones zeros too, and no power of ten
        digits, size = int(form.strip(",.g")), floor(log10(abs(value))) + 1 if value else 1
        return f"{value:,.{max(digits - size, 0)}f}"
    return format(value, form).replace("%", " %")


def cells(table: Mapping[str, Any]) -> list[tuple[str, ...]]:
    """Return the texts of all rows."""
    return [
        (_code_of_flags(row["name"]), *(shown(row.get(each["key"]), each["format"]) for each in table["columns"]))
        for row in table["rows"]
    ]


def _code_of_flags(text: str) -> str:
    """Return a name with its flags, or as a whole where it is a command, between backticks."""
    if text.startswith("lab "):
        return f"`{text}`"
    before, flag, after = text.partition("--")
    end = min((at for at in (after.find(";"), after.find(" (")) if at >= 0), default=len(after))
    return f"{before}`--{after[:end]}`{after[end:]}" if flag else text


def recorded(table: Mapping[str, Any], name: str) -> str:
    """Return when, and on which machines, the rows were measured, and what measures them anew."""
    groups = dict[str, list[Mapping[str, Any]]]()
    for row in table["rows"]:
        groups.setdefault(row["machine"], []).append(row)
    sentences = list[str]()
    for machine, rows in groups.items():
        dates = " and ".join(sorted({row["date"] for row in rows}))
        some = f", {len(rows)} {'row' if len(rows) == 1 else 'rows'}" if len(groups) > 1 else ""
        load = max(row.get("other_processes", 0) for row in rows)
        beside = f", with up to {load:.0f} other processes beside" if load >= 1 else ""
        sentences.append(f"{dates}{some}: {machine}{beside}.")
    return f"{' '.join(sentences)} `python scripts/experiments/stored_results.py --only '{name}:*'` measures them anew."


class StoredRows(SphinxDirective):
    """Show a stored table."""

    required_arguments = 1
    option_spec: ClassVar[dict[str, Callable[[str], Any]]] = {"commands": directives.flag}

    def run(self) -> list[nodes.Node]:
        """Return the table, its commands where they are wanted, and where its figures are from."""
        name = self.arguments[0]
        self.env.note_dependency(str(STORED / f"{name}.json"))
        table = stored_table(name)
        titles = [table["first"], *(each["title"] for each in table["columns"])]
        widths = [34, *([66 // (len(titles) - 1)] * (len(titles) - 1))]
        found: list[nodes.Node] = [table_of(titles, cells(table), widths, "figures")]
        if "commands" in self.options:
            text = "\n".join(dict.fromkeys(row["command"] for row in table["rows"] if row["command"]))
            found.append(nodes.literal_block(text, text, language="text"))
        paragraph = nodes.paragraph(classes=["recorded"])
        parts = recorded(table, name).split("`")
        paragraph += [nodes.literal(text=part) if i % 2 else nodes.Text(part) for i, part in enumerate(parts) if part]
        return [*found, paragraph]


class StoredDocument(SphinxDirective):
    """Show the stored values of a script in its own tables."""

    required_arguments = 1

    def run(self) -> list[nodes.Node]:
        """Return the document without its title."""
        name = self.arguments[0]
        self.env.note_dependency(str(STORED / f"{name}.json"))
        if (experiments := str(DOCS.parent / "scripts" / "experiments")) not in sys.path:
            sys.path.append(experiments)
        document = import_module(name).document(stored_table(name))
        return self.parse_text_to_nodes(to_markdown(document).partition("\n\n")[2], allow_section_headings=True)


def setup(app: Sphinx) -> dict[str, bool]:
    """Register the directives."""
    app.add_directive("source-rows", SourceRows)
    app.add_directive("stored-rows", StoredRows)
    app.add_directive("stored-document", StoredDocument)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
