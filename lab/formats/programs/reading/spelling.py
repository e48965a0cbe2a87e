"""How controllers write poses and joint positions as numbers: units, and what angles mean.

A rotation has many names: a quaternion and its negative, three angles and others half a turn away, a rotation vector
and others a whole turn away, and at gimbal lock any share of two angles. Written is the one that is nearest to the
numbers that a text has already.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from lab.core import se3
from lab.core.se3 import Array

__all__ = ["FIXED_XYZ", "MOVING_XYZ", "MOVING_ZYX", "QUATERNION", "ROTATION_VECTOR", "PoseSpelling"]

_LOCKED = 1e-7  # of the middle angle's cosine: the two others are then one
_TURN, _HALF = 360.0, 180.0


@dataclass(frozen=True)
class PoseSpelling:
    """How a controller writes a pose: three coordinates and three or four numbers of a rotation.

    Attributes:
        per_m: of the unit of length.
        parts: how many numbers a rotation has.
        rotation: of those numbers, ``(3, 3)``.
        near: the numbers of a rotation ``(3, 3)`` nearest to others.
        words: units and meaning, for people.
    """

    per_m: float
    parts: int
    rotation: Callable[[Array], Array]
    near: Callable[[Array, Array], Array]
    words: str

    def pose(self, values: Array) -> Array:
        """The pose ``(4, 4)`` (m) of numbers."""
        return se3.pose(self.rotation(values[3:]), values[:3] / self.per_m)

    def spelt(self, T: Array, was: Array) -> Array:
        """The numbers of a pose ``(4, 4)`` (m), nearest to those of a text.

        Added to the text's numbers is what changes, so that a quaternion that was rounded stays as long as it is.
        """
        same = self.near(self.rotation(was[3:]), was[3:])
        length = float(np.linalg.norm(was[3:])) if self.parts == 4 else 1.0
        turned = was[3:] + length * (self.near(T[:3, :3], was[3:]) - same)
        return np.concatenate([self.per_m * T[:3, 3], turned])


def _quaternion_near(R: Array, was: Array) -> Array:
    found = se3.quaternion_from_rotation(R)
    return found if found @ was >= 0 else -found


def _vector_near(R: Array, was: Array) -> Array:
    """The rotation vector nearest to another one, by whole turns about its axis."""
    found = se3.log(R)
    angle = float(np.linalg.norm(found))
    if angle < 1e-12:
        axis = was / np.linalg.norm(was) if np.linalg.norm(was) > np.pi else np.zeros(3)
        return np.asarray(found + axis * 2 * np.pi * np.round(np.linalg.norm(was) / (2 * np.pi)))
    axis = found / angle
    return np.asarray(axis * (angle + 2 * np.pi * np.round((axis @ was - angle) / (2 * np.pi))))


def _fixed_matrix(values: Array) -> Array:
    return se3.rotation_from_roll_pitch_yaw(np.deg2rad(values))


def _fixed_near(R: Array, was: Array) -> Array:
    """Angles (deg) about the fixed axes x, y and z nearest to others."""
    middle = np.hypot(R[0, 0], R[1, 0])
    if middle < _LOCKED:
        last = np.deg2rad(was[2])
        back = se3.exp(np.array([0.0, 0.0, -last])) @ R
        pitch = np.arctan2(-back[2, 0], back[0, 0])
        first = np.arctan2(-back[1, 2], back[1, 1])
        found = np.rad2deg([first, pitch, last])
    else:
        found = np.rad2deg(se3.roll_pitch_yaw(R))
    choices = [found, np.array([found[0] + _HALF, _HALF - found[1], found[2] + _HALF])]
    near = [each + _TURN * np.round((was - each) / _TURN) for each in choices]
    best = np.asarray(min(near, key=lambda each: float(np.abs(each - was).sum())))
    usual = np.abs(was) <= _HALF  # what a text keeps within half a turn stays so
    return np.where(usual & (np.abs(best) > _HALF), best - _TURN * np.sign(best), best)


def _moving_zyx_near(R: Array, was: Array) -> Array:
    return _fixed_near(R, was[::-1])[::-1]


def _moving_xyz_near(R: Array, was: Array) -> Array:
    """R = Rx Ry Rz is the inverse of turns about the fixed axes, by the opposite angles."""
    return -_fixed_near(R.T, -was)


QUATERNION = PoseSpelling(1e3, 4, se3.rotation_from_quaternion, _quaternion_near, "mm and a quaternion wxyz")
MOVING_ZYX = PoseSpelling(
    1e3, 3, lambda values: _fixed_matrix(values[::-1]), _moving_zyx_near, "mm and degrees, A about z, B new y, C new x"
)
FIXED_XYZ = PoseSpelling(1e3, 3, _fixed_matrix, _fixed_near, "mm and degrees about the fixed x, y and z")
MOVING_XYZ = PoseSpelling(
    1e3,
    3,
    lambda values: _fixed_matrix(-values).T,
    _moving_xyz_near,
    "mm and degrees, Rx about x, Ry about the new y, Rz about the new z",
)
ROTATION_VECTOR = PoseSpelling(1.0, 3, se3.exp, _vector_near, "m and a rotation vector, rad")
