"""Miss measured orientations by an arm that the positions place, and find in which other convention they may be.

Each orientation is compared with that of the arm's last frame; between the two is one rotation, that of the tool, which
most rows agree on.
"""

from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from itertools import permutations
from typing import TYPE_CHECKING

import numpy as np

from lab.core import se3
from lab.core.measurements import Measurements
from lab.core.orientation import ANGLE_CONVENTIONS
from lab.core.random import rng_for
from lab.core.se3 import Array
from lab.diagnosis.hypothesis import Hypothesis, unchanged
from lab.diagnosis.placement import placed
from lab.formats.orientations import (
    orientation_columns,
    orientation_texts,
    oriented_target,
    read_orientations,
)
from lab.kinematics.model import Model, RigidArm
from lab.sensors.tip import tip_rotations

if TYPE_CHECKING:
    from lab.sensors.full_pose import PoseSensor

__all__ = ["orientation_mistakes", "turned_misses"]

_LEVER_M = 0.3  # at which a wrong angle moves a point: about a wrist and a tool
_CENTRES = 16  # rows of which one is taken as the tool's rotation
_NEAR = 2.5  # times the median angle
_LEAST_RAD = 1e-4
_ROUNDS = 3
_TURNED = np.deg2rad(1.0)  # of another fixed frame: a smaller turn is within an arm's errors
_FREE = 10**6  # rotations that a free one is chosen from


def turned_misses(sensor: "PoseSensor", arm: Model, data: Measurements, values: Array) -> Array:
    """Return how far ``(n,)`` a point at a lever is off by each measured orientation (m); NaN where none was measured.

    Args:
        arm: measured by points.
        values: ``(p,)`` where its base and links are placed by the positions.
    """
    target = oriented_target(data)
    measured = _rotations(sensor, data, target)
    flange = _flange(arm, data, values, target)
    turn, seen = np.swapaxes(flange, 1, 2) @ measured, np.isfinite(measured).all(axis=(1, 2))
    angles = np.full(len(data), np.nan)
    if seen.any():
        angles[seen] = _angles_to(_common(turn[seen]), turn[seen])
    return _LEVER_M * angles


def _rotations(sensor: "PoseSensor", data: Measurements, target: str) -> Array:
    """Return the measured rotations ``(n, 3, 3)``, NaN where there are none."""
    quaternions = read_orientations(data, target, sensor.orientation)
    seen = np.isfinite(quaternions).all(axis=1) & data.used
    rotations = np.full((len(data), 3, 3), np.nan)
    rotations[seen] = se3.rotation_from_quaternion(quaternions[seen])
    return rotations


def _flange(arm: Model, data: Measurements, values: Array, target: str) -> Array:
    inputs = data.inputs(arm.conditions)
    return tip_rotations(arm, inputs, values, arm.points(inputs, values), arm.targets.index(target))


def _angles_to(centre: Array, rotations: Array) -> Array:
    return np.asarray(np.linalg.norm(se3.log(np.swapaxes(centre, -1, -2) @ rotations), axis=-1))


def _common(rotations: Array) -> Array:
    """Return the rotation ``(3, 3)`` that most of ``(n, 3, 3)`` are near to."""
    rows = np.unique(np.linspace(0, len(rotations) - 1, _CENTRES).round().astype(np.int_))
    middle = [float(np.median(_angles_to(rotations[row], rotations))) for row in rows]
    centre = rotations[rows[int(np.argmin(middle))]]
    for _ in range(_ROUNDS):
        angles = _angles_to(centre, rotations)
        near = angles <= _NEAR * max(float(np.median(angles)), _LEAST_RAD)
        centre = se3.nearest_rotation(rotations[near].sum(axis=0))
    return np.asarray(centre)


