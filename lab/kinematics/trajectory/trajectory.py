"""Trajectories of the joints: moves between points at given speeds, and paths through or near via points.

Every law keeps the chain's limits of joint position, speed and acceleration, by phases of constant acceleration, or of
constant jerk if the chain has limits of jerk. Double S profiles change between any speeds without acceleration at the
ends; their durations agree with those of Berscheid & Kroeger (2021, ruckig). Joint positions are in rad or m, times in
s.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy  # its parts are loaded at their first use, which not every process comes to

from lab.core.errors import LabError
from lab.core.se3 import Array
from lab.kinematics.joints import JointSpec
from lab.kinematics.trajectory.profiles import (
    EXACT,
    SLACK,
    TINY,
    Axis,
    Span,
    Trajectory,
    change_seconds,
    check_rates,
    check_within,
    joined,
    lasts,
    possible_spans,
    quickest_ramps,
    rest_to_rest,
    rounding_seconds,
    shortest_changes,
    stretches_and_blends,
)

__all__ = [
    "SmoothAxis",
    "blended",
    "common_phases",
    "independent",
    "own_phases",
    "possible_seconds",
    "through",
    "unsynchronised",
]

_ROUNDS, _GRID, _DECADES, _HALVINGS = 5, 49, 16.0, 48  # of the search for common phases


@dataclass(frozen=True)
class _Profile:
    """Motion of one joint in m phases.

    Attributes:
        durations: ``(m,)`` s.
        accelerations: ``(m,)`` at the start of each phase.
        jerks: ``(m,)``.
    """

    durations: Array
    accelerations: Array
    jerks: Array

    def at(self, knots: Array) -> tuple[Array, Array]:
        """Return accelerations at the start and jerks of spans between times ``(k + 1,)``, each within one phase."""
        own = np.append(0.0, np.cumsum(self.durations))
        phase = np.searchsorted(own, 0.5 * (knots[:-1] + knots[1:]), side="right") - 1
        still = phase >= len(self.durations)  # it has stopped before
        phase = np.minimum(phase, len(self.durations) - 1)
        jerks = np.where(still, 0.0, self.jerks[phase])
        return np.where(still, 0.0, self.accelerations[phase] + jerks * (knots[:-1] - own[phase])), jerks


def _rest_to_rest_smooth(moved: Array, speed: Array, acceleration: Array, jerk: Array) -> tuple[float, float]:
    """Return the quickest common phases tau, u - tau, tau of joints at rest, each tau a double S.

    With r = max |D| / a and h = max |D| / j a ramp takes r / u + h / r, or 2 sqrt(h / u) without reaching its
    acceleration. u is the least for which all joints reach their cruise speed D / u.

    Args:
        moved: D ``(n,)``.
        speed, acceleration, jerk: limits ``(n,)``.
    """
    far = np.abs(moved)
    cruised, pulls, jerks = (float((far / rate).max()) for rate in (speed, acceleration, jerk))
    if pulls == 0:
        return 0.0, 0.0
    part = jerks / pulls
    u = 0.5 * (part + math.sqrt(part**2 + 4 * pulls))
    if u * jerks > pulls**2:
        u = float(np.cbrt(4 * jerks))
    u = max(u, cruised)
    return float(shortest_changes(np.array(pulls / u), np.array(jerks / u))), u


def _quickest_smooth_ramps(
    moved: Array, ends: tuple[Array, Array], limits: tuple[Array, Array, Array]
) -> tuple[float, float]:
    """Return the quickest common phases tau, u - tau, tau of joints with any end speeds, to about 1e-6.

    It searches over tau. For a given tau the limits are convex in 1 / u: with the jerk of a ramp lasting tau - e, e
    must be at least |dV| / a, and (tau - e) e at least |dV| / j, which is best at max(|dV| / a, tau / 2).

    Args:
        moved: D ``(n,)``, not all zero if the speeds are.
        ends: speeds ``(n,)`` at the start and at the end.
        limits: of speed, acceleration and jerk ``(n,)``.
    """
    speed, acceleration, jerk = limits
    mean = 0.5 * (ends[0] + ends[1])
    longest = math.log((np.abs(moved) / speed + 4 * speed / acceleration + np.sqrt(8 * speed / jerk)).max())

    def excess(tau: Array, rate: Array) -> Array:
        """Return a number below zero for moves with tau and 1 / u ``(k,)`` within all limits."""
        cruise = (moved - mean * tau[:, None]) * rate[:, None]
        worst = (np.abs(cruise) / speed).max(axis=1) - 1
        for end in ends:
            change = np.abs(cruise - end)
            even = np.maximum((change / acceleration).max(axis=1), 0.5 * tau)
            worst = np.maximum(worst, ((change / jerk).max(axis=1) - even * (tau - even)) / tau**2)
        return np.asarray(worst)

    span, best = (longest - _DECADES, longest), (math.inf, 0.0, 0.0)
    for _ in range(_ROUNDS):
        tau = np.exp(np.linspace(*span, _GRID))
        low, high = np.zeros(_GRID), 1 / tau
        for _ in range(_HALVINGS):  # where it is least
            third = (high - low) / 3
            left = excess(tau, low + third) < excess(tau, high - third)
            low, high = np.where(left, low, low + third), np.where(left, high - third, high)
        good, high = low, 1 / tau
        for _ in range(_HALVINGS):  # the largest 1 / u beyond
            middle = np.where(excess(tau, high) <= 0, high, 0.5 * (good + high))
            kept = excess(tau, middle) <= 0
            good, high = np.where(kept, middle, good), np.where(kept, high, middle)
        u = np.where(excess(tau, good) <= 0, 1 / np.maximum(good, TINY), np.inf)
        i = int(np.argmin(tau + u))
        best = min(best, (float(tau[i] + u[i]), float(tau[i]), float(u[i])))
        wide = (span[1] - span[0]) / (_GRID - 1)
        span = (math.log(best[1]) - wide, min(math.log(best[1]) + wide, longest))
    return best[1], best[2]


@dataclass(frozen=True)
class SmoothAxis:
    """Motion of one joint: change its speed, cruise, and change it again.

    In T seconds it moves by Dmin(T) to Dmax(T), and any distance between by a mixture of the two moves. Dmax rises with
    T, after a fall if both speeds are negative: below all limits but that of jerk its slope is w + j t1 t2 / 2, with
    the cruise speed w and half the times t1, t2 of the changes of speed. So Dmax rules out at most one open interval of
    durations, and so does Dmin.

    Attributes:
        moved: signed distance.
        start_speed, end_speed: signed speeds.
        speed, acceleration, jerk: limits above zero.
    """

    moved: float
    start_speed: float
    end_speed: float
    speed: float
    acceleration: float
    jerk: float

    @property
    def direct(self) -> float:
        """Shortest seconds of the change of speed."""
        return change_seconds(self.end_speed - self.start_speed, self.acceleration, self.jerk)

    def mirrored(self) -> "SmoothAxis":
        """Return the opposite motion."""
        return replace(self, moved=-self.moved, start_speed=-self.start_speed, end_speed=-self.end_speed)

    def spans(self) -> list[Span]:
        """Return the possible durations: one span without end, and at most one before it."""
        possible, start = list[Span](), self.direct
        for low, high in sorted([*self._too_near(), *self.mirrored()._too_near()]):
            if low >= start:
                possible.append((start, low))
            start = max(start, high)
        return [*possible, (start, math.inf)]

    def profiles(self, seconds: float) -> list[tuple[float, _Profile]]:
        """Return the farthest and the nearest move of a possible duration, with the share of each in this one."""
        far, near = self._farthest(seconds), -self.mirrored()._farthest(seconds)
        share = min(max((self.moved - near) / (far - near), 0.0), 1.0) if far > near else 1.0
        back = self.mirrored()._profile(seconds)
        turned = _Profile(back.durations, -back.accelerations, -back.jerks)
        return [(share, self._profile(seconds)), (1 - share, turned)]

    def _ramps(self, cruise: float) -> float:
        """Return the duration of the changes from the start speed to a cruise speed and from there to the end speed."""
        return sum(
            change_seconds(cruise - end, self.acceleration, self.jerk) for end in (self.start_speed, self.end_speed)
        )

    def _cruise(self, seconds: float) -> float:
        """Return the cruise speed of the move to Dmax, in at least ``direct`` seconds."""
        a, j = self.acceleration, self.jerk
        lower, upper = sorted((self.start_speed, self.end_speed))
        gap, reached = upper - lower, a * a / j  # by a change of ``reached`` the acceleration is
        if seconds >= self._ramps(self.speed):
            return self.speed
        if seconds >= self._ramps(upper + reached):
            more = 0.5 * (a * (seconds - 2 * a / j) - gap)
        elif gap >= reached or seconds >= self._ramps(lower + reached):  # y = sqrt(more), y^2 + 2 a y / sqrt(j) = ...
            far = max(a * seconds - gap, 0.0)
            more = max((far - reached) / (math.sqrt(far) + math.sqrt(reached)), 0.0) ** 2
        else:  # sqrt(more) + sqrt(more + gap) = half
            half = 0.5 * seconds * math.sqrt(j)
            more = max((half * half - gap) / max(2 * half, TINY), 0.0) ** 2
        return min(upper + max(more, 0.0), self.speed)

    def _farthest(self, seconds: float) -> float:
        """Return Dmax of a duration of at least ``direct``."""
        cruise, way, left = self._cruise(seconds), 0.0, seconds
        for end in (self.start_speed, self.end_speed):
            ramp = change_seconds(cruise - end, self.acceleration, self.jerk)
            way, left = way + 0.5 * (cruise + end) * ramp, left - ramp
        return way + cruise * left

    def _too_near(self) -> list[Span]:
        """Return the durations with Dmax < D, too short for the distance: one interval or none."""
        first, upper = self.direct, max(self.start_speed, self.end_speed)
        full = self._ramps(self.speed)  # from where on Dmax is a straight line

        def beyond(seconds: float) -> float:
            return self._farthest(seconds) - self.moved

        bottom = first
        if upper < 0:  # it is least before the cruise speed is zero
            bounds = (first, self._ramps(0.0))
            bottom = float(scipy.optimize.minimize_scalar(beyond, bounds=bounds, method="bounded").x)
        if beyond(bottom) >= -SLACK * (abs(self.moved) + self.speed * bottom):
            return []
        short = beyond(full)
        high = full - short / self.speed if short <= 0 else _root(beyond, bottom, full)
        return [(_root(beyond, first, bottom) if bottom > first and beyond(first) > 0 else -math.inf, high)]

    def _profile(self, seconds: float) -> _Profile:
        a, j = self.acceleration, self.jerk
        cruise = self._cruise(seconds)
        phases = list[tuple[float, float, float]]()
        for change in (cruise - self.start_speed, self.end_speed - cruise):
            size, sign = abs(change), math.copysign(1.0, change)
            reached = size > 0 and size * j >= a * a
            rounding = a / j if reached else math.sqrt(size / j)
            level = a if reached else rounding and j * rounding
            even = size / a - rounding if reached else 0.0
            hard = sign * j if rounding else 0.0
            phases += [(rounding, 0.0, hard), (even, sign * level, 0.0), (rounding, sign * level, -hard)]
        left = max(seconds - sum(phase[0] for phase in phases), 0.0)
        durations, accelerations, jerks = np.array([*phases[:3], (left, 0.0, 0.0), *phases[3:]]).T
        return _Profile(durations, accelerations, jerks)


def _root(function: Callable[[float], float], low: float, high: float) -> float:
    return float(scipy.optimize.brentq(function, low, high, xtol=1e-14 * high, rtol=1e-14))


def _mixed(joints: Sequence[Sequence[tuple[float, _Profile]]]) -> tuple[Array, Array, Array]:
    """Return durations ``(m,)``, initial accelerations and jerks ``(m, n)`` of joints that move at the same time.

    Args:
        joints: for each joint the profiles of its move, with the share of each.
    """
    ends = [np.append(0.0, np.cumsum(profile.durations)) for parts in joints for _, profile in parts]
    knots = np.unique(np.concatenate(ends))
    knots = knots[np.append(True, np.diff(knots) > SLACK * knots[-1])]
    shape = (max(len(knots) - 1, 0), len(joints))
    accelerations, jerks = np.zeros(shape), np.zeros(shape)
    for i, parts in enumerate(joints):
        for share, profile in parts:
            at = profile.at(knots)
            accelerations[:, i] += share * at[0]
            jerks[:, i] += share * at[1]
    return np.diff(knots), accelerations, jerks


_Law = Callable[[JointSpec, Array, Array, Array, Array], Trajectory]
"""A move from start to end, at a start speed and an end speed, ``(n,)`` each."""


def possible_seconds(
    chain: JointSpec, start: Array, end: Array, start_speed: Array | None = None, end_speed: Array | None = None
) -> list[Span]:
    """Return the possible durations of ``own_phases``, as ascending spans (from, to); the last one has no end."""
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
    """Return a move in which all joints start and stop together, each with phases of its own.

    Args:
        start, end: joint positions ``(n,)``.
        start_speed, end_speed: ``(n,)``, zero by default.
        seconds: duration, by default the shortest one for all joints.
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
        durations, ramps, jerks = _mixed([axis.profiles(lasting) for axis in limited])
        found = Trajectory(durations, ramps, points[0], speeds[0], jerks)
    check_within(chain, found)
    return found


