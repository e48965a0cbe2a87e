"""What a person reads of a verification."""

from lab.commands.provenance import provenance_section
from lab.commands.verify.result import VerificationResult
from lab.core.serials import called
from lab.core.significance import VERIFICATION
from lab.render.document import (
    PAGE,
    TERMINAL,
    Badge,
    Block,
    Column,
    Document,
    Figure,
    Paragraph,
    Picture,
    Section,
    Table,
    Warnings,
)
from lab.render.format import sentence, short
from lab.render.phrases.registry import phrase
from lab.render.plots import Spread, histograms
from lab.render.style import AFTER, BEFORE, PREDICTED

__all__ = ["errors_picture", "verification_document"]

MOST_HYPOTHESES = 20  # that are listed
_ADVICE = {
    "base": "--refit base says where it is now, and whether the rest of the arm is good",
    "tool": "--refit tool says where it is now, and whether the rest of the arm is good",
    "joint": "set that zero anew, or calibrate anew",
    "reading": "measure that pose again, or mark its row use = skip",
}


def verification_document(result: VerificationResult) -> Document:
    """The verdict and its test, the errors, what may have changed, and the minimum detectable change."""
    found, robot = result.verified, result.calibrated.robot
    verdict = "within the predicted error" if found.good else "beyond the predicted error"
    rate = f"(an unchanged arm fails this test in {100 * VERIFICATION:g} % of all cases)"
    return Document(
        f"{called(robot.name, result.serial)}: {verdict}",
        (
            Paragraph((Badge("good" if found.good else "bad", "good" if found.good else "bad"), f" {rate}")),
            Paragraph(sentence(phrase(found.check)), "lead"),
            Paragraph(f"The run that calibrated the arm is {result.calibrated.result.words}."),
            Warnings(result.warnings),
            Section("Errors, observed and predicted", (*_errors(result), _histogram(result))),
            Section("What alone would explain it", (_hypotheses(result), *_advice(result))),
            Section("What was fitted anew", (_refitted(result),)),
            Section("Minimum detectable change", (_detectable(result),) if found.good else ()),
            provenance_section("verify", result.options, robot.sha256, result.serial),
        ),
    )


def errors_picture(result: VerificationResult) -> Picture:
    """The observed errors as a histogram, with their root mean square and the predicted one."""
    found = result.verified
    observed = float(result.observed_mm["rms"]) / 1e3
    spreads = [
        Spread(found.errors, AFTER if found.good else BEFORE, ("observed: rms", observed)),
        Spread(found.errors[:0], PREDICTED, ("predicted: rms", found.promised_m)),
    ]
    return histograms("errors", spreads, "position error")


def _errors(result: VerificationResult) -> tuple[Block, ...]:
    observed, measured = result.observed_mm, result.measurements
    numbers = [short(observed[key]) for key in ("mean", "rms", "p95", "max")]
    rows = (
        ("observed", *numbers, f"{observed['count']:,}"),
        ("predicted", "", short(1e3 * result.verified.promised_m), "", "", ""),
    )
    below = (
        f"{len(measured)} new poses, targets {', '.join(measured.targets)}, against the run "
        f"{result.calibrated.folder}. Predicted: what the calibration's covariance and the instrument's noise let one "
        "expect here."
    )
    return Table(("", "mean", "rms", "95 %", "max", "points"), rows, "Position error, mm"), Paragraph(below, "note")


def _histogram(result: VerificationResult) -> Figure:
    caption = "The errors of the new measurements, with their root mean square and the predicted one. Logarithmic axis."
    return Figure("errors-figure", (errors_picture(result),), caption)


def _hypotheses(result: VerificationResult) -> Table:
    listed = result.verified.hypotheses
    rows = tuple(
        (phrase(each.check), short(each.chi2), _chance(each.p), short(each.bic), "yes" if each.explains else "no")
        for each in listed
    )
    kinds = tuple("" if each.explains else "quiet" for each in listed)
    columns = ("what may have changed, the best first", "χ² left", "p", Column("BIC"), "explains it")
    return Table(columns, rows, row_kinds=kinds, most_rows=MOST_HYPOTHESES)


def _chance(p: float) -> str:
    return short(p) if p > 0 else "< 1e-300"


def _advice(result: VerificationResult) -> tuple[Block, ...]:
    """What to do where one thing alone has changed, and the first sentence does not say so."""
    moved = () if result.verified.situation is not None else result.verified.moved
    return (Paragraph(sentence(_ADVICE[moved[0]]), shown_in=PAGE | TERMINAL),) if len(moved) == 1 else ()


def _refitted(result: VerificationResult) -> Table:
    rows = tuple(
        (
            name,
            *(
                short(1e3 * size) if size == size else "–"
                for size in (moved.shift_m, moved.shift_std_m, moved.turn_rad, moved.turn_std_rad)
            ),
        )
        for name, moved in result.verified.refit
    )
    return Table(("", "moved by, mm", "1σ", "turned by, mrad", "1σ"), rows)


def _detectable(result: VerificationResult) -> Table:
    """What the test would have detected, with its unit."""
    rows = tuple((name, short(size), unit) for name, unit, size in result.detectable if size < float("inf"))
    caption = "In 95 of 100 such files the test would detect it if one of these were off by"
    return Table(("", "by", "unit"), rows, caption)
