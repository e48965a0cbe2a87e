"""Matching of a tracker's points to a controller's poses: by name, in order, or by time."""

import re
from collections.abc import Callable, Container, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lab.core.errors import LabError
from lab.core.se3 import Array
from lab.core.units import MM, joints_to_si
from lab.formats.joint_log import JointLog
from lab.formats.loose_table import LeftOut
from lab.formats.tracker_export import TrackerPoints
from lab.library.log_clocks import ClockComparison, ClockOffset, NominalFit, PlacedPoints
from lab.options.command_options import By, ImportOptions

__all__ = ["Matching", "Timeline", "matched", "settled_windows"]

_SPAN_S = 0.4  # over which a speed is taken: shorter, and the steps of an encoder look like motion
_ROWS = 2.5  # steps of a log that a speed is taken over at least, where it has few rows a second
_FEWEST = 3  # rows of a window


@dataclass(frozen=True)
class _Windows:
    """Times at which the arm stood still.

    Attributes:
        starts, ends: ``(k,)`` s, of the log's clock.
    """

    starts: Array
    ends: Array
    joints: Array  # (k, joints) rad or m: the mean of the rows of each
    lines: tuple[int, ...]  # (k,) of the first row of each, as an editor counts

    def __len__(self) -> int:
        return len(self.starts)


def settled_windows(log: JointLog, prismatic: tuple[bool, ...], still: float, least_s: float) -> _Windows:
    """Find the windows in which every joint moves more slowly than a bound.

    The speed at a row is the change of a joint over 0.4 s about it (in a log of few rows a second: from the row before
    to the row after), so that the steps of an encoder are no motion. It rises half of that before the arm moves, which
    keeps the ends of a window clear of the motion.

    Args:
        still: the largest speed of a joint at rest, degrees per s, mm per s of a slide.
        least_s: the shortest window.

    Raises:
        LabError: times are missing or fall, or the arm never rests.
    """
    times = log.seconds
    for i in np.flatnonzero(~np.isfinite(times)):
        raise LabError(f"{log.path}: line {log.lines[i]}: the time is missing; a log needs one in every row")
    for i in np.flatnonzero(np.diff(times) < 0):
        raise LabError(f"{log.path}: line {log.lines[i + 1]}: the time decreases; sort the rows by time")
    span = max(_SPAN_S, _ROWS * float(np.median(np.diff(times)))) if len(times) > 1 else _SPAN_S
    before = np.searchsorted(times, times - span / 2, side="left")
    after = np.searchsorted(times, times + span / 2, side="right") - 1
    apart = np.maximum(times[after] - times[before], 1e-9)[:, None]
    unit = joints_to_si(np.ones(len(prismatic)), prismatic)
    speed = (np.abs(log.joints[after] - log.joints[before]) / apart / unit).max(axis=1)
    stands = (speed < still) & (after > before)
    jumps = (np.abs(np.diff(log.joints, axis=0)) / unit).max(axis=1) > still * span  # between rows far apart in time
    run = np.cumsum(~stands | np.concatenate([[True], jumps]))
    _, firsts, counts = np.unique(run[stands], return_index=True, return_counts=True)
    standing = np.flatnonzero(stands)
    spans = [
        (first, first + count)
        for first, count in zip(standing[firsts].tolist(), counts.tolist(), strict=True)
        if count >= _FEWEST and times[first + count - 1] - times[first] >= least_s
    ]
    if not spans:
        raise LabError(
            f"{log.path}: no joint position holds for {least_s:g} s at less than {still:g} °/s "
            f"(the slowest moment has {speed.min():.3g} °/s); give --still-deg-s or --settled-s, or --by order"
        )
    return _Windows(
        np.array([times[first] for first, _ in spans]),
        np.array([times[last - 1] for _, last in spans]),
        np.array([log.joints[first:last].mean(axis=0) for first, last in spans]),
        tuple(log.lines[first] for first, _ in spans),
    )


_ENDING = re.compile(r"(.+?)[\s_.:/\-]+([^\s_.:/\-]+)")  # pose and target in one name
_LOG_GAP_S = 1.0  # rows that follow each other faster are a log, not a list of poses


