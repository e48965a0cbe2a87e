"""Record a campaign with rerun: what it measured, what it found, and how sure, pose by pose.

What moves is on the timelines ``pose``, the 0-based row among all that were measured, and ``time``, two poses a second;
on ``time`` the arm moves from pose to pose. Positions are float32 there: the numbers to compute with are in the other
files of the run.
"""

from pathlib import Path

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from lab.core.number_text import format_magnification, short
from lab.core.se3 import Array
from lab.core.units import MM
from lab.library.calibration_result import CalibrationResult
from lab.report import recording as rec
from lab.report.document import Bullets, Document, Section, Strong, Table, Text
from lab.report.markdown import to_markdown
from lab.report.scene import legs_legend
from lab.report.style import RGB_AFTER, RGB_BEFORE, RGB_MAPPING, RGB_MEASURED, RGB_OUTLIER, RGB_UNCERTAINTY
from lab.report.view import document_of
from lab.report.views.calibration_document import parameters_table
from lab.report.views.calibration_scene import CampaignScene, scene
from lab.simulation.meshes import instrument_body

__all__ = ["parameters_text", "record"]

_PARAMETERS, _SINGULAR_VALUES = "parameters", "singular_values"


def record(path: Path, outcome: CalibrationResult) -> None:
    """Write a campaign's recording, with the blueprint that shows it, to ``path``."""
    shown = scene(outcome)
    fitted, values = outcome.fitted, outcome.identification.values
    identity = rec.identity_of(outcome.robot.sha256, fitted.joints, fitted.points, values)
    with rec.recording_to(path, outcome.robot.name, identity) as recording:
        recording.send_blueprint(_blueprint(outcome, shown))
        rec.draw_shells(recording, rec.pose_times(shown.at), shown.shells, shown.bodies)
        rec.draw_legs(recording, rec.pose_times(shown.at), shown.legs, shown.reach_m)
        arm, values = outcome.rigid(values)
        joints, model = fitted.joints[shown.rows], outcome.robot.model
        rec.draw_frames(recording, rec.pose_times(shown.at), model, arm, values, joints, shown.reach_m)
        planned = getattr(outcome.options, "plan", None) is not None
        rec.draw_moves(recording, model, arm, values, shown.at, joints, path=planned)
        _instrument(recording, outcome, shown)
        _points(recording, shown)
        _outliers(recording, shown)
        _arrows(recording, shown)
        _ellipsoids(recording, shown)
        _numbers(recording, outcome, shown)
        _steps(recording, outcome, shown)
        rec.log_texts(recording, document_of(outcome), _legend(outcome, shown))
        recording.log(_PARAMETERS, rec.markdown(parameters_text(outcome)), static=True)


def parameters_text(outcome: CalibrationResult) -> str:
    """Write the tables of the parameters and of the fit's convergence as Markdown."""
    unit = "σ" if outcome.identification.sigma_given else "mm"
    steps = tuple((str(i), short(float(rms))) for i, rms in enumerate(_convergence(outcome)))
    convergence = Table(("step", f"RMS residual of a coordinate, {unit}"), steps)
    return to_markdown(Document("Parameters", (parameters_table(outcome), Section("Convergence", (convergence,)))))


def _legend(outcome: CalibrationResult, shown: CampaignScene) -> Section:
    known = outcome.identification.sigma_given
    unit = "their effects in standard deviations" if known else "all points have the same weight"
    before, after = format_magnification(shown.factor_before), format_magnification(shown.factor_after)
    vermilion, blue = Strong("vermilion"), Strong("light blue")
    lines: list[Text] = [
        (Strong("yellow"), ": measured points; ", vermilion, ": predicted before calibration, ", blue, ": after"),
        (Strong("arrows"), f": measured less predicted, before and after both {before}; in their own view {after}"),
    ]
    if shown.uncertainty is not None:
        factor = format_magnification(shown.uncertainty.factor)
        lines.append((Strong("violet"), f": 1σ of the position, {factor}; half-axes in mm"))
    lines.append((
        Strong("teal"), f": image of the unit ball of scaled parameters ({unit}), "
        f"{format_magnification(shown.mapping.factor)}"
    ))  # fmt: skip
    lines.append((Strong("red, green, blue axes"), ": x, y, z of base, tool and instrument"))
    lines.append(legs_legend(shown.legs))
    if shown.outliers:
        lines.append((Strong("magenta"), ": outliers with their residuals, joined to their predicted positions"))
    if len(shown.rows) < len(outcome.fitted):
        count = f"{len(shown.rows)} of {len(outcome.fitted)} poses"
        lines.append(f"{count} are drawn, evenly spaced; the plots show all")
    return Section("What is shown", (Bullets(tuple(lines)),))


def _blueprint(outcome: CalibrationResult, shown: CampaignScene) -> rrb.Blueprint:
    controls = rec.eye(shown.origins, shown.all_measured, shown.reach_m, shown.heads[0])
    left = rrb.Vertical(rec.main_view("Arm, measured points, errors", controls), rec.error_plot(), row_shares=[3, 1])
    texts = rec.text_tabs(
        rrb.TextDocumentView(origin=_PARAMETERS, name="Parameters"),
        rec.bars(_SINGULAR_VALUES, "Singular values of J (scaled) by rank"),
        rec.program_view(),
    )
    factor = format_magnification(shown.factor_after)
    errors = rec.close_view("magnified", f"Error after calibration {factor}", shown.reach_m)
    right = rrb.Vertical(errors, _ellipsoid_views(shown), texts, row_shares=[1, 1, 1.2])
    return rec.layout(left, right, rec.TIME)


