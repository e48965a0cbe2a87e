"""Still pictures of a plan, as PNG and SVG: accuracy against the number of poses, and where the poses are.

matplotlib is slow to import: import this module where a picture is asked for.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from lab.commands.design.run import DesignStep, Plan
from lab.commands.design.scene import PlanScene, plan_scene
from lab.core.se3 import Array
from lab.kinematics.joints import JointSpec

PROMISE, WORST, RMS, O1 = "#0b5fa5", "#c2410c", "#3f8f4f", "#7c3aed"
_TRACKER, _ARM, _VIA = "#c2185b", "#6b7280", "#9ca3af"
_ORDER = "viridis"  # first to last pose of the tour
STYLE: Any = {
    "font.size": 10,
    "axes.grid": True,
    "grid.color": "#e5e7eb",
    "axes.axisbelow": True,
    "axes.spines.top": False,
    "svg.hashsalt": "lab",  # the same picture, the same bytes
    "svg.fonttype": "none",
}


def plot_plan(folder: Path, plan: Plan) -> None:
    """Write ``curve`` and ``poses`` into the folder, each as PNG and SVG."""
    total, extended = len(plan.joints), len(plan.problem.already)
    with matplotlib.rc_context(STYLE):
        added = f" added to {extended} measured already" if extended else ""
        title = f"{plan.problem.robot.name}, {plan.options.instrument}: accuracy against poses{added}"
        save(
            folder,
            "curve",
            curve_figure(plan.curve, title, plan.problem.scaling.describe(), (total, plan.prediction.coverage_radius)),
        )
        save(folder, "poses", _poses_figure(plan, plan_scene(plan)))


def save(folder: Path, name: str, figure: Figure) -> None:
    """Write a figure as PNG and SVG, the same bytes for the same figure."""
    with matplotlib.rc_context(STYLE):
        figure.savefig(folder / f"{name}.png", dpi=130)
        figure.savefig(folder / f"{name}.svg", metadata={"Date": None})


def curve_figure(
    curve: Sequence[DesignStep], title: str, scaling: str, chosen: tuple[int, float] | None = None
) -> Figure:
    """Predicted errors on fresh poses (µm, left) and O1 (right) against the number of poses.

    Args:
        scaling: of O1, in words.
        chosen: the plan's number of poses, and the error (m) that it promises.
    """
    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=(9, 6), layout="constrained")
        axes = figure.add_subplot()
        poses = [step.poses for step in curve]
        for label, values, colour, style in (
            ("95 % of fresh poses, in 95 % of campaigns", [s.prediction.coverage_radius for s in curve], PROMISE, "o-"),
            ("worst pose, RMS over campaigns", [s.prediction.rms.max() for s in curve], WORST, "^:"),
            ("all poses, RMS over campaigns", [_rms(s.prediction.rms) for s in curve], RMS, "s:"),
        ):
            axes.plot(poses, 1e6 * np.array(values), style, color=colour, label=label, markersize=5)
        _log_scale(axes)
        second = axes.twinx()
        second.plot(poses, [step.o1 for step in curve], "D--", color=O1, label="O1 (right)", markersize=4)
        second.set_ylim(0, 1.1 * max(step.o1 for step in curve))
        second.set_ylabel(f"O1, information per pose\n({scaling})", color=O1)
        second.tick_params(axis="y", colors=O1)
        second.grid(visible=False)
        if chosen is not None:
            axes.axvline(chosen[0], color="#111827", linewidth=1)
            axes.plot([chosen[0]], [1e6 * chosen[1]], "*", color="#111827", markersize=14,
                      label=f"this plan: {chosen[0]} poses, {1e6 * chosen[1]:.3g} µm")  # fmt: skip
        axes.set(xlabel="poses", ylabel="predicted position error on fresh poses, µm", title=title)
        lines = [*axes.get_legend_handles_labels()[0], *second.get_legend_handles_labels()[0]]
        labels = [str(line.get_label()) for line in lines]
        figure.legend(lines, labels, loc="outside lower center", ncols=3, fontsize=9)
    return figure


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(values**2)))


def _log_scale(axes: Axes) -> None:
    """A logarithmic left axis with plain numbers."""
    axes.set_yscale("log")
    low, high = axes.get_ylim()
    ticks = [m * 10.0**e for e in range(-9, 9) for m in (1, 2, 3, 5) if low <= m * 10.0**e <= high]
    axes.set_yticks(ticks, [f"{tick:g}" for tick in ticks])
    axes.set_yticks([], minor=True)


def _poses_figure(plan: Plan, shown: PlanScene) -> Figure:
    """From above, from the side, and each joint's share of its range."""
    figure = Figure(figsize=(12, 9), layout="constrained")
    grid = figure.add_gridspec(2, 2, height_ratios=[1.7, 1])
    above, aside = figure.add_subplot(grid[0, 0]), figure.add_subplot(grid[0, 1])
    _view(above, shown, (0, 1), "from above")
    _view(aside, shown, (0, 2), "from the side")
    aside.axhline(0.0, color="#374151", linewidth=1)
    _joints(figure.add_subplot(grid[1, :]), plan.problem.robot.chain, plan.joints)
    handles, labels = above.get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=len(labels), fontsize=9)
    n, robot = len(plan.joints), plan.problem.robot.name
    figure.suptitle(
        f"{robot}: {n} poses in {plan.tour.seconds:.1f} s of moves at full joint speed and acceleration, "
        "numbered from first (dark) to last (light)"
    )
    return figure


