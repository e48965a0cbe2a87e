"""Document of predicted points and their uncertainty."""

import numpy as np

from lab.core.errors import counted
from lab.core.number_text import capital, fixed, short
from lab.core.units import MM
from lab.library.predict import PREDICTED_FILE, PredictionResult
from lab.phrases.fit_phrases import listed, model_name
from lab.report import document as doc
from lab.report.plots import Spread, histograms

__all__ = ["prediction_document", "radii_picture"]

_MOST_LISTED = 100  # poses in the table
_CAUSES = {
    "parameters": "uncertain parameters",
    "unmodelled": "model discrepancy",
    "visit": "scatter between visits",
    "together": "together",
}


def prediction_document(result: PredictionResult) -> doc.Document:
    """Build the document of predicted points."""
    run = result.run.result
    return doc.Document(
        f"{result.run.robot.name}: {counted(len(result.rows), 'pose')} predicted",
        (
            doc.Paragraph(
                (doc.Badge(run.verdict, "good" if run.verdict == "good" else "doubtful"), " is the run's verdict")
            ),
            doc.Bullets(tuple(map(capital, run.reasons))),
            doc.Paragraph(_lead(result), "lead"),
            doc.Warnings(result.warnings),
            doc.Section("Uncertainty", _uncertainty(result)),
            doc.Section("Every pose", _every_pose(result), shown_in=doc.PAGE),
        ),
    )


def radii_picture(result: PredictionResult) -> doc.Picture:
    """Radii of 95 % of the errors, all causes together and of the parameters alone, as histograms."""
    every, own = (lengths[np.isfinite(lengths)] for lengths in _two(result))
    spreads = [Spread.before(every, ("together: mean", float(every.mean())))]
    spreads.append(Spread.after(own, ("parameters: mean", float(own.mean()))))
    return histograms("radii", spreads, "radius of 95 % of the errors", result.run.result.gate_mm)


def _two(result: PredictionResult) -> tuple[np.ndarray, np.ndarray]:
    return result.radii_95["together"].ravel(), result.radii_95["parameters"].ravel()


def _lead(result: PredictionResult) -> str:
    points, size = ", ".join(result.run.estimate.arm.targets), result.radius_statistics_mm["together"]
    text = (
        f"Position of {points}" if len(result.run.estimate.arm.targets) == 1 else f"Positions of the points {points}"
    ) + f" at {counted(len(result.rows), 'pose')} of the arm that {result.run.folder} calibrated"
    if size["mean"] is None or size["max"] is None:
        return text + ": none of them is within reach."
    text += (
        f": 95 % of the errors are within {short(size['mean'])} mm on average, {short(size['max'])} mm at most, "
        f"without the noise of a new measurement. Model: {model_name(result.run.estimate.groups)}."
    )
    if result.without_effects_m is None:
        return text
    lacking = ", ".join(listed(result.run.estimate.groups))
    return f"{text} Without {lacking} the points would be {MM.text(result.without_effects_m, 2)} off (rms)."


@doc.guarded
def _uncertainty(result: PredictionResult) -> tuple[doc.Block, ...]:
    rows = tuple(
        (_CAUSES[name], *("" if size is None else short(size) for size in (sizes["mean"], sizes["max"])))
        for name, sizes in result.radius_statistics_mm.items()
    )
    note = (
        f"Radius of the sphere that holds 95 % of the errors. {PREDICTED_FILE} has each point's covariance and "
        "radii; result.json has the covariance."
    )
    table = doc.Table(("cause of errors", "mean, mm", "largest, mm"), rows)
    if not np.isfinite(_two(result)[0]).any():
        return table, doc.Paragraph(note, "note")
    caption = "Radii of all causes together (vermilion, hatched), and of uncertain parameters alone (blue)."
    return table, doc.Paragraph(note, "note"), doc.Figure("radii-figure", (radii_picture(result),), caption)


@doc.guarded
def _every_pose(result: PredictionResult) -> tuple[doc.Block, ...]:
    here, base, radius = MM.of(result.points), MM.of(result.points_in_base), MM.of(result.radii_95["together"])
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
    table = doc.Table(
        (*header, "radius, mm"), rows, most_rows=_MOST_LISTED, rest_in=PREDICTED_FILE, count=here.shape[0]
    )
    return (doc.Paragraph(note, "note"), table) if rows else ()
