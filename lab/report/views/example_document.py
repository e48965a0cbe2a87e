"""Document of the measurements of real robots that come with the lab."""

from lab.library.example import ExampleResult
from lab.report.document import Bullets, Code, CommandText, Document, Paragraph, Section, Table

__all__ = ["example_document"]


def example_document(result: ExampleResult) -> Document:
    """Build the list of examples, or the document of the one that was named."""
    if result.options.name is None:
        rows = tuple(
            (each.name, each.robot, each.measured, f"{each.rows:,}", f"{each.size_bytes / 1e3:.0f} kB",
             each.licence_name) for each in result.examples
        )  # fmt: skip
        columns = ("example", "robot", "what was measured", "rows", "size", "licence")
        sources = Bullets(tuple(f"{each.name}: {each.source}" for each in result.examples))
        steps = tuple(CommandText(f"lab example {each.name}\n{each.command()}") for each in result.examples)
        return Document(
            "Measurements of real robots that come with the lab",
            (Table(columns, rows), Section("Sources", (sources,)), Section("Write one here, and identify", steps)),
        )
    (example,) = result.examples
    facts = (
        f"Robot: {example.robot}", f"Measured: {example.measured}", f"Rows: {example.rows:,}",
        f"Licence: {example.licence_name}", f"Source: {example.source}",
    )  # fmt: skip
    if not result.files:
        return Document(f"Example {example.name}", (Bullets(facts),))
    written = Bullets(tuple((Code(str(file)),) for file in result.files))
    command = CommandText(example.command(result.files[0].parent))
    return Document(
        f"Example {example.name}",
        (Bullets(facts), Section("Written", (written,)), Section("Next", (Paragraph("Identify the robot:"), command))),
    )
