"""Pictures of a calibration's report: errors, corrections of parameters, singular values, the arm at its poses.

Positions are in the world of the model; for a robot given as a table that is frame 0.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lab.calibration.estimate import EstimatedParameter
from lab.calibration.observation import observation_of
from lab.calibration.stations import in_first_frame
from lab.calibration.validation import Errors, JudgedBy, errors_of
from lab.calibration.workspace_prediction import predicted_errors
from lab.commands.calibrate.result import CalibrationResult
from lab.core.linear_model import half_width_95
from lab.core.measurements import Measurements, evenly, rows_called
from lab.core.probability import beta_ppf, normal_ppf
from lab.core.se3 import Array, inverse, transform
from lab.core.units import MM, Unit
from lab.kinematics.parameter import Parameter
from lab.render.charts.chart import axes_picture, cube, log_ticks, shades, view
from lab.render.charts.marks import Axes
from lab.render.document import Block, Figure, Picture, short
from lab.render.plots import MOST_POINTS, VIEWS, SizeMap, Spread, histograms, size_maps, spread_by_size
from lab.render.scene import moved, skeleton
from lab.render.style import (
    AFTER,
    ARM,
    BEFORE,
    HATCH_BEFORE,
    HIGHLIGHT,
    INK,
    INSTRUMENT,
    MEASURED,
    MUTED,
    PREDICTED,
    SERIES,
)

__all__ = [
    "arm_figures", "correction_pictures", "correlation_picture", "error_histograms", "error_maps", "has_correction",
    "main_picture", "residual_figures", "residual_pictures", "selection_picture", "singular_value_picture",
    "uncertainty_map", "where_figures", "world_of",
]  # fmt: skip

_MOST_ARMS = 12  # drawn in a picture
_WHICH: dict[JudgedBy, str] = {
    "fresh": "the validation poses, without noise",
    "holdout": "the poses of the hold-out set",
    "cross-validation": "the poses of the cross-validation, each predicted by the fit without it",
    "file": "the poses of the validation file",
}
_FITTED = "the fitted poses, with the residuals of the fit"


class _ErrorMap(NamedTuple):
    sizes: tuple[SizeMap, SizeMap]  # before calibration and after it, by one scale
    which: str  # the poses of the errors, in words
    all_shown: bool


@dataclass(frozen=True)
class _ArmPoses:
    """The arm at some of its fitted poses, in the world."""

    first: str  # the id of the first of them: it stretches farthest along x, so that it is seen from both sides
    strips: tuple[Array, ...]  # lines (m, c, 3) m, along the chain or each leg
    joints: Array  # (m, f, 3) m, the frames on them
    tips: Array  # (m, k, 3) m, the targets at these poses
    points: Array  # (q, 3) m: targets at all fitted poses, as measured where they are
    measured: bool  # whether points are as measured
    head: Array | None  # (3,) m, the instrument; None where nothing is measured in its frame


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
    outliers = rows_called(result.measurements, [pose.id for pose in result.fit.outliers])
    crosses = _predicted(result, result.measurements.take(outliers)).reshape(-1, 3) if outliers else np.empty((0, 3))
    both = np.concatenate([before[rows], after[rows]])
    largest = max(float(np.percentile(both, 99)), 1e-12)
    scale = max(float(np.percentile(both, 1)), 1e-5 * largest), 1.001 * largest
    shown = SizeMap(points[rows], after[rows], f"{error} after calibration", crosses, range_m=scale, from_one_side=True)
    earlier = f"{error} before calibration"
    no_crosses = np.empty((0, 3))
    start = replace(shown, sizes=before[rows], size_means=earlier, crosses=no_crosses, name="before", with_scale=False)
    return _ErrorMap((start, shown), which, len(rows) == len(known))


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


def _arm_poses(result: CalibrationResult) -> _ArmPoses:
    """The calibrated arm at up to twelve of its fitted poses, evenly spaced, with the points of all of them."""
    fitted, identification = result.fitted, result.identification
    rows = np.unique(np.round(np.linspace(0, len(fitted) - 1, _MOST_ARMS)).astype(np.int_))
    arm, values = result.rigid(identification.values)
    T_world_frame0 = result.robot.model.T_world_frame0
    shown = skeleton(arm, values, fitted.joints[rows])
    lines = [moved(T_world_frame0, line) for line in shown.lines]
    joints = moved(T_world_frame0, shown.frames)
    tips = _predicted(result, fitted.take(rows))
    first = int(np.argmax(np.abs(joints[:, -1, 0] - joints[:, 0, 0])))
    order = [first, *(i for i in range(len(rows)) if i != first)]
    shape = fitted.ids[rows[first]], tuple(line[order] for line in lines), joints[order], tips[order]
    positions = observation_of(identification.model).positions
    if not positions:
        return _ArmPoses(*shape, _predicted(result, fitted).reshape(-1, 3), measured=False, head=None)
    T_world_instrument = world_of(result)
    model, inputs = identification.model, fitted.inputs(identification.model.conditions)
    points = in_first_frame(model, identification.values, inputs, fitted.points[:, :positions]).reshape(-1, 3)
    points = points[np.isfinite(points).all(axis=1)]
    return _ArmPoses(*shape, transform(T_world_instrument, points), True, T_world_instrument[:3, 3])


_WIDER = 1.15  # than the widest interval of a parameter that is well observed
_FAR = 1.3  # half the edge of the arm's cube: an instrument farther off is only pointed at


def main_picture(result: CalibrationResult) -> Picture:
    """The errors before and after calibration, or the corrections where there was no validation."""
    found = error_histograms(result, "error")
    return found[0] if found else correction_pictures(result)[0]


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
    shown = [(unit, rows) for unit, rows in by_unit.items() if rows]
    return tuple(_corrections(rows, unit, number) for number, (unit, rows) in enumerate(shown))


def _corrections(rows: Sequence[EstimatedParameter], unit: Unit, number: int) -> Picture:
    offsets = unit.of(np.array([row.estimate - row.nominal for row in rows]))
    halves = unit.of(np.array([row.half_width_95 for row in rows]))
    reach = np.abs(offsets) + np.nan_to_num(halves)
    known = [size for size, row in zip(reach, rows, strict=True) if not row.weakly_observable]
    limit = _WIDER * max(known) if known and max(known) > 0 else np.inf  # a weak parameter does not stretch the picture

    def draw(axes: Axes) -> None:
        at = np.arange(len(rows))[::-1]
        colours = [AFTER if sure else MUTED for sure in np.abs(offsets) > halves]
        inside, low, high = (np.clip(ends, -limit, limit) for ends in (offsets, offsets - halves, offsets + halves))
        axes.hlines(at, 0, inside, colors=colours, alpha=0.35, linewidth=4)
        axes.hlines(at, low, high, colors=colours, linewidth=1.2)
        for ends in (low, high):
            axes.scatter(ends, at, marker="|", c=colours, s=24, linewidths=1.2)
        axes.scatter(inside, at, c=colours, s=13)
        for i in np.flatnonzero(reach > limit):
            text = f"{short(offsets[i])} ± {short(halves[i])}"
            axes.annotate(text, (limit, at[i]), xytext=(-3, 2), textcoords="offset points", ha="right", fontsize=7)
        axes.axvline(0, color=INK, linewidth=1)
        axes.set_yticks(at, [row.name for row in rows])
        axes.locator_params(axis="x", nbins=5)
        axes.set(ylim=(-0.7, len(rows) - 0.3), xlabel=f"correction of the nominal value, {unit.name}")
        axes.tick_params(axis="y", length=0)
        axes.grid(visible=False, axis="y")
        axes.margins(x=0.06)

    label = f"Corrections of the nominal values with 95 % intervals, {unit.name}"
    height = 0.95 + 0.2 * len(rows)
    return axes_picture(f"corrections-{number}", label, (4.5, height), draw, (1.35, 0.5, 0.15, 0.15))


def singular_value_picture(values: Array) -> tuple[Picture, ...]:
    """Singular values ``(f,)`` relative to the largest, in descending order; none where they are not finite."""
    if not (len(values) and np.isfinite(values).all() and values[0] > 0):
        return ()
    relative = np.maximum(values / values[0], 1e-17)

    def draw(axes: Axes) -> None:
        order = np.arange(1, len(relative) + 1)
        axes.vlines(order, relative.min() / 10, relative, color=ARM, linewidth=1.5)
        axes.plot(order, relative, "o", color=HIGHLIGHT, markersize=4.5)
        log_ticks(axes, "y", min(relative.min() / 1.6, 0.06), 1.7)
        condition = f"condition number: {short(float(1 / relative[-1]))}"
        axes.annotate(condition, (0.99, 0.93), xycoords="axes fraction", ha="right", color=HIGHLIGHT)
        axes.set(xlabel="direction, from the best observed to the worst", ylabel="relative singular value")
        axes.set(xlim=(0.3, len(relative) + 0.7))
        axes.grid(visible=False, axis="x")

    label = "Singular values of the scaled Jacobian"
    return (axes_picture("singular-values", label, (5.6, 2.8), draw, (0.8, 0.5, 0.2, 0.15)),)


def _arm_views(arm: _ArmPoses) -> tuple[Picture, ...]:
    """The arm as a stick figure at its poses, with the points and the instrument, from above and from the side."""
    if not np.isfinite(arm.joints).all():
        return ()
    middle, half = cube([MM.of(arm.joints), MM.of(arm.tips), MM.of(arm.points)])
    if arm.head is not None and np.abs(MM.of(arm.head) - middle).max() < _FAR * half:
        middle, half = cube([MM.of(arm.joints), MM.of(arm.points), MM.of(arm.head)])

    def draw(axes: Axes, plane: tuple[int, int]) -> None:
        _sticks(axes, arm, plane)
        if arm.head is not None:
            _instrument(axes, MM.of(arm.head), middle, half, plane)
        view(axes, plane, middle, half, "base")
        axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.12), ncols=2)

    return tuple(
        axes_picture(
            f"arm-{which}",
            f"The arm at its poses, {'from above' if which == 'above' else 'from the side'}",
            (4.5, 4.85),
            lambda axes, plane=plane: draw(axes, plane),  # type: ignore[misc]
            (0.85, 0.85, 0.15, 0.3),  # places may have four digits and a sign
        )
        for which, plane in VIEWS.items()
    )


def _sticks(axes: Axes, arm: _ArmPoses, plane: tuple[int, int]) -> None:
    size = 9 if len(arm.points) <= 200 else 4
    word = "measured point" if arm.measured else "tool point"
    points = MM.of(arm.points[:: max(1, len(arm.points) // 1000)][:, plane])
    axes.scatter(points[:, 0], points[:, 1], s=size, c=MEASURED, label=word, zorder=3, linewidths=0)
    shown = [slice(0, 1), slice(1, None)] if len(arm.tips) > 1 else [slice(0, 1)]
    for rows in reversed(shown):  # the others first: few artists, since each takes its time
        first = rows.start == 0
        colour, wide = (HIGHLIGHT, 2.6) if first else (ARM, 1.1)
        joints = MM.of(arm.joints[rows][..., plane])  # (m, f, 2)
        tips = MM.of(arm.tips[rows][..., plane])  # (m, k, 2)
        held = np.stack([np.broadcast_to(joints[:, -1:], tips.shape), tips], axis=-2)
        axes.plot(*_parted(held), ":", color=colour, linewidth=0.8, zorder=2)
        links = [_parted(MM.of(strip[rows][..., plane])) for strip in arm.strips]
        axes.plot(
            *np.concatenate(links, axis=1),
            "-",
            color=colour,
            linewidth=wide,
            alpha=1.0 if first else 0.75,
            label=f"arm at pose {arm.first}" if first else f"arm at {len(arm.tips) - 1} other poses",
            zorder=4 if first else 1,
            solid_capstyle="round",
        )
        dot = 3.5 if first else 1.8
        axes.plot(*joints.reshape(-1, 2).T, "o", color=colour, markersize=dot, zorder=4 if first else 1)


def _parted(lines: Array) -> Array:
    """Lines ``(..., c, 2)`` as one ``(2, n)``, with NaN between them."""
    return np.pad(lines, [*[(0, 0)] * (lines.ndim - 2), (0, 1), (0, 0)], constant_values=np.nan).reshape(-1, 2).T


def _instrument(axes: Axes, head: Array, middle: Array, half: float, plane: tuple[int, int]) -> None:
    position, centre = head[list(plane)], middle[list(plane)]
    away = position - centre
    if np.abs(head - middle).max() < half:
        axes.plot(*position, "P", color=INSTRUMENT, markersize=9, linestyle="", label="instrument", zorder=5)
        return
    edge = away * half / np.abs(away).max()
    arrow = {"arrowstyle": "-|>", "color": INSTRUMENT, "linewidth": 2.0}
    axes.annotate("", centre + 0.98 * edge, centre + 0.78 * edge, arrowprops=arrow, zorder=5)
    far = f"to the instrument, {np.linalg.norm(head - middle) / 1e3:.1f} m"
    axes.plot([], [], color=INSTRUMENT, linewidth=2.0, label=far)


_MOST_POSES = 2000  # whose residuals are drawn
_WIDE, _SQUARE = (5.6, 2.6), (3.4, 3.2)  # inches
_QUANTILES = 120
_FEWEST = 8  # residuals that are drawn
_LINK = 0.13  # inches of a parameter


def residual_pictures(result: CalibrationResult) -> tuple[Picture, ...]:
    """The residuals per axis, mm: in the order of the poses, against each joint, and against a normal distribution."""
    found, data = result.identification, result.fitted
    positions = observation_of(found.model).positions
    if not positions:
        return ()
    predicted = found.model.points(data.inputs(found.model.conditions), found.values)[:, :positions]
    residuals = MM.of(data.points[:, :positions] - predicted)
    seen = residuals[np.isfinite(residuals)]
    if len(seen) < _FEWEST:
        return ()
    band = float(half_width_95(np.inf)) * 1e3 * found.sigma_m
    return (_in_order(result, residuals, band), _by_joint(result, residuals, band), _quantiles(seen))


def _drawn(residuals: Array) -> NDArray[np.int_]:
    """The poses of residuals ``(n, ...)`` that are drawn: all, or some evenly spaced."""
    some = evenly(len(residuals), _MOST_POSES)
    return np.arange(len(residuals)) if some is None else some


def _in_order(result: CalibrationResult, residuals: Array, band: float) -> Picture:
    time = result.fitted.conditions.get("time_s")
    timed = time is not None and bool(np.isfinite(time).all())
    at = (time - time.min()) / 60 if timed and time is not None else np.arange(1.0, len(residuals) + 1)
    drawn = _drawn(residuals)

    def draw(axes: Axes) -> None:
        for axis, (colour, mark, _) in zip(range(3), SERIES[:3], strict=True):
            values = residuals[drawn, :, axis]
            axes.plot(
                np.repeat(at[drawn], values.shape[1]), values.ravel(), mark, color=colour, markersize=3,
                label="xyz"[axis], rasterized=True,
            )  # fmt: skip
        _band(axes, band)
        axes.set(xlabel="time, min" if timed else "pose, in the order of the file", ylabel="residual per axis, mm")
        axes.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=3)

    outside = 100 * float(np.mean(np.abs(residuals[np.isfinite(residuals)]) > band)) if np.isfinite(band) else 0.0
    label = f"Residuals per axis {'in time' if timed else 'by pose'}: {outside:.0f} % outside the band of 95 % of noise"
    return axes_picture("residuals-time", label, _WIDE, draw, (0.8, 0.5, 0.15, 0.3))


def _by_joint(result: CalibrationResult, residuals: Array, band: float) -> Picture:
    joints, chain = result.fitted.joints, result.robot.chain
    low, high = joints.min(axis=0), joints.max(axis=0)
    share = (joints - low) / np.where(high > low, high - low, 1.0)
    per_pose = residuals.reshape(len(residuals), -1)
    per_pose = per_pose[:, : max(1, _MOST_POSES // max(1, len(per_pose)))]
    drawn = _drawn(residuals)

    def draw(axes: Axes) -> None:
        for joint, name in enumerate(chain.joint_names):
            at = joint + 0.06 + 0.88 * share[drawn, joint]
            axes.plot(
                np.repeat(at, per_pose.shape[1]), per_pose[drawn].ravel(), "o", color=AFTER, markersize=2, alpha=0.6,
                rasterized=True,
            )  # fmt: skip
            if joint:
                axes.axvline(joint, color=ARM, linewidth=0.8)
            unit = chain.unit(joint)
            ends = f"{unit.of(low[joint]):.0f} to {unit.of(high[joint]):.0f} {unit.name}".replace("-", "−")
            axes.annotate(
                f"{name}\n{ends}", (joint + 0.5, -0.05), xycoords=("data", "axes fraction"), ha="center", va="top",
                fontsize=7,
            )  # fmt: skip
        _band(axes, band)
        axes.set(xlim=(0, chain.size), xticks=[], ylabel="residual per axis, mm")
        axes.grid(visible=False, axis="x")

    known = np.isfinite(per_pose)
    sums, counts = np.where(known, np.abs(per_pose), 0.0).sum(axis=1), known.sum(axis=1)
    seen = counts > 0
    sizes = sums[seen] / counts[seen]
    correlations = [abs(_rank_correlation(share[seen, j], sizes)) for j in range(chain.size)]
    label = f"Residuals against each joint: the largest rank correlation of their sizes is {max(correlations):.2f}"
    return axes_picture("residuals-joints", label, _WIDE, draw, (0.8, 0.55, 0.15, 0.15))


def _rank_correlation(at: Array, sizes: Array) -> float:
    if np.ptp(at) == 0 or np.ptp(sizes) == 0:
        return 0.0
    return float(np.corrcoef(_ranks(at), _ranks(sizes))[0, 1])


def _ranks(values: Array) -> Array:
    """Return the rank of each value in ascending order; ties share their mean rank."""
    _, which, count = np.unique(values, return_inverse=True, return_counts=True)
    return np.asarray((np.cumsum(count) - (count - 1) / 2)[which])


def _quantiles(residuals: Array) -> Picture:
    """Ordered residuals over their RMS against a normal distribution, with the 95 % band of single quantiles."""
    size = float(np.sqrt(np.mean(residuals**2))) or 1.0
    share = (np.arange(1, min(len(residuals), _QUANTILES) + 1) - 0.5) / min(len(residuals), _QUANTILES)
    expected, found = normal_ppf(share), np.quantile(residuals / size, share)
    ranks = share * len(residuals)
    low, high = (normal_ppf(beta_ppf(p, ranks + 0.5, len(residuals) - ranks + 0.5)) for p in (0.025, 0.975))
    outside = float(np.mean((found < low) | (found > high)))

    def draw(axes: Axes) -> None:
        axes.fill_between(expected, low, high, color=PREDICTED, alpha=0.18, linewidth=0)
        axes.plot(expected, expected, color=INK, linewidth=0.8)
        axes.plot(expected, found, "o", color=AFTER, markersize=3, rasterized=True)
        axes.set(xlabel="normal distribution, σ", ylabel="residuals over their RMS")

    label = f"Q-Q: {100 * outside:.0f} % of the quantiles lie outside the 95 % band of a normal distribution"
    return axes_picture("residuals-normal", label, _SQUARE, draw, (0.6, 0.5, 0.15, 0.15))


def _band(axes: Axes, band: float) -> None:
    axes.axhline(0, color=INK, linewidth=0.8)
    if np.isfinite(band):
        axes.axhspan(-band, band, color=PREDICTED, alpha=0.13, linewidth=0)


def correlation_picture(result: CalibrationResult) -> tuple[Picture, ...]:
    """Correlations of the identified parameters, a block for each link; nothing where they are not known."""
    found, std = result.identification, result.identification.std
    if len(std) < 2 or not (np.isfinite(std).all() and (std > 0).all()):
        return ()
    matrix = found.covariance / np.outer(std, std)
    names = [found.model.names[i] for i in found.fit.free]
    owners = [name.rpartition(".")[0] for name in names]
    edges = [i for i in range(1, len(owners)) if owners[i].split(".")[0] != owners[i - 1].split(".")[0]]
    firsts = [0, *edges]

    def draw(axes: Axes) -> None:
        axes.imshow(shades((matrix + 1) / 2, (BEFORE, "#ffffff", AFTER)))
        for edge in edges:
            axes.axhline(edge - 0.5, color=ARM, linewidth=0.8)
            axes.axvline(edge - 0.5, color=ARM, linewidth=0.8)
        middles = [(a + b - 1) / 2 for a, b in zip(firsts, [*edges, len(names)], strict=True)]
        labels = [owners[i].split(".")[0] for i in firsts]
        axes.set_yticks(middles, labels)
        axes.set_xticks(middles, labels, rotation=90)
        axes.tick_params(length=0)
        axes.grid(visible=False)

    upper = np.abs(np.triu(matrix, 1))
    i, j = np.unravel_index(int(upper.argmax()), upper.shape)
    label = f"Correlations of the parameters: the strongest, {matrix[i, j]:.2f}, is of {names[i]} and {names[j]}"
    size = min(max(3.4, 1.3 + _LINK * len(names)), 5.6)
    return (axes_picture("correlations", label, (size, size - 0.4), draw, (0.75, 0.7, 0.3, 0.1)),)


def selection_picture(result: CalibrationResult) -> tuple[Picture, ...]:
    """The hold-out error as groups are taken into the model, one after the other; nothing where there is no choice."""
    tried = [each for each in result.groups if each.chosen and np.isfinite(each.holdout_m)]
    if len(tried) < 2:
        return ()
    errors = MM.of(np.array([each.holdout_m for each in tried]))

    def draw(axes: Axes) -> None:
        at = np.arange(len(tried))[::-1]
        axes.barh(at[0], errors[0], color=BEFORE, hatch=HATCH_BEFORE, alpha=0.75)
        falls = errors[:-1] - errors[1:]
        colours = [AFTER if fall >= 0 else BEFORE for fall in falls]
        axes.barh(at[1:], falls, left=errors[1:], color=colours, alpha=0.85)
        axes.vlines(errors[:-1], at[1:] - 0.4, at[:-1] + 0.4, color=INK, linewidth=0.8)
        for place, error, end in zip(at, errors, np.maximum(errors, np.roll(errors, 1)), strict=True):
            right = error if place == at[0] else end
            falls_to = "" if place == at[0] else "→ "
            axes.annotate(f"\u00a0{falls_to}{short(error)}", (right, place), va="center", ha="left", fontsize=8)
        axes.set_yticks(at, [each.name for each in tried])
        axes.set(xlabel="hold-out error, mm", xlim=(0, 1.18 * errors.max()))
        axes.grid(visible=False, axis="y")

    label = f"Model selection: the hold-out error falls from {short(errors[0])} to {short(errors[-1])} mm"
    return (axes_picture("selection", label, (5.6, 1.0 + 0.28 * len(tried)), draw, (1.6, 0.5, 0.2, 0.1)),)


def uncertainty_map(result: CalibrationResult, range_m: tuple[float, float] | None) -> SizeMap | None:
    """The predicted position error over random poses of the workspace; crosses: beyond the measured joints.

    Args:
        range_m: ends of the scale that it shares with maps of errors; None where there are none.
    """
    found = predicted_errors(result.identification, result.fit.measured)
    if found is None:
        return None
    inputs, sizes = found
    joints = inputs[:, : result.robot.chain.size]
    measured = result.fitted.joints
    beyond = ((joints < measured.min(axis=0)) | (joints > measured.max(axis=0))).any(axis=1)
    arm, values = result.rigid(result.identification.values)
    points = moved(world_of(result), arm.points(joints, values))[:, 0]
    return SizeMap(
        points,
        sizes,
        "predicted error (RMS)",
        points[beyond],
        "outside the measured joint range",
        name="uncertainty",
        range_m=range_m,
        with_scale=range_m is None,
        from_one_side=True,
    )


def where_figures(result: CalibrationResult) -> tuple[Block, ...]:
    """Errors before and after calibration where they are, and the predicted ones over the workspace."""
    found = error_maps(result, result.kind.terms.error)
    predicted = _predicted_map(result, None if found is None else found.sizes[0].range_m)
    if found is None:
        return predicted
    part = "" if found.all_shown else f"; {MOST_POINTS} of them, evenly from the smallest error to the largest"
    before, after = found.sizes
    caption = (
        f"The maps show {found.which}{part}: first before calibration, then after it. Darker points have larger "
        "errors; all maps share one logarithmic scale."
    )
    if len(after.crosses):
        caption += " Crosses mark the predicted positions of the outliers."
    return (Figure("where", (*size_maps(before), *size_maps(after)), caption), *predicted)


def _predicted_map(result: CalibrationResult, range_m: tuple[float, float] | None) -> tuple[Block, ...]:
    found = uncertainty_map(result, range_m)
    if found is None:
        return ()
    caption = (
        "The map shows the predicted error (RMS) at random poses of the workspace. Crosses mark poses outside the "
        "measured joint range: the model is extrapolated there, and its discrepancy may be larger."
    )
    return (Figure("uncertainty", size_maps(found), caption),)


def residual_figures(result: CalibrationResult) -> tuple[Block, ...]:
    """Residuals in time, against each joint, and against a normal distribution."""
    caption = (
        "The plots show the residuals of the fit per axis; the band contains 95 % of the noise. Bends or steps against "
        "a joint show effects that the model lacks. In the last plot, normal noise lies on the line, within the band."
    )
    if len(result.fitted) > _MOST_POSES:
        drawn = f"{_MOST_POSES:,} of the {len(result.fitted):,} poses are drawn, evenly spaced"
        caption += f" {drawn}; the titles refer to all poses."
    return (Figure("residuals", residual_pictures(result), caption),)


def arm_figures(result: CalibrationResult) -> tuple[Block, ...]:
    """The arm at its poses."""
    arm = _arm_poses(result)
    points = "measured points" if arm.measured else "tool points predicted by the calibrated model"
    caption = f"Lines connect the joints of the calibrated arm at {len(arm.joints)} poses; dots are all {points}."
    return (Figure("arm", _arm_views(arm), caption),)
