"""Document of new measurements compared with the predictions of a calibrated arm."""

from dataclasses import replace

import numpy as np

from lab.core.errors import counted
from lab.core.limits import called
from lab.core.measurements import Measurements
from lab.core.number_text import sentence, short
from lab.core.se3 import Array, inverse
from lab.core.significance import VERIFICATION
from lab.core.units import MM
from lab.kinematics.model import RigidArm
from lab.library.point_verification import VerificationResult
from lab.phrases.phrase import phrase
from lab.phrases.verification_phrases import change_text, extent_text, next_step
from lab.report import document as doc
from lab.report.blocks import error_table, verdict_badge
from lab.report.charts.marks import Axes
from lab.report.comparison_plots import rows_picture
from lab.report.page_scene import ArmScene, Arrows, posed_arm
from lab.report.plots import Spread, histograms
from lab.report.scene import drawn_rows, error_factor, mean_lengths, moved, reach_of
from lab.report.style import AFTER, ARROW_AFTER, BEFORE, INK, MUTED, PREDICTED, rgb

__all__ = ["drawn_poses", "errors_picture", "verification_document"]

_MOST_HYPOTHESES = 20  # that are listed
_MOST_DRAWN = 8  # of them on the card
_RATE = f"An unchanged arm fails the test in {100 * VERIFICATION:g} % of all cases."


def verification_document(result: VerificationResult) -> doc.Document:
    """The verdict and its test, the errors, what may have changed, and the minimum detectable change."""
    verified, robot = result.verified, result.calibrated.robot
    within = "within the predicted error" if verified.good else "beyond the predicted error"
    explained = doc.Figure("causes-figure", _causes_picture(result), _CAUSES)
    spread = doc.Figure("errors-figure", (errors_picture(result),), _SPREAD)
    first, *others = (explained, spread) if explained.pictures else (spread,)
    arm = doc.Scene("arm-scene", lambda: _scene(result), _ARM)
    return doc.Document(
        f"{called(robot.name, result.serial)}: {within}",
        (
            *_card(result, first).everywhere,
            doc.Warnings(result.warnings),
            doc.Section(
                "Errors, observed and predicted",
                (arm, doc.Paragraph(sentence(phrase(verified.check))), *_errors(result), *others),
            ),
            doc.Section("Single changes that would explain the errors", (_hypotheses(result),)),
            doc.Section("Refitted parts", (_refitted(result),)),
            doc.Section("Minimum detectable change", (_detectable(result),) if verified.good else ()),
        ),
    )


_CAUSES = (
    "What each single change would leave of the errors, as a multiple of the predicted ones. What reaches the dotted "
    "line (1) explains them. Logarithmic axis."
)
_SPREAD = "The errors of the new measurements, with their root mean square and the predicted one. Logarithmic axis."
_ARM = "The arm at the new poses. Arrows lead from the predicted to the measured position of the first target."


@doc.guarded
def _card(result: VerificationResult, figure: doc.Figure) -> doc.Card:
    verified, measured = result.verified, result.measurements
    observed_m = MM.to_si(float(result.observed_mm["rms"]))
    numbers = [
        ("predicted error", short(MM.of(verified.expected_m), "mm"), ""),
        ("error now", short(result.observed_mm["rms"], "mm"), ""),
    ]
    alike = verified.check.data["alike"]
    if verified.situation is None and len(alike) == 1:
        numbers.append((change_text(alike[0]), extent_text(alike[0]), ""))
    elif not verified.good and verified.expected_m > 0:
        numbers.append(("larger by a factor of", short(observed_m / verified.expected_m), ""))
    within = "within" if verified.good else "beyond"
    date = result.calibrated.options.date
    calibration = f"the calibration{f' of {date}' if date else ''} ({result.calibrated.result.description})"
    about = (
        f"Root mean squares of {counted(int(result.observed_mm['count']), 'point')} in "
        f"{counted(len(measured), 'new pose')}, against {calibration}. {_RATE}"
    )
    return doc.Card(
        ("Verdict: ", verdict_badge(result.verdict), f" ({within} the predicted error)"),
        tuple(numbers),
        about,
        next_step(verified.check, result.verdict),
        (figure,),
    )


def _causes_picture(result: VerificationResult) -> tuple[doc.Picture, ...]:
    """Draw how large the errors would be relative to the predicted ones if one thing has changed; none if good."""
    verified = result.verified
    drawn = [each for each in verified.hypotheses if each.chi2 > 0][:_MOST_DRAWN]
    if not drawn or not verified.numbers:
        return ()
    sizes = np.sqrt([verified.statistic, *(each.chi2 for each in drawn)]) / np.sqrt(verified.numbers)
    names = ["as measured", *(change_text(each.check) for each in drawn)]
    explains = np.array([False, *(each.explains for each in drawn)])

    def draw(axes: Axes, at: Array) -> None:
        axes.axvline(1, color=INK, linewidth=1.2, linestyle=":")
        for which, colour, mark in ((~explains, MUTED, "o"), (explains, PREDICTED, "D")):
            axes.hlines(at[which], np.ones(which.sum()), sizes[which], color=colour, linewidth=1.2)
            axes.plot(sizes[which], at[which], mark, color=colour, markersize=7)

    best = ", ".join(name for name, each in zip(names, explains, strict=True) if each) or "no single change"
    label = f"Errors left by each single change: {best} explains them"
    ends = min(0.5, float(sizes.min()) / 1.3), float(sizes.max()) * 1.6
    return (rows_picture("causes", label, names, draw, "errors left over predicted", ends=ends),)


