"""The report of a verification, one page: is the arm still good, and what may have moved.

It draws with matplotlib, which is slow to import: import this module where a report is written.
"""

from pathlib import Path
from typing import Any

from lab.commands.calibrate.figures import PROMISED, Spread, histograms
from lab.commands.provenance import how_it_was_made
from lab.commands.verify.options import VerifyOptions
from lab.commands.verify.result import verification_summary
from lab.commands.verify.run import VerifiedRun
from lab.render.html import (
    AFTER,
    BEFORE,
    Html,
    badge,
    capital,
    figure,
    paragraph,
    section,
    short,
    table,
    together,
    warnings_box,
    write_page,
)

MOST_LISTED = 20  # hypotheses


def write_verification_report(path: Path, run: VerifiedRun, options: VerifyOptions) -> None:
    """Write the report of ``lab verify``."""
    result = verification_summary(run)
    title = f"{result['robot']}: {'still good' if result['good'] else 'no longer good'}"
    test = f"tested so that an arm that is as it was fails {100 * result['level']:g} times in a hundred"
    parts = [
        paragraph(f"{capital(result['words'])}.", "lead"),
        paragraph(together([badge("good" if result["good"] else "bad"), test])),
        warnings_box(result["warnings"]),
        section("Errors, observed and promised", [_errors(result), _histogram(run)]),
        section("What alone would explain it", [_hypotheses(result)]),
        section("What was fitted anew", [_refit(result)]),
        section("What would have been noticed", [_would_notice(result)] if result["good"] else []),
        how_it_was_made("verify", options, run.calibrated.robot.sha256),
    ]
    write_page(path, title, parts)


def _errors(result: dict[str, Any]) -> Html:
    observed = result["observed_mm"]
    numbers = [short(observed[key]) for key in ("mean", "rms", "p95", "max")]
    rows = [
        ["observed", *numbers, f"{observed['count']:,}"],
        ["promised", "", short(result["promised_mm"]), "", "", ""],
    ]
    below = (
        f"{result['poses']} new poses, targets {', '.join(result['targets'])}, against the run {result['run']}. "
        "Promised: what that calibration and the instrument's noise make one expect here."
    )
    caption = "Position error, mm"
    header = ["", "mean", "rms", "95 %", "max", "points"]
    return together([table(header, rows, caption), paragraph(below, "note")])


def _histogram(run: VerifiedRun) -> Html:
    found = run.verified
    colour = AFTER if found.good else BEFORE
    spreads = [
        Spread(found.errors, colour, ("observed: rms", verification_summary(run)["observed_mm"]["rms"] / 1e3)),
        Spread(found.errors[:0], PROMISED, ("promised: rms", found.promised_m)),
    ]
    caption = "The errors of the new measurements, with their root mean square and the promised one. Logarithmic axis."
    return figure("errors-figure", [histograms("errors", spreads, "position error")], caption)


def _hypotheses(result: dict[str, Any]) -> Html:
    rows = [
        [each["words"], short(each["chi2"]), short(each["p"]), short(each["bic"]), "yes" if each["explains"] else "no"]
        for each in result["hypotheses"][:MOST_LISTED]
    ]
    kinds = ["" if each["explains"] else "quiet" for each in result["hypotheses"][:MOST_LISTED]]
    header = ["what may have changed, the best first", "χ² left", "p", "BIC", "explains it"]
    return table(header, rows, kinds=kinds) if rows else Html("")


def _refit(result: dict[str, Any]) -> Html:
    rows = [
        [name, *(short(extent[key]) for key in ("shift_mm", "shift_std_mm", "turn_mrad", "turn_std_mrad"))]
        for name, extent in result["refit"].items()
    ]
    return table(["", "moved by, mm", "1σ", "turned by, mrad", "1σ"], rows) if rows else Html("")


def _would_notice(result: dict[str, Any]) -> Html:
    """What the test would have found, by its name, with its unit at the end."""
    sizes = {name.rpartition("_")[::2]: size for name, size in result["would_notice"].items()}
    rows = [[name, short(size), unit] for (name, unit), size in sizes.items() if size is not None]
    caption = "In 95 of 100 such files it would be noticed if one of these were off by"
    return table(["", "by", "unit"], rows, caption) if rows else Html("")
