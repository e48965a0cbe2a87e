"""Still pictures of a plan: predicted error against the number of poses, and where the poses are.

matplotlib is slow to import, so it is imported where something is drawn, and not before.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from lab.commands.design.result import DesignResult, DesignStep
from lab.core.se3 import Array
from lab.kinematics.joints import JointSpec
from lab.render.document import Picture
from lab.render.style import (
    ARM,
    AXIS,
    BOUND,
    EQUAL_CONTRAST,
    FIGURE_STYLE,
    GRID,
    INDEX,
    INK,
    INSTRUMENT,
    ORDER_MAP,
    REFERENCE,
    RMS,
    TICK,
    WORST,
    luminance,
)
from lab.render.svg import save_figure

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from lab.commands.design.scene import PlanScene

__all__ = ["curve_figure", "curve_picture", "poses_picture", "write_figures"]


def write_figures(folder: Path, plan: DesignResult) -> None:
    """Write ``curve`` and ``poses`` into the folder, each as PNG and SVG."""
    for picture in (curve_picture(plan), poses_picture(plan)):
        save_figure(folder, picture.name, picture.draw())


def curve_picture(plan: DesignResult) -> Picture:
    """Predicted errors and O1 against the number of poses, with the plan's."""
    extended = len(plan.problem.already)
    added = f" added to {extended} measured already" if extended else ""
    title = f"{plan.problem.robot.name}, {plan.options.instrument}: predicted error against poses{added}"
    chosen = (len(plan.joints), plan.prediction.coverage_radius)
    scaling = plan.problem.scaling.describe()
    return Picture("curve", "Predicted error and O1 against the number of poses",
                   lambda: curve_figure(plan.curve, title, scaling, chosen))  # fmt: skip


def poses_picture(plan: DesignResult) -> Picture:
    """The targets from above and from the side, and the joint positions in their ranges."""
    label = "The targets from above and from the side, and the joint positions in their ranges"
    return Picture("poses", label, lambda: _poses_figure(plan))


def curve_figure(
    curve: Sequence[DesignStep], title: str, scaling: str, chosen: tuple[int, float] | None = None
) -> "Figure":
    """Predicted errors on validation poses (µm, left) and O1 (right) against the number of poses.

    Args:
        scaling: of O1, in words.
        chosen: the plan's number of poses, and its tolerance bound (m).
    """
    import matplotlib
    from matplotlib.figure import Figure

    with matplotlib.rc_context(FIGURE_STYLE):
        figure = Figure(figsize=(9, 6), layout="constrained")
        axes = figure.add_subplot()
        poses = [step.poses for step in curve]
        for label, values, colour, style in (
            ("95 %/95 % tolerance bound", [s.prediction.coverage_radius for s in curve], BOUND, "o-"),
            ("worst pose, RMS over simulated calibrations", [s.prediction.rms.max() for s in curve], WORST, "^:"),
            ("all poses, RMS over simulated calibrations", [_rms(s.prediction.rms) for s in curve], RMS, "s:"),
        ):
            axes.plot(poses, 1e6 * np.array(values), style, color=colour, label=label, markersize=5)
        _log_scale(axes)
        second = axes.twinx()
        second.plot(poses, [step.o1 for step in curve], "D--", color=INDEX, label="O1 (right)", markersize=4)
        second.set_ylim(0, 1.1 * max(step.o1 for step in curve))
        second.set_ylabel(f"O1, information per pose\n({scaling})", color=INDEX)
        second.tick_params(axis="y", colors=INDEX)
        second.grid(visible=False)
        if chosen is not None:
            axes.axvline(chosen[0], color=REFERENCE, linewidth=1)
            axes.plot([chosen[0]], [1e6 * chosen[1]], "*", color=REFERENCE, markersize=14,
                      label=f"this plan: {chosen[0]} poses, {1e6 * chosen[1]:.3g} µm")  # fmt: skip
        axes.set(xlabel="poses", ylabel="predicted position error on validation poses, µm", title=title)
        lines = [*axes.get_legend_handles_labels()[0], *second.get_legend_handles_labels()[0]]
        labels = [str(line.get_label()) for line in lines]
        figure.legend(lines, labels, loc="outside lower center", ncols=3, fontsize=9)
    return figure


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(values**2)))


def _log_scale(axes: "Axes") -> None:
    """A logarithmic left axis with plain numbers."""
    axes.set_yscale("log")
    low, high = axes.get_ylim()
    ticks = [m * 10.0**e for e in range(-9, 9) for m in (1, 2, 3, 5) if low <= m * 10.0**e <= high]
    axes.set_yticks(ticks, [f"{tick:g}" for tick in ticks])
    axes.set_yticks([], minor=True)


def _poses_figure(plan: DesignResult) -> "Figure":
    """From above, from the side, and each joint's share of its range."""
    import matplotlib
    from matplotlib.figure import Figure

    with matplotlib.rc_context(FIGURE_STYLE):
        figure = Figure(figsize=(12, 9), layout="constrained")
        _draw_poses(figure, plan)
    return figure


