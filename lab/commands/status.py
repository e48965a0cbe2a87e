"""Report the state of every arm of a folder of runs, on a day."""

import os
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, date, datetime, timedelta
from functools import cached_property
from hashlib import sha256
from pathlib import Path
from typing import Any, Literal, NamedTuple

import numpy as np

from lab.campaign.config_file import CONFIG_FILE, read_config
from lab.commands.calibrate.load_run import CALIBRATIONS, READ_FILES, load_run
from lab.commands.command_line import options_of, takes
from lab.commands.options import StatusOptions, TrendOptions
from lab.commands.result import Result
from lab.commands.run_folder import check_edits
from lab.commands.trend import DatedRun, TrendResult, change_rows, content_of, followed
from lab.core.errors import LabError, be, counted
from lab.core.limits import called, day
from lab.core.linear_model import half_width_95
from lab.core.whole_folder import CHECKSUMS, file_digest, is_being_written, place_of_draft
from lab.formats.csv_table import write_columns
from lab.formats.structured import read_structured
from lab.render import document as doc
from lab.render.charts.chart import axes_picture, log_ticks
from lab.render.charts.marks import Axes
from lab.render.comparison_plots import date_axis
from lab.render.document import capital, digits_of, fixed, plus_minus, short
from lab.render.style import GATE, GRID, INK, MEASURED, MUTED, RMS, WORST
from lab.render.terminal import status as showing

__all__ = ["STATES", "Check", "StatusResult", "status"]

_RESULT = "result.json"
_MEND = "repeat the run, or remove it"


@dataclass(frozen=True)
class Check:
    """A calibration or a verification of an arm."""

    folder: Path
    robot: str
    serial: str | None
    calibrates: bool  # whether it is a calibration
    on: date | None  # the day of its measurements; None where the run names none
    verdict: str  # good, doubtful, bad or not judged
    error_mm: float | None  # the mean error at poses that were not fitted; None where there are none
    of: str | None  # the digest of the calibration's result.json; None of a verification of a result in memory
    model_sha256: str  # of the robot's files
    gate_mm: float | None = None  # of a calibration: the largest mean error that was accepted


class _LeftOut(NamedTuple):
    """A run that cannot be used, and why not."""

    folder: Path
    reason: str


@dataclass(frozen=True)
class _Summary:
    """Summary of ``result.json`` of a calibration or a verification; its keys."""

    robot: str
    serial: str | None = None
    verdict: Literal["good", "doubtful", "bad", "not judged"] | None = None
    good: bool | None = None
    after_mm: Mapping[str, float] | None = None
    observed_mm: Mapping[str, float] | None = None
    gate_mm: float | None = None


def _checks_of(folder: Path) -> tuple[tuple[Check, ...], tuple[_LeftOut, ...]]:
    """Read every calibration and verification below a folder; a run that cannot be used is listed with the reason."""
    if not folder.is_dir():
        raise LabError(f"{folder}: is no folder; give the folder that contains the runs")
    found, left_out = list[Check](), list[_LeftOut]()
    for run in _runs(folder, left_out):
        try:
            check = _check(run)
        except LabError as error:
            left_out.append(_LeftOut(run, _reason_of(error, run)))
            continue
        found += [] if check is None else [check]
    return tuple(found), tuple(left_out)


def _reason_of(error: LabError, run: Path) -> str:
    """Return what is wrong with a run, without its folder, and without the options of other commands that mend it."""
    return str(error).removeprefix(f"{run}: ").partition("; ")[0]


def _runs(folder: Path, left_out: list[_LeftOut]) -> Iterator[Path]:
    """The folders of runs, without those inside of runs; what a killed process left goes to ``left_out``."""
    for name, inside, files in os.walk(folder):
        here = Path(name)
        if {CONFIG_FILE, CHECKSUMS} & set(files):
            inside.clear()  # copies of the runs that it was made from
            yield here
            continue
        inside.sort()
        for draft in list(inside):
            if (place := place_of_draft(here / draft)) is None:
                continue
            inside.remove(draft)
            if not is_being_written(place):
                left_out.append(_LeftOut(here / draft, f"is an incomplete copy of the run {place.name}"))
        inside[:] = [each for each in inside if not each.startswith(".")]


