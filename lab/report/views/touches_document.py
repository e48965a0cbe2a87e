"""Document of daily touches of a socket."""

from lab.core.errors import counted
from lab.core.limits import called
from lab.core.number_text import sentence, short
from lab.core.significance import TREND_YEAR
from lab.core.units import MM
from lab.library.touch_verification import TouchesResult
from lab.report import document as doc
from lab.report.blocks import verdict_badge

__all__ = ["touches_document"]

_ADVICE = {
    "joint": "set that zero anew, or calibrate anew; then begin with --since the first check after it",
    "socket": "fasten the socket; the arm is as it was. Begin with --since the first check after it",
    "base": "fasten the base, or teach the frames anew; then begin with --since the first check after it",
    "tool": "replace the tool, or measure it anew; then begin with --since the first check after it",
    "touch": "clean ball and socket, and repeat the check tomorrow",
}


def touches_document(result: TouchesResult) -> doc.Document:
    """Build the document: what moved, what is told apart, and what the checks found."""
    change = None if result.findings else result.scan.change  # misread touches show no change
    name = called(result.calibrated.robot.name, result.serial)
    blocks: list[doc.Block] = [
        doc.Paragraph((verdict_badge(result.verdict), f" {sentence(result.words())} An unchanged arm raises an alarm "
                       f"in at most {100 * TREND_YEAR:g} % of the years.")),
        doc.Paragraph(
            f"{counted(len(result.dates), 'check')} from {result.dates[0]} to {result.dates[-1]}, in "
            f"{counted(result.errors.shape[1], 'configuration')}; a touch repeats to "
            f"{short(MM.of(result.repeatability_m))} mm (1σ along an axis).",
            "note",
        ),
    ]  # fmt: skip
    if change is not None and len(change.candidates) == 1 and change.explained:
        blocks.append(doc.Paragraph(sentence(_ADVICE[change.candidates[0].cause.kind])))
    elif change is not None:
        blocks.append(doc.Paragraph("Repeat the check: each further one tells the causes apart better."))
    blocks += [doc.Warnings(result.warnings), doc.Section("What these configurations tell", _told(result))]
    return doc.Document(f"{name}: daily check of {result.dates[-1]}", tuple(blocks))


@doc.guarded
def _told(result: TouchesResult) -> tuple[doc.Block, ...]:
    rows: list[doc.Row] = []
    for each in result.distinctions:
        unit = result.unit(each.cause)
        same = ", ".join(result.called(kind, name) for kind, name in each.confounded)
        named = "–" if each.confounded else short(unit.of(each.named))
        what = sentence(result.called(each.cause.kind, each.cause.name)).rstrip(".")
        rows.append((what, short(unit.of(each.detected)), named, unit.name, same))
    columns = ("cause", "found by the next check", "told apart within three", "unit", "cannot be told from")
    note = (
        "Smallest changes that are found, and told from every other cause, in 95 of 100 cases. Causes that move the "
        "errors alike are named together; another configuration or a second socket tells some of them apart."
    )
    return doc.Table(columns, tuple(rows)), doc.Paragraph(note, "note")
