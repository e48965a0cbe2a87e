"""What a person reads of a plan that was checked again."""

from lab.commands.design.check import PlanCheckResult
from lab.commands.provenance import provenance_section
from lab.render.document import Badge, Document, Paragraph, Section, Table, Warnings

__all__ = ["check_document"]


def check_document(result: PlanCheckResult) -> Document:
    """Whether the plan can be run, what is wrong with it, and how long the day takes."""
    count = len(result.faults)
    cell = f" in {result.options.cell}" if result.options.cell else ""
    badge = Badge("the plan can be run", "good") if not count else Badge("the plan cannot be run", "bad")
    said = (
        f" All {len(result.stops)} stops and the ways between them are free{cell}."
        if not count
        else f" {count} of {len(result.stops)} stops{cell} are not allowed, or the way to them is not; plan anew."
    )
    rows = tuple((fault.stop, fault.why) for fault in result.faults)
    return Document(
        f"{result.robot.name}: {badge.text}",
        (
            Paragraph((badge, f".{said}"), "lead"),
            Warnings(result.warnings),
            Section("Faults", (Table(("stop", "why"), rows),)),
            Section("The day", (Paragraph(result.day.words),)),
            provenance_section("design", result.options, result.robot.sha256),
        ),
    )
