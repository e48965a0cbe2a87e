"""Effects of temperature and time: thermal growth, zeros by temperature, drift of the frame.

Temperature: an arm whose lengths expand, and whose joints' zeros shift, in proportion to the column ``temp_C``.

Both are zero at 20 degrees Celsius, where lengths are stated (ISO 1:2022).

A tracker that creeps, a base that yields, or a frame that grows: what is measured moves steadily.

In proportion to the time from a start where a file has ``time_s``, else to a row's place in the file.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, Self

import numpy as np

from lab.core.errors import LabError
from lab.core.measurements import PLACE
from lab.core.se3 import Array
from lab.core.units import MM, MRAD, PPM, Unit
from lab.kinematics.effects.effect import (
    AXES,
    HOUR_S,
    REFERENCE_C,
    TEMPERATURE,
    TIME,
    ArmFacts,
    Effect,
    FittedGroup,
    MovesArm,
    MovesJoints,
    PoseConditions,
    SimulatedEffect,
    TrackerMotion,
    VirtualEffect,
    by_joint,
    joint_terms,
    levers,
)
from lab.kinematics.joints import JointSpec
from lab.kinematics.parameter import Kind, Parameter, joint_parameter, placed_parameters

__all__ = [
    "Drift",
    "Growth",
    "Temperature",
    "ThermalExpansion",
    "ThermalGrowth",
    "ThermalZeros",
    "TrackerDrift",
    "ZerosByTemperature",
    "drift",
    "expansion",
    "thermal_zeros",
]

_WARMER = ("condition", TEMPERATURE, REFERENCE_C)  # as a signal of formats.plain_arm
_EXPANSION_SCALE, _ZERO_SCALE = 1e-4, 1e-4  # 1/K, rad/K: several times those of aluminium, and of its joints


def expansion() -> Effect:
    """The fitted group: the coefficient (1/K) by which all lengths of the arm, its tool's too, expand."""
    parameter = Parameter("thermal", "expansion", "expansion", "ratio", Unit("1/K", "ppm/K", 1e6), _EXPANSION_SCALE)

    def offsets(_: Array, temperature: Array, values: Array) -> tuple[Array, Array]:
        warmer = temperature - REFERENCE_C  # (n, 1)
        return warmer * values, warmer[:, :, None]

    def plain(values: Array) -> list[dict[str, Any]]:
        return [{"size": float(values[0]), "of": list(_WARMER)}]

    return Effect("expansion", (parameter,), offsets, (TEMPERATURE,), "size", plain=plain)


def thermal_zeros(chain: JointSpec) -> Effect:
    """The fitted group: how far each joint's zero shifts for a degree (rad/K, m/K of a slide)."""
    kinds: tuple[tuple[Kind, Unit], ...] = ("angle", Unit("rad/K", "µrad/K", 1e6)), ("length", Unit("m/K", "µm/K", 1e6))
    parameters = tuple(
        joint_parameter("thermal_zeros", i, "thermal", kind, unit=unit, scale=_ZERO_SCALE)
        for i, slides in enumerate(chain.prismatic)
        for kind, unit in kinds[slides : slides + 1]
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
    """Thermal expansion of one arm.

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

    def moved(self, points: Array, base: Array, conditions: PoseConditions) -> Array:
        """Farther from the foot where it is warmer."""
        if not self.expansion_per_k:
            return points
        scale = 1 + self.expansion_per_k * conditions.warmer
        return np.asarray(base + scale[:, None, None] * (points - base))

    def true_parameters(self) -> dict[str, float]:
        """The coefficient."""
        return {"thermal.expansion": self.expansion_per_k}


@dataclass(frozen=True)
class ThermalZeros(SimulatedEffect, MovesJoints):
    """Thermal zero offsets of one arm.

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
        """Return offsets in proportion to the temperature above 20 degrees."""
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
        """Return the expansion as given."""
        return ThermalExpansion(PPM.to_si(self.expansion_ppm_per_k))


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
        sizes = MRAD.to_si(self.thermal_zero_mrad_per_k) * rngs[0].standard_normal(arm.chain.size)
        return ThermalZeros(levers(arm.chain) * sizes)


@dataclass(frozen=True)
class ThermalGrowth(SimulatedEffect, MovesArm):
    """Thermal growth of one arm.

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

    def moved(self, points: Array, base: Array, conditions: PoseConditions) -> Array:
        """Farther from the foot."""
        if not self.growth_per_h:
            return points
        scale = 1 + self.growth_per_h * conditions.column(TIME) / HOUR_S
        grown: Array = base + scale[:, None, None] * (points - base)
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
        """Return the growth as given."""
        return ThermalGrowth(PPM.to_si(self.growth_ppm_per_h))


def drift(start_s: float = 0.0) -> Effect:
    """The fitted group: how far what is measured is shifted, turned and stretched in an hour."""
    parameters = placed_parameters("drift", "drift", (*AXES, "scale"), rate=True, scaled=True)

    def offsets(_: Array, time_s: Array, values: Array) -> tuple[Array, Array]:
        hours = (time_s - start_s) / HOUR_S  # (n, 1)
        return hours * values, hours[:, :, None] * np.eye(7)

    return Effect("drift", parameters, offsets, (TIME,), "frame")


def _drift_by_row() -> Effect:
    """The fitted group where nobody wrote down the time: how far what is measured moves from first row to last."""
    parameters = placed_parameters("drift", "drift", (*AXES, "scale"), scaled=True)

    def offsets(_: Array, place: Array, values: Array) -> tuple[Array, Array]:
        return place * values, place[:, :, None] * np.eye(7)

    return Effect("drift", parameters, offsets, (PLACE,), "frame")


def _fitted(arm: ArmFacts) -> Effect:
    return drift(arm.sessions.start_s) if arm.sessions.timed else _drift_by_row()


@dataclass(frozen=True)
class TrackerDrift(TrackerMotion):
    """Tracker drift of one campaign: the motion per hour, at a constant rate."""

    condition: ClassVar[str] = TIME
    whole: ClassVar[float] = HOUR_S

    def true_parameters(self) -> dict[str, float]:
        """The tracker's motion reversed: ``p' = exp(w t) (p + v t)``."""
        rates = {f"drift.{axis}": float(value) for axis, value in zip(AXES, -self.motion, strict=True)}
        return rates | {"drift.scale": 0.0}


@dataclass(frozen=True)
class Drift(VirtualEffect):
    """Drift of a virtual arm's tracker."""

    drift_mm_per_h: float = 0.0
    """How fast the tracker creeps, in a random direction."""
    drift_mrad_per_h: float = 0.0
    """How fast the tracker turns, about a random axis."""

    draws: ClassVar[int] = 2
    groups: ClassVar[tuple[FittedGroup, ...]] = (FittedGroup("drift", _fitted, of_one_campaign=True),)

    def simulated(self, arm: ArmFacts, rngs: Sequence[np.random.Generator]) -> SimulatedEffect | None:
        """Both directions are drawn."""
        return TrackerDrift.random(MM.to_si(self.drift_mm_per_h), MRAD.to_si(self.drift_mrad_per_h), rngs)
