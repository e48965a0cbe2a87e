"""Show the history of an arm: its state, what changed and when, its errors, and which change would be found."""

from typing import Any

import numpy as np

from lab.arm_history.changes import Changes
from lab.arm_history.dated_runs import DatedRun
from lab.arm_history.history_result import ArmHistory, HistoryResult
from lab.core.errors import LabError, counted
from lab.core.number_text import capital, digits_of, fixed, plus_minus, short
from lab.core.se3 import Array
from lab.core.significance import TREND_YEAR
from lab.core.units import MM, Unit
from lab.phrases.verification_phrases import parameter_text
from lab.report import document as doc
from lab.report.blocks import verdict_badge
from lab.report.charts.chart import axes_picture, log_ticks
from lab.report.charts.marks import Axes
from lab.report.comparison_plots import (
    ColourScale,
    Intervals,
    date_axis,
    heat_map,
    interval_chart,
    signed_place,
    signed_ticks,
)
from lab.report.style import AFTER, ARROW_AFTER, GATE, INK, OUTLIER, WORST
from lab.report.views.fleet_document import arms_document, change_rows, checks_picture, mark_verdicts
from lab.verification.parameter_changes import ParameterChange

__all__ = ["history_document", "main_picture"]

_ROW = 0.2  # inches of a parameter
_MOST_PICTURES = 6  # parameters with a picture of their own
_MOST_COLUMNS = 24  # of a heat map: of more calibrations, an evenly spaced part
_SHIFT_SCALE = (WORST, "#f5c7ad", "#f7f7f7", "#b9c9ea", ARROW_AFTER)  # from smaller to larger, equal in the middle
_MOST_DIGITS = 6
_LEVEL = f"An unchanged arm raises an alarm in at most {100 * TREND_YEAR:g} % of the years."
_CHANGES = (
    "between", "and", "what changed", "by", "95 %", "unit", doc.Column("found by", doc.PAGE),
    doc.Column("chance if unchanged", doc.PAGE),
)  # fmt: skip


def history_document(result: HistoryResult) -> doc.Document:
    """Build the document: of one arm what changed, of several their states."""
    return _arm_document(result, result.arms[0]) if len(result.arms) == 1 else arms_document(result)


def main_picture(result: HistoryResult) -> doc.Picture:
    """Draw the parameters of an arm over its calibrations, or the checks of arms over time.

    Raises:
        LabError: there is no run.
    """
    if not result.arms:
        raise LabError("no run could be used, so there is nothing to draw")
    changes = result.arms[0].changes
    if len(result.arms) > 1 or changes is None or len(changes.dated) < 2:
        return checks_picture(result)
    return _parameter_pictures(changes)[0]


def _arm_document(result: HistoryResult, arm: ArmHistory) -> doc.Document:
    changes = arm.changes
    rows = () if changes is None else tuple(row for each in changes.found for row in change_rows(changes, each))
    moved = () if changes is None or len(changes.dated) < 2 else _moved(changes)
    return doc.Document(
        f"{arm.called}: {', '.join(filter(None, (arm.state * (not _compares(result)), _count_text(changes))))}",
        (
            *_card(result, arm).everywhere,
            doc.Warnings(result.warnings),
            doc.Section(
                "What changed", (doc.Table(_CHANGES, rows, "Changes between calibrations" * bool(rows)), *moved)
            ),
            doc.Section("Calibrations and verifications", (_checks(arm),)),
            doc.Section("Minimum detectable change", () if changes is None else _detectable(result, changes)),
        ),
    )


def _compares(result: HistoryResult) -> bool:
    """Check whether calibrations were given to be compared, rather than to see the state of an arm."""
    changes = result.arms[0].changes
    return result.given and changes is not None and len(changes.dated) > 1


def _count_text(changes: Changes | None) -> str:
    """Count the changes; "" where there are fewer than two calibrations."""
    if changes is None or len(changes.dated) < 2:
        return ""
    count = len(changes.found)
    return f"{counted(count, 'change') if count else 'no change'} in {len(changes.dated)} calibrations"


