"""Describe rotations by three angles in all twelve orders, and by an axis and an angle, with all solutions.

An order like ``zyx`` names the moving axes in turn: R = Rz(a) Ry(b) Rx(c). About fixed axes the turns come in reverse
order: the same R is a turn by c about x, then by b about y, then by a about z.
"""

from dataclasses import dataclass

import numpy as np

from lab.core import se3
from lab.core.orientation import Order
from lab.core.se3 import Array

__all__ = ["AxisAngle", "EulerAngles", "axis_angle", "euler_angles", "rotation_from_euler"]

_SINGULAR = 1e-7  # rad: by how much angle b misses the singular pose, or an angle zero; rounding moves it by 1e-8


@dataclass(frozen=True)
class EulerAngles:
    """Three angles of a rotation.

    Attributes:
        order: of the moving axes.
        solutions: ``(2, 3)`` rad, a, b and c of both; where singular ``(1, 3)``, the one with a = 0.
        free: where singular 1 or -1: any a and c with the same c + free a are a solution; else 0.
    """

    order: Order
    solutions: Array
    free: int


@dataclass(frozen=True)
class AxisAngle:
    """Axis and angle of a rotation; minus the axis and minus the angle are the other solution.

    Attributes:
        axis: ``(3,)`` unit vector; NaN where any will do, as nothing is turned.
        angle: rad, 0 to pi.
        both_axes: true for half a turn, where minus the axis and the same angle are a solution too.
    """

    axis: Array
    angle: float
    both_axes: bool


def rotation_from_euler(angles: Array, order: Order) -> Array:
    """Return the rotation ``(3, 3)`` of three angles (rad) about moving axes.

    Example:
        >>> rotation_from_euler((np.pi / 2, 0, 0), "zyx").round(6).tolist()
        [[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]
    """
    a, b, c = (se3.exp(angle * np.eye(3)["xyz".index(axis)]) for angle, axis in zip(angles, order, strict=True))
    return np.asarray(a @ b @ c)


def euler_angles(rotation: Array, order: Order) -> EulerAngles:
    """Find the angles of a rotation ``(3, 3)`` in an order, both solutions.

    Angle a is that of the plane through the last axis; the others follow when it is turned back, so that they are exact
    near the singular pose as well (b = 0 or 180 degrees if the first and the last axis are one, else b = +-90 degrees).
    """
    i, j, k = ("xyz".index(axis) for axis in order)
    across = 3 - i - j  # the third axis
    even = 1.0 if (j - i) % 3 == 1 else -1.0
    if i == k:
        sine, cosine = rotation[j, i], -even * rotation[across, i]
    else:
        sine, cosine = -even * rotation[j, k], rotation[k, k]
    singular = bool(np.hypot(sine, cosine) < _SINGULAR)
    first = 0.0 if singular else float(np.arctan2(sine, cosine))
    starts = [first] if singular else [first, first + np.pi]
    found = []
    for a in starts:
        M = se3.exp(-a * np.eye(3)[i]) @ rotation
        if i == k:
            b, c = np.arctan2(-even * M[across, i], M[i, i]), np.arctan2(-even * M[j, across], M[j, j])
        else:
            b, c = np.arctan2(even * M[i, k], M[k, k]), np.arctan2(even * M[j, i], M[j, j])
        found.append([a, b, c])
    solutions = np.array(found)
    solutions -= 2 * np.pi * np.ceil(solutions / (2 * np.pi) - 0.5)  # above -180, up to 180 degrees
    upright = np.cos(solutions[0, 1]) if i == k else even * np.sin(solutions[0, 1])
    return EulerAngles(order, solutions, int(np.sign(upright)) if singular else 0)


def axis_angle(rotation: Array) -> AxisAngle:
    """Find the axis and the angle of a rotation ``(3, 3)`` by its quaternion, exact at every angle.

    Example:
        >>> axis_angle(np.diag([1.0, -1.0, -1.0]))
        AxisAngle(axis=array([1., 0., 0.]), angle=3.141592653589793, both_axes=True)
    """
    w, *vector = se3.quaternion_from_rotation(rotation)
    axis = np.array(vector) * (-1.0 if w < 0 else 1.0)
    size = float(np.linalg.norm(axis))
    angle = 2 * float(np.arctan2(size, abs(w)))
    if size < _SINGULAR:
        return AxisAngle(np.full(3, np.nan), angle, both_axes=False)
    return AxisAngle(axis / size + 0.0, angle, both_axes=bool(np.pi - angle < _SINGULAR))
