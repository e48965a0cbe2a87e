"""Pictures of a calibration's report: errors, corrections of parameters, singular values, residuals.

Positions are in the world of the model; for a robot given as a table that is frame 0.
"""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from lab.calibration.guess import in_first_frame
from lab.calibration.observation import observation_of
from lab.calibration.row_groups import configurations
from lab.core.errors import LabError
from lab.core.linear_model import half_width_95
from lab.core.measurements import Measurements, rows_called, seen_mask
from lab.core.number_text import short
from lab.core.probability import beta_ppf, normal_ppf
from lab.core.se3 import Array, inverse
from lab.core.units import MM, Unit
from lab.kinematics.parameter import Parameter
from lab.library.calibration_result import CalibrationResult
from lab.prediction.estimate import EstimatedParameter
from lab.prediction.validation import Errors, JudgedBy, errors_of
from lab.prediction.workspace_prediction import predicted_errors
from lab.report.charts.chart import axes_picture, cube, name_points, shades
from lab.report.charts.marks import Axes
from lab.report.comparison_plots import rows_picture
from lab.report.document import Block, Figure, Picture, guarded
from lab.report.plots import (
    MOST_POINTS,
    SMALL,
    WIDTH,
    ArrowMap,
    SizeMap,
    Spread,
    Trend,
    arrow_maps,
    histograms,
    size_maps,
    spread_by_size,
    trend_pictures,
)
from lab.report.scene import LARGEST_FACTOR, magnification, moved
from lab.report.style import (
    AFTER,
    ARM,
    BEFORE,
    INK,
    MUTED,
    PREDICTED,
)

__all__ = [
    "ErrorVectors", "correction_pictures", "correlation_picture", "error_histograms", "error_maps",
    "error_vectors", "has_correction",
    "main_picture", "residual_figures", "residual_pictures",
    "uncertainty_map", "where_figures", "world_of",
]  # fmt: skip

_MOST_CORRECTIONS = 30  # drawn in a picture
_WHICH: dict[JudgedBy, str] = {
    "fresh": "the validation poses, without noise",
    "holdout": "the poses of the hold-out set",
    "cross-validation": "the poses of the cross-validation, each predicted by the fit without it",
    "file": "the poses of the validation file",
}
_FITTED = "the fitted poses, with the residuals of the fit"
_SOME = f"{MOST_POINTS} of them, evenly from the smallest error to the largest"
_ARROW = 0.06  # of the map's edge: how long the mean error is drawn


class _ErrorMap(NamedTuple):
    sizes: tuple[SizeMap, SizeMap]  # before calibration and after it, by one scale
    which: str  # the poses of the errors, in words
    all_shown: bool


class ErrorVectors(NamedTuple):
    """Errors before and after calibration as vectors in the world, at ``m`` measured points."""

    points: Array  # (m, 3) m, predicted by the calibrated model
    before: Array  # (m, 3) m, measured less predicted
    after: Array
    names: tuple[str, ...]  # of the pose of each
    thing: str  # what the names are of
    which: str  # the poses, in words


def world_of(result: CalibrationResult) -> Array:
    """Pose ``(4, 4)`` of the instrument in the world: where the identified base has it."""
    arm, values = result.rigid(result.identification.values)
    return result.robot.model.T_world_frame0 @ inverse(arm.T_tracker_frame0(values))


def error_maps(result: CalibrationResult, error: str) -> _ErrorMap | None:
    """The errors of the validation, or the residuals where its poses' places are not known; None where there are none.

    Args:
        error: what the errors are.
    """
    data, errors, which = _validated(result)
    points = _predicted(result, data)
    count = min(points.shape[1], errors.after.shape[1])  # the orientation of a measured pose has errors of its own
    points = points[:, :count].reshape(-1, 3)
    before, after = (each[:, :count].reshape(-1) for each in (errors.before, errors.after))
    known = np.flatnonzero(np.isfinite(after) & np.isfinite(before))
    if not len(known):
        return None
    rows = known[spread_by_size(after[known])]
    crosses, _ = _outliers(result)
    both = np.concatenate([before[rows], after[rows]])
    largest = max(float(np.percentile(both, 99)), 1e-12)
    scale = max(float(np.percentile(both, 1)), 1e-5 * largest), 1.001 * largest
    shown = SizeMap(points[rows], after[rows], f"{error} after calibration", crosses, range_m=scale, from_one_side=True)
    earlier = f"{error} before calibration"
    no_crosses = np.empty((0, 3))
    start = replace(shown, sizes=before[rows], size_means=earlier, crosses=no_crosses, name="before")
    return _ErrorMap((start, shown), which, len(rows) == len(known))