def _check(folder: Path) -> Check | None:
    """The summary of a run; None of a run of another command."""
    config = read_config(folder, _MEND)
    if config.command not in (*CALIBRATIONS, "verify"):
        return None
    check_edits(folder, READ_FILES, accept=False)
    found = read_structured(folder / _RESULT, _Summary, _MEND)
    calibrates = config.command in CALIBRATIONS
    verdict = found.verdict or (None if found.good is None else "good" if found.good else "bad")
    if verdict is None:
        raise LabError(f"{_RESULT} has no verdict; {_MEND}")
    errors, given = found.after_mm if calibrates else found.observed_mm, config.options.get("date")
    return Check(
        folder,
        found.robot,
        found.serial,
        calibrates,
        None if given is None else day(f"{folder}/{CONFIG_FILE}: date", str(given)),
        verdict,
        None if errors is None else errors.get("mean"),
        file_digest(folder / _RESULT) if calibrates else config.inputs_sha256.get(str(config.options.get("run"))),
        config.model_sha256,
        found.gate_mm,
    )


STATES = ("good", "due", "unknown", "never calibrated", "doubtful", "bad")  # by severity; the number is the metric's
_FEWEST_CHECKS = 4  # verifications from which a slope is estimated
_YEAR = 365.25  # days


class _Slope(NamedTuple):
    per_year: float  # of the mean error over the verifications of the current calibration, mm
    half_width: float  # of its 95 % interval, by the scatter about the line
    verifications: int


@dataclass(frozen=True)
class _ArmStatus:
    """An arm on a day."""

    robot: str
    serial: str | None  # its serial number; None where its runs name none
    checks: tuple[Check, ...]  # its calibrations and verifications up to the day, in order; those without a day first
    on: date  # the day
    every_days: int  # after how many days without a check it is due
    trend: TrendResult | None = None  # of its calibrations; None where fewer than two can be compared

    @property
    def called(self) -> str:
        """The arm as a person names it."""
        return called(self.robot, self.serial)

    @cached_property
    def calibration(self) -> Check | None:
        """The last calibration of a known day."""
        return next((each for each in reversed(self.checks) if each.calibrates and each.on is not None), None)

    @cached_property
    def verifications(self) -> tuple[Check, ...]:
        """The verifications of the last calibration, in order: by its digest, else those of later days."""
        last = self.calibration
        if last is None or last.on is None:
            return ()
        calibrations = {each.of for each in self.checks if each.calibrates}
        own = [each for each in self.checks if not each.calibrates and each.on is not None]
        return tuple(
            each
            for each in own
            if each.of == last.of or (each.of not in calibrations and each.on and each.on > last.on)
        )

    @property
    def verification(self) -> Check | None:
        """The last verification of any calibration."""
        return next((each for each in reversed(self.checks) if not each.calibrates and each.on is not None), None)

    @property
    def latest(self) -> Check | None:
        """The check that the state rests on: the last verification of the last calibration, or that itself."""
        return self.verifications[-1] if self.verifications else self.calibration

    @property
    def due(self) -> date | None:
        """The last day for the next check, of a bad arm that on which it was found; None where there was none."""
        if self.latest is None or self.latest.on is None:
            return None
        return self.latest.on + timedelta(0 if self.latest.verdict == "bad" else self.every_days)

    @property
    def state(self) -> str:
        """State of the arm, one of ``STATES``."""
        if not any(each.calibrates for each in self.checks):
            return "never calibrated"
        if self.latest is None or self.latest.verdict == "not judged":
            return "unknown"
        if self.latest.verdict != "good":
            return self.latest.verdict
        return "due" if self.due is not None and self.on > self.due else "good"

    @property
    def error_then_mm(self) -> float | None:
        """The mean error of the last calibration at poses that were not fitted."""
        return None if self.calibration is None else self.calibration.error_mm

    @property
    def error_now_mm(self) -> float | None:
        """The mean error of the last verification of that calibration."""
        return self.verifications[-1].error_mm if self.verifications else None

    @property
    def gate_mm(self) -> float | None:
        """The gate of the last calibration."""
        return None if self.calibration is None else self.calibration.gate_mm

    @property
    def to_do(self) -> str:
        """What is to be done with the arm, and when."""
        if self.due is None:
            return "calibrate" if self.state == "never calibrated" else "calibrate, with --date"
        late = (self.on - self.due).days
        return {
            "good": f"verify by {self.due}",
            "due": f"verify: {counted(late, 'day')} late",
            "doubtful": "see the reasons of its last run",
            "bad": "calibrate again",
            "unknown": "validate its calibration",
        }[self.state]

    @cached_property
    def slope(self) -> _Slope | None:
        """The slope of the error since the last calibration; None of fewer than four verifications."""
        points = [(each.on.toordinal() / _YEAR, each.error_mm) for each in self.verifications if each.on is not None]
        return _slope([(at, error) for at, error in points if error is not None])


