"""Inverse kinematics of any robot with any effects, by damped Newton steps.

Without a wanted rotation, and for redundant arms, each step is the shortest one. Arms with fewer than six joints reach
the position, then the nearest rotation in the null space of the position's rows of the Jacobian.
"""

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from lab.core import se3
from lab.core.se3 import Array
from lab.kinematics.compiled.kernels import real, with_fallback
from lab.kinematics.differential import ROTATION_M, WEIGHTS, pseudo_inverse
from lab.kinematics.serial.serial_arm import SerialArm

if TYPE_CHECKING:
    from lab.kinematics.effects.arm_with_effects import Arm

__all__ = ["FREEDOMS", "PLACES", "PoseTarget", "pose_landmarks", "reach", "shortest_step", "tool_at", "within_reach"]

PLACES = 3  # degrees of freedom of a position
FREEDOMS = 6  # degrees of freedom of a pose
_MAX_STEPS = 40
ARRIVED_M, ARRIVED_RAD = 1e-10, 1e-10  # tolerances
_PLACE_FIRST = 1e3  # weight of the position for arms with few joints
_HIDDEN_M = 1e-12  # rounding of a remaining rotation error
_NOWHERE = se3.pose(np.eye(3), np.full(3, 1e6))
_LONGEST_STEP = 0.3  # rad or m, of any joint
LEAST_DAMPING, LARGEST_DAMPING = 1e-6, 1e3  # m, as singular values


@dataclass(frozen=True)
class PoseTarget:
    """Wanted poses of a target of the tool, in the tracker's frame.

    Attributes:
        positions: ``(n, 3)`` m.
        rotations: ``(n, 3, 3)`` of the last frame; NaN for any.
    """

    positions: Array
    rotations: Array

    def __post_init__(self) -> None:
        assert self.positions.shape == (len(self), 3) and self.rotations.shape == (len(self), 3, 3)
        assert np.isfinite(self.positions).all()

    def __len__(self) -> int:
        return len(self.positions)

    @property
    def turned(self) -> NDArray[np.bool_]:
        """Mask ``(n,)`` of targets with a rotation."""
        return np.asarray(np.isfinite(self.rotations).all(axis=(1, 2)))

    def take(self, rows: NDArray[np.int_]) -> "PoseTarget":
        """Return the targets of some rows."""
        return PoseTarget(self.positions[rows], self.rotations[rows])

    def errors(self, Ts: Array) -> Array:
        """Return the errors ``(n, 6)`` of poses ``(n, 4, 4)``: m, and the rotation vector log(R_wanted R') (rad)."""
        out = np.zeros((len(self), 6))
        out[:, :3] = self.positions - Ts[:, :3, 3]
        turned = self.turned
        out[turned, 3:] = se3.log(self.rotations[turned] @ Ts[turned, :3, :3].swapaxes(1, 2))
        return out


@dataclass(frozen=True)
class _IKResult:
    """Result of Newton's method.

    Attributes:
        joints: ``(n, joints)`` joint positions.
        errors: ``(n, 6)`` m and rad.
        left: ``(n, 6)`` part of the errors that the joints could correct: all with six and more.
        steps: ``(n,)``.
    """

    joints: Array
    errors: Array
    left: Array
    steps: NDArray[np.int_]

    @property
    def arrived(self) -> NDArray[np.bool_]:
        """Mask ``(n,)`` of targets without errors that the joints could correct."""
        return np.asarray(_in_tolerances(self.left) < 1.0)


def _compilable(
    arm: "Arm", values: Array, wanted: PoseTarget, start: Array, conditions: Array, target: int = 0
) -> bool:
    return isinstance(arm, SerialArm) and start.shape[1] >= FREEDOMS and real(values, values)


