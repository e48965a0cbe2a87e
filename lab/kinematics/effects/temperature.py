"""Effects of temperature and time: thermal growth, zeros by temperature, drift of the frame.

Expansion and zeros are in proportion to ``temp_C`` above 20 degrees, the reference temperature of lengths (ISO 1:2022).
Drift is in proportion to ``time_s``, or to a row's place in a file without it.
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
    OnePerJoint,
    PoseConditions,
    SimulatedEffect,
    TrackerMotion,
    VirtualEffect,
    from_signals,
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
]

_WARMER = ("condition", TEMPERATURE, REFERENCE_C)  # signal of formats.plain_arm
_EXPANSION_SCALE, _ZERO_SCALE = 1e-4, 1e-4  # 1/K, rad/K: several times those of aluminium, and of its joints


def _expansion() -> Effect:
    """Return the fitted group: the coefficient (1/K) of expansion of all lengths of the arm and its tool."""
    parameter = Parameter("thermal", "expansion", "expansion", "ratio", Unit("1/K", "ppm/K", 1e6), _EXPANSION_SCALE)

    def offsets(_: Array, temperature: Array, values: Array) -> tuple[Array, Array]:
        warmer = temperature - REFERENCE_C  # (n, 1)
        return warmer * values, warmer[:, :, None]

    def terms(values: Array) -> list[dict[str, Any]]:
        return [{"size": float(values[0]), "of": list(_WARMER)}]

    return Effect("expansion", (parameter,), offsets, (TEMPERATURE,), "size", terms=terms)


def _thermal_zeros(chain: JointSpec) -> Effect:
    """Return the fitted group: shifts of the joints' zeros per degree (rad/K, m/K of a slide)."""
    kinds: tuple[tuple[Kind, Unit], ...] = ("angle", Unit("rad/K", "µrad/K", 1e6)), ("length", Unit("m/K", "µm/K", 1e6))
    parameters = tuple(
        joint_parameter("thermal_zeros", i, "thermal", kind, unit=unit, scale=_ZERO_SCALE)
        for i, slides in enumerate(chain.prismatic)
        for kind, unit in kinds[slides : slides + 1]
    )

    return from_signals(
        "thermal_zeros",
        parameters,
        range(chain.size),
        lambda _, temperature: temperature - REFERENCE_C,
        [_WARMER] * chain.size,
        (TEMPERATURE,),
    )


@dataclass(frozen=True)
class ThermalExpansion(SimulatedEffect, MovesArm):
    """Thermal expansion of one arm.

    Attributes:
        expansion_per_k: relative growth of all its lengths about its base per degree.
    """

    expansion_per_k: float

    def __post_init__(self) -> None:
        if not np.isfinite(self.expansion_per_k):
            raise LabError("effects: expansion_per_k is to be finite")

    @classmethod
    def none(cls, joints: int) -> Self:
        """Return no expansion."""
        return cls(0.0)

    def conditions(self, joint_names: tuple[str, ...]) -> tuple[str, ...]:
        """Return the temperature."""
        return (TEMPERATURE,) if self.expansion_per_k else ()

    def moved(self, points: Array, base: Array, conditions: PoseConditions) -> Array:
        """Return the points scaled about the base."""
        if not self.expansion_per_k:
            return points
        scale = 1 + self.expansion_per_k * conditions.warmer
        return np.asarray(base + scale[:, None, None] * (points - base))

    def true_parameters(self) -> dict[str, float]:
        """Return the coefficient."""
        return {"thermal.expansion": self.expansion_per_k}


@dataclass(frozen=True)
class ThermalZeros(OnePerJoint, MovesJoints):
    """Thermal zero offsets of one arm.

    Attributes:
        zeros_rad_per_k: ``(n,)`` shift of each joint's zero per degree; m/K of a slide.
    """

    zeros_rad_per_k: Array
    symbol: ClassVar[str] = "thermal"

    def conditions(self, joint_names: tuple[str, ...]) -> tuple[str, ...]:
        """Return the temperature."""
        return (TEMPERATURE,) if self.zeros_rad_per_k.any() else ()

    def joint_offsets(self, joints: Array, conditions: PoseConditions) -> Array:
        """Return offsets in proportion to the temperature above 20 degrees."""
        return np.asarray(conditions.warmer[:, None] * self.zeros_rad_per_k)


