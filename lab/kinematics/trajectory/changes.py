"""Changes of speed within limits of acceleration and jerk, without acceleration at their ends: double S shapes.

A change by d takes |d| / a + a / j seconds where its acceleration reaches a, and else 2 sqrt(|d| / j) (Biagiotti &
Melchiorri 2008, section 3.4).
"""

import math

import numpy as np

from lab.core.se3 import Array

__all__ = ["TINY", "change_seconds", "rounding_seconds", "shortest_changes", "slowing"]

TINY = 1e-300  # in place of a zero divisor under a zero


def change_seconds(change: float, acceleration: float, jerk: float) -> float:
    """How long a change of speed takes at least, without acceleration at its ends."""
    size = abs(change)
    if size * jerk >= acceleration**2 or math.isinf(jerk):
        return size / acceleration + acceleration / jerk if size else 0.0
    return 2 * math.sqrt(size / jerk)


def rounding_seconds(ramp: Array | float, jerks: Array | float) -> Array:
    """How long the jerk lasts in changes of speed that take ``ramp`` s in all.

    Args:
        ramp: ``(m,)``.
        jerks: ``(m,)`` |d| / j of the joint for which it is the largest, s^2.
    """
    return np.asarray(0.5 * (ramp - np.sqrt(np.maximum(np.square(ramp) - 4 * np.asarray(jerks), 0.0))))


def shortest_changes(pulls: Array, jerks: Array) -> Array:
    """The shortest durations ``(m,)`` of changes of speed that joints make together.

    Args:
        pulls: ``(m,)`` the largest |d| / a, s.
        jerks: ``(m,)`` the largest |d| / j, s^2.
    """
    reached = jerks <= pulls**2
    return np.where(reached, pulls + jerks / np.maximum(pulls, TINY), 2 * np.sqrt(jerks))


def slowing(pulls: Array, jerks: Array, longest: Array) -> Array:
    """By which factor k changes of speed have to be slowed down, so that d / k takes no more than k times ``longest``.

    All ``(m,)``; 1 where they need not be.
    """
    part = jerks / np.maximum(pulls, TINY)
    reaching = (part + np.sqrt(part**2 + 4 * longest * pulls)) / (2 * longest)
    found = np.where(reaching * jerks <= pulls**2, reaching, np.cbrt(4 * jerks / longest**2))
    return np.asarray(np.maximum(found, 1.0))