def _reach(
    arm: "Arm", values: Array, wanted: PoseTarget, start: Array, conditions: Array, target: int = 0
) -> _IKResult:
    """Return ``reach`` in numpy; each row has its own damping, and steps that do not help are dropped."""
    few, start = start.shape[1] < FREEDOMS, start.astype(np.float64)

    def at(rows: NDArray[np.int_], joints: Array) -> tuple[Array, Array]:
        """Return the pose errors ``(m, 6)`` and the Jacobian ``(m, 6, joints)``."""
        Ts, jacobian = tool_at(arm, np.concatenate([joints, conditions[rows]], axis=1), values, target)
        return wanted.take(rows).errors(Ts), jacobian

    joints, steps = start, np.zeros(len(wanted), dtype=np.int_)
    errors, jacobian = at(np.arange(len(wanted)), joints)
    left = within_reach(jacobian, errors, wanted.turned)
    damping = np.zeros(len(wanted))
    for _ in range(_MAX_STEPS):
        active = np.flatnonzero((_in_tolerances(left) >= 1.0) & (damping <= LARGEST_DAMPING))
        if not active.size:
            break
        turned = wanted.turned[active]
        moved = joints[active] + shortest_step(jacobian[active], errors[active], turned, damping[active])
        there, ahead = at(active, moved)
        if few:  # back to the position after a step along the null space
            moved += shortest_step(ahead, there, np.zeros_like(turned))
            there, ahead = at(active, moved)
        better = _nearer(there, errors[active], few)
        retained = active[better]
        joints[retained], errors[retained], jacobian[retained] = moved[better], there[better], ahead[better]
        left[retained] = within_reach(ahead[better], there[better], turned[better])
        damping[retained] = np.where(damping[retained] > LEAST_DAMPING, damping[retained] / 10, 0.0)
        worse = active[~better]
        damping[worse] = np.maximum(10 * damping[worse], LEAST_DAMPING)
        steps[active] += 1
    return _IKResult(joints, errors, left, steps)


@with_fallback(_reach, when=_compilable)
def reach(arm: "Arm", values: Array, wanted: PoseTarget, start: Array, conditions: Array, target: int = 0) -> _IKResult:
    """Return joint positions for target poses, from joint positions ``start`` ``(n, joints)``.

    By Newton's method, damped if a step does not help (Levenberg 1944). Steps are limited, so that the arm stays in its
    branch. Joint limits are not checked.

    Args:
        conditions: ``(n, c)`` of the arm's effects.
    """
    assert isinstance(arm, SerialArm)
    places, turns = wanted.positions, wanted.rotations
    found, missing, taken = arm.compiled.reach(start.astype(np.float64), values, places, turns, target)
    return _IKResult(found, missing, missing, taken)


def tool_at(arm: "Arm", inputs: Array, values: Array, target: int = 0) -> tuple[Array, Array]:
    """Return ``RigidArm.tool``; where loops do not close the target is far away and does not move."""
    Ts, jacobian = arm.tool(inputs, values, target)
    lost = np.isnan(Ts).any(axis=(1, 2))
    Ts[lost], jacobian[lost] = _NOWHERE, 0.0
    return Ts, jacobian


def pose_landmarks(positions: Array, rotations: Array, turned: bool) -> Array:
    """Return points ``(n, 3 or 9)`` whose distances are those of poses: of the tool, and on two of its axes."""
    if not turned:
        return positions
    axes = [positions + ROTATION_M * rotations[:, :, i] for i in (0, 1)]
    return np.concatenate([positions, *axes], axis=1)


def within_reach(jacobian: Array, errors: Array, turned: NDArray[np.bool_]) -> Array:
    """Return the part of errors ``(n, 6)`` that the joints can correct: with six joints or more all; else the position,
    and the rotation by joint moves that keep the position. Where that is zero no small move reduces the rotation error.
    One or two joints move the position on a line or a surface; the rest of its error is dropped (Benmisra 2007, 3.37).
    """
    if jacobian.shape[2] < PLACES:
        sides = np.linalg.svd(jacobian[:, :3], full_matrices=False)[0]
        kept = (sides @ (sides.swapaxes(1, 2) @ errors[:, :3, None]))[:, :, 0]
        return np.concatenate([kept, np.zeros_like(kept)], axis=1)
    if jacobian.shape[2] >= FREEDOMS or not turned.any():
        return errors
    turning = _turning(jacobian, pseudo_inverse(jacobian[:, :3]))
    along = turning @ pseudo_inverse(turning) @ errors[:, 3:, None]
    return np.concatenate([errors[:, :3], np.where(turned[:, None], along[:, :, 0], 0.0)], axis=1)


