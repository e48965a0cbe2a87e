"""Still pictures of a plan: predicted error and O1 against the number of poses, where the poses are, their joints."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from lab.commands.design.result import DesignResult, DesignStep
from lab.commands.design.scene import PlanScene
from lab.core.se3 import Array
from lab.kinematics.joints import JointSpec
from lab.render.charts.axes import Axes
from lab.render.charts.marks import colour
from lab.render.document import Picture
from lab.render.format import short
from lab.render.plots import SQUARE, VIEWS
from lab.render.style import (
    ARM,
    AXIS,
    BOUND,
    EQUAL_CONTRAST,
    GRID,
    INDEX,
    INK,
    INSTRUMENT,
    ORDER_SCALE,
    REFERENCE,
    RMS,
    TICK,
    WORST,
    luminance,
)
from lab.render.svg import axes_picture, cube, shades, view

__all__ = ["curve_pictures", "draw_errors", "draw_information", "pose_pictures"]

_HALF, _WIDE = (4.8, 3.6), (8.0, 2.6)  # inches
_ROOM = 0.2  # around the poses, of their width: for the legend
_EDGE = 0.94  # of the half of a picture
_NUMBER = 6.5  # points, of a pose's number
_TICKS = (1, 2, 3, 5)  # of each power of ten


def curve_pictures(plan: DesignResult) -> tuple[Picture, ...]:
    """Predicted errors against the number of poses with the plan's; beside them O1, where each number was designed."""
    chosen = len(plan.joints), plan.prediction.coverage_radius
    scaling = plan.problem.scaling.describe()
    errors = axes_picture(
        "curve", "Predicted error against the number of poses", _HALF,
        lambda axes: draw_errors(axes, plan.curve, chosen), (0.65, 0.5, 0.15, 0.3),
    )  # fmt: skip
    if not plan.options.curve:  # of a continuous design O1 is the same for any number
        return (errors,)
    information = axes_picture(
        "information", "O1 against the number of poses", _HALF,
        lambda axes: draw_information(axes, plan.curve, scaling, chosen[0]), (0.65, 0.5, 0.15, 0.3),
    )  # fmt: skip
    return errors, information


def pose_pictures(plan: DesignResult) -> tuple[Picture, ...]:
    """The targets from above and from the side, and the joint positions in their ranges."""
    targets = (
        axes_picture(f"poses-{name}", f"The targets from {'the side' if name == 'side' else name}", SQUARE,
                     lambda axes, plane=plane: _targets(axes, plan.scene, plane),  # type: ignore[misc]
                     (0.75, 0.5, 0.15, 0.3))
        for name, plane in VIEWS.items()
    )  # fmt: skip
    joints = axes_picture(
        "joints", "The joint positions in their ranges", _WIDE,
        lambda axes: _joints(axes, plan.problem.robot.chain, plan.joints), (1.0, 0.15, 0.2, 0.3),
    )  # fmt: skip
    return (*targets, joints)


def draw_errors(axes: Axes, curve: Sequence[DesignStep], chosen: tuple[int, float] | None = None) -> None:
    """Draw predicted errors on validation poses (µm, logarithmic) against the number of poses.

    Args:
        chosen: the plan's number of poses, and its tolerance bound (m).
    """
    poses = [step.poses for step in curve]
    drawn = [1e6 * np.array([_rms(s.prediction.rms) for s in curve])]
    for label, values, tint, style in (
        ("95 %/95 % tolerance bound", [s.prediction.coverage_radius for s in curve], BOUND, "o-"),
        ("worst pose, RMS", [s.prediction.rms.max() for s in curve], WORST, "^:"),
        ("all poses, RMS", [_rms(s.prediction.rms) for s in curve], RMS, "s:"),
    ):
        drawn.append(1e6 * np.array(values))
        axes.plot(poses, drawn[-1], style, color=tint, label=label, markersize=5)
    if chosen is not None:
        said = f"this plan: {chosen[0]} poses, {short(1e6 * chosen[1])} µm"
        drawn.append(np.array([1e6 * chosen[1]]))
        axes.axvline(chosen[0], color=REFERENCE, linewidth=1)
        axes.plot([chosen[0]], drawn[-1], "D", color=REFERENCE, markersize=8, label=said, zorder=4)
    every = np.concatenate(drawn)
    low, high = float(every.min()) / 1.2, float(every.max()) * 1.2
    ticks = [m * 10.0**e for e in range(-9, 9) for m in _TICKS if low <= m * 10.0**e <= high]
    axes.set(yscale="log", ylim=(low, high))
    axes.set_yticks(ticks, [f"{tick:g}" for tick in ticks])
    axes.set_yticks([], minor=True)
    axes.set(xlabel="poses", ylabel="predicted position error, µm (logarithmic)", title="Error on validation poses")
    axes.legend(loc="upper right")


def draw_information(axes: Axes, curve: Sequence[DesignStep], scaling: str, chosen: int | None = None) -> None:
    """Draw O1, the information per pose, against the number of poses.

    Args:
        scaling: of O1, in words.
        chosen: the plan's number of poses.
    """
    o1 = [step.o1 for step in curve]
    axes.plot([step.poses for step in curve], o1, "D--", color=INDEX, markersize=4)
    if chosen is not None:
        axes.axvline(chosen, color=REFERENCE, linewidth=1)
    axes.set(xlabel="poses", ylabel=f"O1 ({scaling})", title="Information per pose", ylim=(0, 1.1 * max(o1)))


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(values**2)))


