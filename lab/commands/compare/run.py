"""Calibrations of one robot against each other: have its links moved?"""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from lab.commands.calibrate.load_run import Calibrated, calibrated_by, read_calibrated
from lab.commands.compare.options import CompareOptions
from lab.commands.compare.result import ComparisonResult
from lab.commands.keywords import options_of, takes
from lab.core.errors import LabError
from lab.verification.difference import Estimates, difference_of

if TYPE_CHECKING:
    from lab.commands.calibrate.run import CalibrationResult

__all__ = ["compare"]

_PLACED = ("base", "tool")  # groups that another setup moves


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
        LabError: a run is not good, is of another robot, or identified other parameters.

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


def _compared(options: CompareOptions, runs: Sequence[Calibrated]) -> ComparisonResult:
    first, *later = runs
    if not options.force:
        for run in runs:
            run.refuse_unfit("a comparison")
    for run in later:
        if run.robot.sha256 != first.robot.sha256:
            raise LabError(f"{run.folder}: is of another robot than {first.folder}; compare runs of one robot")
    estimates = [_estimates(run) for run in runs]
    for run, each in zip(later, estimates[1:], strict=True):
        if other := set(each.names) ^ set(estimates[0].names):
            raise LabError(
                f"{run.folder}: {min(other)} was identified in it or in {first.folder}, but not in both: the others "
                "mean something else in each; identify both with the same --model, --fix and --free"
            )
    differences = tuple(difference_of(estimates[0], each) for each in estimates[1:])
    return ComparisonResult(options, tuple(runs), differences)


def _estimates(run: Calibrated) -> Estimates:
    """What a run says of the links and effects: base and tool are another setup's."""
    parameters = {each.name: each for each in run.arm.parameters}
    kept = [i for i, name in enumerate(run.identified) if parameters[name].group not in _PLACED]
    names = tuple(run.identified[i] for i in kept)
    _, larger, dof = run.lacking((run.result.noise_mm or 0.0) / 1e3)
    covariance = larger * run.covariance[kept][:, kept]
    angles = tuple(parameters[name].is_angle for name in names)
    return Estimates(names, run.estimates[kept], covariance, angles, dof)
