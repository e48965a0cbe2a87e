"""Trajectories of the joints: moves between points at given speeds, and paths past via points.

Every law keeps the chain's limits of joint position, speed and acceleration. It is made of phases of constant
acceleration; of a chain whose jerks are limited of phases of constant jerk, within these limits, too. Joint positions
are in rad or m, times in s.
"""

import math
from collections.abc import Callable, Sequence

import numpy as np

from lab.core.errors import LabError
from lab.core.se3 import Array
from lab.kinematics.joints import JointSpec
from lab.kinematics.trajectory.double_s import SmoothAxis, mixed, quickest_smooth_ramps, rest_to_rest_smooth
from lab.kinematics.trajectory.profiles import (
    EXACT,
    SLACK,
    Axis,
    Span,
    Trajectory,
    check_rates,
    check_within,
    joined,
    lasts,
    possible_spans,
    quickest_ramps,
    rest_to_rest,
    rounding_seconds,
    stretches_and_blends,
)

__all__ = ["blended", "common_phases", "independent", "own_phases", "possible_seconds", "through"]

Law = Callable[[JointSpec, Array, Array, Array, Array], Trajectory]
"""A move from start to end, at a start speed and an end speed, ``(n,)`` each."""


def possible_seconds(
    chain: JointSpec, start: Array, end: Array, start_speed: Array | None = None, end_speed: Array | None = None
) -> list[Span]:
    """The durations that ``own_phases`` can have, as spans (from, to) in rising order; the last one goes to infinity.

    Args and errors are those of ``own_phases``.
    """
    move = _move(chain, start, end, start_speed, end_speed)
    return possible_spans(_axes(chain, *move) if chain.jerk is None else _smooth_axes(chain, *move))


def own_phases(
    chain: JointSpec,
    start: Array,
    end: Array,
    start_speed: Array | None = None,
    end_speed: Array | None = None,
    seconds: float | None = None,
) -> Trajectory:
    """A move in which all joints start and stop together, each with phases of its own.

    Args:
        start, end: joint positions ``(n,)``.
        start_speed, end_speed: ``(n,)``, zero unless given.
        seconds: how long it is to take, instead of the least that is possible for all joints.

    Raises:
        LabError: a point, a speed or a limit that cannot be used, a duration that is not possible, or a joint that
            would leave its limits on the way.
    """
    points, speeds = _move(chain, start, end, start_speed, end_speed)
    limited, axes = _smooth_axes(chain, points, speeds), _axes(chain, points, speeds)
    spans = possible_spans(axes if chain.jerk is None else limited)
    lasting = spans[0][0] if seconds is None else seconds
    if not (lasts(spans, lasting) and lasting < math.inf):
        raise LabError(f"the move cannot take {lasting:g} s; give {_durations(spans)}")
    if chain.jerk is None:
        found = _lasting(chain, axes, points[0], speeds, lasting)
    else:
        durations, ramps, jerks = mixed([axis.profiles(lasting) for axis in limited])
        found = Trajectory(durations, ramps, points[0], speeds[0], jerks)
    check_within(chain, found)
    return found


def _lasting(chain: JointSpec, axes: Sequence[Axis], start: Array, speeds: Array, lasting: float) -> Trajectory:
    """The move that takes a duration that is possible for all joints, with the full accelerations."""
    cruises = np.array([axis.cruise(lasting) for axis in axes])
    changes = np.array([cruises - speeds[0], speeds[1] - cruises])
    first, last = np.abs(changes) / chain.acceleration
    slowing = lasting - last
    knots = np.unique(np.concatenate([[0.0], first, slowing, [lasting]]))
    knots = knots[np.append(True, np.diff(knots) > SLACK * lasting)]
    knots[-1] = lasting
    middle = 0.5 * (knots[:-1] + knots[1:])[:, None]
    signs = np.where(middle < first, np.sign(changes[0]), np.where(middle > slowing, np.sign(changes[1]), 0.0))
    return Trajectory(np.diff(knots), signs * chain.acceleration, start, speeds[0])


