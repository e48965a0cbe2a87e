"""Show the states of several arms: what needs attention first, their errors over time, and their last changes."""

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence

import numpy as np

from lab.arm_history.changes import Changes
from lab.arm_history.dated_runs import DatedRun
from lab.arm_history.history_result import FEWEST_CHECKS, STATES, ArmHistory, HistoryResult
from lab.core.errors import be, counted
from lab.core.number_text import capital, digits_of, fixed, plus_minus, short
from lab.core.se3 import Array
from lab.phrases.verification_phrases import chance_text, parameter_text
from lab.report import document as doc
from lab.report.blocks import verdict_badge
from lab.report.charts.marks import Axes
from lab.report.comparison_plots import date_axis, rows_picture
from lab.report.style import GATE, GRID, INK, MEASURED, MUTED, RMS, WORST
from lab.verification.parameter_changes import ParameterChange

__all__ = ["arms_document", "change_rows", "checks_picture", "mark_verdicts"]

_VERDICT_MARKS = {
    "good": (RMS, "o"),
    "doubtful": (MEASURED, "^"),
    "bad": (WORST, "D"),
    "not judged": (MUTED, "s"),
}  # by verdict: they differ without colour, too
_MOST_NAME = 26  # characters of an arm
_MOST_DRAWN = 12  # arms on the card
_NAMED = 3  # arms that a sentence names
_MOST_OPEN, _MOST_CHECKED = 15, 40  # arms in the open table; in the picture of checks
_MOST_DIGITS = 6
_MOST_ARMS = 200  # listed beyond these
_CHANGES = ("arm", "calibrations", "last change between", "and", "what changed", "by", "95 %", "unit")


def checks_picture(result: HistoryResult) -> doc.Picture:
    """Draw a row for each arm, the worst on top: a mark for each check, a stroke for each calibration."""
    arms = result.arms[:_MOST_CHECKED]
    dated = [(each.on, row, each) for row, arm in enumerate(arms) for each in arm.checks if each.on is not None]
    first = min((on for on, *_ in dated), default=result.on)

    def draw(axes: Axes, at: Array) -> None:
        for row in at:
            axes.axhline(row, color=GRID, linewidth=0.8)
        strokes = [(on.toordinal(), at[row]) for on, row, each in dated if each.calibrates]
        if strokes:
            axes.plot(*zip(*strokes, strict=True), "|", color=INK, markersize=15, label="calibration")
        mark_verdicts(axes, [(on.toordinal(), at[row], each.verdict) for on, row, each in dated])
        axes.axvline(result.on.toordinal(), color=MUTED, linewidth=1, linestyle=":")
        date_axis(axes, first, result.on)
        axes.set(ylim=(-0.7, len(arms) + 0.6))
        axes.grid(visible=False)
        axes.legend(loc="upper left", ncols=5)

    label = f"Calibrations and verifications of {len(arms)} arms up to {result.on}, by verdict"
    return rows_picture("checks", label, _names(arms), draw, "", width=7.2, above=0.35)


def mark_verdicts(axes: Axes, points: Sequence[tuple[float, float, str]]) -> None:
    """Draw a mark at points (x, y) by the verdict of each, with its entry in a legend."""
    for verdict, (colour, mark) in _VERDICT_MARKS.items():
        own = [(x, y) for x, y, of in points if of == verdict]
        if own:
            axes.plot(*zip(*own, strict=True), mark, color=colour, markersize=5, label=verdict)


def _names(arms: Iterable[ArmHistory]) -> list[str]:
    names = (arm.called for arm in arms)
    return [name if len(name) <= _MOST_NAME else f"{name[:_MOST_NAME]}…" for name in names]


def _errors_picture(result: HistoryResult) -> tuple[doc.Picture, ...]:
    """Draw the error of each arm at its calibration and at its last verification, with its gate; the worst on top."""
    known = [arm for arm in result.arms if arm.error_then_mm or arm.error_now_mm][:_MOST_DRAWN]
    sizes = [size for arm in known for size in (arm.error_then_mm, arm.error_now_mm, arm.gate_mm) if size]
    if not known:
        return ()

    def draw(axes: Axes, at: Array) -> None:
        gates = [(arm.gate_mm, row) for row, arm in zip(at.tolist(), known, strict=True) if arm.gate_mm]
        for row, arm in zip(at.tolist(), known, strict=True):
            _draw_error(axes, row, arm)
        if gates:
            axes.annotate("gate", (gates[0][0], gates[0][1] + 0.55), color=GATE, ha="center")

    label = f"Mean error of {counted(len(known), 'arm')} at the last check, against the gate"
    ends = min(sizes) / 1.5, max(sizes) * 1.5
    axis = "mean error now, mm (logarithmic)"
    return (rows_picture("errors-now", label, _names(known), draw, axis, ends=ends, above=0.25),)