def _lasting(chain: JointSpec, axes: Sequence[Axis], start: Array, speeds: Array, lasting: float) -> Trajectory:
    """Return the move of a duration that is possible for all joints, at full accelerations."""
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
    """Describe durations, rounded so that they are possible."""
    rounded = [(f"{math.ceil(1e6 * low) / 1e6:.6f}", high) for low, high in spans]
    bounded = "".join(f"{low} to {math.floor(1e6 * high) / 1e6:.6f} s, or " for low, high in rounded[:-1])
    return f"{bounded}{rounded[-1][0]} s or more"


def common_phases(
    chain: JointSpec, start: Array, end: Array, start_speed: Array | None = None, end_speed: Array | None = None
) -> Trajectory:
    """Return the quickest move with common phases tau, u - tau, tau of all joints: straight from rest to rest.

    At rest in closed form, else by ``quickest_ramps``, or by a search with limits of jerk.
    """
    points, (v0, vf) = _move(chain, start, end, start_speed, end_speed)
    moved, limits = points[1] - points[0], (chain.speed, chain.acceleration)
    at_rest = not (v0.any() or vf.any())
    if chain.jerk is None:
        tau, u = rest_to_rest(moved, *limits) if at_rest else quickest_ramps(moved, v0, vf, *limits)
    elif at_rest:
        tau, u = _rest_to_rest_smooth(moved, *limits, chain.jerk)
    else:
        tau, u = _quickest_smooth_ramps(moved, (v0, vf), (*limits, chain.jerk))
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
    axes = _smooth_axes(chain, points, speeds)
    durations, ramps, jerks = _mixed([axis.profiles(axis.spans()[0][0]) for axis in axes])
    return Trajectory(durations, ramps, points[0], speeds[0], None if chain.jerk is None else jerks)


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
    phases = np.empty((chain.size, 3))
    for j, axis in enumerate(_smooth_axes(chain, *_move(chain, start, end, start_speed, end_speed))):
        _, quickest = max(axis.profiles(axis.spans()[0][0]), key=lambda part: part[0])
        phases[j] = quickest.durations[:3].sum(), quickest.durations[3], quickest.durations[4:].sum()
    return phases


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

    Limits of jerk give double S shapes, which are nearer to the points. A stretch is as fast as the blends at its ends
    allow; with sharp turns and a small error, stops at the via points are quicker.

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
    changes, durations = stretches_and_blends(moved, allowed, chain.speed, chain.acceleration, chain.jerk)
    ramps = np.zeros((len(durations), chain.size))
    ramps[::2] = changes
    return _in_phases(chain, durations, ramps, points[0], speeds[0])


