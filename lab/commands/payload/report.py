"""The report of a load at the hand, one page: what it weighs, how sure, what is not known, whether to believe it.

It draws with matplotlib, which is slow to import: import this module where a report is written.
"""

from pathlib import Path

import numpy as np
from matplotlib.axes import Axes

from lab.commands.payload.options import PayloadOptions
from lab.commands.payload.result import channels, cost_words, display_unit, rows_of
from lab.commands.payload.run import PayloadResult
from lab.commands.provenance import how_it_was_made
from lab.render.html import (
    Html,
    badge,
    capital,
    figure,
    panel,
    paragraph,
    section,
    short,
    table,
    together,
    warnings_box,
    write_page,
)

MOST_DRAWN = 600  # rows
_SEEN, _FITTED = "#9ca3af", "#0b5fa5"


def write_payload_report(path: Path, run: PayloadResult, options: PayloadOptions) -> None:
    """Write the report of ``lab payload``."""
    found = run.estimate
    mass = f"{found.mass_kg:.4g} kg at the hand" if np.isfinite(found.mass_kg) else "a load that is not told"
    believed = {True: badge("adequate", "good"), False: badge("not adequate", "bad"), None: badge("not judged")}
    parts = [
        paragraph(f"{capital(found.method)}: {found.rank} of {found.columns} parameters identified.", "lead"),
        paragraph(together([believed[found.adequate], f"{capital(found.verdict.words)}."])),
        warnings_box(run.warnings),
        section("The load", [_load(run)]),
        section("What it costs", [paragraph(f"{capital(cost_words(run))}.")] if np.isfinite(run.cost_m) else []),
        section("What is not told", [paragraph(f"{capital(words)}.") for words in found.unidentified]),
        section("What was fitted along", [_along(run)] if found.nuisance else []),
        section("Measured and explained", [_explained(run)]),
        how_it_was_made("payload", options, run.robot.sha256),
    ]
    write_page(path, f"{run.robot.name}: {mass}", parts)


def _load(run: PayloadResult) -> Html:
    rows = [list(row) for row in rows_of(run.estimate)]
    caption = f"About and along the frame of the {run.estimate.frame}, with half-widths of 95 % intervals."
    below = "" if run.estimate is run.fitted else "No body has what least squares found: the nearest that one has."
    return together([table(["", "value", "±", "unit"], rows, caption), paragraph(below, "note")])


def _along(run: PayloadResult) -> Html:
    rows = []
    for each in run.estimate.nuisance:
        factor, unit = display_unit(each.unit)
        rows.append([each.name, short(factor * each.value), short(factor * each.half_width), unit])
    return table(["", "value", "±", "unit"], rows)


def _explained(run: PayloadResult) -> Html:
    """Each channel: what was seen, and what the load with what was fitted along makes of it."""
    found = run.estimate
    every = max(1, len(found.measured) // MOST_DRAWN)
    seen, left = found.measured[::every], found.residual[::every]
    panels = []
    for i, (name, unit) in enumerate(channels(run)):

        def draw(axes: Axes, i: int = i, name: str = name, unit: str = unit) -> None:
            at = np.arange(len(seen)) * every
            axes.plot(at, seen[:, i], ".", color=_SEEN, markersize=3, label="measured")
            axes.plot(at, seen[:, i] - left[:, i], "-", color=_FITTED, linewidth=1, label="explained")
            axes.set(title=name, xlabel="row, as thinned", ylabel=unit)
            if i == 0:
                axes.legend(loc="best")

        panels.append(panel(f"channel{i}", f"{name}, measured and explained", (4.4, 2.3), draw, (0.7, 0.45, 0.1, 0.3)))
    caption = "What the load adds, as measured, and as the identified load and what was fitted along explain it."
    return figure("explained", panels, caption)