def _slope(points: Sequence[tuple[float, float]]) -> _Slope | None:
    """Fit a line by least squares to errors (mm) over time (years)."""
    if len(points) < _FEWEST_CHECKS:
        return None
    at, errors = np.array(points).T
    apart = at - at.mean()
    square = float(apart @ apart)
    if square == 0:
        return None
    slope = float(apart @ errors) / square
    left = errors - errors.mean() - slope * apart
    dof = len(points) - 2
    std = float(np.sqrt(left @ left / dof / square))
    return _Slope(slope, float(half_width_95(float(dof))) * std, len(points))


@dataclass(frozen=True, repr=False, eq=False)
class StatusResult(Result):
    """The state of every arm of a folder of runs on a date.

    Attributes:
        on: the date.
        arms: the worst first.
        left_out: runs that could not be used, and why not.
    """

    command = "status"
    shown_by = "lab.commands.status:_status_document"
    drawn_by = "lab.commands.status:_checks_picture"

    options: StatusOptions
    on: date
    arms: tuple[_ArmStatus, ...]
    left_out: tuple[_LeftOut, ...]

    @property
    def warnings(self) -> tuple[str, ...]:
        """The runs that could not be used."""
        return tuple(f"{each.folder}: left out: {each.reason}" for each in self.left_out)

    @property
    def exit_code(self) -> int:
        """1 where an arm is bad; 3 where all are to be good and one is not; else 0."""
        states = {each.state for each in self.arms}
        if "bad" in states:
            return 1
        return 3 if self.options.require and states != {"good"} else 0

    @property
    def model_sha256(self) -> str:
        """The digest of the digests of all robots' files."""
        models = sorted({check.model_sha256 for arm in self.arms for check in arm.checks})
        return sha256("".join(models).encode()).hexdigest()

    def to_dict(self) -> dict[str, Any]:
        """Return the values that ``--json`` prints and ``result.json`` holds: days as YYYY-MM-DD, errors in mm."""
        return {
            "folder": str(self.options.folder),
            "on": self.on.isoformat(),
            "every_days": self.options.every_days,
            "arms": [_arm(each) for each in self.arms],
            "left_out": [{"run": str(each.folder), "reason": each.reason} for each in self.left_out],
            "warnings": list(self.warnings),
        }

    def write_files(self, folder: Path) -> None:
        """Write ``status.csv`` and ``status.prom``."""
        write_columns(folder / "status.csv", {name: [*map(str, each)] for name, each in self.columns().items()})
        (folder / "status.prom").write_text(_exposition(self.arms, len(self.left_out)), encoding="utf-8")

    def columns(self) -> Mapping[str, Sequence[Any]]:
        """A row for each arm, as ``status.csv`` has it; empty where nothing is known."""
        rows = [_arm(each) for each in self.arms]
        flat = [
            {
                "serial": row["serial"],
                "robot": row["robot"],
                "state": row["state"],
                **{
                    f"last_{kind}_{key}": None if row[f"last_{kind}"] is None else row[f"last_{kind}"][key]
                    for kind in ("calibration", "verification")
                    for key in ("date", "verdict")
                },
                "error_then_mm": row["error_then_mm"],
                "error_now_mm": row["error_now_mm"],
                "slope_mm_per_year": None if row["slope"] is None else row["slope"]["mm_per_year"],
                "slope_half_width_95": None if row["slope"] is None else row["slope"]["half_width_95"],
                "calibrations": row["calibrations"],
                "verifications": row["verifications"],
                "changes": None if row["changes"] is None else len(row["changes"]),
                "next_due": row["next_due"],
            }
            for row in rows
        ]
        return {name: ["" if row[name] is None else row[name] for row in flat] for name in (flat or [{}])[0]}