def _view(axes: Axes, shown: PlanScene, plane: tuple[int, int], name: str) -> None:
    """Target positions in mm on a plane of the world, with the way between them, the arm at home and the tracker."""
    i, j = plane
    mm = 1e3
    axes.plot(
        mm * shown.path[:, i], mm * shown.path[:, j], color=_VIA, linewidth=0.6, alpha=0.8, label="way of the target"
    )
    for k, line in enumerate(mm * each for each in shown.home):
        label = "" if k else "robot at home"
        axes.plot(line[:, i], line[:, j], "o-", color=_ARM, linewidth=5, alpha=0.45, markersize=6, label=label)
    points = mm * shown.points[shown.measured, 0]
    colour = np.arange(len(points))
    axes.scatter(
        points[:, i], points[:, j], c=colour, cmap=_ORDER, s=120, edgecolors="white", zorder=3, label="target at a pose"
    )
    for k, (x, y) in enumerate(points[:, plane]):
        ink = "white" if k < 0.6 * len(points) else "black"
        axes.annotate(shown.ids[k], (x, y), ha="center", va="center", fontsize=6.5, color=ink, zorder=4)
    via = ~shown.measured
    via[[0, -1]] = False
    if via.any():
        passed = mm * shown.points[via, 0]
        axes.plot(passed[:, i], passed[:, j], "x", color="#111827", label="passed only", zorder=3)
    head = mm * shown.head
    axes.plot([head[i]], [head[j]], "P", color=_TRACKER, markersize=13, label="tracker")
    axes.set_aspect("equal", adjustable="box")
    axes.set(xlabel=f"{'xyz'[i]}, mm", ylabel=f"{'xyz'[j]}, mm", title=name)


def _joints(axes: Axes, chain: JointSpec, joints: Array) -> None:
    """Every reading on its joint's range, the limits written at its ends."""
    share = (joints - chain.lower) / (chain.upper - chain.lower)
    rows = np.arange(chain.size)[::-1]
    axes.hlines(rows, 0, 1, color="#e5e7eb", linewidth=9, zorder=1)
    for k, row in enumerate(rows):
        axes.scatter(
            share[:, k],
            np.full(len(share), row),
            c=np.arange(len(share)),
            cmap=_ORDER,
            s=45,
            edgecolors="white",
            zorder=2,
        )
        scale, unit = (1e3, "mm") if chain.prismatic[k] else (180 / np.pi, "°")
        for x, value, side in ((-0.01, chain.lower[k], "right"), (1.01, chain.upper[k], "left")):
            axes.text(x, row, f"{scale * value:.0f} {unit}".replace("-", "−"), ha=side, va="center", fontsize=9)
    axes.set_yticks(rows, chain.joint_names)
    axes.tick_params(axis="y", length=0)
    axes.set(xlim=(-0.09, 1.09), ylim=(-0.6, chain.size - 0.4), xticks=[], title="joint readings, between the limits")
    axes.grid(visible=False)
    for spine in axes.spines.values():
        spine.set_visible(False)
