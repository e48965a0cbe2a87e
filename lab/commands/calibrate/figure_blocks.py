"""The figures of a calibration's page, each with the sentence that says what it shows."""

from lab.calibration.sensor import SensorWords
from lab.commands.calibrate.diagnostics import (
    MOST_POSES,
    correlation_picture,
    residual_pictures,
    selection_picture,
    uncertainty_map,
)
from lab.commands.calibrate.error_map import arm_poses, error_maps
from lab.commands.calibrate.figures import arm_views, singular_value_picture
from lab.commands.calibrate.result import CalibrationResult
from lab.core.se3 import Array
from lab.render.document import Block, Figure
from lab.render.plots import MOST_POINTS, size_maps

__all__ = [
    "arm_figures",
    "correlation_figure",
    "residual_figures",
    "selection_figure",
    "singular_value_figure",
    "where_figures",
]


def where_figures(result: CalibrationResult, words: SensorWords) -> tuple[Block, ...]:
    """Errors before and after calibration where they are, and the predicted ones over the workspace."""
    found = error_maps(result, words.error)
    predicted = _predicted_map(result, None if found is None else found.sizes[0].range_m)
    if found is None:
        return predicted
    part = "" if found.all_shown else f"; {MOST_POINTS} of them, evenly from the smallest error to the largest"
    before, after = found.sizes
    caption = (
        f"Shown are {found.which}{part}: first before calibration, then after it. The darker, the larger the error; "
        "both have one logarithmic scale."
    )
    if len(after.crosses):
        caption += " Crosses: where the outliers should be."
    return (Figure("where", (*size_maps(before), *size_maps(after)), caption), *predicted)


def _predicted_map(result: CalibrationResult, range_m: tuple[float, float] | None) -> tuple[Block, ...]:
    found = uncertainty_map(result, range_m)
    if found is None:
        return ()
    caption = (
        "The predicted error (RMS) at random poses of the workspace. Crosses: a joint is "
        "beyond what was measured, so the model is extrapolated there, and what it leaves out may be larger."
    )
    return (Figure("uncertainty", size_maps(found), caption),)


def residual_figures(result: CalibrationResult) -> tuple[Block, ...]:
    """Residuals in time, against each joint, and against a normal distribution."""
    caption = (
        "The residuals of the fit per axis. The band holds 95 % of the noise. Against each joint: over the range that "
        "was measured; what bends or steps there, the model leaves out. At last ordered against a normal distribution: "
        "noise lies on the line, within the band."
    )
    if len(result.fitted) > MOST_POSES:
        caption += f" Drawn are {MOST_POSES:,} of the {len(result.fitted):,} poses, evenly spaced; titles tell of all."
    return (Figure("residuals", residual_pictures(result), caption),)


def selection_figure(result: CalibrationResult) -> Figure:
    """What each group of the model is worth."""
    caption = (
        "The hold-out error of the geometry alone, and by how much each group that was taken lowers it, from top to "
        "bottom."
    )
    return Figure("selection-figure", selection_picture(result), caption)


def correlation_figure(result: CalibrationResult) -> Figure:
    """Which parameters these poses hardly tell apart."""
    caption = (
        "Correlations of the identified parameters, a block for each link: blue, they rise together; vermilion, one "
        "falls as the other rises. Dark cells off the diagonal are parameters that these poses hardly tell apart."
    )
    return Figure("correlations-figure", correlation_picture(result), caption)


def singular_value_figure(values: Array) -> Figure:
    """Which directions the measurements observe well."""
    caption = (
        "Singular values of the Jacobian (whitened rows, unit columns) of the identified parameters: a direction far "
        "below the others is one of which the measurements say little."
    )
    return Figure("singular-values-figure", singular_value_picture(values), caption)


def arm_figures(result: CalibrationResult) -> tuple[Block, ...]:
    """The arm at its poses."""
    arm = arm_poses(result)
    points = "points as measured" if arm.measured else "tool points as the calibrated model predicts them"
    caption = f"The calibrated arm as lines between its joints, at {len(arm.joints)} of its poses, and all {points}."
    return (Figure("arm", arm_views(arm), caption),)
