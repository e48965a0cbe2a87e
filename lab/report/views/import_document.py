"""Document of measurements that were merged from a tracker's and a controller's file."""

from collections import Counter

import numpy as np

from lab.core.errors import counted
from lab.core.number_text import fixed
from lab.core.units import MM
from lab.library.import_measurements import ImportResult
from lab.library.log_clocks import LEAST_POSES, NominalFit
from lab.library.log_matching import Timeline
from lab.report.charts.chart import axes_picture
from lab.report.charts.marks import Axes
from lab.report.document import Code, Document, Figure, Paragraph, Picture, Row, Section, Table, Warnings, guarded
from lab.report.style import AFTER, BEFORE, GRID, MUTED

__all__ = ["import_document"]

_MOST = 20  # things left out that are listed
_MAX_WINDOWS = 400  # of a log that are drawn, from the first
_WIDE = (7.0, 2.4)  # inches


def import_document(result: ImportResult) -> Document:
    """Build the document of merged measurements."""
    data = result.measurements
    by_camera = result.corners is not None
    counts = (
        f"{counted(len(result.matching.poses), 'picture')}, {counted(len(data), 'corner')}"
        if by_camera
        else f"{len(data)} poses, {int(data.seen.sum())} points"
    )
    return Document(
        f"{result.robot.name}: {counts}",
        (
            Paragraph(" ".join(result.matching.description), "lead"),
            Warnings(result.warnings),
            *_match(result),
            *(() if by_camera else (Section("Uncertainty", (Paragraph(_uncertainty(result)),)),)),
            Section("Columns", (_columns(result),)),
            Section("Left out", (*_left_out(result),)),
        ),
    )


@guarded
def _match(result: ImportResult) -> tuple[Section, ...]:
    """The two files on one clock; nothing where points found their poses by name or order."""
    line = result.matching.timeline
    if line is None:
        return ()
    placed = line.placed
    if result.corners is not None:
        return (
            Section(
                "Match in time",
                (
                    Paragraph(
                        f"{placed.description} pictures are placed by times alone, which a wrong clock offset may also "
                        "allow; lab identify shows by its residuals whether pictures belong to other poses."
                    ),
                    Figure("match", (_timeline_picture(line),), "When the arm stood still (grey), and the pictures."),
                ),
            ),
        )
    checked = (
        f"Points are compared with the nominal arm, with base and tool fitted: {placed.description}."
        if placed.rms_m is not None
        else f"{placed.description} points are placed. Fewer than {LEAST_POSES} distinct poses were measured, so the "
        "nominal arm cannot check the clock offset."
    )
    caption = (
        "Above: when the arm stood still (grey) and when points were measured (blue; vermilion: left out), on the "
        "controller's clock. Below: the step from each pose to the next, measured and by the nominal arm, with base "
        "and tool fitted. A point matched to a wrong pose lies off the line."
    )
    pictures = (_timeline_picture(line), *([_steps_picture(result)] if placed.rms_m is not None else []))
    return (Section("Match in time", (Paragraph(checked), Figure("match", pictures, caption))),)


def _timeline_picture(line: Timeline) -> Picture:
    """Draw the arm's stops and the measured points over the controller's time since its first stop."""
    first, inside = line.starts[0], line.retained
    starts, ends = line.starts[:_MAX_WINDOWS] - first, line.ends[:_MAX_WINDOWS] - first
    shown = (
        (line.at >= first) & (line.at <= first + ends[-1]) if len(line.starts) > _MAX_WINDOWS else np.isfinite(line.at)
    )

    def draw(axes: Axes) -> None:
        for start, end in zip(starts, ends, strict=True):
            axes.fill_between([start, max(end, start + 1e-3)], [0, 0], [1, 1], color=GRID, linewidth=0)
        for chosen, colour, text in ((inside & shown, AFTER, "placed"), (~inside & shown, BEFORE, "left out")):
            if chosen.any():
                axes.scatter(line.at[chosen] - first, np.full(chosen.sum(), 0.5), s=14, color=colour, label=text)
        axes.set(xlabel="time from the first stop, s", ylim=(-0.1, 1.7))
        axes.set_yticks([], [])
        axes.legend(loc="upper right")

    label = f"{inside.sum()} of {len(inside)} measured in {len(line.starts)} stops"
    return axes_picture("timeline", label, _WIDE, draw, (0.7, 0.5, 0.15, 0.15))


def _steps_picture(result: ImportResult) -> Picture:
    """The step from each pose to the next, measured and by the nominal arm with base and tool fitted."""
    data = result.measurements
    nominal = NominalFit(result.robot, data.targets, result.points.positions)
    rows, points = np.arange(len(data)), data.points[:, 0]
    predicted = nominal.predicted(data.joints, np.zeros(len(data), dtype=np.int_), points)
    measured, expected = (MM.of(np.linalg.norm(np.diff(each, axis=0), axis=1)) for each in (points, predicted))

    def draw(axes: Axes) -> None:
        axes.plot(rows[1:] + 1, expected, "-", color=MUTED, linewidth=1.2, label="nominal arm")
        axes.plot(rows[1:] + 1, measured, "o", color=AFTER, markersize=3.5, label="measured")
        axes.set(xlabel="pose", ylabel="step, mm", ylim=(0, 1.4 * float(np.nanmax(measured))))
        axes.legend(loc="upper right")

    return axes_picture("steps", f"Steps between {len(data)} poses, measured and nominal", _WIDE, draw)


def _uncertainty(result: ImportResult) -> str:
    sigma = MM.of(result.measurements.sigma_m[np.isfinite(result.measurements.sigma_m)])
    if not sigma.size:
        return (
            "The tracker's file gives no uncertainties: give lab identify --noise-mm or --instrument, or let it "
            "estimate the noise."
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
        return (Paragraph("None: every line is a point or a pose."),)
    counts = "; ".join(f"{count} because: {why}" for why, count in Counter(each.why for each in left).items())
    more = f" The first {_MOST} of {len(left)} are listed; result.json has all." if len(left) > _MOST else ""
    rows: list[Row] = [
        (each.file.rsplit("/", 1)[-1], str(each.line or "–"), each.what, each.why) for each in left[:_MOST]
    ]
    return Paragraph(f"{counts}.{more}"), Table(("file", "line", "what", "why"), tuple(rows))
