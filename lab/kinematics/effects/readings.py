"""Simulated scatter of readings: repeatability, encoder rounding, correlated noise, outliers."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray

from lab.core.errors import LabError, option_name
from lab.core.se3 import Array
from lab.core.units import MM, MRAD
from lab.kinematics.effects.effect import (
    ArmFacts,
    ChangesJointPositions,
    DisplacesReadings,
    OnePerJoint,
    ScattersJoints,
    ShapesNoise,
    SimulatedEffect,
    VirtualEffect,
    levers,
    refuse_negative,
)
from lab.kinematics.joints import Encoders

__all__ = [
    "BadReadings",
    "DisplacedReadings",
    "EncoderCounts",
    "EncoderRounding",
    "InstrumentNoise",
    "Repeatability",
    "ShapedNoise",
    "VisitScatter",
]


@dataclass(frozen=True)
class VisitScatter(OnePerJoint, ScattersJoints):
    """Repeatability of one arm's joints.

    Attributes:
        repeatability_rad: ``(n,)`` standard deviation of a joint's position between visits, m of a slide.
    """

    repeatability_rad: Array

    def __post_init__(self) -> None:
        refuse_negative("repeatability_rad", self.repeatability_rad)

    @property
    def is_on(self) -> bool:
        """True if any joint scatters."""
        return bool(self.repeatability_rad.any())

    def scatter(self, poses: int, rng: np.random.Generator) -> Array:
        """Draw normal scatter."""
        return np.asarray(self.repeatability_rad * rng.standard_normal((poses, len(self.repeatability_rad))))


@dataclass(frozen=True)
class Repeatability(VirtualEffect):
    """Repeatability of a virtual arm."""

    repeatability_mrad: float = 0.0
    """Scatter of a joint's position between visits (1σ)."""

    def simulated(self, arm: ArmFacts, rngs: Sequence[np.random.Generator]) -> SimulatedEffect | None:
        """Return equal scatter of all joints."""
        return VisitScatter(levers(arm.chain) * MRAD.to_si(self.repeatability_mrad))


@dataclass(frozen=True)
class EncoderCounts(SimulatedEffect, ChangesJointPositions):
    """Encoder resolution of one arm; None for ideal encoders."""

    encoders: Encoders | None

    @classmethod
    def none(cls, joints: int) -> Self:
        """Return ideal encoders."""
        return cls(None)

    def shown(self, joints: Array) -> Array:
        """Return the joint positions rounded to whole counts."""
        return joints if self.encoders is None else self.encoders.rounded(joints)


@dataclass(frozen=True)
class EncoderRounding(VirtualEffect):
    """Encoders of a virtual arm, from the robot's table, without an option."""

    def simulated(self, arm: ArmFacts, rngs: Sequence[np.random.Generator]) -> SimulatedEffect | None:
        """Return the encoders of the nominal model."""
        return None if arm.chain.encoders is None else EncoderCounts(arm.chain.encoders)


_LEAST_DOF = 2.0  # Student's t has a variance above


@dataclass(frozen=True)
class ShapedNoise(SimulatedEffect, ShapesNoise):
    """Noise distribution of one instrument, with its variance unchanged.

    Attributes:
        correlation: of each number's noise from one pose to the next, AR(1).
        tail_dof: degrees of freedom of Student's t; infinite for normal tails.
        moved_m: step of the base or the tracker in each set of measurements; the mean is unchanged.
        moved_after: number of poses before the step; 0 for half of them.
    """

    correlation: float
    tail_dof: float
    moved_m: float = 0.0
    moved_after: int = 0

    def __post_init__(self) -> None:
        if not 0 <= self.correlation < 1:
            raise LabError("effects: the noise's correlation is to be in [0, 1)")
        if not self.tail_dof > _LEAST_DOF:
            raise LabError("effects: tail_dof is to be above 2: below, Student's t has no variance")

    @classmethod
    def none(cls, joints: int) -> Self:
        """Return independent normal noise."""
        return cls(0.0, np.inf)

    @property
    def is_on(self) -> bool:
        """True if it changes the noise."""
        return self.correlation > 0 or bool(np.isfinite(self.tail_dof)) or self.is_of_a_tracker

    @property
    def is_of_a_tracker(self) -> bool:
        """True if it moves the tracker, which some kinds of measurement do not have."""
        return self.moved_m > 0

    def shaped(self, noise: Array, rng: np.random.Generator) -> Array:
        """Return noise ``(poses, k, 3)`` m with tails, autocorrelation and a step."""
        return self._carried(noise, rng) + self._moved(len(noise), rng)

    def _carried(self, noise: Array, rng: np.random.Generator) -> Array:
        if np.isfinite(self.tail_dof):
            noise = noise * np.sqrt((self.tail_dof - 2) / rng.chisquare(self.tail_dof, noise.shape))
        if not self.correlation:
            return noise
        carried, fresh = noise.copy(), np.sqrt(1 - self.correlation**2)
        for i in range(1, len(noise)):
            carried[i] = self.correlation * carried[i - 1] + fresh * noise[i]
        return carried

    def _moved(self, poses: int, rng: np.random.Generator) -> Array:
        if not self.moved_m:
            return np.zeros((1, 1, 1))
        after = np.arange(poses) >= (self.moved_after or poses / 2)
        direction = rng.standard_normal(3)
        return np.asarray(self.moved_m * (after - after.mean())[:, None, None] * direction / np.linalg.norm(direction))


