"""Joint positions in whole counts of the encoders that a robot's table names."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np

from lab.core.se3 import Array
from lab.kinematics.effects.effect import ArmFacts, ChangesJointPositions, SimulatedEffect, VirtualEffect
from lab.kinematics.encoders import Encoders

__all__ = ["EncoderCounts", "EncoderRounding"]


@dataclass(frozen=True)
class EncoderCounts(SimulatedEffect, ChangesJointPositions):
    """Of one arm.

    Attributes:
        encoders: those of its table; None for ideal ones.
    """

    encoders: Encoders | None

    @classmethod
    def none(cls, joints: int) -> Self:
        """Ideal encoders."""
        return cls(None)

    def shown(self, joints: Array) -> Array:
        """In whole counts."""
        return joints if self.encoders is None else self.encoders.rounded(joints)


@dataclass(frozen=True)
class EncoderRounding(VirtualEffect):
    """Encoders of a virtual arm: a robot's table says them, no option."""

    def simulated(self, arm: ArmFacts, rngs: Sequence[np.random.Generator]) -> SimulatedEffect | None:
        """As the table has them."""
        return None if arm.chain.encoders is None else EncoderCounts(arm.chain.encoders)
