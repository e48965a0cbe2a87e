"""Inverse kinematics of any robot with any effects, from poses of the tool, by damped Newton steps.

Where the tool is only to be somewhere, not turned in some way, and where the arm has more joints than it needs,
every step is the shortest one that does what is asked. Arms with fewer than six joints cannot turn the tool anyhow:
they bring it to its place, and then as near to the rotation as joints that leave it there can (the null space of the
place's rows of the Jacobian).
"""

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from lab.core import se3
from lab.core.se3 import Array
from lab.kinematics.compiled.kernels import real, with_fallback
from lab.kinematics.differential import ROTATION_M, WEIGHTS, pseudo_inverse
from lab.kinematics.serial.arm import SerialArm

if TYPE_CHECKING:
    from lab.kinematics.effects.arm import Arm

__all__ = ["FREEDOMS", "PLACES", "PoseTarget", "pose_landmarks", "reach", "shortest_step", "tool_at", "within_reach"]

PLACES = 3  # directions of a place: with fewer joints an arm takes some places only
FREEDOMS = 6  # of a tool in space: with fewer joints an arm takes some rotations only
MAX_STEPS = 40
ARRIVED_M, ARRIVED_RAD = 1e-10, 1e-10  # an error below these is none
_PLACE_FIRST = 1e3  # how much more the place weighs than the rotation, where that cannot be met
_HIDDEN_M = 1e-12  # by rounding of what is left of a rotation
_NOWHERE = se3.pose(np.eye(3), np.full(3, 1e6))
_LONGEST_STEP = 0.3  # rad or m, of any joint
LEAST_DAMPING, LARGEST_DAMPING = 1e-6, 1e3  # beside singular values in m


