"""The state of every arm of a folder of runs, on a day."""

from collections.abc import Iterable, Mapping
from datetime import date
from pathlib import Path
from typing import Any

import numpy as np

from lab.commands.calibrate.load_run import read_calibrated
from lab.commands.command_line import options_of, takes
from lab.commands.status.arm import STATES, ArmStatus, Check, LeftOut, checks_of, reason_of
from lab.commands.status.options import StatusOptions
from lab.commands.status.result import StatusResult
from lab.commands.trend.options import TrendOptions
from lab.commands.trend.result import DatedRun, TrendResult
from lab.commands.trend.run import content_of, followed
from lab.core.errors import LabError
from lab.core.limits import day
from lab.render.terminal import status as showing

__all__ = ["status"]


@takes(StatusOptions)
def status(folder: str | Path | StatusOptions, **options: Any) -> StatusResult:
    """Say of every arm of a folder of runs whether it is good, when it was checked, and when it is next due.

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
    asked = folder
    if not isinstance(asked, StatusOptions):
        asked = options_of("lab.status", StatusOptions, {"folder": str(folder), **options})
    asked.check()
    on = date.today() if asked.on is None else day("--on", asked.on)
    with showing("reading the runs") as stage:
        checks, left_out = checks_of(asked.folder)
        if not checks and not left_out:
            raise LabError(
                f"{asked.folder}: holds no run of lab calibrate, lab identify or lab verify; give the folder that does"
            )
        arms, reasons = list[ArmStatus](), list(left_out)
        groups = _by_arm(checks)
        for i, ((serial, robot), own) in enumerate(groups.items()):
            stage("following the calibrations", i, len(groups))
            own = tuple(each for each in own if each.on is None or each.on <= on)
            if own:
                arms.append(ArmStatus(robot, serial or None, own, on, asked.every_days, _trend(asked, own, reasons)))
    arms.sort(key=lambda each: -STATES.index(each.state))
    result = StatusResult(asked, on, tuple(arms), tuple(dict.fromkeys(reasons)))
    if asked.out is not None:
        result.save(asked.out, overwrite=asked.overwrite)
    return result


def _by_arm(checks: Iterable[Check]) -> Mapping[tuple[str, str], tuple[Check, ...]]:
    """The checks by serial number and robot, each arm's in the order of their days."""
    found: dict[tuple[str, str], list[Check]] = {}
    for each in sorted(checks, key=lambda each: (each.serial or "", each.robot)):
        found.setdefault((each.serial or "", each.robot), []).append(each)
    return {
        arm: tuple(sorted(own, key=lambda each: (each.on or date.min, str(each.folder)))) for arm, own in found.items()
    }


def _trend(options: StatusOptions, checks: tuple[Check, ...], left_out: list[LeftOut]) -> TrendResult | None:
    """Follow the calibrations of an arm; what cannot be read or compared goes to ``left_out``."""
    dated = [each for each in checks if each.calibrates and each.on is not None]
    if len(dated) < 2:
        return None
    runs, seen = list[DatedRun](), set[str]()
    for each in dated:
        try:
            run = read_calibrated(each.folder)
        except LabError as error:
            left_out.append(LeftOut(each.folder, reason_of(error, each.folder)))
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
        left_out.append(LeftOut(runs[-1].run.folder, f"is not compared with earlier calibrations: {error}"))
        return None
