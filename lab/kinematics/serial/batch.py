"""Many arms of one nominal model, each with its own parameters: positions and derivatives at once."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import singledispatch
from typing import Protocol

import numpy as np

from lab.core import se3
from lab.core.se3 import Array
from lab.kinematics.model import RigidArm
from lab.kinematics.parameter import BASE_PARAMETERS
from lab.kinematics.serial.arm import SerialArm
from lab.kinematics.serial.walk import Motion, along, fill

__all__ = ["Stacked", "StackedArm", "stacked"]


class Stacked(Protocol):
    """What fits of many campaigns need of arms of one nominal model."""

    @property
    def arm(self) -> RigidArm:
        """The nominal model and its targets."""

    def points(self, joints: Array, values: Array) -> Array:
        """Target positions ``(b, k, 3, n)`` m of arms with parameters ``(b, p)`` at joint positions ``(n, joints)``."""

    def observe(self, joints: Array, values: Array, free: Sequence[int]) -> tuple[Array, Array]:
        """The positions, and their derivatives ``(f, 3, k, b, n)`` by some of the parameters."""


@singledispatch
def stacked(arm: RigidArm) -> Stacked:
    """Many arms of this nominal model: one after the other, unless its kind registers something quicker."""
    return SequentialBatch(arm)


@dataclass(frozen=True)
class SequentialBatch:
    """Arms of one nominal model, asked one after the other: of a mechanism, whose loops close in their own time."""

    arm: RigidArm

    def points(self, joints: Array, values: Array) -> Array:
        """Target positions ``(b, k, 3, n)`` m of arms with parameters ``(b, p)``, one arm after the other."""
        return np.stack([self.arm.points(joints, row).transpose(1, 2, 0) for row in values])

    def observe(self, joints: Array, values: Array, free: Sequence[int]) -> tuple[Array, Array]:
        """Positions ``(b, k, 3, n)`` m and their derivatives by the ``free`` parameters, one arm after the other."""
        both = [self.arm.observe(joints, row) for row in values]
        points = np.stack([points.transpose(1, 2, 0) for points, _ in both])
        columns = np.stack([jacobian[..., list(free)].transpose(3, 2, 1, 0) for _, jacobian in both], axis=3)
        return points, columns


@dataclass(frozen=True)
class StackedArm:
    """Arms of one nominal model, as many as there are rows of parameters.

    Attributes:
        arm: the nominal model and its targets.
    """

    arm: SerialArm

    def points(self, joints: Array, values: Array) -> Array:
        """Target positions ``(b, k, 3, n)`` m of arms with parameters ``(b, p)`` at joint positions ``(n, joints)``."""
        if (code := self.arm.compiled(joints, values)) is not None:
            return code.stacked(joints, values, code.every, 0)[0]
        return self.walk(joints, values, 3)[1].transpose(2, 1, 0, 3)

    def observe(self, joints: Array, values: Array, free: Sequence[int]) -> tuple[Array, Array]:
        """The positions, and their derivatives ``(f, 3, k, b, n)`` by some of the parameters."""
        if (code := self.arm.compiled(joints, values)) is not None:
            points, columns = code.stacked(joints, values, code.some(list(free)), len(free))
            return points, columns.transpose(1, 3, 2, 0, 4)
        motions, points, frame = self.walk(joints, values, 5)
        slot = {parameter: i for i, parameter in enumerate(free)}
        jacobian = np.zeros((len(free), 3, *points.shape[1:]))
        wanted = [replace(motion, column=slot[motion.column]) for motion in motions if motion.column in slot]
        fill(jacobian, wanted, points)
        first = len(self.arm.names) - 3 * len(self.arm.targets)
        for k in range(len(self.arm.targets)):
            for i, axis in enumerate(frame):
                if (column := first + 3 * k + i) in slot:
                    jacobian[slot[column], :, k] = axis[:3]
        return points[:3].transpose(2, 1, 0, 3), jacobian

    def walk(self, joints: Array, values: Array, rows: int) -> tuple[list[Motion], Array, tuple[Array, Array, Array]]:
        """All motions, the targets ``(rows, k, b, n)``, and the last frame's axes ``(rows, b, n)``: x y z (x y).

        Args:
            joints: joint positions ``(n, joints)`` of all arms, or ``(b, n, joints)`` of each.
        """

        def stacked(vectors: Array) -> Array:
            """Vectors ``(b, 3)`` as ``(rows, b, 1)``."""
            return np.concatenate([vectors.T, vectors.T[: rows - 3]])[:, :, None]

        arm, columns = self.arm, values.T[:, :, None]  # (p, b, 1)
        first_tool = len(columns) - 3 * len(arm.targets)
        table = np.broadcast_to(arm.chain.table[:, :, None, None], (*arm.chain.table.shape, len(values), 1)).copy()
        table[arm.table_rows, arm.table_columns] = columns[len(BASE_PARAMETERS) : first_tool]
        base = values[:, : len(BASE_PARAMETERS)]
        axes = [stacked(column) for column in np.moveaxis(se3.exp(base[:, 3:]), 2, 0)]
        origin = stacked(base[:, :3])
        motions = [Motion(i, stacked(np.eye(3)[None, i]), None) for i in range(3)]
        turning = np.moveaxis(se3.left_jacobian(base[:, 3:]), 2, 0)
        motions += [Motion(3 + i, stacked(column), origin) for i, column in enumerate(turning)]
        links, frame, end = along(
            arm.chain,
            (axes[0], axes[1], axes[2]),
            origin,
            table,
            np.moveaxis(joints if joints.ndim == 3 else joints[None], 2, 0),
        )
        tool = columns[first_tool:].reshape(len(arm.targets), 3, len(values), 1)
        x, y, z = frame
        points = np.stack([end + px * x + py * y + pz * z for px, py, pz in tool], axis=1)
        return motions + links, points, frame


@stacked.register
def _(arm: SerialArm) -> Stacked:
    return StackedArm(arm)
