"""A tracker that creeps, or a frame that grows: what is measured moves in proportion to the time from a start."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar, Self

import numpy as np

from lab.core.se3 import Array
from lab.kinematics.effects.conditions import HOUR_S, TIME, PoseConditions
from lab.kinematics.effects.effect import (
    AXES,
    ArmFacts,
    Effect,
    FittedGroup,
    MovesTracker,
    SimulatedEffect,
    VirtualEffect,
    in_moved_frame,
    random_direction,
)
from lab.kinematics.parameter import placed_parameters

__all__ = ["Drift", "TrackerDrift", "drift"]


def drift(start_s: float = 0.0) -> Effect:
    """The fitted group: how far what is measured is shifted, turned and stretched in an hour."""
    parameters = placed_parameters("drift", "drift", (*AXES, "scale"), rate=True, scaled=True)

    def offsets(_: Array, time_s: Array, values: Array) -> tuple[Array, Array]:
        hours = (time_s - start_s) / HOUR_S  # (n, 1)
        return hours * values, hours[:, :, None] * np.eye(7)

    return Effect("drift", parameters, offsets, (TIME,), "frame")


@dataclass(frozen=True)
class TrackerDrift(SimulatedEffect, MovesTracker):
    """Of one campaign.

    Attributes:
        drift_per_h: ``(6,)`` motion of the tracker in its own frame in an hour, m and rad, steady.
    """

    drift_per_h: Array

    @classmethod
    def none(cls, joints: int) -> Self:
        """A tracker that stays."""
        return cls(np.zeros(6))

    def conditions(self, joint_names: tuple[str, ...]) -> tuple[str, ...]:
        """The time."""
        return (TIME,) if self.drift_per_h.any() else ()

    def seen_after(self, points: Array, conditions: PoseConditions) -> Array:
        """In the frame of a tracker that moved in proportion to the time."""
        if not self.drift_per_h.any():
            return points
        moved = self.drift_per_h * (conditions.column(TIME) / HOUR_S)[:, None]
        return in_moved_frame(points, moved)

    def true_parameters(self) -> dict[str, float]:
        """The tracker's motion reversed: ``p' = exp(w t) (p + v t)``."""
        rates = {f"drift.{axis}": float(value) for axis, value in zip(AXES, -self.drift_per_h, strict=True)}
        return rates | {"drift.scale": 0.0}


@dataclass(frozen=True)
class Drift(VirtualEffect):
    """Drift of a virtual arm's tracker."""

    drift_mm_per_h: float = 0.0
    """How fast the tracker creeps, in a random direction."""
    drift_mrad_per_h: float = 0.0
    """How fast the tracker turns, about a random axis."""

    draws: ClassVar[int] = 2
    groups: ClassVar[tuple[FittedGroup, ...]] = (
        FittedGroup("drift", lambda arm: drift(arm.sessions.start_s), of_one_campaign=True),
    )

    def simulated(self, arm: ArmFacts, rngs: Sequence[np.random.Generator]) -> SimulatedEffect | None:
        """Both directions are drawn."""
        sizes = self.drift_mm_per_h / 1e3, self.drift_mrad_per_h / 1e3
        return TrackerDrift(
            np.concatenate([size * random_direction(rng) for size, rng in zip(sizes, rngs, strict=True)])
        )
