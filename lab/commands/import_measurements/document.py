"""What a person reads of a merge: how many poses, which columns were taken for what, what was left out and why."""

import numpy as np

from lab.commands.import_measurements.matching import Timeline
from lab.commands.import_measurements.nominal_fit import LEAST_POSES, NominalFit
from lab.commands.import_measurements.result import ImportResult
from lab.commands.provenance import provenance_section
from lab.render.charts.axes import Axes
from lab.render.document import Code, Document, Figure, Paragraph, Picture, Row, Section, Table, Warnings
from lab.render.format import fixed
from lab.render.style import AFTER, BEFORE, GRID, MUTED
from lab.render.svg import axes_picture

__all__ = ["import_document", "points_picture", "steps_picture", "timeline_picture"]

_MOST = 20  # things left out that are listed
_STOPS = 400  # of a log that are drawn, from the first
_WIDE = (7.0, 2.4)  # inches


def import_document(result: ImportResult) -> Document:
    """The merge in sentences, the columns, and what was left out."""
    data = result.measurements
    caption = "The points in the tracker's frame, seen along its z axis."
    return Document(
        f"{result.robot.name}: {len(data)} poses, {int(data.seen.sum())} points",
        (
            Paragraph(" ".join(result.matching.said), "lead"),
            Warnings(result.warnings),
            *_match(result),
            Section("Uncertainty", (Paragraph(_uncertainty(result)),)),
            Section("Columns", (_columns(result),)),
            Section("Left out", (*_left_out(result),)),
            Section("Points", (Figure("points", (points_picture(result),), caption),)),
            provenance_section("import", result.options, result.robot.sha256),
        ),
    )


def _match(result: ImportResult) -> tuple[Section, ...]:
    """The two files on one clock; nothing where points found their poses by name or order."""
    line = result.matching.timeline
    if line is None:
        return ()
    placed = line.placed
    checked = (
        f"Points are compared with the nominal arm, with base and tool fitted: {placed.words}."
        if placed.rms_m is not None
        else f"{placed.words} points are placed. Fewer than {LEAST_POSES} distinct poses were met, so the nominal arm "
        "does not check the offset of the clocks."
    )
    caption = (
        "Above: when the arm stood still (grey) and when points were measured (blue; vermilion: left out), on the "
        "controller's clock. Below: the step from each pose to the next, measured and by the nominal arm, with base "
        "and tool fitted. Points of other poses would leave the line."
    )
    pictures = (timeline_picture(line), *([steps_picture(result)] if placed.rms_m is not None else []))
    return (Section("Match in time", (Paragraph(checked), Figure("match", pictures, caption))),)


def timeline_picture(line: Timeline) -> Picture:
    """When the arm stood still and when points were measured, on the controller's clock from its first stop on."""
    first, inside = line.starts[0], line.kept
    starts, ends = line.starts[:_STOPS] - first, line.ends[:_STOPS] - first
    shown = (line.at >= first) & (line.at <= first + ends[-1]) if len(line.starts) > _STOPS else np.isfinite(line.at)

    def draw(axes: Axes) -> None:
        for start, end in zip(starts, ends, strict=True):
            axes.fill_between([start, max(end, start + 1e-3)], [0, 0], [1, 1], color=GRID, linewidth=0)
        for chosen, colour, words in ((inside & shown, AFTER, "placed"), (~inside & shown, BEFORE, "left out")):
            if chosen.any():
                axes.scatter(line.at[chosen] - first, np.full(chosen.sum(), 0.5), s=14, color=colour, label=words)
        axes.set(xlabel="time from the first stop, s", ylim=(-0.1, 1.7))
        axes.set_yticks([], [])
        axes.legend(loc="upper right")

    label = f"{inside.sum()} of {len(inside)} points in {len(line.starts)} stops"
    return axes_picture("timeline", label, _WIDE, draw, (0.7, 0.5, 0.15, 0.15))


def steps_picture(result: ImportResult) -> Picture:
    """The step from each pose to the next, measured and by the nominal arm with base and tool fitted."""
    data = result.measurements
    nominal = NominalFit(result.robot, data.targets, result.points.positions)
    rows, points = np.arange(len(data)), data.points[:, 0]
    predicted = nominal.predicted(data.joints, np.zeros(len(data), dtype=np.int_), points)
    measured, expected = (1e3 * np.linalg.norm(np.diff(each, axis=0), axis=1) for each in (points, predicted))

    def draw(axes: Axes) -> None:
        axes.plot(rows[1:] + 1, expected, "-", color=MUTED, linewidth=1.2, label="nominal arm")
        axes.plot(rows[1:] + 1, measured, "o", color=AFTER, markersize=3.5, label="measured")
        axes.set(xlabel="pose", ylabel="step, mm", ylim=(0, 1.4 * float(np.nanmax(measured))))
        axes.legend(loc="upper right")

    return axes_picture("steps", f"Steps between {len(data)} poses, measured and nominal", _WIDE, draw)


def _uncertainty(result: ImportResult) -> str:
    sigma = 1e3 * result.measurements.sigma_m[np.isfinite(result.measurements.sigma_m)]
    if not sigma.size:
        return (
            "The tracker's file gives no uncertainties: give lab identify --noise-mm or --instrument, "
            "or let it estimate them."
        )
    if np.ptp(sigma) < 1e-9:
        return f"The standard uncertainty of a coordinate is {fixed(float(sigma[0]), 4)} mm (column sigma_mm)."
    low, high = (fixed(float(each), 4) for each in (sigma.min(), sigma.max()))
    return f"The standard uncertainty of a coordinate is {low} to {high} mm (column sigma_mm)."


def _columns(result: ImportResult) -> Table:
    rows: list[Row] = [(what, Code(column), result.points.path.name) for what, column in result.points.used.items()]
    rows += [(what, Code(column), result.log.path.name) for what, column in result.log.used.items()]
    rows += [("not used", Code(column), result.points.path.name) for column in result.points.unused]
    return Table(("taken for", "column", "file"), tuple(rows))


def _left_out(result: ImportResult) -> tuple[Paragraph | Table, ...]:
    left = result.left_out
    if not left:
        return (Paragraph("Nothing: every line is a point or a pose."),)
    counts = "; ".join(f"{count} because: {why}" for why, count in result.left_out_counts.items())
    more = f" The first {_MOST} of {len(left)} are listed; result.json has all." if len(left) > _MOST else ""
    rows: list[Row] = [
        (each.file.rsplit("/", 1)[-1], str(each.line or "–"), each.what, each.why) for each in left[:_MOST]
    ]
    return Paragraph(f"{counts}.{more}"), Table(("file", "line", "what", "why"), tuple(rows))


def points_picture(result: ImportResult) -> Picture:
    """The points seen along the z axis of the tracker's frame."""
    points = 1e3 * result.measurements.points.reshape(-1, 3)
    points = points[np.isfinite(points).all(axis=1)]

    def draw(axes: Axes) -> None:
        axes.scatter(points[:, 0], points[:, 1], s=12, color=AFTER)
        axes.set(xlabel="x, mm", ylabel="y, mm")
        axes.set_aspect("equal", adjustable="datalim")

    return axes_picture("points", f"{len(points)} measured points", (4.5, 3.6), draw)
