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
from lab.commands.trend import DatedRun, TrendResult, change_text, content_of, followed
from lab.core.errors import LabError, counted
from lab.core.limits import called, day
from lab.core.linear_model import half_width_95
from lab.core.whole_folder import CHECKSUMS, file_digest, is_being_written, place_of_draft
from lab.formats.csv_table import write_columns
from lab.formats.structured import read_structured
from lab.render import document as doc
from lab.render.charts.chart import axes_picture
from lab.render.charts.marks import Axes
from lab.render.document import digits_of, fixed, plus_minus, short
from lab.render.style import GRID, INK, MEASURED, MUTED, RMS, WORST
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
    """The state of every arm of a folder of runs on a day."""

    command = "status"
    shown_by = "lab.commands.status:_status_document"
    drawn_by = "lab.commands.status:_checks_picture"

    options: StatusOptions
    on: date  # the day
    arms: tuple[_ArmStatus, ...]  # the worst first
    left_out: tuple[_LeftOut, ...]  # runs that could not be used, and why not

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
_MONTHS = (1, 2, 3, 6, 12, 24, 60, 120)  # between ticks
_MOST_TICKS = 8


def _checks_picture(result: StatusResult) -> doc.Picture:
    """Draw a row for each arm, the worst on top: a mark for each check, a stroke for each calibration."""
    arms = result.arms
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
        first = min((each.on for each, _ in days if each.on is not None), default=result.on)
        ticks = _ticks(first, result.on)
        axes.set_xticks([each.toordinal() for each in ticks], [f"{each:%Y-%m}" for each in ticks])
        names = [arm.called for arm in reversed(arms)]
        axes.set_yticks(range(len(arms)), [n if len(n) <= _MOST_NAME else f"{n[:_MOST_NAME]}…" for n in names])
        span = max(30, result.on.toordinal() - first.toordinal())
        left, right = first.toordinal() - 0.03 * span, result.on.toordinal() + 0.03 * span
        axes.set(xlim=(left, right), ylim=(-0.7, len(arms) + 0.6))
        axes.grid(visible=False)
        axes.legend(loc="upper left", ncols=5)

    label = f"Calibrations and verifications of {len(arms)} arms up to {result.on}, by verdict"
    widest = max((min(len(arm.called), _MOST_NAME) for arm in arms), default=0)
    return axes_picture("checks", label, (7.2, 1.1 + _ROW * len(arms)), draw, (0.35 + 0.075 * widest, 0.45, 0.2, 0.15))


def _ticks(first: date, last: date) -> list[date]:
    months = [first.year * 12 + first.month - 1, last.year * 12 + last.month - 1]
    step = next((each for each in _MONTHS if (months[1] - months[0]) / each < _MOST_TICKS), _MONTHS[-1])
    start = -(-(months[0]) // step) * step
    return [date(at // 12, at % 12 + 1, 1) for at in range(start, months[1] + 1, step)]


_KINDS: Mapping[str, Literal["good", "doubtful", "bad", "open"]] = {
    "good": "good",
    "due": "doubtful",
    "doubtful": "doubtful",
    "bad": "bad",
}
_MOST_DIGITS = 6


def _status_document(result: StatusResult) -> doc.Document:
    """The count of each state, a row for each arm, the checks over time, changes, and what was left out."""
    counts = Counter(each.state for each in result.arms)
    text = ", ".join(f"{counts[state]} {state}" for state in reversed(STATES) if counts[state])
    lead = tuple(_badges(counts))
    caption = f"Every check of every arm: strokes are calibrations, marks are verdicts. The dotted line is {result.on}."
    return doc.Document(
        f"{counted(len(result.arms), 'arm')} on {result.on}: {text}" if result.arms else "no arm",
        (
            doc.Paragraph(lead, "lead"),
            doc.Warnings(result.warnings),
            doc.Section("The arms", (_arms(result), doc.Paragraph(_explained(result), "note", shown_in=doc.PAGE))),
            doc.Section("The checks over time", (doc.Figure("checks", (_checks_picture(result),), caption),)),
            doc.Section("Changes between calibrations", (doc.Bullets(tuple(_changes(each) for each in result.arms)),)),
        ),
    )


def _badges(counts: Mapping[str, int]) -> list[doc.Inline]:
    parts: list[doc.Inline] = []
    for state in reversed(STATES):
        if counts.get(state):
            parts += [doc.Badge(f"{counts[state]} {state}", _KINDS.get(state, "open")), " "]
    return parts


def _arms(result: StatusResult) -> doc.Table:
    on_page = ("verdict", "error then", "slope, mm a year")  # a terminal has no room for these
    headings = (
        "state", "arm", "calibrated", "verdict", "verified", "verdict", "error then", "error now", "slope, mm a year",
        "next due",
    )  # fmt: skip
    columns = tuple(doc.Column(each, doc.PAGE if each in on_page else doc.EVERYWHERE) for each in headings)
    return doc.Table(columns, tuple(_row(each) for each in result.arms), "Mean position errors, mm", most_rows=200)


def _row(arm: _ArmStatus) -> doc.Row:
    slope = arm.slope
    text = "–"
    if slope is not None:
        digits = digits_of(slope.half_width, _MOST_DIGITS)
        text = f"{fixed(slope.per_year, digits, signed=True)} {plus_minus(slope.half_width, digits)}"
    return (
        doc.Badge(arm.state, _KINDS.get(arm.state, "open")),
        doc.Code(arm.called),
        *_checked(arm.calibration),
        *_checked(arm.verification),
        short(arm.error_then_mm),
        short(arm.error_now_mm),
        text,
        "–" if arm.due is None else arm.due.isoformat(),
    )


def _checked(check: Check | None) -> tuple[doc.Text, doc.Text]:
    if check is None or check.on is None:
        return "–", "–"
    return check.on.isoformat(), check.verdict


def _explained(result: StatusResult) -> str:
    return (
        "The state is the verdict of the last verification of the last calibration, or of the calibration itself. "
        f"An arm is due {counted(result.options.every_days, 'day')} after its last check, a bad one at once. Error "
        "then: at validation of the last calibration; now: at its last verification. The slope needs "
        f"{_FEWEST_CHECKS} verifications of one calibration; its interval is 95 %."
    )


def _changes(arm: _ArmStatus) -> doc.Text:
    if arm.trend is None:
        return ""
    if not arm.trend.changes:
        return f"{arm.called}: no change in {len(arm.trend.runs)} calibrations."
    count, change = len(arm.trend.changes), change_text(arm.trend, arm.trend.changes[-1])
    earlier = "" if count == 1 else f" The last of {count} changes in {len(arm.trend.runs)} calibrations (lab trend)."
    return f"{arm.called}: {change}{earlier}"


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
    arms.sort(key=lambda each: -STATES.index(each.state))
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
