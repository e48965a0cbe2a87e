"""Pictures that several commands show: lengths as histograms, lengths and errors in space, and trends of errors."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Literal, Self

import numpy as np
from numpy.typing import NDArray

from lab.core.number_text import capital, format_magnification, short
from lab.core.probability import f_sf, t_ppf
from lab.core.se3 import Array
from lab.core.units import MM
from lab.report.charts.chart import axes_picture, cube, log_ticks, name_points, shades, view
from lab.report.charts.marks import Axes
from lab.report.document import Picture
from lab.report.style import (
    AFTER,
    ARM,
    BEFORE,
    COLOUR_SCALE,
    GATE,
    HATCH_AFTER,
    HATCH_BEFORE,
    HIGHLIGHT,
    INK,
    MARK_AFTER,
    MARK_BEFORE,
    MARK_EDGE,
    MUTED,
    OUTLIER,
    PREDICTED,
)

__all__ = [
    "MAP", "MOST_POINTS", "SMALL", "SQUARE", "VIEWS", "WIDTH", "ArrowMap", "SizeMap", "Smooth", "Spread", "Trend",
    "arrow_maps", "histograms", "singular_value_picture", "size_maps", "smooth", "spread_by_size", "trend_pictures",
]  # fmt: skip

MOST_POINTS = 200  # drawn in a picture
SQUARE = (4.5, 4.5)  # inches
MAP = (3.2, 3.2)  # inches: four fit beside each other, two on a sheet of paper, one on a phone
WIDTH = 4.1  # inches: three fit beside each other, two on a sheet of paper, one on a phone
SMALL = (2.1, 2.0)  # inches: six fit beside each other, four on a sheet of paper, two on a phone
_MAP_MARGINS = (0.78, 0.5, 0.1, 0.3)  # inches: places may have four digits and a sign
_BOX = {"boxstyle": "round,pad=0.1", "facecolor": "#ffffff", "edgecolor": "none"}  # behind words on a map
VIEWS = {"above": (0, 1), "side": (0, 2)}  # by name the plane of each, as ``charts.chart.view`` has it
_SEEN_FROM = {"above": "from above", "side": "from the side"}
_BAR = 0.85  # inches of a colour bar below axes
_FEWEST_SMOOTHED = 12  # points
_FEW = 25  # lengths, which are shown one by one
_MANY, _HUNDREDS = 30, 200  # crosses, which are drawn smaller: the colours beneath are to be seen
_LEAST_MM = 1e-12  # of a logarithmic axis
_BAR_LETTERS = 32  # that fit below a colour bar
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
        range_m: ends of a logarithmic scale that several maps share; None for one of its own.
        extrapolated: flags ``(m,)`` of lengths that are shown as crosses of their colour; None for none.
    """

    points: Array  # (m, 3) m
    sizes: Array  # (m,) m
    size_means: str
    crosses: Array = field(default_factory=lambda: np.empty((0, 3)))  # (o, 3) m, marked beside them
    cross_means: str = "outlier"
    frame: str = "base"  # whose frame the points are in
    name: str = "where"  # of its pictures
    range_m: tuple[float, float] | None = None
    from_one_side: bool = False  # whether one view is enough: from the side, or from above where that is a line
    extrapolated: NDArray[np.bool_] | None = None


@dataclass(frozen=True)
class ArrowMap:
    """Errors as arrows where they are.

    Attributes:
        means: what the errors are.
        layers: of each kind of errors its name, colour and vectors ``(m, 3)`` m, the first one undermost.
        factor: magnification of the arrows.
        names: of the points.
        thing: what each point is, and the heading of the column of a table that names it.
    """

    name: str  # of its pictures
    points: Array  # (m, 3) m
    means: str
    layers: tuple[tuple[str, str, Array], ...]
    factor: float
    names: Sequence[str]
    thing: str = "pose"
    crosses: Array = field(default_factory=lambda: np.empty((0, 3)))  # (o, 3) m, marked beside them
    cross_names: Sequence[str] = ()
    frame: str = "base"


@dataclass(frozen=True)
class Trend:
    """Errors against something that may cause them."""

    title: str
    axis: str  # the causes, with their unit
    causes: Array  # (n,)
    errors_mm: Array  # (n,)
    names: Sequence[str]
    steps: Sequence[float] = ()  # causes at which something moved