@doc.guarded
def _card(result: HistoryResult, arm: ArmHistory) -> doc.Card:
    changes = arm.changes
    lead = list[doc.Inline]()
    if not _compares(result):
        lead += [verdict_badge(arm.state), f" on {result.on}"]
    numbers: list[tuple[str, str, str]] = []
    if (error := arm.error_then_mm if arm.error_now_mm is None else arm.error_now_mm) is not None:
        numbers.append(("mean error now", short(error, "mm"), "after"))
    if arm.gate_mm is not None:
        numbers.append(("gate", f"{arm.gate_mm:g} mm", ""))
    if changes is not None and len(changes.dated) > 1:
        badge = doc.Badge("changed", "bad") if changes.found else doc.Badge("unchanged", "good")
        lead += [*("; ",) * bool(lead), badge, f" {_when(changes)}"]
    if changes is not None and changes.found:
        numbers += _numbers_of_change(changes, changes.found[-1])
    figure = doc.Figure("errors-over-time", _errors_picture(arm), _errors_caption(arm))
    return doc.Card(
        tuple(lead),
        tuple(numbers),
        f"Errors at poses that were not fitted. {_LEVEL}",
        _next_step(result, arm),
        (figure,),
    )


def _numbers_of_change(changes: Changes, change: ParameterChange) -> list[tuple[str, str, str]]:
    """Return the size of a change: of the first parameter that it names, and at the tool."""
    numbers = [("at the tool", short(MM.of(changes.at_tool_m(change)), "mm"), "")]
    if not change.named:
        return numbers
    size, half, unit = _size(changes.unit(change.named[0]), change.changes[0], change.half_widths[0])
    return [(parameter_text(change.named[0]), f"{size} {half} {unit}", ""), *numbers]


def _when(changes: Changes) -> str:
    """Name the calibrations around the last change; of an unchanged arm the first and the last."""
    after = changes.found[-1].after if changes.found else 0
    first, last = (changes.dated[i] for i in ((after, after + 1) if changes.found else (0, -1)))
    times = f"{len(changes.found)} times, the last time " if len(changes.found) > 1 else ""
    return f"{times}between {_short_day(first)} and {_short_day(last)}"


def _short_day(run: DatedRun) -> str:
    return run.folder.name if run.on is None else run.on.isoformat()


def _next_step(result: HistoryResult, arm: ArmHistory) -> str:
    changes = arm.changes
    if changes is None or not changes.found or arm.state == "bad":
        if _compares(result) and arm.state != "bad":
            return "Keep the last calibration, and check the arm each month with lab verify."
        return f"{capital(arm.to_do)}."
    before, after, last = (changes.dated[i] for i in (changes.found[-1].after, changes.found[-1].after + 1, -1))
    return (
        f"Use the calibration of {_short_day(last)}, which includes the change. Find what happened between "
        f"{_short_day(before)} and {_short_day(after)}: a collision, a new motor, gear or zero, or another mounting?"
    )


def _errors_picture(arm: ArmHistory) -> tuple[doc.Picture, ...]:
    """Draw the mean error of each check over time, against the gate; nothing of fewer than two."""
    dated = [(each.on, each.error_mm, each) for each in arm.checks if each.on is not None and each.error_mm]
    if len(dated) < 2:
        return ()
    days, sizes = [on.toordinal() for on, _, _ in dated], [size for _, size, _ in dated]
    gates = [(on.toordinal(), each.gate_mm) for on, _, each in dated if each.gate_mm is not None]
    low, high = min(sizes) / 1.6, max(*sizes, *(gate for _, gate in gates)) * 1.8

    def draw(axes: Axes) -> None:
        log_ticks(axes, "y", low, high)
        _mark_changes(axes, arm.changes, low, high)
        axes.plot(days, sizes, "-", color=AFTER, linewidth=1.2)
        mark_verdicts(axes, [(on.toordinal(), size, each.verdict) for on, size, each in dated])
        if gates:
            axes.plot(*zip(*gates, strict=True), "--", color=GATE, linewidth=1.4, drawstyle="steps-post")
            beside: Any = {"xytext": (7, 0), "textcoords": "offset points", "va": "center"}
            axes.annotate("gate", gates[-1], color=GATE, **beside)
        axes.set(ylabel="mean error, mm (logarithmic)")
        date_axis(axes, dated[0][0], dated[-1][0], right=0.17)

    label = f"Mean error of each check: {short(min(sizes))} to {short(max(sizes))} mm"
    return (axes_picture("errors", label, (3.8, 2.4), draw, (0.7, 0.35, 0.1, 0.25)),)


