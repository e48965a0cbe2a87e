"""Global or sequential identification: the picture, the table and the sentences of the study."""

import time
from collections.abc import Sequence

import matplotlib
import numpy as np
from matplotlib.figure import Figure

from lab.core.se3 import Array
from lab.experiments.global_or_sequential import (
    CURVE_RAD,
    PREDICTED,
    SIGMA_M,
    WORSE,
    Interval,
    Options,
    beside,
    campaigns,
    crossing_rad,
    predicted_mm,
    ranks,
    table_of,
)
from lab.experiments.script import Answer, paragraphs, write_rows
from lab.render.document import Document
from lab.render.style import FIGURE_STYLE, MUTED, REFERENCE, SERIES
from lab.render.svg import save_figure

__all__ = ["answer", "picture", "report"]


def picture(rows: Sequence[dict[str, float]], curve: Array, alone_mm: float, title: str) -> Figure:
    """Errors on validation poses against the orientations' noise.

    Points are simulated, lines ``(2, CURVE_RAD)`` predicted.
    """
    noise = [row["noise_mrad"] for row in rows]
    with matplotlib.rc_context(FIGURE_STYLE):
        figure = Figure(figsize=(8.5, 5.5), layout="constrained")
        axes = figure.add_subplot(xscale="log", yscale="log", title=title)
        for name, colour, mark, size, line in (
            ("sequential", SERIES[1][0], "s--", 6.5, curve[1]),
            ("global", SERIES[2][0], "o-", 5, curve[0]),
        ):
            mean, lower, upper = (np.array([row[f"{name}_mm{e}"] for row in rows]) for e in ("", "_lower", "_upper"))
            axes.plot(1e3 * CURVE_RAD, line, mark[1:], color=colour, label=f"{name}: predicted")
            axes.errorbar(noise, mean, [mean - lower, upper - mean], fmt=mark[0], color=colour, markersize=size,
                          ecolor=REFERENCE, capsize=5, label=f"{name}: simulated, 95 % interval")  # fmt: skip
        repaired = [row["one_step_mm"] for row in rows]
        axes.plot(noise, repaired, "o", color=REFERENCE, fillstyle="none", markersize=13,
                  label="sequential, then one global step")  # fmt: skip
        axes.axhline(alone_mm, color=MUTED, linestyle=":", label="positions alone: global")
        parting = 1e3 * crossing_rad(curve[1] / curve[0], WORSE)
        axes.axvline(parting, color=MUTED, linewidth=1)
        words = f"from {parting:.2f} mrad on sequential\nis {100 * (WORSE - 1):.0f} % worse and more"
        axes.text(parting / 1.05, 0.6, words, transform=axes.get_xaxis_transform(), ha="right")
        for axis, ticks in ((axes.xaxis, (0.01, 0.03, 0.1, 0.3, 1)), (axes.yaxis, (0.05, 0.07, 0.1, 0.2, 0.3, 0.4))):
            axis.set_ticks(ticks, [f"{tick:g}" for tick in ticks])
            axis.set_ticks([], minor=True)
        axes.set_xlabel("noise of orientations, mrad (1 σ per axis)")
        axes.set_ylabel("mean position error on validation poses, mm")
        axes.legend(loc="upper left")
    return figure


def report(rows: Sequence[dict[str, float]], others: dict[str, Interval]) -> list[str]:
    """The table, and the other ways beside it, line by line."""
    lines = [
        "mean position error on validation poses, mm, with 95 % intervals over robots; p: predicted",
        f"{'mrad':>5}  {'global':34}  {'sequential':34}  one step  {'paired ratio':22}  {'of means':13}  worse in",
    ]
    for row in rows:
        cells = [f"{row['noise_mrad']:>5g}"]
        for name in ("global_mm", "sequential_mm"):
            mean, lower, upper, foreseen = (row[name + end] for end in ("", "_lower", "_upper", "_predicted"))
            cells.append(f"{mean:.4f} ({lower:.4f} to {upper:.4f}) p {foreseen:.4f}")
        cells.append(f"{row['one_step_mm']:8.4f}")
        cells.append(f"{row['ratio']:.3f} ({row['ratio_lower']:.3f} to {row['ratio_upper']:.3f})")
        cells.append(f"{row['ratio_of_means']:.3f} p {row['ratio_of_means_predicted']:.3f}")
        lines.append("  ".join([*cells, f"{row['share_worse']:8.0%}"]))
    lines.append("one step: a global one after the sequential answer; worse in: of the robots")
    for name, (mean, lower, upper) in others.items():
        lines.append(f"{name}: {mean:.1e}" if mean < 1e-9 else f"{name}: {mean:.4f} ({lower:.4f} to {upper:.4f})")
    return lines


def said(rows: Sequence[dict[str, float]], curve: Array, alone_mm: float, reach_m: float) -> str:
    """The answer in a few sentences."""
    part, useless = crossing_rad(curve[1] / curve[0], WORSE), crossing_rad(curve[1], alone_mm)
    last, off = rows[-1], max(row["one_step_off"] for row in rows)
    return (
        "Sequential equals global only where the noise of orientations times the reach is well below that of "
        f"positions, {1e3 * SIGMA_M:g} mm. They part at {1e3 * part:.2f} mrad ({1e3 * part * reach_m:.2f} mm at "
        f"{reach_m:.2f} m), where sequential is {100 * (WORSE - 1):.0f} % worse. From {1e3 * useless:.2f} mrad on "
        f"it is worse than positions alone, and at {last['noise_mrad']:g} mrad {last['ratio']:.1f} times worse than "
        "the global fit. One global step after it repairs it: no robot's error then differs from the global one's by "
        f"more than {100 * off:.1f} %."
    )


def answer(options: Options) -> Answer:
    """Simulate, predict, and draw."""
    began, campaign = time.perf_counter(), campaigns(options)
    found, rows, others = ranks(campaign), table_of(campaign, options.seed), beside(campaign, options.seed)
    curve = predicted_mm(campaign, CURVE_RAD.tolist(), PREDICTED).mean(axis=2)
    alone_mm = others["positions alone, global"][0]
    words = said(rows, curve, alone_mm, float(np.abs(campaign.nominal.arm.chain.table[:, [1, 2]]).sum()))
    size = f"{options.robots} RX 130 arms, {options.poses} poses each, position noise {1e3 * SIGMA_M:g} mm"
    title = f"Global or sequential? {size}"
    options.out.mkdir(parents=True, exist_ok=True)
    save_figure(options.out, "global_or_sequential", picture(rows, curve, alone_mm, title))
    table = options.out / "global_or_sequential.csv"
    write_rows(table, rows)
    seconds = time.perf_counter() - began
    lines = [
        f"ranks: {', '.join(f'{name}: {rank}' for name, rank in found.items())}",
        *report(rows, others),
        words,
        f"{seconds:.0f} s; table: {table}, picture: {table.with_suffix('.png')}",
    ]
    values = {"ranks": found, "rows": rows, "beside_mm": others, "words": words, "seconds": seconds}
    return Answer(values, Document(title, paragraphs(lines)))
