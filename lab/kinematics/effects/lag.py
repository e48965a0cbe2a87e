"""Joint positions that are read before the arm has settled."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np

from lab.core.errors import LabError
from lab.core.se3 import Array
from lab.kinematics.effects.effect import ArmFacts, ChangesJointPositions, SimulatedEffect, VirtualEffect

__all__ = ["Lag", "ReadingLag"]


@dataclass(frozen=True)
class ReadingLag(SimulatedEffect, ChangesJointPositions):
    """Of one arm.

    Attributes:
        lag: share of the last move that a joint position still lacks when it is read, in [0, 1).
    """

    lag: float

    def __post_init__(self) -> None:
        if not 0 <= self.lag < 1:
            raise LabError("effects: lag is to be in [0, 1)")

    @classmethod
    def none(cls, joints: int) -> Self:
        """Joint positions of the settled arm."""
        return cls(0.0)

    def shown(self, joints: Array) -> Array:
        """Behind where they will settle; the first pose is settled."""
        shown: Array = joints - self.lag * np.diff(joints, axis=0, prepend=joints[:1])
        return shown


@dataclass(frozen=True)
class Lag(VirtualEffect):
    """Lag of a virtual arm's joint positions."""

    lag: float = 0.0
    """Share of the last move that the joint positions still lack, from 0 to below 1."""

    def check(self) -> None:
        """Refuse a joint that never moves.

        Raises:
            LabError: with the option.
        """
        if not self.lag < 1:
            raise LabError(f"--lag {self.lag:g}: give a share from 0 to below 1")

    def simulated(self, arm: ArmFacts, rngs: Sequence[np.random.Generator]) -> SimulatedEffect | None:
        """As it is given."""
        return ReadingLag(self.lag)
