"""Test daily touches of one socket: does the calibrated arm still meet it, and if not, which joint's zero moved?"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lab.calibration.statistics.joint_rounding import by_joint_positions
from lab.core.errors import LabError, counted
from lab.core.limits import CONFIGURATIONS, day
from lab.core.measurements import Measurements
from lab.core.number_text import digits_of, fixed, plus_minus, sentence, short
from lab.core.se3 import Array
from lab.core.significance import TREND_YEAR
from lab.core.units import MM, MRAD, Unit
from lab.diagnosis.gross import gross_mistakes
from lab.diagnosis.hypothesis import Finding
from lab.kinematics.model import RigidArm
from lab.library.load_run import CalibrationRun
from lab.library.point_verification import situation_values
from lab.library.result import Result, exit_code_of, number
from lab.library.touch_plan import TouchPlan, ball_columns, placed_by, planned, sockets_of
from lab.options.command_options import VerifyOptions
from lab.phrases.phrase import phrase
from lab.sensors.socket import SocketSensor
from lab.verdict.diagnosed import read_as_accepted
from lab.verification.socket_checks import (
    LEAST_CONFIGURATIONS,
    REFERENCE,
    Candidate,
    Cause,
    Change,
    Distinction,
    Scan,
    SocketChecks,
    causes_of,
)

__all__ = ["TouchesResult", "planned_touches", "verified_touches"]

_NEAR_RAD = np.deg2rad(10.0)  # within which a joint position is that of the same configuration
_NEAR_M = 0.05  # of a slide
_UNNAMED = "?"  # of a socket that a file does not name
_BY_NAME = {"base": "the base", "tool": "the tool"}


@dataclass(frozen=True, repr=False, eq=False)
class TouchesResult(Result):
    """Result of testing daily touches of a socket.

    Attributes:
        calibrated: the run that calibrated the arm.
        dates: of the checks, ascending.
        errors: ``(checks, m, 3)`` m, where the joints put the ball, less the socket.
        sockets: names of the sockets.
        distinctions: how well each cause is seen in these configurations.
        scan: all checks, tested one after the other.
        findings: mistakes of reading that nobody has accepted: where there are any, the checks mean nothing.
    """

    command = "verify"
    robot_at = "calibrated.robot"

    options: VerifyOptions
    calibrated: CalibrationRun
    dates: tuple[str, ...]
    errors: Array
    sockets: tuple[str, ...]
    distinctions: tuple[Distinction, ...]
    scan: Scan
    findings: tuple[Finding, ...]
    warnings: tuple[str, ...]

    @property
    def verdict(self) -> str:
        """``bad`` where one cause explains a change, ``doubtful`` where several or none do, else ``good``.

        ``bad`` also where readings are wrong; ``not judged`` before the first check that is tested.
        """
        if self.findings:
            return "bad"
        if (change := self.scan.change) is not None:
            return "bad" if change.named and change.candidates[0].cause.kind != "touch" else "doubtful"
        return "good" if self.scan.tested else "not judged"

    @property
    def exit_code(self) -> int:
        """1 where something moved and one cause explains it; 3 where a good answer is required; else 0."""
        return exit_code_of(self.verdict, self.options.require)

    @property
    def serial(self) -> str | None:
        """The serial number of the arm, by the run or the option; None where neither states it."""
        return self.calibrated.serial or self.options.serial

    @property
    def reference(self) -> int:
        """How many checks, from the first, show how touches repeat."""
        return self.options.reference or REFERENCE

    @cached_property
    def repeatability_m(self) -> float:
        """Standard deviation (m) of a touch along an axis, over the reference checks."""
        return float(np.sqrt(self.errors[: self.reference].var(axis=0, ddof=1).mean()))

    def to_dict(self) -> dict[str, Any]:
        """Return the values that ``--json`` prints and ``result.json`` holds: lengths in mm, angles in mrad."""
        change = self.scan.change
        return {
            "run": str(self.calibrated.folder),
            "robot": self.calibrated.robot.name,
            "serial": self.serial,
            "verdict": self.verdict,
            "words": sentence(self.words()),
            "checks": len(self.dates),
            "tested": self.scan.tested,
            "first": self.dates[0],
            "last": self.dates[-1],
            "configurations": self.errors.shape[1],
            "level_per_year": TREND_YEAR,
            "repeatability_mm": number(MM.of(self.repeatability_m)),
            "change": None if change is None else self._change(change),
            "situation": situation_values(self.findings[0].check if self.findings else None),
            "bad_touches": [self.dates[i] for i in self.scan.bad_touches],
            "causes": [
                {
                    **self._cause(each.cause),
                    "detected": number(self.unit(each.cause).of(each.detected)),
                    "named": number(self.unit(each.cause).of(each.named)),
                    "same_as": [self.called(kind, name) for kind, name in each.confounded],
                }
                for each in self.distinctions
            ],
            "warnings": list(self.warnings),
        }

    def _cause(self, cause: Cause) -> dict[str, Any]:
        return {"kind": cause.kind, "name": cause.name, "unit": self.unit(cause).name}

    def _change(self, change: Change) -> dict[str, Any]:
        return {
            "first": self.dates[change.first],
            "found": self.dates[change.found_at],
            "explained": change.explained,
            "p": change.p,
            "level": change.level,
            "causes": [
                {
                    **self._cause(each.cause),
                    "size": number(self.unit(each.cause).of(each.size)),
                    "half_width_95": number(self.unit(each.cause).of(each.half_width)),
                    "p": each.p,
                }
                for each in change.candidates
            ],
        }

    def columns(self) -> Mapping[str, Sequence[Any] | Array]:
        """The errors by ``date`` and ``configuration`` (from 1): ``error_x_mm``, ``error_y_mm``, ``error_z_mm``."""
        days, m, _ = self.errors.shape
        table = MM.of(self.errors.reshape(-1, 3))
        return {
            "date": [date for date in self.dates for _ in range(m)],
            "configuration": [1 + i for _ in range(days) for i in range(m)],
            **{f"error_{axis}_mm": table[:, i] for i, axis in enumerate("xyz")},
        }

    def unit(self, cause: Cause) -> Unit:
        """Return the unit in which the size of a change is shown."""
        chain = self.calibrated.robot.chain
        turns = cause.kind == "joint" and not chain.prismatic[chain.joint_names.index(cause.name)]
        return MRAD if turns else MM

    def called(self, kind: str, name: str) -> str:
        """Return what a cause is called in a sentence."""
        if kind == "joint":
            return f"the zero of joint {name}"
        if kind == "touch":
            return f"one bad touch of configuration {name}"
        return f"the socket {name}".strip() if kind == "socket" else _BY_NAME[kind]

    def words(self) -> str:
        """Say in a sentence what is wrong with the readings; else whether anything moved, what, and by how much."""
        if self.findings:
            return phrase(self.findings[0].check)
        change = self.scan.change
        if change is None:
            if self.scan.tested:
                return f"nothing has moved in {counted(self.scan.tested, 'tested check')}"
            left = self.reference + 1 - len(self.dates)
            return f"{counted(len(self.dates), 'check')} so far: {left} more, and the last of them is tested"
        since = f"since the check of {self.dates[change.first]}"
        names = [self._moved(each) for each in change.candidates]
        if not change.explained:
            return f"{since} the errors are others, and no single cause explains them; the nearest: {names[0]}"
        if len(names) > 1:
            return f"{since} one of these moved, and these checks do not tell which: {'; or '.join(names)}"
        return f"{since} {names[0]}" if change.candidates[0].cause.kind == "touch" else f"{names[0]} {since}"

    def _moved(self, candidate: Candidate) -> str:
        unit, what = self.unit(candidate.cause), self.called(candidate.cause.kind, candidate.cause.name)
        if candidate.cause.kind != "joint":
            return f"{what} ({short(unit.of(candidate.size))} {unit.name})"
        digits = digits_of(unit.of(candidate.half_width), 6)
        size = fixed(unit.of(candidate.size), digits, signed=True)
        return f"{what} moved by {size} {plus_minus(unit.of(candidate.half_width), digits)} {unit.name}"


def planned_touches(options: VerifyOptions, calibrated: CalibrationRun, read: Measurements) -> TouchPlan:
    """Propose configurations for daily touches.

    Raises:
        LabError: there is no touch by which a socket is placed.
    """
    rows, slides = read.only("calibrate", "reference", "test"), np.array(calibrated.robot.chain.prismatic)
    if not len(rows):
        raise LabError(f"{options.file}: holds no touch; add one of each socket, by which it is placed")
    return planned(options, calibrated, rows, np.where(slides, _NEAR_M, _NEAR_RAD), read.warnings)


def verified_touches(options: VerifyOptions, calibrated: CalibrationRun, read: Measurements) -> TouchesResult:
    """Test daily touches of a socket.

    Raises:
        LabError: the rows make no daily checks.
    """
    read, findings = _read_as_accepted(options, calibrated, read)
    days, rows, table = _checks_by_day(options, calibrated, read)
    labels = sockets_of(rows, table[0].tolist())
    arm, values = calibrated.estimate.geometry
    joints = rows.joints[table]  # (days, m, joints)
    errors, causes = _errors(arm, values, joints, labels, options.reference or REFERENCE)
    if len(days) < 2:
        raise LabError(f"{options.file}: one check has nothing to be compared with; add that of another day")
    tests = SocketChecks(causes, options.reference or REFERENCE)
    scan = tests.scan(errors)
    end = len(days) if scan.change is None else scan.change.first
    unchanged = [i for i in range(end) if i not in scan.bad_touches]
    warnings = [*calibrated.warnings, *read.warnings]
    warnings += [
        f"a bad touch on {days[i]}: that check raised an alarm, and the next was as those before; it is left out"
        for i in scan.bad_touches
    ]
    distinctions = tests.distinctions(errors[unchanged])
    return TouchesResult(options, calibrated, days, errors, labels, distinctions, scan, findings, tuple(warnings))


def _read_as_accepted(
    options: VerifyOptions, calibrated: CalibrationRun, read: Measurements
) -> tuple[Measurements, tuple[Finding, ...]]:
    """Find mistakes of reading by the calibrated arm; return the rows with those accepted undone, and the others.

    A socket that moved is no mistake of reading: the checks find it.
    """
    arm, values = calibrated.estimate.geometry
    one = calibrated.robot.arm(arm.targets[:1])
    rows = read.only("calibrate", "reference", "test")
    count = len(rows)
    sockets = {"location": tuple(name or _UNNAMED for name in sockets_of(rows, range(count))), "socket": ("-",) * count}
    task = replace(rows, targets=(), points=np.empty((count, 0, 3)), other={**rows.other, **sockets})
    gross = gross_mistakes(SocketSensor(), one, task, values[[arm.names.index(name) for name in one.names]])
    found = tuple(each for each in gross.findings if not each.name.endswith("_moved"))
    task, gross = read_as_accepted(task, replace(gross, findings=found), options.accept)
    if options.accept:
        names = tuple(name.replace(_UNNAMED, "") for name in task.other["location"])
        read = replace(task, other={**rows.other, "location": names, "socket": ("",) * count})
    return read, gross.findings


def _checks_by_day(
    options: VerifyOptions, calibrated: CalibrationRun, read: Measurements
) -> tuple[tuple[str, ...], Measurements, NDArray[np.int_]]:
    """Return the days, the rows since the day that the options name, and the row of each configuration on each day."""
    rows, slides = read.only("calibrate", "reference", "test"), np.array(calibrated.robot.chain.prismatic)
    dates = _dates(options, rows)
    kept = [i for i, date in enumerate(dates) if options.since is None or date >= options.since]
    if not kept:
        raise LabError(f"{options.file}: holds no check since {options.since}; give an earlier --since")
    rows = rows[kept]
    days, table = _by_configuration(options, rows, [dates[i] for i in kept], slides)
    return days, rows, table


def _dates(options: VerifyOptions, rows: Measurements) -> list[str]:
    """Return the day of each row, as ``session`` states it."""
    for i, session in enumerate(rows.sessions):
        if not session:
            raise LabError(f"{rows.where(i)}, column session: empty; give the day of the check, YYYY-MM-DD")
        day(f"{rows.where(i)}, column session:", session)
    if not len(rows):
        raise LabError(f"{options.file}: holds no row to be used; mark fewer with use = skip")
    return list(rows.sessions)


def _by_configuration(
    options: VerifyOptions, rows: Measurements, dates: Sequence[str], slides: NDArray[np.bool_]
) -> tuple[tuple[str, ...], NDArray[np.int_]]:
    """Return the days, and ``(days, m)`` the row of each configuration: the order is that of the first day.

    Raises:
        LabError: a day lacks a configuration, has one twice, or has one that the first day lacks.
    """
    days = sorted(set(dates))
    on = {date: [i for i, each in enumerate(dates) if each == date] for date in days}
    first = on[days[0]]
    if len(first) < LEAST_CONFIGURATIONS:
        raise LabError(
            f"{options.file}: the check of {days[0]} has {counted(len(first), 'configuration')}; touch the socket in "
            f"at least {LEAST_CONFIGURATIONS}"
        )
    CONFIGURATIONS(f"{options.file}: the check of {days[0]}", first)
    near, table = np.where(slides, _NEAR_M, _NEAR_RAD), []
    for date in days:
        apart = (np.abs(rows.joints[on[date]][:, None] - rows.joints[first]) / near).max(axis=2)
        order = _matched_rows(rows, on[date], apart, days[0], date)
        if lacking := [at for at in range(len(first)) if at not in order]:
            raise LabError(
                f"{options.file}: the check of {date} lacks configuration {lacking[0] + 1} of the first check; touch "
                "all of them, or mark its rows use = skip"
            )
        table.append([order[at] for at in range(len(first))])
    return tuple(days), np.array(table)


def _matched_rows(rows: Measurements, of_day: Sequence[int], apart: Array, first_day: str, date: str) -> dict[int, int]:
    """Return a day's row of each configuration of the first check.

    Args:
        of_day: the day's rows.
        apart: ``(rows of the day, configurations)`` distances, of which those up to one are near.

    Raises:
        LabError: a row is near no configuration, or two are at one.
    """
    order: dict[int, int] = {}
    for row, distances in zip(of_day, apart, strict=True):
        at = int(np.argmin(distances))
        if distances[at] > 1.0:
            raise LabError(
                f"{rows.where(row)}: no configuration of the first check ({first_day}) is within 10° of it; touch "
                "the same ones, or mark the row use = skip"
            )
        if at in order:
            raise LabError(
                f"{rows.where(row)}: touches the same configuration as {rows.where(order[at])} on {date}; keep one "
                "row of each"
            )
        order[at] = row
    return order


def _errors(
    arm: RigidArm, values: Array, joints: Array, sockets: Sequence[str], reference: int
) -> tuple[Array, tuple[Cause, ...]]:
    """Return the errors ``(days, m, 3)`` m, with ball and sockets placed by the reference checks, and the causes."""
    days, m, count = joints.shape
    usual = joints[:reference].mean(axis=0)
    values, placed = placed_by(arm, values, usual, sockets)
    centres = np.array([placed[name] for name in sockets])
    found = arm.points(joints.reshape(-1, count), values)[:, 0].reshape(days, m, 3)
    points, jacobian = arm.observe(usual, values)
    by_joint = by_joint_positions(arm, usual, values, count)[:, 0]
    by_ball = jacobian[:, 0][..., ball_columns(arm)]
    causes = causes_of(arm.chain.joint_names, by_joint, by_ball, points[:, 0], sockets)
    return found - centres, causes
