"""Fit measured poses of many arms at once by Gauss-Newton, with the shortest steps where parameters are not shown.

Residuals are those of ``lab.sensors.full_pose``: a target's position, and log(R_measured' R_predicted) of a frame fixed
to it. A block always has as many campaigns, the last one padded: a matrix product's last bits change with its size.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from lab.calibration.batched_fits import BLOCK, BatchFits
from lab.calibration.observation import ROTATION_PARAMETERS
from lab.core import se3
from lab.core.newton import newton
from lab.core.se3 import Array
from lab.kinematics.compiled.numpy_kernels import walk_stacked
from lab.kinematics.parameter import Parameter, names_of
from lab.kinematics.serial.serial_arm import SerialArm
from lab.kinematics.serial.walk import ElementaryMotion

__all__ = ["MAX_STEPS", "MeasuredPoses", "StackedPoseArm", "fit_poses"]

MAX_STEPS = 20
_SETTLED = 1e-9  # m or rad: a step below is still taken, so that what remains is its square
_RANK_TOLERANCE = 1e-10  # of the normal equations of unit columns


@dataclass(frozen=True)
class MeasuredPoses:
    """Poses measured in some campaigns.

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
        """Select campaigns."""
        return MeasuredPoses(self.joints[rows], self.points[rows], self.rotations[rows])


@dataclass(frozen=True)
class StackedPoseArm:
    """Arms of one nominal model with a target whose pose is measured; their parameters are rows ``(b, p)``.

    Attributes:
        parameters: the arm's, then the rotation vector of the target's frame in the last one.
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
        """Return the nominal parameters ``(p,)`` with the default tool, the target's frame along the last one."""
        return np.concatenate([self.arm.nominal(), np.zeros(3)])

    def columns(self, names: Sequence[str]) -> list[int]:
        """Return the indices of parameters by name."""
        return [self.names.index(name) for name in names]

    def poses(self, joints: Array, values: Array) -> tuple[Array, Array]:
        """Positions ``(b, n, 3)`` and rotations ``(b, n, 3, 3)`` at joint positions ``(b, n, joints)``."""
        _, point, rotation = self._walk(joints, values)
        return point[:3].transpose(1, 2, 0), rotation

    def observe(self, joints: Array, values: Array, free: Sequence[int]) -> tuple[Array, Array, Array, Array]:
        """Return the poses, and moves of position and turns by some parameters, each ``(b, n, 3, f)``.

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

    def _walk(self, joints: Array, values: Array) -> tuple[list[ElementaryMotion], Array, Array]:
        motions, points, frame = walk_stacked(self.arm, joints, values[:, :-3], 5)
        first = len(self.arm.names) - 3
        motions += [ElementaryMotion(column, axis, None) for column, axis in enumerate(frame, start=first)]
        last = np.stack([axis[:3] for axis in frame], axis=-1).transpose(1, 2, 0, 3)
        return motions, points[:, 0], last @ se3.exp(values[:, None, -3:])


@dataclass(frozen=True)
class _PoseBatch:
    """Measured poses of b campaigns with their weights and the arms that predict them.

    Attributes:
        position_weight: one over the standard deviation of a coordinate, 1/m; 0 leaves positions out.
        rotation_weight: ``(3,)`` that of a rotation about the axes of the target's frame, 1/rad; 0 leaves them out.
    """

    model: StackedPoseArm
    measured: MeasuredPoses
    position_weight: float
    rotation_weight: Array

    def __len__(self) -> int:
        return len(self.measured)

    def take(self, rows: NDArray[np.int_]) -> "_PoseBatch":
        """Select campaigns."""
        return replace(self, measured=self.measured.take(rows))

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

    Where the free parameters are not identifiable, each step is the shortest (in unit columns).

    Args:
        position_weight: one over the standard deviation of a coordinate, 1/m; 0 leaves positions out.
        rotation_weight: that of a rotation, 1/rad, of all axes or ``(3,)`` of the target's frame; 0 leaves them out.
    """
    weights = np.broadcast_to(np.asarray(rotation_weight, dtype=np.float64), 3)
    observed = _PoseBatch(model, measured, position_weight, weights)
    order = np.arange(-(-len(measured) // BLOCK) * BLOCK)
    order[len(measured) :] = 0
    blocks = (order[first : first + BLOCK] for first in range(0, len(order), BLOCK))
    parts = [_fitted(observed.take(rows), start[rows].copy(), list(free), max_steps) for rows in blocks]
    return BatchFits(*(np.concatenate(part)[: len(measured)] for part in zip(*parts, strict=True)))


def _fitted(
    block: _PoseBatch, values: Array, free: list[int], max_steps: int
) -> tuple[Array, NDArray[np.bool_], NDArray[np.int_], Array]:
    """Solve normal equations of unit columns; return the values, whether and when each settled, and J' J."""
    information = np.empty((len(block), len(free), len(free)))

    def step(unknowns: Array, going: NDArray[np.bool_]) -> tuple[Array, NDArray[np.bool_]]:
        values[:, free] = unknowns
        columns, residual = block.linearized(values, free)
        products = columns @ columns.swapaxes(1, 2)
        scale = np.sqrt(np.diagonal(products, axis1=1, axis2=2))
        scale = np.where(scale == 0, 1.0, scale)
        inverse = np.linalg.pinv(
            products / (scale[:, :, None] * scale[:, None, :]), rcond=_RANK_TOLERANCE, hermitian=True
        )
        right = (columns @ residual[:, :, None])[:, :, 0] / scale
        change = np.einsum("bfg,bg->bf", inverse, right) / scale
        information[going] = products[going]
        return change, np.abs(change).max(axis=1) < _SETTLED

    solution = newton(step, values[:, free], max_steps)
    values[:, free] = solution.values
    return values, solution.converged, solution.iterations, information