@dataclass(frozen=True)
class InstrumentNoise(VirtualEffect):
    """Noise of a virtual instrument."""

    noise_correlation: float = 0.0
    """Correlation of the instrument's noise from one pose to the next."""
    noise_tail_dof: float = 0.0
    """Give the noise the heavy tails of Student's t with so many degrees of freedom, above 2; 0 for none."""
    step_mm: float = 0.0
    """How far the base or the tracker moves at once, unnoticed; the mean over the poses stays where it is."""
    step_after: int = 0
    """Poses that are measured before that; 0 for half of them."""

    def check(self) -> None:
        """Refuse a correlation of one, tails without a variance, and the time of a step without a size."""
        if not self.noise_correlation < 1:
            raise LabError(
                f"{option_name('noise_correlation')} {self.noise_correlation:g}: give a correlation from 0 to below 1"
            )
        if self.noise_tail_dof and not self.noise_tail_dof > _LEAST_DOF:
            raise LabError(
                f"{option_name('noise_tail_dof')} {self.noise_tail_dof:g}: give more than 2 degrees of freedom, e.g. 3"
            )
        if self.step_after and not self.step_mm:
            raise LabError(
                f"{option_name('step_after')} {self.step_after}: give {option_name('step_mm')}, too: how far "
                f"the base moves there"
            )

    def simulated(self, arm: ArmFacts, rngs: Sequence[np.random.Generator]) -> SimulatedEffect | None:
        """Return the noise distribution as given."""
        step_m, dof = MM.to_si(self.step_mm), self.noise_tail_dof or np.inf
        return ShapedNoise(self.noise_correlation, dof, step_m, self.step_after)


@dataclass(frozen=True)
class DisplacedReadings(SimulatedEffect, DisplacesReadings):
    """Outliers of one campaign.

    Attributes:
        bad_share: probability of an outlier.
        bad_range_m: least and largest displacement of an outlier; log-uniform between, in any direction.
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
        """Return no outliers."""
        return cls(0.0, (1e-3, 1e-3))

    @property
    def is_on(self) -> bool:
        """True if outliers can occur."""
        return self.bad_share > 0

    def displacements(self, poses: int, rng: np.random.Generator) -> tuple[Array, NDArray[np.bool_]]:
        """Draw four numbers a pose: for the outlier, its size and its direction."""
        chance, size, height, turn = rng.random((poses, 4)).T
        bad = chance < self.bad_share
        least, largest = np.log(self.bad_range_m)
        z, radius = 2 * height - 1, 2 * np.sqrt(height * (1 - height))
        direction = np.stack([radius * np.cos(2 * np.pi * turn), radius * np.sin(2 * np.pi * turn), z], axis=1)
        return (bad * np.exp(least + (largest - least) * size))[:, None] * direction, bad


@dataclass(frozen=True)
class BadReadings(VirtualEffect):
    """Outliers of a virtual arm."""

    bad_share: float = 0.0
    """Share of the poses whose reading is bad."""
    bad_mm: tuple[float, ...] = (1.0, 50.0)
    """Least and largest displacement of a bad reading."""

    def check(self) -> None:
        """Refuse a share above one, and sizes that are not valid or without a share."""
        if not self.bad_share <= 1:
            raise LabError(f"{option_name('bad_share')} {self.bad_share:g}: give a share from 0 to 1")
        if len(self.bad_mm) != 2 or not 0 < self.bad_mm[0] <= self.bad_mm[1]:
            raise LabError(f"{option_name('bad_mm')}: give the least and the largest displacement, e.g. 1,50")
        if self.bad_mm != BadReadings.bad_mm and not self.bad_share:
            raise LabError(f"{option_name('bad_mm')} is the size of outliers; give {option_name('bad_share')} too")

    def simulated(self, arm: ArmFacts, rngs: Sequence[np.random.Generator]) -> SimulatedEffect | None:
        """Return the outliers' share and range as given; each campaign draws its outliers."""
        return DisplacedReadings(self.bad_share, (MM.to_si(self.bad_mm[0]), MM.to_si(self.bad_mm[1])))
