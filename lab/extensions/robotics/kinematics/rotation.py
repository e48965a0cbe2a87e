"""Convert a rotation between all usual descriptions: matrix, quaternion, axis and angle, three angles in twelve orders.

All solutions are given, and where a description is singular what of it is determined (Mallem 2011, annex; Khalil &
Dombre 2002, chapter 3).
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from lab.core import se3
from lab.core.errors import LabError
from lab.core.euler import AxisAngle, EulerAngles, axis_angle, euler_angles, rotation_from_euler
from lab.core.limits import OPTION_SIZE, POSITIVE_OPTION, QUATERNION_NORM, ROTATION_ERROR
from lab.core.orientation import ORDERS
from lab.core.se3 import Array
from lab.extensions.robotics.kinematics.kinematics_options import KinematicsOptions
from lab.extensions.robotics.kinematics.kinematics_result import tidied
from lab.library.result import Result, tidy

__all__ = ["Rotation", "converted", "determined"]

_ROUNDED = 1e-6  # of R'R - 1: a matrix that misses it is mended, and the reader told


@dataclass(frozen=True, repr=False, eq=False)
class Rotation(Result):
    """A rotation in all its descriptions.

    Attributes:
        matrix: ``(3, 3)``; its columns are the turned axes.
        quaternion: ``(4,)`` wxyz, w not negative; its negative is the same rotation.
        axis: of the rotation, and its angle.
        angles: in every order of axes.
    """

    command = "kinematics"

    options: KinematicsOptions
    matrix: Array
    quaternion: Array
    axis: AxisAngle
    angles: tuple[EulerAngles, ...]
    warnings: tuple[str, ...]

    def to_dict(self) -> dict[str, Any]:
        """Return the output of ``--json``: angles in the unit of the options."""
        free = bool(np.isnan(self.axis.axis).any())
        return {
            "unit": "rad" if self.options.radians else "deg",
            "matrix": [tidied(row) for row in self.matrix],
            "quaternion": tidied(self.quaternion),
            "axis": None if free else tidied(self.axis.axis),
            "angle": self.in_unit(self.axis.angle),
            "both_axes": self.axis.both_axes,
            "axis_angles": self._in_unit(self.axis_directions()),
            "orders": {
                angles.order: {
                    "solutions": self._in_unit(angles.solutions),
                    "singular": bool(angles.free),
                    "determined": determined(angles),
                }
                for angles in self.angles
            },
            "warnings": list(self.warnings),
        }

    def _in_unit(self, rows: Iterable[Iterable[float]]) -> list[list[float]]:
        return [[self.in_unit(angle) for angle in row] for row in rows]

    def columns(self) -> Mapping[str, Sequence[Any]]:
        """Return a row for each order and solution: a, b and c in the unit of the options."""
        rows = [(each.order, *row) for each in self.angles for row in each.solutions]
        unit = "rad" if self.options.radians else "deg"
        names = ("order", *(f"{name}_{unit}" for name in "abc"))
        return {name: [row[i] if i == 0 else self.in_unit(row[i]) for row in rows] for i, name in enumerate(names)}

    def in_unit(self, angle: float) -> float:
        """Return an angle (rad) in the unit of the options."""
        return tidy(angle if self.options.radians else np.rad2deg(angle))

    def axis_directions(self) -> list[tuple[float, float]]:
        """Return alpha and beta (rad) of the axis, which is Rz(alpha) Rx(beta) z: both solutions; none of no axis."""
        x, y, z = self.axis.axis
        if not np.isfinite(x):
            return []
        level = float(np.hypot(x, y))
        alpha, beta = float(np.arctan2(x, -y)) if level > 0 else 0.0, float(np.arctan2(level, z))
        return [(alpha, beta), (alpha - np.pi if alpha > 0 else alpha + np.pi, -beta)]


def converted(options: KinematicsOptions) -> Rotation:
    """Convert the rotation of the options to all its descriptions.

    Raises:
        LabError: what is given is no rotation.
    """
    R, warnings = _given(options)
    quaternion = se3.quaternion_from_rotation(R)
    return Rotation(
        options, R, np.where(quaternion[0] < 0, -quaternion, quaternion) + 0.0, axis_angle(R),
        tuple(euler_angles(R, order) for order in ORDERS), warnings,
    )  # fmt: skip


def _given(options: KinematicsOptions) -> tuple[Array, tuple[str, ...]]:
    """Return the rotation matrix that options give, and warnings."""
    unit = 1.0 if options.radians else np.pi / 180
    if options.quaternion:
        quaternion = _numbers("--quaternion", options.quaternion, 4, "w,x,y,z")
        norm = float(np.linalg.norm(quaternion))
        if norm not in QUATERNION_NORM:
            raise LabError(f"--quaternion: its norm is {norm:.6g}, not 1; mend it, or its order w,x,y,z")
        return se3.rotation_from_quaternion(quaternion), ()
    if options.axis:
        axis = _numbers("--axis", options.axis, 3, "x,y,z")
        size = float(np.linalg.norm(axis))
        if size not in POSITIVE_OPTION:
            raise LabError(f"--axis is {size:g} long; give a direction that is not zero")
        angle = _numbers("--angle", (options.angle or 0.0,), 1, "one angle")[0]
        return se3.exp(axis / size * angle * unit), ()
    if options.angles:
        angles = _numbers("--angles", options.angles, 3, "a,b,c") * unit
        order = options.order
        if options.fixed:
            return rotation_from_euler(angles[::-1], order[::-1]), ()  # type: ignore[arg-type]
        return rotation_from_euler(angles, order), ()
    return _mended(_numbers("--matrix", options.matrix, 9, "its rows, one after the other").reshape(3, 3))


def _mended(matrix: Array) -> tuple[Array, tuple[str, ...]]:
    """Return the rotation nearest to a matrix, and a warning where that changes it."""
    missed = float(np.abs(matrix.T @ matrix - np.eye(3)).max())
    if missed not in ROTATION_ERROR:
        raise LabError(f"--matrix: RᵀR misses 1 by {missed:.2g}; give a rotation, with three digits or more")
    if np.linalg.det(matrix) < 0:
        raise LabError("--matrix: its determinant is −1, as of a reflection; mend the sign of a row or column")
    moved = f"--matrix: RᵀR misses 1 by {missed:.2g}; the nearest rotation is taken"
    return se3.nearest_rotation(matrix), (moved,) if missed > _ROUNDED else ()


def _numbers(flag: str, given: Sequence[float], count: int, what: str) -> Array:
    if len(given) != count:
        raise LabError(f"{flag} has {len(given)} numbers, not {count}; give {what}")
    if bad := [each for each in given if abs(each) not in OPTION_SIZE]:
        raise LabError(f"{flag} {bad[0]:g}: give finite numbers of at most {OPTION_SIZE.most:g}")
    return np.array(given, dtype=np.float64)


def determined(each: EulerAngles) -> str:
    """Name what of the angles is determined where the order is singular; empty elsewhere."""
    return {1: "c + a", -1: "c − a", 0: ""}[each.free]
