"""The pictures of a run's report: errors before and after, where they are, parameters, singular values, the arm.

matplotlib is slow to import: import this module where a report is written.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import Colormap, LinearSegmentedColormap, Normalize

from lab.commands.calibrate.error_map import ArmPlaces, ErrorMap
from lab.core.se3 import Array
from lab.render.html import AFTER, INK, MEASURED, OFF, QUIET, Html, panel, short
from lab.render.svg import cube, log_ticks, view

VIEWS = {"above": (0, 1), "side": (0, 2)}
WORDS = {"above": "from above", "side": "from the side"}
PROMISED = "#0b5fa5"
_ARM, _FIRST = "#94a3b8", "#1e3a5f"
_SMALL, _LARGE = "#fde68a", "#4c0519"  # of errors, by way of red
_SQUARE = (4.5, 4.5)
_LEAST_MM = 1e-12  # of a logarithmic axis
_LINE = 0.01  # of their width: points that rise less make a line of a view
_FAR = 1.3  # half the edge of the arm's cube: an instrument farther off is only pointed at


@dataclass(frozen=True)
class Spread:
    """Lengths (m) to be shown as a histogram, and what is to be marked in it: words and a length (m)."""

    lengths: Array
    colour: str
    mark: tuple[str, float]


def histograms(name: str, spreads: Sequence[Spread], axis: str) -> Html:
    """Histograms in one picture, mm on a logarithmic axis.

    Args:
        axis: what the lengths are.
    """
    shown = [np.maximum(1e3 * spread.lengths[np.isfinite(spread.lengths)], _LEAST_MM) for spread in spreads]
    marks = [max(1e3 * spread.mark[1], _LEAST_MM) for spread in spreads]
    everything = np.concatenate([*shown, marks])
    low, high = float(everything.min()), float(everything.max())
    fewest = min(len(sizes) for sizes in shown if len(sizes))
    edges = np.geomspace(low / 1.25, high * 1.25, int(np.clip(3 * np.sqrt(fewest), 12, 60)) + 1)

    def draw(axes: Axes) -> None:
        log_ticks(axes, "x", edges[0], edges[-1])
        for k, (spread, sizes, mark) in enumerate(zip(spreads, shown, marks, strict=True)):
            counts = 100 * np.histogram(sizes, edges)[0] / max(len(sizes), 1)
            axes.stairs(counts, edges, fill=True, color=spread.colour, alpha=0.45)
            axes.stairs(counts, edges, color=spread.colour, linewidth=1.1)
            axes.axvline(mark, color=spread.colour, linewidth=1.2, linestyle="--")
            right = mark > np.sqrt(edges[0] * edges[-1])
            axes.annotate(
                f"{spread.mark[0]} {short(mark)} mm", (mark, 1.02 + 0.08 * k), color=spread.colour,
                xycoords=("data", "axes fraction"), ha="right" if right else "left", fontweight="bold",
            )  # fmt: skip
        axes.set(xlabel=f"{axis}, mm (logarithmic)", ylabel="share of the points, %")
        axes.grid(visible=False, axis="x")

    return panel(name, f"Histogram: {axis}", (7.5, 3), draw, (0.6, 0.5, 0.2, 0.5))


def size_maps(places: ErrorMap) -> list[Html]:
    """Lengths where they are, from above and from the side, and their scale; no view in which they are a line."""
    sizes = 1e3 * places.sizes
    colours = LinearSegmentedColormap.from_list("sizes", [_SMALL, "#f97316", "#b91c1c", _LARGE])
    norm = Normalize(0.0, float(np.percentile(sizes, 99)) or 1.0)
    middle, half = cube([1e3 * places.points, 1e3 * places.off])
    drawn = []
    for which, plane in _telling(np.concatenate([places.points, places.off])).items():

        def draw(axes: Axes, plane: tuple[int, int] = plane) -> None:
            points, off = 1e3 * places.points[:, plane], 1e3 * places.off[:, plane]
            axes.scatter(
                points[:, 0], points[:, 1], c=colours(norm(sizes)), s=14, edgecolors="#57534e", linewidths=0.25
            )
            if len(off):
                axes.scatter(off[:, 0], off[:, 1], marker="x", c=OFF, s=60, linewidths=2, label=places.off_means)
                axes.legend(loc="upper right", framealpha=0.9, frameon=True)
            view(axes, plane, middle, half, places.frame)

        drawn.append(panel(f"where-{which}", f"{places.size_means}, seen {WORDS[which]}", _SQUARE, draw))
    return [*drawn, _scale(colours, norm, sizes, places.size_means)]


def _telling(points: Array) -> dict[str, tuple[int, int]]:
    """The views in which points ``(n, 3)`` are more than a line; all where there is none."""
    width = np.ptp(points, axis=0)
    return {which: plane for which, plane in VIEWS.items() if width[plane[1]] > _LINE * width.max()} or VIEWS


def _scale(colours: Colormap, norm: Normalize, sizes: Array, means: str) -> Html:
    """The colours as a bar, the last one for all that is larger."""
    edges = np.linspace(0.0, norm.vmax or 1.0, 65)

    def draw(axes: Axes) -> None:
        shades = colours(norm((edges[1:] + edges[:-1]) / 2))
        steps = list(zip(edges[:-1].tolist(), np.diff(edges).tolist(), strict=True))
        axes.broken_barh(steps, (0, 1), facecolors=shades, edgecolors=shades, linewidth=0.5)
        axes.set(xlim=(edges[0], edges[-1]), ylim=(0, 1), yticks=[])
        axes.set_xlabel(f"{means}, mm (largest {short(float(sizes.max()))})")
        axes.grid(visible=False)

    return panel("where-scale", f"Scale: {means}, mm", (9.1, 0.75), draw, (0.7, 0.5, 0.3, 0.05))


def changes(rows: Sequence[dict[str, Any]], unit: str, number: int) -> Html:
    """By how much parameters of one unit differ from the drawing, with their 95 % intervals.

    Args:
        rows: ``name``, ``change`` and ``half`` (None where it is not known), in the unit.
    """
    height = 0.95 + 0.2 * len(rows)

    def draw(axes: Axes) -> None:
        at, moved = np.arange(len(rows))[::-1], np.array([row["change"] for row in rows])
        halves = np.array([np.nan if row["half"] is None else row["half"] for row in rows])
        colours = [AFTER if sure else QUIET for sure in np.abs(moved) > halves]
        axes.hlines(at, 0, moved, colors=colours, alpha=0.35, linewidth=4)
        axes.hlines(at, moved - halves, moved + halves, colors=colours, linewidth=1.2)
        for side in (-1, 1):
            axes.scatter(moved + side * halves, at, marker="|", c=colours, s=24, linewidths=1.2)
        axes.scatter(moved, at, c=colours, s=13)
        axes.axvline(0, color=INK, linewidth=1)
        axes.set_yticks(at, [row["name"] for row in rows])
        axes.set(ylim=(-0.7, len(rows) - 0.3), xlabel=f"change from the drawing, {unit}")
        axes.tick_params(axis="y", length=0)
        axes.grid(visible=False, axis="y")
        axes.margins(x=0.06)

    label = f"Changes of parameters from the drawing with 95 % intervals, {unit}"
    return panel(f"changes-{number}", label, (4.5, height), draw, (1.35, 0.5, 0.15, 0.15))


def singular_values(values: Array) -> Html:
    """Singular values, from the best seen direction to the worst, relative to the largest."""
    shown = np.maximum(values / values[0], 1e-17)

    def draw(axes: Axes) -> None:
        order = np.arange(1, len(shown) + 1)
        axes.vlines(order, shown.min() / 10, shown, color=_ARM, linewidth=1.5)
        axes.plot(order, shown, "o", color=_FIRST, markersize=4.5)
        log_ticks(axes, "y", min(shown.min() / 1.6, 0.06), 1.7)
        condition = f"condition (largest over smallest): {short(float(1 / shown[-1]))}"
        axes.text(0.99, 0.93, condition, transform=axes.transAxes, ha="right", color=_FIRST)
        axes.set(xlabel="direction, from the best seen to the worst", ylabel="singular value over the largest")
        axes.set(xlim=(0.3, len(shown) + 0.7))
        axes.grid(visible=False, axis="x")

    return panel("singular-values", "Singular values of the scaled Jacobian", (7.5, 2.8), draw, (0.8, 0.5, 0.2, 0.15))


def arm_views(arm: ArmPlaces) -> list[Html]:
    """The arm as a stick figure at its poses, with the points and the instrument, from above and from the side."""
    middle, half = cube([1e3 * arm.joints, 1e3 * arm.tips, 1e3 * arm.points])
    if arm.head is not None and np.abs(1e3 * arm.head - middle).max() < _FAR * half:
        middle, half = cube([1e3 * arm.joints, 1e3 * arm.points, 1e3 * arm.head])
    drawn = []
    for which, plane in VIEWS.items():

        def draw(axes: Axes, plane: tuple[int, int] = plane) -> None:
            _sticks(axes, arm, plane)
            if arm.head is not None:
                _instrument(axes, 1e3 * arm.head, middle, half, plane)
            view(axes, plane, middle, half, "base")
            axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.12), ncols=2)

        drawn.append(
            panel(
                f"arm-{which}", f"The arm at its poses, seen {WORDS[which]}", (4.5, 4.85), draw, (0.7, 0.85, 0.15, 0.3)
            )
        )
    return drawn


def _sticks(axes: Axes, arm: ArmPlaces, plane: tuple[int, int]) -> None:
    """Links, joints, targets and points."""
    size = 9 if len(arm.points) <= 200 else 4
    word = "measured point" if arm.measured else "tool point"
    points = 1e3 * arm.points[:: max(1, len(arm.points) // 1000)][:, plane]
    axes.scatter(points[:, 0], points[:, 1], s=size, c=MEASURED, label=word, zorder=3, linewidths=0)
    for k, tips in reversed(list(enumerate(arm.tips))):
        colour, wide = (_FIRST, 2.6) if k == 0 else (_ARM, 1.1)
        joints = 1e3 * arm.joints[k][:, plane]
        for tip in 1e3 * tips[:, plane]:
            axes.plot(*np.stack([joints[-1], tip]).T, color=colour, linewidth=0.8, linestyle=":", zorder=2)
        label = {0: f"arm at pose {arm.first}", 1: f"arm at {len(arm.tips) - 1} other poses"}.get(k, "")
        for line in arm.strips:
            axes.plot(
                *(1e3 * line[k][:, plane]).T, color=colour, linewidth=wide, alpha=1.0 if k == 0 else 0.75, label=label,
                zorder=4 if k == 0 else 1, solid_joinstyle="round", solid_capstyle="round",
            )  # fmt: skip
            label = ""
        axes.plot(*joints.T, "o", color=colour, markersize=3.5 if k == 0 else 1.8, zorder=4 if k == 0 else 1)


def _instrument(axes: Axes, head: Array, middle: Array, half: float, plane: tuple[int, int]) -> None:
    """The instrument, or an arrow towards it at the edge of the view where it is farther off."""
    place, centre = head[list(plane)], middle[list(plane)]
    away = place - centre
    if np.abs(head - middle).max() < half:
        axes.plot(*place, "P", color=OFF, markersize=9, linestyle="", label="instrument", zorder=5)
        return
    edge = away * half / np.abs(away).max()
    arrow = {"arrowstyle": "-|>", "color": OFF, "linewidth": 2.0}
    axes.annotate("", centre + 0.98 * edge, centre + 0.78 * edge, arrowprops=arrow, zorder=5)
    far = f"to the instrument, {np.linalg.norm(head - middle) / 1e3:.1f} m"
    axes.plot([], [], color=OFF, linewidth=2.0, label=far)
