"""Velocity profiles of joints, and trajectories in phases of constant acceleration.

End speeds need not be zero. For one joint the results agree with those of Berscheid & Kroeger (2021, ruckig) without a
limit of jerk, for several at rest with Khalil & Dombre (2002, chapter 13). Lengths are in rad or m, times in s.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise

import numpy as np

from lab.core.errors import LabError
from lab.core.se3 import Array
from lab.kinematics.joints import JointSpec

__all__ = [
    "EXACT",
    "SLACK",
    "TINY",
    "Axis",
    "Span",
    "Trajectory",
    "check_rates",
    "check_within",
    "joined",
    "possible_spans",
    "quickest_ramps",
    "rest_to_rest",
    "rest_to_rest_seconds",
    "stretches_and_blends",
]

TINY = 1e-300  # replaces a zero divisor


SLACK = 1e-13  # relative tolerance of limits and durations for rounding
_ROUNDS = 100  # of slowing down single stretches, before the whole path

Span = tuple[float, float]


@dataclass(frozen=True)
class Axis:
    """Motion of one joint: change its speed, cruise, and change it again.

    With U and L the larger and the smaller one of its end speeds, a duration T is (U - L) / a, of the change of speed,
    and a rest c.

    Attributes:
        moved: signed distance.
        start_speed, end_speed: signed speeds.
        speed, acceleration: limits v and a, above zero.
    """

    moved: float
    start_speed: float
    end_speed: float
    speed: float
    acceleration: float

    @property
    def ramp(self) -> float:
        """Shortest seconds (U - L) / a of the change of speed."""
        return abs(self.end_speed - self.start_speed) / self.acceleration

    @property
    def rest(self) -> float:
        """Remaining distance after the direct change of speed."""
        return self.moved - 0.5 * (self.start_speed + self.end_speed) * self.ramp

    def mirrored(self) -> "Axis":
        """Return the opposite motion."""
        return replace(self, moved=-self.moved, start_speed=-self.start_speed, end_speed=-self.end_speed)

    def spans(self) -> list[Span]:
        """Return the possible durations: one span without end, and at most one before it.

        In c seconds the joint moves by Dmin(c) to Dmax(c), and any distance between. Dmax is convex and Dmin concave,
        so that each rules out one open interval.
        """
        possible, start = [], 0.0
        for low, high in sorted([*self._too_near(), *self.mirrored()._too_near()]):
            if low >= start - SLACK * (self.ramp + high):
                possible.append((self.ramp + start, self.ramp + max(low, start)))
            start = max(start, high)
        return [*possible, (self.ramp + start, math.inf)]

    def _too_near(self) -> list[Span]:
        """Return the c with Dmax(c) < D, too short for the distance: one interval, which may begin below zero, or none.

        Dmax - D = a c^2 / 4 + U c - rest up to the c at which v is reached, then v c - (v - U)^2 / a - rest.
        """
        a, upper = self.acceleration, max(self.start_speed, self.end_speed)
        square = upper**2 + a * self.rest
        if square <= 0:
            return []
        fastest = math.sqrt(square)  # the cruise speed of the quickest move
        if upper > 0:
            low, high = -2 * (upper + fastest) / a, 2 * self.rest / (upper + fastest)
        else:
            low, high = 2 * self.rest / (upper - fastest), 2 * (fastest - upper) / a
        if fastest > self.speed:
            high = (self.rest + (self.speed - upper) ** 2 / a) / self.speed
        return [(low, high)] if high > 0 else []

    def cruise(self, seconds: float) -> float:
        """Return the cruise speed of a move with a possible duration.

        The distance grows with this speed at the rate of the cruising time: linear between L and U, else as a parabola.
        """
        lower, upper = sorted((self.start_speed, self.end_speed))
        spare = max(seconds - self.ramp, 0.0)
        beyond = self.rest - upper * spare
        if beyond > 0:  # x = cruise speed - U: c x - x^2 / a = beyond
            square = spare**2 - 4 * beyond / self.acceleration
            root = math.sqrt(square) if square > SLACK * spare * seconds else 0.0
            faster = 2 * beyond / max(spare + root, TINY)
            return upper + min(faster, 0.5 * self.acceleration * spare, self.speed - upper)
        if self.rest < lower * spare:
            return -self.mirrored().cruise(seconds)
        return self.rest / spare if spare > 0 else upper


def possible_spans(axes: Sequence[Axis]) -> list[Span]:
    """Return the durations that are possible for all joints, ascending; the last span has no end."""
    each, found = [axis.spans() for axis in axes], list[Span]()
    for seconds in sorted(low for spans in each for low, _ in spans):
        if not found or seconds > found[-1][1]:
            ends = [_end(spans, seconds) for spans in each]
            if min(ends) >= 0:
                found.append((seconds, max(min(ends), seconds)))
    return found


def _end(spans: Sequence[Span], seconds: float) -> float:
    slack = SLACK * seconds
    return next((high for low, high in spans if low - slack <= seconds <= high + slack), -1.0)


def check_rates(names: Sequence[str], speed: Array, acceleration: Array) -> None:
    """Refuse limits ``(n,)`` that are not above zero, or not finite."""
    for what, rates in (("speed", speed), ("acceleration", acceleration)):
        if np.shape(rates) != (len(names),):
            raise LabError(f"largest {what}s have shape {np.shape(rates)}: give one for each of {len(names)} joints")
        for name, rate in zip(names, rates, strict=True):
            if not 0 < rate < math.inf:
                raise LabError(f"joint {name}: its largest {what} is {rate:g}; give a finite one above zero")


def rest_to_rest(moved: Array, speed: Array, acceleration: Array) -> tuple[Array, Array]:
    """Return the quickest common phases tau, u - tau, tau of joints at rest, as tau and u ``(...,)``.

    u = max(max |D| / v, sqrt(max |D| / a)) and tau = max(|D| / a) / u: for a given u the shortest ramp is best, and u +
    tau then grows with u from tau = u on.

    Args:
        moved: D ``(..., n)``.
        speed, acceleration: v and a ``(n,)``.
    """
    far = np.abs(moved)
    cruised, ramped = (
        np.maximum.reduce([far[..., j] / rate for j, rate in enumerate(rates)])  # quicker than .max(axis=-1)
        for rates in (speed, acceleration)
    )
    between = np.maximum(cruised, np.sqrt(ramped))
    return ramped / np.maximum(between, TINY), between


def rest_to_rest_seconds(moved: Array, speed: Array, acceleration: Array) -> Array:
    """Return the durations ``(...,)`` s of the fastest moves from rest to rest with common phases.

    Args:
        moved: ``(..., n)`` rad or m.
        speed, acceleration: limits ``(n,)``.
    """
    check_rates([str(i + 1) for i in range(np.shape(moved)[-1])], speed, acceleration)
    tau, between = rest_to_rest(moved, speed, acceleration)
    return tau + between


def quickest_ramps(
    moved: Array, start_speed: Array, end_speed: Array, speed: Array, acceleration: Array
) -> tuple[float, float]:
    """Return the quickest common phases tau, u - tau, tau of joints with any end speeds, as tau and u.

    A joint cruises at w = (D - m tau) / u, m the mean of its end speeds. |w| <= v, w - L <= a tau and U - w <= a tau, L
    and U the smaller and the larger end speed, are p <= q u with p and q linear in tau; so is tau <= u. Along a curve p
    = q u, u + tau is stationary only where u - tau = (L - U) / (2 a) <= 0. So it is least where two of them meet: at
    roots of quadratics, all of which are tried. One is always possible, as a long move with u = 2 tau breaks no limit.

    Args:
        moved: D ``(n,)``, not all zero if the speeds are.
        start_speed, end_speed: ``(n,)``.
        speed, acceleration: v and a ``(n,)``.
    """
    mean, zero = 0.5 * (start_speed + end_speed), np.zeros(len(moved))
    rows = [np.array([[0.0, 1.0, 1.0, 0.0]])]  # p = p0 + p1 tau and q = q0 + q1 tau as (p0, p1, q0, q1)
    for sign, end in ((1.0, np.minimum(start_speed, end_speed)), (-1.0, np.maximum(start_speed, end_speed))):
        p = (sign * moved, -sign * mean)
        rows += [np.stack([*p, speed, zero], axis=1), np.stack([*p, sign * end, acceleration], axis=1)]
    p0, p1, q0, q1 = np.concatenate(rows).T  # (4 n + 1,)
    i, j = np.triu_indices(len(p0), 1)
    tau = _roots(
        p1[i] * q1[j] - p1[j] * q1[i],
        p0[i] * q1[j] + p1[i] * q0[j] - p0[j] * q1[i] - p1[j] * q0[i],
        p0[i] * q0[j] - p0[j] * q0[i],
    )[:, None]
    p, q = p0 + p1 * tau, q0 + q1 * tau
    p_size, q_size = np.abs(p0) + np.abs(p1) * tau, np.abs(q0) + np.abs(q1) * tau
    from_below = q > SLACK * q_size
    u = np.where(from_below, p / np.where(from_below, q, 1.0), 0.0).max(axis=1, keepdims=True)
    kept = (p - q * u <= SLACK * (p_size + q_size * u)).all(axis=1)
    assert kept.any()
    best = np.argmin(np.where(kept, (tau + u)[:, 0], math.inf))
    return float(tau[best, 0]), float(u[best, 0])


def _roots(a: Array, b: Array, c: Array) -> Array:
    half = -0.5 * (b + np.copysign(np.sqrt(np.maximum(b**2 - 4 * a * c, 0.0)), b))
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        roots = np.concatenate([half / a, c / half])
    return roots[(roots > 0) & (roots < math.inf)]


def stretches_and_blends(
    moved: Array, allowed: Array | float, speed: Array, acceleration: Array
) -> tuple[Array, Array]:
    """Plan a move near via points from rest to rest: stretches of constant velocity V, joined by parabolic blends.

    A blend of duration tau misses its via point by |dV| tau / 8, so that it takes 8 error / |dV| (Khalil & Dombre 2002,
    chapter 13), for the joint with the least; and at most half of the stretches beside it. If it needs too large an
    acceleration, the faster one of the two is slowed down.

    Args:
        moved: ``(m - 1, n)`` between the points, no row zero.
        allowed: errors at the via points ``(n,)``, or one for all.
        speed, acceleration: limits ``(n,)``.

    Returns:
        dV ``(m, n)`` of the blends; and durations ``(2 m - 1,)``, of blends and stretches in turns.
    """
    far = np.abs(moved)
    lasting = (far / speed).max(axis=1)  # from the middle of a blend to that of the next, (m - 1,)
    for _ in range(_ROUNDS):
        changes, longest = _blends(moved, lasting, allowed)
        slower = _slower(changes, longest, acceleration)
        pace = (far / acceleration).max(axis=1) / lasting
        before, after = np.append(0.0, pace), np.append(pace, 0.0)
        lasting *= np.maximum(
            np.where(after >= before, slower, 1.0)[:-1],
            np.where(before >= after, slower, 1.0)[1:],
        )
    changes, longest = _blends(moved, lasting, allowed)
    lasting *= _slower(changes, longest, acceleration).max()
    changes, blends = _blends(moved, lasting, allowed)
    blends[[0, -1]] = _shortest(changes, acceleration)[[0, -1]]
    durations = np.zeros(2 * len(blends) - 1)
    durations[::2], durations[1::2] = blends, np.maximum(lasting - 0.5 * (blends[:-1] + blends[1:]), 0.0)
    return changes, durations


def _slower(changes: Array, longest: Array, acceleration: Array) -> Array:
    """Return the factors k, at least 1, of slower blends ``(m,)``: the change is dV / k, in at most k ``longest``."""
    reaching = np.sqrt(4 * longest * _shortest(changes, acceleration)) / (2 * longest)
    return np.asarray(np.maximum(reaching, 1.0))


def _shortest(changes: Array, acceleration: Array) -> Array:
    """Return the shortest durations ``(m,)`` of blends ``(m, n)``: the largest |dV| / a."""
    return np.asarray((np.abs(changes) / acceleration).max(axis=1))


def _blends(moved: Array, lasting: Array, allowed: Array | float) -> tuple[Array, Array]:
    """Return m blends dV ``(m, n)`` and their longest durations ``(m,)``."""
    velocities = moved / lasting[:, None]
    still = np.zeros_like(velocities[:1])
    changes = np.diff(np.vstack([still, velocities, still]), axis=0)
    missing = (np.abs(changes) / (8 * allowed)).max(axis=1)
    missing[[0, -1]] = 0.0
    room = np.minimum(np.append(math.inf, lasting), np.append(lasting, math.inf))
    return changes, 1 / np.maximum(missing, 1 / room)


EXACT = 1e-9  # rad or m, or per s: tolerance of limits and of joined ends


@dataclass(frozen=True)
class Trajectory:
    """Trajectory of n joints in m phases of constant acceleration.

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
        each, a = self.durations[:, None], self.accelerations
        speeds = np.cumsum(np.vstack([self.start_speed, a * each]), axis=0)
        moves = (speeds[:-1] + 0.5 * a * each) * each
        return np.append(0.0, np.cumsum(self.durations)), np.cumsum(np.vstack([self.start, moves]), axis=0), speeds

    @property
    def seconds(self) -> float:
        """Total duration."""
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
    def peaks(self) -> tuple[Array, Array]:
        """Largest magnitudes ``(n,)`` of the speeds and of the accelerations."""
        accelerations = np.abs(self.accelerations).max(axis=0, initial=0.0)
        return np.asarray(np.abs(self.knots[2]).max(axis=0)), np.asarray(accelerations)

    @property
    def extremes(self) -> tuple[Array, Array]:
        """Lowest and highest joint positions ``(n,)``."""
        _, positions, speeds = self.knots
        v, a, each = speeds[:-1], self.accelerations, self.durations[:, None]
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            t = -v / a  # where the speed v + a t passes zero
        inside = np.where((t > 0) & (t < each), t, 0.0)
        every = np.vstack([positions, positions[:-1] + (v + 0.5 * a * inside) * inside])
        return every.min(axis=0), every.max(axis=0)

    def at(self, times: Array) -> tuple[Array, Array, Array]:
        """Return joint positions, speeds and accelerations ``(k, n)`` at times ``(k,)`` since the start.

        They are clipped to start and end. Between two phases the acceleration is that of the next one; from the end on
        it is zero.
        """
        times_of_knots, positions, speeds = self.knots
        held = np.clip(times, 0.0, self.seconds)
        phase = np.searchsorted(times_of_knots, held, side="right") - 1
        since = (held - times_of_knots[phase])[:, None]
        now = np.vstack([self.accelerations, np.zeros_like(self.start)])[phase]
        return positions[phase] + (speeds[phase] + 0.5 * now * since) * since, speeds[phase] + now * since, now


def joined(parts: Sequence[Trajectory]) -> Trajectory:
    """Join trajectories; refuse gaps of position or speed."""
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


def check_within(chain: JointSpec, trajectory: Trajectory) -> None:
    """Refuse a trajectory that leaves the limits of the joint positions between its ends."""
    lowest, highest = trajectory.extremes
    beyond = np.array([chain.lower - lowest, highest - chain.upper])
    side, j = divmod(int(np.argmax(beyond)), chain.size)
    if beyond[side, j] > EXACT:
        ends = f"from {chain.shown(j, trajectory.start[j])} to {chain.shown(j, trajectory.end[j])}"
        raise LabError(
            f"on its way {ends} {chain.limit_note(j, (lowest, highest)[side][j])}; lower its speeds at the ends, or "
            "move these away from the limit"
        )
