"""Gear ratios that are off: joint i is at (1 + e_i) q_i."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar, Self

import numpy as np

from lab.core.se3 import Array
from lab.kinematics.effects.conditions import PoseConditions
from lab.kinematics.effects.effect import (
    ArmFacts,
    Effect,
    FittedGroup,
    MovesJoints,
    SimulatedEffect,
    VirtualEffect,
    by_joint,
    joint_terms,
)
from lab.kinematics.joints import JointSpec
from lab.kinematics.parameter import joint_parameter

__all__ = ["Gear", "GearErrors", "gear"]


def gear(chain: JointSpec) -> Effect:
    """The fitted group: e_i of every joint."""
    parameters = tuple(joint_parameter("gear", i, "gear", "ratio") for i in range(chain.size))
    where = [(i, ("position", i)) for i in range(chain.size)]
    return Effect(
        "gear",
        parameters,
        lambda joints, _, values: by_joint(joints, values),
        plain=lambda values: joint_terms(values, *where),
    )


@dataclass(frozen=True)
class GearErrors(SimulatedEffect, MovesJoints):
    """Of one arm.

    Attributes:
        gear: ``(n,)``; the joint moves by 1 + gear where its measured position says 1.
    """

    gear: Array

    @classmethod
    def none(cls, joints: int) -> Self:
        """Exact gears."""
        return cls(np.zeros(joints))

    def joint_offsets(self, joints: Array, conditions: PoseConditions) -> Array:
        """In proportion to the joint's position."""
        offsets: Array = self.gear * joints
        return offsets

    def true_parameters(self) -> dict[str, float]:
        """e_i."""
        return {f"joint{i + 1}.gear": float(value) for i, value in enumerate(self.gear)}


@dataclass(frozen=True)
class Gear(VirtualEffect):
    """Gear errors of a virtual arm."""

    gear_ppm: float = 0.0
    """How far gear ratios are off (1σ)."""

    draws: ClassVar[int] = 1
    groups: ClassVar[tuple[FittedGroup, ...]] = (FittedGroup("gear", lambda arm: gear(arm.chain)),)

    def simulated(self, arm: ArmFacts, rngs: Sequence[np.random.Generator]) -> SimulatedEffect | None:
        """Normal draws, one a joint."""
        return GearErrors(self.gear_ppm / 1e6 * rngs[0].standard_normal(arm.chain.size))
