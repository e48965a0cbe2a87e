"""Project points through a pinhole camera with Brown's distortion, with analytic derivatives.

A point (x, y, z) in the camera's frame (z forward, x to the right of the picture, y down) has the normalised
coordinates (a, b) = (x, y) / z. Radial terms k1, k2, k3 and tangential terms p1, p2 distort them (Brown 1971):
a' = a (1 + k1 r^2 + k2 r^4 + k3 r^6) + 2 p1 a b + p2 (r^2 + 2 a^2), r^2 = a^2 + b^2, and b' alike with p1 and p2
exchanged. The picture's coordinates are u = fx a' + cx, v = fy b' + cy, whole at the middle of a pixel.
"""

import numpy as np
from numpy.typing import NDArray

from lab.core.se3 import Array

__all__ = ["INTRINSICS", "distorted", "projected", "sight_lines"]

INTRINSICS = ("fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2", "k3")
"""Names of a camera's intrinsic parameters: focal lengths and centre in units of the picture, then the distortion."""
_STEPS, _SETTLED = 50, 1e-15  # of Newton's method, by which distortion is removed
_LEAST_DEPTH_M = 1e-6


def distorted(flat: Array, distortion: Array) -> tuple[Array, Array, Array]:
    """Distort normalised coordinates.

    Args:
        flat: ``(..., 2)``.
        distortion: ``(..., 5)`` k1, k2, p1, p2, k3.

    Returns:
        ``(..., 2)``, and the derivatives ``(..., 2, 2)`` by ``flat`` and ``(..., 2, 5)`` by ``distortion``.
    """
    a, b = flat[..., 0], flat[..., 1]
    k1, k2, p1, p2, k3 = np.moveaxis(distortion, -1, 0)
    s = a * a + b * b
    radial, slope = 1 + s * (k1 + s * (k2 + s * k3)), k1 + s * (2 * k2 + 3 * s * k3)
    bent = np.stack(
        [a * radial + 2 * p1 * a * b + p2 * (s + 2 * a * a), b * radial + p1 * (s + 2 * b * b) + 2 * p2 * a * b], -1
    )
    across = 2 * a * b * slope + 2 * p1 * a + 2 * p2 * b
    by_flat = np.stack(
        [
            np.stack([radial + 2 * a * a * slope + 2 * p1 * b + 6 * p2 * a, across], -1),
            np.stack([across, radial + 2 * b * b * slope + 6 * p1 * b + 2 * p2 * a], -1),
        ],
        -2,
    )
    by_distortion = np.stack(
        [
            np.stack([a * s, a * s * s, 2 * a * b, s + 2 * a * a, a * s**3], -1),
            np.stack([b * s, b * s * s, s + 2 * b * b, 2 * a * b, b * s**3], -1),
        ],
        -2,
    )
    return bent, by_flat, by_distortion


def projected(points: Array, intrinsics: Array) -> tuple[Array, Array, Array]:
    """Project points in the camera's frame.

    Args:
        points: ``(n, 3)`` m.
        intrinsics: ``(n, 9)`` or ``(9,)``, in the order of ``INTRINSICS``.

    Returns:
        Places in the picture ``(n, 2)``, also of points behind the camera, and their derivatives ``(n, 2, 3)`` by the
        points and ``(n, 2, 9)`` by the intrinsic parameters.
    """
    near = np.abs(points[:, 2].real) < _LEAST_DEPTH_M
    depth = np.where(near, _LEAST_DEPTH_M, points[:, 2])
    flat = points[:, :2] / depth[:, None]
    scale, centre = intrinsics[..., :2], intrinsics[..., 2:4]
    bent, by_flat, by_distortion = distorted(flat, np.broadcast_to(intrinsics[..., 4:], (len(points), 5)))
    by_point = np.zeros((len(points), 2, 3), dtype=bent.dtype)
    by_point[:, [0, 1], [0, 1]] = 1.0
    by_point[:, :, 2] = -flat
    by_point = by_flat @ by_point / depth[:, None, None]
    scaled = np.broadcast_to(scale, bent.shape)[..., None]
    by_intrinsics = np.zeros((len(points), 2, 9), dtype=bent.dtype)
    by_intrinsics[:, [0, 1], [0, 1]] = bent
    by_intrinsics[:, [0, 1], [2, 3]] = 1.0
    by_intrinsics[:, :, 4:] = scaled * by_distortion
    return scale * bent + centre, scaled * by_point, by_intrinsics


def sight_lines(places: Array, intrinsics: Array) -> Array:
    """Return normalised coordinates ``(n, 2)`` of places ``(n, 2)`` in the picture: undistorted, by Newton's method.

    Args:
        intrinsics: ``(9,)`` in the order of ``INTRINSICS``.
    """
    bent = (places - intrinsics[2:4]) / intrinsics[:2]
    flat, distortion = bent.copy(), np.broadcast_to(intrinsics[4:], (len(bent), 5))
    going: NDArray[np.bool_] = np.asarray(np.isfinite(bent).all(axis=1))
    for _ in range(_STEPS):
        there, slope, _ = distorted(flat[going], distortion[going])
        step = np.linalg.solve(slope, (bent[going] - there)[..., None])[..., 0]
        flat[going] += step
        going[going] = np.abs(step).max(axis=1) > _SETTLED
        if not going.any():
            break
    return flat
