"""Solve Khalil's ten equation types in one and two unknowns, for whole arrays.

An inverse in closed form is made of them (Khalil & Dombre, Modeling, Identification and Control of Robots, 2002, table
4.1): types 1 to 3, 9 and 10 have one unknown, 4 to 8 two. Types 6, 7 and 8 each close a triangle of three lengths, and
are solved as that: to rounding of the lengths, where the squares of Khalil's own solution lose half of the digits
beside a short side.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lab.core.se3 import Array

__all__ = [
    "ROUNDING",
    "TINY",
    "Roots",
    "type_1",
    "type_2",
    "type_3",
    "type_4",
    "type_5",
    "type_6",
    "type_7",
    "type_8",
    "type_9",
    "type_10",
    "unless_tiny",
]

ROUNDING = 1e-12  # of the coefficients: a root missed by less is a double root
TINY = 1e-13  # m, or of a unit vector: a coefficient below this is none


class Roots(NamedTuple):
    """Roots of equations, never NaN.

    Attributes:
        values: of each unknown its roots ``(roots, ...)``: rad, up to whole turns, or a length as the equation has it.
        gap: ``(...)`` zero where there are roots; else the residual of the equations
            with the values given, which are those that come nearest.
        free: of each unknown ``(...)``, where any value does as well: it is the reference there.
    """

    values: tuple[Array, ...]
    gap: Array
    free: tuple[NDArray[np.bool_], ...]


def type_1(x: ArrayLike, y: ArrayLike, tiny: float = TINY, reference: ArrayLike = 0.0) -> Roots:
    """Solve X r = Y: one root."""
    x, y = _same_shape(x, y)
    free = np.abs(x) <= tiny
    value = np.where(free, reference, y / np.where(free, 1.0, x))
    return Roots((value[None],), unless_tiny(np.where(free, np.abs(y), 0.0), tiny), (free,))


def type_2(x: Array, y: Array, z: Array | float, tiny: float = TINY, reference: ArrayLike = 0.0) -> Roots:
    """Solve X sin t + Y cos t = Z: two roots.

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
    """Solve X1 sin t = Y1 and X2 cos t = Y2: one root.

    Where both sides of one equation are zero, the other alone has two roots: the one nearer to the reference is given.
    Two equations for one angle may contradict each other, which is a gap.
    """
    x1, y1, x2, y2, reference = _same_shape(x1, y1, x2, y2, reference)
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
    """Solve X cos t = Y: two roots."""
    cosine, gap, free = _quotient(x, y, tiny)
    angle = 2 * np.arctan2(np.sqrt(1 - cosine), np.sqrt(1 + cosine))
    return Roots((np.where(free, reference, np.stack([angle, -angle])),), gap, (free,))


def type_10(x: ArrayLike, y: ArrayLike, tiny: float = TINY, reference: ArrayLike = 0.0) -> Roots:
    """Solve X sin t = Y: two roots."""
    sine, gap, free = _quotient(x, y, tiny)
    rest = np.sqrt((1 - sine) * (1 + sine))
    roots = np.stack([np.arctan2(sine, rest), np.arctan2(sine, -rest)])
    return Roots((np.where(free, reference, roots),), gap, (free,))


def nearer(roots: Array, reference: Array) -> Array:
    """Choose of two angles ``(2, ...)`` the one nearer to a reference, up to whole turns; the first if equally near."""
    apart = np.cos(roots - reference)
    return np.asarray(np.where(apart[1] > apart[0], roots[1], roots[0]))


def unless_tiny(missing: Array, tolerance: Array | float) -> Array:
    """Return the residual, zero where it is within a tolerance."""
    return np.asarray(np.where(missing <= tolerance, 0.0, missing))


def _same_shape(*values: ArrayLike) -> tuple[Array, ...]:
    return np.broadcast_arrays(*(np.asarray(value, dtype=np.float64) for value in values))