class _MatchedPose(NamedTuple):
    name: str
    joints: Array
    points: dict[str, int]  # rows of the measured points in the tracker's file, by target


@dataclass(frozen=True)
class Timeline:
    """Times of the measured points and of the arm's stops, on the controller's clock.

    Attributes:
        starts, ends: ``(k,)`` s, of the windows in which the arm stood still.
    """

    at: Array  # (n,) s, of the points; NaN where unknown
    starts: Array
    ends: Array
    placed: PlacedPoints  # which window each point falls into, by which offset of the clocks
    retained: NDArray[np.bool_]  # (n,) which points are in the measurements


@dataclass(frozen=True)
class Matching:
    """Assignment of points to poses."""

    by: By  # the criterion that was compared
    poses: tuple[_MatchedPose, ...]  # in the order of the controller's file
    left_out: tuple[LeftOut, ...]  # points and poses without the other
    description: tuple[str, ...]  # description of the method, in sentences
    timeline: Timeline | None = None  # of points that found their poses by time


def matched(
    options: ImportOptions,
    points: TrackerPoints,
    log: JointLog,
    prismatic: tuple[bool, ...],
    nominal: NominalFit | None = None,
    *,
    times_alone: bool = False,
) -> Matching:
    """Find the pose of each point.

    Args:
        nominal: the arm by which an offset of the clocks is checked; None to take it as it is given.
        times_alone: whether an offset is checked by times, without an arm.

    Raises:
        LabError: names, counts or times do not go together.
    """
    by = options.by if options.by != "auto" else _choice(options, points, log)
    if by == "name":
        return _by_name(options, points, log)
    found = _poses(options, log, prismatic, as_log=_is_log(log))
    if by == "order":
        return _by_order(options, points, log, found)
    return _by_time(options, points, log, found, nominal, times_alone=times_alone)


def _choice(options: ImportOptions, points: TrackerPoints, log: JointLog) -> By:
    known = set(log.names)
    if all(log.names) and any(_split(options, points, i, known) for i in range(len(points.names))):
        return "name"
    timed = np.isfinite(points.seconds).all() and np.isfinite(log.seconds).all()
    return "time" if timed else "order"


def _is_log(log: JointLog) -> bool:
    known = np.isfinite(log.seconds)
    return bool(known.all()) and len(known) > 2 and float(np.median(np.diff(log.seconds))) < _LOG_GAP_S


def _poses(options: ImportOptions, log: JointLog, prismatic: tuple[bool, ...], *, as_log: bool) -> _Windows:
    """The poses at which the arm stood: settled windows of a log, else the file's rows."""
    if as_log:
        return settled_windows(log, prismatic, options.still_deg_s, options.settled_s)
    return _Windows(log.seconds, log.seconds, log.joints, log.lines)


# By name


def _split(options: ImportOptions, points: TrackerPoints, i: int, known: Container[str]) -> tuple[str, str] | None:
    """Pose and target by the name of a point; None where no pose has this name."""
    name, target = points.names[i], points.targets[i]
    if name in known:
        return (name, target or options.targets[0]) if target or len(options.targets) == 1 else None
    match = _ENDING.fullmatch(name)
    if match and match[1] in known and match[2] in options.targets:
        return match[1], match[2]
    return None


def _by_name(options: ImportOptions, points: TrackerPoints, log: JointLog) -> Matching:
    if not all(log.names):
        raise LabError(
            f"{log.path}: its rows have no names; name their column by --columns, or give --by order or time"
        )
    if not all(points.names):
        raise LabError(f"{points.path}: its points have no names; give --by order or --by time")
    first: dict[str, int] = {}
    for i, name in enumerate(log.names):
        if name in first:
            lines = f"lines {log.lines[first[name]]} and {log.lines[i]}"
            raise LabError(f"{log.path}: {lines}: two poses are named '{name}'; rename one, or give --by time")
        first[name] = i
    found: dict[str, dict[str, int]] = {}
    left = []
    for i, name in enumerate(points.names):
        which = _split(options, points, i, first)
        if which is None:
            left.append(LeftOut(str(points.path), points.lines[i], name, "no pose has this name"))
            continue
        pose, target = which
        if target not in options.targets:
            raise LabError(
                f"{points.path}: line {points.lines[i]}: target '{target}' is none of --targets; name it there"
            )
        if target in found.setdefault(pose, {}):
            lines = f"lines {points.lines[found[pose][target]]} and {points.lines[i]}"
            raise LabError(f"{points.path}: {lines}: point '{name}' appears twice; rename one, or give --by time")
        found[pose][target] = i
    if not found:
        raise LabError(
            f"{points.path}: no point has the name of a pose ('{points.names[0]}' here, '{log.names[0]}' in "
            f"{log.path}); give --by order or --by time, or --targets with the endings of the names"
        )
    left += [
        LeftOut(str(log.path), log.lines[i], name, "no point was measured at this pose")
        for name, i in first.items()
        if name not in found
    ]
    poses = tuple(_MatchedPose(name, log.joints[i], found[name]) for name, i in first.items() if name in found)
    return Matching("name", poses, tuple(left), ("Points are matched to the poses of the same name.",))


