"""What may have moved since an arm was calibrated: its base, its tool, the zero of one joint; and how far."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from lab.calibration.initial_guess import columns_of
from lab.core import se3
from lab.core.se3 import Array
from lab.kinematics.effects.arm import Arm

__all__ = [
    "ChangeHypothesis",
    "Displacement",
    "Kind",
    "extent",
    "movements",
    "of_base",
    "of_joints",
    "of_targets",
    "refitted",
    "sized",
]

Kind = Literal["base", "tool", "joint", "reading"]


@dataclass(frozen=True)
class Displacement:
    """How far something has moved, each with its standard deviation; NaN where that does not apply or is not told."""

    shift_m: float = float("nan")
    shift_std_m: float = float("nan")
    turn_rad: float = float("nan")
    turn_std_rad: float = float("nan")


@dataclass(frozen=True)
class ChangeHypothesis:
    """One way in which an arm may have changed.

    Attributes:
        change: what it is, by the name of its phrase: ``base_shift``, ``base``, ``tool``, ``targets``, ``target`` or
            ``joint``.
        of: the target's name, or the joint's number and name.
        directions: ``(p, h)`` how its h numbers change the parameters.
        turns: how many of these, the last ones, are rotations (rad); the others are lengths (m).
        alike: how many movements like it are tried.
    """

    kind: Kind
    change: str
    of: tuple[str, ...]
    directions: Array
    turns: int = 0
    alike: int = 1


def movements(arm: Arm, values: Array, without: Sequence[str]) -> list[ChangeHypothesis]:
    """All that is tried: of base, tool and joints, without the kinds that are fitted anew anyhow.

    Args:
        without: ``base``, ``tool``, or both.
    """
    found = [] if "base" in without else of_base(arm)
    found += [] if "tool" in without else _of_tool(arm, values)
    return found + of_joints(arm)


def refitted(arm: Arm, refit: Sequence[str]) -> Array:
    """Directions ``(p, h)`` of everything that is fitted anew."""
    return np.eye(len(arm.names))[:, list(columns_of(arm, refit))]


def of_base(arm: Arm) -> list[ChangeHypothesis]:
    """Instrument and base moved against each other: it is the same to the measurements."""
    one = refitted(arm, ("base",))
    return [
        ChangeHypothesis("base", "base_shift", (), one[:, :3]),
        ChangeHypothesis("base", "base", (), one, turns=3),
    ]


def _of_tool(arm: Arm, values: Array) -> list[ChangeHypothesis]:
    """Each target moved alone; of several, the tool moved as one (by little: v + w x t), or each by its own."""
    one, count, found = refitted(arm, ("tool",)), len(arm.targets), of_targets(arm)
    if count > 1:
        places = values[list(columns_of(arm, ("tool",)))].reshape(-1, 3)
        turned = -se3.skew(places - places.mean(axis=0))  # (k, 3, 3) of w x t
        as_one = np.concatenate([np.tile(np.eye(3), (count, 1)), turned.reshape(-1, 3)], axis=1)
        found.append(ChangeHypothesis("tool", "tool", (), one @ as_one, turns=3))
        found.append(ChangeHypothesis("tool", "targets", (), one))
    return found


def of_targets(arm: Arm) -> list[ChangeHypothesis]:
    """Each target moved alone."""
    one, count = refitted(arm, ("tool",)), len(arm.targets)
    return [
        ChangeHypothesis("tool", "target", (target,), one[:, 3 * k : 3 * k + 3], alike=count)
        for k, target in enumerate(arm.targets)
    ]


def of_joints(arm: Arm) -> list[ChangeHypothesis]:
    """The zero of each joint: it stands further than its reading says."""
    chain, found = arm.rigid.chain, []
    directions = arm.rigid.joint_derivatives(np.eye(len(arm.names)))  # (p, joints)
    for k, slides in enumerate(chain.prismatic):
        of = str(k + 1), chain.joint_names[k]
        direction = directions[:, k : k + 1]
        found.append(ChangeHypothesis("joint", "joint", of, direction, int(not slides), chain.size))
    return found


def extent(arm: Arm, movement: ChangeHypothesis, before: Array, after: Array, covariance: Array) -> Displacement:
    """How far a movement went.

    Args:
        before, after: all parameters ``(p,)``.
        covariance: ``(p, p)`` of ``after``.
    """
    back = np.linalg.pinv(movement.directions, rcond=1e-9)
    numbers, spread = back @ (after - before), back @ covariance @ back.T
    if movement.kind == "base" and movement.turns:
        turning = list(columns_of(arm, ("base",)))[3:]
        old, new = se3.exp(before[turning]), se3.exp(after[turning])
        numbers[3:] = se3.log(new @ old.T)
        local = np.eye(6)
        local[3:, 3:] = se3.left_jacobian(after[turning])
        spread = local @ spread @ local.T
    first = len(numbers) - movement.turns
    shift = sized(numbers[:first], spread[:first, :first])
    turn = sized(numbers[first:], spread[first:, first:])
    return Displacement(*shift, *turn)


def sized(vector: Array, covariance: Array) -> tuple[float, float]:
    """Length of a vector ``(3 k,)``, or of the mean of k of them (root mean square), and its standard deviation.

    A single number keeps its sign. NaN where there is none.
    """
    if not len(vector):
        return float("nan"), float("nan")
    if len(vector) == 1:
        return float(vector[0]), float(np.sqrt(covariance[0, 0]))
    length = float(np.linalg.norm(vector))
    along = vector / length if length > 0 else np.full(len(vector), len(vector) ** -0.5)
    each = np.sqrt(len(vector) / 3)
    return length / each, float(np.sqrt(along @ covariance @ along)) / each