def _arm(arm: _ArmStatus) -> dict[str, Any]:
    slope, trend = arm.slope, arm.trend
    return {
        "serial": arm.serial,
        "robot": arm.robot,
        "state": arm.state,
        "last_calibration": _check_to_dict(arm.calibration),
        "last_verification": _check_to_dict(arm.verification),
        "error_then_mm": arm.error_then_mm,
        "error_now_mm": arm.error_now_mm,
        "slope": None
        if slope is None
        else {"mm_per_year": slope.per_year, "half_width_95": slope.half_width, "verifications": slope.verifications},
        "calibrations": sum(each.calibrates for each in arm.checks),
        "verifications": sum(not each.calibrates for each in arm.checks),
        "changes": None if trend is None else trend.to_dict()["changes"],
        "next_due": None if arm.due is None else arm.due.isoformat(),
    }


def _check_to_dict(check: Check | None) -> dict[str, Any] | None:
    if check is None:
        return None
    on = None if check.on is None else check.on.isoformat()
    return {"run": str(check.folder), "date": on, "verdict": check.verdict, "error_mm": check.error_mm}


_MARKS = {
    "good": (RMS, "o"),
    "doubtful": (MEASURED, "^"),
    "bad": (WORST, "D"),
    "not judged": (MUTED, "s"),
}  # by verdict: they differ without colour, too
_ROW, _MOST_NAME = 0.24, 26  # inches of an arm; characters of its name
_MOST_DRAWN = 12  # arms on the card
_NAMED = 3  # arms that a sentence names
_MOST_OPEN, _MOST_CHECKED = 15, 40  # arms in the open table; in the picture of checks


def _checks_picture(result: StatusResult) -> doc.Picture:
    """Draw a row for each arm, the worst on top: a mark for each check, a stroke for each calibration."""
    arms = result.arms[:_MOST_CHECKED]
    days = [(each, len(arms) - 1 - i) for i, arm in enumerate(arms) for each in arm.checks if each.on is not None]

    def draw(axes: Axes) -> None:
        for row in range(len(arms)):
            axes.axhline(row, color=GRID, linewidth=0.8)
        strokes = [(each.on.toordinal(), row) for each, row in days if each.on is not None and each.calibrates]
        if strokes:
            at, rows = zip(*strokes, strict=True)
            axes.plot(at, rows, "|", color=INK, markersize=15, label="calibration")
        for verdict, (colour, mark) in _MARKS.items():
            own = [(each.on.toordinal(), row) for each, row in days if each.on is not None and each.verdict == verdict]
            if own:
                at, rows = zip(*own, strict=True)
                axes.plot(at, rows, mark, color=colour, markersize=5, label=verdict)
        axes.axvline(result.on.toordinal(), color=MUTED, linewidth=1, linestyle=":")
        date_axis(axes, min((each.on for each, _ in days if each.on is not None), default=result.on), result.on)
        axes.set_yticks(range(len(arms)), _names(reversed(arms)))
        axes.set(ylim=(-0.7, len(arms) + 0.6))
        axes.grid(visible=False)
        axes.legend(loc="upper left", ncols=5)

    label = f"Calibrations and verifications of {len(arms)} arms up to {result.on}, by verdict"
    return axes_picture("checks", label, (7.2, 1.1 + _ROW * len(arms)), draw, (_beside(arms), 0.45, 0.2, 0.15))


def _names(arms: Iterable[_ArmStatus]) -> list[str]:
    names = (arm.called for arm in arms)
    return [name if len(name) <= _MOST_NAME else f"{name[:_MOST_NAME]}…" for name in names]


def _beside(arms: Iterable[_ArmStatus]) -> float:
    """Inches that the names of arms need beside a picture."""
    return 0.35 + 0.075 * max(map(len, _names(arms)), default=0)


