"""Rigid motions as arrays: rotations ``(..., 3, 3)``, poses ``(..., 4, 4)``, quaternions wxyz.

``T_a_b`` is the pose of b in a: ``p_a = T_a_b @ p_b`` and ``T_a_c = T_a_b @ T_b_c``.
A rotation vector is axis times angle (rad); ``exp`` and ``log`` convert. Lengths in metres.
"""

import numpy as np
from numpy.typing import NDArray

__all__ = [
    "Array",
    "exp",
    "inverse",
    "left_jacobian",
    "log",
    "nearest_rotation",
    "pose",
    "quaternion_from_rotation",
    "roll_pitch_yaw",
    "rotation_between",
    "rotation_from_quaternion",
    "rotation_from_roll_pitch_yaw",
    "skew",
    "transform",
]

Array = NDArray[np.float64]
_PRODUCTS = np.array(
    [
        [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, -1, 0, 0, 0, 0, -1],
        [0, 0, 0, -1, 0, 0, 1, 0, 0, 1, 0, 0, -1, 0, 0, 0],
        [0, 0, 1, 0, 0, 0, 0, 1, 1, 0, 0, 0, 0, 1, 0, 0],
        [0, 0, 0, 1, 0, 0, 1, 0, 0, 1, 0, 0, 1, 0, 0, 0],
        [1, 0, 0, 0, 0, -1, 0, 0, 0, 0, 1, 0, 0, 0, 0, -1],
        [0, -1, 0, 0, -1, 0, 0, 0, 0, 0, 0, 1, 0, 0, 1, 0],
        [0, 0, -1, 0, 0, 0, 0, 1, -1, 0, 0, 0, 0, 1, 0, 0],
        [0, 1, 0, 0, 1, 0, 0, 0, 0, 0, 0, 1, 0, 0, 1, 0],
        [1, 0, 0, 0, 0, -1, 0, 0, 0, 0, -1, 0, 0, 0, 0, 1],
    ],
    dtype=np.float64,
)  # from a rotation's nine numbers to 4 q q' - 1, for its quaternion q = wxyz


def skew(v: Array) -> Array:
    """Return the matrix ``[v]x`` with ``[v]x w = v x w``; ``(..., 3)`` to ``(..., 3, 3)``."""
    v = np.asarray(v)
    matrix = np.zeros((*v.shape, 3), dtype=v.dtype)
    matrix[..., 2, 1], matrix[..., 0, 2], matrix[..., 1, 0] = v[..., 0], v[..., 1], v[..., 2]
    matrix[..., 1, 2], matrix[..., 2, 0], matrix[..., 0, 1] = -v[..., 0], -v[..., 1], -v[..., 2]
    return matrix


def _angle_series(angle_squared: Array) -> tuple[Array, Array, Array]:
    """``sin t / t``, ``(1 - cos t) / t^2`` and ``(t - sin t) / t^3`` from t^2, analytic for complex steps."""
    small = np.abs(angle_squared) < 1e-4
    if small.ndim == 0:  # one rotation, in the inner loop of every fit: one branch alone
        return _near_zero(angle_squared) if small else _away_from_zero(angle_squared)
    if small.all():
        return _near_zero(angle_squared)
    away = _away_from_zero(np.where(small, 1.0, angle_squared))
    a, b, c = (np.where(small, s, t) for s, t in zip(_near_zero(angle_squared), away, strict=True))
    return a, b, c


def _near_zero(s: Array) -> tuple[Array, Array, Array]:
    a = 1 - s / 6 * (1 - s / 20 * (1 - s / 42))
    return a, 0.5 - s / 24 * (1 - s / 30 * (1 - s / 56)), 1 / 6 - s / 120 * (1 - s / 42 * (1 - s / 72))


def _away_from_zero(s: Array) -> tuple[Array, Array, Array]:
    t = np.sqrt(s)
    sine = np.sin(t)
    return sine / t, 2 * np.sin(t / 2) ** 2 / s, (t - sine) / (s * t)


def exp(vector: Array) -> Array:
    """Rotation of a rotation vector (Rodrigues); ``(..., 3)`` rad in, ``(..., 3, 3)`` out."""
    vector = np.asarray(vector)
    a, b, _ = _angle_series((vector * vector).sum(-1))
    k = skew(vector)
    rotation: Array = np.eye(3) + a[..., None, None] * k + b[..., None, None] * (k @ k)
    return rotation


def log(rotation: Array) -> Array:
    """Rotation vector of a rotation, of length at most pi; the inverse of exp."""
    q = quaternion_from_rotation(rotation)
    sine = np.sqrt((q[..., 1:] ** 2).sum(axis=-1, keepdims=True))
    angle = 2 * np.arctan2(sine, np.abs(q[..., :1]))
    scale = np.divide(angle, sine, out=np.full_like(sine, 2.0), where=sine > 1e-12)
    vector: Array = np.where(q[..., :1] < 0, -scale, scale) * q[..., 1:]
    return vector


