"""Play of full width b_i: joint i is at q_i + a_i b_i / 2, where a_i, its direction of approach, is 1 or -1."""

from collections.abc import Callable, Container, Sequence
from dataclasses import dataclass
from typing import ClassVar, Self

import numpy as np

from lab.core.se3 import Array
from lab.kinematics.effects.conditions import PoseConditions, approach_of
from lab.kinematics.effects.effect import (
    ArmFacts,
    Effect,
    FittedGroup,
    MovesJoints,
    SimulatedEffect,
    TermFamily,
    VirtualEffect,
    by_joint,
    joint_terms,
    levers,
    refuse_negative,
)
from lab.kinematics.joints import JointSpec
from lab.kinematics.parameter import Kind, Parameter, joint_parameter

__all__ = ["Backlash", "Play", "approached_groups", "backlash", "fitted_widths"]

_SCALE = 1e-3  # rad, m of a slide


def backlash(chain: JointSpec) -> Effect:
    """The fitted group: b_i of every joint."""
    return fitted_widths("backlash", chain, approach_of)


def fitted_widths(group: str, chain: JointSpec, direction_of: Callable[[str], str]) -> Effect:
    """The fitted group of widths w_i: joint i is at q_i + s_i w_i / 2, with a direction s_i of 1 or -1.

    Args:
        direction_of: from a joint's name to the condition that is its direction.
    """
    parameters = tuple(_width(group, chain, i, group) for i in range(chain.size))
    conditions = tuple(map(direction_of, chain.joint_names))
    where = [(i, ("condition", name, 0.0)) for i, name in enumerate(conditions)]
    return Effect(
        group,
        parameters,
        lambda _, direction, values: by_joint(direction / 2, values),
        conditions,
        plain=lambda values: joint_terms(values, *where, times=0.5),
    )


def approached_groups(chain: JointSpec, columns: Container[str]) -> tuple[str, ...]:
    """The groups that stand for ``backlash`` where measurements have some columns alone.

    Args:
        columns: the names of the measurements' conditions.

    Returns:
        A group for each joint whose direction of approach is among the columns, where others' are not; else
        ``backlash`` itself.
    """
    known = [joint for joint, name in enumerate(chain.joint_names) if approach_of(name) in columns]
    return tuple(map(PLAY.name, known)) if 0 < len(known) < chain.size else ("backlash",)


def _width(group: str, chain: JointSpec, joint: int, symbol: str) -> Parameter:
    kind: Kind = "length" if chain.prismatic[joint] else "angle"
    return joint_parameter(group, joint, symbol, kind, scale=_SCALE)


def _of_one_joint(arm: ArmFacts, joint: int, _: int) -> Effect:
    name, size = PLAY.name(joint), arm.chain.size

    def offsets(joints: Array, direction: Array, values: Array) -> tuple[Array, Array]:
        derivative = np.zeros((len(joints), size, 1))
        derivative[:, joint] = direction / 2
        return derivative @ values, derivative

    width = _width(name, arm.chain, joint, "backlash")
    condition = approach_of(arm.chain.joint_names[joint])
    where = (joint, ("condition", condition, 0.0))
    return Effect(name, (width,), offsets, (condition,), plain=lambda values: joint_terms(values, where, times=0.5))


PLAY = TermFamily("backlash", "", _of_one_joint, lambda _: (), lambda joint, _: f"joint {joint} has play")


@dataclass(frozen=True)
class Play(SimulatedEffect, MovesJoints):
    """Of one arm.

    Attributes:
        backlash_rad: ``(n,)`` full widths, m of a slide.
    """

    backlash_rad: Array

    def __post_init__(self) -> None:
        refuse_negative("backlash_rad", self.backlash_rad)

    @classmethod
    def none(cls, joints: int) -> Self:
        """Joints without play."""
        return cls(np.zeros(joints))

    def conditions(self, joint_names: tuple[str, ...]) -> tuple[str, ...]:
        """The direction of approach of joints with play."""
        return tuple(approach_of(name) for name, width in zip(joint_names, self.backlash_rad, strict=True) if width)

    def joint_offsets(self, joints: Array, conditions: PoseConditions) -> Array:
        """Half the width above the measured position at approach +1, below it at -1."""
        offsets: Array = self.backlash_rad / 2 * conditions.approach
        return offsets

    def true_parameters(self) -> dict[str, float]:
        """b_i."""
        return {f"joint{i + 1}.backlash": float(value) for i, value in enumerate(self.backlash_rad)}


@dataclass(frozen=True)
class Backlash(VirtualEffect):
    """Play of a virtual arm."""

    backlash_mrad: float = 0.0
    """Mean play of the joints."""

    draws: ClassVar[int] = 1
    groups: ClassVar[tuple[FittedGroup, ...]] = (FittedGroup("backlash", lambda arm: backlash(arm.chain)),)
    terms: ClassVar[tuple[TermFamily, ...]] = (PLAY,)

    def simulated(self, arm: ArmFacts, rngs: Sequence[np.random.Generator]) -> SimulatedEffect | None:
        """Each joint's between half the mean and one and a half of it."""
        return Play(levers(arm.chain) * (self.backlash_mrad / 1e3) * rngs[0].uniform(0.5, 1.5, arm.chain.size))
