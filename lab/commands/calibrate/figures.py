"""The pictures of a calibration's report: errors, corrections of parameters, singular values, the arm at its poses."""

from collections.abc import Sequence

import numpy as np

from lab.calibration.estimate import EstimatedParameter
from lab.commands.calibrate.error_map import ArmPoses
from lab.commands.calibrate.result import CalibrationResult
from lab.core.se3 import Array
from lab.kinematics.parameter import Parameter
from lab.render.charts.axes import Axes
from lab.render.document import Picture
from lab.render.format import short
from lab.render.plots import VIEWS, Spread, histograms
from lab.render.style import (
    AFTER,
    ARM,
    BEFORE,
    HATCH_AFTER,
    HATCH_BEFORE,
    HIGHLIGHT,
    INK,
    INSTRUMENT,
    MARK_AFTER,
    MARK_BEFORE,
    MEASURED,
    MUTED,
)
from lab.render.svg import axes_picture, cube, log_ticks, view
from lab.render.units import DisplayUnit, display_unit

__all__ = [
    "arm_views",
    "correction_pictures",
    "error_histograms",
    "has_correction",
    "main_picture",
    "singular_value_picture",
]

_WIDER = 1.15  # than the widest interval of a parameter that is well observed
_FAR = 1.3  # half the edge of the arm's cube: an instrument farther off is only pointed at


def main_picture(result: CalibrationResult) -> Picture:
    """The errors before and after calibration, or the corrections where there was no validation."""
    found = error_histograms(result, "error")
    return found[0] if found else correction_pictures(result)[0]


def error_histograms(result: CalibrationResult, error: str) -> tuple[Picture, ...]:
    """How the errors are spread before and after calibration; nothing without a validation."""
    errors = result.validation.errors
    if errors is None or not np.isfinite(errors.after).any():
        return ()
    spreads = [
        Spread(errors.before, BEFORE, ("before: mean", float(np.nanmean(errors.before))), HATCH_BEFORE, MARK_BEFORE),
        Spread(errors.after, AFTER, ("after: mean", float(np.nanmean(errors.after))), HATCH_AFTER, MARK_AFTER),
    ]
    return (histograms("errors", spreads, error, result.options.gate_mm),)


def has_correction(parameter: Parameter, row: EstimatedParameter) -> bool:
    """Whether the nominal model says what the parameter would be: base, tool and fixtures are only placed."""
    return row.identified and bool(np.isfinite(parameter.scale))


def correction_pictures(result: CalibrationResult) -> tuple[Picture, ...]:
    """By how much parameters differ from their nominal values, with 95 % intervals, a picture for each unit."""
    by_unit: dict[str, list[EstimatedParameter]] = {"mm": []}
    units = dict[str, DisplayUnit]()
    for parameter, row in zip(result.identification.model.parameters, result.parameters, strict=True):
        if has_correction(parameter, row):
            unit = display_unit(parameter)
            units.setdefault(unit.name, unit)
            by_unit.setdefault(unit.name, []).append(row)
    shown = [(units[name], rows) for name, rows in by_unit.items() if rows]
    return tuple(_corrections(rows, unit, number) for number, (unit, rows) in enumerate(shown))


def _corrections(rows: Sequence[EstimatedParameter], display: DisplayUnit, number: int) -> Picture:
    factor, unit, _ = display
    offsets = factor * np.array([row.estimate - row.nominal for row in rows])
    halves = factor * np.array([row.half_width_95 for row in rows])
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
            words = f"{short(offsets[i])} ± {short(halves[i])}"
            axes.annotate(words, (limit, at[i]), xytext=(-3, 2), textcoords="offset points", ha="right", fontsize=7)
        axes.axvline(0, color=INK, linewidth=1)
        axes.set_yticks(at, [row.name for row in rows])
        axes.locator_params(axis="x", nbins=5)
        axes.set(ylim=(-0.7, len(rows) - 0.3), xlabel=f"correction of the nominal value, {unit}")
        axes.tick_params(axis="y", length=0)
        axes.grid(visible=False, axis="y")
        axes.margins(x=0.06)

    label = f"Corrections of the nominal values with 95 % intervals, {unit}"
    height = 0.95 + 0.2 * len(rows)
    return axes_picture(f"corrections-{number}", label, (4.5, height), draw, (1.35, 0.5, 0.15, 0.15))


def singular_value_picture(values: Array) -> tuple[Picture, ...]:
    """Singular values ``(f,)`` relative to the largest, in descending order; nothing where they say nothing."""
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


def arm_views(arm: ArmPoses) -> tuple[Picture, ...]:
    """The arm as a stick figure at its poses, with the points and the instrument, from above and from the side."""
    if not np.isfinite(arm.joints).all():
        return ()
    middle, half = cube([1e3 * arm.joints, 1e3 * arm.tips, 1e3 * arm.points])
    if arm.head is not None and np.abs(1e3 * arm.head - middle).max() < _FAR * half:
        middle, half = cube([1e3 * arm.joints, 1e3 * arm.points, 1e3 * arm.head])

    def draw(axes: Axes, plane: tuple[int, int]) -> None:
        _sticks(axes, arm, plane)
        if arm.head is not None:
            _instrument(axes, 1e3 * arm.head, middle, half, plane)
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


def _sticks(axes: Axes, arm: ArmPoses, plane: tuple[int, int]) -> None:
    """Links, joints, targets and points."""
    size = 9 if len(arm.points) <= 200 else 4
    word = "measured point" if arm.measured else "tool point"
    points = 1e3 * arm.points[:: max(1, len(arm.points) // 1000)][:, plane]
    axes.scatter(points[:, 0], points[:, 1], s=size, c=MEASURED, label=word, zorder=3, linewidths=0)
    shown = [slice(0, 1), slice(1, None)] if len(arm.tips) > 1 else [slice(0, 1)]
    for rows in reversed(shown):  # the others first: few artists, since each takes its time
        first = rows.start == 0
        colour, wide = (HIGHLIGHT, 2.6) if first else (ARM, 1.1)
        joints = 1e3 * arm.joints[rows][..., plane]  # (m, f, 2)
        tips = 1e3 * arm.tips[rows][..., plane]  # (m, k, 2)
        held = np.stack([np.broadcast_to(joints[:, -1:], tips.shape), tips], axis=-2)
        axes.plot(*_parted(held), ":", color=colour, linewidth=0.8, zorder=2)
        links = [_parted(1e3 * strip[rows][..., plane]) for strip in arm.strips]
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
    """The instrument, or an arrow towards it at the edge of the view where it is farther off."""
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
