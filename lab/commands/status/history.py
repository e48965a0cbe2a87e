"""The calibrations and verifications of a folder of runs, read from their summaries, whatever else the folder holds."""

import os
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from datetime import date
from pathlib import Path
from typing import Literal

from lab.campaign.config_file import CONFIG_FILE, RunConfig, read_config
from lab.commands.calibrate.load_run import CALIBRATIONS, READ_FILES
from lab.commands.integrity import said_of_edits
from lab.core.dates import day
from lab.core.errors import LabError
from lab.core.whole_folder import CHECKSUMS, file_digest, is_being_written, place_of_draft
from lab.formats.structured import read_structured

__all__ = ["Check", "LeftOut", "checks_of", "reason_of"]

_RESULT = "result.json"
_MEND = "make the run again, or remove it"


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
    """What matters here of ``result.json`` of a calibration or a verification; its keys."""

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
        raise LabError(f"{folder}: is no folder; give the one that holds the runs")
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
                left_out.append(LeftOut(here / draft, f"is half of the run {place.name}, whose writing was killed"))
        inside[:] = [each for each in inside if not each.startswith(".")]


def _check(folder: Path) -> Check | None:
    """The summary of a run; None of a run of another command."""
    config = read_config(folder, _MEND)
    if config.command not in (*CALIBRATIONS, "verify"):
        return None
    said_of_edits(folder, READ_FILES, accept=False)
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
