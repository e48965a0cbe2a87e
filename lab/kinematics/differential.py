"""Differential kinematics: joint rates, the tool's twist, and singularities.

The geometric Jacobian (``SerialArm.tool``) maps rates in rad/s, m/s of a slide, to the target's velocity (m/s) and
angular velocity (rad/s) in the tracker's frame: twist = J rates. Singular values are in metres: radians of the tool are
weighted by ``ROTATION_M``.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lab.core.se3 import Array

__all__ = ["ROTATION_M", "SINGULAR_M", "WEIGHTS", "manipulability", "pseudo_inverse", "rates", "singular_distance"]

ROTATION_M = 0.3  # weight of a radian of the tool
SINGULAR_M = 1e-9  # singular values up to this are zero
_WELL_CONDITIONED = 1e6  # condition number by Frobenius norms: ten digits are kept
WEIGHTS = np.array([1.0, 1.0, 1.0, ROTATION_M, ROTATION_M, ROTATION_M])


@dataclass(frozen=True)
class _Rates:
    """Joint rates for twists.

    Attributes:
        joints: ``(n, joints)`` least-squares rates of least norm, rad/s or m/s.
        missing: ``(n, 6)`` m/s and rad/s: J joints = twist - missing.
        rank: ``(n,)`` of the Jacobian.
        free: ``(n, joints, joints)`` orthonormal rows: the null space of the joints, joints - rank of them, then zeros.
        lost: ``(n, 6, 6)`` rows of unit length with weighted radians: directions (m, rad) orthogonal to all motions, 6
            - rank of them, then zeros.
    """

    joints: Array
    missing: Array
    rank: NDArray[np.int_]
    free: Array
    lost: Array


def rates(jacobian: Array, twists: Array, least_m: float = SINGULAR_M) -> _Rates:
    """Invert the differential model by a truncated pseudo-inverse (e.g. Khalil & Dombre 2002).

    Args:
        jacobian: ``(n, 6, joints)``, geometric.
        twists: ``(n, 6)`` m/s and rad/s.
        least_m: singular values up to this count as zero.
    """
    u, sizes, vt = np.linalg.svd(WEIGHTS[:, None] * jacobian)
    count = sizes.shape[1]
    retained = sizes > least_m
    along = np.einsum("nik,ni->nk", u, WEIGHTS * twists)  # of the twist, in each direction
    by_size = np.where(retained, along[:, :count], 0.0) / np.where(retained, sizes, 1.0)
    rank = retained.sum(axis=1)
    free = _last_rows(vt, rank)
    lost = _last_rows(u.swapaxes(1, 2), rank)
    missing = np.einsum("nki,nk->ni", lost, np.einsum("nki,ni->nk", lost, WEIGHTS * twists)) / WEIGHTS
    return _Rates(np.einsum("nkj,nk->nj", vt[:, :count], by_size), missing, rank, free, lost / WEIGHTS)


def _last_rows(rows: Array, first: NDArray[np.int_]) -> Array:
    """Select rows ``first`` ``(n,)`` and later of ``(n, k, k)``, the first largest part positive; zeros follow."""
    size = np.abs(rows)
    largest = (size > (1 - 1e-9) * size.max(axis=2, keepdims=True)).argmax(axis=2)[:, :, None]
    signed = rows * np.sign(np.take_along_axis(rows, largest, axis=2))
    chosen = np.where((np.arange(rows.shape[1]) >= first[:, None])[:, :, None], signed, 0.0)
    return chosen[:, ::-1]


def pseudo_inverse(matrix: Array, damping: Array | float = 0.0, least: float = SINGULAR_M) -> Array:
    """Invert ``(n, r, c)`` without singular values up to ``least``: V s / (s^2 + damping^2) U'.

    Args:
        damping: ``(n,)``, in the singular values' unit.
    """
    u, sizes, vt = np.linalg.svd(matrix, full_matrices=False)
    kept = sizes > least
    inverse = np.where(kept, sizes, 0.0) / np.where(kept, sizes**2 + np.reshape(damping, (-1, 1)) ** 2, 1.0)
    found: Array = (vt.swapaxes(1, 2) * inverse[:, None]) @ u.swapaxes(1, 2)
    return found


def manipulability(jacobian: Array) -> Array:
    """Return the product w ``(n,)`` m^3 of the singular values, sqrt(det J J') (Yoshikawa 1985)."""
    return np.asarray(np.prod(np.linalg.svd(jacobian, compute_uv=False), axis=1))


def _clipped_inverse(jacobian: Array) -> Array:
    """Return pseudo-inverses ``(n, joints, 6)``, with singular values clipped above zero."""
    u, sizes, vt = np.linalg.svd(jacobian, full_matrices=False)
    sizes = np.maximum(sizes, 1e-15 * sizes[:, :1])
    inverse: Array = (vt.swapaxes(1, 2) / sizes[:, None]) @ u.swapaxes(1, 2)
    return inverse


def _inverse(jacobian: Array) -> Array:
    if jacobian.shape[2] > 6:
        return _clipped_inverse(jacobian)
    regular = np.linalg.det(jacobian) != 0
    inverse = np.full(jacobian.shape, np.inf)
    inverse[regular] = np.linalg.inv(jacobian[regular])
    sizes = np.linalg.norm(jacobian, axis=(1, 2)) * np.linalg.norm(inverse, axis=(1, 2))
    near = np.flatnonzero(~(sizes < _WELL_CONDITIONED))
    inverse[near] = _clipped_inverse(jacobian[near])
    return inverse


def _where_singular(jacobian: Array, gradient: Array) -> None:
    """Correct a gradient ``(n, joints)`` of log w where fewer than six joints are exactly singular.

    The least singular value then may grow in more than one direction.
    """
    u, sizes, vt = np.linalg.svd(jacobian)
    last, sizes = sizes.shape[1] - 1, np.maximum(sizes, 1e-15 * sizes[:, :1])
    there = np.flatnonzero(sizes[:, -1] <= 1e-12 * sizes[:, 0])
    columns = jacobian[there].swapaxes(1, 2)
    v, o = columns[..., :3], columns[..., 3:]
    for k in range(columns.shape[1] if there.size else 0):
        by_k = np.zeros_like(columns)
        by_k[:, k:, :3] = np.cross(o[:, k : k + 1], v[:, k:])
        by_k[:, :k, :3] = np.cross(o[:, :k], v[:, k : k + 1])
        by_k[:, k + 1 :, 3:] = np.cross(o[:, k : k + 1], o[:, k + 1 :])
        grown = np.einsum("nrl,njr,nj->nl", u[there, :, last:], by_k, vt[there, last])
        gradient[there, k] = np.linalg.norm(grown, axis=1) / sizes[there, -1]


def singular_distance(jacobian: Array) -> tuple[Array, NDArray[np.int_]]:
    """Return the first-order distance (rad, m of a slide) of the joints from a singularity.

    The manipulability w is zero there: w / |dw/dq| away. The gradient is w tr(J+ dJ/dq_k), with the columns (v_i, o_i)
    of a serial arm dv_i/dq_k = o_k x v_i for k <= i, else o_i x v_k; do_i/dq_k = o_k x o_i for k < i, else 0
    (Hollerbach 1985). For six joints and more it depends neither on units nor on the target.

    Returns:
        ``(n,)`` distances, and the joint (from 0) that moves most.
    """
    few = jacobian.shape[2] < 6
    inverse = _clipped_inverse(jacobian) if few else _inverse(jacobian)
    columns = jacobian.swapaxes(1, 2)  # (n, joints, 6)
    v, o = columns[..., :3], columns[..., 3:]
    # With rows (a_j, b_j) of the inverse, dw/dq_k / w is o_k (v_j x a_j) over j >= k, o_k (o_j x b_j) over j > k, and
    # v_k (a_j x o_j) over j < k: sums that go on from one joint to the next.
    by_v, by_o, before = np.cross(v, inverse[..., :3]), np.cross(o, inverse[..., 3:]), np.cross(inverse[..., :3], o)
    from_here = np.cumsum((by_v + by_o)[:, ::-1], axis=1)[:, ::-1] - by_o
    gradient = np.einsum("njr,njr->nj", o, from_here) + np.einsum("njr,njr->nj", v, np.cumsum(before, axis=1) - before)
    if few:
        _where_singular(jacobian, gradient)
    distance: Array = 1 / np.maximum(np.linalg.norm(gradient, axis=1), 1e-300)
    return distance, np.abs(gradient).argmax(axis=1)