def _errors_caption(arm: ArmHistory) -> str:
    parts = ["Mean error of each calibration and verification: round is good, a triangle doubtful, a diamond bad"]
    parts += ["dashed: the gate"] * any(each.gate_mm is not None for each in arm.checks)
    parts += ["shaded: between the calibrations around a change"] * bool(arm.changes is not None and arm.changes.found)
    return f"{'; '.join(parts)}."


def _mark_changes(axes: Axes, changes: Changes | None, low: float, high: float) -> None:
    """Shade the time between the calibrations around each change."""
    for change in () if changes is None else changes.found:
        between = [changes.dated[i].on for i in (change.after, change.after + 1)] if changes is not None else []
        ends = [on.toordinal() for on in between if on is not None]
        if len(ends) == 2:
            axes.fill_between(ends, [low, low], [high, high], color=OUTLIER, alpha=0.16)


@doc.guarded
def _moved(changes: Changes) -> tuple[doc.Block, ...]:
    own = _over_time_pictures(changes)
    several = "Where rows are joined by 'or', the calibrations do not decide which of them changed."
    doubted = any(len(change.named) > 1 and not change.several for change in changes.found)
    if len(changes.dated) == 2:
        caption = "Differences between the two calibrations with 95 % intervals; bold: changed."
    else:
        caption = (
            "All parameters: differences from the first calibration. Faint: within the interval, as an unchanged arm "
            "is in 19 of 20 cases. Blue: larger; vermilion: smaller. Lines mark changes. The scale is logarithmic "
            "beyond ±1."
        )
    if own:
        caption = f"Differences from the first calibration with 95 % intervals; shaded: around a change. {caption}"
    return (
        doc.Paragraph(several if doubted else "", "note"),
        doc.Paragraph("" if changes.found else "Nothing: no parameter of the links differs.", shown_in=doc.PAGE),
        doc.Figure("parameters-figure", (*own, *_parameter_pictures(changes)), caption, wide=True),
        *(_differences(changes),) * (len(changes.dated) == 2),
    )


def _changed_names(changes: Changes) -> list[str]:
    return list(dict.fromkeys(name for change in changes.found for name in change.named))


