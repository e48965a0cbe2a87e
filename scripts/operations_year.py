"""Twelve arms over two years: is a change found, is an unchanged arm left alone, what does it take?

Virtual IRB 120 with three targets and the uniform noise of 8 µm. Each arm is calibrated at the start and verified once
a month, on the 8th; where a verification is bad, it is calibrated anew a week later. Half of the arms stay as they are.
The zero of one joint moves in two arms; two have a crash, which moves three zeros; in two the zero of joint 2 wears
slowly. What moves is what the controller does not know: the joint positions of the file are off by it. Runs, dates and
serial numbers are those of the public calls, and the folder at the end is one that ``lab history`` reads.
"""

import resource
import sys
from collections.abc import Mapping
from dataclasses import dataclass, replace
from datetime import date
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

sys.path.append(str(Path(__file__).with_name("experiments")))
from shared import Answer, Document, Flag, Row, Section, Table, paragraphs, run_script

import lab
from lab.core.errors import LabError
from lab.core.measurements import Measurements
from lab.core.random import rng_for
from lab.core.se3 import Array

ROBOT, TARGETS, NOISE_MM = "irb120", ("p1", "p2", "p3"), 8e-3 / 3**0.5
_FIRST, _MENDED = date(2024, 1, 8), 15  # days of the first measurement, and of a month of calibrations


@dataclass(frozen=True)
class Options:
    """How much to simulate."""

    arms: int = 12
    """Half of them unchanged."""
    months: int = 24
    """One verification in each."""
    poses: int = 40
    """Of a calibration."""
    verified: int = 8
    """Poses of a verification."""
    moved_mrad: float = 0.15
    """How far a zero moves."""
    crash_mrad: float = 1.0
    """How far the zeros of joints 2, 3 and 5 move, up to the sign."""
    wear_mrad: float = 0.01
    """How far the zero of joint 2 wears in a month."""
    seed: int = 0
    """Of arms, noise, poses and the months of changes."""
    out: Path | None = None
    """A folder that does not exist, to keep the runs in; by default they are removed."""
    json: Flag = False
    """Print one JSON object."""


@dataclass(frozen=True)
class Arm:
    """An arm, what happens to it, and from which month on.

    Attributes:
        kind: ``stable``, ``zero``, ``crash`` or ``wear``.
        month: of the first measurement with the change.
    """

    serial: str
    kind: str
    month: int

    def off(self, month: int, options: Options) -> Array:
        """Return how far the zeros ``(6,)`` are off in a month, rad."""
        found = np.zeros(6)
        if self.kind != "stable" and month >= self.month:
            if self.kind == "zero":
                found[2] = options.moved_mrad
            elif self.kind == "crash":
                found[[1, 2, 4]] = options.crash_mrad * np.array([0.6, -1.0, 0.8])
            else:
                found[1] = options.wear_mrad * (month - self.month + 1)
        return found / 1e3


@dataclass(frozen=True)
class Life:
    """What happened to an arm.

    Attributes:
        false_alarms: bad verifications of an arm that was as at its last calibration.
        checks: verifications of such an arm.
        found: months from the change to the bad verification; None where none came.
        size_mrad: the largest change of a zero then.
    """

    arm: Arm
    false_alarms: int
    checks: int
    found: int | None
    size_mrad: float | None
    calibrations: int
    verdicts: Mapping[str, int]


