"""The history of arms: their calibrations and verifications, the changes between them, and their states on a day."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, date, datetime, timedelta
from functools import cached_property
from hashlib import sha256
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from lab.arm_history.changes import Changes
from lab.arm_history.dated_runs import DatedRun, UnusableRun
from lab.core.errors import counted
from lab.core.limits import called
from lab.core.linear_model import half_width_95
from lab.core.significance import TREND_YEAR
from lab.formats.csv_table import write_columns
from lab.library.result import Result, number
from lab.options.command_options import HistoryOptions
from lab.verification.parameter_changes import ParameterChange

__all__ = ["FEWEST_CHECKS", "STATES", "ArmHistory", "HistoryResult"]

STATES = ("good", "due", "unknown", "never calibrated", "doubtful", "bad")  # by severity; the number is the metric's
FEWEST_CHECKS = 4  # verifications from which a slope is estimated
_YEAR = 365.25  # days


class _Slope(NamedTuple):
    per_year: float  # of the mean error over the verifications of the current calibration, mm
    half_width: float  # of its 95 % interval, by the scatter about the line
    verifications: int


@dataclass(frozen=True)
class ArmHistory:
    """An arm on a day.

    Attributes:
        serial: its serial number; None where its runs name none.
        checks: its calibrations and verifications up to the day, in order; those without a day first.
        on: the day.
        every_days: after how many days without a check it is due.
        changes: between its calibrations; None where they cannot be compared.
    """

    robot: str
    serial: str | None
    checks: tuple[DatedRun, ...]
    on: date
    every_days: int
    changes: Changes | None = None

    @property
    def called(self) -> str:
        """The arm as a person names it."""
        return called(self.robot, self.serial)

    @cached_property
    def calibration(self) -> DatedRun | None:
        """The last calibration of a known day."""
        return next((each for each in reversed(self.checks) if each.calibrates and each.on is not None), None)

    @property
    def calibrated_on(self) -> date | None:
        """The day of the last calibration; None where none has a day."""
        return None if self.calibration is None else self.calibration.on

    @cached_property
    def verifications(self) -> tuple[DatedRun, ...]:
        """The verifications of the last calibration, in order: by its digest, else those of later days."""
        last, day = self.calibration, self.calibrated_on
        if last is None or day is None:
            return ()
        others = {check.of for check in self.checks if check.calibrates} - {last.of}
        dated = [(check, check.on) for check in self._dated_verifications if check.of not in others]
        return tuple(check for check, on in dated if check.of == last.of or (on is not None and on > day))

    @property
    def _dated_verifications(self) -> list[DatedRun]:
        return [check for check in self.checks if not check.calibrates and check.on is not None]

    @property
    def verification(self) -> DatedRun | None:
        """The last verification of any calibration."""
        dated = self._dated_verifications
        return dated[-1] if dated else None

    @property
    def latest(self) -> DatedRun | None:
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
        """The mean error of the last verification of that calibration that measured one."""
        return next((each.error_mm for each in reversed(self.verifications) if each.error_mm is not None), None)

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

    def to_dict(self) -> dict[str, Any]:
        """Return the values of the arm: days as YYYY-MM-DD, errors in mm, parameters in SI units."""
        slope = self.slope
        return {
            "serial": self.serial,
            "robot": self.robot,
            "state": self.state,
            "last_calibration": _check_to_dict(self.calibration),
            "last_verification": _check_to_dict(self.verification),
            "error_then_mm": self.error_then_mm,
            "error_now_mm": self.error_now_mm,
            "slope": None if slope is None else {
                "mm_per_year": slope.per_year, "half_width_95": slope.half_width, "verifications": slope.verifications
            },
            "calibrations": sum(each.calibrates for each in self.checks),
            "verifications": sum(not each.calibrates for each in self.checks),
            "next_due": None if self.due is None else self.due.isoformat(),
            **_changes_to_dict(self.changes),
        }  # fmt: skip


def _changes_to_dict(changes: Changes | None) -> dict[str, Any]:
    """Return what moved between the calibrations of an arm; None of each value where none are compared."""
    if changes is None:
        return dict.fromkeys(("compared", "changes", "parameters", "minimum_detectable_change"))
    return {
        "compared": [_check_to_dict(run) for run in changes.dated],
        "changes": [_change_to_dict(changes, change) for change in changes.found],
        "parameters": _parameters(changes),
        "minimum_detectable_change": {
            f"joint{i + 1}_{unit.key}": number(unit.of(size))
            for i, (size, unit) in enumerate(zip(changes.detectable, changes.joint_units, strict=True))
        },
    }


def _slope(points: Sequence[tuple[float, float]]) -> _Slope | None:
    """Fit a line by least squares to errors (mm) over time (years)."""
    if len(points) < FEWEST_CHECKS:
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


def _check_to_dict(check: DatedRun | None) -> dict[str, Any] | None:
    if check is None:
        return None
    on = None if check.on is None else check.on.isoformat()
    return {"run": str(check.folder), "date": on, "verdict": check.verdict, "error_mm": check.error_mm}


def _change_to_dict(changes: Changes, change: ParameterChange) -> dict[str, Any]:
    before, after, found = (changes.dated[i] for i in (change.after, change.after + 1, change.found_at))
    return {
        "between": [None if each.on is None else each.on.isoformat() for each in (before, after)],
        "runs": [str(before.folder), str(after.folder)],
        "found_by": str(found.folder),
        "named": [
            {"name": name, "change": size, "interval_95": [size - half, size + half]}
            for name, size, half in zip(change.named, change.changes, change.half_widths, strict=True)
        ],
        "several": change.several,
        "p": change.p,
        "level": change.level,
    }


def _parameters(changes: Changes) -> dict[str, Any]:
    """Differences of each parameter from the first calibration, with halves of their intervals."""
    shifts, halves = changes.shifts, changes.half_widths
    return {
        name: {"change": shifts[:, i].tolist(), "half_width_95": halves[:, i].tolist()}
        for i, name in enumerate(changes.estimates[0].names)
    }


@dataclass(frozen=True, repr=False, eq=False)
class HistoryResult(Result):
    """The history of arms, and their states on a day.

    Attributes:
        on: the day.
        arms: the worst first.
        left_out: runs that could not be used, and why not.
        given: whether the runs were given one by one, and are of one arm.
    """

    command = "history"

    options: HistoryOptions
    on: date
    arms: tuple[ArmHistory, ...]
    left_out: tuple[UnusableRun, ...]
    given: bool = False

    @property
    def warnings(self) -> tuple[str, ...]:
        """The runs that could not be used; of a single arm also the warnings of its calibrations."""
        messages = [f"{each.folder}: left out: {each.reason}" for each in self.left_out]
        if len(self.arms) == 1 and (changes := self.arms[0].changes) is not None:
            messages += [text for run in changes.runs for text in run.named_warnings]
        return tuple(dict.fromkeys(messages))

    @property
    def serial(self) -> str | None:
        """The serial number of a single arm; None of several."""
        return self.arms[0].serial if len(self.arms) == 1 else None

    @property
    def exit_code(self) -> int:
        """1 where an arm is bad, or has changed between given runs; 3 where one is not good and has to be; else 0."""
        states = {each.state for each in self.arms}
        changed = self.given and any(each.changes is not None and each.changes.found for each in self.arms)
        if "bad" in states or changed:
            return 1
        return 3 if self.options.require and states != {"good"} else 0

    @property
    def model_sha256(self) -> str:
        """The digest of the robot's files; of several robots, of their digests."""
        models = sorted({check.model_sha256 for arm in self.arms for check in arm.checks})
        return models[0] if len(models) == 1 else sha256("".join(models).encode()).hexdigest()

    def to_dict(self) -> dict[str, Any]:
        """Return the values that ``--json`` prints and ``result.json`` holds."""
        return {
            "runs": [str(each) for each in self.options.runs],
            "on": self.on.isoformat(),
            "every_days": self.options.every_days,
            "level_per_year": TREND_YEAR,
            "arms": [each.to_dict() for each in self.arms],
            "left_out": [{"run": str(each.folder), "reason": each.reason} for each in self.left_out],
            "warnings": list(self.warnings),
        }

    def write_files(self, folder: Path) -> None:
        """Write ``history.csv`` and ``history.prom``."""
        write_columns(folder / "history.csv", {name: [*map(str, each)] for name, each in self.columns().items()})
        (folder / "history.prom").write_text(_exposition(self.arms, len(self.left_out)), encoding="utf-8")

    def columns(self) -> Mapping[str, Sequence[Any]]:
        """A row for each arm, as ``history.csv`` has it; empty where nothing is known."""
        rows = [_table_row(each.to_dict()) for each in self.arms]
        return {name: ["" if row[name] is None else row[name] for row in rows] for name in (rows or [{}])[0]}