def _quotient(x: ArrayLike, y: ArrayLike, tiny: float) -> tuple[Array, Array, NDArray[np.bool_]]:
    """Return Y / X within -1 and 1, the excess of Y, and where X is zero."""
    x, y = _same_shape(x, y)
    free = np.abs(x) <= tiny
    gap = unless_tiny(np.abs(y) - np.abs(x), np.where(free, tiny, ROUNDING * np.abs(x)))
    inside = np.clip(y, -np.abs(x), np.abs(x))
    return inside / np.where(free, 1.0, x), gap, free


_Pair = tuple[ArrayLike, ArrayLike]


def type_4(
    x1: ArrayLike, y1: ArrayLike, x2: ArrayLike, y2: ArrayLike, tiny: float = TINY, reference: _Pair = (0.0, 0.0)
) -> Roots:
    """Solve X1 r sin t = Y1 and X2 r cos t = Y2 for r and t: two roots, of opposite r.

    Where r is zero t is free. Where both sides of one equation are zero, both are free: r sin t (or r cos t) is the
    reference's.
    """
    x1, y1, x2, y2, r_preferred, t_preferred = _same_shape(x1, y1, x2, y2, *reference)
    no_sine, no_cosine = np.abs(x1) <= tiny, np.abs(x2) <= tiny
    up = np.where(no_sine, r_preferred * np.sin(t_preferred), y1 / np.where(no_sine, 1.0, x1))
    along = np.where(no_cosine, r_preferred * np.cos(t_preferred), y2 / np.where(no_cosine, 1.0, x2))
    size, silent = np.hypot(up, along), no_sine | no_cosine
    t = np.where(size <= tiny, t_preferred, np.stack([np.arctan2(up, along), np.arctan2(-up, -along)]))
    gap = np.hypot(np.where(no_sine, y1, 0.0), np.where(no_cosine, y2, 0.0))
    return Roots((np.stack([size, -size]), t), unless_tiny(gap, 2 * tiny), (silent, silent | (size <= tiny)))


def type_5(
    x1: ArrayLike,
    y1: ArrayLike,
    z1: ArrayLike,
    x2: ArrayLike,
    y2: ArrayLike,
    z2: ArrayLike,
    tiny: float = TINY,
    reference: _Pair = (0.0, 0.0),
) -> Roots:
    """Solve X1 sin t = Y1 + Z1 r and X2 cos t = Y2 + Z2 r for r and t: two roots.

    They are where the line V + W r (V = Y / X, W = Z / X) crosses the unit circle. Where both Z are zero r is free;
    where an X is zero its equation is about r alone, and t may be free.
    """
    x1, y1, z1, x2, y2, z2, r_preferred, t_preferred = _same_shape(x1, y1, z1, x2, y2, z2, *reference)
    no_sine, no_cosine, fixed = np.abs(x1) <= tiny, np.abs(x2) <= tiny, np.hypot(z1, z2) <= tiny
    by_1, by_2 = np.where(no_sine, 1.0, x1), np.where(no_cosine, 1.0, x2)
    v1, w1, v2, w2 = y1 / by_1, z1 / by_1, y2 / by_2, z2 / by_2
    size = np.where(fixed, 1.0, np.hypot(w1, w2))
    height = np.clip((v1 * w2 - v2 * w1) / size, -1.0, 1.0)  # of the line over the circle's middle, K / sqrt(A)
    half = np.sqrt((1 - height) * (1 + height))
    chord = np.stack([half, -half])
    r = np.where(fixed, r_preferred, (chord - (v1 * w1 + v2 * w2) / size) / size)
    t = np.where(fixed, np.arctan2(v1, v2), np.arctan2(w2 * height + w1 * chord, w2 * chord - w1 * height))
    r_free, t_free = fixed, np.zeros_like(fixed)
    if (no_sine | no_cosine).any():
        preferred = (r_preferred, t_preferred)
        for odd, part in (
            (no_sine, _one_angle((y1, z1), (x2, y2, z2), type_9, np.cos, tiny, preferred)),
            (no_cosine, _one_angle((y2, z2), (x1, y1, z1), type_10, np.sin, tiny, preferred)),
            (no_sine & no_cosine, _no_angle((y1, z1), (y2, z2), tiny, preferred)),
        ):
            r, t, r_free, t_free = (np.where(odd, *pair) for pair in zip(part, (r, t, r_free, t_free), strict=True))
    missing = np.hypot(x1 * np.sin(t) - y1 - z1 * r, x2 * np.cos(t) - y2 - z2 * r).max(axis=0)
    scale = np.abs([x1, y1, x2, y2]).sum(axis=0) + np.hypot(z1, z2) * np.abs(r).max(axis=0)
    return Roots((r, t), unless_tiny(missing, tiny + ROUNDING * scale), (r_free, t_free))