def _scene(result: VerificationResult) -> ArmScene:
    data, arm, values, predicted = drawn_poses(result)
    model = result.calibrated.robot.model
    scene = posed_arm(model, arm, values, data.joints, data.ids)
    T_world_instrument = model.T_world_frame0 @ inverse(arm.T_tracker_frame0(values))
    points = moved(T_world_instrument, predicted)
    vectors = (data.points - predicted) @ T_world_instrument[:3, :3].T
    lengths = mean_lengths(vectors)
    reach = reach_of(model.T_world_frame0, points[np.isfinite(points).all(axis=2)], scene.legs)
    factor = error_factor(lengths, reach)
    colour = rgb(ARROW_AFTER if result.good else BEFORE)
    return replace(
        scene,
        points=points[:, 0],
        arrows=(Arrows("measured less predicted", vectors[:, 0], factor, colour),),
        columns={"error": lengths},
    )


def errors_picture(result: VerificationResult) -> doc.Picture:
    """The observed errors as a histogram, with their root mean square and the predicted one."""
    verified = result.verified
    observed = MM.to_si(float(result.observed_mm["rms"]))
    spreads = [
        Spread(verified.errors, AFTER if verified.good else BEFORE, ("observed: rms", observed)),
        Spread(verified.errors[:0], PREDICTED, ("predicted: rms", verified.expected_m)),
    ]
    return histograms("errors", spreads, "position error")


@doc.guarded
def _errors(result: VerificationResult) -> tuple[doc.Block, ...]:
    observed, measured = result.observed_mm, result.measurements
    rows = [("observed", observed), ("predicted", {"rms": MM.of(result.verified.expected_m)})]
    below = (
        f"{len(measured)} new poses, targets {', '.join(measured.targets)}, against the run "
        f"{result.calibrated.folder}. The predicted error follows from the calibration's covariance and the "
        "instrument's noise."
    )
    return error_table(rows, "Position error, mm"), doc.Paragraph(below, "note")


def _hypotheses(result: VerificationResult) -> doc.Table:
    listed = result.verified.hypotheses
    rows = tuple(
        (
            phrase(each.check),
            short(each.chi2),
            short(each.p) if each.p > 0 else "< 1e-300",
            short(each.bic),
            "yes" if each.explains else "no",
        )
        for each in listed
    )
    kinds = tuple("" if each.explains else "quiet" for each in listed)
    columns = ("possible change, likeliest first", "remaining χ²", "p", doc.Column("BIC"), "explains the errors")
    caption = "Possible changes, each with what it leaves" if rows else ""
    return doc.Table(columns, rows, caption, kinds, most_rows=_MOST_HYPOTHESES, folded=True)


def _refitted(result: VerificationResult) -> doc.Table:
    rows = tuple(
        (
            name,
            *(
                short(MM.of(size)) if size == size else "–"
                for size in (moved.shift_m, moved.shift_std_m, moved.turn_rad, moved.turn_std_rad)
            ),
        )
        for name, moved in result.verified.refit
    )
    return doc.Table(("", "moved by, mm", "1σ", "turned by, mrad", "1σ"), rows)


def _detectable(result: VerificationResult) -> doc.Table:
    rows = tuple(
        (name.replace("joint", "zero of joint "), short(size), unit)
        for name, unit, size in result.detectable
        if size < float("inf")
    )
    caption = "Smallest change that the test detects in 95 of 100 such files"
    return doc.Table(("", "by", "unit"), rows, caption)


def drawn_poses(result: VerificationResult) -> tuple[Measurements, RigidArm, Array, Array]:
    """Return the poses that are drawn, of many an evenly spaced part, and what the calibrated arm predicts there.

    Returns:
        The measurements, the arm's geometry and its parameters with the base that the instrument sees, and the
        predicted points ``(m, k, 3)`` m in the instrument's frame, NaN where none was measured.
    """
    calibrated, values = result.calibrated, result.verified.values
    data = result.measurements[drawn_rows(len(result.measurements))]
    arm = calibrated.robot.arm_with(data.targets, calibrated.estimate.groups)
    predicted = np.where(data.seen[:, :, None], arm.points(data.inputs(arm.conditions), values), np.nan)
    return data, arm.rigid, values[: len(arm.rigid.names)], predicted