def _table_row(values: Mapping[str, Any]) -> dict[str, Any]:
    """Return the row of ``history.csv`` of an arm, from its values by name."""
    row = {name: values[name] for name in ("serial", "robot", "state")}
    for kind in ("calibration", "verification"):
        last = values[f"last_{kind}"] or {}
        row |= {f"last_{kind}_{key}": last.get(key) for key in ("date", "verdict")}
    row |= {name: values[name] for name in ("error_then_mm", "error_now_mm")}
    slope = values["slope"] or {}
    return row | {
        "slope_mm_per_year": slope.get("mm_per_year"),
        "slope_half_width_95": slope.get("half_width_95"),
        "calibrations": values["calibrations"],
        "verifications": values["verifications"],
        "changes": None if values["changes"] is None else len(values["changes"]),
        "next_due": values["next_due"],
    }


_STATES = ", ".join(f"{i} {word}" for i, word in enumerate(STATES))
_ESCAPES = str.maketrans({"\\": r"\\", '"': r"\"", "\n": r"\n"})


def _exposition(arms: Sequence[ArmHistory], left_out: int) -> str:
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
            [_seconds(arm.calibrated_on) for arm in arms],
        ),
        ("lab_arm_due_timestamp_seconds", "Latest date of the next check.", [_seconds(each.due) for each in arms]),
    )
    lines = list[str]()
    labels = [_labels(arm) for arm in arms]
    for name, text, values in families:
        lines += [f"# HELP {name} {text}", f"# TYPE {name} gauge"]
        lines += [f"{name}{{{arm}}} {value!r}" for arm, value in zip(labels, values, strict=True) if value is not None]
    name, text = "lab_history_left_out_runs", "Runs that could not be read."
    lines += [f"# HELP {name} {text}", f"# TYPE {name} gauge", f"{name} {left_out}"]
    return "\n".join(lines) + "\n"


def _labels(arm: ArmHistory) -> str:
    serial, robot = ((each or "").translate(_ESCAPES) for each in (arm.serial, arm.robot))
    return f'serial="{serial}",robot="{robot}"'


def _seconds(on: date | None) -> int | None:
    return None if on is None else int(datetime(on.year, on.month, on.day, tzinfo=UTC).timestamp())
