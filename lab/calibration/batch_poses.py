"""Many campaigns of measured poses at once: arms of one drawing, each with its own parameters and its own readings.

The residuals are those of ``sightings.poses``: a target's position, and log(R_measured' R_predicted) of a frame that is
fixed to it. What is fitted, and to which of the two, is the caller's choice: together, or one after the other.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from lab.calibration.observations.full_pose import ROTATION_PARAMETERS
from lab.core import se3
from lab.core.se3 import Array
from lab.kinematics.parameter import names_of
from lab.kinematics.serial.arm import Motion, SerialArm
from lab.kinematics.serial.batch import StackedArm

BLOCK = 50  # campaigns solved together: what fits the processor's cache
MAX_STEPS = 20
SETTLED = 1e-9  # m or rad: the step is still taken, so that what remains is its square
RANK_TOLERANCE = 1e-10  # of the normal equations of unit columns


@dataclass(frozen=True)
class SeenPoses:
    """What was measured in some campaigns.

    Attributes:
        joints: readings ``(b, n, joints)``.
        points: positions ``(b, n, 3)`` m.
        rotations: ``(b, n, 3, 3)`` of the target's frame.
    """

    joints: Array
    points: Array
    rotations: Array

    def __len__(self) -> int:
        return len(self.points)

    def block(self, rows: slice) -> "SeenPoses":
        """Some of the campaigns."""
        return SeenPoses(self.joints[rows], self.points[rows], self.rotations[rows])


@dataclass(frozen=True)
class StackedPoses:
    """Arms of one drawing with a target whose pose is seen; their parameters are rows ``(b, p)``.

    Attributes:
        arm: the drawing, with one target.
        names: the arm's parameters, then the rotation vector of the target's frame in the last one.
    """

    arm: SerialArm
    names: tuple[str, ...] = field(init=False)

    def __post_init__(self) -> None:
        assert len(self.arm.targets) == 1
        object.__setattr__(self, "names", (*self.arm.names, *names_of(ROTATION_PARAMETERS)))

    def nominal(self) -> Array:
        """The drawing's parameters ``(p,)`` with the default tool, the target's frame along the last one."""
        return np.concatenate([self.arm.nominal(), np.zeros(3)])

    def columns(self, names: Sequence[str]) -> list[int]:
        """Where parameters stand, by name."""
        return [self.names.index(name) for name in names]

    def poses(self, joints: Array, values: Array) -> tuple[Array, Array]:
        """Positions ``(b, n, 3)`` and rotations ``(b, n, 3, 3)`` at readings ``(b, n, joints)``."""
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


def fit_poses(
    model: StackedPoses,
    seen: SeenPoses,
    start: Array,
    free: Sequence[int],
    *,
    position_weight: float = 0.0,
    rotation_weight: float | Array = 0.0,
    steps: int = MAX_STEPS,
) -> tuple[Array, NDArray[np.bool_]]:
    """Gauss-Newton from ``start`` ``(b, p)`` over the free parameters of every campaign, the others held.

    Where the measurements do not tell the free parameters apart, each step is the shortest (in unit columns).

    Args:
        position_weight: one over the standard deviation of a coordinate, 1/m; 0 leaves positions out.
        rotation_weight: that of a rotation, 1/rad, of all axes or ``(3,)`` of the target's frame; 0 leaves them out.
        steps: take so many at most.

    Returns:
        The values ``(b, p)``, and which campaigns settled ``(b,)``.
    """
    weights = (position_weight, np.broadcast_to(np.asarray(rotation_weight, dtype=np.float64), 3))
    parts = [
        _newton(model, seen.block(rows), start[rows], list(free), weights, steps)
        for rows in (slice(at, at + BLOCK) for at in range(0, len(seen), BLOCK))
    ]
    return np.concatenate([values for values, _ in parts]), np.concatenate([settled for _, settled in parts])


def _newton(
    model: StackedPoses, seen: SeenPoses, start: Array, free: list[int], weights: tuple[float, Array], steps: int
) -> tuple[Array, NDArray[np.bool_]]:
    """One block of ``fit_poses``."""
    values, settled = start.copy(), np.zeros(len(start), dtype=np.bool_)
    for _ in range(steps):
        rows, residual = _linearized(model, seen, values, free, weights)
        scale = np.linalg.norm(rows, axis=1)
        scale[scale == 0] = 1.0
        rows /= scale[:, None]
        turned = rows.swapaxes(1, 2)
        inverse = np.linalg.pinv(turned @ rows, rcond=RANK_TOLERANCE, hermitian=True)
        step = (inverse @ (turned @ residual[:, :, None]))[:, :, 0] / scale
        values[:, free] += np.where(settled[:, None], 0.0, step)
        settled |= np.abs(step).max(axis=1) < SETTLED
        if settled.all():
            break
    return values, settled


def _linearized(
    model: StackedPoses, seen: SeenPoses, values: Array, free: list[int], weights: tuple[float, Array]
) -> tuple[Array, Array]:
    """Whitened Jacobian ``(b, r, f)`` of the prediction, and residual ``(b, r)``, measured less predicted."""
    points, rotations, moves, turns = model.observe(seen.joints, values, free)
    rows, residual = [], []
    if weights[0]:
        rows.append(weights[0] * moves)
        residual.append(weights[0] * (seen.points - points))
    if weights[1].any():
        back = seen.rotations.swapaxes(2, 3)
        vector = se3.log(back @ rotations)
        rows.append(weights[1][:, None] * np.linalg.solve(se3.left_jacobian(vector), back @ turns))
        residual.append(-weights[1] * vector)
    count = len(values)
    return np.concatenate(rows, 1).reshape(count, -1, len(free)), np.concatenate(residual, 1).reshape(count, -1)
