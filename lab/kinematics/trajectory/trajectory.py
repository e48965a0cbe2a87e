"""Trajectories of the joints: moves between points at given speeds, and paths past via points.

Every law is made of phases of constant acceleration, and keeps the chain's limits of joint position, speed and
acceleration. Joint positions are in rad or m, times in s.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np

from lab.core.errors import LabError
from lab.core.se3 import Array
from lab.kinematics.joints import JointSpec
from lab.kinematics.trajectory.profiles import (
    SLACK,
    Axis,
    Span,
    check_rates,
    lasts,
    possible_spans,
    quickest_ramps,
    rest_to_rest,
    stretches_and_blends,
)

__all__ = [
    "Trajectory",
    "blended",
    "check_within",
    "common_phases",
    "independent",
    "joined",
    "own_phases",
    "possible_seconds",
    "through",
]

EXACT = 1e-9  # rad or m, or per s: by how much a joint position may pass its limit, or two ends miss each other

Law = Callable[[JointSpec, Array, Array, Array, Array], "Trajectory"]
"""A move from start to end, at a start speed and an end speed, ``(n,)`` each."""


@dataclass(frozen=True)
class Trajectory:
    """How n joints move in m phases of constant acceleration.

    Attributes:
        durations: ``(m,)`` s.
        accelerations: ``(m, n)`` rad/s^2 or m/s^2.
        start: ``(n,)`` joint positions, rad or m.
        start_speed: ``(n,)`` rad/s or m/s.
    """

    durations: Array
    accelerations: Array
    start: Array
    start_speed: Array

    def __post_init__(self) -> None:
        shape = (len(self.durations), len(self.start))
        assert self.accelerations.shape == shape and self.start_speed.shape == shape[1:]
        assert (self.durations >= 0).all() and np.isfinite(self.durations).all()
        assert all(np.isfinite(values).all() for values in (self.accelerations, self.start, self.start_speed))

    @cached_property
    def knots(self) -> tuple[Array, Array, Array]:
        """Times ``(m + 1,)``, joint positions and speeds ``(m + 1, n)`` between the phases and at the ends."""
        each = self.durations[:, None]
        speeds = np.cumsum(np.vstack([self.start_speed, self.accelerations * each]), axis=0)
        moves = (speeds[:-1] + 0.5 * self.accelerations * each) * each
        return np.append(0.0, np.cumsum(self.durations)), np.cumsum(np.vstack([self.start, moves]), axis=0), speeds

    @property
    def seconds(self) -> float:
        """How long it takes."""
        return float(self.knots[0][-1])

    @property
    def end(self) -> Array:
        """Joint positions ``(n,)`` at the end."""
        return np.asarray(self.knots[1][-1])

    @property
    def end_speed(self) -> Array:
        """Speeds ``(n,)`` at the end."""
        return np.asarray(self.knots[2][-1])

    @property
    def peak_speed(self) -> Array:
        """The largest magnitudes ``(n,)`` of the speeds."""
        return np.asarray(np.abs(self.knots[2]).max(axis=0))

    @property
    def peaks(self) -> tuple[Array, Array]:
        """The largest magnitudes ``(n,)`` of the speeds and of the accelerations."""
        return self.peak_speed, np.asarray(np.abs(self.accelerations).max(axis=0, initial=0.0))

    @property
    def extremes(self) -> tuple[Array, Array]:
        """The lowest and the highest joint positions ``(n,)``, where joints turn back between the ends too."""
        _, positions, speeds = self.knots
        reverses = speeds[:-1] * speeds[1:] < 0
        turning = positions[:-1] - 0.5 * speeds[:-1] ** 2 / np.where(reverses, self.accelerations, 1.0)
        passed = np.vstack([positions, np.where(reverses, turning, positions[:-1])])
        return passed.min(axis=0), passed.max(axis=0)

    def at(self, times: Array) -> tuple[Array, Array, Array]:
        """Joint positions, speeds and accelerations ``(k, n)`` at times ``(k,)`` since the start.

        Before the start all is as at the start, and after the end as at the end. Between two phases the acceleration
        is the next one's; from the end on it is zero.
        """
        knots, positions, speeds = self.knots
        held = np.clip(times, 0.0, self.seconds)
        phase = np.searchsorted(knots, held, side="right") - 1
        since = (held - knots[phase])[:, None]
        acceleration = np.vstack([self.accelerations, np.zeros_like(self.start)])[phase]
        speed = speeds[phase] + acceleration * since
        return positions[phase] + 0.5 * (speeds[phase] + speed) * since, speed, acceleration


def joined(parts: Sequence[Trajectory]) -> Trajectory:
    """One trajectory after the other.

    Raises:
        LabError: one begins elsewhere than the one before it ends, or at another speed.
    """
    for i, (first, second) in enumerate(pairwise(parts)):
        for what, end, start in (
            ("reading", first.end, second.start),
            ("speed", first.end_speed, second.start_speed),
        ):
            j = int(np.argmax(np.abs(end - start)))
            if abs(end[j] - start[j]) > EXACT:
                raise LabError(
                    f"trajectory {i + 2} begins where joint {j + 1} has a {what} of {start[j]:g}, but the one before "
                    f"it ends at {end[j]:g}; make them the same"
                )
    return Trajectory(
        np.concatenate([part.durations for part in parts]),
        np.concatenate([part.accelerations for part in parts]),
        parts[0].start,
        parts[0].start_speed,
    )


def possible_seconds(
    chain: JointSpec, start: Array, end: Array, start_speed: Array | None = None, end_speed: Array | None = None
) -> list[Span]:
    """The durations that ``own_phases`` can have, as spans (from, to) in rising order; the last one goes to infinity.

    Args and errors are those of ``own_phases``.
    """
    return possible_spans(_axes(chain, *_move(chain, start, end, start_speed, end_speed)))


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
    axes = _axes(chain, points, speeds)
    spans = possible_spans(axes)
    lasting = spans[0][0] if seconds is None else seconds
    if not (lasts(spans, lasting) and lasting < math.inf):
        raise LabError(f"the move cannot take {lasting:g} s; give {_told(spans)}")
    cruises = np.array([axis.cruise(lasting) for axis in axes])
    changes = np.array([cruises - speeds[0], speeds[1] - cruises])
    first, last = np.abs(changes) / chain.acceleration
    slowing = lasting - last
    knots = np.unique(np.concatenate([[0.0], first, slowing, [lasting]]))
    knots = knots[np.append(True, np.diff(knots) > SLACK * lasting)]
    knots[-1] = lasting
    middle = 0.5 * (knots[:-1] + knots[1:])[:, None]
    signs = np.where(middle < first, np.sign(changes[0]), np.where(middle > slowing, np.sign(changes[1]), 0.0))
    found = Trajectory(np.diff(knots), signs * chain.acceleration, points[0], speeds[0])
    check_within(chain, found)
    return found


def _told(spans: Sequence[Span]) -> str:
    """Durations in words, rounded so that they are possible."""
    rounded = [(f"{math.ceil(1e6 * low) / 1e6:.6f}", high) for low, high in spans]
    bounded = "".join(f"{low} to {math.floor(1e6 * high) / 1e6:.6f} s, or " for low, high in rounded[:-1])
    return f"{bounded}{rounded[-1][0]} s or more"


def common_phases(
    chain: JointSpec, start: Array, end: Array, start_speed: Array | None = None, end_speed: Array | None = None
) -> Trajectory:
    """The quickest move whose phases tau, u - tau, tau all joints have in common: straight if at rest at both ends.

    At rest in closed form, else by ``quickest_ramps``, which tries every duration that could be the least one.
    Args and errors are those of ``own_phases``.
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
    """A move from rest to rest in which each joint is as quick as it can be alone: they start together, and stop apart.

    Args and errors are those of ``own_phases``; speeds at the ends have to be zero.
    """
    points, speeds = _move(chain, start, end, start_speed, end_speed)
    if speeds.any():
        raise LabError("joints that are not synchronised move from rest to rest; leave out the speeds at the ends")
    moved = points[1] - points[0]
    tau, u = (np.array(each) for each in zip(*(
        rest_to_rest(moved[j : j + 1], chain.speed[j : j + 1], chain.acceleration[j : j + 1])
        for j in range(chain.size)), strict=True))  # fmt: skip
    knots = np.unique(np.concatenate([[0.0], tau, u, u + tau]))
    knots = knots[np.append(True, np.diff(knots) > SLACK * knots[-1])]
    middle = 0.5 * (knots[:-1] + knots[1:])[:, None]
    rising, falling = middle < tau, (middle > u) & (middle < u + tau)
    with np.errstate(divide="ignore", invalid="ignore"):
        size = np.where(moved != 0, moved / (u * tau), 0.0)
    return Trajectory(np.diff(knots), np.where(rising, size, np.where(falling, -size, 0.0)), points[0], speeds[0])


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
    changes, durations = stretches_and_blends(moved, allowed, chain.speed, chain.acceleration)
    ramps = np.zeros((len(durations), chain.size))
    ramps[::2] = changes
    return _in_phases(chain, durations, ramps, points[0], speeds[0])