_Part = tuple[Array, Array, NDArray[np.bool_], NDArray[np.bool_]]  # r, t and where each is free


def _one_angle(
    alone: tuple[Array, Array],
    rest: tuple[Array, Array, Array],
    angle: Callable[..., Roots],
    turned: Callable[[Array], Array],
    tiny: float,
    preferred: tuple[Array, Array],
) -> _Part:
    """Solve 0 = Y + Z r and X cos t (or sin t) = Y + Z r."""
    (y, z), (x, other_y, other_z), (r_preferred, t_preferred) = alone, rest, preferred
    silent, still = np.abs(z) <= tiny, np.abs(other_z) <= tiny
    r = np.where(silent, r_preferred, -y / np.where(silent, 1.0, z))
    open_ = silent & ~still  # one equation for both: t as it is preferred, and r by that
    r = np.where(open_, (x * turned(t_preferred) - other_y) / np.where(still, 1.0, other_z), r)
    roots = angle(x, other_y + other_z * r, tiny, t_preferred)
    t = np.where(open_, t_preferred, roots.values[0])
    return np.broadcast_to(r, t.shape), t, silent, open_ | roots.free[0]


def _no_angle(
    first: tuple[Array, Array], second: tuple[Array, Array], tiny: float, preferred: tuple[Array, Array]
) -> _Part:
    """Solve 0 = Y1 + Z1 r and 0 = Y2 + Z2 r by least squares: t is free."""
    (y1, z1), (y2, z2), (r_preferred, t_preferred) = first, second, preferred
    square = z1 * z1 + z2 * z2
    silent = square <= tiny * tiny
    r = np.where(silent, r_preferred, -(y1 * z1 + y2 * z2) / np.where(silent, 1.0, square))
    return np.stack([r, r]), np.stack([t_preferred, t_preferred]), silent, np.ones_like(silent)


def type_6(
    w: ArrayLike,
    x: ArrayLike,
    y: ArrayLike,
    z1: ArrayLike,
    z2: ArrayLike,
    tiny: float = TINY,
    reference: _Pair = (0.0, 0.0),
) -> Roots:
    """Solve W sin j = X cos i + Y sin i + Z1 and W cos j = X sin i - Y cos i + Z2 for i and j: two roots.

    Where X and Y or both Z are zero i is free, where W is zero j.
    """
    w, x, y, z1, z2, i_preferred, j_preferred = _same_shape(w, x, y, z1, z2, *reference)
    i, right, gap, free = _closed(np.abs(w), x, y, z1, z2, tiny, i_preferred)
    sign, none = np.where(w < 0, -1.0, 1.0), np.abs(w) <= tiny
    return Roots((i, np.where(none, j_preferred, np.arctan2(sign * right[0], sign * right[1]))), gap, (free, none))