def _parameter_pictures(changes: Changes) -> tuple[doc.Picture, ...]:
    """Draw the differences from the first calibration: of one other in their units, of more as a map over time."""
    names, shifts, halves = changes.estimates[0].names, changes.shifts, changes.half_widths
    if len(shifts) == 2:
        units = dict.fromkeys(each.unit_of_change for each in changes.parameters)
        return tuple(_difference_picture(changes, unit, f"differences-{i}") for i, unit in enumerate(units, start=1))
    sizes: Array = np.divide(shifts, halves, out=np.zeros_like(shifts), where=halves > 0)
    columns = np.unique(np.round(np.linspace(0, len(sizes) - 1, min(len(sizes), _MOST_COLUMNS))).astype(int))
    most, step = max(float(np.abs(sizes).max()), 2.0), -(-len(columns) // 8)
    dates = [_short_day(changes.dated[i]) if k % step == 0 else "" for k, i in enumerate(columns)]
    lines = [int(np.searchsorted(columns, change.after + 1)) for change in changes.found]
    scale = ColourScale(_SHIFT_SCALE, signed_ticks(most), "difference in half-widths of its 95 % interval")
    label = f"Parameters over time, {_count_text(changes)}"
    return (
        heat_map("parameters", label, names, dates, signed_place(sizes[columns].T, most), scale, lines=lines,
                 height=_ROW),
    )  # fmt: skip


def _difference_picture(changes: Changes, unit: Unit, called: str) -> doc.Picture:
    """Draw the differences between two calibrations of the parameters of one unit, with 95 % intervals."""
    rows = [i for i, each in enumerate(changes.parameters) if each.unit_of_change == unit]
    names, changed = [changes.estimates[0].names[i] for i in rows], _changed_names(changes)
    sizes, halves = (np.asarray(unit.of(values[1, rows])) for values in (changes.shifts, changes.half_widths))
    drawn = Intervals("", sizes, halves, np.array([name in changed for name in names]))
    label = f"Differences of the second calibration from the first, {unit.name}, with 95 % intervals"
    return interval_chart(called, label, names, [drawn], f"difference, {unit.name}")


def _over_time_pictures(changes: Changes) -> tuple[doc.Picture, ...]:
    """Draw each parameter that changed, over time with its intervals; none of two calibrations or without days."""
    if len(changes.dated) < 3 or any(each.on is None for each in changes.dated):
        return ()
    names = changes.estimates[0].names
    own = [names.index(name) for name in _changed_names(changes) if name in names][:_MOST_PICTURES]
    return tuple(_over_time(changes, at, f"moved-{i + 1}") for i, at in enumerate(own))


def _over_time(changes: Changes, at: int, called: str) -> doc.Picture:
    name, unit = changes.estimates[0].names[at], changes.parameters[at].unit_of_change
    shifts, halves = unit.of(changes.shifts[:, at]), unit.of(changes.half_widths[:, at])
    dates = [each.on for each in changes.dated if each.on is not None]
    days = [each.toordinal() for each in dates]
    low, high = float((shifts - halves).min()), float((shifts + halves).max())
    room = 0.1 * (high - low)

    def draw(axes: Axes) -> None:
        _mark_changes(axes, changes, low - room, high + room)
        axes.axhline(0, color=INK, linewidth=0.8)
        axes.vlines(days, shifts - halves, shifts + halves, color=INK, linewidth=1.6)
        axes.plot(days, shifts, "o", color=INK, markersize=5)
        axes.set(ylabel=f"{name}, {unit.name}", ylim=(low - room, high + room))
        date_axis(axes, dates[0], dates[-1])

    label = f"{name} over time: {shifts[-1]:.3g} {unit.name} from the first calibration"
    return axes_picture(called, label, (3.8, 2.2), draw, (0.75, 0.35, 0.1, 0.25))


def _differences(changes: Changes) -> doc.Table:
    """Tabulate the differences between two calibrations, what changed first."""
    names, moved = changes.estimates[0].names, _changed_names(changes)
    order = sorted(range(len(names)), key=lambda i: names[i] not in moved)
    rows = tuple(
        (
            doc.Code(names[i]),
            parameter_text(names[i]).partition(" (")[0],
            *_size(changes.parameters[i].unit_of_change, changes.shifts[-1, i], changes.half_widths[-1, i]),
        )
        for i in order
    )
    columns = ("parameter", doc.Column("what", doc.PAGE), "difference", "95 %", "unit")
    kinds = tuple("" if names[i] in moved else "quiet" for i in order)
    return doc.Table(columns, rows, "Differences of the second calibration from the first", kinds, folded=True)


def _size(unit: Unit, size: float, half: float) -> tuple[str, str, str]:
    """Return a difference, half of its 95 % interval, and the unit."""
    digits = digits_of(unit.of(half), _MOST_DIGITS)
    return fixed(unit.of(size), digits, signed=True), plus_minus(unit.of(half), digits), unit.name


def _checks(arm: ArmHistory) -> doc.Table:
    rows = tuple(
        (
            "–" if each.on is None else each.on.isoformat(),
            "calibration" if each.calibrates else "verification",
            doc.Code(each.folder.name),
            each.verdict,
            "–" if each.gate_mm is None else f"{each.gate_mm:g}",
            short(each.error_mm),
            short(each.p95_mm),
        )
        for each in arm.checks
    )
    caption = "Errors at positions that were not fitted, and the gate of their mean, mm"
    return doc.Table(("date", "what", "run", "verdict", "gate", "mean", "95 %"), rows, caption)


@doc.guarded
def _detectable(result: HistoryResult, changes: Changes) -> tuple[doc.Block, ...]:
    rows = tuple(
        (f"joint {i + 1}", "–" if np.isinf(size) else short(MM.of(size)), unit.name)
        for i, (size, unit) in enumerate(zip(changes.detectable, changes.joint_units, strict=True))
    )
    hidden = any(np.isinf(size) for size in changes.detectable) and set(result.options.kept) != {"base", "tool"}
    note = (
        "A dash: the zero cannot be separated from the setup of base and tool. If instrument, base and tool stay in "
        "place between the calibrations, --kept base,tool compares them as well."
    )
    caption = "Change of a joint's zero that the next calibration detects in 95 of 100 cases"
    return doc.Table(("", "by", "unit"), rows, caption), doc.Paragraph(note if hidden else "", "note")