def _turning(jacobian: Array, inverse: Array) -> Array:
    """Return the tool's rotation ``(n, 3, joints)`` by joint moves at fixed position; ``inverse`` is of its rows."""
    return np.asarray(jacobian[:, 3:] @ (np.eye(jacobian.shape[2]) - inverse @ jacobian[:, :3]))


def shortest_step(jacobian: Array, errors: Array, turned: NDArray[np.bool_], damping: Array | float = 0.0) -> Array:
    """Return the shortest joint step for errors, J' (J J' + d^2 I)^-1 e, limited in length.

    With fewer than six joints the position comes first, then the possible rotation.

    Args:
        jacobian: ``(n, 6, joints)``.
        errors: ``(n, 6)``.
        turned: ``(n,)``; without a rotation, the position's rows count alone.
        damping: ``(n,)`` m.
    """
    if jacobian.shape[2] < FREEDOMS:
        return _limited(_place_first(jacobian, errors, turned, damping))
    weight = WEIGHTS * np.where(turned[:, None], 1.0, np.arange(6) < 3)
    J, e = weight[:, :, None] * jacobian, weight * errors
    square, rows = J @ J.swapaxes(1, 2), np.arange(6)
    square[:, rows, rows] += np.reshape(damping, (-1, 1)) ** 2 + np.where(weight > 0, 1e-15, 1.0)
    return _limited((J.swapaxes(1, 2) @ np.linalg.solve(square, e[:, :, None]))[:, :, 0])


def _place_first(jacobian: Array, errors: Array, turned: NDArray[np.bool_], damping: Array | float) -> Array:
    position, rotation = errors[:, :3, None], np.where(turned[:, None], errors[:, 3:], 0.0)[:, :, None]
    step = pseudo_inverse(jacobian[:, :3], damping) @ position
    turning = _turning(jacobian, pseudo_inverse(jacobian[:, :3]))
    rest = np.where(turned[:, None, None], rotation - jacobian[:, 3:] @ step, 0.0)
    second: Array = pseudo_inverse(ROTATION_M * turning, damping) @ (ROTATION_M * rest)
    return np.asarray((step + second)[:, :, 0])


def _limited(step: Array) -> Array:
    longest = np.abs(step).max(axis=1, keepdims=True)
    return np.asarray(step * np.minimum(1.0, _LONGEST_STEP / np.maximum(longest, 1e-300)))


def _nearer(errors: Array, before: Array, few: bool) -> NDArray[np.bool_]:
    """Compare errors ``(n, 6)`` with those before, a radian as ``ROTATION_M``.

    With few joints the position has priority, and equal counts: rounding of a remaining rotation error hides the last
    steps.
    """
    if not few:
        return np.asarray(np.linalg.norm(errors * WEIGHTS, axis=1) < np.linalg.norm(before * WEIGHTS, axis=1))
    now, then = (
        _PLACE_FIRST * np.linalg.norm(e[:, :3], axis=1) + ROTATION_M * np.linalg.norm(e[:, 3:], axis=1)
        for e in (errors, before)
    )
    return np.asarray(now <= then + _HIDDEN_M)


def _in_tolerances(errors: Array) -> Array:
    """Return the sizes of errors in units of their tolerances."""
    position, rotation = np.linalg.norm(errors[:, :3], axis=1), np.linalg.norm(errors[:, 3:], axis=1)
    return np.asarray(np.maximum(position / ARRIVED_M, rotation / ARRIVED_RAD))
