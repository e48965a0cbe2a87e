"""Calibrations of one robot against each other: have its links moved?"""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from lab.calibration.estimate import IdentifiedSubset
from lab.commands.calibrate.load_run import (
    CalibrationRun,
    calibrated_by,
    read_calibrated,
    refuse_other_parameters,
)
from lab.commands.command_line import options_of, takes
from lab.commands.compare.options import CompareOptions
from lab.commands.compare.result import ComparisonResult
from lab.core.errors import LabError
from lab.core.limits import one_serial
from lab.core.measurements import copied_rows
from lab.verification.difference import difference_of

if TYPE_CHECKING:
    from lab.commands.calibrate.run import CalibrationResult

__all__ = ["compare"]


@takes(CompareOptions)
def compare(runs: "Sequence[str | Path | CalibrationResult] | CompareOptions", **options: Any) -> ComparisonResult:
    """Compare calibrations of one robot: which parameters of its links have moved, and by how much.

    Args:
        runs: results of ``calibrate`` or ``identify``, or folders of runs, the earliest first; or all options in one
            object.
        options: those of ``lab compare``, by name: ``force``, ``accept_edited``.

    Returns:
        The differences of each later run from the first, with their intervals and a test at a level of 1 %.

    Raises:
        LabError: a run is not good, is of another robot, identified other parameters, or is given twice.

    Example:
        >>> import lab
        >>> day = lab.simulate("irb120", poses=60, seed=7).measurements
        >>> halves = [day.take(range(30)), day.take(range(30, 60))]
        >>> first, second = (lab.identify(half, robot="irb120", instrument="uniform-8um") for half in halves)
        >>> lab.compare([first, second], force=True).exit_code
        0
    """
    if isinstance(runs, CompareOptions):
        runs.check()
        found = [read_calibrated(run, accept_edited=runs.accept_edited) for run in runs.runs]
        return _compared(runs, found)
    names = [str(run) if isinstance(run, str | Path) else f"run-{i + 1}-in-memory" for i, run in enumerate(runs)]
    asked = options_of("lab.compare", CompareOptions, {"runs": names, **options})
    asked.check()
    accept = asked.accept_edited
    return _compared(
        asked, [calibrated_by(run, Path(n), accept_edited=accept) for run, n in zip(runs, names, strict=True)]
    )


def _compared(options: CompareOptions, runs: Sequence[CalibrationRun]) -> ComparisonResult:
    if not options.force:
        for run in runs:
            run.refuse_unfit("a comparison")
    serial = one_serial({str(run.folder): run.serial for run in runs}, "compare runs of one arm")
    estimates = [run.estimate.subset() for run in runs]
    refuse_other_parameters(runs, estimates)
    _refuse_same(runs, estimates)
    differences = tuple(difference_of(estimates[0], each) for each in estimates[1:])
    return ComparisonResult(options, tuple(runs), differences, serial)


def _refuse_same(runs: Sequence[CalibrationRun], estimates: Sequence[IdentifiedSubset]) -> None:
    """Refuse a run that is given twice, or a copy of one: between the same numbers nothing can have moved."""
    if copies := copied_rows(np.stack([each.values for each in estimates])):
        folder, same = (runs[i].folder for i in copies[0])
        raise LabError(
            f"{folder}: has the parameters of {same}, to the last digit; give another calibration of the robot"
        )
