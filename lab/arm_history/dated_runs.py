"""Read calibrations and verifications of arms: from runs, from folders of runs, and from results in memory."""

import os
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import date
from hashlib import sha256
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, NamedTuple

from lab.core.errors import LabError
from lab.core.limits import day, one_serial
from lab.core.whole_folder import CHECKSUMS, file_digest, is_being_written, place_of_draft
from lab.formats.structured import read_structured
from lab.library.load_run import (
    CALIBRATIONS,
    MEASUREMENTS_FILE,
    READ_FILES,
    CalibrationRun,
    calibrated_by,
    load_run,
)
from lab.library.run_folder import check_edits
from lab.robots.config_file import CONFIG_FILE, read_config

if TYPE_CHECKING:
    from lab.library.calibration_result import CalibrationResult

__all__ = ["DatedRun", "DatedRuns", "UnusableRun", "is_run", "reason_of", "runs_below", "runs_given"]

_RESULT = "result.json"
_MEND = "repeat the run, or remove it"
_COMMANDS = "lab calibrate, lab identify or lab verify"


@dataclass(frozen=True)
class DatedRun:
    """A calibration or a verification of an arm.

    Attributes:
        on: the day of its measurements; None where the run names none.
        verdict: good, doubtful, bad or not judged.
        error_mm, p95_mm: mean and 95 % of the errors at poses that were not fitted; None where there are none.
        of: the digest of the calibration's result.json; None of a verification of a result in memory.
        model_sha256: of the robot's files.
        gate_mm: of a calibration: the largest mean error that was accepted.
        loaded: the calibration itself, where it was read already.
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
    gate_mm: float | None = None
    p95_mm: float | None = None
    loaded: CalibrationRun | None = None

    def calibration(self, *, accept_edited: bool) -> CalibrationRun:
        """Return the calibration, read from its folder if it was not."""
        return self.loaded or load_run(self.folder, accept_edited=accept_edited)

    @property
    def measured(self) -> str:
        """What identifies its measurements: two runs of the same file have the same."""
        path = self.folder / MEASUREMENTS_FILE
        return sha256(path.read_bytes()).hexdigest() if path.is_file() else str(self.folder)


class UnusableRun(NamedTuple):
    """A run that cannot be used, and why not."""

    folder: Path
    reason: str


class DatedRuns(NamedTuple):
    """Runs in the order in which they were found, and those that cannot be used."""

    used: tuple[DatedRun, ...]
    left_out: tuple[UnusableRun, ...]


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
    last: str | None = None  # the last day of touches of a socket

    @property
    def word(self) -> str | None:
        """The verdict in a word, also of a run that says only whether the arm is good; None without any."""
        return self.verdict or {None: None, True: "good", False: "bad"}[self.good]

    def errors_mm(self, *, calibrates: bool) -> Mapping[str, float]:
        """Return the errors that a calibration leaves, or a verification finds; empty where the run has none."""
        return (self.after_mm if calibrates else self.observed_mm) or {}


def is_run(place: object) -> bool:
    """Check whether this is a run rather than a folder of runs: a result in memory, or the folder of a run."""
    if not isinstance(place, str | Path):
        return True
    return any((Path(place) / name).is_file() for name in (CONFIG_FILE, CHECKSUMS))


def runs_given(
    places: Sequence["Path | CalibrationResult"], names: Sequence[Path], *, force: bool, accept_edited: bool
) -> tuple[DatedRun, ...]:
    """Read runs of one arm, by their days where all have one.

    Args:
        names: of each: its folder, or what it is called.
        force: whether calibrations may be bad or not judged.

    Raises:
        LabError: one cannot be used, or they are of several arms.
    """
    read = [
        _run_given(place, name, force=force, accept_edited=accept_edited)
        for place, name in zip(places, names, strict=True)
    ]
    serial = one_serial({str(each.folder): each.serial for each in read}, "compare runs of one arm")
    for each in read[1:]:
        if each.robot != read[0].robot:
            raise LabError(f"{each.folder}: is of another robot than {read[0].folder}; compare runs of one robot")
    if all(each.on is not None for each in read):
        read.sort(key=lambda each: each.on or date.min)
    return tuple(replace(each, serial=serial) for each in read)


def _run_given(place: "Path | CalibrationResult", name: Path, *, force: bool, accept_edited: bool) -> DatedRun:
    run = _run_at(name, accept_edited=accept_edited) if isinstance(place, Path) else None
    if run is None and isinstance(place, Path):
        raise LabError(f"{name}: is no run of {_COMMANDS} with a verdict; give the folders of such runs")
    if run is not None and not run.calibrates:
        return run
    calibration = calibrated_by(place, name, accept_edited=accept_edited)
    if not force:
        calibration.refuse_unfit("a comparison")
    return _of_calibration(calibration)


def _of_calibration(run: CalibrationRun) -> DatedRun:
    result, given = run.result, run.options.date
    errors: Mapping[str, float] = result.after_mm or {}
    digest = file_digest(run.folder / _RESULT) if (run.folder / _RESULT).is_file() else None
    return DatedRun(
        run.folder, run.robot.name, run.serial, True,
        None if given is None else day(f"{run.folder}: date", given),
        result.verdict, errors.get("mean"), digest, run.robot.sha256, result.gate_mm, errors.get("p95"), run,
    )  # fmt: skip


def runs_below(folder: Path, *, accept_edited: bool) -> DatedRuns:
    """Read every calibration and verification below a folder; a run that cannot be used is listed with the reason.

    Raises:
        LabError: there is no such folder.
    """
    if not folder.is_dir():
        raise LabError(f"{folder}: is no folder; give the folder of a run, or one that contains runs")
    found, left_out = list[DatedRun](), list[UnusableRun]()
    for run in _folders(folder, left_out):
        try:
            each = _run_at(run, accept_edited=accept_edited)
        except LabError as error:
            left_out.append(UnusableRun(run, reason_of(error, run)))
            continue
        found += [] if each is None else [each]
    return DatedRuns(tuple(found), tuple(left_out))


def reason_of(error: LabError, run: Path) -> str:
    """Return what is wrong with a run, without its folder, and without the options of other commands that mend it."""
    return str(error).removeprefix(f"{run}: ").partition("; ")[0]


def _folders(folder: Path, left_out: list[UnusableRun]) -> Iterator[Path]:
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
                left_out.append(UnusableRun(here / draft, f"is an incomplete copy of the run {place.name}"))
        inside[:] = [each for each in inside if not each.startswith(".")]


def _run_at(folder: Path, *, accept_edited: bool) -> DatedRun | None:
    """Return a run; None of another command, and of a verification that has no verdict yet."""
    config = read_config(folder, _MEND)
    options: Mapping[str, Any] = config.options
    calibrates = config.command in CALIBRATIONS
    verifies = config.command == "verify" and options.get("plan") is None
    if not calibrates and not verifies:
        return None
    check_edits(folder, READ_FILES, accept=accept_edited)
    summary = read_structured(folder / _RESULT, _Summary, _MEND)
    if summary.word is None:
        raise LabError(f"{folder}: {_RESULT} has no verdict; {_MEND}")
    if verifies and summary.word == "not judged":
        return None
    errors = summary.errors_mm(calibrates=calibrates)
    measured_on = options.get("date") or summary.last
    return DatedRun(
        folder,
        summary.robot,
        summary.serial,
        calibrates,
        None if measured_on is None else day(f"{folder}/{CONFIG_FILE}: date", str(measured_on)),
        summary.word,
        errors.get("mean"),
        file_digest(folder / _RESULT) if calibrates else config.inputs_sha256.get(str(options.get("run"))),
        config.model_sha256,
        summary.gate_mm,
        errors.get("p95"),
    )
