"""Parallel robots calibrated: the picture and the tables of the study."""

import json
import time
from collections.abc import Callable, Sequence
from typing import Any

import matplotlib
import numpy as np
from matplotlib.figure import Figure
from scipy.stats import quantile_test

from lab.core.errors import LabError
from lab.experiments.parallel_robots import (
    CASES,
    EVERY,
    LONGER_M,
    NOISELESS,
    Options,
    Row,
    assembled,
    course_of,
    longer_rod,
    one_robot,
    six_rods,
)
from lab.experiments.script import Answer, paragraphs
from lab.kinematics.closed.arm import ClosedArm
from lab.render.document import Document
from lab.render.style import BEFORE, FIGURE_STYLE, REFERENCE, TICK
from lab.render.svg import save_figure
from lab.studies import executors

__all__ = ["answer", "picture", "report"]

SINGULAR, ROBOT = BEFORE, TICK
PIXELS, LINES = 301, (0.1, 0.2, 0.4, 0.6, 0.8)  # of the picture
Range = tuple[float, float]
FITS = {
    "plain": "rank of the drawing",
    "prior": "the same, with a prior of tolerances",
    "every": f"every parameter, of {EVERY} robots at most",
    "three rods": "a model of three rods",
    "exact": "rank of the drawing, no noise",
}


def picture() -> Figure:
    """How far from singular each drawing is, over its plane or a section of its space."""
    panels: tuple[tuple[str, str, Range, Range, Range, Callable[[Any, Any], list[Any]]], ...] = (
        ("2-RPR", "rpr2", (-300, 900), (-150, 800), (300, 500), lambda x, y: [x, y]),
        ("3-RPR at φ = 0°", "rpr3", (-500, 500), (-480, 560), (0, 0), lambda x, y: [x, y, 0 * x]),
        ("3-RPR at φ = −45°", "rpr3", (-500, 500), (-480, 560), (0, 0), lambda x, y: [x, y, 0 * x - np.pi / 4]),
        ("Delta, section y = 0", "delta", (-1150, 1150), (-1800, 100), (300, -1200), lambda x, y: [x, 0 * x, y]),
    )
    with matplotlib.rc_context({**FIGURE_STYLE, "axes.grid": False}):
        figure = Figure(figsize=(11, 10), layout="constrained")
        for axes, (title, robot, across, up, stands, place) in zip(figure.subplots(2, 2).flat, panels, strict=True):
            chain, course = course_of(robot)
            x, y = np.meshgrid(np.linspace(*across, PIXELS), np.linspace(*up, PIXELS))
            passive = np.stack(place(x.ravel() / 1e3, y.ravel() / 1e3), axis=1)
            joints = course.inverse_solutions(passive)[:, 0]
            away = course.distances(joints, passive)
            far = (np.min(away, axis=0) if robot == "delta" else away.parallel).reshape(x.shape)
            side = course.side(joints, passive).reshape(x.shape)
            within = ((joints >= chain.lower) & (joints <= chain.upper)).all(axis=1).reshape(x.shape)
            shown = axes.pcolormesh(x, y, far, vmin=0, vmax=1, rasterized=True)
            axes.contourf(x, y, within, [-0.5, 0.5], colors="white", alpha=0.65)
            axes.contour(x, y, within, [0.5], colors=REFERENCE, linewidths=2)
            lines = axes.contour(x, y, np.where(within, far, np.nan), LINES, colors="white", linewidths=0.8)
            axes.clabel(lines, fontsize=9)
            axes.contour(x, y, side, [0], colors=SINGULAR, linewidths=3)
            at = course.inverse_solutions(np.array([place(*(np.array(stands) / 1e3))]))[:, 0]
            for leg in ClosedArm(chain).legs(at, ClosedArm(chain).nominal()):
                axes.plot(*1e3 * leg[0, :, [0, 2] if robot == "delta" else [0, 1]], "o-", color=ROBOT, markersize=4)
            axes.set(
                aspect="equal", xlim=across, ylim=up, xlabel="x, mm", ylabel=f"{'z' if robot == 'delta' else 'y'}, mm"
            )
            axes.set_title(f"{title}: {far[within].min():.2f} or more within limits")
        figure.colorbar(shown, ax=figure.axes, label="distance from a singularity: 0 singular, 1 best", shrink=0.7)
        figure.suptitle(
            "Within limits (black) the 2-RPR and the Delta stay clear of singularities; the 3-RPR, turned, does not\n"
            "red: parallel singularities; faded: beyond the joints' limits; of the Delta the worst of three distances"
        )
    return figure


