"""The directive `source-exercises SOURCE`: the exercises of a source, each with its solution folded.

The questions are those of lab/extensions/reproduction/exercises; the solutions are computed while the pages are built.
"""

from collections.abc import Iterator

from docutils import nodes
from sphinx.application import Sphinx
from sphinx.util.docutils import SphinxDirective
from stored_rows import table_of

from lab.extensions.reproduction.item import Exercise, Item, source_named
from lab.extensions.reproduction.reproduction_result import solution_of
from lab.report.document import Document, Matrices, Table, plain
from lab.report.terminal import to_text


class SourceExercises(SphinxDirective):
    """Show the exercises of a source in its order."""

    required_arguments = 1

    def run(self) -> list[nodes.Node]:
        """Return the questions with what is given, and their folded solutions."""
        items = source_named(self.arguments[0]).items
        return [node for item in items if item.exercise is not None for node in shown(item, item.exercise)]


def shown(item: Item, exercise: Exercise) -> Iterator[nodes.Node]:
    """Return one exercise."""
    yield nodes.rubric(text=f"{item.number}: {item.title}")
    yield nodes.paragraph(text=exercise.question)
    if exercise.given:
        yield _list(nodes.bullet_list(bullet="*"), exercise.given)
    if exercise.table:
        yield table_of(exercise.table[0], exercise.table[1:], [1] * len(exercise.table[0]))
    yield nodes.raw("", "<details><summary>Solution</summary>", format="html")
    yield _list(nodes.enumerated_list(), exercise.steps)
    for block in solution_of(item.answers()):
        if isinstance(block, Matrices) and block.matrices:
            text = to_text(Document("", (block,)), 100).strip("\n")
            yield nodes.literal_block(text, text, language="text")
        elif isinstance(block, Table) and block.rows:
            rows = [
                (name, f"`{text}`", unit) for name, text, unit in ([plain(cell) for cell in row] for row in block.rows)
            ]
            wide = 3 if any(unit for *_, unit in rows) else 2
            yield table_of(block.headings[:wide], [row[:wide] for row in rows], (40, 45, 15)[:wide])
    yield nodes.raw("", "</details>", format="html")


def _list(found: nodes.Element, texts: tuple[str, ...]) -> nodes.Element:
    found += [nodes.list_item("", nodes.paragraph(text=text)) for text in texts]
    return found


def setup(app: Sphinx) -> dict[str, bool]:
    """Register the directive."""
    app.add_directive("source-exercises", SourceExercises)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
