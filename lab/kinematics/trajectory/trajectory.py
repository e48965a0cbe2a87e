"""Trajectories of the joints: moves between points at given speeds, and paths through or near via points.

Every law keeps the chain's limits of joint position, speed and acceleration, by phases of constant acceleration. Joint
positions are in rad or m, times in s.
"""

from collections.abc import Callable, Sequence

import numpy as np

from lab.core.errors import LabError
from lab.core.se3 import Array
from lab.kinematics.joints import JointSpec
from lab.kinematics.trajectory.profiles import (
    EXACT,
    SLACK,
    Axis,
    Trajectory,
    check_rates,
    check_within,
    joined,
    possible_spans,
    quickest_ramps,
    rest_to_rest,
    stretches_and_blends,
)

__all__ = [
    "blended",
    "common_phases",
    "independent",
    "own_phases",
    "through",
    "unsynchronised",
]


_Law = Callable[[JointSpec, Array, Array, Array, Array], Trajectory]
"""A move from start to end, at a start speed and an end speed, ``(n,)`` each."""


def own_phases(
    chain: JointSpec, start: Array, end: Array, start_speed: Array | None = None, end_speed: Array | None = None
) -> Trajectory:
    """Return the quickest move in which all joints start and stop together, each with phases of its own.

    Args:
        start, end: joint positions ``(n,)``.
        start_speed, end_speed: ``(n,)``, zero by default.
    """
    points, speeds = _move(chain, start, end, start_speed, end_speed)
    axes = _axes(chain, points, speeds)
    shortest = possible_spans(axes)[0][0]
    found = _lasting(chain, axes, points[0], speeds, np.full(chain.size, shortest))
    check_within(chain, found)
    return found


def _changes(axes: Sequence[Axis], lasting: Array) -> Array:
    """Return the changes of speed ``(2, n)``, to and from the cruise speed, of joints that take ``(n,)`` s."""
    cruises = np.array([axis.cruise(seconds) for axis, seconds in zip(axes, lasting.tolist(), strict=True)])
    return np.array([cruises - [axis.start_speed for axis in axes], [axis.end_speed for axis in axes] - cruises])


def _quickest(axes: Sequence[Axis]) -> Array:
    """Return the shortest duration ``(n,)`` of each joint alone."""
    return np.array([axis.spans()[0][0] for axis in axes])


def _lasting(chain: JointSpec, axes: Sequence[Axis], start: Array, speeds: Array, lasting: Array) -> Trajectory:
    """Return the move of possible durations ``(n,)`` of the joints, at full accelerations."""
    changes, whole = _changes(axes, lasting), float(lasting.max())
    first, last = np.abs(changes) / chain.acceleration
    slowing = lasting - last
    knots = np.unique(np.concatenate([[0.0], first, slowing, lasting]))
    knots = knots[np.append(True, np.diff(knots) > SLACK * whole)]
    knots[-1] = whole
    middle = 0.5 * (knots[:-1] + knots[1:])[:, None]
    slows = (middle > slowing) & (middle < lasting)
    signs = np.where(middle < first, np.sign(changes[0]), np.where(slows, np.sign(changes[1]), 0.0))
    return Trajectory(np.diff(knots), signs * chain.acceleration, start, speeds[0])


def common_phases(
    chain: JointSpec, start: Array, end: Array, start_speed: Array | None = None, end_speed: Array | None = None
) -> Trajectory:
    """Return the quickest move with common phases tau, u - tau, tau of all joints: straight from rest to rest.

    At rest in closed form, else by ``quickest_ramps``.
    """
    points, (v0, vf) = _move(chain, start, end, start_speed, end_speed)
    moved, limits = points[1] - points[0], (chain.speed, chain.acceleration)
    at_rest = not (v0.any() or vf.any())
    tau, u = rest_to_rest(moved, *limits) if at_rest else quickest_ramps(moved, v0, vf, *limits)
    cruise = (moved - 0.5 * (v0 + vf) * tau) / u if u > 0 else v0
    ramps = np.array([cruise - v0, np.zeros_like(v0), vf - cruise])
    found = _in_phases(chain, np.array([tau, u - tau, tau]), ramps, points[0], v0)
    check_within(chain, found)
    return found


def independent(
    chain: JointSpec, start: Array, end: Array, start_speed: Array | None = None, end_speed: Array | None = None
) -> Trajectory:
    """Return a move from rest to rest, each joint at its own quickest: they start together, and stop apart."""
    points, speeds = _move(chain, start, end, start_speed, end_speed)
    if speeds.any():
        raise LabError("joints that are not synchronised move from rest to rest; leave out the speeds at the ends")
    axes = _axes(chain, points, speeds)
    return _lasting(chain, axes, points[0], speeds, _quickest(axes))