def arms_of(options: Options) -> tuple[Arm, ...]:
    """Return the arms: every second one changes, in a month drawn at random."""
    rng, kinds = rng_for(options.seed, "robots"), ("zero", "crash", "wear")
    found = []
    for i in range(options.arms):
        kind = "stable" if i % 2 == 0 else kinds[i // 2 % len(kinds)]
        latest = max(3, options.months // 2)
        month = options.months + 1 if kind == "stable" else int(rng.integers(2, latest))
        found.append(Arm(f"A-{i + 1:02}", kind, month))
    return tuple(found)


def lived(arm: Arm, runs: Path, options: Options, seed: int) -> Life:
    """Measure, calibrate and verify an arm over all months; its runs go into a folder of its own."""
    rows = _Rows(arm, options, seed)
    current = _calibrated(arm, rows.next(options.poses, 0), 0, runs)
    calibrated_at, calibrations, false, checks = 0, 1, 0, 0
    found: tuple[int, float] | None = None
    verdicts: dict[str, int] = {current.verdict.word: 1}
    for month in range(1, options.months + 1):
        changed = np.abs(arm.off(month, options) - arm.off(calibrated_at, options)).max()
        day = _day(month)
        result = lab.verify(
            current, rows.next(options.verified, month), date=day, noise_mm=NOISE_MM, no_recording=True, force=True
        )
        result.save(runs / arm.serial / f"verify-{day}")
        bad = result.exit_code == 1
        if changed == 0:
            checks += 1
            false += bad
        elif bad and found is None:
            found = month - arm.month, 1e3 * float(changed)
        if bad:
            current = _calibrated(arm, rows.next(options.poses, month), month, runs)
            calibrated_at, calibrations = month, calibrations + 1
            verdicts[current.verdict.word] = verdicts.get(current.verdict.word, 0) + 1
    months, size = (None, None) if found is None else found
    return Life(arm, false, checks, months, size, calibrations, verdicts)


class _Rows:
    """Measurements of one arm, handed out in order, each with the zeros of its month."""

    def __init__(self, arm: Arm, options: Options, seed: int) -> None:
        most = options.poses * (1 + options.months) + options.verified * options.months
        self._all = lab.simulate(ROBOT, poses=most, seed=seed, targets=TARGETS).measurements
        self._arm, self._options, self._taken = arm, options, 0

    def next(self, count: int, month: int) -> Measurements:
        """The next so many rows: the controller says less than where a joint stands whose zero has moved."""
        part = self._all[self._taken : self._taken + count]
        self._taken += count
        return replace(part, joints=part.joints - self._arm.off(month, self._options))


def _calibrated(arm: Arm, rows: Measurements, month: int, runs: Path) -> Any:
    day = _day(month, _MENDED if month else _FIRST.day)
    result = lab.identify(rows, robot=ROBOT, noise_mm=NOISE_MM, date=day, serial=arm.serial, no_recording=True)
    result.save(runs / arm.serial / f"calibrate-{day}")
    return result


def _day(month: int, of_month: int = _FIRST.day) -> str:
    at = _FIRST.month - 1 + month
    return date(_FIRST.year + at // 12, at % 12 + 1, of_month).isoformat()


def answer(options: Options) -> Answer:
    """Live through the months of every arm, and read the folder back.

    Raises:
        LabError: the folder to keep the runs in exists.
    """
    if options.out is not None and options.out.exists():
        raise LabError(f"{options.out}: exists; give --out a folder that does not")
    with TemporaryDirectory() as scratch:
        runs = options.out or Path(scratch) / "runs"
        began = _processor_s()
        lives = [lived(arm, runs, options, options.seed + i) for i, arm in enumerate(arms_of(options))]
        lived_s = _processor_s() - began
        history = lab.history(runs, on=_day(options.months))
        history_s = _processor_s() - began - lived_s
        disk = sum(path.stat().st_size for path in runs.rglob("*") if path.is_file())
    return _told(lives, {arm.serial or "": arm.state for arm in history.arms}, disk, (lived_s, history_s))


def _processor_s() -> float:
    used = resource.getrusage(resource.RUSAGE_SELF)
    return used.ru_utime + used.ru_stime


def _told(lives: list[Life], states: Mapping[str, str], disk: int, seconds: tuple[float, float]) -> Answer:
    false, checks = sum(each.false_alarms for each in lives), sum(each.checks for each in lives)
    changed = [each for each in lives if each.arm.kind != "stable"]
    found = [each for each in changed if each.found is not None]
    values = {
        "verifications_unchanged": checks,
        "false_alarms": false,
        "changes": len(changed),
        "found": len(found),
        "disk_bytes": disk,
        "processor_s": seconds[0],
        "history_processor_s": seconds[1],
        "arms": [
            {
                "serial": each.arm.serial,
                "kind": each.arm.kind,
                "changed_in_month": each.arm.month if each.arm.kind != "stable" else None,
                "found_after_months": each.found,
                "found_at_mrad": each.size_mrad,
                "false_alarms": each.false_alarms,
                "calibrations": each.calibrations,
                "verdicts": dict(each.verdicts),
                "state": states.get(each.arm.serial),
            }
            for each in lives
        ],
    }
    said = (
        f"{checks} verifications of an unchanged arm: {false} false alarms (1 % are meant). {len(found)} of "
        f"{len(changed)} changes found. Disk {disk / 1e6:.1f} MB, processor {seconds[0] / 60:.1f} min, lab history "
        f"{seconds[1]:.1f} s."
    )
    return Answer(
        values, Document("Operations: arms over months", (Section("", (*paragraphs([said]), _table(lives))),))
    )


def _table(lives: list[Life]) -> Table:
    rows: list[Row] = [
        (
            each.arm.serial,
            each.arm.kind,
            "–" if each.arm.kind == "stable" else str(each.arm.month),
            "–" if each.found is None else str(each.found),
            "–" if each.size_mrad is None else f"{each.size_mrad:.3f}",
            str(each.false_alarms),
            str(each.calibrations),
        )
        for each in lives
    ]
    columns = ("arm", "what happens", "month", "found after, months", "at, mrad", "false alarms", "calibrations")
    return Table(columns, tuple(rows))


if __name__ == "__main__":
    run_script("operations_year")
