"""Waves of gears and motors: joints that run out many times a turn."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar, Self

import numpy as np

from lab.core.errors import LabError
from lab.core.se3 import Array
from lab.kinematics.effects.conditions import PoseConditions
from lab.kinematics.effects.effect import ArmFacts, MovesJoints, SimulatedEffect, VirtualEffect
from lab.kinematics.joints import JointSpec

__all__ = ["GearWaves", "Ripple"]

_ORDERS = (3, 60)  # least and largest: those of one and two are runout


@dataclass(frozen=True)
class GearWaves(SimulatedEffect, MovesJoints):
    """Of one arm.

    Attributes:
        waves: ``(n, 3)``: how often a turn of its own position each joint is off, and the coefficients (rad) of sine
            and cosine of that many times the position. Zero for a slide.
    """

    waves: Array

    @classmethod
    def none(cls, joints: int) -> Self:
        """Smooth gears."""
        return cls(np.zeros((joints, 3)))

    def joint_offsets(self, joints: Array, conditions: PoseConditions) -> Array:
        """Waves of the joint's position."""
        order, sine, cosine = self.waves.T
        offsets: Array = sine * np.sin(order * joints) + cosine * np.cos(order * joints)
        return offsets

    def true_parameters(self) -> dict[str, float]:
        """Those of ``joint2.harmonic20`` and its like."""
        found: dict[str, float] = {}
        for i, (order, sine, cosine) in enumerate(self.waves.tolist(), start=1):
            if order:
                found |= {f"joint{i}.sin{order:.0f}": sine, f"joint{i}.cos{order:.0f}": cosine}
        return found

    def refuse_unfit(self, chain: JointSpec) -> None:
        """A slide does not turn."""
        if self.waves[list(chain.prismatic), 1:].any():
            raise LabError(f"robot {chain.name}: a slide has no waves; give it zeros")


@dataclass(frozen=True)
class Ripple(VirtualEffect):
    """Gear waves of a virtual arm."""

    ripple_mrad: float = 0.0
    """A wave of each joint's gear, as often a turn as the robot's gear ratios say, else 3 to 60 times."""

    draws: ClassVar[int] = 1

    def simulated(self, arm: ArmFacts, rngs: Sequence[np.random.Generator]) -> SimulatedEffect | None:
        """The same amplitude for every hinge; phases are drawn, and orders where no gear ratio names them."""
        size = arm.chain.size
        order = rngs[0].integers(_ORDERS[0], _ORDERS[1] + 1, size)
        if (ratio := arm.chain.gear_ratio) is not None:
            order = np.where(arm.chain.prismatic, order, np.maximum(np.round(np.abs(ratio)), 1)).astype(np.int_)
        phase = rngs[0].uniform(0.0, 2 * np.pi, size)
        amplitude = self.ripple_mrad / 1e3 * ~np.array(arm.chain.prismatic)
        waves = np.stack([order, amplitude * np.cos(phase), amplitude * np.sin(phase)], axis=1)
        return GearWaves(waves * (amplitude > 0)[:, None])
