"""Dated calibrations of one robot, in order: what has changed, and since when."""

from collections.abc import Iterator, Sequence
from hashlib import sha256
from pathlib import Path

import numpy as np

from lab.calibration.estimate import SETUP, Estimate
from lab.campaign.config_file import read_config
from lab.commands.calibrate.load_run import (
    CALIBRATIONS,
    MEASUREMENTS_FILE,
    read_calibrated,
    refuse_other_parameters,
)
from lab.commands.trend.options import TrendOptions
from lab.commands.trend.result import DatedRun, DetectableChange, TrendResult
from lab.core.errors import LabError
from lab.core.limits import day, one_serial
from lab.core.random import rng_for
from lab.core.se3 import Array
from lab.kinematics.gauge import STRUCTURE_POSES
from lab.verification.change_points import Directions, Series

__all__ = ["content_of", "followed", "trend"]

_WITHIN = 1e-6  # of a joint's effect that the identified parameters may lack


def trend(options: TrendOptions) -> TrendResult:
    """Read the runs of a folder, and test after each whether the robot has changed.

    Raises:
        LabError: there is no dated run, or they are of different arms, robots or parameters.
    """
    options.check()
    left_out: list[str] = []
    runs = list(_dated(options, left_out))
    if not runs:
        why = f" ({'; '.join(left_out)})" if left_out else ""
        raise LabError(
            f"{options.folder}: holds 0 dated runs of lab calibrate or lab identify{why}; give the folder that "
            "contains the runs' folders"
        )
    return followed(options, runs, tuple(left_out))


def followed(options: TrendOptions, dated: Sequence[DatedRun], left_out: tuple[str, ...] = ()) -> TrendResult:
    """Test after each of one or more runs of an arm whether it has changed.

    Raises:
        LabError: they are of different arms, robots or parameters.
    """
    runs = tuple(sorted(dated, key=lambda each: (each.date, each.run.folder.name)))
    serials = {str(each.run.folder): each.run.serial for each in runs}
    serial = one_serial(serials, "give --serial to follow one of them")
    without = tuple(group for group in SETUP if group not in options.kept)
    estimates = [each.run.estimate.subset(without) for each in runs]
    refuse_other_parameters([each.run for each in runs], estimates)
    last = runs[-1].run.estimate
    zeros = _joint_zeros(last)  # (f, joints) of all identified parameters
    compared = [last.free_names.index(name) for name in estimates[0].names]
    days = [float(each.date.toordinal()) for each in runs]
    series = Series(estimates, days, _directions(estimates[0].names, zeros[compared]))
    everything = Series([each.run.estimate.subset(()) for each in runs], days, _directions(last.free_names, zeros))
    changes = series.change_points()
    start = max((change.after + 1 for change in changes), default=0)
    found = _detectable(series, zeros[compared], start), _detectable(everything, zeros, start)
    detectable = tuple(
        DetectableChange(i + 1, bool(slides), float(found[0][i]), float(found[1][i]))
        for i, slides in enumerate(last.rigid.chain.prismatic)
    )
    return TrendResult(options, runs, tuple(estimates), changes, detectable, left_out, serial)


def _dated(options: TrendOptions, left_out: list[str]) -> Iterator[DatedRun]:
    """The runs that a trend is made of; of the others, why not goes to ``left_out``."""
    if not options.folder.is_dir():
        raise LabError(f"{options.folder}: is no folder; give the one that holds the runs")
    seen: dict[str, str] = {}
    for folder in sorted(path for path in options.folder.iterdir() if (path / "config.json").is_file()):
        try:
            config = read_config(folder, "make the run again")
        except LabError as error:
            left_out.append(f"{error}; the run is left out")
            continue
        if config.command not in CALIBRATIONS:
            left_out.append(f"{folder}: is no run of lab calibrate or lab identify, and is left out")
        elif config.options.get("date") is None:
            left_out.append(f"{folder}: has no date, and is left out; lab migrate {folder} --date YYYY-MM-DD adds it")
        elif options.serial not in (None, serial := config.options.get("serial")):
            of = "has no serial number" if serial is None else f"is of the arm {serial}"
            left_out.append(f"{folder}: {of}, and is left out of the trend of {options.serial}")
        elif (twin := seen.setdefault(content_of(folder), folder.name)) != folder.name:
            left_out.append(f"{folder}: has the same measurements as {twin}, and is left out")
        else:
            try:
                run = read_calibrated(folder, accept_edited=options.accept_edited)
            except LabError as error:
                left_out.append(f"{error}; the run is left out")
                continue
            if run.result.usable or options.force:
                yield DatedRun(day(f"{folder}/config.json:", str(run.options.date)), run)
            else:
                left_out.append(f"{folder}: its verdict is '{run.result.verdict}', and it is left out without --force")


def content_of(folder: Path) -> str:
    """Return what identifies the measurements of a run: two runs of the same file have the same."""
    path = folder / MEASUREMENTS_FILE
    return sha256(path.read_bytes()).hexdigest() if path.is_file() else str(folder)


def _joint_zeros(estimate: Estimate) -> Array:
    """Compute the change of the identified parameters ``(f, joints)`` per unit of joint zero; NaN if impossible."""
    arm, at = estimate.arm, list(estimate.free)
    inputs = arm.structure_joints(STRUCTURE_POSES, rng_for(0, "structure"))
    jacobian = arm.observe(inputs, arm.rank_point(estimate.nominal))[1].reshape(-1, len(arm.names))
    wanted = jacobian @ arm.rigid.joint_derivatives(np.eye(len(arm.names)))
    size = np.linalg.norm(jacobian[:, at], axis=0)
    found = np.linalg.lstsq(jacobian[:, at] / size, wanted, rcond=None)[0]
    left = np.linalg.norm(jacobian[:, at] / size @ found - wanted, axis=0)
    found = np.where(np.abs(found) > _WITHIN * np.abs(found).max(), found, 0.0) / size[:, None]
    return np.where(left > _WITHIN * np.linalg.norm(wanted, axis=0), np.nan, found)


def _directions(names: tuple[str, ...], zeros: Array) -> Directions:
    """Return the tested directions: each parameter, and each observable joint zero that is no single parameter."""
    one = np.eye(len(names))
    other = [i for i in range(zeros.shape[1]) if np.count_nonzero(zeros[:, i]) > 1 and np.isfinite(zeros[:, i]).all()]
    words = tuple(f"zero of joint {i + 1}" for i in other)
    return Directions((*names, *words), np.concatenate([one, zeros[:, other]], axis=1))


def _detectable(series: Series, zeros: Array, start: int) -> Array:
    """The minimum detectable change of each joint's zero; infinite where nothing shows it.

    Args:
        start: the first calibration since the last change.
    """
    shown = np.isfinite(zeros).all(axis=0) & (zeros != 0).any(axis=0)
    found = series.detectable(np.where(shown, np.nan_to_num(zeros), 0.0), start)
    return np.where(shown, found, np.inf)
