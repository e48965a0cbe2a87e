"""Points, circles and angles in a plane, for whole arrays; what is not there is NaN."""

import numpy as np

from lab.core.se3 import Array

__all__ = ["as_sorted", "circles_meet", "cross", "left", "real_root", "turned", "usable", "wrapped"]

_ROUNDING = 1e-12  # of a square's scale: circles that miss each other by less touch


def real_root(square: Array, scale: Array | float) -> Array:
    """The square root, zero where the square is below zero by rounding alone, and NaN where by more.

    Args:
        scale: of the terms that the square is the difference of, in its unit.
    """
    root: Array = np.sqrt(np.where(square >= 0, square, np.where(square >= -_ROUNDING * scale, 0.0, np.nan)))
    return root


def cross(a: Array, b: Array) -> Array:
    """The product a x b ``(...)`` of ``(..., 2)``: positive where b is to the left of a."""
    return np.asarray(a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0])


def left(a: Array) -> Array:
    """Vectors ``(..., 2)`` turned by a quarter to the left."""
    return np.stack([-a[..., 1], a[..., 0]], axis=-1)


def turned(angle: Array, vectors: Array) -> Array:
    """Vectors ``(..., 2)`` turned to the left by angles ``(...)`` (rad)."""
    turns: Array = np.cos(angle)[..., None] * vectors + np.sin(angle)[..., None] * left(vectors)
    return turns


def wrapped(angle: Array) -> Array:
    """An angle (rad) less whole turns, between -pi and pi."""
    return np.asarray(angle - 2 * np.pi * np.round(angle / (2 * np.pi)))


def usable(lengths: Array) -> Array:
    """Lengths, NaN where one is below zero."""
    lengths = np.asarray(lengths, dtype=np.float64)
    return np.where(lengths >= 0, lengths, np.nan)


def circles_meet(a: Array, b: Array, radius_a: Array, radius_b: Array) -> Array:
    """Where circles about a and b ``(2,)`` meet, ``(n, 2, 2)``: the point to the left of the way from a to b first.

    Args:
        radius_a, radius_b: ``(n,)`` m.
    """
    apart = float(np.hypot(*(b - a)))
    along = (b - a) / apart
    foot = (apart + (radius_a - radius_b) * (radius_a + radius_b) / apart) / 2
    height = real_root((radius_a - foot) * (radius_a + foot), radius_a**2 + radius_b**2 + apart**2)
    heights = np.stack([height, -height], axis=1)
    points: Array = a + foot[:, None, None] * along + heights[..., None] * left(along)
    return points


def as_sorted(poses: Array) -> Array:
    """Poses ``(n, m, 3)`` (x, y, angle) of each row by rising angle, those that are not there at the end."""
    order = np.argsort(poses[..., 2], axis=1)
    return np.take_along_axis(poses, order[..., None], axis=1)