def unsynchronised(
    chain: JointSpec, start: Array, end: Array, start_speed: Array | None = None, end_speed: Array | None = None
) -> Array:
    """Return the phases ``(n, 3)`` s of each joint's own quickest move: change of speed, cruise, change of speed.

    These are the times before the joints are synchronised (Mallem 2011, section 10.2, step 2). A row's sum is the
    shortest time of that joint; the joint with the largest one constrains the move.

    Args:
        start, end: joint positions ``(n,)``.
        start_speed, end_speed: ``(n,)``, zero by default.
    """
    axes = _axes(chain, *_move(chain, start, end, start_speed, end_speed))
    quickest = _quickest(axes)
    first, last = np.abs(_changes(axes, quickest)) / chain.acceleration
    cruising = quickest - first - last
    return np.stack([first, np.where(cruising > SLACK * quickest, cruising, 0.0), last], axis=1)


def through(chain: JointSpec, points: Array, speeds: Array, law: _Law = common_phases) -> Trajectory:
    """Return a path through via points, exactly and at the given speeds.

    Args:
        points: joint positions ``(m, n)``, with the start and the end.
        speeds: ``(m, n)``.
        law: of the moves between, ``common_phases`` or ``own_phases``.
    """
    points, speeds = _checked(chain, points, speeds)
    return joined([law(chain, *points[i : i + 2], *speeds[i : i + 2]) for i in range(len(points) - 1)])


def blended(chain: JointSpec, points: Array, error: Array | float) -> Trajectory:
    """Return a path near via points, from rest to rest: stretches of constant speed, joined by parabolic blends.

    A stretch is as fast as the blends at its ends allow; with sharp turns and a small error, stops at the via points
    are quicker.

    Args:
        points: joint positions ``(m, n)``, with the start and the end, which are exact.
        error: largest deviation of each joint at the via points, ``(n,)`` or one for all, rad or m.
    """
    points, speeds = _checked(chain, points, np.zeros((len(points), chain.size)))
    allowed = np.asarray(error, dtype=np.float64)
    if allowed.shape not in ((), (chain.size,)) or not (np.isfinite(allowed) & (allowed > 0)).all():
        raise LabError(f"the error at via points is {error}; give a finite one above zero, or one for each joint")
    moved = np.diff(points, axis=0)
    if (still := ~moved.any(axis=1)).any():
        i = int(np.argmax(still))
        raise LabError(f"{_where(i, len(points))} and {_where(i + 1, len(points))} are the same; leave one out")
    changes, durations = stretches_and_blends(moved, allowed, chain.speed, chain.acceleration)
    ramps = np.zeros((len(durations), chain.size))
    ramps[::2] = changes
    return _in_phases(chain, durations, ramps, points[0], speeds[0])


def _in_phases(chain: JointSpec, durations: Array, ramps: Array, start: Array, start_speed: Array) -> Trajectory:
    """Return a trajectory with changes of speed ``ramps`` ``(m, n)``, without phases from rounding."""
    lasting = durations > SLACK * durations.sum()
    each = durations[lasting]
    level = ramps[lasting] / each[:, None]
    level = np.clip(level, -chain.acceleration, chain.acceleration)  # what rounding has added
    return Trajectory(each, level, start, start_speed)


def _axes(chain: JointSpec, points: Array, speeds: Array) -> list[Axis]:
    rows = np.stack([points[1] - points[0], *speeds, chain.speed, chain.acceleration], axis=1)
    return [Axis(*row) for row in rows.tolist()]


def _move(
    chain: JointSpec, start: Array, end: Array, start_speed: Array | None, end_speed: Array | None
) -> tuple[Array, Array]:
    speeds = [np.zeros(chain.size) if speed is None else speed for speed in (start_speed, end_speed)]
    return _checked(chain, [start, end], speeds)


def _checked(chain: JointSpec, points: Sequence[Array] | Array, speeds: Sequence[Array] | Array) -> tuple[Array, Array]:
    """Check points and speeds ``(m, n)`` against the limits, and return them."""
    check_rates(chain.joint_names, chain.speed, chain.acceleration)
    if len(points) < 2 or len(speeds) != len(points):
        raise LabError(f"{len(points)} points and {len(speeds)} speeds: give at least two points, and speeds for each")
    for i, rows in enumerate(zip(points, speeds, strict=True)):
        where = _where(i, len(points))
        for what, row in zip(("readings", "speeds"), rows, strict=True):
            if np.shape(row) != (chain.size,):
                raise LabError(f"{where}: {what} have shape {np.shape(row)}; give {chain.size} of them")
            if not np.isfinite(row).all():
                raise LabError(f"{where}: {what} are not all finite; give a number for each joint")
        reading, speed = rows
        if (beyond := chain.beyond_limits(reading, EXACT)).any():
            j = int(np.argmax(beyond))
            raise LabError(f"{where}: {chain.limit_note(j, reading[j])}; move it within them")
        if (beyond := np.abs(speed) > chain.speed * (1 + SLACK)).any():
            j = int(np.argmax(beyond))
            raise LabError(
                f"{where}: joint {chain.joint_names[j]} is to move at {chain.shown(j, speed[j])}/s; its largest "
                f"speed is {chain.shown(j, chain.speed[j])}/s"
            )
    return np.array(points, dtype=np.float64), np.clip(np.array(speeds, dtype=np.float64), -chain.speed, chain.speed)


def _where(i: int, count: int) -> str:
    return {0: "the start", count - 1: "the end"}.get(i, f"via point {i}")