# In order


def _by_order(options: ImportOptions, points: TrackerPoints, log: JointLog, waypoints: _Windows) -> Matching:
    each, count = len(options.targets), len(points.names)
    if count != len(waypoints) * each:
        of_each = f" with {each} points each" if each > 1 else ""
        what = "settled poses" if _is_log(log) else "poses"
        raise LabError(
            f"{points.path}: {count} points, but {log.path} has {len(waypoints)} {what}{of_each}; remove those "
            "without a partner, or give --by name or --by time"
        )
    poses = tuple(
        _MatchedPose(
            _pose_name(points, k * each, k), waypoints.joints[k], _in_turn(options, range(k * each, (k + 1) * each))
        )
        for k in range(len(waypoints))
    )
    return Matching("order", poses, (), ("Points and poses are matched in the order of their files.",))


def _in_turn(options: ImportOptions, rows: Sequence[int]) -> dict[str, int]:
    return dict(zip(options.targets, rows, strict=True))


def _pose_name(points: TrackerPoints, i: int, k: int) -> str:
    return points.names[i] or str(k)


# By time


def _by_time(
    options: ImportOptions,
    points: TrackerPoints,
    log: JointLog,
    waypoints: _Windows,
    nominal: NominalFit | None,
    *,
    times_alone: bool,
) -> Matching:
    if not np.isfinite(points.seconds).any():
        raise LabError(f"{points.path}: its points have no times; give --by name or --by order, or --columns")
    if not np.isfinite(log.seconds).all():
        raise LabError(f"{log.path}: its rows have no times; give --by name or --by order, or --columns")
    at, starts, ends, same = _one_clock(points, log, waypoints)
    window_of, spans = _windows_by_time(starts, ends, exact=not _is_log(log))
    compared = ClockComparison(at, *spans, window_of, waypoints.joints, points.positions, len(options.targets), nominal)
    if not same and options.clock_offset_s is None:
        raise LabError(
            f"{points.path}: its times and those of {log.path} start at different moments; counted from the first of "
            f"each, {compared.proposal()}"
        )
    offset = ClockOffset(options.clock_offset_s or 0.0, options.clock_drift_ppm)
    placed = compared.placed_by(offset)
    if not placed.placed:
        raise LabError(
            f"{points.path}: no point was measured while the arm of {log.path} stood still; {compared.proposal()}"
        )
    if nominal is not None or times_alone:
        try:
            compared.check(offset, given=options.clock_offset_s is not None)
        except LabError as error:
            raise LabError(f"{points.path}: {error}") from error
    astray = placed.astray(len(options.targets))
    retained = np.where(astray, -1, placed.where)
    left = [
        LeftOut(
            str(points.path), points.lines[i], points.names[i] or f"point {i + 1}",
            "no time" if np.isnan(at[i]) else
            f"over {MM.text(placed.tolerance_m, 2)} from the nominal arm in the pose of that time" if astray[i] else
            "measured while the arm moved, or outside the log",
        )
        for i in np.flatnonzero(retained < 0)
    ]  # fmt: skip
    poses, met = list(_timed_poses(options, points, waypoints, retained)), set(retained.tolist())
    left += [
        LeftOut(str(log.path), waypoints.lines[k], f"pose {k + 1}", "no point was measured at this pose")
        for k in range(len(waypoints))
        if k not in met
    ]
    messages = [
        f"Points are matched to the poses at which the arm stood when they were measured ({len(waypoints)} in the log)."
    ]
    if offset.seconds or offset.drift_ppm:
        drift = f", and {offset.drift_ppm:g} ppm faster" if offset.drift_ppm else ""
        messages.append(f"The tracker's clock is assumed to be {offset.seconds:g} s ahead of the controller's{drift}.")
    timeline = Timeline(offset.on_log(at), starts, ends, placed, retained >= 0)
    return Matching("time", tuple(poses), tuple(left), tuple(messages), timeline)


