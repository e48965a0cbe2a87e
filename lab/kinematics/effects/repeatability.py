"""Joints that stop a little elsewhere at each visit."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np

from lab.core.se3 import Array
from lab.kinematics.effects.effect import (
    ArmFacts,
    ScattersJoints,
    SimulatedEffect,
    VirtualEffect,
    levers,
    refuse_negative,
)

__all__ = ["Repeatability", "VisitScatter"]


@dataclass(frozen=True)
class VisitScatter(SimulatedEffect, ScattersJoints):
    """Of one arm.

    Attributes:
        repeatability_rad: ``(n,)`` standard deviation of where a joint stops from one visit to the next, m of a slide.
    """

    repeatability_rad: Array

    def __post_init__(self) -> None:
        refuse_negative("repeatability_rad", self.repeatability_rad)

    @classmethod
    def none(cls, joints: int) -> Self:
        """Joints that stop where they did before."""
        return cls(np.zeros(joints))

    @property
    def is_on(self) -> bool:
        """Whether any joint scatters."""
        return bool(self.repeatability_rad.any())

    def scatter(self, poses: int, rng: np.random.Generator) -> Array:
        """Normal draws."""
        drawn: Array = self.repeatability_rad * rng.standard_normal((poses, len(self.repeatability_rad)))
        return drawn


@dataclass(frozen=True)
class Repeatability(VirtualEffect):
    """Repeatability of a virtual arm."""

    repeatability_mrad: float = 0.0
    """How far a joint is off from one visit to the next (1σ)."""

    def simulated(self, arm: ArmFacts, rngs: Sequence[np.random.Generator]) -> SimulatedEffect | None:
        """Alike for all joints."""
        return VisitScatter(levers(arm.chain) * (self.repeatability_mrad / 1e3))
