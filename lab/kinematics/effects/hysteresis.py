"""Hysteresis of width h_i: joint i is at q_i + s_i h_i / 2, where s_i is the direction in which it moved last.

What friction and wind-up leave behind: like play, but told by the order of the poses alone, where a file does not say
from which side each joint came (``backlash``).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar, Self

import numpy as np

from lab.core.measurements import last_moves
from lab.core.se3 import Array
from lab.kinematics.effects.backlash import fitted_widths
from lab.kinematics.effects.conditions import PoseConditions, last_move_of
from lab.kinematics.effects.effect import (
    ArmFacts,
    Effect,
    FittedGroup,
    MovesJoints,
    SimulatedEffect,
    VirtualEffect,
    levers,
    refuse_negative,
)
from lab.kinematics.joints import JointSpec

__all__ = ["Hysteresis", "JointHysteresis", "hysteresis"]


def hysteresis(chain: JointSpec) -> Effect:
    """The fitted group: h_i of every joint."""
    return fitted_widths("hysteresis", chain, last_move_of)


@dataclass(frozen=True)
class JointHysteresis(SimulatedEffect, MovesJoints):
    """Of one arm.

    Attributes:
        hysteresis_rad: ``(n,)`` full widths, m of a slide.
    """

    hysteresis_rad: Array

    def __post_init__(self) -> None:
        refuse_negative("hysteresis_rad", self.hysteresis_rad)

    @classmethod
    def none(cls, joints: int) -> Self:
        """Joints without friction."""
        return cls(np.zeros(joints))

    def joint_offsets(self, joints: Array, conditions: PoseConditions) -> Array:
        """Half the width to where the joint came from its last position, by the order of the poses."""
        if not self.hysteresis_rad.any():
            return np.zeros(joints.shape)
        return np.asarray(self.hysteresis_rad / 2 * last_moves(joints))

    def true_parameters(self) -> dict[str, float]:
        """h_i."""
        return {f"joint{i + 1}.hysteresis": float(value) for i, value in enumerate(self.hysteresis_rad)}


@dataclass(frozen=True)
class Hysteresis(VirtualEffect):
    """Hysteresis of a virtual arm."""

    hysteresis_mrad: float = 0.0
    """Mean hysteresis of the joints, by the direction of their last move."""

    draws: ClassVar[int] = 1
    groups: ClassVar[tuple[FittedGroup, ...]] = (
        FittedGroup(
            "hysteresis",
            lambda arm: hysteresis(arm.chain),
            "play by the direction of the last move, as rows are ordered",
        ),
    )

    def simulated(self, arm: ArmFacts, rngs: Sequence[np.random.Generator]) -> SimulatedEffect | None:
        """Each joint's between half the mean and one and a half of it."""
        widths = (self.hysteresis_mrad / 1e3) * rngs[0].uniform(0.5, 1.5, arm.chain.size)
        return JointHysteresis(levers(arm.chain) * widths)