def error_vectors(result: CalibrationResult) -> ErrorVectors | None:
    """Return the errors of the validation, or the residuals of the fit where it does not have its poses.

    None where no positions were measured in the instrument's frame.
    """
    identification, validation = result.identification, result.validation
    model, positions = identification.model, observation_of(identification.model).positions
    if not positions:
        return None
    data, which, thing = result.fitted, _FITTED, "pose"
    if validation.rows is not None and validation.judged_by in ("fresh", "holdout", "file"):
        data, which = validation.rows, _WHICH[validation.judged_by]
        thing = "pose" if validation.judged_by == "holdout" else "validation pose"
    try:
        inputs = data.inputs(model.conditions)
    except LabError:  # a virtual arm is validated by positions alone, also where orientations are fitted
        data, which, thing = result.fitted, _FITTED, "pose"
        inputs = data.inputs(model.conditions)
    predicted = (
        model.points(inputs, values)[:, :positions]
        for values in (identification.nominal_aligned, identification.values)
    )
    T_world_instrument = world_of(result)
    measured, before, after = (
        moved(T_world_instrument, in_first_frame(model, identification.values, inputs, each)).reshape(-1, 3)
        for each in (data.points[:, :positions], *predicted)
    )
    known = np.flatnonzero(np.isfinite(measured - before + after).all(axis=1))
    if not len(known):
        return None
    names = tuple(data.ids[row // positions] for row in known.tolist())
    measured, before, after = measured[known], before[known], after[known]
    return ErrorVectors(after, measured - before, measured - after, names, thing, which)


def _validated(result: CalibrationResult) -> tuple[Measurements, Errors, str]:
    """Poses, the errors ``(n, things)`` there, and which poses they are."""
    validation = result.validation
    rows, errors, judged_by = validation.rows, validation.errors, validation.judged_by
    if rows is not None and errors is not None and judged_by is not None:
        return rows, errors, _WHICH[judged_by]
    return result.fitted, errors_of(result.identification, result.fitted), _FITTED


def _predicted(result: CalibrationResult, data: Measurements) -> Array:
    """Targets ``(n, k, 3)`` in the world, of the calibrated geometry."""
    arm, values = result.rigid(result.identification.values)
    return moved(world_of(result), arm.points(data.joints, values))


def _outliers(result: CalibrationResult) -> tuple[Array, tuple[str, ...]]:
    """Where the calibrated geometry predicts the targets ``(o, 3)`` of the outliers, and the names of their poses."""
    rows = rows_called(result.measurements, [pose.id for pose in result.state.outliers])
    if not rows:
        return np.empty((0, 3)), ()
    predicted = _predicted(result, result.measurements[rows])
    names = tuple(result.measurements.ids[row] for row in rows for _ in range(predicted.shape[1]))
    return predicted.reshape(-1, 3), names


_WIDER = 1.15  # than the widest interval of a parameter that is well observed


def main_picture(result: CalibrationResult) -> Picture:
    """The errors before and after calibration, or the corrections where there was no validation."""
    pictures = error_histograms(result, "error")
    return pictures[0] if pictures else correction_pictures(result)[0]


def error_histograms(result: CalibrationResult, error: str) -> tuple[Picture, ...]:
    """Draw histograms of the errors before and after calibration; none without a validation."""
    errors = result.validation.errors
    if errors is None or not np.isfinite(errors.after).any():
        return ()
    spreads = [
        Spread.before(errors.before, ("before: mean", float(np.nanmean(errors.before)))),
        Spread.after(errors.after, ("after: mean", float(np.nanmean(errors.after)))),
    ]
    return (histograms("errors", spreads, error, result.options.gate_mm),)


def has_correction(parameter: Parameter, row: EstimatedParameter) -> bool:
    """Decide whether the parameter has a nominal value; base, tool and fixtures are only placed."""
    return row.identified and bool(np.isfinite(parameter.scale))


def correction_pictures(result: CalibrationResult) -> tuple[Picture, ...]:
    """Draw the corrections of nominal parameter values with 95 % intervals, a picture for each unit."""
    by_unit: dict[Unit, list[EstimatedParameter]] = {MM: []}
    for parameter, row in zip(result.identification.model.parameters, result.parameters, strict=True):
        if has_correction(parameter, row):
            by_unit.setdefault(parameter.unit, []).append(row)
    parts = [(unit, part, _limit(unit, rows)) for unit, rows in by_unit.items() for part in _in_parts(rows)]
    return tuple(_corrections(rows, unit, limit, number) for number, (unit, rows, limit) in enumerate(parts))


def _limit(unit: Unit, rows: Sequence[EstimatedParameter]) -> float:
    """Return how far a picture of corrections reaches: a parameter that is weakly observable does not stretch it."""
    reach = [
        abs(row.estimate - row.nominal) + np.nan_to_num(row.half_width_95) for row in rows if not row.weakly_observable
    ]
    largest = max(reach, default=0.0)
    return _WIDER * unit.of(largest) if largest > 0 else np.inf


def _in_parts(rows: Sequence[EstimatedParameter]) -> Iterator[Sequence[EstimatedParameter]]:
    """Yield parts of about one size, none larger than a picture."""
    if rows:
        count = -(-len(rows) // -(-len(rows) // _MOST_CORRECTIONS))
        yield from (rows[i : i + count] for i in range(0, len(rows), count))


def _corrections(rows: Sequence[EstimatedParameter], unit: Unit, limit: float, number: int) -> Picture:
    """Draw corrections of one unit, up to ``limit``."""
    names = [row.name for row in rows]
    offsets = unit.of(np.array([row.estimate - row.nominal for row in rows]))
    halves = unit.of(np.array([row.half_width_95 for row in rows]))
    texts = [f"{short(a)} ± {short(b)}" for a, b in zip(offsets.tolist(), halves.tolist(), strict=True)]
    beyond = np.flatnonzero(np.abs(offsets) + np.nan_to_num(halves) > limit)

    def draw(axes: Axes, at: Array) -> None:
        colours = [AFTER if sure else MUTED for sure in np.abs(offsets) > halves]
        inside, low, high = (np.clip(ends, -limit, limit) for ends in (offsets, offsets - halves, offsets + halves))
        axes.hlines(at, 0, inside, color=colours, alpha=0.35, linewidth=4)
        axes.hlines(at, low, high, color=colours, linewidth=1.2)
        for ends in (low, high):
            axes.scatter(ends, at, marker="|", c=colours, s=24, linewidths=1.2)
        axes.scatter(inside, at, c=colours, s=13)
        for i in beyond:
            axes.annotate(texts[i], (limit, at[i]), xytext=(-3, 2), textcoords="offset points", ha="right")
        axes.axvline(0, color=INK, linewidth=1)
        name_points(axes, "parameter", inside, at, names, [f"{text} {unit.name}" for text in texts])
        if np.isfinite(limit):
            axes.set(xlim=(-1.06 * limit, 1.06 * limit))
        axes.locator_params(axis="x", nbins=5)
        axes.tick_params(axis="y", length=0)
        axes.margins(x=0.06)

    label = f"Corrections of the nominal values with 95 % intervals, {unit.name}"
    axis = f"correction of the nominal value, {unit.name}"
    return rows_picture(f"corrections-{number}", label, names, draw, axis, step=0.2, width=WIDTH)


_QUANTILES = 120
_FEWEST = 8  # residuals that are drawn
_LINK = 0.13  # inches of a parameter
_CORRELATION_SCALE = (BEFORE, "#ffffff", AFTER)  # from −1 to 1
_WORD = 0.16  # inches of a word beside the correlations
_STRONG = 0.5  # a correlation from which a reader can ask its names
_STEP = 1e-6  # rad or m, by which a joint is moved
_LEAST_LEVER = 1e-3  # of the largest: how far a joint must move the targets, to be seen in their errors


def residual_pictures(result: CalibrationResult) -> tuple[Picture, ...]:
    """The residuals of the poses, mm: along each joint's motion, in time, and against a normal distribution."""
    identification, data = result.identification, result.fitted
    positions = observation_of(identification.model).positions
    if not positions:
        return ()
    inputs = data.inputs(identification.model.conditions)
    residuals = data.points[:, :positions] - identification.model.points(inputs, identification.values)[:, :positions]
    seen = MM.of(residuals[np.isfinite(residuals)])
    if len(seen) < _FEWEST:
        return ()
    band = float(half_width_95(np.inf)) * MM.of(identification.sigma_m)
    joints = trend_pictures("residuals-joint", _by_joint(result, inputs, residuals), band)
    return (*joints, *trend_pictures("residuals-time", _in_order(result, residuals), band), _quantiles(seen))


def _by_joint(result: CalibrationResult, inputs: Array, residuals: Array) -> list[Trend]:
    """Residuals of configurations along the direction in which each joint moves the targets, against that joint.

    The residual ``r`` of all targets of a pose, and their motion ``d`` by the joint, give ``r·d/|d|``, whose noise is
    that of a coordinate. Poses that repeat a configuration are one point, their mean.
    """
    identification, data, chain = result.identification, result.fitted, result.robot.chain
    positions = residuals.shape[1]
    labels = configurations(data.joints)
    _, firsts, which = np.unique(labels, return_index=True, return_inverse=True)
    trends = []
    for joint, name in enumerate(chain.joint_names):
        step = _STEP * np.eye(inputs.shape[1])[joint]
        ahead, back = (
            identification.model.points(inputs + side * step, identification.values)[:, :positions] for side in (1, -1)
        )
        motion = np.where(np.isfinite(residuals), (ahead - back) / (2 * _STEP), 0.0).reshape(len(data), -1)
        lever = np.linalg.norm(motion, axis=1)
        moves = lever > _LEAST_LEVER * lever.max()
        along = np.sum(np.nan_to_num(residuals).reshape(len(data), -1) * motion, axis=1) / np.where(moves, lever, 1.0)
        sums, counts = (np.bincount(which, each * moves) for each in (along, np.ones(len(data))))
        unit, shown = chain.unit(joint), np.flatnonzero(counts)
        trends.append(
            Trend(
                name,
                f"{name}, {unit.name}",
                unit.of(data.joints[firsts[shown], joint]),
                MM.of(sums[shown] / counts[shown]),
                [data.ids[row] for row in firsts[shown].tolist()],
            )
        )
    return trends


def _in_order(result: CalibrationResult, residuals: Array) -> list[Trend]:
    """Residuals of poses along each axis of the instrument, in time or in the order of the file."""
    data, time = result.fitted, result.fitted.conditions.get("time_s")
    timed = time is not None and bool(np.isfinite(time).all())
    at = (time - time.min()) / 60 if timed and time is not None else np.arange(1.0, len(data) + 1)
    seen = seen_mask(residuals)
    rows = np.flatnonzero(seen.any(axis=1))
    sums = np.where(seen[..., None], residuals, 0.0)[rows].sum(axis=1) / np.sqrt(seen[rows].sum(axis=1))[:, None]
    axis = "time, min" if timed else "pose, in order"
    names = [data.ids[row] for row in rows.tolist()]
    steps = _steps(result, at)
    return [Trend(name, axis, at[rows], MM.of(sums[:, k]), names, steps) for k, name in enumerate("xyz")]


def _steps(result: CalibrationResult, at: Array) -> list[float]:
    """Return where something moved, midway between the two rows of each step (in the order or time of the rows)."""
    places = dict(zip(result.fitted.ids, at.tolist(), strict=True))
    between = [each.hypothesis.of[-2:] for each in result.diagnosis if each.name.endswith("_step")]
    return [(places[last] + places[first]) / 2 for last, first in between if {last, first} <= set(places)]


def _quantiles(residuals: Array) -> Picture:
    """Ordered residuals over their RMS against a normal distribution, with the 95 % band of single quantiles."""
    size = float(np.sqrt(np.mean(residuals**2))) or 1.0
    share = (np.arange(1, min(len(residuals), _QUANTILES) + 1) - 0.5) / min(len(residuals), _QUANTILES)
    expected, quantiles = normal_ppf(share), np.quantile(residuals / size, share)
    ranks = share * len(residuals)
    low, high = (normal_ppf(beta_ppf(p, ranks + 0.5, len(residuals) - ranks + 0.5)) for p in (0.025, 0.975))
    outside = float(np.mean((quantiles < low) | (quantiles > high)))

    def draw(axes: Axes) -> None:
        axes.fill_between(expected, low, high, color=PREDICTED, alpha=0.18, linewidth=0)
        axes.plot(expected, expected, color=INK, linewidth=0.8)
        axes.plot(expected, quantiles, "o", color=AFTER, markersize=3)
        axes.set(xlabel="normal distribution, σ", title=f"Q-Q: {100 * outside:.0f} % outside")
        axes.locator_params(axis="x", nbins=4)

    label = f"Q-Q: {100 * outside:.0f} % of the quantiles lie outside the 95 % band of a normal distribution"
    return axes_picture("residuals-normal", label, SMALL, draw, (0.55, 0.5, 0.1, 0.35))


def correlation_picture(result: CalibrationResult) -> tuple[Picture, ...]:
    """Correlations of the identified parameters, a block for each link; nothing where they are not known."""
    identification, std = result.identification, result.identification.std
    if len(std) < 2 or not (np.isfinite(std).all() and (std > 0).all()):
        return ()
    names = [identification.model.names[i] for i in identification.fit.free]
    links = [name.split(".")[0] for name in names]
    order = sorted(range(len(names)), key=lambda i: links.index(links[i]))  # of each link or joint one block
    matrix = (identification.covariance / np.outer(std, std))[np.ix_(order, order)]
    names, links = [names[i] for i in order], [links[i] for i in order]
    wide = min(max(2.4, _LINK * len(names)), WIDTH - 0.9)

    def draw(axes: Axes) -> None:
        edges = np.arange(len(names) + 1) - 0.5
        axes.pcolormesh(edges, edges, shades((matrix + 1) / 2, _CORRELATION_SCALE))
        axes.set(xlim=(-0.5, len(names) - 0.5), ylim=(len(names) - 0.5, -0.5))
        axes.set_aspect("equal")
        _mark_links(axes, links, wide / len(names))
        axes.tick_params(length=0)
        axes.grid(visible=False)
        _name_strong(axes, names, matrix)
        _correlation_bar(axes.inset_axes((0.0, -0.32 * 3.0 / wide, 1.0, 0.15 / wide)))

    upper = np.abs(np.triu(matrix, 1))
    i, j = np.unravel_index(int(upper.argmax()), upper.shape)
    label = f"Correlations of the parameters: the strongest, {matrix[i, j]:.2f}, is of {names[i]} and {names[j]}"
    return (axes_picture("correlations", label, (wide + 0.9, wide + 1.55), draw, (0.75, 1.45, 0.15, 0.1)),)


def _mark_links(axes: Axes, links: Sequence[str], cell: float) -> None:
    """Part the parameters of each link from the next by a line, and name the blocks as far as there is room.

    Args:
        links: of each parameter, those of one link in a row.
        cell: inches of a parameter.
    """
    firsts = [i for i in range(len(links)) if i == 0 or links[i] != links[i - 1]]
    for edge in firsts[1:]:
        axes.axhline(edge - 0.5, color=ARM, linewidth=0.8)
        axes.axvline(edge - 0.5, color=ARM, linewidth=0.8)
    middles = [(a + b - 1) / 2 for a, b in zip(firsts, [*firsts[1:], len(links)], strict=True)]
    room = [True, *(b - a > _WORD / cell for a, b in pairwise(middles))]
    shown = [(at, links[i]) for at, i, fits in zip(middles, firsts, room, strict=True) if fits]
    axes.set_yticks(*zip(*shown, strict=True))
    axes.set_xticks(*zip(*shown, strict=True), rotation=90)


def _name_strong(axes: Axes, names: Sequence[str], matrix: Array) -> None:
    """Name the strong correlations for those who point at their cells, on either side of the diagonal."""
    rows, columns = np.nonzero(np.abs(np.triu(matrix, 1)) > _STRONG)
    named = [f"{names[i]} and {names[j]}" for i, j in zip(rows.tolist(), columns.tolist(), strict=True)]
    texts = [f"{value:.2f}".replace("-", "−") for value in matrix[rows, columns].tolist()]
    for across, up in ((columns, rows), (rows, columns)):
        name_points(axes, "correlation of", across, up, named, texts)


def _correlation_bar(bar: Axes) -> None:
    values = np.linspace(-1, 1, 65)
    colours = shades(((values[1:] + values[:-1]) / 2 + 1) / 2, _CORRELATION_SCALE)
    bar.pcolormesh(values, [0, 1], colours[None])
    bar.set(xlim=(-1, 1), ylim=(0, 1), xticks=[-1, -0.5, 0, 0.5, 1], yticks=[], xlabel="correlation")
    bar.grid(visible=False)


def uncertainty_map(result: CalibrationResult) -> SizeMap | None:
    """The predicted position error over random poses of the workspace; crosses: beyond the measured joints."""
    prediction = predicted_errors(result.identification, result.state.measured)
    if prediction is None:
        return None
    inputs, sizes = prediction
    joints = inputs[:, : result.robot.chain.size]
    measured = result.fitted.joints
    beyond = ((joints < measured.min(axis=0)) | (joints > measured.max(axis=0))).any(axis=1)
    arm, values = result.rigid(result.identification.values)
    points = moved(world_of(result), arm.points(joints, values))[:, 0]
    return SizeMap(points, sizes, "predicted error (RMS)", name="uncertainty", extrapolated=beyond)


@guarded
def where_figures(result: CalibrationResult) -> tuple[Block, ...]:
    """Errors before and after calibration where they are, and the predicted ones over the workspace."""
    arrows = error_vectors(result)
    maps = None if arrows is not None else error_maps(result, result.kind.terms.error)
    predicted = _predicted_map(result)
    if arrows is not None:
        return (_arrow_figure(result, arrows), *predicted)
    if maps is None:
        return predicted
    part = "" if maps.all_shown else f"; {_SOME}"
    before, after = maps.sizes
    caption = f"The maps show {maps.which}{part}: first before calibration, then after it, by the same scale."
    if len(after.crosses):
        caption += " Crosses mark the predicted positions of the outliers."
    return (Figure("where", (*size_maps(before), *size_maps(after)), caption), *predicted)


def _arrow_figure(result: CalibrationResult, errors: ErrorVectors) -> Figure:
    """Draw the errors before and after calibration at one magnification, and those after it at a larger one."""
    rows = spread_by_size(np.linalg.norm(errors.after, axis=1))
    points, names = errors.points[rows], [errors.names[row] for row in rows.tolist()]
    edge = 2 * cube([points])[1]
    before, after = (
        min(magnification(float(np.linalg.norm(each, axis=1).mean()), _ARROW * edge), LARGEST_FACTOR)
        for each in (errors.before, errors.after)
    )
    crosses, cross_names = _outliers(result)
    layers = ("before", BEFORE, errors.before[rows]), ("after", AFTER, errors.after[rows])
    both = ArrowMap("before", points, result.kind.terms.error, layers, before, names, errors.thing)
    alone = replace(both, name="after", layers=layers[1:], factor=after)
    maps = [both, alone] if after > before else [both]
    maps[-1] = replace(maps[-1], crosses=crosses, cross_names=cross_names)
    part = "" if len(rows) == len(errors.names) else f"; {_SOME}"
    caption = f"Arrows show the {result.kind.terms.error}, measured less predicted, at {errors.which}{part}."
    if after > before:
        caption += " The second map of each view shows the errors after calibration alone, magnified more."
    caption += " Neighbouring arrows that point the same way show an error that the model lacks."
    if len(crosses):
        caption += " Crosses mark the predicted positions of the outliers."
    return Figure("where", arrow_maps(maps), caption)


@guarded
def _predicted_map(result: CalibrationResult) -> tuple[Block, ...]:
    uncertainty = uncertainty_map(result)
    if uncertainty is None:
        return ()
    assert uncertainty.extrapolated is not None
    share = float(uncertainty.extrapolated.mean())
    caption = "The map shows the predicted error (RMS) at random poses of the workspace."
    if share:
        many = "All poses are" if share == 1 else f"Crosses ({100 * share:.0f} % of the poses) are"
        caption += (
            f" {many} outside the measured joint range: the model is extrapolated there, and its discrepancy may be "
            "larger."
        )
    return (Figure("uncertainty", size_maps(uncertainty), caption),)


@guarded
def residual_figures(result: CalibrationResult) -> tuple[Block, ...]:
    """Residuals against each joint, in time, and against a normal distribution."""
    pictures = residual_pictures(result)
    joints = result.robot.chain.size
    trends = [each.label for each in pictures[:-1] if not each.label.endswith("no trend")]
    count = len(np.unique(configurations(result.fitted.joints))) if pictures else 0
    some = f" ({MOST_POINTS} of {count:,} are drawn)" if count > MOST_POINTS else ""
    common = "The line is their smooth mean with its 95 % band; green: 95 % of the noise."
    summary = f" Trends: {'; '.join(trends)}." if trends else " None has a trend (F tests, 1 % over all)."
    by_joint = (
        f"Errors against each joint. A dot is a configuration{some}: its residual, mm, along the direction in which "
        f"that joint moves the tool. {common} A wave or a slope shows an effect of the joint that the model lacks."
    )
    in_time = (
        "Errors in time, mm, along each axis of the instrument, and the residuals over their RMS against a normal "
        "distribution: normal noise lies on the line, within its band."
    )
    if any(each.name.endswith("_step") for each in result.diagnosis):
        in_time += " Dashed: something moved there, which the fit contains."
    return (
        Figure("residuals", pictures[:joints], by_joint + summary),
        Figure("residuals-in-time", pictures[joints:], in_time),
    )
