"""Jerk-limited joint motion with double S speed profiles.

The mean speed of a change of speed is that of its ends (``profiles``). What is here holds between any speeds, with no
acceleration at the ends. For one joint and for several that stop together the durations agree with those of Berscheid &
Kroeger (2021, ruckig). Lengths are in rad or m, times in s.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy  # its parts are loaded at their first use, which not every process comes to

from lab.core.se3 import Array
from lab.kinematics.trajectory.profiles import SLACK, TINY, Span, change_seconds, shortest_changes

__all__ = ["Profile", "SmoothAxis", "mixed", "quickest_smooth_ramps", "rest_to_rest_smooth"]

_ROUNDS, _GRID, _DECADES, _HALVINGS = 5, 49, 16.0, 48  # of the search for common phases


@dataclass(frozen=True)
class Profile:
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
        """Accelerations at the start and jerks of the spans between times ``(k + 1,)``, each within one phase."""
        own = np.append(0.0, np.cumsum(self.durations))
        phase = np.searchsorted(own, 0.5 * (knots[:-1] + knots[1:]), side="right") - 1
        still = phase >= len(self.durations)  # it has stopped before
        phase = np.minimum(phase, len(self.durations) - 1)
        jerks = np.where(still, 0.0, self.jerks[phase])
        return np.where(still, 0.0, self.accelerations[phase] + jerks * (knots[:-1] - own[phase])), jerks


def rest_to_rest_smooth(moved: Array, speed: Array, acceleration: Array, jerk: Array) -> tuple[float, float]:
    """The quickest phases tau, u - tau, tau that joints at rest have in common, each tau a double S.

    With r = max |D| / a and h = max |D| / j a ramp takes r / u + h / r, or 2 sqrt(h / u) where it does not reach its
    acceleration. u is the least that lets all joints come up to their cruise speed D / u in no more than u: a larger
    one takes longer.

    Args:
        moved: D ``(n,)``.
        speed, acceleration, jerk: largest ones ``(n,)``.

    Returns:
        tau and u, zero where nothing moves.
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


def quickest_smooth_ramps(
    moved: Array, ends: tuple[Array, Array], limits: tuple[Array, Array, Array]
) -> tuple[float, float]:
    """The quickest phases tau, u - tau, tau that joints have in common, whatever their end speeds.

    Sought over tau. At a given one, what the limits ask of 1 / u is convex: with the jerk of a ramp lasting tau - e, e
    has to be |dV| / a at least, and (tau - e) e to be |dV| / j at least, which is best at max(|dV| / a, tau / 2).

    Args:
        moved: D ``(n,)``, not all zero if the speeds are.
        ends: speeds ``(n,)`` at the start and at the end.
        limits: largest speed, acceleration and jerk ``(n,)``.

    Returns:
        tau and u, to about 1e-6 of the quickest.
    """
    speed, acceleration, jerk = limits
    mean = 0.5 * (ends[0] + ends[1])
    longest = math.log((np.abs(moved) / speed + 4 * speed / acceleration + np.sqrt(8 * speed / jerk)).max())

    def excess(tau: Array, rate: Array) -> Array:
        """Below zero where moves with tau and 1 / u ``(k,)`` keep all limits."""
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

    In T seconds it comes as far as Dmin(T) to Dmax(T), and anywhere between: the limits allow any mixture of the two
    moves. Dmax rises with T, after it has fallen where both speeds are negative: while no limit but that of jerk is
    reached its slope is w + j t1 t2 / 2, with w the cruise speed and t1 and t2 half the times of the two changes of
    speed. So it rules out one open interval of durations at most, and so does Dmin.

    Attributes:
        moved: how far, with its sign.
        start_speed, end_speed: at its ends, with their signs.
        speed, acceleration, jerk: largest ones, above zero.
    """

    moved: float
    start_speed: float
    end_speed: float
    speed: float
    acceleration: float
    jerk: float

    @property
    def direct(self) -> float:
        """The seconds that the change of speed takes at least."""
        return change_seconds(self.end_speed - self.start_speed, self.acceleration, self.jerk)

    def mirrored(self) -> "SmoothAxis":
        """The mirrored profile: the joint moves the other way."""
        return replace(self, moved=-self.moved, start_speed=-self.start_speed, end_speed=-self.end_speed)

    def spans(self) -> list[Span]:
        """The durations that are possible: one span without end, and at most one before it."""
        possible, start = list[Span](), self.direct
        for low, high in sorted([*self._too_near(), *self.mirrored()._too_near()]):
            if low >= start:
                possible.append((start, low))
            start = max(start, high)
        return [*possible, (start, math.inf)]

    def profiles(self, seconds: float) -> list[tuple[float, Profile]]:
        """The farthest and the nearest move of a duration that is possible, and how much of each makes up this one."""
        far, near = self._farthest(seconds), -self.mirrored()._farthest(seconds)
        share = min(max((self.moved - near) / (far - near), 0.0), 1.0) if far > near else 1.0
        back = self.mirrored()._profile(seconds)
        turned = Profile(back.durations, -back.accelerations, -back.jerks)
        return [(share, self._profile(seconds)), (1 - share, turned)]

    def _ramps(self, cruise: float) -> float:
        """Return the duration of the changes from the start speed to a cruise speed and from there to the end speed."""
        return sum(
            change_seconds(cruise - end, self.acceleration, self.jerk) for end in (self.start_speed, self.end_speed)
        )

    def _cruise(self, seconds: float) -> float:
        """The speed at which it cruises on the way to Dmax, in no less than ``direct`` seconds."""
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
        """Dmax of a duration of no less than ``direct``."""
        cruise, way, left = self._cruise(seconds), 0.0, seconds
        for end in (self.start_speed, self.end_speed):
            ramp = change_seconds(cruise - end, self.acceleration, self.jerk)
            way, left = way + 0.5 * (cruise + end) * ramp, left - ramp
        return way + cruise * left

    def _too_near(self) -> list[Span]:
        """The durations at which Dmax < D: the joint can only stop short; one interval or none."""
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

    def _profile(self, seconds: float) -> Profile:
        """The move to Dmax, in seven phases."""
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
        return Profile(durations, accelerations, jerks)


def _root(function: Callable[[float], float], low: float, high: float) -> float:
    """Find the root of a function that is monotonic between two durations."""
    return float(scipy.optimize.brentq(function, low, high, xtol=1e-14 * high, rtol=1e-14))


def mixed(joints: Sequence[Sequence[tuple[float, Profile]]]) -> tuple[Array, Array, Array]:
    """Durations ``(m,)``, accelerations at their starts and jerks ``(m, n)`` of joints that move at the same time.

    Args:
        joints: of each joint the profiles of which its move is the sum, with how much of each.
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