def _in_phases(chain: JointSpec, durations: Array, ramps: Array, start: Array, start_speed: Array) -> Trajectory:
    """Return a trajectory with changes of speed ``ramps`` ``(m, n)``, without phases from rounding."""
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
    rows = np.stack([points[1] - points[0], *speeds, chain.speed, chain.acceleration], axis=1)
    return [Axis(*row) for row in rows.tolist()]


def _smooth_axes(chain: JointSpec, points: Array, speeds: Array) -> list[SmoothAxis]:
    jerk = np.full(chain.size, np.inf) if chain.jerk is None else chain.jerk
    rows = np.stack([points[1] - points[0], *speeds, chain.speed, chain.acceleration, jerk], axis=1)
    return [SmoothAxis(*row) for row in rows.tolist()]


def _move(
    chain: JointSpec, start: Array, end: Array, start_speed: Array | None, end_speed: Array | None
) -> tuple[Array, Array]:
    speeds = [np.zeros(chain.size) if speed is None else speed for speed in (start_speed, end_speed)]
    return _checked(chain, [start, end], speeds)


def _checked(chain: JointSpec, points: Sequence[Array] | Array, speeds: Sequence[Array] | Array) -> tuple[Array, Array]:
    """Check points and speeds ``(m, n)`` against the limits, and return them."""
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
    return {0: "the start", count - 1: "the end"}.get(i, f"via point {i}")
