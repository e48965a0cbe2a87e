"""Place boards and cameras in closed form, as initial values of a fit.

A board's pose in a camera is the homography of its plane, or the direct linear transform of corners that are not in a
plane, settled by a few Gauss-Newton steps on the corners. Cameras and boards then follow from ``A X = Z B`` by the
nearest Kronecker product (Shah 2013), hand-eye alone from ``A X = X B`` by the logarithms of relative rotations (Park &
Martin 1994).
"""

import numpy as np
from numpy.typing import NDArray

from lab.core import se3
from lab.core.se3 import Array

__all__ = ["board_poses", "hand_eye", "mean_pose", "robot_world", "robot_worlds"]

_STEPS, _SETTLED = 12, 1e-10  # of Gauss-Newton on a board's corners
_FLAT = 1e-6  # of a board's size: corners nearer to a plane are in it
_TURNED = np.deg2rad(1.0)  # relative rotations below show no direction of their axis


def board_poses(corners: Array, flat: Array) -> tuple[Array, Array]:
    """Return the poses of a board in a camera from the corners seen in each of some pictures.

    Args:
        corners: ``(c, 3)`` m, in the board's frame.
        flat: ``(v, c, 2)`` undistorted normalised coordinates, NaN where not seen.

    Returns:
        ``(v, 4, 4)`` m, and the root mean square residual ``(v,)`` in normalised coordinates. A picture of fewer than
        four corners (six of a board that is not flat), or of corners on a line, gives NaN.
    """
    seen: NDArray[np.bool_] = np.asarray(np.isfinite(flat).all(axis=2))
    centre = corners.mean(axis=0)
    spread, axes = np.linalg.svd(corners - centre)[1:]
    size = float(spread[0]) / np.sqrt(len(corners))
    frame = axes.T if np.linalg.det(axes) > 0 else axes.T @ np.diag([1.0, 1.0, -1.0])
    local = (corners - centre) @ frame / size
    is_flat = bool(spread[2] < _FLAT * spread[0])
    if is_flat:
        local[:, 2] = 0.0
    Ts = _from_homographies(local, flat, seen) if is_flat else _from_projections(local, flat, seen)
    Ts, residual = _settled(Ts, local, flat, seen)
    Ts[:, :3, 3] *= size
    T_local_board = se3.inverse(se3.pose(frame, centre))
    return np.asarray(Ts @ T_local_board), residual


def _null_vectors(rows: Array) -> Array:
    """Return unit vectors ``(v, m)`` that rows ``(v, r, m)`` map nearest to zero; NaN where several do."""
    size, axes = np.linalg.eigh(np.swapaxes(rows, 1, 2) @ rows)
    unique = size[:, 1] > 1e-12 * size[:, -1]
    return np.where(unique[:, None], axes[:, :, 0], np.nan)


def _from_homographies(local: Array, flat: Array, seen: NDArray[np.bool_]) -> Array:
    """Return poses ``(v, 4, 4)`` from homographies: their columns are two axes and the place (Zhang 2000)."""
    plane = np.column_stack([local[:, :2], np.ones(len(local))])
    there = np.where(seen[..., None], flat, 0.0)
    rows = np.zeros((*flat.shape, 9))
    rows[:, :, 0, :3] = rows[:, :, 1, 3:6] = plane
    rows[..., 6:] = -there[..., None] * plane[:, None]
    h = _null_vectors((rows * seen[..., None, None]).reshape(len(flat), -1, 9)).reshape(-1, 3, 3)
    depth = h[:, 2] @ plane.T
    h = h * np.sign(np.where(seen, depth, 0.0).sum(axis=1))[:, None, None]  # the board is before the camera
    scale = np.sqrt(np.linalg.norm(h[:, :, 0], axis=1) * np.linalg.norm(h[:, :, 1], axis=1))
    h = h / np.where(scale > 0, scale, np.nan)[:, None, None]
    return _poses(np.stack([h[..., 0], h[..., 1], np.cross(h[..., 0], h[..., 1])], axis=2), h[..., 2])


def _from_projections(local: Array, flat: Array, seen: NDArray[np.bool_]) -> Array:
    """Return poses ``(v, 4, 4)`` from the direct linear transform of corners in space."""
    space = np.column_stack([local, np.ones(len(local))])
    there = np.where(seen[..., None], flat, 0.0)
    rows = np.zeros((*flat.shape, 12))
    rows[:, :, 0, :4] = rows[:, :, 1, 4:8] = space
    rows[..., 8:] = -there[..., None] * space[:, None]
    p = _null_vectors((rows * seen[..., None, None]).reshape(len(flat), -1, 12)).reshape(-1, 3, 4)
    p = p * np.sign(np.where(seen, p[:, 2] @ space.T, 0.0).sum(axis=1))[:, None, None]
    scale = np.cbrt(np.abs(np.linalg.det(np.nan_to_num(p[..., :3]))))
    p = p / np.where(scale > 0, scale, np.nan)[:, None, None]
    return _poses(p[..., :3], p[..., 3])


def _poses(matrices: Array, places: Array) -> Array:
    known = np.asarray(np.isfinite(matrices).all(axis=(1, 2)) & np.isfinite(places).all(axis=1))
    rotations = se3.nearest_rotation(np.where(known[:, None, None], matrices, np.eye(3)))
    return se3.pose(rotations, np.where(known[:, None], places, np.nan))