def _one_clock(points: TrackerPoints, log: JointLog, waypoints: _Windows) -> tuple[Array, Array, Array, bool]:
    """Times of the points, and of when poses begin and end, on one clock; whether the clocks are of one kind."""
    at, starts, ends = points.seconds, waypoints.starts, waypoints.ends
    clocks = {points.clock, log.clock}
    if len(clocks) == 1:
        return at, starts, ends, True
    if clocks == {"date", "day"}:
        day = 86400.0
        if points.clock == "date":
            at = at - day * np.floor(np.nanmin(at) / day)
        else:
            first = day * np.floor(starts[0] / day)
            starts, ends = starts - first, ends - first
        return at, starts, ends, True
    return at - np.nanmin(at), starts - log.seconds[0], ends - log.seconds[0], False


def _windows_by_time(
    starts: Array, ends: Array, *, exact: bool
) -> tuple[Callable[[Array], NDArray[np.int_]], tuple[Array, Array]]:
    """A callable: the window that each of times ``(n,)`` falls into, -1 where none; and when windows begin and end.

    Args:
        exact: whether windows are moments: then that one which is nearest, within half the way to its neighbours.
    """
    last = len(starts) - 1
    if not exact:

        def around(at: Array) -> NDArray[np.int_]:
            k = np.clip(np.searchsorted(starts, at, side="right") - 1, 0, last)
            return np.where((at >= starts[k]) & (at <= ends[k]), k, -1)

        return around, (starts, ends)
    gap = float(np.median(np.diff(starts))) if last else np.inf
    moments, rows = np.unique(starts, return_index=True)

    def nearest(at: Array) -> NDArray[np.int_]:
        after = np.minimum(np.searchsorted(moments, at), len(moments) - 1)
        before = np.maximum(after - 1, 0)
        k = np.where(np.abs(at - moments[before]) <= np.abs(moments[after] - at), before, after)
        return np.where(np.abs(at - moments[k]) <= gap / 2, rows[k], -1)

    reach = np.full(len(moments), max(gap if np.isfinite(gap) else 0.0, 0.0) / 2)
    before, after = reach.copy(), reach.copy()
    before[1:] = after[:-1] = np.minimum(np.diff(moments) / 2, reach[1:])
    return nearest, (moments - before, moments + after)


def _timed_poses(
    options: ImportOptions, points: TrackerPoints, waypoints: _Windows, where: NDArray[np.int_]
) -> "list[_MatchedPose]":
    each, poses = len(options.targets), list[_MatchedPose]()
    for k, rows in _rows_of_windows(where):
        if len(rows) % each:
            lines = ", ".join(str(points.lines[i]) for i in rows[:8])
            raise LabError(
                f"{points.path}: {len(rows)} points (lines {lines}) were measured at one pose, which has "
                f"{', '.join(options.targets)}; give --targets as they were measured, or remove the others"
            )
        for n in range(0, len(rows), each):
            poses.append(_MatchedPose(_pose_name(points, rows[n], len(poses)), waypoints.joints[k],
                                     _in_turn(options, rows[n : n + each])))  # fmt: skip
    return poses


def _rows_of_windows(where: NDArray[np.int_]) -> list[tuple[int, list[int]]]:
    """The windows that points ``(n,)`` fall into, in order, and the points of each in theirs."""
    inside = np.flatnonzero(where >= 0)
    order = inside[np.argsort(where[inside], kind="stable")]
    windows, firsts = np.unique(where[order], return_index=True)
    rows = np.split(order, firsts[1:])
    return [(int(k), some.tolist()) for k, some in zip(windows, rows, strict=True)]