@dataclass(frozen=True)
class PoseTarget:
    """Wanted pose of a target of the tool, in the tracker's frame.

    Attributes:
        places: ``(n, 3)`` m.
        turns: ``(n, 3, 3)`` of the last frame; NaN where any will do.
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
        """``(n,)``: whether the rotation matters."""
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
class IKResult:
    """Result of Newton's method.

    Attributes:
        joints: ``(n, joints)`` joint positions.
        errors: ``(n, 6)`` what is missing, m and rad.
        left: ``(n, 6)`` what of that the joints could still make up for: with six and more all of it.
        steps: ``(n,)`` how many it took.
    """

    joints: Array
    errors: Array
    left: Array
    steps: NDArray[np.int_]

    @property
    def arrived(self) -> NDArray[np.bool_]:
        """``(n,)``: whether nothing is missing that the joints could make up for."""
        return np.asarray(_in_tolerances(self.left) < 1.0)


def _compilable(
    arm: "Arm", values: Array, wanted: PoseTarget, start: Array, conditions: Array, target: int = 0
) -> bool:
    """Decide whether machine code can do it: it takes serial arms of six joints and more, and real numbers."""
    return isinstance(arm, SerialArm) and start.shape[1] >= FREEDOMS and real(values)


def _reach(arm: "Arm", values: Array, wanted: PoseTarget, start: Array, conditions: Array, target: int = 0) -> IKResult:
    """``reach`` by numpy, for any arm.

    The loop is its own: each row has a damping that it keeps, and a step that is not taken where it brings nothing
    nearer.
    """
    few, start = start.shape[1] < FREEDOMS, start.astype(np.float64)

    def at(rows: NDArray[np.int_], joints: Array) -> tuple[Array, Array]:
        """Return the pose errors ``(m, 6)`` and the Jacobian ``(m, 6, joints)``."""
        Ts, jacobian = tool_at(arm, np.concatenate([joints, conditions[rows]], axis=1), values, target)
        return wanted.take(rows).errors(Ts), jacobian

    joints, steps = start, np.zeros(len(wanted), dtype=np.int_)
    errors, jacobian = at(np.arange(len(wanted)), joints)
    left = within_reach(jacobian, errors, wanted.turned)
    damping = np.zeros(len(wanted))
    for _ in range(MAX_STEPS):
        going = np.flatnonzero((_in_tolerances(left) >= 1.0) & (damping <= LARGEST_DAMPING))
        if not going.size:
            break
        turned = wanted.turned[going]
        moved = joints[going] + shortest_step(jacobian[going], errors[going], turned, damping[going])
        there, ahead = at(going, moved)
        if few:  # a long step along the null space has left the place
            moved += shortest_step(ahead, there, np.zeros_like(turned))
            there, ahead = at(going, moved)
        better = _nearer(there, errors[going], few)
        retained = going[better]
        joints[retained], errors[retained], jacobian[retained] = moved[better], there[better], ahead[better]
        left[retained] = within_reach(ahead[better], there[better], turned[better])
        damping[retained] = np.where(damping[retained] > LEAST_DAMPING, damping[retained] / 10, 0.0)
        worse = going[~better]
        damping[worse] = np.maximum(10 * damping[worse], LEAST_DAMPING)
        steps[going] += 1
    return IKResult(joints, errors, left, steps)


@with_fallback(_reach, when=_compilable)
def reach(arm: "Arm", values: Array, wanted: PoseTarget, start: Array, conditions: Array, target: int = 0) -> IKResult:
    """Joint positions that bring a target to where it is wanted, from joint positions ``start`` ``(n, joints)``.

    Newton's method; where a step does not bring the target nearer, a damped one (Levenberg 1944). Steps are
    limited, so that the arm stays in the branch it starts in. Joint limits are not looked at.

    Args:
        conditions: ``(n, c)``, what the arm's effects ask for.
    """
    assert isinstance(arm, SerialArm)
    places, turns = wanted.positions, wanted.rotations
    found, missing, taken = arm.compiled.reach(start.astype(np.float64), values, places, turns, target)
    return IKResult(found, missing, missing, taken)


def tool_at(arm: "Arm", inputs: Array, values: Array, target: int = 0) -> tuple[Array, Array]:
    """Poses of a target, and how the joint positions move them (``RigidArm.tool``).

    Where the robot cannot stand so, as its loops do not close, the target is far away, and nothing moves it: no step
    that leads there is taken.
    """
    Ts, jacobian = arm.tool(inputs, values, target)
    lost = np.isnan(Ts).any(axis=(1, 2))
    Ts[lost], jacobian[lost] = _NOWHERE, 0.0
    return Ts, jacobian


def pose_landmarks(positions: Array, rotations: Array, turned: bool) -> Array:
    """Points ``(n, 3 or 9)`` whose distances are those of the poses: of the tool, and on two of its axes."""
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
    left: Array = jacobian[:, 3:] @ (np.eye(jacobian.shape[2]) - inverse @ jacobian[:, :3])
    return left


def shortest_step(jacobian: Array, errors: Array, turned: NDArray[np.bool_], damping: Array | float = 0.0) -> Array:
    """The shortest move of the joints that makes up for errors, J' (J J' + d^2 I)^-1 e, limited in length.

    With fewer than six joints it makes up for the place, and then for what is within reach of the rotation.

    Args:
        jacobian: ``(n, 6, joints)``.
        errors: ``(n, 6)``.
        turned: ``(n,)``; where the rotation does not matter, the rows of the position count alone.
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
    """The step ``(n, joints)`` of an arm that cannot turn its tool anyhow."""
    position, rotation = errors[:, :3, None], np.where(turned[:, None], errors[:, 3:], 0.0)[:, :, None]
    step = pseudo_inverse(jacobian[:, :3], damping) @ position
    turning = _turning(jacobian, pseudo_inverse(jacobian[:, :3]))
    rest = np.where(turned[:, None, None], rotation - jacobian[:, 3:] @ step, 0.0)
    second: Array = pseudo_inverse(ROTATION_M * turning, damping) @ (ROTATION_M * rest)
    return np.asarray((step + second)[:, :, 0])


def _limited(step: Array) -> Array:
    """Steps ``(n, joints)``, none of a joint longer than ``_LONGEST_STEP``."""
    longest = np.abs(step).max(axis=1, keepdims=True)
    limited: Array = step * np.minimum(1.0, _LONGEST_STEP / np.maximum(longest, 1e-300))
    return limited


def _nearer(errors: Array, before: Array, few: bool) -> NDArray[np.bool_]:
    """``(n,)``: whether errors are smaller than those before, a radian as ``ROTATION_M``.

    With few joints the place goes before the rotation, and equal is near enough: what is left of a rotation hides the
    last steps.
    """
    if not few:
        return np.asarray(np.linalg.norm(errors * WEIGHTS, axis=1) < np.linalg.norm(before * WEIGHTS, axis=1))
    now, then = (
        _PLACE_FIRST * np.linalg.norm(e[:, :3], axis=1) + ROTATION_M * np.linalg.norm(e[:, 3:], axis=1)
        for e in (errors, before)
    )
    return np.asarray(now <= then + _HIDDEN_M)


def _in_tolerances(errors: Array) -> Array:
    """Sizes of errors in what counts as none: below one is arrived."""
    position, rotation = np.linalg.norm(errors[:, :3], axis=1), np.linalg.norm(errors[:, 3:], axis=1)
    return np.asarray(np.maximum(position / ARRIVED_M, rotation / ARRIVED_RAD))