def _errors_picture(result: StatusResult) -> tuple[doc.Picture, ...]:
    """Draw the error of each arm at its calibration and at its last verification, with its gate; the worst on top."""
    known = [arm for arm in result.arms if arm.error_then_mm or arm.error_now_mm][:_MOST_DRAWN]
    sizes = [
        size
        for arm in known
        for size in (arm.error_then_mm, arm.error_now_mm, arm.gate_mm)
        if size is not None and size
    ]
    if not known:
        return ()
    at = np.arange(len(known))[::-1]

    def draw(axes: Axes) -> None:
        log_ticks(axes, "x", min(sizes) / 1.5, max(sizes) * 1.5)
        for row, arm in zip(at.tolist(), known, strict=True):
            then, now = arm.error_then_mm, arm.error_now_mm
            if then and now:
                axes.hlines([row], min(then, now), max(then, now), colors=MUTED, linewidth=1.2)
            if then:
                axes.plot([then], [row], "|", color=MUTED, markersize=10)
            colour, mark = _MARKS[arm.latest.verdict if arm.latest is not None else "not judged"]
            axes.plot([now or then or np.nan], [row], mark, color=colour, markersize=7)
        gates = [(arm.gate_mm, row) for row, arm in zip(at.tolist(), known, strict=True) if arm.gate_mm]
        for gate, row in gates:
            axes.vlines([gate], row - 0.5, row + 0.5, colors=GATE, linewidth=1.6)
        if gates:
            axes.annotate("gate", (gates[0][0], gates[0][1] + 0.55), color=GATE, ha="center")
        axes.set_yticks(at, _names(known))
        axes.set(ylim=(-0.6, len(known) - 0.1), xlabel="mean error now, mm (logarithmic)")
        axes.grid(visible=False, axis="y")

    label = f"Mean error of {counted(len(known), 'arm')} at the last check, against the gate"
    size = (3.8, 0.85 + _ROW * len(known))
    return (axes_picture("errors-now", label, size, draw, (_beside(known), 0.5, 0.15, 0.1)),)


_KINDS: Mapping[str, Literal["good", "doubtful", "bad", "open"]] = {
    "good": "good",
    "due": "doubtful",
    "doubtful": "doubtful",
    "bad": "bad",
}
_MOST_DIGITS = 6
_MOST_ARMS = 200  # listed beyond these
_CHANGES = ("arm", "calibrations", "last change between", "and", "what changed", "by", "95 %", "unit")


def _status_document(result: StatusResult) -> doc.Document:
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
            doc.Section("The checks over time", (doc.Figure("checks", (_checks_picture(result),), caption),)),
        ),
    )


def _card(result: StatusResult, counts: Mapping[str, int]) -> doc.Card:
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
    return doc.Card(
        tuple(_badges(counts)), tuple(numbers), about, _next_step(result), (figure,) * bool(figure.pictures)
    )


def _next_step(result: StatusResult) -> str:
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
            parts += [doc.Badge(f"{counts[state]} {state}", _KINDS.get(state, "open")), " "]
    return parts


def _arms(result: StatusResult) -> tuple[doc.Table, ...]:
    """Tabulate the arms, those that need attention first; of many, the rest is folded."""
    on_page = ("error, gate dashed", "error then", "slope, mm a year")  # a terminal has no room for these
    headings = (
        "state", "arm", "error, gate dashed", "error now", "gate", "error then", "slope, mm a year", "calibrated",
        "verified", "to do",
    )  # fmt: skip
    columns = tuple(doc.Column(each, doc.PAGE if each in on_page else doc.EVERYWHERE) for each in headings)
    rows = tuple(_row(arm, line) for arm, line in zip(result.arms, _sparklines(result), strict=True))
    if not any(arm.slope for arm in result.arms):
        at = headings.index("slope, mm a year")
        columns, rows = columns[:at] + columns[at + 1 :], tuple(row[:at] + row[at + 1 :] for row in rows)
    rest = rows[_MOST_OPEN:]
    return (
        doc.Table(columns, rows[:_MOST_OPEN], "What needs attention first. Mean position errors, mm"),
        doc.Table(columns, rest, f"{counted(len(rest), 'more arm')}", most_rows=_MOST_ARMS, folded=True),
    )


def _row(arm: _ArmStatus, line: doc.Text) -> doc.Row:
    slope = arm.slope
    text = "–"
    if slope is not None:
        digits = digits_of(slope.half_width, _MOST_DIGITS)
        text = f"{fixed(slope.per_year, digits, signed=True)} {plus_minus(slope.half_width, digits)}"
    return (
        doc.Badge(arm.state, _KINDS.get(arm.state, "open")),
        doc.Code(arm.called),
        line,
        short(arm.error_now_mm),
        "–" if arm.gate_mm is None else f"{arm.gate_mm:g}",
        short(arm.error_then_mm),
        text,
        _checked(arm.calibration),
        _checked(arm.verification),
        arm.to_do,
    )


