"""Measured orientations: quaternions, or angles in a given convention."""

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from lab.core import se3
from lab.core.errors import LabError, option_name
from lab.core.limits import QUATERNION_NORM
from lab.core.measurements import Measurements
from lab.core.orientation import ANGLE_CONVENTIONS, AngleConvention
from lab.core.se3 import Array

__all__ = [
    "ENDS",
    "orientation_columns",
    "orientation_texts",
    "oriented_target",
    "read_orientations",
    "rotation_from_angles",
]

_QUATERNION = ("qw", "qx", "qy", "qz")
_ANGLES = ("rx_deg", "ry_deg", "rz_deg")
ENDS = (*_QUATERNION, *_ANGLES)  # of the columns of an orientation


def oriented_target(data: Measurements) -> str:
    """Return the one target with an orientation."""
    oriented = [t for t in data.targets if any(f"{t}_{end}" in data.other for end in ENDS)]
    if not oriented and len(data.targets) == 1 and set(ENDS) & set(data.other):
        oriented = [data.targets[0]]
    if not oriented:
        first = data.targets[0]
        raise LabError(f"no orientation to observe: give {first}_qw to {first}_qz, or {first}_rx_deg to {first}_rz_deg")
    if len(oriented) > 1:
        raise LabError(f"targets {' and '.join(oriented)} have orientations: keep those of one, as the tool is rigid")
    return oriented[0]


def read_orientations(data: Measurements, target: str, meaning: AngleConvention | None = None) -> Array:
    """Return unit quaternions wxyz ``(n, 4)`` of a target in the instrument's frame, NaN if not measured.

    Args:
        meaning: convention of three angles.
    """
    columns = orientation_columns(data, target)
    numbers = np.stack([_numbers(data.other[column]) for column in columns], axis=1)
    empty = np.isnan(numbers)
    if (half := np.flatnonzero(empty.any(axis=1) & ~empty.all(axis=1))).size:
        column = columns[int(np.argmax(empty[half[0]]))]
        raise LabError(f"{data.where(half[0])}, column {column}: empty beside others; give all or none")
    if len(columns) == len(_QUATERNION):
        norm = np.linalg.norm(numbers, axis=1)
        if (off := np.flatnonzero(QUATERNION_NORM.outside(norm))).size:
            raise LabError(
                f"{data.where(off[0])}, columns {columns[0]} to {columns[3]}: the quaternion's norm is "
                f"{norm[off[0]]:.6g}, not 1: fix the row, or the columns' order"
            )
        return np.asarray(numbers / norm[:, None])
    if meaning is None:
        known = f"{', '.join(ANGLE_CONVENTIONS[:-1])} or {ANGLE_CONVENTIONS[-1]}"
        raise LabError(f"columns {', '.join(columns)} are angles: give {option_name('orientation')} {known}")
    complete = ~empty.any(axis=1)
    quaternions = np.full((len(data), 4), np.nan)
    quaternions[complete] = se3.quaternion_from_rotation(rotation_from_angles(np.deg2rad(numbers[complete]), meaning))
    return quaternions


def orientation_columns(data: Measurements, target: str) -> list[str]:
    """Return the columns of a target's orientation as the file names them: four of a quaternion, or three of angles."""
    quaternion, angles = (_columns(data, target, ends) for ends in (_QUATERNION, _ANGLES))
    if quaternion and angles:
        raise LabError(f"columns {quaternion[0]} and {angles[0]} both give an orientation: keep one")
    return quaternion or angles


def _columns(data: Measurements, target: str, ends: tuple[str, ...]) -> list[str]:
    found, missing = [], []
    for end in ends:
        names = [f"{target}_{end}", *([end] if len(data.targets) == 1 else [])]
        present = [name for name in names if name in data.other]
        if len(present) > 1:
            raise LabError(f"columns {' and '.join(present)} are the same: keep one")
        found += present
        missing += [] if present else names[:1]
    if found and missing:
        raise LabError(f"column {missing[0]} is missing beside {found[0]}: an orientation takes all of them")
    return found


@lru_cache(maxsize=4)  # the columns of one orientation, for several models of one file
def _numbers(texts: tuple[str, ...]) -> Array:
    return np.array([float(text) if text else np.nan for text in texts])


def rotation_from_angles(angles: Array, meaning: AngleConvention) -> Array:
    """Return rotations ``(..., 3, 3)`` of three angles (rad) ``(..., 3)`` in a convention."""
    if meaning == "rotation-vector":
        return se3.exp(angles)
    if meaning == "fixed-xyz":
        return se3.rotation_from_roll_pitch_yaw(angles)
    return se3.rotation_from_roll_pitch_yaw(-angles).swapaxes(-1, -2)  # Rx(a) Ry(b) Rz(c)


def orientation_texts(
    target: str, rotations: Array, measured: NDArray[np.bool_], meaning: AngleConvention | None = None
) -> dict[str, tuple[str, ...]]:
    """Return the columns of rotations for ``read_orientations``.

    Args:
        rotations: ``(n, 3, 3)``.
        measured: ``(n,)``; cells of other rows are empty.
        meaning: convention of three angles; quaternions by default.
    """
    ends: tuple[str, ...] = _QUATERNION if meaning is None else _ANGLES
    numbers = se3.quaternion_from_rotation(rotations) if meaning is None else np.rad2deg(_angles(rotations, meaning))
    cells = [[repr(x) if there else "" for x in row] for row, there in zip(numbers.tolist(), measured, strict=True)]
    return {f"{target}_{end}": tuple(column) for end, column in zip(ends, zip(*cells, strict=True), strict=True)}


def _angles(rotations: Array, meaning: AngleConvention) -> Array:
    if meaning == "rotation-vector":
        return se3.log(rotations)
    if meaning == "fixed-xyz":
        return se3.roll_pitch_yaw(rotations)
    return -se3.roll_pitch_yaw(rotations.swapaxes(-1, -2))
