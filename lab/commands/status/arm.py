"""The state of one arm on a day, from its calibrations and verifications."""

import os
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from datetime import date, timedelta
from functools import cached_property
from pathlib import Path
from typing import Literal

import numpy as np

from lab.campaign.config_file import CONFIG_FILE, RunConfig, read_config
from lab.commands.calibrate.load_run import CALIBRATIONS, READ_FILES
from lab.commands.run_folder import check_edits
from lab.commands.trend.result import TrendResult
from lab.core.errors import LabError
from lab.core.limits import called, day
from lab.core.linear_model import half_width_95
from lab.core.whole_folder import CHECKSUMS, file_digest, is_being_written, place_of_draft
from lab.formats.structured import read_structured

__all__ = ["FEWEST_CHECKS", "STATES", "ArmStatus", "Check", "LeftOut", "Slope", "checks_of", "reason_of"]

_RESULT = "result.json"
_MEND = "repeat the run, or remove it"


@dataclass(frozen=True)
class Check:
    """A calibration or a verification of an arm.

    Attributes:
        calibrates: whether it is a calibration.
        on: the day of its measurements; None where the run names none.
        verdict: good, doubtful, bad or not judged.
        error_mm: the mean error at poses that were not fitted; None where there are none.
        of: the digest of the calibration's ``result.json``; None of a verification of a result in memory.
        model_sha256: of the robot's files.
    """

    folder: Path
    robot: str
    serial: str | None
    calibrates: bool
    on: date | None
    verdict: str
    error_mm: float | None
    of: str | None
    model_sha256: str


@dataclass(frozen=True)
class LeftOut:
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


def checks_of(folder: Path) -> tuple[tuple[Check, ...], tuple[LeftOut, ...]]:
    """Read every calibration and verification below a folder; a run that cannot be used is listed with the reason.

    Raises:
        LabError: there is no such folder.
    """
    if not folder.is_dir():
        raise LabError(f"{folder}: is no folder; give the folder that contains the runs")
    found, left_out = list[Check](), list[LeftOut]()
    for run in _runs(folder, left_out):
        try:
            check = _check(run)
        except LabError as error:
            left_out.append(LeftOut(run, reason_of(error, run)))
            continue
        found += [] if check is None else [check]
    return tuple(found), tuple(left_out)


def reason_of(error: LabError, run: Path) -> str:
    """Return what is wrong with a run, without its folder, and without the options of other commands that mend it."""
    return str(error).removeprefix(f"{run}: ").partition("; ")[0]


def _runs(folder: Path, left_out: list[LeftOut]) -> Iterator[Path]:
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
                left_out.append(LeftOut(here / draft, f"is an incomplete copy of the run {place.name}"))
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
    errors = found.after_mm if calibrates else found.observed_mm
    return Check(
        folder,
        found.robot,
        found.serial,
        calibrates,
        _day(folder, config),
        verdict,
        None if errors is None else errors.get("mean"),
        file_digest(folder / _RESULT) if calibrates else config.inputs_sha256.get(str(config.options.get("run"))),
        config.model_sha256,
    )


def _day(folder: Path, config: RunConfig) -> date | None:
    given = config.options.get("date")
    return None if given is None else day(f"{folder}/{CONFIG_FILE}: date", str(given))


STATES = ("good", "due", "unknown", "never calibrated", "doubtful", "bad")  # by severity; the number is the metric's
FEWEST_CHECKS = 4  # verifications from which a slope is estimated
_YEAR = 365.25  # days


@dataclass(frozen=True)
class Slope:
    """The slope of the mean error over the verifications of the current calibration, mm per year.

    Attributes:
        half_width: of its 95 % interval, by the scatter about the line.
        count: of the verifications.
    """

    per_year: float
    half_width: float
    count: int


@dataclass(frozen=True)
class ArmStatus:
    """An arm on a day.

    Attributes:
        serial: its serial number; None where its runs name none.
        checks: its calibrations and verifications up to the day, in order; those without a day first.
        on: the day.
        every_days: after how many days without a check it is due.
        trend: of its calibrations; None where fewer than two can be compared.
    """

    robot: str
    serial: str | None
    checks: tuple[Check, ...]
    on: date
    every_days: int
    trend: TrendResult | None = None

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
        known = {each.of for each in self.checks if each.calibrates}
        own = [each for each in self.checks if not each.calibrates and each.on is not None]
        return tuple(
            each for each in own if each.of == last.of or (each.of not in known and each.on and each.on > last.on)
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
    def slope(self) -> Slope | None:
        """The slope of the error since the last calibration; None of fewer than four verifications."""
        points = [(each.on.toordinal() / _YEAR, each.error_mm) for each in self.verifications if each.on is not None]
        return _slope([(at, error) for at, error in points if error is not None])


def _slope(points: Sequence[tuple[float, float]]) -> Slope | None:
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
    return Slope(slope, float(half_width_95(float(dof))) * std, len(points))
