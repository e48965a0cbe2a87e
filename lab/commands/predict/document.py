"""What a person reads of predicted points: their uncertainty by cause, and each of them."""

import numpy as np

from lab.commands.predict.result import PREDICTED_FILE, PredictionResult
from lab.commands.provenance import provenance_section
from lab.core.wording import counted
from lab.render.document import (
    PAGE,
    Badge,
    Block,
    Bullets,
    Document,
    Figure,
    Paragraph,
    Picture,
    Section,
    Table,
    Warnings,
)
from lab.render.format import capital, fixed, short
from lab.render.phrases.models import listed, model_name
from lab.render.plots import Spread, histograms
from lab.render.style import AFTER, BEFORE, HATCH_AFTER, HATCH_BEFORE, MARK_AFTER, MARK_BEFORE

__all__ = ["prediction_document", "radii_picture"]

_MOST_LISTED = 100  # poses in the table
_CAUSES = {
    "parameters": "uncertain parameters",
    "unmodelled": "what the model lacks",
    "visit": "scatter from visit to visit",
    "together": "together",
}


def prediction_document(result: PredictionResult) -> Document:
    """The points' uncertainty by cause, and every pose with its points in both frames."""
    run = result.run.result
    return Document(
        f"{result.run.robot.name}: {counted(len(result.rows), 'pose')} predicted",
        (
            Paragraph((Badge(run.verdict, "good" if run.verdict == "good" else "doubtful"), " is the run's verdict")),
            Bullets(tuple(map(capital, run.reasons))),
            Paragraph(_lead(result), "lead"),
            Warnings(result.warnings),
            Section("Uncertainty", _uncertainty(result)),
            Section("Every pose", _every_pose(result), shown_in=PAGE),
            provenance_section("predict", result.options, result.run.robot.sha256),
        ),
    )


def radii_picture(result: PredictionResult) -> Picture:
    """Radii of 95 % of the errors, all causes together and of the parameters alone, as histograms."""
    every, own = (lengths[np.isfinite(lengths)] for lengths in _two(result))
    spreads = [Spread(every, BEFORE, ("together: mean", float(every.mean())), HATCH_BEFORE, MARK_BEFORE)]
    spreads.append(Spread(own, AFTER, ("parameters: mean", float(own.mean())), HATCH_AFTER, MARK_AFTER))
    return histograms("radii", spreads, "radius of 95 % of the errors", result.run.result.gate_mm)


def _two(result: PredictionResult) -> tuple[np.ndarray, np.ndarray]:
    return result.radii_95["together"].ravel(), result.radii_95["parameters"].ravel()


def _lead(result: PredictionResult) -> str:
    points, size = ", ".join(result.run.estimate.arm.targets), result.radius_statistics_mm["together"]
    text = (
        f"Where {points} is" if len(result.run.estimate.arm.targets) == 1 else f"Where the points {points} are"
    ) + f" at {counted(len(result.rows), 'pose')} of the arm that {result.run.folder} calibrated"
    if size["mean"] is None or size["max"] is None:
        return text + ": it can take none of them."
    text += (
        f": 95 % of the errors are within {short(size['mean'])} mm on average, {short(size['max'])} mm at most, the "
        f"noise of a new measurement aside. Model: {model_name(result.run.estimate.groups)}."
    )
    if result.without_effects_m is None:
        return text
    lacking = ", ".join(listed(result.run.estimate.groups))
    return f"{text} Without {lacking} the points would be {1e3 * result.without_effects_m:.2g} mm off (rms)."


def _uncertainty(result: PredictionResult) -> tuple[Block, ...]:
    rows = tuple(
        (_CAUSES[name], *("" if size is None else short(size) for size in (sizes["mean"], sizes["max"])))
        for name, sizes in result.radius_statistics_mm.items()
    )
    note = (
        "Radius of the sphere that holds 95 % of the errors. Each point's covariance is in result.json and, with its "
        f"radii, in {PREDICTED_FILE}."
    )
    table = Table(("cause of errors", "mean, mm", "largest, mm"), rows)
    if not np.isfinite(_two(result)[0]).any():
        return table, Paragraph(note, "note")
    caption = "Radii of all causes together (vermilion, hatched), and of uncertain parameters alone (blue)."
    return table, Paragraph(note, "note"), Figure("radii-figure", (radii_picture(result),), caption)


def _every_pose(result: PredictionResult) -> tuple[Block, ...]:
    here, base, radius = 1e3 * result.points, 1e3 * result.points_in_base, 1e3 * result.radii_95["together"]
    rows = tuple(
        (
            result.rows.ids[i],
            target,
            *(fixed(float(value), 3) for value in (*here[i, k], *base[i, k])),
            short(float(radius[i, k])),
        )
        for i in range(min(len(result.rows), _MOST_LISTED))
        for k, target in enumerate(result.run.estimate.arm.targets)
        if np.isfinite(here[i, k]).all()
    )
    header = ("pose", "point", *(f"{axis}, mm" for axis in "xyz"), *(f"{axis} in the base, mm" for axis in "xyz"))
    note = "x, y and z are in the frame in which the arm was measured, then in its base (frame 0 of its table)."
    table = Table((*header, "radius, mm"), rows, most_rows=_MOST_LISTED, rest_in=PREDICTED_FILE, count=here.shape[0])
    return (Paragraph(note, "note"), table) if rows else ()
