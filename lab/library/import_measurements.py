"""Merge a tracker's export with a controller's file into measurements."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from lab.core.errors import LabError, counted, option_name
from lab.core.measurements import Measurements, measured
from lab.core.se3 import Array
from lab.core.units import MM
from lab.formats.corner_export import CornerRows, holds_corners, read_corners
from lab.formats.joint_log import JointLog, read_joint_log
from lab.formats.loose_table import LeftOut, read_column_map, read_loose
from lab.formats.measurement_csv import write_measurements
from lab.formats.tracker_export import TrackerPoints, read_tracker_points
from lab.library.log_clocks import NominalFit
from lab.library.log_matching import Matching, matched
from lab.library.result import Result, number
from lab.library.run_folder import joint_columns
from lab.options.call_options import options_of, takes
from lab.options.command_options import ImportOptions
from lab.phrases.phrase import phrase
from lab.robots.load_robot import load_robot, robot_of_call
from lab.robots.robot import Robot
from lab.verdict.diagnosed import misread_points

__all__ = ["ImportResult", "import_measurements"]


@dataclass(frozen=True, repr=False, eq=False)
class ImportResult(Result):
    """Measurements that were merged from a tracker's and a controller's file.

    Attributes:
        measurements: a row for each pose (m, rad, in the tracker's frame), or for each corner in a picture.
        points: the tracker's file, or the pictures.
        log: the controller's file.
        matching: how points found their poses.
        corners: in the pictures; None of a tracker's file.
    """

    command = "import"
    robot_at = "robot"

    options: ImportOptions
    robot: Robot
    measurements: Measurements
    points: TrackerPoints
    log: JointLog
    matching: Matching
    warnings: tuple[str, ...]
    corners: CornerRows | None = None

    @property
    def measured(self) -> int:
        """Number of measured points or corners."""
        return len(self.measurements) if self.corners is not None else int(self.measurements.seen.sum())

    @property
    def left_out(self) -> tuple[LeftOut, ...]:
        """Entries of the two files that are not in the measurements, with the reason."""
        return (*self.points.left_out, *self.log.left_out, *self.matching.left_out)

    def to_dict(self) -> dict[str, Any]:
        """Return the values that ``--json`` prints."""
        data = self.measurements
        sigma = data.sigma_m[np.isfinite(data.sigma_m)]
        return {
            "robot": self.robot.name,
            "by": self.matching.by,
            "poses": len(self.matching.poses),
            "points": self.measured,
            "targets": list(data.targets),
            "sigma_mm": number(MM.of(float(np.median(sigma)))) if sigma.size else None,
            "conditions": [*data.conditions, *data.other],
            "columns": {"points": self.points.used, "joints": self.log.used},
            "columns_not_used": list(self.points.unused),
            "clocks": self._clocks(),
            "left_out": [
                {"file": each.file, "line": each.line or None, "what": each.what, "why": each.why}
                for each in self.left_out
            ],
            "warnings": list(self.warnings),
        }

    def _clocks(self) -> dict[str, Any] | None:
        """The offset of the clocks and what it does; None where points found their poses otherwise."""
        if (line := self.matching.timeline) is None:
            return None
        placed = line.placed
        return {
            "offset_s": placed.offset.seconds,
            "drift_ppm": placed.offset.drift_ppm,
            "placed": placed.placed,
            "of": len(placed.where),
            "stops": len(line.starts),
            "nominal_arm_rms_mm": None if placed.rms_m is None else MM.of(placed.rms_m),
        }

    def write_files(self, folder: Path) -> None:
        """Write ``measurements.csv``."""
        write_measurements(folder / "measurements.csv", self.measurements, self.robot.chain.prismatic)

    def columns(self) -> Mapping[str, Sequence[Any]]:
        """A row for each pose: its joints, ° or mm, and its points, mm; for each corner: its place, px."""
        data, chain = self.measurements, self.robot.chain
        shown = joint_columns(chain, data.joints)
        table: dict[str, Sequence[Any]] = {"id": data.ids, **{name: each.tolist() for name, each in shown.items()}}
        for k, target in enumerate(data.targets):
            for i, axis in enumerate("xyz"):
                table[f"{target}_{axis}_mm"] = MM.of(data.points[:, k, i]).tolist()
        if self.corners is not None:
            table |= {name: data.conditions[name].tolist() for name in ("u_px", "v_px")}
        return table


_OTHER_UNIT = 15.0  # times the distances that the nominal arm has: another unit
_SHOWN = 60  # poses by which distances are compared


@takes(ImportOptions)
def import_measurements(
    points: str | Path | ImportOptions, robot: str | Path | Robot | None = None, **options: Any
) -> ImportResult:
    r"""Merge a tracker's export with a controller's joint positions into measurements that ``identify`` reads.

    Corners in pictures, with the time of each picture, take the place of points for ``observe="pixels"``.

    Args:
        points: the tracker's or the corners' file; or all options in one object.
        robot: whose joints were read, which the files do not name: a name, a path, or a loaded robot.
        options: those of ``lab import``, by name: ``joints``, ``by`` and so on.

    Returns:
        The measurements (m, rad, in the tracker's frame), and what of the files was left out.

    Raises:
        LabError: a file cannot be read, or the two do not go together; with file, line and column.

    Example:
        >>> import lab, pathlib, tempfile
        >>> here, day = pathlib.Path(tempfile.mkdtemp()), lab.simulate("irb120", poses=12, seed=7).measurements
        >>> points = [f"P{i},{x},{y},{z}" for i, (x, y, z) in enumerate(1e3 * day.points[:, 0])]
        >>> _ = (here / "tracker.csv").write_text("\n".join(["name,x_mm,y_mm,z_mm", *points]))
        >>> joints = [",".join(map(str, [f"P{i}", *row])) for i, row in enumerate(day.joints)]
        >>> header = "name,q1_rad,q2_rad,q3_rad,q4_rad,q5_rad,q6_rad"
        >>> _ = (here / "joints.csv").write_text("\n".join([header, *joints]))
        >>> found = lab.import_measurements(here / "tracker.csv", "irb120", joints=here / "joints.csv")
        >>> found.measurements.points.shape
        (12, 1, 3)
    """
    if not isinstance(points, ImportOptions):
        loaded = robot_of_call("lab.import_measurements", points, robot)
        given = {"points": str(points), "robot": loaded.source, **options}
        points = options_of("lab.import_measurements", ImportOptions, given)
    else:
        loaded = load_robot(points.robot)
    points.check()
    chain = loaded.chain
    columns = read_column_map(points.columns)
    log = read_joint_log(points.joints, chain.joint_names, chain.prismatic, columns.joints, points.joint_unit)
    table = read_loose(points.points, 3)
    if holds_corners(table, columns.points):
        _refuse_those_of_points(points)
        pictures, corners = read_corners(table, columns.points)
        found = matched(points, pictures, log, chain.prismatic, times_alone=True)
        data = _pixel_measurements(loaded, pictures, corners, found)
        return ImportResult(points, loaded, data, pictures, log, found, loaded.warnings, corners)
    seen = read_tracker_points(table, columns.points, points.unit, points.coverage)
    nominal = NominalFit(loaded, points.targets, seen.positions)
    found = matched(points, seen, log, chain.prismatic, nominal)
    data = _measurements(points, loaded, seen, found)
    warnings = _doubts(points, loaded, data, nominal)
    return ImportResult(points, loaded, data, seen, log, found, (*loaded.warnings, *seen.notes, *warnings))


def _refuse_those_of_points(options: ImportOptions) -> None:
    for name in ("targets", "unit", "coverage", "station"):
        if getattr(options, name) != getattr(ImportOptions(options.points, options.joints), name):
            raise LabError(f"{options.points}: its rows are corners in pictures; leave out {option_name(name)}")


def _pixel_measurements(robot: Robot, pictures: TrackerPoints, corners: CornerRows, found: Matching) -> Measurements:
    """A row for each corner of the pictures that found their poses."""
    order = [k for pose in found.poses for k in pose.points.values()]
    rows = np.concatenate([np.flatnonzero(corners.picture == k) for k in order])
    pose = np.full(len(pictures.lines), -1)
    pose[order] = np.arange(len(order))
    joints = np.array([each.joints for each in found.poses])[pose[corners.picture[rows]]]
    seconds = pictures.seconds - np.nanmin(pictures.seconds)
    data = measured(robot.chain.joint_names, joints, (), np.empty((len(rows), 0, 3)))
    return replace(
        data,
        robot=robot.source,
        conditions={
            "time_s": seconds[corners.picture[rows]],
            "u_px": corners.places[rows, 0],
            "v_px": corners.places[rows, 1],
        },
        other={name: tuple(texts[i] for i in rows) for name, texts in corners.texts.items()},
    )


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


def _by_default(options: ImportOptions) -> str:
    default = ImportOptions(options.points, options.joints).robot
    return ", which is taken without --robot" if options.robot == default else ""


def _doubts(options: ImportOptions, robot: Robot, data: Measurements, nominal: NominalFit) -> tuple[str, ...]:
    """Compare the points with the nominal arm.

    The distance of two points of one target hardly depends on where base and tool are: a wrong unit of lengths scales
    all of them. Where points are far from the nominal arm wherever base and tool are, the diagnosis names the mistake.
    """
    shown = data[:_SHOWN]
    flange = nominal.flanges(shown.joints)
    pairs = [(i, j) for i in range(len(flange)) for j in range(i)]
    if len(pairs) < 3:
        return ()
    one, two = np.array(pairs).T
    expected = np.linalg.norm(flange[one] - flange[two], axis=1)
    apart = np.linalg.norm(shown.points[one] - shown.points[two], axis=2)
    retained = np.isfinite(apart) & (expected[:, None] > 1e-6)
    if retained.sum() < 3:
        return ()
    k = int(np.argmax(retained.sum(axis=0)))
    expected, apart = expected[retained[:, k]], apart[retained[:, k], k]
    ratio = float(np.median(apart) / np.median(expected))
    if not 1 / _OTHER_UNIT < ratio < _OTHER_UNIT:
        raise LabError(
            f"{options.points}: points are {np.median(apart):.3g} m apart where the arm moves its flange by "
            f"{np.median(expected):.3g} m (medians): the lengths are in another unit; give the right --unit"
        )
    pose, target = np.nonzero(data.seen)
    if not nominal.usable(data.joints[pose]):
        return ()
    far = nominal.distances(data.joints[pose], target, data.points[pose, target]) > nominal.tolerance_m
    if not far.any():
        return ()
    mistakes = [phrase(each.check) for each in misread_points(robot, data)]
    named = "; ".join(mistakes) or f"check --robot{_by_default(options)} and the rows before lab identify"
    return (
        f"{far.sum()} of {counted(len(pose), 'point')} do not follow the nominal arm: {data.ids[pose[far.argmax()]]}, "
        f"the first, is over {MM.text(nominal.tolerance_m, 2)} from it; {named}",
    )
