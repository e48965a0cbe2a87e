"""Methods of identifying a payload: the picture and the tables of the study."""

import time
from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure

from lab.experiments.payload_methods import (
    DIFFERENCE,
    METHODS,
    MOVING,
    NOISE,
    RANDOM,
    RESTING,
    STIFFNESS,
    TORQUES,
    Options,
    Row,
    Run,
    biased,
    by_torques,
    errors_of,
    foreseen,
    measured,
    planned,
    precision,
    write_motion,
)
from lab.experiments.script import Answer, paragraphs, write_rows
from lab.extensions.dynamics.payload.excitation import predicted
from lab.render.document import Document
from lab.render.style import AXIS, GRID, REFERENCE, SERIES
from lab.render.svg import save_figure

__all__ = ["answer", "picture", "report"]

FLOOR = 1e-3  # % and mm: smaller biases are drawn there
COLOURS = dict(zip((TORQUES, RESTING, MOVING, RANDOM), (SERIES[i][0] for i in (1, 2, 3, 4)), strict=True))


def picture(found: dict[str, Run], rows: Sequence[Row], biases: Sequence[Row]) -> Figure:
    """Left: errors of the mass, run by run. Right: biases of mass and centre without and with their cure."""
    figure = Figure(figsize=(14, 5.8), layout="constrained")
    left, *right = figure.subplots(1, 3, width_ratios=[1.25, 1, 1])
    ticks, style = [], {"fmt": "_", "capsize": 8, "linewidth": 2}
    for i, (method, estimates) in enumerate(found.items()):
        row, errors = next(row for row in rows if row["method"] == method), errors_of(estimates)[:, 0]
        left.plot(i + np.linspace(0.15, 0.35, len(errors)), errors, "o", color=COLOURS[method], alpha=0.6)
        left.errorbar(i - 0.2, 0, row["predicted"], color=REFERENCE, **style)
        left.errorbar(i, row["mean_error"], row["scatter"], color=COLOURS[method], **style)
        ticks.append(f"{method}\npredicted {row['predicted']:.2g} %\nscatter {row['scatter']:.2g} %")
    left.grid(color=GRID)
    left.set_xticks(range(len(found)), ticks)
    left.set(xlim=(-0.5, 2.5), ylabel="error of the mass, %", title="1.5 kg weighed: predicted ±1 σ (black), found")
    names = ("mass", "mass_percent", "mass, % (dotted: 0.3)"), ("centre", "centre_mm", "centre of mass, mm")
    for axes, (error, name, words) in zip(right, names, strict=True):
        for y, row in enumerate(biases):
            ends, colour = [max(FLOOR, abs(row[f"{name}{end}"])) for end in ("", "_cured")], COLOURS[row["method"]]
            axes.plot(ends, [y, y], "-", color=AXIS, linewidth=1)
            for end, x, fill in zip(("", "_cured"), ends, ("full", "none"), strict=True):
                bar = [[0], [2 * row[f"{error}_error{end}"]]]
                axes.errorbar(x, y, xerr=bar, fmt="o", color=colour, fillstyle=fill, markersize=9)
        axes.set(xscale="log", xlabel=f"size of the mean error of the {words}", ylim=(len(biases) - 0.5, -0.5))
        axes.set_yticks(range(len(biases)), [f"{row['what']}\n{row['method']}" for row in biases])
        axes.grid(color=GRID)
        axes.set_xticks([FLOOR, 0.01, 0.1, 1], [f"≤ {FLOOR:g}", "0.01", "0.1", "1"])
    right[1].tick_params(labelleft=False)
    right[0].axvline(0.3, color=REFERENCE, linestyle=":")
    right[0].set_title("filled: unnoticed; hollow: cured")
    right[1].set_title("bars: up to 2 standard errors more")
    return figure


def report(rows: Sequence[Row], biases: Sequence[Row]) -> list[str]:
    """The tables, line by line."""
    lines = [
        f"{'':48}{'predicted 1 σ':>13}{'scatter':>10}{'mean error':>12}  95 % intervals cover; adequacy test fires"
    ]
    for row in rows:
        line = f"{row['method']:18}{row['quantity']:23}{row['unit']:7}{row['predicted']:13.3g}{row['scatter']:10.3g}"
        ends = f"{row['mean_error']:12.2g}  {row['covered']:.0%}; {row['fired']:.0%}" if "covered" in row else ""
        lines.append(line + ends)
    lines.append(f"mean errors of mass and centre, µm at {STIFFNESS[0]:g} Nm/rad, test fires: without -> with the cure")
    shown = (("mass_percent", ".3f", "%"), ("centre_mm", ".3f", "mm"), ("cost_um", ".3f", "µm"), ("fired", ".0%", ""))
    for row in biases:
        cells = [f"{row[name]:{form}} -> {row[name + '_cured']:{form}} {unit}" for name, form, unit in shown]
        lines.append("  ".join([f"{row['what']:20}{row['method']:22}{row['cure']:13}", *cells]))
    return lines


def answer(options: Options) -> Answer:
    """Plan, measure, identify, and draw."""
    began, plan = time.perf_counter(), planned(options)
    found = {way: measured(plan, NOISE, way, ("",), options.runs, options.seed, 0)[0] for way in METHODS}
    rows, biases = precision(found, foreseen(plan)), biased(plan, NOISE, options.runs, options.seed)
    options.out.mkdir(parents=True, exist_ok=True)
    save_figure(options.out, "payload", picture(found, rows, biases))
    write_motion(options.out, plan)
    for name, table in (("payload", rows), ("payload_biases", biases)):
        write_rows(options.out / f"{name}.csv", table)
    seconds = time.perf_counter() - began
    condition, by_chance = (predicted(path, by_torques, DIFFERENCE).condition for path in (plan.path, plan.random))
    lines = [
        *report(rows, biases),
        f"condition number of the torques' information: D-optimal path {condition:.3g}, random path {by_chance:.3g}",
        f"{seconds:.0f} s; tables and picture: {options.out}",
    ]
    values = {"rows": rows, "biases": biases, "seconds": seconds}
    return Answer(values, Document("How is a payload identified best?", paragraphs(lines)))