def _checked(check: Check | None) -> str:
    """Return the day of a check, with its verdict where that is not good."""
    if check is None or check.on is None:
        return "–"
    return f"{check.on}" if check.verdict == "good" else f"{check.on} {check.verdict}"


def _sparklines(result: StatusResult) -> list[doc.Text]:
    """Return the errors of each arm over time, all on one scale of the error over the gate; a dash for none."""
    dated = [
        [(each.on, each.error_mm, each.verdict) for each in arm.checks if each.on is not None and each.error_mm]
        for arm in result.arms
    ]
    days = [on for own in dated for on, _, _ in own]
    first, span = min(days, default=result.on), max((result.on - min(days, default=result.on)).days, 1)
    gates = [
        arm.gate_mm or max((size for _, size, _ in own), default=1.0)
        for arm, own in zip(result.arms, dated, strict=True)
    ]
    ratios = [np.log(size / gate) for own, gate in zip(dated, gates, strict=True) for _, size, _ in own]
    low, high = min([*ratios, -1.0]), max([*ratios, 0.5])
    lines = list[doc.Text]()
    for arm, own, gate in zip(result.arms, dated, gates, strict=True):
        if not own:
            lines.append("–")
            continue
        points = tuple(
            ((on - first).days / span, float((np.log(size / gate) - low) / (high - low))) for on, size, _ in own
        )
        ends = f"{short(own[0][1], 'mm')} on {own[0][0]}, {short(own[-1][1], 'mm')} on {own[-1][0]}"
        limit = None if arm.gate_mm is None else float(-low / (high - low))
        beside = "" if arm.gate_mm is None else f"; gate {arm.gate_mm:g} mm"
        lines.append(doc.Sparkline(points, limit, f"Error: {ends}{beside}", _KINDS.get(own[-1][2], "open")))
    return lines


def _explained(result: StatusResult) -> str:
    return (
        "The state is the verdict of the last verification of the last calibration, or of the calibration itself. "
        f"An arm is due {counted(result.options.every_days, 'day')} after its last check, a bad one at once. The "
        "curves are logarithmic, with one scale relative to the gate (dashed). Error then: at validation of the last "
        f"calibration; now: at its last verification. The slope needs {_FEWEST_CHECKS} verifications of one "
        "calibration; its interval is 95 %."
    )


def _changes(arm: _ArmStatus) -> list[doc.Row]:
    """Return a row for an arm that was calibrated more than once: its last change."""
    if arm.trend is None:
        return []
    name, count = arm.called, f"{len(arm.trend.runs)}"
    if not arm.trend.changes:
        return [(name, count, "–", "–", "nothing", "", "", "")]
    first, *more = (row[: len(_CHANGES) - 2] for row in change_rows(arm.trend, arm.trend.changes[-1]))
    return [(name, count, *first), *(("", "", *row) for row in more)]


_STATES = ", ".join(f"{i} {word}" for i, word in enumerate(STATES))
_ESCAPES = str.maketrans({"\\": r"\\", '"': r"\"", "\n": r"\n"})


def _exposition(arms: Sequence[_ArmStatus], left_out: int) -> str:
    """Return the text that a scraper reads: a family for each quantity, a line for each arm that has it.

    Days are the seconds of their first moment, UTC.
    """
    errors = [each.error_then_mm if each.error_now_mm is None else each.error_now_mm for each in arms]
    families = (
        ("lab_arm_state", f"State of the arm: {_STATES}.", [STATES.index(each.state) for each in arms]),
        ("lab_arm_error_mm", "Mean position error at the last check, mm.", errors),
        (
            "lab_arm_last_calibration_timestamp_seconds",
            "Date of the last calibration.",
            [None if each.calibration is None else _seconds(each.calibration.on) for each in arms],
        ),
        ("lab_arm_due_timestamp_seconds", "Latest date of the next check.", [_seconds(each.due) for each in arms]),
    )
    lines = list[str]()
    for name, text, values in families:
        lines += [f"# HELP {name} {text}", f"# TYPE {name} gauge"]
        for arm, value in zip(arms, values, strict=True):
            serial, robot = ((each or "").translate(_ESCAPES) for each in (arm.serial, arm.robot))
            lines += [] if value is None else [f'{name}{{serial="{serial}",robot="{robot}"}} {value!r}']
    name, text = "lab_status_left_out_runs", "Runs in the folder that could not be read."
    lines += [f"# HELP {name} {text}", f"# TYPE {name} gauge", f"{name} {left_out}"]
    return "\n".join(lines) + "\n"