def left_jacobian(vector: Array) -> Array:
    """``J`` with ``exp(v + dv) = exp(J dv) exp(v)`` to first order; ``(..., 3)`` to ``(..., 3, 3)``."""
    vector = np.asarray(vector)
    _, b, c = _angle_series((vector * vector).sum(-1))
    k = skew(vector)
    jacobian: Array = np.eye(3) + b[..., None, None] * k + c[..., None, None] * (k @ k)
    return jacobian


def quaternion_from_rotation(rotation: Array) -> Array:
    """Unit quaternion wxyz from the largest pivot of four; ``(..., 3, 3)`` in, ``(..., 4)`` out."""
    r = np.asarray(rotation, dtype=np.float64)
    products = (np.eye(4).ravel() + r.reshape(-1, 9) @ _PRODUCTS).reshape(-1, 4, 4)
    pivot = np.argmax(products[:, range(4), range(4)], axis=1)
    q = products[np.arange(len(products)), pivot]
    unit: Array = q / np.sqrt((q * q).sum(axis=1, keepdims=True))
    return unit.reshape(*r.shape[:-2], 4)


def rotation_from_quaternion(quaternion: Array) -> Array:
    """Rotation of a quaternion wxyz of any length; ``(..., 4)`` in, ``(..., 3, 3)`` out."""
    q = np.asarray(quaternion, dtype=np.float64)
    q = q / np.linalg.norm(q, axis=-1, keepdims=True)
    k = skew(q[..., 1:])
    rotation: Array = np.eye(3) + 2 * (q[..., :1, None] * k + k @ k)
    return rotation


def roll_pitch_yaw(rotation: Array) -> Array:
    """Angles x, y, z (rad) with ``R = Rz(z) Ry(y) Rx(x)``, and z = 0 at a pitch of +-90 degrees."""
    r = np.asarray(rotation, dtype=np.float64)
    yaw = np.where(np.hypot(r[..., 0, 0], r[..., 1, 0]) < 1e-15, 0.0, np.arctan2(r[..., 1, 0], r[..., 0, 0]))
    c, s = np.cos(yaw), np.sin(yaw)
    pitch = np.arctan2(-r[..., 2, 0], c * r[..., 0, 0] + s * r[..., 1, 0])
    roll = np.arctan2(s * r[..., 0, 2] - c * r[..., 1, 2], c * r[..., 1, 1] - s * r[..., 0, 1])
    return np.stack([roll, pitch, yaw], axis=-1)


def rotation_from_roll_pitch_yaw(angles: Array) -> Array:
    """``R = Rz(z) Ry(y) Rx(x)`` of angles x, y, z (rad) about the fixed axes; ``(..., 3)`` in, ``(..., 3, 3)`` out."""
    x, y, z = (exp(np.asarray(angles)[..., i, None] * np.eye(3)[i]) for i in range(3))
    rotation: Array = z @ y @ x
    return rotation


def pose(rotation: Array, position: Array) -> Array:
    """Homogeneous matrix of a rotation ``(..., 3, 3)`` and a position ``(..., 3)``."""
    rotation, position = np.asarray(rotation), np.asarray(position)
    shape = np.broadcast_shapes(rotation.shape[:-2], position.shape[:-1])
    matrix = np.zeros((*shape, 4, 4), dtype=np.result_type(rotation, position, np.float64))
    matrix[..., :3, :3] = rotation
    matrix[..., :3, 3] = position
    matrix[..., 3, 3] = 1
    return matrix


def inverse(matrix: Array) -> Array:
    """Pose of a in b from the pose of b in a; ``(..., 4, 4)``."""
    transposed = np.swapaxes(matrix[..., :3, :3], -1, -2)
    return pose(transposed, -(transposed @ matrix[..., :3, 3, None])[..., 0])


def transform(matrix: Array, points: Array) -> Array:
    """Transform points ``(..., n, 3)`` from b into a, by the pose ``T_a_b`` ``(..., 4, 4)``."""
    moved: Array = points @ np.swapaxes(matrix[..., :3, :3], -1, -2) + matrix[..., None, :3, 3]
    return moved


def nearest_rotation(matrix: Array) -> Array:
    """Return the rotations nearest to matrices ``(..., 3, 3)`` in the Frobenius norm (Kabsch 1976)."""
    u, _, vt = np.linalg.svd(matrix)
    u[..., 2] *= np.sign(np.linalg.det(u @ vt))[..., None]
    nearest: Array = u @ vt
    return nearest


def rotation_between(a: Array, b: Array) -> Array:
    """Return the smallest rotation from unit vector a to unit vector b, both ``(3,)``."""
    axis, cosine = np.cross(a, b), float(np.dot(a, b))
    if cosine < -1 + 1e-12:  # opposite: half a turn about any axis normal to a
        normal = np.cross(a, np.eye(3)[np.argmin(np.abs(a))])
        return exp(np.pi * normal / np.linalg.norm(normal))
    k = skew(axis)
    rotation: Array = np.eye(3) + k + k @ k / (1 + cosine)
    return rotation