def _ellipsoid_views(shown: CampaignScene) -> rrb.Tabs:
    """The target from near by, fixed in the middle, with one ellipsoid each."""
    factor = format_magnification(shown.mapping.factor)
    views = [rec.close_view("ellipsoid/mapping", f"Sensitivity {factor}", shown.reach_m)]
    if shown.uncertainty is not None:
        factor = format_magnification(shown.uncertainty.factor)
        views.insert(0, rec.close_view("ellipsoid/uncertainty", f"Uncertainty (1σ) {factor}", shown.reach_m))
    return rrb.Tabs(*views, active_tab=0)


def _instrument(recording: rr.RecordingStream, outcome: CalibrationResult, shown: CampaignScene) -> None:
    """Draw the instrument's frame; of a virtual tracker also the beam to each visible target."""
    name = "tracker" if outcome.truth is not None else "instrument's frame"
    for i, (station, T_world_station) in enumerate(shown.Ts_world_station.items()):
        rec.draw_instrument(recording, station or name, T_world_station, station if i else "")
    if outcome.truth is not None:
        if instrument_body(outcome.robot.model) not in shown.bodies:  # the robot's model draws none
            rec.draw_tracker(recording, next(iter(shown.Ts_world_station.values()))[:3, 3])
        rec.draw_beams(recording, rec.pose_times(shown.at), shown.heads, shown.measured)


def _points(recording: rr.RecordingStream, shown: CampaignScene) -> None:
    """Measured and predicted points: these in points on the screen, so that they part when one comes close."""
    radius = 0.007 * shown.reach_m * min(1.0, (100 / len(shown.all_measured)) ** (1 / 3))
    cloud = rr.Points3D(shown.all_measured, colors=RGB_MEASURED, radii=radius)
    recording.log("world/targets/all_measured", cloud, static=True)
    for name, points, colour, size in (
        ("measured", shown.measured, RGB_MEASURED, 5.0),
        ("predicted_before", shown.before, RGB_BEFORE, 4.0),
        ("predicted_after", shown.after, RGB_AFTER, 3.0),
    ):
        radius = rr.Radius.ui_points(size)
        rec.draw_points(recording, f"world/targets/{name}", rec.pose_times(shown.at), points, colour, radius)


def _outliers(recording: rr.RecordingStream, shown: CampaignScene) -> None:
    """Outliers, whether they were fitted or not: marked, named, and joined to where they should be."""
    if not shown.outliers:
        return
    strips = [np.stack([pose.measured, pose.expected]) for pose in shown.outliers]
    marks = rr.Points3D(
        [pose.measured for pose in shown.outliers],
        colors=RGB_OUTLIER,
        radii=0.018 * shown.reach_m,
        labels=[pose.description for pose in shown.outliers],
    )
    recording.log("world/targets/off", marks, static=True)
    lines = rr.LineStrips3D(strips, colors=RGB_OUTLIER, radii=0.005 * shown.reach_m)
    recording.log("world/targets/off/to_expected", lines, static=True)


def _arrows(recording: rr.RecordingStream, shown: CampaignScene) -> None:
    """Measured less predicted, from the predicted point.

    Before and after calibration have one factor; with one of their own, those after are drawn once more, apart.
    """
    for entity, name, points, factor, colour in (
        ("errors/before", "before", shown.before, shown.factor_before, RGB_BEFORE),
        ("errors/after", "after", shown.after, shown.factor_before, RGB_AFTER),
        ("magnified/after", "after", shown.after, shown.factor_after, RGB_AFTER),
    ):
        ends = points, shown.measured - points
        rec.draw_arrows(recording, f"world/{entity}", shown.at, ends, factor, name, colour, shown.reach_m)


def _steps(recording: rr.RecordingStream, outcome: CalibrationResult, shown: CampaignScene) -> None:
    """Replay the session as a program: a line for each pose, with its errors."""
    lines = []
    for row in shown.rows:
        before, after = (MM.text(float(errors[row])) for errors in (shown.error_before, shown.error_after))
        found = f"{before} before, {after} after" if np.isfinite(shown.error_before[row]) else "no target was seen"
        lines.append(f"pose {outcome.fitted.ids[row]}: {found}")
    rec.draw_program(recording, rec.pose_times(shown.at), lines)


def _ellipsoids(recording: rr.RecordingStream, shown: CampaignScene) -> None:
    """Both ellipsoids of the first target with their half-axes, and the place that their views look at."""
    focus = rr.Transform3D.columns(translation=shown.mapping.centers)
    recording.send_columns("world/focus", rec.pose_times(shown.at), focus)
    rec.draw_ellipsoid(recording, "mapping", rec.pose_times(shown.at), shown.mapping, RGB_MAPPING)
    if shown.uncertainty is not None:
        rec.draw_ellipsoid(recording, "uncertainty", rec.pose_times(shown.at), shown.uncertainty, RGB_UNCERTAINTY)


def _numbers(recording: rr.RecordingStream, outcome: CalibrationResult, shown: CampaignScene) -> None:
    for name, errors, colour in (("before", shown.error_before, RGB_BEFORE), ("after", shown.error_after, RGB_AFTER)):
        rec.draw_error_curve(recording, shown.numbers, name, errors, colour)
    values = outcome.identification.fit.singular_values
    recording.log(
        _SINGULAR_VALUES, rr.BarChart(values, abscissa=np.arange(1, len(values) + 1), color=RGB_MAPPING), static=True
    )


def _convergence(outcome: CalibrationResult) -> Array:
    """Root mean square residual of a coordinate before and after each step: in sigmas, in mm if sigma was estimated."""
    identification = outcome.identification
    squares = 2 * np.array(identification.fit.cost_trace) / (3 * outcome.fitted.seen.sum())
    rms: Array = np.sqrt(squares) * (1.0 if identification.sigma_given else 1e3)
    return rms
