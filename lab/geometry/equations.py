"""Equations of inverse kinematics in one or two angles, solved for whole arrays.

The types are Khalil's (Khalil & Dombre, Modeling, Identification and Control of Robots, 2002, table 4.1). Two roots
are a first axis of length two. They are never NaN: a function says by how much there is no real
root: then the angles are those that come nearest.
"""

import numpy as np
from numpy.typing import NDArray

from lab.frames import Array

ROUNDING = 1e-12  # of the coefficients: a root missed by less is a double root


def type_2(
    x: Array, y: Array, z: Array | float, tiny: float, reference: Array | float = 0.0
) -> tuple[Array, Array, NDArray[np.bool_]]:
    """X sin t + Y cos t = Z.

    Args:
        tiny: a coefficient below this is zero.
        reference: of t, where it is free.

    Returns:
        The two roots ``(2, ...)`` rad; by how much Z is too large for a root (zero where there is one); and
        where t is free, because both coefficients are zero: its roots are the reference there.
    """
    size = np.sqrt(x * x + y * y)
    gap = np.abs(z) - size
    free = size <= tiny
    gap = np.where(gap <= ROUNDING * size, 0.0, gap)
    height = np.where(gap > 0, np.sign(z) * size, z)
    rest = np.sqrt(np.maximum((size - np.abs(height)) * (size + np.abs(height)), 0.0))
    roots = np.empty((2, *size.shape))
    np.arctan2(x * height + y * rest, y * height - x * rest, out=roots[0])
    np.arctan2(x * height - y * rest, y * height + x * rest, out=roots[1])
    if free.any():
        roots = np.where(free, reference, roots)
    return roots, gap, free


def type_3(sine: Array, cosine: Array) -> Array:
    """Sin t = Y1 / X1 and cos t = Y2 / X2, given the quotients: the one root."""
    return np.arctan2(sine, cosine)


def type_8(
    x: float, y: float, z1: Array, z2: Array, tiny: float, reference: Array | float = 0.0, bend: float = 0.0
) -> tuple[Array, Array, Array, NDArray[np.bool_]]:
    """X cos i + Y cos(i + j) = Z1 and X sin i + Y sin(i + j) = Z2, with X and Y above zero.

    Args:
        tiny: a (Z1, Z2) below this is zero.
        reference: of i, where it is free.
        bend: where there is no root, the angles given are that far (rad) from a straight or a folded pair of links.

    Returns:
        The roots i and j ``(2, ...)`` rad; by how much (Z1, Z2) is too far out or too far in (zero where there are
        roots); and where i is free, because the two links fold back onto their root: i is the reference there.
    """
    reach = np.sqrt(z1 * z1 + z2 * z2)
    outside, inside = reach - (x + y), abs(x - y) - reach
    gap = np.maximum(outside, inside)
    gap = np.where(gap <= ROUNDING * (x + y), 0.0, gap)
    stretched = np.maximum(-outside * (reach + x + y), 0.0)
    folded = np.maximum(-inside * (reach + abs(x - y)), 0.0)
    j = np.empty((2, *reach.shape))
    np.arctan2(np.sqrt(stretched), np.sqrt(folded), out=j[0])
    j[0] *= 2
    j[0] = np.where(gap > 0, np.clip(j[0], bend, np.pi - bend), j[0])
    np.negative(j[0], out=j[1])
    along, across = x + y * np.cos(j), y * np.sin(j)
    i = np.arctan2(along * z2 - across * z1, along * z1 + across * z2)
    free = reach <= tiny
    if free.any():
        i = np.where(free, reference, i)
    return i, j, gap, free
