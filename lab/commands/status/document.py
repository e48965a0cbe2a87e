"""What a person reads of the state of the arms."""

from collections import Counter
from collections.abc import Mapping
from typing import Literal

from lab.commands.provenance import provenance_section
from lab.commands.status.arm import FEWEST_CHECKS, STATES, ArmStatus
from lab.commands.status.figures import checks_picture
from lab.commands.status.history import Check
from lab.commands.status.result import StatusResult
from lab.commands.trend.document import change_words
from lab.core.wording import counted
from lab.render.document import (
    EVERYWHERE,
    PAGE,
    Badge,
    Bullets,
    Code,
    Column,
    Document,
    Figure,
    Inline,
    Paragraph,
    Row,
    Section,
    Table,
    Text,
    Warnings,
)
from lab.render.format import digits_of, fixed, plus_minus, short

__all__ = ["status_document"]

_KINDS: Mapping[str, Literal["good", "doubtful", "bad", "open"]] = {
    "good": "good",
    "due": "doubtful",
    "doubtful": "doubtful",
    "bad": "bad",
}
_MOST_DIGITS = 6


def status_document(result: StatusResult) -> Document:
    """The count of each state, a row for each arm, the checks over time, changes, and what was left out."""
    counts = Counter(each.state for each in result.arms)
    said = ", ".join(f"{counts[state]} {state}" for state in reversed(STATES) if counts[state])
    lead = tuple(_badges(counts))
    caption = (
        "Every check of every arm: a stroke is a calibration, its mark and those between the strokes the verdicts. The "
        f"dotted line is {result.on}."
    )
    return Document(
        f"{counted(len(result.arms), 'arm')} on {result.on}: {said}" if result.arms else "no arm",
        (
            Paragraph(lead, "lead"),
            Warnings(result.warnings),
            Section("The arms", (_arms(result), Paragraph(_explained(result), "note", shown_in=PAGE))),
            Section("The checks over time", (Figure("checks", (checks_picture(result),), caption),)),
            Section("Changes between calibrations", (Bullets(tuple(_changes(each) for each in result.arms)),)),
            provenance_section("status", result.options, result.model_sha256),
        ),
    )


def _badges(counts: Mapping[str, int]) -> list[Inline]:
    parts: list[Inline] = []
    for state in reversed(STATES):
        if counts.get(state):
            parts += [Badge(f"{counts[state]} {state}", _KINDS.get(state, "open")), " "]
    return parts


def _arms(result: StatusResult) -> Table:
    on_page = ("verdict", "error then", "slope, mm a year")  # a terminal has no room for these
    headings = (
        "state", "arm", "calibrated", "verdict", "verified", "verdict", "error then", "error now", "slope, mm a year",
        "next due",
    )  # fmt: skip
    columns = tuple(Column(each, PAGE if each in on_page else EVERYWHERE) for each in headings)
    return Table(columns, tuple(_row(each) for each in result.arms), "Mean position errors, mm", most_rows=200)


def _row(arm: ArmStatus) -> Row:
    slope = arm.slope
    words = "–"
    if slope is not None:
        digits = digits_of(slope.half_width, _MOST_DIGITS)
        words = f"{fixed(slope.per_year, digits, signed=True)} {plus_minus(slope.half_width, digits)}"
    return (
        Badge(arm.state, _KINDS.get(arm.state, "open")),
        Code(arm.called),
        *_checked(arm.calibration),
        *_checked(arm.verification),
        _length(arm.error_then_mm),
        _length(arm.error_now_mm),
        words,
        "–" if arm.due is None else arm.due.isoformat(),
    )


def _checked(check: Check | None) -> tuple[Text, Text]:
    if check is None or check.on is None:
        return "–", "–"
    return check.on.isoformat(), check.verdict


def _length(value: float | None) -> str:
    return "–" if value is None else short(value)


def _explained(result: StatusResult) -> str:
    return (
        "The state is the verdict of the last verification of the last calibration, or of that itself. An arm is due "
        f"{counted(result.options.every_days, 'day')} after its last check, a bad one at once. Error then: at "
        "validation of the last calibration; now: at its last verification. The slope needs "
        f"{FEWEST_CHECKS} verifications of one calibration; its interval is 95 %."
    )


def _changes(arm: ArmStatus) -> Text:
    """What changed between the calibrations of an arm, in the words of its trend."""
    if arm.trend is None:
        return ""
    if not arm.trend.changes:
        return f"{arm.called}: no change in {len(arm.trend.runs)} calibrations."
    count, said = len(arm.trend.changes), change_words(arm.trend, arm.trend.changes[-1])
    earlier = "" if count == 1 else f" The last of {count} changes in {len(arm.trend.runs)} calibrations (lab trend)."
    return f"{arm.called}: {said}{earlier}"