def _settled(Ts: Array, local: Array, flat: Array, seen: NDArray[np.bool_]) -> tuple[Array, Array]:
    """Return the poses ``(v, 4, 4)`` of least squares on the corners, by Gauss-Newton, and their residuals ``(v,)``."""
    Ts = Ts.copy()
    going: NDArray[np.bool_] = np.asarray(np.isfinite(Ts).all(axis=(1, 2)))
    count = seen.sum(axis=1)
    residual = np.full(len(Ts), np.nan)
    for _ in range(_STEPS):
        at = np.flatnonzero(going)
        if not len(at):
            break
        turned = local @ np.swapaxes(Ts[at, :3, :3], 1, 2)
        points = turned + Ts[at, None, :3, 3]
        there = points[..., :2] / points[..., 2:]
        left = np.where(seen[at, :, None], flat[at] - there, 0.0)
        residual[at] = np.sqrt((left**2).sum(axis=(1, 2)) / np.maximum(count[at], 1))
        by_point = np.zeros((*there.shape, 3))
        by_point[..., [0, 1], [0, 1]] = 1.0
        by_point[..., 2] = -there
        by_point *= np.where(seen[at], 1.0 / points[..., 2], 0.0)[..., None, None]
        rows = np.concatenate([by_point, -by_point @ se3.skew(turned)], axis=3).reshape(len(at), -1, 6)
        normal = np.swapaxes(rows, 1, 2) @ rows
        normal += 1e-14 * np.trace(normal, axis1=1, axis2=2)[:, None, None] * np.eye(6)
        step = np.linalg.solve(normal, np.swapaxes(rows, 1, 2) @ left.reshape(len(at), -1, 1))[..., 0]
        Ts[at, :3, 3] += step[:, :3]
        Ts[at, :3, :3] = se3.exp(step[:, 3:]) @ Ts[at, :3, :3]
        going[at] = np.abs(step).max(axis=1) > _SETTLED
    return Ts, residual


def robot_world(As: Array, Bs: Array) -> tuple[Array, Array]:
    """Solve ``A_i X = Z B_i`` for X and Z (Shah 2013): the rotations as the nearest Kronecker product, then the places.

    Args:
        As, Bs: ``(v, 4, 4)`` m each, of three poses at least with rotations about different axes.

    Returns:
        X and Z, ``(4, 4)`` each.
    """
    X, Z = robot_worlds(As, Bs, np.ones((1, len(As))))
    return X[0], Z[0]


def robot_worlds(As: Array, Bs: Array, weights: Array) -> tuple[Array, Array]:
    """Solve ``robot_world`` for several sets of weights ``(b, v)`` of the poses: X and Z, ``(b, 4, 4)`` each."""
    Ra, Rb = As[:, :3, :3], Bs[:, :3, :3]
    # vec Z = (sum A x B) vec X, rows first: Z = A X B'
    products = np.einsum("vij,vkl->vikjl", Ra, Rb).reshape(len(As), 81)
    u, _, vt = np.linalg.svd((weights @ products).reshape(-1, 9, 9))
    X, Z = vt[:, 0].reshape(-1, 3, 3), u[:, :, 0].reshape(-1, 3, 3)
    sign = np.where(np.linalg.det(X) < 0, -1.0, 1.0)[:, None, None]
    Rx, Rz = se3.nearest_rotation(sign * X), se3.nearest_rotation(sign * Z)
    # places: R_A t_X - t_Z = R_Z t_B - t_A
    rows = np.concatenate([Ra, np.broadcast_to(-np.eye(3), Ra.shape)], axis=2)
    right = Bs[:, :3, 3] @ np.swapaxes(Rz, 1, 2) - As[:, :3, 3]
    normal = (weights @ (np.swapaxes(rows, 1, 2) @ rows).reshape(len(rows), 36)).reshape(-1, 6, 6)
    normal += 1e-14 * np.trace(normal, axis1=1, axis2=2)[:, None, None] * np.eye(6)
    moment = (weights[..., None] * right).reshape(len(weights), -1) @ rows.reshape(-1, 6)
    places = np.linalg.solve(normal, moment[..., None])[..., 0]
    return se3.pose(Rx, places[:, :3]), se3.pose(Rz, places[:, 3:])


def hand_eye(As: Array, Bs: Array) -> Array:
    """Solve ``A_ij X = X B_ij`` for X from all relative motions of poses (Park & Martin 1994).

    Args:
        As, Bs: ``(v, 4, 4)`` m each: poses, whose relative motions ``A_j^-1 A_i`` and ``B_j^-1 B_i`` X relates.

    Returns:
        X ``(4, 4)``.
    """
    first, second = np.triu_indices(len(As), 1)
    moved_a = se3.inverse(As[second]) @ As[first]
    moved_b = se3.inverse(Bs[second]) @ Bs[first]
    alpha, beta = se3.log(moved_a[:, :3, :3]), se3.log(moved_b[:, :3, :3])
    shown = np.linalg.norm(alpha, axis=1) > _TURNED
    rotation = se3.nearest_rotation((alpha[shown, :, None] * beta[shown, None, :]).sum(axis=0))
    rows = (moved_a[:, :3, :3] - np.eye(3)).reshape(-1, 3)
    right = (moved_b[:, :3, 3] @ rotation.T - moved_a[:, :3, 3]).ravel()
    return se3.pose(rotation, np.asarray(np.linalg.lstsq(rows, right)[0], dtype=np.float64))


def mean_pose(Ts: Array) -> Array:
    """Return the mean ``(4, 4)`` of poses ``(v, 4, 4)``: the mean place, and the rotation nearest to the sum."""
    return se3.pose(se3.nearest_rotation(Ts[:, :3, :3].sum(axis=0)), Ts[:, :3, 3].mean(axis=0))
