"""What a campaign on a virtual arm sets beside the joints: its payloads, and how long it takes."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from lab.core.errors import LabError
from lab.core.numbers import positive
from lab.kinematics.effects.effect import ArmFacts, SimulatedEffect, VirtualEffect

__all__ = ["Duration", "Payloads"]


@dataclass(frozen=True)
class Payloads(VirtualEffect):
    """What hangs at the flange."""

    payload_kg: tuple[float, ...] = (0.0,)
    """Payloads at the flange, one of which each pose has."""

    def check(self) -> None:
        """Refuse no payload at all.

        Raises:
            LabError: with the option.
        """
        if not self.payload_kg:
            raise LabError("--payload-kg: give at least one payload, e.g. 0,3")

    def simulated(self, arm: ArmFacts, rngs: Sequence[np.random.Generator]) -> SimulatedEffect | None:
        """No effect by itself."""
        return None


@dataclass(frozen=True)
class Duration(VirtualEffect):
    """How long the poses take."""

    hours: float | None = None
    """How long the campaign takes: an hour, if drift or growth need to know."""

    def check(self) -> None:
        """Refuse a time that is none."""
        if self.hours is not None:
            positive("--hours", self.hours)

    def simulated(self, arm: ArmFacts, rngs: Sequence[np.random.Generator]) -> SimulatedEffect | None:
        """No effect by itself."""
        return None