def middle(rows: Sequence[Row], key: str) -> list[float]:
    """The median over robots, and an interval that holds it with 95 % or more, whatever the distribution."""
    known = np.array([row[key] for row in rows], dtype=float)
    ends = quantile_test(known).confidence_interval(0.95)
    return [float(np.median(known)), float(ends.low), float(ends.high)]


def said(rows: Sequence[Row]) -> str:
    """Errors on validation poses over robots, in µm, how many fits converged, and how many were found not adequate."""
    size, worst = "{:.2f} ({:.2f} to {:.2f})".format(*middle(rows, "fresh_um")), max(row["worst_um"] for row in rows)
    text = f"{size:22} {max(row['fresh_um'] for row in rows):6.2f} {worst:6.0f}  "
    shares = [f"{np.mean([row[key] for row in rows]):4.0%}" for key in ("converged", "inadequate") if key in rows[0]]
    return text + " ".join(shares)


def report(found: Row) -> list[str]:
    """The tables, line by line."""
    head = "fresh µm rms: median, worst robot, worst pose; fits converged; found not adequate"
    lines = [f"parameters -> rank, condition; before, mm; floor, µm; fresh over floor; predicted, µm; {head}"]
    shown = {"parameters": ".0f", "rank": ".0f", "condition": "4.0f", "before_mm": ".2f", "floor_um": ".2f"}
    for name, rows in found["table"].items():
        cells = [f"{middle(rows, key)[0]:{form}}" for key, form in shown.items()]
        ratio = "{:.2f} ({:.2f} to {:.2f})".format(*middle(rows, "ratio"))
        size = f"{cells[0]} -> {'  '.join(cells[1:])}  {ratio}  {middle(rows, 'predicted_um')[0]:.2f}"
        lines.append(f"{name:28}{size}   {said(rows)}")
    six, rod = found["six rods"], found["longer rod"]
    ranks = ", ".join(str(rank) for rank in sorted({row["rank_copy"] for row in six}))
    sizes = [f"{middle(six, key)[0]:.1e}" for key in ("least_drawn", "next_copy", "least_copy")]
    lines.append(
        f"Delta with six rods, off by 0.1 mm and 0.1 mrad: rank {six[0]['rank_drawn']} as drawn, {ranks} of imperfect "
        f"copies; the last singular value drawn is {sizes[0]}, in copies the next {sizes[1]} and the last {sizes[2]}"
    )
    lines += [f"  {words:38}{said([row[key] for row in six if key in row])}" for key, words in FITS.items()]
    tilts = f"tilts the platform by {rod['tilt_mrad']:.2f} mrad, {rod['worst_mrad']:.2f} at most"
    left = f"three rods leave {rod['fresh_um']:.1f} µm rms, {rod['worst_um']:.0f} at most"
    lines.append(f"one rod {1e3 * LONGER_M:g} mm longer than its twin, no noise: {tilts}; {left}")
    lines += [
        f"no noise, {name}: {worst:.1e} m on validation poses at most" for name, worst in found["exact_m"].items()
    ]
    for name, row in found["modes"].items():
        lines.append(f"modes of {name} drawn: {', '.join(f'{key} {count}' for key, count in row.items())}")
    return lines


def answer(options: Options) -> Answer:
    """Simulate and draw.

    Raises:
        LabError: fewer than two robots.
    """
    began = time.perf_counter()
    if options.robots < 2:
        raise LabError("give two --robots or more: a median with its interval is asked for")
    seeds = range(options.seed, options.seed + options.robots)
    with executors.local_executor() as pool:
        waiting = {name: [pool.submit(one_robot, name, seed) for seed in seeds] for name in CASES}
        six = [pool.submit(six_rods, seed, i < EVERY) for i, seed in enumerate(seeds)]
        exact = {name: [pool.submit(one_robot, name, seed, True) for seed in seeds[:5]] for name in NOISELESS}
        found: Row = {
            "longer rod": longer_rod(),
            "modes": {name: assembled(name, options.readings, options.seed) for name in ("rpr2", "rpr3", "delta")},
            "table": {name: [each.result() for each in futures] for name, futures in waiting.items()},
            "six rods": [each.result() for each in six],
            "exact_m": {name: max(each.result()["worst_um"] for each in f) / 1e6 for name, f in exact.items()},
        }
    options.out.mkdir(parents=True, exist_ok=True)
    save_figure(options.out, "singularities", picture())
    found["seconds"] = time.perf_counter() - began
    (options.out / "parallel_robots.json").write_text(json.dumps(found), encoding="utf-8")
    lines = [*report(found), f"{found['seconds']:.0f} s; figures and picture: {options.out}"]
    return Answer(found, Document("Parallel robots calibrated", paragraphs(lines)))