def _in_phases(chain: JointSpec, durations: Array, ramps: Array, start: Array, start_speed: Array) -> Trajectory:
    """A trajectory in which speeds change by ``ramps`` ``(m, n)``, without those that only rounding has made."""
    lasting = durations > SLACK * durations.sum()
    accelerations = ramps[lasting] / durations[lasting, None]
    accelerations = np.clip(accelerations, -chain.acceleration, chain.acceleration)  # what rounding has added
    return Trajectory(durations[lasting], accelerations, start, start_speed)


def check_within(chain: JointSpec, trajectory: Trajectory) -> None:
    """Refuse a trajectory that leaves the limits of the joint positions between its ends.

    Raises:
        LabError: naming the joint that goes the farthest beyond.
    """
    lowest, highest = trajectory.extremes
    beyond = np.array([chain.lower - lowest, highest - chain.upper])
    side, j = divmod(int(np.argmax(beyond)), chain.size)
    if beyond[side, j] > EXACT:
        ends = f"from {chain.shown(j, trajectory.start[j])} to {chain.shown(j, trajectory.end[j])}"
        raise LabError(
            f"on its way {ends} {chain.said_beyond(j, (lowest, highest)[side][j])}; lower its speeds at the ends, or "
            "move these away from the limit"
        )


def _axes(chain: JointSpec, points: Array, speeds: Array) -> list[Axis]:
    """What each joint is to do between two points."""
    rows = np.stack([points[1] - points[0], *speeds, chain.speed, chain.acceleration], axis=1)
    return [Axis(*row) for row in rows.tolist()]


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
            raise LabError(f"{where}: {chain.said_beyond(j, reading[j])}; move it within them")
        if (beyond := np.abs(speed) > chain.speed * (1 + SLACK)).any():
            j = int(np.argmax(beyond))
            raise LabError(
                f"{where}: joint {chain.joint_names[j]} is to move at {chain.shown(j, speed[j])}/s; its largest "
                f"speed is {chain.shown(j, chain.speed[j])}/s"
            )
    return np.array(points, dtype=np.float64), np.clip(np.array(speeds, dtype=np.float64), -chain.speed, chain.speed)


def _where(i: int, count: int) -> str:
    """What a person calls a point."""
    return {0: "the start", count - 1: "the end"}.get(i, f"via point {i}")
