"""Poses of a target in many campaigns, as ``batch`` fits them: each arm has its own parameters and joint positions.

The residuals are those of ``observations.full_pose``: a target's position, and log(R_measured' R_predicted) of a frame
that is fixed to it. What is fitted, and to which of the two, is the caller's choice: together, or one after the other.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from lab.calibration.batch import MAX_STEPS, BatchFits, fit_batch
from lab.calibration.observation import ROTATION_PARAMETERS
from lab.core import se3
from lab.core.se3 import Array
from lab.kinematics.parameter import Parameter, names_of
from lab.kinematics.serial.arm import SerialArm
from lab.kinematics.serial.batch import StackedArm
from lab.kinematics.serial.walk import Motion

__all__ = ["MeasuredPoses", "PoseBatch", "StackedPoseArm", "fit_poses"]


@dataclass(frozen=True)
class MeasuredPoses:
    """What was measured in some campaigns.

    Attributes:
        joints: joint positions ``(b, n, joints)``.
        points: positions ``(b, n, 3)`` m.
        rotations: ``(b, n, 3, 3)`` of the target's frame.
    """

    joints: Array
    points: Array
    rotations: Array

    def __len__(self) -> int:
        return len(self.points)

    def take(self, rows: NDArray[np.int_]) -> "MeasuredPoses":
        """Some of the campaigns."""
        return MeasuredPoses(self.joints[rows], self.points[rows], self.rotations[rows])


@dataclass(frozen=True)
class StackedPoseArm:
    """Arms of one nominal model with a target whose pose is measured; their parameters are rows ``(b, p)``.

    Attributes:
        arm: the nominal model, with one target.
        parameters: the arm's, then the rotation vector of the target's frame in the last one.
        names: theirs.
    """

    arm: SerialArm
    parameters: tuple[Parameter, ...] = field(init=False)
    names: tuple[str, ...] = field(init=False)

    def __post_init__(self) -> None:
        assert len(self.arm.targets) == 1
        parameters = (*self.arm.parameters, *ROTATION_PARAMETERS)
        object.__setattr__(self, "parameters", parameters)
        object.__setattr__(self, "names", names_of(parameters))

    def nominal(self) -> Array:
        """The nominal parameters ``(p,)`` with the default tool, the target's frame along the last one."""
        return np.concatenate([self.arm.nominal(), np.zeros(3)])

    def columns(self, names: Sequence[str]) -> list[int]:
        """Where parameters stand, by name."""
        return [self.names.index(name) for name in names]

    def poses(self, joints: Array, values: Array) -> tuple[Array, Array]:
        """Positions ``(b, n, 3)`` and rotations ``(b, n, 3, 3)`` at joint positions ``(b, n, joints)``."""
        _, point, rotation = self._walk(joints, values)
        return point[:3].transpose(1, 2, 0), rotation

    def observe(self, joints: Array, values: Array, free: Sequence[int]) -> tuple[Array, Array, Array, Array]:
        """The poses, and what some parameters do to them: moves of the position and turns, each ``(b, n, 3, f)``.

        A turn is a small rotation vector in the instrument's frame, by which the rotation is multiplied on its left.
        """
        motions, point, rotation = self._walk(joints, values)
        moves, turns = np.zeros((2, len(free), 3, *point.shape[1:]))
        slot = {parameter: i for i, parameter in enumerate(free)}
        for motion in motions:
            i = slot.get(motion.column)
            if i is None:
                continue
            if motion.origin is None:
                moves[i] = motion.axis[:3]
                continue
            lever = point - motion.origin
            moves[i] = motion.axis[1:4] * lever[2:5] - motion.axis[2:5] * lever[1:4]
            turns[i] = motion.axis[:3]
        # the rotation is R exp(v): a change dv turns it by R J_l(v) dv = R exp(v) J_l(-v) dv
        vector = values[:, None, -3:]
        turning = rotation @ se3.left_jacobian(-vector)
        for k, column in enumerate(range(len(self.names) - 3, len(self.names))):
            if column in slot:
                turns[slot[column]] = np.moveaxis(turning[..., k], 2, 0)
        return point[:3].transpose(1, 2, 0), rotation, moves.transpose(2, 3, 1, 0), turns.transpose(2, 3, 1, 0)

    def _walk(self, joints: Array, values: Array) -> tuple[list[Motion], Array, Array]:
        """All motions but the target's rotation, the target ``(5, b, n)``, and its rotations ``(b, n, 3, 3)``."""
        motions, points, frame = StackedArm(self.arm).walk(joints, values[:, :-3], 5)
        first = len(self.arm.names) - 3
        motions += [Motion(column, axis, None) for column, axis in enumerate(frame, start=first)]
        last = np.stack([axis[:3] for axis in frame], axis=-1).transpose(1, 2, 0, 3)
        return motions, points[:, 0], last @ se3.exp(values[:, None, -3:])