def _durations(spans: Sequence[Span]) -> str:
    """Durations in words, rounded so that they are possible."""
    rounded = [(f"{math.ceil(1e6 * low) / 1e6:.6f}", high) for low, high in spans]
    bounded = "".join(f"{low} to {math.floor(1e6 * high) / 1e6:.6f} s, or " for low, high in rounded[:-1])
    return f"{bounded}{rounded[-1][0]} s or more"


def common_phases(
    chain: JointSpec, start: Array, end: Array, start_speed: Array | None = None, end_speed: Array | None = None
) -> Trajectory:
    """The quickest move whose phases tau, u - tau, tau all joints have in common: straight if at rest at both ends.

    At rest in closed form, else by ``quickest_ramps``, which tries every duration that could be the least one; with
    limits of jerk by ``quickest_smooth_ramps``, which searches. Args and errors are those of ``own_phases``.
    """
    points, (v0, vf) = _move(chain, start, end, start_speed, end_speed)
    moved, limits = points[1] - points[0], (chain.speed, chain.acceleration)
    at_rest = not (v0.any() or vf.any())
    if chain.jerk is None:
        tau, u = rest_to_rest(moved, *limits) if at_rest else quickest_ramps(moved, v0, vf, *limits)
    elif at_rest:
        tau, u = rest_to_rest_smooth(moved, *limits, chain.jerk)
    else:
        tau, u = quickest_smooth_ramps(moved, (v0, vf), (*limits, chain.jerk))
    cruise = (moved - 0.5 * (v0 + vf) * tau) / u if u > 0 else v0
    ramps = np.array([cruise - v0, np.zeros_like(v0), vf - cruise])
    found = _in_phases(chain, np.array([tau, u - tau, tau]), ramps, points[0], v0)
    check_within(chain, found)
    return found


def independent(
    chain: JointSpec, start: Array, end: Array, start_speed: Array | None = None, end_speed: Array | None = None
) -> Trajectory:
    """A move from rest to rest in which each joint is as quick as it can be alone: they start together, and stop apart.

    Args and errors are those of ``own_phases``; speeds at the ends have to be zero.
    """
    points, speeds = _move(chain, start, end, start_speed, end_speed)
    if speeds.any():
        raise LabError("joints that are not synchronised move from rest to rest; leave out the speeds at the ends")
    axes = _smooth_axes(chain, points, speeds)
    durations, ramps, jerks = mixed([axis.profiles(axis.spans()[0][0]) for axis in axes])
    return Trajectory(durations, ramps, points[0], speeds[0], None if chain.jerk is None else jerks)


def through(chain: JointSpec, points: Array, speeds: Array, law: Law = common_phases) -> Trajectory:
    """A path through via points, each passed exactly and at the speed that is asked for.

    Args:
        points: joint positions ``(m, n)``, with the start and the end.
        speeds: ``(m, n)`` there.
        law: of the moves between, ``common_phases`` or ``own_phases``.

    Raises:
        LabError: as ``own_phases``.
    """
    points, speeds = _checked(chain, points, speeds)
    return joined([law(chain, *points[i : i + 2], *speeds[i : i + 2]) for i in range(len(points) - 1)])