def type_7(
    w1: ArrayLike,
    w2: ArrayLike,
    x: ArrayLike,
    y: ArrayLike,
    z1: ArrayLike,
    z2: ArrayLike,
    tiny: float = TINY,
    reference: _Pair = (0.0, 0.0),
) -> Roots:
    """Solve W1 cos j + W2 sin j = X cos i + Y sin i + Z1 and W1 sin j - W2 cos j = X sin i - Y cos i + Z2.

    Two roots, as type 6 has them.
    """
    w1, w2, x, y, z1, z2, i_preferred, j_preferred = _same_shape(w1, w2, x, y, z1, z2, *reference)
    w = np.hypot(w1, w2)
    i, (r1, r2), gap, free = _closed(w, x, y, z1, z2, tiny, i_preferred)
    j = np.where(w <= tiny, j_preferred, np.arctan2(w2 * r1 + w1 * r2, w1 * r1 - w2 * r2))
    return Roots((i, j), gap, (free, w <= tiny))


def _closed(
    w: Array, x: Array, y: Array, z1: Array, z2: Array, tiny: float, preferred: Array
) -> tuple[Array, Array, Array, NDArray[np.bool_]]:
    """Solve types 6 and 7 for i: a vector (X, Y) turned by i and a fixed (Z1, Z2) add up to the length W.

    Returns:
        i ``(2, ...)``; the right sides ``(2, 2, ...)``; the gap; and where i is free.
    """
    moving, fixed = np.hypot(x, y), np.hypot(z1, z2)
    corner, gap = _corner(moving, fixed, w, tiny)
    free = (moving <= tiny) | (fixed <= tiny)
    straight = np.arctan2(z2, z1) + np.arctan2(y, x)  # the i that adds the two lengths
    i = np.where(free, preferred, straight + np.stack([corner, -corner]))
    cosine, sine = np.cos(i), np.sin(i)
    return i, np.stack([x * cosine + y * sine + z1, x * sine - y * cosine + z2]), gap, free


def type_8(
    x: float, y: float, z1: Array, z2: Array, tiny: float = TINY, reference: _Pair = (0.0, 0.0), bend: float = 0.0
) -> Roots:
    """Solve X cos i + Y cos(i + j) = Z1 and X sin i + Y sin(i + j) = Z2 for i and j: two roots.

    Where Z is zero and X = Y, so that the two links fold back onto their root, i is free; where X is zero i is, and
    where Y is zero j.

    Args:
        bend: where there is no root, the angles given are that far (rad) from a straight or a folded pair of links.
    """
    reach = np.sqrt(z1 * z1 + z2 * z2)
    corner, gap = _corner(abs(x), abs(y), reach, tiny)
    if bend:
        corner = np.where(gap > 0, np.clip(corner, bend, np.pi - bend), corner)
    if x * y < 0:
        corner -= np.pi
    j = np.stack([corner, -corner])
    if abs(y) <= tiny:
        j = np.broadcast_to(reference[1], j.shape)
    along, across = x + y * np.cos(j), y * np.sin(j)
    i = np.arctan2(along * z2 - across * z1, along * z1 + across * z2)
    free = reach <= tiny
    if abs(x) <= tiny:
        free = np.ones_like(free)
    if free.any():
        i = np.where(free, reference[0], i)
    if abs(x) <= tiny < abs(y):
        j = np.arctan2(z2 * np.sign(y), z1 * np.sign(y)) - i
    return Roots((i, j), gap, (free, np.full_like(free, abs(y) <= tiny)))


def _corner(first: Array | float, second: Array | float, third: Array, tiny: float) -> tuple[Array, Array]:
    """Return the turn (rad, 0 to pi) from a first length to a second that makes them span a third, and the gap."""
    longest, shortest = np.add(first, second), np.abs(np.subtract(first, second))
    outside, inside = third - longest, shortest - third
    gap = np.maximum(outside, inside)
    gap = np.where(gap <= ROUNDING * longest + tiny, 0.0, gap)
    stretched = np.maximum(-outside * (third + longest), 0.0)
    folded = np.maximum(-inside * (third + shortest), 0.0)
    return 2 * np.arctan2(np.sqrt(stretched), np.sqrt(folded)), gap