def _first_visits(points: Array) -> tuple[NDArray[np.int_], list[int]]:
    """Rows of points ``(n, 3)`` mm at which a place is visited first, and how often each is: a reference pose again."""
    places: dict[tuple[float, ...], list[int]] = {}
    for row, point in enumerate(np.round(points, 3)):
        places.setdefault(tuple(point + 0.0), []).append(row)
    return np.array([rows[0] for rows in places.values()], int), [len(rows) for rows in places.values()]


def _in_order(rows: NDArray[np.int_], count: int) -> Array:
    """The colours ``(n, 3)`` of rows ``(n,)`` of so many: dark for the first, light for the last."""
    return shades(rows / max(count - 1, 1), ORDER_SCALE)


def _targets(axes: Axes, shown: PlanScene, plane: tuple[int, int]) -> None:
    """Target positions in mm on a plane of the world, with the way between them, the arm at home and the tracker."""
    i, j = plane
    mm = 1e3
    every = mm * shown.points[shown.measured, 0]
    middle, half = cube([mm * shown.path, every, *(mm * line for line in shown.home)], _ROOM)
    view(axes, plane, middle, half, "world", "Targets")
    axes.plot(mm * shown.path[:, i], mm * shown.path[:, j], color=AXIS, linewidth=0.6, alpha=0.8, label="their way")
    for k, line in enumerate(mm * each for each in shown.home):
        label = "" if k else "robot at home"
        axes.plot(line[:, i], line[:, j], "o-", color=ARM, linewidth=5, alpha=0.45, markersize=6, label=label)
    rows, visits = _first_visits(every)
    points, tints = every[rows][:, plane], _in_order(rows, len(every))
    axes.scatter(
        points[:, 0], points[:, 1], s=110, c=tints, edgecolors="white", linewidths=1, label="at a pose", zorder=3
    )
    for row, place, tint, times in zip(rows, points, tints, visits, strict=True):
        ink = "white" if luminance(tint) < EQUAL_CONTRAST else "black"
        own = {"boxstyle": "circle,pad=0.05", "facecolor": colour(tint), "edgecolor": "none"}  # where points overlap
        axes.annotate(shown.ids[row], place, ha="center", va="center", fontsize=_NUMBER, color=ink, bbox=own, zorder=4)
        if times > 1:
            axes.annotate(
                f"{times} visits", place, xytext=(8, 5), textcoords="offset points", fontsize=7, color=INK,
                bbox={"boxstyle": "round,pad=0.1", "facecolor": "white", "edgecolor": "none"}, zorder=5,
            )  # fmt: skip
    via = ~shown.measured
    via[[0, -1]] = False
    if via.any():
        passed = mm * shown.points[via, 0]
        axes.plot(passed[:, i], passed[:, j], "x", color=REFERENCE, label="passed only", zorder=3)
    head, said = _at_edge(mm * shown.head - middle, half, plane)
    axes.plot([middle[i] + head[0]], [middle[j] + head[1]], "P", color=INSTRUMENT, markersize=12, label=said, zorder=4)
    if j == 2:
        axes.axhline(0.0, color=TICK, linewidth=1)
    axes.legend(loc="best", frameon=True)


def _at_edge(head: Array, half: float, plane: tuple[int, int]) -> tuple[Array, str]:
    """Where a tracker at ``(3,)`` mm from the middle is drawn on a plane ``(2,)``, and its words.

    One that is beyond the picture is drawn at its edge.
    """
    seen = head[list(plane)]
    beyond = float(np.abs(seen).max()) / (_EDGE * half)
    if beyond <= 1:
        return seen, "tracker"
    return seen / beyond, f"to the tracker, {np.linalg.norm(seen) / 1e3:.1f} m"


def _joints(axes: Axes, chain: JointSpec, joints: Array) -> None:
    """Every joint position in its joint's range, the limits written at its ends."""
    share = (joints - chain.lower) / (chain.upper - chain.lower)
    rows = np.arange(chain.size)[::-1]
    axes.hlines(rows, 0, 1, color=GRID, linewidth=9)
    for k, row in enumerate(rows):
        tints = _in_order(np.arange(len(share)), len(share))
        axes.scatter(share[:, k], np.full(len(share), row), c=tints, s=45, edgecolors="white", linewidths=1, zorder=3)
        scale, unit = (1e3, "mm") if chain.prismatic[k] else (180 / np.pi, "°")
        for x, value, side in ((-0.01, chain.lower[k], "right"), (1.01, chain.upper[k], "left")):
            axes.annotate(f"{scale * value:.0f} {unit}".replace("-", "−"), (x, row), ha=side, va="center", color=TICK)
    axes.set_yticks(rows, chain.joint_names)
    axes.tick_params(axis="y", length=0)
    axes.set(xlim=(-0.09, 1.09), ylim=(-0.6, chain.size - 0.4), xticks=[], title="Joint positions between the limits")
    axes.grid(visible=False)
