"""A tracker that creeps, a base that yields, or a frame that grows: what is measured moves steadily.

In proportion to the time from a start where a file has ``time_s``, else to a row's place in the file.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from lab.core.measurements import PLACE
from lab.core.se3 import Array
from lab.kinematics.effects.conditions import HOUR_S, TIME
from lab.kinematics.effects.effect import (
    AXES,
    ArmFacts,
    Effect,
    FittedGroup,
    SimulatedEffect,
    TrackerMotion,
    VirtualEffect,
)
from lab.kinematics.parameter import placed_parameters

__all__ = ["Drift", "TrackerDrift", "drift", "drift_by_row"]


def drift(start_s: float = 0.0) -> Effect:
    """The fitted group: how far what is measured is shifted, turned and stretched in an hour."""
    parameters = placed_parameters("drift", "drift", (*AXES, "scale"), rate=True, scaled=True)

    def offsets(_: Array, time_s: Array, values: Array) -> tuple[Array, Array]:
        hours = (time_s - start_s) / HOUR_S  # (n, 1)
        return hours * values, hours[:, :, None] * np.eye(7)

    return Effect("drift", parameters, offsets, (TIME,), "frame")


def drift_by_row() -> Effect:
    """The fitted group where nobody wrote down the time: how far what is measured moves from first row to last."""
    parameters = placed_parameters("drift", "drift", (*AXES, "scale"), scaled=True)

    def offsets(_: Array, place: Array, values: Array) -> tuple[Array, Array]:
        return place * values, place[:, :, None] * np.eye(7)

    return Effect("drift", parameters, offsets, (PLACE,), "frame")


def _fitted(arm: ArmFacts) -> Effect:
    return drift(arm.sessions.start_s) if arm.sessions.timed else drift_by_row()


@dataclass(frozen=True)
class TrackerDrift(TrackerMotion):
    """Of one campaign: the motion is that of an hour, steady."""

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
        return TrackerDrift.random(self.drift_mm_per_h / 1e3, self.drift_mrad_per_h / 1e3, rngs)