def _draw_poses(figure: "Figure", plan: DesignResult) -> None:
    shown = plan.scene
    grid = figure.add_gridspec(2, 2, height_ratios=[1.7, 1])
    above, aside = figure.add_subplot(grid[0, 0]), figure.add_subplot(grid[0, 1])
    _view(above, shown, (0, 1), "from above")
    _view(aside, shown, (0, 2), "from the side")
    aside.axhline(0.0, color=TICK, linewidth=1)
    _joints(figure.add_subplot(grid[1, :]), plan.problem.robot.chain, plan.joints)
    handles, labels = above.get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=len(labels), fontsize=9)
    n, robot = len(plan.joints), plan.problem.robot.name
    figure.suptitle(
        f"{robot}: {n} poses in {plan.tour.seconds:.1f} s of moves at full joint speed and acceleration, "
        "numbered from first (dark) to last (light)"
    )


def _first_visits(points: Array) -> tuple[NDArray[np.int_], list[int]]:
    """Rows of points ``(n, 3)`` mm at which a place is visited first, and how often each is: a reference pose again."""
    places: dict[tuple[float, ...], list[int]] = {}
    for row, point in enumerate(np.round(points, 3)):
        places.setdefault(tuple(point + 0.0), []).append(row)
    return np.array([rows[0] for rows in places.values()], int), [len(rows) for rows in places.values()]


def _view(axes: "Axes", shown: "PlanScene", plane: tuple[int, int], name: str) -> None:
    """Target positions in mm on a plane of the world, with the way between them, the arm at home and the tracker."""
    from matplotlib import colormaps

    i, j = plane
    mm = 1e3
    axes.plot(
        mm * shown.path[:, i], mm * shown.path[:, j], color=AXIS, linewidth=0.6, alpha=0.8, label="way of the target"
    )
    for k, line in enumerate(mm * each for each in shown.home):
        label = "" if k else "robot at home"
        axes.plot(line[:, i], line[:, j], "o-", color=ARM, linewidth=5, alpha=0.45, markersize=6, label=label)
    every = mm * shown.points[shown.measured, 0]
    colour, visits = _first_visits(every)
    points = every[colour]
    axes.scatter(
        points[:, i],
        points[:, j],
        c=colour,
        cmap=ORDER_MAP,
        vmin=0,
        vmax=len(every) - 1,
        s=120,
        edgecolors="white",
        zorder=3,
        label="target at a pose",
    )
    shades = colormaps[ORDER_MAP](colour / max(len(every) - 1, 1))[:, :3]
    for k, (x, y) in enumerate(points[:, plane]):
        ink = "white" if luminance(shades[k]) < EQUAL_CONTRAST else "black"
        own = {"boxstyle": "circle,pad=0.05", "facecolor": shades[k], "edgecolor": "none"}  # also where points overlap
        own_id = shown.ids[colour[k]]
        axes.annotate(own_id, (x, y), ha="center", va="center", fontsize=6.5, color=ink, bbox=own, zorder=4)
        if visits[k] > 1:
            axes.annotate(
                f"{visits[k]} visits", (x, y), xytext=(8, 5), textcoords="offset points", fontsize=7, color=INK,
                bbox={"boxstyle": "round,pad=0.1", "facecolor": "white", "edgecolor": "none", "alpha": 0.8}, zorder=5,
            )  # fmt: skip
    via = ~shown.measured
    via[[0, -1]] = False
    if via.any():
        passed = mm * shown.points[via, 0]
        axes.plot(passed[:, i], passed[:, j], "x", color=REFERENCE, label="passed only", zorder=3)
    head = mm * shown.head
    axes.plot([head[i]], [head[j]], "P", color=INSTRUMENT, markersize=13, label="tracker")
    axes.set_aspect("equal", adjustable="box")
    axes.set(xlabel=f"{'xyz'[i]}, mm", ylabel=f"{'xyz'[j]}, mm", title=name)


def _joints(axes: "Axes", chain: JointSpec, joints: Array) -> None:
    """Every joint position in its joint's range, the limits written at its ends."""
    share = (joints - chain.lower) / (chain.upper - chain.lower)
    rows = np.arange(chain.size)[::-1]
    axes.hlines(rows, 0, 1, color=GRID, linewidth=9, zorder=1)
    for k, row in enumerate(rows):
        axes.scatter(
            share[:, k],
            np.full(len(share), row),
            c=np.arange(len(share)),
            cmap=ORDER_MAP,
            s=45,
            edgecolors="white",
            zorder=2,
        )
        scale, unit = (1e3, "mm") if chain.prismatic[k] else (180 / np.pi, "°")
        for x, value, side in ((-0.01, chain.lower[k], "right"), (1.01, chain.upper[k], "left")):
            axes.text(x, row, f"{scale * value:.0f} {unit}".replace("-", "−"), ha=side, va="center", fontsize=9)
    axes.set_yticks(rows, chain.joint_names)
    axes.tick_params(axis="y", length=0)
    axes.set(xlim=(-0.09, 1.09), ylim=(-0.6, chain.size - 0.4), xticks=[], title="joint positions, between the limits")
    axes.grid(visible=False)
    for spine in axes.spines.values():
        spine.set_visible(False)