@dataclass(frozen=True)
class Smooth:
    """A smooth mean of points, with its 95 % intervals.

    Attributes:
        p: of the F test that the mean is the same everywhere.
    """

    at: Array  # (g,)
    mean: Array  # (g,)
    half: Array  # (g,)
    p: float


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
                _draw_shares(axes, spread, each, edges)
            side: Literal["left", "right"] = "right" if mark > np.sqrt(edges[0] * edges[-1]) else "left"
            _draw_mark(axes, spread, mark, 1.02 + line * k, side)
        if gate_mm is not None:
            _draw_gate(axes, gate_mm)
        axes.set(xlabel=f"{axis.partition(',')[0]}, mm (logarithmic)", ylabel="" if few else "share of the points, %")
        if few:
            axes.set(yticks=[], ylim=(0.6 - len(spreads), 0.6))
        axes.grid(visible=False, axis="x")

    text = "; ".join(f"{spread.mark[0]} {short(mark)} mm" for spread, mark in zip(spreads, marks, strict=True))
    return axes_picture(name, f"{capital(axis)}: {text}", (4.0, 2.0 if few else 2.6), draw, (0.6, 0.5, 0.2, 0.5))


def _draw_shares(axes: Axes, spread: Spread, sizes_mm: Array, edges: Array) -> None:
    """Draw the share of lengths between edges, %, as an area with its outline."""
    counts = 100 * np.histogram(sizes_mm, edges)[0] / max(len(sizes_mm), 1)
    axes.stairs(counts, edges, fill=True, color=spread.colour, alpha=0.45, hatch=spread.hatch)
    axes.stairs(counts, edges, color=spread.colour, linewidth=1.1)


def _draw_mark(axes: Axes, spread: Spread, mark_mm: float, height: float, side: Literal["left", "right"]) -> None:
    axes.axvline(mark_mm, color=spread.colour, linewidth=1.2, linestyle="--")
    axes.annotate(
        f"{spread.mark[0]} {short(mark_mm)} mm", (mark_mm, height), xycoords=("data", "axes fraction"),
        color=spread.colour, ha=side, fontweight="bold",
    )  # fmt: skip


def _draw_gate(axes: Axes, gate_mm: float) -> None:
    axes.axvline(gate_mm, color=GATE, linewidth=1.6, linestyle=":")
    axes.annotate(
        f"gate {short(gate_mm)} mm", (gate_mm, 0.84), xytext=(3, 0), textcoords="offset points",
        xycoords=("data", "axes fraction"), color=GATE,
    )  # fmt: skip


def size_maps(shown: SizeMap) -> tuple[Picture, ...]:
    """Lengths where they are, from above and from the side, each with its scale; no view in which they are a line."""
    views = _views([shown.points, shown.crosses])
    if shown.from_one_side:
        views = dict(list(views.items())[-1:])
    return tuple(
        axes_picture(
            f"{shown.name}-{which}",
            f"{shown.size_means}, seen {_SEEN_FROM[which]}: {short(float(MM.of(np.median(shown.sizes))))} mm in the "
            f"median, {short(float(MM.of(shown.sizes.max())))} mm at most",
            (MAP[0], MAP[1] + _BAR),
            lambda axes, plane=plane: _size_map(axes, shown, plane),  # type: ignore[misc]
            (_MAP_MARGINS[0], _MAP_MARGINS[1] + _BAR, *_MAP_MARGINS[2:]),
        )
        for which, plane in views.items()
    )


def _views(points: Sequence[Array]) -> dict[str, tuple[int, int]]:
    """The views in which points ``(n, 3)`` are no line."""
    width = np.ptp(np.concatenate(points), axis=0)
    return {which: plane for which, plane in VIEWS.items() if width[plane[1]] > _LINE * width.max()} or VIEWS


def _ends(shown: SizeMap) -> tuple[float, float]:
    """The ends of the logarithmic scale, mm: nearly all lengths, and no less than a factor of two."""
    if shown.range_m is not None:
        return MM.of(shown.range_m[0]), MM.of(shown.range_m[1])
    sizes = np.maximum(MM.of(shown.sizes), _LEAST_MM)
    low, high = np.percentile(sizes, 1), np.percentile(sizes, 99)
    more = max(1.0, 2 / (high / low)) ** 0.5
    return float(low / more), float(high * more)


