"""Links that bend under the moment of what they carry; ``simulation.elastic`` finds how the arm settles."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np

from lab.core.errors import LabError
from lab.core.se3 import Array
from lab.kinematics.effects.conditions import PAYLOAD
from lab.kinematics.effects.effect import ArmFacts, SimulatedEffect, VirtualEffect, refuse_negative
from lab.kinematics.joints import JointSpec

__all__ = ["Bending", "LinkBending"]


@dataclass(frozen=True)
class LinkBending(SimulatedEffect):
    """Of one arm.

    Attributes:
        bending_rad_per_nm: ``(n,)``; the link that carries jointed body i (the stand of the arm for i = 0) bends
            at that body's origin, by this times the moment there of the weight of all that is carried. Zero for a
            slide.
    """

    bending_rad_per_nm: Array

    def __post_init__(self) -> None:
        refuse_negative("bending_rad_per_nm", self.bending_rad_per_nm)

    @classmethod
    def none(cls, joints: int) -> Self:
        """Stiff links."""
        return cls(np.zeros(joints))

    def conditions(self, joint_names: tuple[str, ...]) -> tuple[str, ...]:
        """The payload."""
        return (PAYLOAD,) if self.bending_rad_per_nm.any() else ()

    def true_parameters(self) -> dict[str, float]:
        """About a joint's axis its carrier's bending is like its own compliance, to first order."""
        return {f"joint{i + 1}.compliance": float(value) for i, value in enumerate(self.bending_rad_per_nm)}

    def refuse_unfit(self, chain: JointSpec) -> None:
        """What carries a slide is stiff.

        Raises:
            LabError: a slide is to bend.
        """
        if self.bending_rad_per_nm[list(chain.prismatic)].any():
            raise LabError(f"robot {chain.name}: a slide has no bending_rad_per_nm; give it zeros")


@dataclass(frozen=True)
class Bending(VirtualEffect):
    """Bending links of a virtual arm."""

    bending_mrad_per_knm: float = 0.0
    """How far each link bends under the moment of what it carries."""

    def simulated(self, arm: ArmFacts, rngs: Sequence[np.random.Generator]) -> SimulatedEffect | None:
        """Alike for what carries each hinge."""
        return LinkBending((self.bending_mrad_per_knm / 1e6) * ~np.array(arm.chain.prismatic))
