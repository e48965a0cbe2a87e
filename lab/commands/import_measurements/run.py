"""A tracker's export and a controller's file, merged into measurements."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from lab.campaign.robot import Robot, load_robot
from lab.commands.command_line import options_of, takes
from lab.commands.import_measurements.clocks import NominalFit
from lab.commands.import_measurements.matching import Matching, matched
from lab.commands.import_measurements.options import ImportOptions
from lab.commands.import_measurements.result import ImportResult
from lab.core.errors import LabError, counted
from lab.core.measurements import Measurements, measured
from lab.core.se3 import Array
from lab.formats.joint_log import read_joint_log
from lab.formats.loose_table import read_column_map
from lab.formats.tracker_export import TrackerPoints, read_tracker_points

__all__ = ["import_measurements"]

_OTHER_UNIT = 15.0  # times the distances that the nominal arm has: another unit
_SHOWN = 60  # poses by which distances are compared


@takes(ImportOptions)
def import_measurements(points: str | Path | ImportOptions, **options: Any) -> ImportResult:
    """Merge a tracker's export with a controller's joint positions into measurements that ``identify`` reads.

    Args:
        points: the tracker's file; or all options in one object.
        options: those of ``lab import``, by name: ``joints``, ``robot``, ``by`` and so on.

    Returns:
        The measurements (m, rad, in the tracker's frame), and what of the files was left out.

    Raises:
        LabError: a file cannot be read, or the two do not go together; with file, line and column.
    """
    if not isinstance(points, ImportOptions):
        points = options_of("lab.import_measurements", ImportOptions, {"points": str(points), **options})
    points.check()
    robot = load_robot(points.robot)
    chain = robot.chain
    columns = read_column_map(points.columns)
    seen = read_tracker_points(points.points, columns.points, points.unit, points.coverage)
    log = read_joint_log(points.joints, chain.joint_names, chain.prismatic, columns.joints, points.joint_unit)
    nominal = NominalFit(robot, points.targets, seen.positions)
    found = matched(points, seen, log, chain.prismatic, nominal)
    data = _measurements(points, robot, seen, found)
    warnings = _doubts(points, robot, data, nominal)
    return ImportResult(points, robot, data, seen, log, found, (*robot.warnings, *seen.notes, *warnings))


def _measurements(options: ImportOptions, robot: Robot, seen: TrackerPoints, found: Matching) -> Measurements:
    n, targets = len(found.poses), options.targets
    points = np.full((n, len(targets), 3), np.nan)
    rows: list[list[int]] = []
    for i, pose in enumerate(found.poses):
        for target, row in pose.points.items():
            points[i, targets.index(target)] = seen.positions[row]
        rows.append(sorted(pose.points.values()))
    joints = np.array([pose.joints for pose in found.poses])
    data = measured(robot.chain.joint_names, joints, targets, points)
    first = seen.seconds - np.nanmin(seen.seconds) if np.isfinite(seen.seconds).any() else seen.seconds
    conditions = {"temp_C": _mean(rows, seen.temperature_c), "time_s": _mean(rows, first)}
    air = {"pressure_hPa": _mean(rows, seen.pressure_hpa), "humidity_percent": _mean(rows, seen.humidity_percent)}
    other = {
        name: tuple("" if np.isnan(value) else f"{value:.10g}" for value in values)
        for name, values in air.items()
        if np.isfinite(values).any()
    }
    if options.station is not None:
        other["station"] = (options.station,) * n
    return replace(
        data,
        ids=_unique([f"{options.station or ''} {pose.name}".strip() for pose in found.poses]),
        robot=robot.source,
        sigma_m=np.sqrt(_mean(rows, seen.sigma_m**2)),
        conditions={name: values for name, values in conditions.items() if np.isfinite(values).any()},
        other=other,
    )


def _mean(rows: Sequence[Sequence[int]], values: Array) -> Array:
    """The mean over the points of each pose ``(n,)``; NaN where one has no value."""
    return np.array([values[list(each)].mean() for each in rows])


def _unique(names: Sequence[str]) -> tuple[str, ...]:
    """Names of rows: those that are there again, because a pose was measured again, are numbered."""
    counts: dict[str, int] = {}
    found = []
    for name in names:
        counts[name] = counts.get(name, 0) + 1
        found.append(name if counts[name] == 1 else f"{name} ({counts[name]})")
    return tuple(found)


def _doubts(options: ImportOptions, robot: Robot, data: Measurements, nominal: NominalFit) -> tuple[str, ...]:
    """Compare the points with the nominal arm.

    The distance of two points of one target hardly depends on where base and tool are: a wrong unit of lengths scales
    all of them. Points of other poses, or joints in another unit or with another sign, are far from the nominal arm
    wherever base and tool are.

    Raises:
        LabError: the distances are another unit's.
    """
    shown = data.take(np.arange(min(len(data), _SHOWN)))
    flange = nominal.flanges(shown.joints)
    pairs = [(i, j) for i in range(len(flange)) for j in range(i)]
    if len(pairs) < 3:
        return ()
    one, two = np.array(pairs).T
    expected = np.linalg.norm(flange[one] - flange[two], axis=1)
    apart = np.linalg.norm(shown.points[one] - shown.points[two], axis=2)
    kept = np.isfinite(apart) & (expected[:, None] > 1e-6)
    if kept.sum() < 3:
        return ()
    k = int(np.argmax(kept.sum(axis=0)))
    expected, apart = expected[kept[:, k]], apart[kept[:, k], k]
    ratio = float(np.median(apart) / np.median(expected))
    if not 1 / _OTHER_UNIT < ratio < _OTHER_UNIT:
        raise LabError(
            f"{options.points}: points are {np.median(apart):.3g} m apart where the arm moves its flange by "
            f"{np.median(expected):.3g} m (medians): lengths are in another unit; give the right --unit or map"
        )
    pose, target = np.nonzero(data.seen)
    if not nominal.usable(data.joints[pose]):
        return ()
    far = nominal.distances(data.joints[pose], target, data.points[pose, target]) > nominal.tolerance_m
    if not far.any():
        return ()
    return (
        f"{far.sum()} of {counted(len(pose), 'point')} do not follow the nominal arm: {data.ids[pose[far.argmax()]]}, "
        f"the first, is over {1e3 * nominal.tolerance_m:.2g} mm from it. Rows may belong to other poses, or the joints "
        "be in another unit, order or direction; check before lab identify",
    )