def _draw_error(axes: Axes, row: float, arm: ArmHistory) -> None:
    """Draw the error of an arm at its calibration, and now, and its gate, in its row."""
    then, now = arm.error_then_mm, arm.error_now_mm
    if arm.gate_mm:
        axes.vlines([arm.gate_mm], row - 0.5, row + 0.5, color=GATE, linewidth=1.6)
    if then and now:
        axes.hlines([row], min(then, now), max(then, now), color=MUTED, linewidth=1.2)
    if then:
        axes.plot([then], [row], "|", color=MUTED, markersize=10)
    colour, mark = _VERDICT_MARKS[arm.latest.verdict if arm.latest is not None else "not judged"]
    axes.plot([now or then or np.nan], [row], mark, color=colour, markersize=7)


def arms_document(result: HistoryResult) -> doc.Document:
    """The count of each state, a row for each arm, the checks over time, changes, and what was left out."""
    counts = Counter(each.state for each in result.arms)
    text = ", ".join(f"{counts[state]} {state}" for state in reversed(STATES) if counts[state])
    which = "every arm" if len(result.arms) <= _MOST_CHECKED else f"the first {_MOST_CHECKED} arms"
    caption = f"Every check of {which}: strokes are calibrations, marks are verdicts. The dotted line is {result.on}."
    changes = tuple(row for each in result.arms for row in _changes(each))
    return doc.Document(
        f"{counted(len(result.arms), 'arm')} on {result.on}: {text}" if result.arms else "no arm",
        (
            *_card(result, counts).everywhere,
            doc.Warnings(result.warnings),
            doc.Section("The arms", (*_arms(result), doc.Paragraph(_explained(result), "note", shown_in=doc.PAGE))),
            doc.Section("Changes between calibrations", (doc.Table(_CHANGES, changes),)),
            doc.Section("The checks over time", (doc.Figure("checks", (checks_picture(result),), caption),)),
        ),
    )


@doc.guarded
def _card(result: HistoryResult, counts: Mapping[str, int]) -> doc.Card:
    arms = result.arms
    waiting = len(arms) - counts.get("good", 0)
    numbers = [("need attention", f"{waiting} of {len(arms)}", "")]
    now = [(size, arm.called) for arm in arms if (size := arm.error_now_mm or arm.error_then_mm) is not None]
    about = "The state is that of the last check. No error is known."
    if now:
        size, name = max(now)
        numbers.append(("largest mean error now", short(size, "mm"), ""))
        about = f"The state is that of the last check. The largest error is that of {name}."
    caption = (
        f"Mean error at the last check of {'each arm' if len(arms) <= _MOST_DRAWN else 'the first arms'}: round is "
        "good, a triangle doubtful, a diamond bad. Grey stroke: at calibration. Black line: the gate."
    )
    figure = doc.Figure("errors-now-figure", _errors_picture(result), caption)
    return doc.Card(tuple(_badges(counts)), tuple(numbers), about, _next_step(result), (figure,))


def _next_step(result: HistoryResult) -> str:
    """Name what is to be done first, by the worst states."""
    steps = {"bad": "Calibrate {} again", "doubtful": "see why {} {be} doubtful", "never calibrated": "calibrate {}",
             "unknown": "validate {}", "due": "verify {}"}  # fmt: skip
    parts = list[str]()
    for state, step in steps.items():
        names = [arm.called for arm in result.arms if arm.state == state]
        if names:
            shown = names if len(names) <= _NAMED else [*names[: _NAMED - 1], f"{len(names) - _NAMED + 1} more"]
            parts.append(step.format(" and ".join(filter(None, (", ".join(shown[:-1]), shown[-1]))), be=be(len(names))))
    if parts:
        return capital("; ".join(parts)) + "."
    dues = [arm.due for arm in result.arms if arm.due is not None]
    return f"Nothing now. The next check is due on {min(dues)}." if dues else "Nothing now."


