"""Temperature: an arm whose lengths expand, and whose joints' zeros shift, in proportion to the column ``temp_C``.

Both are zero at 20 degrees Celsius, where lengths are stated (ISO 1:2022).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, Self

import numpy as np

from lab.core.errors import LabError
from lab.core.se3 import Array
from lab.kinematics.effects.conditions import REFERENCE_C, TEMPERATURE, PoseConditions
from lab.kinematics.effects.effect import (
    ArmFacts,
    Effect,
    FittedGroup,
    MovesArm,
    MovesJoints,
    SimulatedEffect,
    VirtualEffect,
    by_joint,
    joint_terms,
    levers,
)
from lab.kinematics.joints import JointSpec
from lab.kinematics.parameter import Kind, Parameter, joint_parameter

__all__ = ["Temperature", "ThermalExpansion", "ThermalZeros", "ZerosByTemperature", "expansion", "thermal_zeros"]

_WARMER = ("condition", TEMPERATURE, REFERENCE_C)  # as a signal of formats.plain_arm
_EXPANSION_SCALE, _ZERO_SCALE = 1e-4, 1e-4  # 1/K, rad/K: several times those of aluminium, and of its joints


def expansion() -> Effect:
    """The fitted group: the coefficient (1/K) by which all lengths of the arm, its tool's too, expand."""
    parameter = Parameter("thermal", "expansion", "expansion", "ratio", "1/K", _EXPANSION_SCALE)

    def offsets(_: Array, temperature: Array, values: Array) -> tuple[Array, Array]:
        warmer = temperature - REFERENCE_C  # (n, 1)
        return warmer * values, warmer[:, :, None]

    def plain(values: Array) -> list[dict[str, Any]]:
        return [{"size": float(values[0]), "of": list(_WARMER)}]

    return Effect("expansion", (parameter,), offsets, (TEMPERATURE,), "size", plain=plain)


def thermal_zeros(chain: JointSpec) -> Effect:
    """The fitted group: how far each joint's zero shifts for a degree (rad/K, m/K of a slide)."""
    kinds: list[tuple[Kind, str]] = [("length", "m/K") if slides else ("angle", "rad/K") for slides in chain.prismatic]
    parameters = tuple(
        joint_parameter("thermal_zeros", i, "thermal", kind, unit=unit, scale=_ZERO_SCALE)
        for i, (kind, unit) in enumerate(kinds)
    )

    return Effect(
        "thermal_zeros",
        parameters,
        lambda _, temperature, values: by_joint(temperature - REFERENCE_C, values),
        (TEMPERATURE,),
        plain=lambda values: joint_terms(values, *((i, _WARMER) for i in range(chain.size))),
    )


@dataclass(frozen=True)
class ThermalExpansion(SimulatedEffect, MovesArm):
    """Of one arm.

    Attributes:
        expansion_per_k: by which all its lengths grow about its foot for a degree, relative.
    """

    expansion_per_k: float

    def __post_init__(self) -> None:
        if not np.isfinite(self.expansion_per_k):
            raise LabError("effects: expansion_per_k is to be finite")

    @classmethod
    def none(cls, joints: int) -> Self:
        """An arm of a material that does not expand."""
        return cls(0.0)

    def conditions(self, joint_names: tuple[str, ...]) -> tuple[str, ...]:
        """The temperature."""
        return (TEMPERATURE,) if self.expansion_per_k else ()

    def moved(self, points: Array, foot: Array, conditions: PoseConditions) -> Array:
        """Farther from the foot where it is warmer."""
        if not self.expansion_per_k:
            return points
        scale = 1 + self.expansion_per_k * conditions.warmer
        return np.asarray(foot + scale[:, None, None] * (points - foot))

    def true_parameters(self) -> dict[str, float]:
        """The coefficient."""
        return {"thermal.expansion": self.expansion_per_k}


@dataclass(frozen=True)
class ThermalZeros(SimulatedEffect, MovesJoints):
    """Of one arm.

    Attributes:
        zeros_rad_per_k: ``(n,)`` by which each joint's zero shifts for a degree; m/K of a slide.
    """

    zeros_rad_per_k: Array

    @classmethod
    def none(cls, joints: int) -> Self:
        """Zeros that stay."""
        return cls(np.zeros(joints))

    def conditions(self, joint_names: tuple[str, ...]) -> tuple[str, ...]:
        """The temperature."""
        return (TEMPERATURE,) if self.zeros_rad_per_k.any() else ()

    def joint_offsets(self, joints: Array, conditions: PoseConditions) -> Array:
        """In proportion to how much warmer than 20 degrees it is."""
        return np.asarray(conditions.warmer[:, None] * self.zeros_rad_per_k)

    def true_parameters(self) -> dict[str, float]:
        """The shifts."""
        return {f"joint{i + 1}.thermal": float(value) for i, value in enumerate(self.zeros_rad_per_k)}


@dataclass(frozen=True)
class Temperature(VirtualEffect):
    """A virtual arm that warms up."""

    expansion_ppm_per_k: float = 0.0
    """How much all lengths of the arm grow with its temperature: 12 of steel, 23 of aluminium."""

    groups: ClassVar[tuple[FittedGroup, ...]] = (
        FittedGroup("expansion", lambda _: expansion(), "lengths that grow with temp_C"),
    )

    def simulated(self, arm: ArmFacts, rngs: Sequence[np.random.Generator]) -> SimulatedEffect | None:
        """As it is given."""
        return ThermalExpansion(self.expansion_ppm_per_k / 1e6)


@dataclass(frozen=True)
class ZerosByTemperature(VirtualEffect):
    """A virtual arm whose joints' zeros shift as it warms up."""

    thermal_zero_mrad_per_k: float = 0.0
    """How far the joints' zeros shift with the temperature (1σ)."""

    draws: ClassVar[int] = 1
    groups: ClassVar[tuple[FittedGroup, ...]] = (
        FittedGroup("thermal_zeros", lambda arm: thermal_zeros(arm.chain), "joints' zeros that shift with temp_C"),
    )

    def simulated(self, arm: ArmFacts, rngs: Sequence[np.random.Generator]) -> SimulatedEffect | None:
        """Normal draws, one a joint."""
        sizes = self.thermal_zero_mrad_per_k / 1e3 * rngs[0].standard_normal(arm.chain.size)
        return ThermalZeros(levers(arm.chain) * sizes)
