"""The pictures by which a fit is checked: residuals, correlations, the path of model selection, predicted errors."""

import numpy as np
from numpy.typing import NDArray

from lab.calibration.observation import observation_of
from lab.calibration.workspace_prediction import predicted_errors
from lab.commands.calibrate.result import CalibrationResult
from lab.commands.calibrate.scene import world_of
from lab.core.linear_model import half_width_95
from lab.core.measurements import evenly
from lab.core.probabilities import beta_ppf, normal_ppf
from lab.core.se3 import Array
from lab.render.charts.axes import Axes
from lab.render.document import Picture
from lab.render.format import short
from lab.render.plots import SizeMap
from lab.render.scene import moved
from lab.render.style import AFTER, ARM, BEFORE, HATCH_BEFORE, INK, PREDICTED, SERIES
from lab.render.svg import axes_picture, shades

__all__ = ["MOST_POSES", "correlation_picture", "residual_pictures", "selection_picture", "uncertainty_map"]

MOST_POSES = 2000  # whose residuals are drawn
_WIDE, _SQUARE = (5.6, 2.6), (3.4, 3.2)  # inches
_QUANTILES = 120
_FEWEST = 8  # residuals whose shape says something
_LINK = 0.13  # inches of a parameter


def residual_pictures(result: CalibrationResult) -> tuple[Picture, ...]:
    """The residuals per axis, mm: in the order of the poses, against each joint, and against a normal distribution."""
    found, data = result.identification, result.fitted
    positions = observation_of(found.model).positions
    if not positions:
        return ()
    predicted = found.model.points(data.inputs(found.model.conditions), found.values)[:, :positions]
    residuals = 1e3 * (data.points[:, :positions] - predicted)
    seen = residuals[np.isfinite(residuals)]
    if len(seen) < _FEWEST:
        return ()
    band = float(half_width_95(np.inf)) * 1e3 * found.sigma_m
    return (_in_order(result, residuals, band), _by_joint(result, residuals, band), _quantiles(seen))


def _drawn(residuals: Array) -> NDArray[np.int_]:
    """The poses of residuals ``(n, ...)`` that are drawn: all, or some evenly spaced."""
    some = evenly(len(residuals), MOST_POSES)
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
    """A lane for each joint, over the range that was measured."""
    joints, chain = result.fitted.joints, result.robot.chain
    low, high = joints.min(axis=0), joints.max(axis=0)
    share = (joints - low) / np.where(high > low, high - low, 1.0)
    per_pose = residuals.reshape(len(residuals), -1)
    per_pose = per_pose[:, : max(1, MOST_POSES // max(1, len(per_pose)))]
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
            factor, unit = (1e3, "mm") if chain.prismatic[joint] else (180 / np.pi, "°")
            ends = f"{factor * low[joint]:.0f} to {factor * high[joint]:.0f} {unit}".replace("-", "−")
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
    label = f"Residuals against each joint: the sizes' rank correlation is {max(correlations):.2f} at most"
    return axes_picture("residuals-joints", label, _WIDE, draw, (0.8, 0.55, 0.15, 0.15))


def _rank_correlation(at: Array, sizes: Array) -> float:
    if np.ptp(at) == 0 or np.ptp(sizes) == 0:
        return 0.0
    return float(np.corrcoef(_ranks(at), _ranks(sizes))[0, 1])


def _ranks(values: Array) -> Array:
    """Which of the values, in ascending order, each is; equal ones share the mean of theirs."""
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
    errors = 1e3 * np.array([each.holdout_m for each in tried])

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
        "beyond the measured joints",
        name="uncertainty",
        range_m=range_m,
        with_scale=range_m is None,
        from_one_side=True,
    )