@dataclass(frozen=True)
class PoseBatch:
    """Measured poses of b campaigns with their weights and the arms that predict them, as ``batch`` fits them.

    Attributes:
        model: the arms.
        measured: what was measured.
        position_weight: one over the standard deviation of a coordinate, 1/m; 0 leaves positions out.
        rotation_weight: ``(3,)`` that of a rotation about the axes of the target's frame, 1/rad; 0 leaves them out.
    """

    model: StackedPoseArm
    measured: MeasuredPoses
    position_weight: float
    rotation_weight: Array

    def __len__(self) -> int:
        return len(self.measured)

    def take(self, rows: NDArray[np.int_]) -> "PoseBatch":
        """Some of the campaigns."""
        return replace(self, measured=self.measured.take(rows))

    def residual(self, values: Array) -> Array:
        """Whitened residual ``(b, r)`` at parameters ``(b, p)``."""
        return self._residual(*self.model.poses(self.measured.joints, values))

    def linearized(self, values: Array, free: Sequence[int]) -> tuple[Array, Array]:
        """Whitened derivatives ``(b, f, r)`` and residual ``(b, r)`` at parameters ``(b, p)``."""
        points, rotations, moves, turns = self.model.observe(self.measured.joints, values, free)
        rows = []
        if self.position_weight:
            rows.append(self.position_weight * moves)
        if self.rotation_weight.any():
            vector = self._rotation_errors(rotations)
            back = self.measured.rotations.swapaxes(2, 3)
            rows.append(self.rotation_weight[:, None] * np.linalg.solve(se3.left_jacobian(vector), back @ turns))
        columns = np.concatenate(rows, 1).reshape(len(values), -1, len(free)).swapaxes(1, 2)
        return columns, self._residual(points, rotations)

    def settled(self, step: Array, squares: Array, tolerance: float) -> NDArray[np.bool_]:
        """Whether no parameter moves by more than the tolerance (m or rad)."""
        return np.asarray(np.abs(step).max(axis=1) < tolerance)

    def _rotation_errors(self, rotations: Array) -> Array:
        """log(R_measured' R_predicted) ``(b, n, 3)``."""
        return se3.log(self.measured.rotations.swapaxes(2, 3) @ rotations)

    def _residual(self, points: Array, rotations: Array) -> Array:
        parts = []
        if self.position_weight:
            parts.append(self.position_weight * (self.measured.points - points))
        if self.rotation_weight.any():
            parts.append(-self.rotation_weight * self._rotation_errors(rotations))
        return np.concatenate(parts, 1).reshape(len(points), -1)


def fit_poses(
    model: StackedPoseArm,
    measured: MeasuredPoses,
    start: Array,
    free: Sequence[int],
    *,
    position_weight: float = 0.0,
    rotation_weight: float | Array = 0.0,
    max_steps: int = MAX_STEPS,
) -> BatchFits:
    """Gauss-Newton from ``start`` ``(b, p)`` over the free parameters of every campaign, the others held.

    Where the measurements do not tell the free parameters apart, each step is the shortest (in unit columns).

    Args:
        position_weight: one over the standard deviation of a coordinate, 1/m; 0 leaves positions out.
        rotation_weight: that of a rotation, 1/rad, of all axes or ``(3,)`` of the target's frame; 0 leaves them out.
        max_steps: take so many at most.
    """
    weights = np.broadcast_to(np.asarray(rotation_weight, dtype=np.float64), 3)
    observed = PoseBatch(model, measured, position_weight, weights)
    return fit_batch(observed, start, free, shortest=True, max_steps=max_steps)
