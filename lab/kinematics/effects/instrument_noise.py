"""Noise of the instrument that is not what its data sheet says: correlated from pose to pose, or with heavy tails."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np

from lab.core.errors import LabError
from lab.core.se3 import Array
from lab.kinematics.effects.effect import ArmFacts, ShapesNoise, SimulatedEffect, VirtualEffect

__all__ = ["InstrumentNoise", "ShapedNoise"]

_LEAST_DOF = 2.0  # of Student's t: there its variance ends


@dataclass(frozen=True)
class ShapedNoise(SimulatedEffect, ShapesNoise):
    """Of one instrument, whose variance it leaves as it is.

    Attributes:
        correlation: of each number's noise from one pose to the next: an autoregressive process of the first order.
        tail_dof: degrees of freedom of Student's t, which the noise is stretched to by chance; infinite for none.
    """

    correlation: float
    tail_dof: float

    def __post_init__(self) -> None:
        if not 0 <= self.correlation < 1:
            raise LabError("effects: the noise's correlation is to be in [0, 1)")
        if not self.tail_dof > _LEAST_DOF:
            raise LabError("effects: tail_dof is to be above 2: below, Student's t has no variance")

    @classmethod
    def none(cls, joints: int) -> Self:
        """Noise that is independent, and as the instrument has it."""
        return cls(0.0, np.inf)

    @property
    def is_on(self) -> bool:
        """Whether it changes the noise."""
        return self.correlation > 0 or bool(np.isfinite(self.tail_dof))

    def shaped(self, noise: Array, rng: np.random.Generator) -> Array:
        """Independent noise ``(poses, k, 3)`` m, stretched number by number, then carried on from pose to pose."""
        if np.isfinite(self.tail_dof):
            noise = noise * np.sqrt((self.tail_dof - 2) / rng.chisquare(self.tail_dof, noise.shape))
        if not self.correlation:
            return noise
        carried, fresh = noise.copy(), np.sqrt(1 - self.correlation**2)
        for i in range(1, len(noise)):
            carried[i] = self.correlation * carried[i - 1] + fresh * noise[i]
        return carried


@dataclass(frozen=True)
class InstrumentNoise(VirtualEffect):
    """The noise of a virtual instrument."""

    noise_correlation: float = 0.0
    """Correlation of the instrument's noise from one pose to the next."""
    noise_tail_dof: float = 0.0
    """Give the noise the heavy tails of Student's t with so many degrees of freedom, above 2; 0 for none."""

    def check(self) -> None:
        """Refuse a correlation of one, and tails without a variance."""
        if not self.noise_correlation < 1:
            raise LabError(f"--noise-correlation {self.noise_correlation:g}: give a correlation from 0 to below 1")
        if self.noise_tail_dof and not self.noise_tail_dof > _LEAST_DOF:
            raise LabError(f"--noise-tail-dof {self.noise_tail_dof:g}: give more than 2 degrees of freedom, e.g. 3")

    def simulated(self, arm: ArmFacts, rngs: Sequence[np.random.Generator]) -> SimulatedEffect | None:
        """As it is given."""
        return ShapedNoise(self.noise_correlation, self.noise_tail_dof or np.inf)
