"""How far from singular a parallel robot is, as numbers without a unit from 0 (singular) to 1.

From its closure f(X, q) = 0 follows A dX + B dq = 0 (Gosselin & Angeles 1990). Where A is singular the platform moves
though the joints are locked (type 2, *parallel*); where B is, a joint moves and the platform does not (type 1,
*serial*); and where what holds the platform upright is dependent, it gains a turn (*constraint*; Zlatanov 2002).
"""

from typing import NamedTuple

import numpy as np

from lab.core.se3 import Array

__all__ = ["Distances", "independence", "unit"]


class Distances(NamedTuple):
    """From what is singular, each ``(n,)``, 0 to 1; NaN out of reach.

    Attributes:
        parallel: the smallest singular value of A, its rows brought to unit length. A load of 1 on the
            platform takes forces of up to 1 / parallel in the legs (root of the sum of squares).
        serial: of the leg that is worst, how well the platform's motion shows in its joint.
        constraint: as parallel, of the moments that hold the platform upright; 1 in the plane, where none need to.
    """

    parallel: Array
    serial: Array
    constraint: Array


def independence(rows: Array) -> Array:
    """The smallest singular value ``(n,)`` of square matrices ``(n, k, k)`` with rows of unit length at most: 0 to 1.

    It is 0 where rows are dependent and 1 where they are of unit length and at right angles.
    """
    known = np.asarray(np.isfinite(rows).all(axis=(1, 2)))
    least = np.full(len(rows), np.nan)
    least[known] = np.linalg.svd(rows[known], compute_uv=False)[:, -1]
    return least


def unit(rows: Array) -> Array:
    """Rows ``(..., k)`` brought to unit length; zero rows stay zero."""
    size = np.linalg.norm(rows, axis=-1, keepdims=True)
    found: Array = rows / np.where(size == 0, 1.0, size)
    return found
