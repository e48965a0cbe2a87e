"""Poses whose reading is bad: all of its points are displaced alike."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray

from lab.core.errors import LabError
from lab.core.se3 import Array
from lab.kinematics.effects.effect import ArmFacts, DisplacesReadings, SimulatedEffect, VirtualEffect

__all__ = ["BadReadings", "Displaced"]


@dataclass(frozen=True)
class Displaced(SimulatedEffect, DisplacesReadings):
    """Of one campaign.

    Attributes:
        bad_share: how likely a pose's reading is bad.
        bad_range_m: least and largest displacement of a bad reading; log-uniform between, in any direction.
    """

    bad_share: float
    bad_range_m: tuple[float, float]

    def __post_init__(self) -> None:
        if not 0 <= self.bad_share <= 1:
            raise LabError("effects: bad_share is to be in [0, 1]")
        if not 0 < self.bad_range_m[0] <= self.bad_range_m[1] < np.inf:
            raise LabError(f"effects: bad_range_m {self.bad_range_m} is to be a least and a largest length above zero")

    @classmethod
    def none(cls, joints: int) -> Self:
        """Good readings."""
        return cls(0.0, (1e-3, 1e-3))

    @property
    def is_on(self) -> bool:
        """Whether any reading may be bad."""
        return self.bad_share > 0

    def displacements(self, poses: int, rng: np.random.Generator) -> tuple[Array, NDArray[np.bool_]]:
        """Four draws a pose: whether it is bad, how far it is displaced, and where."""
        chance, size, height, turn = rng.random((poses, 4)).T
        bad = chance < self.bad_share
        least, largest = np.log(self.bad_range_m)
        z, radius = 2 * height - 1, 2 * np.sqrt(height * (1 - height))
        direction = np.stack([radius * np.cos(2 * np.pi * turn), radius * np.sin(2 * np.pi * turn), z], axis=1)
        return (bad * np.exp(least + (largest - least) * size))[:, None] * direction, bad


@dataclass(frozen=True)
class BadReadings(VirtualEffect):
    """Bad readings of a virtual arm."""

    bad_share: float = 0.0
    """Share of the poses whose reading is bad."""
    bad_mm: tuple[float, ...] = (1.0, 50.0)
    """Least and largest displacement of a bad reading."""

    def check(self) -> None:
        """Refuse a share above one, and sizes that are none or without a share.

        Raises:
            LabError: with the option.
        """
        if not self.bad_share <= 1:
            raise LabError(f"--bad-share {self.bad_share:g}: give a share from 0 to 1")
        if len(self.bad_mm) != 2 or not 0 < self.bad_mm[0] <= self.bad_mm[1]:
            raise LabError("--bad-mm: give the least and the largest displacement, e.g. 1,50")
        if self.bad_mm != BadReadings.bad_mm and not self.bad_share:
            raise LabError("--bad-mm says how large bad readings are; give --bad-share too")

    def simulated(self, arm: ArmFacts, rngs: Sequence[np.random.Generator]) -> SimulatedEffect | None:
        """As it is given; each campaign draws which are bad."""
        return Displaced(self.bad_share, (self.bad_mm[0] / 1e3, self.bad_mm[1] / 1e3))
