"""The report of a run, one page that a person reads; the same seed gives the same bytes.

It draws with matplotlib, which is slow to import: import this module where a report is written.
"""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from lab.calibration.observations.kind import ObservationWords
from lab.campaign.options import VirtualCampaign
from lab.commands.calibrate.error_map import MOST_POINTS, arm_places, error_places
from lab.commands.calibrate.figures import Spread, arm_views, changes, histograms, singular_values, size_maps
from lab.commands.calibrate.options import MeasuredCampaign
from lab.commands.calibrate.report_parameters import changes_of, parameters_table
from lab.commands.calibrate.report_text import (
    errors_table,
    headline,
    identifiability,
    lead,
    outliers_section,
    trust,
)
from lab.commands.calibrate.result import parameters, summary
from lab.commands.calibrate.run import CalibrationResult
from lab.commands.provenance import how_it_was_made
from lab.render.html import (
    AFTER,
    BEFORE,
    Html,
    badge,
    capital,
    figure,
    paragraph,
    section,
    together,
    warnings_box,
    write_page,
)


def write_report(path: Path, outcome: CalibrationResult, options: VirtualCampaign | MeasuredCampaign) -> None:
    """Write the report of a run of ``lab calibrate`` or ``lab identify``."""
    result, rows = summary(outcome), changes_of(parameters(outcome))
    doubt = "the model is not adequate (below)" if result["adequate"] is False else ""
    why = "; ".join(part for part in (result["reason"], doubt) if part)
    observed = outcome.kind.words
    parts = [
        paragraph(lead(result, observed), "lead"),
        paragraph(together(["Verdict:", badge(result["verdict"]), why])),
        warnings_box(result["warnings"]),
        section("Before and after", [errors_table(result, observed), _histograms(outcome, observed)]),
        section("Where in the workspace the errors are", [_where(outcome, options, observed)]),
        trust(result),
        outliers_section(result),
        section("Parameters", [parameters_table(rows), *_changes(rows, observed, outcome.robot.chain.offset_lengths)]),
        section("What these poses tell apart", [*identifiability(result), _singular_values(outcome)]),
        section("The arm at its poses", [_arm(outcome)]),
        how_it_was_made(_command(options), options, outcome.robot.sha256),
    ]
    write_page(path, headline(result), parts)


def _command(options: VirtualCampaign | MeasuredCampaign) -> str:
    return "calibrate" if isinstance(options, VirtualCampaign) else "identify"


def _histograms(outcome: CalibrationResult, observed: ObservationWords) -> Html:
    errors = outcome.validation.errors
    if errors is None or not np.isfinite(errors.after).any():
        return Html("")
    caption = (
        "How the errors are spread. Red: before, green: after; dashed: the means. "
        "The axis is logarithmic: from one number to the next the error is ten times as large."
    )
    spreads = [
        Spread(lengths, colour, (f"{word}: mean", float(np.nanmean(lengths))))
        for word, lengths, colour in (("before", errors.before, BEFORE), ("after", errors.after, AFTER))
    ]
    return figure("errors-figure", [histograms("errors", spreads, observed.error)], caption)


def _where(outcome: CalibrationResult, options: VirtualCampaign | MeasuredCampaign, observed: ObservationWords) -> Html:
    places = replace(error_places(outcome, options), size_means=f"{observed.error} after calibration")
    if not len(places.points):
        return Html("")
    drawn = f"; {MOST_POINTS} of them, evenly from the smallest error to the largest" if places.thinned else ""
    caption = f"Shown are {places.words}{drawn}. The darker, the larger the error."
    if len(places.off):
        caption += " Crosses: where the poses that are off should be."
    return figure("where", size_maps(places), caption)


def _changes(rows: list[dict[str, Any]], observed: ObservationWords, offsets: Sequence[str]) -> list[Html]:
    """How far each parameter is from the drawing, a picture a unit; in words what lengths of legs are."""
    shown = sorted((row for row in rows if row["change"] is not None), key=lambda row: row["unit"] != "mm")
    units = {row["unit"]: [each for each in shown if each["unit"] == row["unit"]] for row in shown}
    panels = [changes(of, unit, number) for number, (unit, of) in enumerate(units.items())]
    caption = (
        "How far the dimensions are from the drawing, with 95 % intervals (often smaller than the dot). "
        "Green: the interval leaves zero out; grey: it does not, or is not known."
    )
    below = paragraph(
        f"{capital(observed.placed)} have no drawing: before is where its dimensions put them."
        " A parameter that is fixed stays at its nominal value, and its error goes into those that it acts as."
        + (f" Added to a reading to give a leg's length: {', '.join(offsets)}." if offsets else ""),
        "note",
    )
    return [below, figure("changes", panels, caption) if panels else Html("")]


def _singular_values(outcome: CalibrationResult) -> Html:
    values = outcome.identification.fit.singular_values
    if not (len(values) and np.isfinite(values).all() and values[0] > 0):
        return Html("")
    caption = (
        "Singular values of the Jacobian (whitened rows, unit columns) of the identified parameters: a direction far "
        "below the others is one of which the measurements say little."
    )
    return figure("singular-values-figure", [singular_values(values)], caption)


def _arm(outcome: CalibrationResult) -> Html:
    arm = arm_places(outcome)
    if not np.isfinite(arm.joints).all():
        return Html("")
    points = "points as measured" if arm.measured else "tool points as the calibrated arm has them"
    caption = f"The calibrated arm as lines between its joints, at {len(arm.joints)} of its poses, and all {points}."
    return figure("arm", arm_views(arm), caption)