def orientation_mistakes(sensor: "PoseSensor", arm: RigidArm, data: Measurements) -> Iterator[Hypothesis]:
    """Yield other conventions of the orientations, and of the whole poses.

    Args:
        arm: measured by points.
    """
    target = oriented_target(data)
    columns = orientation_columns(data, target)

    def of(what: str, undo: Callable[[Measurements], Measurements], tried: int = 24, **other: object) -> Hypothesis:
        return Hypothesis("orientation_convention", (what,), tried, undo, **other)  # type: ignore[arg-type]

    # other meanings of the columns
    for meaning in ANGLE_CONVENTIONS if sensor.orientation is not None else ():
        if meaning != sensor.orientation:
            yield of(meaning, unchanged, sensor=replace(sensor, orientation=meaning))
    for order in permutations(range(len(columns))):
        if list(order) != sorted(order) and (len(columns) == 3 or order in ((1, 2, 3, 0), (3, 0, 1, 2))):
            named = ", ".join(columns[i].rpartition("_")[2] if len(columns) == 4 else columns[i] for i in order)
            yield of(f"columns as {named}", partial(_reordered, columns=columns, order=order))
    if len(columns) == 3:
        yield of("rad", partial(_scaled, columns=columns, factor=180 / np.pi))
    # other rotations
    rewritten = partial(_rewritten, sensor=sensor, target=target)
    yield of("inverse", partial(rewritten, change=lambda R: np.swapaxes(R, 1, 2)))
    turn = _fixed_turn(sensor, arm, data, target)
    if (angle := float(np.linalg.norm(se3.log(turn)))) > _TURNED:
        yield of("another frame", partial(rewritten, change=lambda R: turn @ R), _FREE, data=(("angle_rad", angle),))
    if len(data.targets) == 1:
        yield of("inverse pose", partial(_inverted, sensor=sensor, target=target))


def _fixed_turn(sensor: "PoseSensor", arm: RigidArm, data: Measurements, target: str) -> Array:
    """Return the rotation ``(3, 3)`` from the frame of the orientations to that of the positions, which place the arm.

    The base's rotation B by positions and the arm's F give R = T' B F X with the tool's X and the turn T: the rotations
    of B'T and X are those of the nearest Kronecker product (Shah 2013).
    """
    points = np.where(data.used[:, None, None], data.points, np.nan)
    at = placed(arm, data.inputs(arm.conditions), points, arm.nominal(), rng_for(0, "null"))
    measured, flange = _rotations(sensor, data, target), _flange(arm, data, at.values, target)
    seen = np.isfinite(measured).all(axis=(1, 2))
    near = np.flatnonzero(seen & (at.misses <= _NEAR * np.nanmedian(at.misses[seen]))) if seen.any() else np.array([])
    turn = np.eye(3)
    for _ in range(_ROUNDS if len(near) > 2 else 0):
        both = np.einsum("vij,vkl->ikjl", flange[near], measured[near]).reshape(9, 9)  # vec X to vec T, rows first
        u, _, vt = np.linalg.svd(both)
        X, T = vt[0].reshape(3, 3), u[:, 0].reshape(3, 3)
        sign = -1.0 if np.linalg.det(X) < 0 else 1.0
        X, turn = se3.nearest_rotation(sign * X), se3.nearest_rotation(sign * T)
        angles = _angles_to(turn @ measured, flange @ X)
        near = np.flatnonzero(seen & ~(angles > _NEAR * max(float(np.nanmedian(angles)), _LEAST_RAD)))
    return np.asarray(turn)


def _reordered(rows: Measurements, columns: list[str], order: tuple[int, ...]) -> Measurements:
    changed = {columns[i]: rows.other[columns[j]] for i, j in enumerate(order)}
    return replace(rows, other={**rows.other, **changed})


def _scaled(rows: Measurements, columns: list[str], factor: float) -> Measurements:
    texts = {name: tuple(repr(factor * float(text)) if text else "" for text in rows.other[name]) for name in columns}
    return replace(rows, other={**rows.other, **texts})


def _rewritten(rows: Measurements, sensor: "PoseSensor", target: str, change: Callable[[Array], Array]) -> Measurements:
    """Return the rows with other rotations, in the same columns."""
    quaternions = read_orientations(rows, target, sensor.orientation)
    seen = np.asarray(np.isfinite(quaternions).all(axis=1))
    rotations = change(se3.rotation_from_quaternion(np.where(seen[:, None], quaternions, [1.0, 0.0, 0.0, 0.0])))
    cells = orientation_texts(target, rotations, seen, sensor.orientation).values()
    names = orientation_columns(rows, target)
    return replace(rows, other={**rows.other, **dict(zip(names, cells, strict=True))})


def _inverted(rows: Measurements, sensor: "PoseSensor", target: str) -> Measurements:
    """Return the rows with inverse poses: of the instrument's frame in the target's, for the target's in it."""
    rotations = se3.rotation_from_quaternion(read_orientations(rows, target, sensor.orientation))
    points = -(np.swapaxes(rotations, 1, 2) @ rows.points[:, 0, :, None])[..., 0]
    inverse = _rewritten(rows, sensor, target, lambda R: np.swapaxes(R, 1, 2))
    return replace(inverse, points=points[:, None])