def _colours(shown: SizeMap, sizes_mm: Array) -> Array:
    """The colours ``(n, 3)`` of lengths ``(n,)``."""
    low, high = _ends(shown)
    return shades(np.log(np.clip(sizes_mm, low, high) / low) / np.log(high / low), COLOUR_SCALE)


def _size_map(axes: Axes, shown: SizeMap, plane: tuple[int, int]) -> None:
    middle, half = cube([MM.of(shown.points), MM.of(shown.crosses)])
    points, crosses = MM.of(shown.points[:, plane]), MM.of(shown.crosses[:, plane])
    tints = _colours(shown, MM.of(shown.sizes))
    far = np.zeros(len(points), bool) if shown.extrapolated is None else shown.extrapolated
    near = ~far
    axes.scatter(points[near, 0], points[near, 1], c=tints[near], s=14, edgecolors=MARK_EDGE, linewidths=0.25)
    if far.any():
        axes.scatter(points[far, 0], points[far, 1], c=tints[far], s=20, marker="x", linewidths=1.2)
    if len(crosses):
        thin = 1 if len(crosses) < _MANY else 2 if len(crosses) < _HUNDREDS else 4
        axes.scatter(crosses[:, 0], crosses[:, 1], marker="x", c=OUTLIER, s=60 / thin**2, linewidths=2 / thin)
        _corner(axes, f"× {shown.cross_means}", OUTLIER)
    view(axes, plane, middle, half, shown.frame)
    _colour_bar(axes, shown)


def _corner(axes: Axes, text: str, colour: str, line: int = 0) -> None:
    """Words in the upper right corner of the axes, on lines from 0."""
    axes.annotate(
        text, (0.99, 0.99 - 0.075 * line), xycoords="axes fraction", ha="right", va="top", color=colour, bbox=_BOX,
        fontweight="bold",
    )  # fmt: skip


def _colour_bar(axes: Axes, shown: SizeMap) -> None:
    """Draw the scale of the lengths below the axes."""
    bar = axes.inset_axes((0.0, -0.36, 1.0, 0.06))
    ends = _ends(shown)
    edges = np.geomspace(*ends, 49)
    bar.pcolormesh(edges, [0, 1], _colours(shown, np.sqrt(edges[1:] * edges[:-1]))[None])
    log_ticks(bar, "x", *ends)
    means = shown.size_means if len(shown.size_means) <= _BAR_LETTERS else " ".join(shown.size_means.split()[-2:])
    bar.set(xlim=ends, ylim=(0, 1), yticks=[], xlabel=f"{means}, mm")
    bar.grid(visible=False)


def arrow_maps(maps: Sequence[ArrowMap]) -> tuple[Picture, ...]:
    """Errors as arrows from above and from the side: the maps of one view beside each other, at one scale of space."""
    points = [each for shown in maps for each in (shown.points, shown.crosses)]
    tips = [shown.points + shown.factor * vectors for shown in maps for *_, vectors in shown.layers]
    middle, half = cube([MM.of(each) for each in (*points, *tips)])
    pictures = []
    for which, plane in _views(points).items():
        for shown in maps:
            sizes = [(name, MM.of(np.linalg.norm(vectors, axis=1))) for name, _, vectors in shown.layers]
            said = (f"{name} {short(float(np.median(each)))} mm in the median" for name, each in sizes)
            label = f"{shown.means} as arrows, seen {_SEEN_FROM[which]}: {', '.join(said)}"

            def draw(axes: Axes, shown: ArrowMap = shown, plane: tuple[int, int] = plane) -> None:
                _arrows(axes, shown, plane)
                _arrow_scale(axes, shown, middle[list(plane)] - half, half)
                view(axes, plane, middle, half, shown.frame, format_magnification(shown.factor))

            pictures.append(axes_picture(f"{shown.name}-{which}", label, MAP, draw, _MAP_MARGINS))
    return tuple(pictures)


