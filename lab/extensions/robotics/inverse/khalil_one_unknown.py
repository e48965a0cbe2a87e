"""Khalil's equations in one unknown, solved for whole arrays; those in two are in ``equation_pairs``.

The ten types are those of Khalil & Dombre (Modeling, Identification and Control of Robots, 2002, table 4.1). An
inverse in closed form is made of them: types 1 to 3, 9 and 10 have one unknown, 4 to 8 two.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lab.core.se3 import Array

__all__ = ["ROUNDING", "TINY", "Roots", "same_shape", "type_1", "type_2", "type_3", "type_9", "type_10", "unless_tiny"]

ROUNDING = 1e-12  # of the coefficients: a root missed by less is a double root
TINY = 1e-13  # m, or of a unit vector: a coefficient below this is none


class Roots(NamedTuple):
    """What solves some equations, never NaN.

    Attributes:
        values: of each unknown its roots ``(roots, ...)``: rad, up to whole turns, or a length as the equation says.
        gap: ``(...)`` zero where there are roots; else by how much there are none: what the equations still miss
            with the values given, which are those that come nearest.
        free: of each unknown ``(...)``, where any value does as well: it is the reference there.
    """

    values: tuple[Array, ...]
    gap: Array
    free: tuple[NDArray[np.bool_], ...]


def type_1(x: ArrayLike, y: ArrayLike, tiny: float = TINY, reference: ArrayLike = 0.0) -> Roots:
    """X r = Y: one root."""
    x, y = same_shape(x, y)
    free = np.abs(x) <= tiny
    value = np.where(free, reference, y / np.where(free, 1.0, x))
    return Roots((value[None],), unless_tiny(np.where(free, np.abs(y), 0.0), tiny), (free,))


def type_2(x: Array, y: Array, z: Array | float, tiny: float = TINY, reference: ArrayLike = 0.0) -> Roots:
    """X sin t + Y cos t = Z: two roots.

    Args:
        tiny: a coefficient below this is zero.
        reference: of t, where it is free because both coefficients are zero.
    """
    size = np.sqrt(x * x + y * y)
    gap = np.abs(z) - size
    free = size <= tiny
    gap = np.where(gap <= ROUNDING * size + tiny, 0.0, gap)
    height = np.where(gap > 0, np.sign(z) * size, z)
    rest = np.sqrt(np.maximum((size - np.abs(height)) * (size + np.abs(height)), 0.0))
    roots = np.empty((2, *gap.shape))
    np.arctan2(x * height + y * rest, y * height - x * rest, out=roots[0])
    np.arctan2(x * height - y * rest, y * height + x * rest, out=roots[1])
    if free.any():
        roots = np.where(free, reference, roots)
    return Roots((roots,), gap, (free,))


def type_3(
    x1: ArrayLike, y1: ArrayLike, x2: ArrayLike, y2: ArrayLike, tiny: float = TINY, reference: ArrayLike = 0.0
) -> Roots:
    """X1 sin t = Y1 and X2 cos t = Y2: one root.

    Where one of them says nothing, because both its sides are zero, the other alone has two: the one nearer to the
    reference is given. Two equations for one angle may contradict each other, which is a gap.
    """
    x1, y1, x2, y2, reference = same_shape(x1, y1, x2, y2, reference)
    no_sine, no_cosine = np.abs(x1) <= tiny, np.abs(x2) <= tiny
    sine, cosine = y1 / np.where(no_sine, 1.0, x1), y2 / np.where(no_cosine, 1.0, x2)
    angle = np.arctan2(sine, cosine)
    angle = np.where(no_sine, nearer(type_9(x2, y2, tiny).values[0], reference), angle)
    angle = np.where(no_cosine, nearer(type_10(x1, y1, tiny).values[0], reference), angle)
    nowhere = np.hypot(sine, cosine) <= tiny  # 0 = sin t and 0 = cos t
    angle = np.where((no_sine & no_cosine) | nowhere, reference, angle)
    missing = np.hypot(x1 * np.sin(angle) - y1, x2 * np.cos(angle) - y2)
    gap = unless_tiny(missing, tiny + ROUNDING * (np.abs(x1) + np.abs(y1) + np.abs(x2) + np.abs(y2)))
    return Roots((angle[None],), gap, (no_sine & no_cosine,))


def type_9(x: ArrayLike, y: ArrayLike, tiny: float = TINY, reference: ArrayLike = 0.0) -> Roots:
    """X cos t = Y: two roots."""
    cosine, gap, free = _quotient(x, y, tiny)
    angle = 2 * np.arctan2(np.sqrt(1 - cosine), np.sqrt(1 + cosine))
    return Roots((np.where(free, reference, np.stack([angle, -angle])),), gap, (free,))


def type_10(x: ArrayLike, y: ArrayLike, tiny: float = TINY, reference: ArrayLike = 0.0) -> Roots:
    """X sin t = Y: two roots."""
    sine, gap, free = _quotient(x, y, tiny)
    rest = np.sqrt((1 - sine) * (1 + sine))
    roots = np.stack([np.arctan2(sine, rest), np.arctan2(sine, -rest)])
    return Roots((np.where(free, reference, roots),), gap, (free,))


def nearer(roots: Array, reference: Array) -> Array:
    """Of two angles ``(2, ...)`` the one nearer to a reference, whatever the whole turns; the first where both are."""
    apart = np.cos(roots - reference)
    return np.asarray(np.where(apart[1] > apart[0], roots[1], roots[0]))


def unless_tiny(missing: Array, tolerance: Array | float) -> Array:
    """What is missing, zero where that is within a tolerance."""
    return np.asarray(np.where(missing <= tolerance, 0.0, missing))


def same_shape(*values: ArrayLike) -> tuple[Array, ...]:
    """Numbers and arrays as arrays of one shape."""
    return np.broadcast_arrays(*(np.asarray(value, dtype=np.float64) for value in values))


def _quotient(x: ArrayLike, y: ArrayLike, tiny: float) -> tuple[Array, Array, NDArray[np.bool_]]:
    """Y / X within -1 and 1, by how much Y is too large, and where X is zero."""
    x, y = same_shape(x, y)
    free = np.abs(x) <= tiny
    gap = unless_tiny(np.abs(y) - np.abs(x), np.where(free, tiny, ROUNDING * np.abs(x)))
    inside = np.clip(y, -np.abs(x), np.abs(x))
    return inside / np.where(free, 1.0, x), gap, free