@dataclass(frozen=True)
class Temperature(VirtualEffect):
    """Thermal expansion of a virtual arm."""

    expansion_ppm_per_k: float = 0.0
    """How much all lengths of the arm grow with its temperature: 12 of steel, 23 of aluminium."""

    groups: ClassVar[tuple[FittedGroup, ...]] = (
        FittedGroup("expansion", lambda _: _expansion(), "lengths that grow with temp_C"),
    )

    def simulated(self, arm: ArmFacts, rngs: Sequence[np.random.Generator]) -> SimulatedEffect | None:
        """Return the expansion as given."""
        return ThermalExpansion(PPM.to_si(self.expansion_ppm_per_k))


@dataclass(frozen=True)
class ZerosByTemperature(VirtualEffect):
    """Thermal shifts of a virtual arm's zeros."""

    thermal_zero_mrad_per_k: float = 0.0
    """How far the joints' zeros shift with the temperature (1σ)."""

    draws: ClassVar[int] = 1
    groups: ClassVar[tuple[FittedGroup, ...]] = (
        FittedGroup("thermal_zeros", lambda arm: _thermal_zeros(arm.chain), "joints' zeros that shift with temp_C"),
    )

    def simulated(self, arm: ArmFacts, rngs: Sequence[np.random.Generator]) -> SimulatedEffect | None:
        """Draw one normal number a joint."""
        sizes = MRAD.to_si(self.thermal_zero_mrad_per_k) * rngs[0].standard_normal(arm.chain.size)
        return ThermalZeros(levers(arm.chain) * sizes)


@dataclass(frozen=True)
class ThermalGrowth(SimulatedEffect, MovesArm):
    """Thermal growth of one arm.

    Attributes:
        growth_per_h: relative growth of all lengths of the arm about its base per hour.
    """

    growth_per_h: float

    def __post_init__(self) -> None:
        if not np.isfinite(self.growth_per_h):
            raise LabError("effects: growth_per_h is to be finite")

    @classmethod
    def none(cls, joints: int) -> Self:
        """Return no growth."""
        return cls(0.0)

    def conditions(self, joint_names: tuple[str, ...]) -> tuple[str, ...]:
        """Return the time."""
        return (TIME,) if self.growth_per_h else ()

    def moved(self, points: Array, base: Array, conditions: PoseConditions) -> Array:
        """Return the points scaled about the base."""
        if not self.growth_per_h:
            return points
        scale = 1 + self.growth_per_h * conditions.column(TIME) / HOUR_S
        return np.asarray(base + scale[:, None, None] * (points - base))

    def obscured(self) -> tuple[str, ...]:
        """Return the shifts and the stretch of drift, which growth about the base changes."""
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
    """Return the fitted group: shift, turn and stretch of the measured points per hour."""
    return _drift(TIME, start_s, HOUR_S)


def _drift(condition: str, start: float, whole: float) -> Effect:
    parameters = placed_parameters("drift", "drift", (*AXES, "scale"), rate=condition == TIME, scaled=True)

    def offsets(_: Array, given: Array, values: Array) -> tuple[Array, Array]:
        share = (given - start) / whole  # (n, 1)
        return share * values, share[:, :, None] * np.eye(7)

    return Effect("drift", parameters, offsets, (condition,), "frame")


def _fitted(arm: ArmFacts) -> Effect:
    return drift(arm.sessions.start_s) if arm.sessions.timed else _drift(PLACE, 0.0, 1.0)


@dataclass(frozen=True)
class TrackerDrift(TrackerMotion):
    """Tracker drift of one campaign: the motion per hour, at a constant rate."""

    condition: ClassVar[str] = TIME
    whole: ClassVar[float] = HOUR_S

    def true_parameters(self) -> dict[str, float]:
        """Return the tracker's motion reversed: ``p' = exp(w t) (p + v t)``."""
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
        """Draw both directions."""
        return TrackerDrift.random(MM.to_si(self.drift_mm_per_h), MRAD.to_si(self.drift_mrad_per_h), rngs)