def _arrows(axes: Axes, shown: ArrowMap, plane: tuple[int, int]) -> None:
    at, crosses = MM.of(shown.points[:, plane]).T, MM.of(shown.crosses[:, plane]).T
    axes.scatter(*at, s=4, c=ARM, linewidths=0)
    for _, colour, vectors in shown.layers:
        along = MM.of(vectors[:, plane]).T * shown.factor
        axes.quiver(*at, *along, color=colour, angles="xy", scale_units="xy", scale=1, width=0.005)
    sizes = [[short(MM.of(size)) for size in np.linalg.norm(each, axis=1).tolist()] for *_, each in shown.layers]
    kinds = [name for name, *_ in shown.layers]
    texts = [
        ", ".join(f"{kind} {size} mm" for kind, size in zip(kinds, of, strict=True)) for of in zip(*sizes, strict=True)
    ]
    name_points(axes, shown.thing, at[0], at[1], shown.names, texts)
    if len(shown.crosses):
        axes.scatter(*crosses, marker="x", c=OUTLIER, s=50, linewidths=1.5)
        name_points(axes, shown.thing, crosses[0], crosses[1], shown.cross_names, ["outlier"] * len(shown.crosses))
    words = [(name, colour) for name, colour, _ in shown.layers] + [("× outlier", OUTLIER)] * bool(len(shown.crosses))
    for line, (text, colour) in enumerate(words):
        _corner(axes, text, colour, line)


def _arrow_scale(axes: Axes, shown: ArrowMap, corner: Array, half: float) -> None:
    """Draw an arrow of a round length in the lower left corner of a map."""
    length = _round_below(0.5 * half / shown.factor)
    at = corner + 0.06 * half
    axes.quiver(
        [at[0]], [at[1]], [length * shown.factor], [0], color=INK, angles="xy", scale_units="xy", scale=1, width=0.008
    )
    axes.annotate(
        f"{length:g} mm", at, xytext=(0, 6), textcoords="offset points", color=INK, fontweight="bold", bbox=_BOX
    )


def _round_below(length: float) -> float:
    """The largest of 1, 2, 5 times a power of ten that is not above a length."""
    power = 10.0 ** np.floor(np.log10(length))
    return float(max(each for each in (1, 2, 5) if each * power <= length * (1 + 1e-9)) * power)


def smooth(x: Array, y: Array) -> Smooth | None:
    """Fit a smooth mean to points ``(n,)``; None where they are too few or all at one place.

    A straight line, or a natural cubic spline (Hastie, Tibshirani and Friedman 2009, equations 5.4 and 5.5) with four
    or eight knots, by least squares: that with the least Schwarz criterion. Points farther from the median than five
    standard deviations, by the median absolute one, are left out.
    """
    known = np.isfinite(x) & np.isfinite(y)
    if known.any():
        apart = np.abs(y - np.median(y[known]))
        known &= apart <= 5 * 1.4826 * np.median(apart[known])
    x, y = x[known], y[known]
    if len(x) < _FEWEST_SMOOTHED or np.ptp(x) == 0:
        return None
    at = (x - x.min()) / np.ptp(x)
    places = np.unique(at.round(2))  # joint positions that a controller repeats are one
    counts = sorted({min(each, len(places)) for each in (2, 4, 8) if 5 * each <= len(x)})
    tried = [_least_squares_spline(at, y, np.quantile(places, np.linspace(0, 1, count))) for count in counts]
    best = min(tried, key=lambda each: each[0])[1]
    p = min(1.0, len(tried) * min(each[1].p for each in tried))  # of the least of several (Bonferroni)
    return replace(best, at=float(x.min()) + float(np.ptp(x)) * best.at, p=p)


