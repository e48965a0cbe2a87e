"""An arm that grows as it warms up."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np

from lab.core.errors import LabError
from lab.core.se3 import Array
from lab.kinematics.effects.conditions import HOUR_S, TIME, PoseConditions
from lab.kinematics.effects.effect import ArmFacts, MovesArm, SimulatedEffect, VirtualEffect

__all__ = ["Growth", "ThermalGrowth"]


@dataclass(frozen=True)
class ThermalGrowth(SimulatedEffect, MovesArm):
    """Of one arm.

    Attributes:
        growth_per_h: how much all lengths of the arm grow about its foot in an hour, relative.
    """

    growth_per_h: float

    def __post_init__(self) -> None:
        if not np.isfinite(self.growth_per_h):
            raise LabError("effects: growth_per_h is to be finite")

    @classmethod
    def none(cls, joints: int) -> Self:
        """An arm that keeps its size."""
        return cls(0.0)

    def conditions(self, joint_names: tuple[str, ...]) -> tuple[str, ...]:
        """The time."""
        return (TIME,) if self.growth_per_h else ()

    def moved(self, points: Array, foot: Array, conditions: PoseConditions) -> Array:
        """Farther from the foot."""
        if not self.growth_per_h:
            return points
        scale = 1 + self.growth_per_h * conditions.column(TIME) / HOUR_S
        grown: Array = foot + scale[:, None, None] * (points - foot)
        return grown

    def obscured(self) -> tuple[str, ...]:
        """Growth about the foot shifts and stretches what is measured; it does not turn it."""
        return tuple(f"drift.{axis}" for axis in ("x", "y", "z", "scale")) if self.growth_per_h else ()


@dataclass(frozen=True)
class Growth(VirtualEffect):
    """Growth of a virtual arm."""

    growth_ppm_per_h: float = 0.0
    """How fast the arm grows with its temperature."""

    def simulated(self, arm: ArmFacts, rngs: Sequence[np.random.Generator]) -> SimulatedEffect | None:
        """As it is given."""
        return ThermalGrowth(self.growth_ppm_per_h / 1e6)
