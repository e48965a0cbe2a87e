"""From poses of the tool to joint readings, for any serial arm, whatever effects it has: damped Newton steps.

Where the tool is only to be somewhere, not turned in some way, and where the arm has more joints than it needs,
every step is the shortest one that does what is asked.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lab import frames
from lab.frames import Array
from lab.geometry.affected import Arm

MAX_STEPS = 40
ARRIVED_M, ARRIVED_RAD = 1e-10, 1e-10  # an error below these is none
ROTATION_M = 0.3  # a radian weighs as much as this where steps are damped
LONGEST_STEP = 0.3  # rad or m, of any joint
LEAST_DAMPING, LARGEST_DAMPING = 1e-6, 1e3  # beside singular values in m


@dataclass(frozen=True)
class Wanted:
    """Where a target of the tool is wanted, in the tracker's frame.

    Attributes:
        places: ``(n, 3)`` m.
        turns: ``(n, 3, 3)`` of the last frame; NaN where any will do.
    """

    places: Array
    turns: Array

    def __post_init__(self) -> None:
        assert self.places.shape == (len(self), 3) and self.turns.shape == (len(self), 3, 3)
        assert np.isfinite(self.places).all()

    def __len__(self) -> int:
        return len(self.places)

    @property
    def turned(self) -> NDArray[np.bool_]:
        """``(n,)``: whether the rotation matters."""
        return np.asarray(np.isfinite(self.turns).all(axis=(1, 2)))

    def take(self, rows: NDArray[np.int_]) -> "Wanted":
        """Some of them."""
        return Wanted(self.places[rows], self.turns[rows])

    def errors(self, Ts: Array) -> Array:
        """What is missing ``(n, 6)`` from poses ``(n, 4, 4)``: m, and the rotation vector log(R_wanted R') (rad)."""
        out = np.zeros((len(self), 6))
        out[:, :3] = self.places - Ts[:, :3, 3]
        turned = self.turned
        out[turned, 3:] = frames.log(self.turns[turned] @ Ts[turned, :3, :3].swapaxes(1, 2))
        return out


@dataclass(frozen=True)
class Reached:
    """Where Newton's method ended.

    Attributes:
        joints: ``(n, joints)`` readings.
        errors: ``(n, 6)`` what is missing, m and rad.
        steps: ``(n,)`` how many it took.
    """

    joints: Array
    errors: Array
    steps: NDArray[np.int_]

    @property
    def arrived(self) -> NDArray[np.bool_]:
        """``(n,)``: whether nothing is missing."""
        return np.asarray(_in_tolerances(self.errors) < 1.0)


def reach(arm: Arm, values: Array, wanted: Wanted, start: Array, conditions: Array, target: int = 0) -> Reached:
    """Readings that bring a target to where it is wanted, from readings ``start`` ``(n, joints)``.

    Newton's method; where a step does not bring the target nearer, a damped one (Levenberg 1944). Steps are
    limited, so that the arm stays in the branch it starts in. Joint limits are not looked at.

    Args:
        conditions: ``(n, c)``, what the arm's effects ask for.
    """
    joints, steps = start.astype(np.float64), np.zeros(len(wanted), dtype=np.int_)
    errors, jacobian = _at(arm, values, wanted, joints, conditions, target)
    damping = np.zeros(len(wanted))
    for _ in range(MAX_STEPS):
        going = np.flatnonzero((_in_tolerances(errors) >= 1.0) & (damping <= LARGEST_DAMPING))
        if not going.size:
            break
        moved = joints[going] + shortest_step(jacobian[going], errors[going], wanted.turned[going], damping[going])
        there, ahead = _at(arm, values, wanted.take(going), moved, conditions[going], target)
        better = _size(there) < _size(errors[going])
        kept = going[better]
        joints[kept], errors[kept], jacobian[kept] = moved[better], there[better], ahead[better]
        damping[kept] = np.where(damping[kept] > LEAST_DAMPING, damping[kept] / 10, 0.0)
        worse = going[~better]
        damping[worse] = np.maximum(10 * damping[worse], LEAST_DAMPING)
        steps[going] += 1
    return Reached(joints, errors, steps)


def _at(arm: Arm, values: Array, wanted: Wanted, joints: Array, conditions: Array, target: int) -> tuple[Array, Array]:
    """What is missing ``(n, 6)``, and the Jacobian ``(n, 6, joints)``."""
    Ts, jacobian = arm.tool(np.concatenate([joints, conditions], axis=1), values, target)
    return wanted.errors(Ts), jacobian


def shortest_step(jacobian: Array, errors: Array, turned: NDArray[np.bool_], damping: Array | float = 0.0) -> Array:
    """The shortest move of the joints that makes up for errors, J' (J J' + d^2 I)^-1 e, limited in length.

    Args:
        jacobian: ``(n, 6, joints)``.
        errors: ``(n, 6)``.
        turned: ``(n,)``; where the rotation does not matter, the rows of the position count alone.
        damping: ``(n,)`` m.
    """
    weight = np.where(np.arange(6) < 3, 1.0, ROTATION_M) * np.where(turned[:, None], 1.0, np.arange(6) < 3)
    J, e = weight[:, :, None] * jacobian, weight * errors
    square, rows = J @ J.swapaxes(1, 2), np.arange(6)
    square[:, rows, rows] += np.reshape(damping, (-1, 1)) ** 2 + np.where(weight > 0, 1e-15, 1.0)
    step = (J.swapaxes(1, 2) @ np.linalg.solve(square, e[:, :, None]))[:, :, 0]
    longest = np.abs(step).max(axis=1, keepdims=True)
    limited: Array = step * np.minimum(1.0, LONGEST_STEP / np.maximum(longest, 1e-300))
    return limited


def _size(errors: Array) -> Array:
    """Lengths ``(n,)`` of what is missing, m, a radian as ``ROTATION_M``."""
    return np.asarray(np.linalg.norm(errors * np.where(np.arange(6) < 3, 1.0, ROTATION_M), axis=1))


def _in_tolerances(errors: Array) -> Array:
    """The same in what counts as none: below one is arrived."""
    place, turn = np.linalg.norm(errors[:, :3], axis=1), np.linalg.norm(errors[:, 3:], axis=1)
    return np.asarray(np.maximum(place / ARRIVED_M, turn / ARRIVED_RAD))