def _least_squares_spline(x: Array, y: Array, knots: Array) -> tuple[float, Smooth]:
    """The Schwarz criterion of a spline through points with places from 0 to 1, and the spline."""
    at = np.linspace(0, 1, 61)
    columns, shown = _natural_spline(x, knots), _natural_spline(at, knots)
    inverse = np.linalg.pinv(columns.T @ columns, hermitian=True)
    weights = inverse @ columns.T @ y
    count, more = len(y), columns.shape[1] - 1
    squares, plain = float(np.sum((y - columns @ weights) ** 2)), float(np.sum((y - y.mean()) ** 2))
    variance = squares / (count - more - 1)
    half = t_ppf(0.975, count - more - 1) * np.sqrt(variance * np.einsum("gi,ij,gj->g", shown, inverse, shown))
    if variance <= 1e-24 * max(plain, 1e-300):  # rounding
        return -np.inf, Smooth(at, shown @ weights, half, 0.0 if plain > 0 else 1.0)
    p = float(f_sf(max(plain - squares, 0.0) / more / variance, more, count - more - 1))
    return count * np.log(squares / count) + more * np.log(count), Smooth(at, shown @ weights, half, p)


def _natural_spline(x: Array, knots: Array) -> Array:
    """The basis ``(n, knots)`` of cubic splines that are straight beyond the first and the last knot."""
    parts = np.maximum(x[:, None] - knots, 0) ** 3  # (n, knots)
    steps = (parts[:, :-1] - parts[:, -1:]) / (knots[-1] - knots[:-1])
    return np.column_stack([np.ones(len(x)), x, *(steps[:, :-1] - steps[:, -1:]).T])


def trend_pictures(name: str, trends: Sequence[Trend], band_mm: float, thing: str = "pose") -> tuple[Picture, ...]:
    """Errors against each of several causes, by the same scale of errors, each with its smooth mean.

    A picture says in its title whether there is a trend (F test, 1 % over all pictures). A cause without errors has
    none.

    Args:
        band_mm: half the width of a band round zero that noise leaves in 5 % of the cases; NaN for none.
    """
    trends = [each for each in trends if np.isfinite(each.errors_mm).any()]
    if not trends:
        return ()
    every = np.concatenate([each.errors_mm for each in trends])
    typical = float(np.nanpercentile(np.abs(every), 98))
    reach = 1.15 * max(typical, band_mm if np.isfinite(band_mm) else 0.0) or 1.0
    return tuple(
        _trend(f"{name}-{i}", each, reach, band_mm, 0.01 / len(trends), thing) for i, each in enumerate(trends)
    )


def _trend(name: str, shown: Trend, reach: float, band_mm: float, level: float, thing: str) -> Picture:
    trend = smooth(shown.causes, shown.errors_mm)
    sure = trend is not None and trend.p < level
    size = 0.0 if trend is None else float(np.ptp(trend.mean)) / 2
    title = f"{shown.title}: trend ± {short(size)} mm" if sure else f"{shown.title}: no trend"
    some = np.unique(np.round(np.linspace(0, len(shown.causes) - 1, MOST_POINTS)).astype(np.int_))
    x, y = shown.causes[some], shown.errors_mm[some]

    def draw(axes: Axes) -> None:
        if np.isfinite(band_mm):
            axes.axhspan(-band_mm, band_mm, color=PREDICTED, alpha=0.13, linewidth=0)
        axes.axhline(0, color=INK, linewidth=0.6)
        for at in shown.steps:
            axes.axvline(at, color=HIGHLIGHT, linewidth=1.2, linestyle="--")
        axes.scatter(x, np.clip(y, -reach, reach), s=5, c=ARM, linewidths=0)
        if trend is not None:
            tint = AFTER if sure else MUTED
            low, high = (np.clip(trend.mean + side * trend.half, -reach, reach) for side in (-1, 1))
            axes.fill_between(trend.at, low, high, color=tint, alpha=0.25, linewidth=0)
            axes.plot(trend.at, trend.mean, color=tint, linewidth=1.8)
        axes.set(xlabel=shown.axis, ylim=(-reach, reach), title=title)
        axes.locator_params(axis="x", nbins=3)
        axes.locator_params(axis="y", nbins=5)
        axes.grid(visible=False, axis="x")
        names = [shown.names[i] for i in some.tolist()]
        name_points(axes, thing, x, np.clip(y, -reach, reach), names, [f"{short(each)} mm" for each in y.tolist()])

    return axes_picture(name, title, SMALL, draw, (0.55, 0.5, 0.1, 0.35))


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
    return (axes_picture("singular-values", label, (WIDTH, 2.8), draw, (0.8, 0.5, 0.2, 0.15)),)