def blended(chain: JointSpec, points: Array, error: Array | float) -> Trajectory:
    """A path that passes near via points, from rest to rest: stretches of constant speed, joined by parabolic blends.

    With limits of jerk the speed changes in double S shapes in these, which miss the point by less.
    A stretch is only as fast as the blends at its ends allow all along, so that a path with sharp turns and a small
    error is quicker if it stops at its via points; and this is not the quickest path of its kind.

    Args:
        points: joint positions ``(m, n)``, with the start and the end, which are met exactly.
        error: the largest deviation of each joint at the via points, ``(n,)`` or one for all, rad or m.

    Raises:
        LabError: a point, an error or a limit that cannot be used.
    """
    points, speeds = _checked(chain, points, np.zeros((len(points), chain.size)))
    allowed = np.asarray(error, dtype=np.float64)
    if allowed.shape not in ((), (chain.size,)) or not (np.isfinite(allowed) & (allowed > 0)).all():
        raise LabError(f"the error at via points is {error}; give a finite one above zero, or one for each joint")
    moved = np.diff(points, axis=0)
    if (still := ~moved.any(axis=1)).any():
        i = int(np.argmax(still))
        raise LabError(f"{_where(i, len(points))} and {_where(i + 1, len(points))} are the same; leave one out")
    changes, durations = stretches_and_blends(moved, allowed, chain.speed, chain.acceleration, chain.jerk)
    ramps = np.zeros((len(durations), chain.size))
    ramps[::2] = changes
    return _in_phases(chain, durations, ramps, points[0], speeds[0])


def _in_phases(chain: JointSpec, durations: Array, ramps: Array, start: Array, start_speed: Array) -> Trajectory:
    """A trajectory in which speeds change by ``ramps`` ``(m, n)``, without those that only rounding has made."""
    lasting = durations > SLACK * durations.sum()
    each, ramps = durations[lasting], ramps[lasting]
    rounding = (
        np.zeros_like(each) if chain.jerk is None else rounding_seconds(each, (np.abs(ramps) / chain.jerk).max(1))
    )
    level = ramps / (each - rounding)[:, None]
    level = np.clip(level, -chain.acceleration, chain.acceleration)  # what rounding has added
    if chain.jerk is None:
        return Trajectory(each, level, start, start_speed)
    rounded = (rounding > 0)[:, None]
    hard, none = np.where(rounded, level / np.where(rounded, rounding[:, None], 1.0), 0.0), np.zeros_like(level)
    three = np.stack([rounding, each - 2 * rounding, rounding], axis=1).ravel()
    retained = three > SLACK * durations.sum()
    accelerations, jerks = np.stack([none, level, level], axis=1), np.stack([hard, none, -hard], axis=1)
    shape = (len(three), len(start))
    return Trajectory(
        three[retained], accelerations.reshape(shape)[retained], start, start_speed, jerks.reshape(shape)[retained]
    )


def _axes(chain: JointSpec, points: Array, speeds: Array) -> list[Axis]:
    """Return each joint's motion between two points."""
    rows = np.stack([points[1] - points[0], *speeds, chain.speed, chain.acceleration], axis=1)
    return [Axis(*row) for row in rows.tolist()]


def _smooth_axes(chain: JointSpec, points: Array, speeds: Array) -> list[SmoothAxis]:
    """Return each joint's motion between two points, with its largest jerk, infinite where there is none."""
    jerk = np.full(chain.size, np.inf) if chain.jerk is None else chain.jerk
    rows = np.stack([points[1] - points[0], *speeds, chain.speed, chain.acceleration, jerk], axis=1)
    return [SmoothAxis(*row) for row in rows.tolist()]


def _move(
    chain: JointSpec, start: Array, end: Array, start_speed: Array | None, end_speed: Array | None
) -> tuple[Array, Array]:
    """The points and speeds ``(2, n)`` of a move, checked."""
    speeds = [np.zeros(chain.size) if speed is None else speed for speed in (start_speed, end_speed)]
    return _checked(chain, [start, end], speeds)


def _checked(chain: JointSpec, points: Sequence[Array] | Array, speeds: Sequence[Array] | Array) -> tuple[Array, Array]:
    """Points and the speeds there ``(m, n)``, if the chain can have them: the one place where all of it is checked.

    Raises:
        LabError: what does not fit or is beyond a limit, and where.
    """
    check_rates(chain.joint_names, chain.speed, chain.acceleration, chain.jerk)
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
    """Return the description of a point."""
    return {0: "the start", count - 1: "the end"}.get(i, f"via point {i}")
