"""How a path runs over time: that trapezoid or double S of its speed which takes the shortest time within all limits.

A shape is on what part of the way its speed changes, and during what share of these changes its jerk lasts. Times
scale: at T times the duration speeds are T, accelerations T^2 and jerks T^3 times smaller, so that the shortest T of
each shape is exact.
"""

from collections.abc import Callable, Sequence
from itertools import product

import numpy as np
from scipy.interpolate import BSpline

from lab.core.se3 import Array
from lab.kinematics.joints import JointSpec
from lab.kinematics.trajectory.phases import Trajectory

__all__ = ["quickest_pace"]

_WAYS, _SHARES = 20, 6  # shapes that are tried first
_AROUND, _ROUNDS = (-0.6, -0.3, 0.0, 0.3, 0.6), 3  # of trying again, nearer to the best
_COARSE, _FINE = 33, 1025  # places in each phase at which the limits are looked at, to choose and to keep
_PLACES = 2049  # on the path, at which slopes are known to choose
_TOGETHER = 1 + 1e-12  # of a time, so that rounding passes no limit


def quickest_pace(chain: JointSpec, joints: BSpline, rates: Sequence[tuple[float, float]]) -> Trajectory:
    """The place s from 0 to 1 over time, from rest to rest, as a trajectory of one joint.

    Args:
        chain: the joints, with their speeds and accelerations, and their jerks where these are limited.
        joints: their positions over s, of the fifth degree.
        rates: largest ds/dt and d2s/dt2 beside.
    """
    slopes = [joints.derivative(order) for order in (1, 2, 3)]
    known = [slope(np.linspace(0, 1, _PLACES)) for slope in slopes]

    def nearest(s: Array) -> list[Array]:
        return [each[np.rint(s * (_PLACES - 1)).astype(int)] for each in known]

    def seconds(shape: tuple[float, float]) -> float:
        return _seconds(_unit(*shape), chain, nearest, rates, _COARSE)

    limited = chain.jerk is not None
    ways = np.linspace(0, 1, _WAYS + 1)[1:].tolist()
    shares = np.linspace(0, 0.5, _SHARES + 1)[1:].tolist() if limited else [0.0]
    best = min(product(ways, shares), key=seconds)
    wide = (1 / _WAYS, 0.5 / _SHARES)
    for _ in range(_ROUNDS):
        near = product(
            (best[0] + wide[0] * i for i in _AROUND), (best[1] + wide[1] * i for i in _AROUND if limited or not i)
        )
        best = min(
            [(min(max(way, 1e-3), 1.0), min(max(share, 1e-3), 0.5) * limited) for way, share in near], key=seconds
        )
        wide = (0.3 * wide[0], 0.3 * wide[1])
    unit = _unit(*best)
    lasting = _TOGETHER * _seconds(unit, chain, lambda s: [slope(s) for slope in slopes], rates, _FINE)
    jerks = None if unit.jerks is None else unit.jerks / lasting**3
    return Trajectory(unit.durations * lasting, unit.accelerations / lasting**2, unit.start, unit.start_speed, jerks)


def _unit(way: float, share: float) -> Trajectory:
    """The place over a second: its speed changes on a part of the way; jerk lasts a share of a change at each end."""
    ramp = way / (1 + way)
    rounding, speed, still = share * ramp, 1 / (1 - ramp), np.zeros(1)
    pull = speed / (ramp - rounding)
    if not share:
        durations, accelerations = np.array([ramp, 1 - 2 * ramp, ramp]), np.array([pull, 0, -pull])
        return Trajectory(durations, accelerations[:, None], still, still)
    hard, even = pull / rounding, ramp - 2 * rounding
    durations = np.array([rounding, even, rounding, max(1 - 2 * ramp, 0.0), rounding, even, rounding])
    accelerations = np.array([0, pull, pull, 0, 0, -pull, -pull])
    jerks = np.array([hard, 0, -hard, 0, -hard, 0, hard])
    kept = durations > 0
    return Trajectory(durations[kept], accelerations[kept, None], still, still, jerks[kept, None])


def _seconds(
    unit: Trajectory,
    chain: JointSpec,
    slopes: Callable[[Array], list[Array]],
    rates: Sequence[tuple[float, float]],
    count: int,
) -> float:
    """How long a shape takes at least, by what its joints need at ``count`` places of each phase.

    Args:
        slopes: the first three derivatives ``(k, n)`` of the joints at s ``(k,)``.
    """
    t = np.linspace(0, 1, count)[:, None] * unit.durations  # (count, phases)
    _, places, speeds = unit.knots
    a, j = unit.accelerations[:, 0], unit.jerk[:, 0]
    s = places[:-1, 0] + (speeds[:-1, 0] + (0.5 * a + j * t / 6) * t) * t
    speed, pull, hard = (
        np.broadcast_to(each, t.shape).reshape(-1, 1) for each in (speeds[:-1, 0] + (a + 0.5 * j * t) * t, a + j * t, j)
    )
    first, second, third = slopes(np.clip(s.ravel(), 0.0, 1.0))
    needed = [
        float((np.abs(first * speed) / chain.speed).max()),
        float(np.sqrt((np.abs(second * speed**2 + first * pull) / chain.acceleration).max())),
    ]
    if chain.jerk is not None:
        pushed = third * speed**3 + 3 * second * speed * pull + first * hard
        needed.append(float(np.cbrt((np.abs(pushed) / chain.jerk).max())))
    for fastest, quickest in rates:
        needed += [float(speed.max()) / fastest, float(np.sqrt(np.abs(pull).max() / quickest))]
    return max(needed)
