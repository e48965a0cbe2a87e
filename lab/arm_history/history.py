"""Run ``lab history``."""

from collections.abc import Iterable, Sequence
from datetime import date
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from lab.arm_history.changes import Changes, changes_between
from lab.arm_history.dated_runs import DatedRun, UnusableRun, is_run, reason_of, runs_below, runs_given
from lab.arm_history.history_result import STATES, ArmHistory, HistoryResult
from lab.core.errors import LabError
from lab.core.limits import day
from lab.core.progress import stages
from lab.options.call_options import options_of, takes
from lab.options.command_options import HistoryOptions

if TYPE_CHECKING:
    from lab.library.calibration_result import CalibrationResult
    from lab.library.load_run import CalibrationRun

__all__ = ["history"]


@takes(HistoryOptions)
def history(
    runs: "str | Path | CalibrationResult | Sequence[str | Path | CalibrationResult] | HistoryOptions", **options: Any
) -> HistoryResult:
    """Report what moved between runs and since when; of a folder of runs, which arms are good and when each is due.

    Args:
        runs: results of ``calibrate`` or ``identify``, folders of runs, the earliest first, or folders that contain
            runs of ``calibrate``, ``identify`` and ``verify``, at any depth; or all options in one object.
        options: those of ``lab history``, by name: ``kept``, ``serial``, ``every_days``, ``on``, ``require``,
            ``force``, ``accept_edited``, ``out``.

    Returns:
        Of each arm its state and its next check, the changes between its calibrations, and which change would be found.

    Raises:
        LabError: there is no run of an arm, or given runs are of several arms or cannot be compared.

    Example:
        >>> import lab
        >>> day = lab.simulate("irb120", poses=60, seed=7).measurements
        >>> halves = [day[:30], day[30:60]]
        >>> first, second = (lab.identify(half, robot="irb120", instrument="uniform-8um") for half in halves)
        >>> lab.history([first, second], force=True).arms[0].changes.found
        ()
    """
    if isinstance(runs, HistoryOptions):
        requested, places = runs, list[Any](runs.runs)
    else:
        places = [runs] if isinstance(runs, str | Path) or not isinstance(runs, Sequence) else list(runs)
        names = [
            str(each) if isinstance(each, str | Path) else f"run-{i + 1}-in-memory" for i, each in enumerate(places)
        ]
        requested = options_of("lab.history", HistoryOptions, {"runs": names, **options})
    requested.check()
    result = _history(requested, [Path(each) if isinstance(each, str) else each for each in places])
    if requested.out is not None:
        result.save(requested.out, overwrite=requested.overwrite)
    return result


def _history(options: HistoryOptions, places: Sequence[Any]) -> HistoryResult:
    by_runs = all(map(is_run, places))
    on = date.today() if options.on is None else day("--on", options.on)
    with stages("reading the runs") as stage:
        runs, left_out = _read(options, places, by_runs=by_runs)
        if not runs and not left_out:
            raise _no_runs(options)
        arms, groups = list[ArmHistory](), _by_arm(runs)
        latest = date.max if by_runs and options.on is None else on
        for i, group in enumerate(groups):
            stage("comparing the calibrations", i, len(groups))
            if own := [run for run in group if run.on is None or run.on <= latest]:
                changes = _changes(options, own) if by_runs else _where_possible(options, own, left_out)
                arms.append(ArmHistory(own[0].robot, own[0].serial, tuple(own), on, options.every_days, changes))
    arms.sort(key=lambda arm: (-STATES.index(arm.state), arm.due or date.min))
    return HistoryResult(options, on, tuple(arms), tuple(dict.fromkeys(left_out)), by_runs)


def _no_runs(options: HistoryOptions) -> LabError:
    of = "" if options.serial is None else f" of the arm {options.serial}"
    return LabError(
        f"{options.runs[0]}: contains no run of lab calibrate, lab identify or lab verify{of}; give a run, or "
        "a folder that contains runs"
    )


def _read(
    options: HistoryOptions, places: Sequence[Any], *, by_runs: bool
) -> tuple[tuple[DatedRun, ...], list[UnusableRun]]:
    """Read runs that are given one by one, or those below folders; return the arm's, and those that cannot be used."""
    left_out = list[UnusableRun]()
    if by_runs:
        runs = runs_given(places, options.runs, force=options.force, accept_edited=options.accept_edited)
    else:
        read = [runs_below(Path(place), accept_edited=options.accept_edited) for place in places]
        runs = tuple(each for part in read for each in part.used)
        left_out += [each for part in read for each in part.left_out]
    return tuple(each for each in runs if options.serial in (None, each.serial)), left_out


def _by_arm(found: Iterable[DatedRun]) -> list[list[DatedRun]]:
    """The runs of each arm, by serial number and robot, in the order of their days."""
    arms: dict[tuple[str, str], list[DatedRun]] = {}
    for each in sorted(found, key=lambda each: (each.serial or "", each.robot)):
        arms.setdefault((each.serial or "", each.robot), []).append(each)
    return [sorted(own, key=lambda each: each.on or date.min) for own in arms.values()]


def _changes(options: HistoryOptions, runs: Sequence[DatedRun]) -> Changes | None:
    """Compare given calibrations; None where there is none."""
    dated = [each for each in runs if each.calibrates]
    if not dated:
        return None
    loaded = [each.calibration(accept_edited=options.accept_edited) for each in dated]
    for run in loaded:
        if not _has_covariance(run):
            raise LabError(
                f"{run.folder}: its covariance is unknown, so it cannot be compared; identify from more poses"
            )
    return changes_between(dated, loaded, options.kept)


def _where_possible(options: HistoryOptions, runs: Sequence[DatedRun], left_out: list[UnusableRun]) -> Changes | None:
    """Compare two or more dated calibrations of an arm; what cannot be read or compared goes to ``left_out``."""
    dated = [each for each in runs if each.calibrates and each.on is not None]
    if len(dated) < 2:
        return None
    used, loaded = _comparable(options, dated, left_out)
    if len(used) < 2:
        return None
    try:
        return changes_between(used, loaded, options.kept)
    except LabError as error:
        left_out.append(UnusableRun(used[-1].folder, f"is not compared with earlier calibrations: {error}"))
        return None


def _comparable(
    options: HistoryOptions, dated: Sequence[DatedRun], left_out: list[UnusableRun]
) -> "tuple[list[DatedRun], list[CalibrationRun]]":
    """Read the calibrations that can be compared: usable ones with a covariance, each file of measurements once."""
    used, loaded, seen = list[DatedRun](), list["CalibrationRun"](), set[str]()
    for each in dated:
        try:
            run = each.calibration(accept_edited=options.accept_edited)
        except LabError as error:
            left_out.append(UnusableRun(each.folder, reason_of(error, each.folder)))
            continue
        if (run.result.usable or options.force) and _has_covariance(run) and each.measured not in seen:
            used.append(each)
            loaded.append(run)
            seen.add(each.measured)
    return used, loaded


def _has_covariance(run: "CalibrationRun") -> bool:
    return bool(np.isfinite(run.estimate.free_covariance).all())
