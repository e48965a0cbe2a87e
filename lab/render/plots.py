"""Pictures that several commands show: lengths as histograms, and lengths where they are in space."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Self

import numpy as np
from numpy.typing import NDArray

from lab.core.se3 import Array
from lab.core.units import MM
from lab.render.charts.chart import axes_picture, cube, log_ticks, shades, view
from lab.render.charts.marks import Axes
from lab.render.document import Picture, capital, short
from lab.render.style import (
    AFTER,
    BEFORE,
    COLOUR_SCALE,
    GATE,
    HATCH_AFTER,
    HATCH_BEFORE,
    MARK_AFTER,
    MARK_BEFORE,
    MARK_EDGE,
    OUTLIER,
)

__all__ = ["MOST_POINTS", "SQUARE", "VIEWS", "SizeMap", "Spread", "histograms", "size_maps", "spread_by_size"]

MOST_POINTS = 300  # drawn in a picture
SQUARE = (4.5, 4.5)  # inches
VIEWS = {"above": (0, 1), "side": (0, 2)}  # by name the plane of each, as ``charts.chart.view`` has it
_SEEN_FROM = {"above": "from above", "side": "from the side"}
_FEW = 25  # lengths, which are shown one by one
_MANY, _HUNDREDS = 30, 200  # crosses, which are drawn smaller: the colours beneath are to be seen
_LEAST_MM = 1e-12  # of a logarithmic axis
_LINE = 0.01  # of their width: points that rise less make a line of a view


@dataclass(frozen=True)
class Spread:
    """Lengths to be shown as a histogram, and what is marked in it.

    Attributes:
        hatch, marker: of areas and of single dots, which differ in grey prints.
    """

    lengths: Array  # (n,) m, NaN where there is none
    colour: str
    mark: tuple[str, float]  # words and a length (m)
    hatch: str = ""
    marker: str = "o"

    @classmethod
    def before(cls, lengths: Array, mark: tuple[str, float]) -> Self:
        """Return lengths in the style of those before calibration."""
        return cls(lengths, BEFORE, mark, HATCH_BEFORE, MARK_BEFORE)

    @classmethod
    def after(cls, lengths: Array, mark: tuple[str, float]) -> Self:
        """Return lengths in the style of those after calibration."""
        return cls(lengths, AFTER, mark, HATCH_AFTER, MARK_AFTER)


@dataclass(frozen=True)
class SizeMap:
    """Lengths (errors, corrections) where they are.

    Attributes:
        size_means, cross_means: what the lengths and the crosses are.
        range_m: ends of a logarithmic scale that several maps share; None for a linear one of its own.
    """

    points: Array  # (m, 3) m
    sizes: Array  # (m,) m
    size_means: str
    crosses: Array = field(default_factory=lambda: np.empty((0, 3)))  # (o, 3) m, marked beside them
    cross_means: str = "outlier"
    frame: str = "base"  # whose frame the points are in
    name: str = "where"  # of its pictures
    range_m: tuple[float, float] | None = None
    with_scale: bool = True  # whether the scale is drawn beside it
    from_one_side: bool = False  # whether one view is enough: from the side, or from above where that is a line


def spread_by_size(sizes: Array) -> NDArray[np.int_]:
    """Up to ``MOST_POINTS`` rows of sizes ``(n,)``, evenly spaced through the sizes by rank, the largest last."""
    order = np.argsort(sizes, kind="stable")
    if len(order) <= MOST_POINTS:
        return order
    return order[np.round(np.linspace(0, len(order) - 1, MOST_POINTS)).astype(np.int_)]


def histograms(name: str, spreads: Sequence[Spread], axis: str, gate_mm: float | None = None) -> Picture:
    """Histograms in one picture, mm on one logarithmic axis; of fewer than 25 lengths every one is a dot.

    Args:
        axis: what the lengths are.
        gate_mm: the largest error that was asked for, drawn as a line; None where none was.
    """
    sizes = [np.maximum(MM.of(spread.lengths[np.isfinite(spread.lengths)]), _LEAST_MM) for spread in spreads]
    marks = [max(MM.of(spread.mark[1]), _LEAST_MM) for spread in spreads]
    everything = np.concatenate([*sizes, marks, [] if gate_mm is None else [gate_mm]])
    low, high = float(everything.min()), float(everything.max())
    fewest = min(len(each) for each in sizes if len(each))
    edges = np.geomspace(low / 1.25, high * 1.25, int(np.clip(3 * np.sqrt(fewest), 12, 60)) + 1)
    few = fewest < _FEW
    line = 0.13 if few else 0.08  # of the axes' height, which a line of words takes

    def draw(axes: Axes) -> None:
        log_ticks(axes, "x", edges[0], edges[-1])
        for k, (spread, each, mark) in enumerate(zip(spreads, sizes, marks, strict=True)):
            if few:
                axes.plot(each, np.full(len(each), -k), spread.marker, color=spread.colour, alpha=0.6, markersize=5)
            else:
                counts = 100 * np.histogram(each, edges)[0] / max(len(each), 1)
                axes.stairs(counts, edges, fill=True, color=spread.colour, alpha=0.45, hatch=spread.hatch)
                axes.stairs(counts, edges, color=spread.colour, linewidth=1.1)
            axes.axvline(mark, color=spread.colour, linewidth=1.2, linestyle="--")
            right = mark > np.sqrt(edges[0] * edges[-1])
            axes.annotate(
                f"{spread.mark[0]} {short(mark)} mm", (mark, 1.02 + line * k), color=spread.colour,
                xycoords=("data", "axes fraction"), ha="right" if right else "left", fontweight="bold",
            )  # fmt: skip
        if gate_mm is not None:
            axes.axvline(gate_mm, color=GATE, linewidth=1.6, linestyle=":")
            axes.annotate(
                f"gate {short(gate_mm)} mm", (gate_mm, 0.84), xytext=(3, 0), textcoords="offset points",
                xycoords=("data", "axes fraction"), color=GATE,
            )  # fmt: skip
        axes.set(xlabel=f"{axis}, mm (logarithmic)", ylabel="" if few else "share of the points, %")
        if few:
            axes.set(yticks=[], ylim=(0.6 - len(spreads), 0.6))
        axes.grid(visible=False, axis="x")

    text = "; ".join(f"{spread.mark[0]} {short(mark)} mm" for spread, mark in zip(spreads, marks, strict=True))
    return axes_picture(name, f"{capital(axis)}: {text}", (5.6, 2.2 if few else 3), draw, (0.6, 0.5, 0.2, 0.5))


def size_maps(shown: SizeMap) -> tuple[Picture, ...]:
    """Lengths where they are, from above and from the side, and their scale; no view in which they are a line."""
    everything = np.concatenate([shown.points, shown.crosses])
    width = np.ptp(everything, axis=0)
    views = {which: plane for which, plane in VIEWS.items() if width[plane[1]] > _LINE * width.max()} or VIEWS
    if shown.from_one_side:
        views = dict(list(views.items())[-1:])
    pictures = [
        axes_picture(
            f"{shown.name}-{which}",
            f"{shown.size_means}, seen {_SEEN_FROM[which]}: {short(float(MM.of(np.median(shown.sizes))))} mm in the "
            f"median, {short(float(MM.of(shown.sizes.max())))} mm at most",
            SQUARE,
            lambda axes, plane=plane: _size_map(axes, shown, plane),  # type: ignore[misc]
            (0.85, 0.5, 0.15, 0.3),  # places may have four digits and a sign
        )
        for which, plane in views.items()
    ]
    return (*pictures, _scale(shown)) if shown.with_scale else tuple(pictures)


def _ends(shown: SizeMap) -> tuple[float, float]:
    if shown.range_m is not None:
        return MM.of(shown.range_m[0]), MM.of(shown.range_m[1])
    return 0.0, float(np.percentile(MM.of(shown.sizes), 99)) or 1.0


def _colours(shown: SizeMap, sizes_mm: Array) -> Array:
    """The colours ``(n, 3)`` of lengths ``(n,)``."""
    low, high = _ends(shown)
    if shown.range_m is not None:
        sizes_mm, low, high = np.log(np.clip(sizes_mm, low, high)), np.log(low), np.log(high)
    return shades((sizes_mm - low) / (high - low), COLOUR_SCALE)


def _size_map(axes: Axes, shown: SizeMap, plane: tuple[int, int]) -> None:
    middle, half = cube([MM.of(shown.points), MM.of(shown.crosses)])
    points, crosses = MM.of(shown.points[:, plane]), MM.of(shown.crosses[:, plane])
    tints = _colours(shown, MM.of(shown.sizes))
    axes.scatter(points[:, 0], points[:, 1], c=tints, s=14, edgecolors=MARK_EDGE, linewidths=0.25, rasterized=True)
    if len(crosses):
        thin = 1 if len(crosses) < _MANY else 2 if len(crosses) < _HUNDREDS else 4
        axes.scatter(
            crosses[:, 0], crosses[:, 1], marker="x", c=OUTLIER, s=60 / thin**2, linewidths=2 / thin,
            label=shown.cross_means,
        )  # fmt: skip
        axes.legend(loc="upper right", framealpha=0.9, frameon=True)
    view(axes, plane, middle, half, shown.frame, shown.size_means)


def _scale(shown: SizeMap) -> Picture:

    def draw(axes: Axes) -> None:
        ends = _ends(shown)
        edges = np.linspace(*ends, 65) if shown.range_m is None else np.geomspace(*ends, 65)
        middles = np.sqrt(edges[1:] * edges[:-1])
        axes.pcolormesh(edges, [0, 1], _colours(shown, middles)[None], rasterized=True)
        if shown.range_m is not None:
            log_ticks(axes, "x", *ends)
        axes.set(xlim=ends, ylim=(0, 1), yticks=[])
        alone = f"{shown.size_means}, mm (largest {short(float(MM.of(shown.sizes.max())))})"
        axes.set(xlabel=alone if shown.range_m is None else "mm (logarithmic)")
        axes.grid(visible=False)

    return axes_picture(
        f"{shown.name}-scale", f"Scale: {shown.size_means}, mm", (5.6, 0.75), draw, (0.7, 0.5, 0.3, 0.05)
    )
