"""How near an arm stands to a singularity, from its Jacobian alone."""

import numpy as np
from numpy.typing import NDArray

from lab.frames import Array


def manipulability(jacobian: Array) -> Array:
    """The product w ``(n,)`` of the singular values of ``(n, 6, joints)``: of six joints |det J|, of more
    sqrt(det J J') (Yoshikawa 1985); m^3.
    """
    return np.asarray(np.prod(np.linalg.svd(jacobian, compute_uv=False), axis=1))


def singular_distance(jacobian: Array) -> tuple[Array, NDArray[np.int_]]:
    """How far (rad, m of a slide) the joints are from where the arm is singular, to first order.

    The manipulability w is zero there: by its gradient that is w / |dw/dq| away. The gradient is w tr(J+ dJ/dq_k),
    and of a serial arm's columns (v_i, o_i) dv_i/dq_k = o_k x v_i for k <= i, else o_i x v_k; do_i/dq_k = o_k x o_i
    for k < i, else 0 (Hollerbach 1985). Of six joints and more neither units nor the choice of the target change it.

    Args:
        jacobian: ``(n, 6, joints)``, geometric.

    Returns:
        ``(n,)`` the distances, and the joint (from 0) that would have to move most.
    """
    u, sizes, vt = np.linalg.svd(jacobian, full_matrices=False)
    inverse = (vt.swapaxes(1, 2) / np.maximum(sizes, 1e-15 * sizes[:, :1])[:, None]) @ u.swapaxes(1, 2)
    columns = jacobian.swapaxes(1, 2)  # (n, joints, 6)
    v, o = columns[..., :3], columns[..., 3:]
    gradient = np.empty(columns.shape[:2])  # of log w
    for k in range(columns.shape[1]):
        by_k = np.zeros_like(columns)
        by_k[:, k:, :3] = np.cross(o[:, k : k + 1], v[:, k:])
        by_k[:, :k, :3] = np.cross(o[:, :k], v[:, k : k + 1])
        by_k[:, k + 1 :, 3:] = np.cross(o[:, k : k + 1], o[:, k + 1 :])
        gradient[:, k] = np.einsum("njr,njr->n", inverse, by_k)
    distance: Array = 1 / np.maximum(np.linalg.norm(gradient, axis=1), 1e-300)
    return distance, np.abs(gradient).argmax(axis=1)