def _seconds(on: date | None) -> int | None:
    return None if on is None else int(datetime(on.year, on.month, on.day, tzinfo=UTC).timestamp())


@takes(StatusOptions)
def status(folder: str | Path | StatusOptions, **options: Any) -> StatusResult:
    """Report the state of every arm of a folder of runs: whether it is good, its last check, and the next one due.

    Args:
        folder: that holds runs of ``identify``, ``calibrate`` and ``verify``, at any depth; or all options in one
            object.
        options: those of ``lab status``, by name: ``every_days``, ``on``, ``out``.

    Returns:
        The arms by serial number and robot, and the runs that could not be used.

    Raises:
        LabError: there is no such folder, or it holds no run of an arm.

    Example:
        >>> import lab, pathlib, tempfile
        >>> runs = pathlib.Path(tempfile.mkdtemp())
        >>> result = lab.calibrate("irb120", seed=7, serial="A-17", date="2026-03-02", no_recording=True)
        >>> _ = result.save(runs / "march")
        >>> [(arm.serial, arm.state) for arm in lab.status(runs, on="2026-03-20").arms]
        [('A-17', 'good')]
    """
    requested = folder
    if not isinstance(requested, StatusOptions):
        requested = options_of("lab.status", StatusOptions, {"folder": str(folder), **options})
    requested.check()
    on = date.today() if requested.on is None else day("--on", requested.on)
    with showing("reading the runs") as stage:
        checks, left_out = _checks_of(requested.folder)
        if not checks and not left_out:
            raise LabError(
                f"{requested.folder}: contains no run of lab calibrate, lab identify or lab verify; give a folder "
                "that does"
            )
        arms, reasons = list[_ArmStatus](), list(left_out)
        groups = _by_arm(checks)
        for i, ((serial, robot), own) in enumerate(groups.items()):
            stage("following the calibrations", i, len(groups))
            own = tuple(each for each in own if each.on is None or each.on <= on)
            if own:
                arms.append(
                    _ArmStatus(robot, serial or None, own, on, requested.every_days, _trend(requested, own, reasons))
                )
    arms.sort(key=lambda each: (-STATES.index(each.state), each.due or date.min))
    result = StatusResult(requested, on, tuple(arms), tuple(dict.fromkeys(reasons)))
    if requested.out is not None:
        result.save(requested.out, overwrite=requested.overwrite)
    return result


def _by_arm(checks: Iterable[Check]) -> Mapping[tuple[str, str], tuple[Check, ...]]:
    """The checks by serial number and robot, each arm's in the order of their days."""
    found: dict[tuple[str, str], list[Check]] = {}
    for each in sorted(checks, key=lambda each: (each.serial or "", each.robot)):
        found.setdefault((each.serial or "", each.robot), []).append(each)
    return {
        arm: tuple(sorted(own, key=lambda each: (each.on or date.min, str(each.folder)))) for arm, own in found.items()
    }


def _trend(options: StatusOptions, checks: tuple[Check, ...], left_out: list[_LeftOut]) -> TrendResult | None:
    """Follow the calibrations of an arm; what cannot be read or compared goes to ``left_out``."""
    dated = [each for each in checks if each.calibrates and each.on is not None]
    if len(dated) < 2:
        return None
    runs, seen = list[DatedRun](), set[str]()
    for each in dated:
        try:
            run = load_run(each.folder)
        except LabError as error:
            left_out.append(_LeftOut(each.folder, _reason_of(error, each.folder)))
            continue
        twin = content_of(each.folder) in seen  # the same measurements, identified again
        if each.on is not None and run.result.usable and np.isfinite(run.estimate.free_covariance).all() and not twin:
            runs.append(DatedRun(each.on, run))
            seen.add(content_of(each.folder))
    if len(runs) < 2:
        return None
    try:
        return followed(TrendOptions(options.folder), runs)
    except LabError as error:
        left_out.append(_LeftOut(runs[-1].run.folder, f"is not compared with earlier calibrations: {error}"))
        return None
