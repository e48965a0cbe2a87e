"""What a person reads of a merge: how many poses, which columns were taken for what, what was left out and why."""

import numpy as np

from lab.commands.import_measurements.result import ImportResult
from lab.commands.provenance import provenance_section
from lab.render.charts.axes import Axes
from lab.render.document import Code, Document, Figure, Paragraph, Picture, Row, Section, Table, Warnings
from lab.render.format import fixed
from lab.render.style import AFTER
from lab.render.svg import axes_picture

__all__ = ["import_document", "points_picture"]

_MOST = 20  # things left out that are listed


def import_document(result: ImportResult) -> Document:
    """The merge in sentences, the columns, and what was left out."""
    data = result.measurements
    caption = "The points in the tracker's frame, seen along its z axis."
    return Document(
        f"{result.robot.name}: {len(data)} poses, {int(data.seen.sum())} points",
        (
            Paragraph(" ".join(result.matching.said), "lead"),
            Warnings(result.warnings),
            Section("Uncertainty", (Paragraph(_uncertainty(result)),)),
            Section("Columns", (_columns(result),)),
            Section("Left out", (*_left_out(result),)),
            Section("Points", (Figure("points", (points_picture(result),), caption),)),
            provenance_section("import", result.options, result.robot.sha256),
        ),
    )


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