def _badges(counts: Mapping[str, int]) -> list[doc.Inline]:
    parts: list[doc.Inline] = []
    for state in reversed(STATES):
        if counts.get(state):
            parts += [verdict_badge(state, f"{counts[state]} {state}"), " "]
    return parts


def _arms(result: HistoryResult) -> tuple[doc.Table, ...]:
    """Tabulate the arms, those that need attention first; of many, the rest is folded."""
    on_page = ("error then", "slope, mm a year")  # a terminal has no room for these
    headings = (
        "state", "arm", "error now", "gate", "error then", "slope, mm a year", "calibrated", "verified", "to do"
    )  # fmt: skip
    columns = tuple(doc.Column(each, doc.PAGE if each in on_page else doc.EVERYWHERE) for each in headings)
    rows = tuple(map(_row, result.arms))
    if not any(arm.slope for arm in result.arms):
        at = headings.index("slope, mm a year")
        columns, rows = columns[:at] + columns[at + 1 :], tuple(row[:at] + row[at + 1 :] for row in rows)
    rest = rows[_MOST_OPEN:]
    return (
        doc.Table(columns, rows[:_MOST_OPEN], "What needs attention first. Mean position errors, mm"),
        doc.Table(columns, rest, f"{counted(len(rest), 'more arm')}", most_rows=_MOST_ARMS, folded=True),
    )


def _row(arm: ArmHistory) -> doc.Row:
    slope = arm.slope
    text = "–"
    if slope is not None:
        digits = digits_of(slope.half_width, _MOST_DIGITS)
        text = f"{fixed(slope.per_year, digits, signed=True)} {plus_minus(slope.half_width, digits)}"
    return (
        verdict_badge(arm.state),
        doc.Code(arm.called),
        short(arm.error_now_mm),
        "–" if arm.gate_mm is None else f"{arm.gate_mm:g}",
        short(arm.error_then_mm),
        text,
        _checked(arm.calibration),
        _checked(arm.verification),
        arm.to_do,
    )


def _checked(check: DatedRun | None) -> str:
    """Return the day of a check, with its verdict where that is not good."""
    if check is None or check.on is None:
        return "–"
    return f"{check.on}" if check.verdict == "good" else f"{check.on} {check.verdict}"


def _explained(result: HistoryResult) -> str:
    return (
        "The state is the verdict of the last verification of the last calibration, or of the calibration itself. "
        f"An arm is due {counted(result.options.every_days, 'day')} after its last check, a bad one at once. Error "
        "then: at validation of the last calibration; now: at its last verification. The slope needs "
        f"{FEWEST_CHECKS} verifications of one calibration; its interval is 95 %."
    )


def _changes(arm: ArmHistory) -> list[doc.Row]:
    """Return a row for an arm that was calibrated more than once: its last change."""
    changes = arm.changes
    if changes is None:
        return []
    name, count = arm.called, f"{len(changes.dated)}"
    if not changes.found:
        return [(name, count, "–", "–", "nothing", "", "", "")]
    first, *more = (row[: len(_CHANGES) - 2] for row in change_rows(changes, changes.found[-1]))
    return [(name, count, *first), *(("", "", *row) for row in more)]


def change_rows(changes: Changes, change: ParameterChange) -> list[doc.Row]:
    """Return the rows of a table for a change, one for each parameter: days, what changed, by how much; when found."""
    before, after, detected = (changes.dated[i] for i in (change.after, change.after + 1, change.found_at))
    named = list[tuple[str, str, str, str]]()
    for name, size, half in zip(change.named, change.changes, change.half_widths, strict=True):
        unit = changes.unit(name)
        digits = digits_of(unit.of(half), _MOST_DIGITS)
        by = fixed(unit.of(size), digits, signed=True)
        named.append((parameter_text(name), by, plus_minus(unit.of(half), digits), unit.name))
    what, *more = named or [("the links; no single parameter", "", "", "")]
    joined = "and" if change.several else "or"
    first = (_day(before), _day(after), *what, _day(detected), chance_text(change.p))
    return [first, *(("", "", f"{joined} {name}", *by, "", "") for name, *by in more)]


def _day(run: DatedRun) -> str:
    """Return the date of a run, with its folder's name where that is another."""
    name = run.folder.name
    if run.on is None:
        return name
    return f"{run.on}" if str(run.on) == name else f"{run.on} ({name})"
