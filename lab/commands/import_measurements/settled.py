"""When a robot stood still, by a log of its joints over time."""

from dataclasses import dataclass

import numpy as np

from lab.core.errors import LabError
from lab.core.se3 import Array
from lab.formats.joint_log import JointLog

__all__ = ["Windows", "settled_windows"]

_SPAN_S = 0.4  # over which a speed is taken: shorter, and the steps of an encoder look like motion
_ROWS = 2.5  # steps of a log that a speed is taken over at least, where it has few rows a second
_FEWEST = 3  # rows of a window


@dataclass(frozen=True)
class Windows:
    """Times at which the arm stood still.

    Attributes:
        starts, ends: ``(k,)`` s, of the log's clock.
        joints: ``(k, joints)`` rad or m: the mean of the rows of each.
        lines: ``(k,)`` of the first row of each, as an editor counts.
    """

    starts: Array
    ends: Array
    joints: Array
    lines: tuple[int, ...]

    def __len__(self) -> int:
        return len(self.starts)


def settled_windows(log: JointLog, prismatic: tuple[bool, ...], still: float, least_s: float) -> Windows:
    """Find the windows in which every joint moves more slowly than a bound.

    The speed at a row is the change of a joint over 0.4 s about it (in a log of few rows a second: from the row before
    to the row after), so that the steps of an encoder are no motion. It rises half of that before the arm moves, which
    keeps the ends of a window clear of the motion.

    Args:
        log: with times in every row.
        prismatic: which joints slide.
        still: the largest speed of a joint that stands, degrees per s, mm per s of a slide.
        least_s: the shortest window.

    Raises:
        LabError: times are missing or fall, or the arm never stands.
    """
    times = log.seconds
    for i in np.flatnonzero(~np.isfinite(times)):
        raise LabError(f"{log.path}: line {log.lines[i]}: the time is missing; a log needs one in every row")
    for i in np.flatnonzero(np.diff(times) < 0):
        raise LabError(f"{log.path}: line {log.lines[i + 1]}: the time falls; give the rows in their order")
    span = max(_SPAN_S, _ROWS * float(np.median(np.diff(times)))) if len(times) > 1 else _SPAN_S
    before = np.searchsorted(times, times - span / 2, side="left")
    after = np.searchsorted(times, times + span / 2, side="right") - 1
    apart = np.maximum(times[after] - times[before], 1e-9)[:, None]
    unit = np.where(prismatic, 1e-3, np.pi / 180)
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
    return Windows(
        np.array([times[first] for first, _ in spans]),
        np.array([times[last - 1] for _, last in spans]),
        np.array([log.joints[first:last].mean(axis=0) for first, last in spans]),
        tuple(log.lines[first] for first, _ in spans),
    )
