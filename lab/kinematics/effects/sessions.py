"""A tracker, or a foot, that was bumped: every session after the first has a frame moved by a little."""

import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from lab.core.errors import LabError
from lab.core.measurements import SESSION
from lab.core.se3 import Array
from lab.kinematics.effects.conditions import BUMPED
from lab.kinematics.effects.effect import (
    AXES,
    ArmFacts,
    Effect,
    FittedGroup,
    Offsets,
    SimulatedEffect,
    TrackerMotion,
    VirtualEffect,
)
from lab.kinematics.parameter import placed_parameters

__all__ = ["Bump", "TrackerBump", "frame_each", "sessions"]


def sessions(names: Sequence[str]) -> Effect:
    """The fitted group: how the frame of every session but the first is moved and turned."""
    moved = [placed_parameters(f"session.{name}", "sessions", AXES, scaled=True) for name in names[1:]]
    parameters = tuple(itertools.chain.from_iterable(moved))
    return Effect("sessions", parameters, frame_each(1.0), tuple(SESSION + name for name in names[1:]), "frame")


def frame_each(sign: float) -> Offsets:
    """What moves the frame of each setup but the first, by six parameters of its own.

    Args:
        sign: 1 where they are how the points move, -1 where they are how the frame moves.

    Returns:
        The ``offsets`` of an effect whose conditions are one for each of these setups: 1 of its rows, else 0.
    """

    def offsets(_: Array, within: Array, values: Array) -> tuple[Array, Array]:
        count = within.shape[1]
        derivative = np.zeros((len(within), 7, 6 * count))
        for k in range(count):
            derivative[:, :6, 6 * k : 6 * k + 6] = sign * within[:, k, None, None] * np.eye(6)
        return derivative @ values, derivative

    return offsets


def _fitted(arm: ArmFacts) -> Effect:
    if len(arm.sessions.sessions) < 2:
        raise LabError("--model sessions: all rows are of one session; say in a column session which belong together")
    return sessions(arm.sessions.sessions)


@dataclass(frozen=True)
class TrackerBump(TrackerMotion):
    """Of one campaign: the motion is that of all at once in its middle."""

    condition: ClassVar[str] = BUMPED

    def true_parameters(self) -> dict[str, float]:
        """The tracker's motion reversed."""
        return {f"session.2.{axis}": float(value) for axis, value in zip(AXES, -self.motion, strict=True)}


@dataclass(frozen=True)
class Bump(VirtualEffect):
    """A bump of a virtual arm's tracker."""

    bump_mm: float = 0.0
    """How far the tracker is moved in the middle of the campaign: what follows is session 2."""
    bump_mrad: float = 0.0
    """How far the tracker is turned in the middle of the campaign."""

    draws: ClassVar[int] = 2
    groups: ClassVar[tuple[FittedGroup, ...]] = (
        FittedGroup(
            "sessions", _fitted, "a frame that was bumped between the sessions of the file", of_one_campaign=True
        ),
    )

    def simulated(self, arm: ArmFacts, rngs: Sequence[np.random.Generator]) -> SimulatedEffect | None:
        """Both directions are drawn."""
        return TrackerBump.random(self.bump_mm / 1e3, self.bump_mrad / 1e3, rngs)
