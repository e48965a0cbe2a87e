"""Sessions and stations of a campaign: bumps of the frame, several stations, duration and payloads.

A station is a place of the instrument, with its own frame; the first one's is the frame of the arm's base. A session
begins after a small motion of the frame (``sessions``).
"""

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import ClassVar, Self

import numpy as np

from lab.core import se3
from lab.core.errors import LabError, option_name
from lab.core.limits import positive
from lab.core.measurements import SESSION, STATION
from lab.core.se3 import Array
from lab.core.units import MM, MRAD
from lab.kinematics.effects.effect import (
    AXES,
    BUMPED,
    ArmFacts,
    Effect,
    FittedGroup,
    MovesTracker,
    Offsets,
    PoseConditions,
    SimulatedEffect,
    TrackerMotion,
    VirtualEffect,
)
from lab.kinematics.parameter import Parameter, placed_parameters

__all__ = [
    "GROUP",
    "Bump",
    "Duration",
    "Payloads",
    "StationPoses",
    "at_first_station",
    "further_stations",
    "station_parameters",
    "stations",
]


def _sessions(names: Sequence[str]) -> Effect:
    """Return the fitted group: motions of the frame in every session but the first."""
    moved = [placed_parameters(f"session.{name}", "sessions", AXES, scaled=True) for name in names[1:]]
    parameters = tuple(itertools.chain.from_iterable(moved))
    return Effect("sessions", parameters, _frame_each(1.0), tuple(SESSION + name for name in names[1:]), "frame")


def _frame_each(sign: float) -> Offsets:
    """Return ``offsets`` of a frame, six parameters for each condition; ``sign`` is -1 for motions of the frame, 1 of
    points.
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
        raise LabError(f"{option_name('model')} sessions: all rows are of one session; add a column session")
    return _sessions(arm.sessions.sessions)


@dataclass(frozen=True)
class _TrackerBump(TrackerMotion):
    """Tracker bump of one campaign: the motion happens at once in its middle."""

    condition: ClassVar[str] = BUMPED

    def true_parameters(self) -> dict[str, float]:
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
        """Draw both directions."""
        return _TrackerBump.random(MM.to_si(self.bump_mm), MRAD.to_si(self.bump_mrad), rngs)


GROUP = "stations"  # of the parameters
_OWNER = "station."


def stations(names: Sequence[str]) -> tuple[Effect, ...]:
    """Return the group of the poses of all stations but the first, in the first one's frame; none for one station.

    They have no initial values, like the base (``initial_guess``).
    """
    return (_stations(tuple(names)),) if len(names) > 1 else ()


def _stations(names: tuple[str, ...]) -> Effect:
    placed = [placed_parameters(_OWNER + name, GROUP, AXES) for name in names[1:]]
    parameters = tuple(itertools.chain.from_iterable(placed))
    conditions = tuple(STATION + name for name in names[1:])
    again = partial(_stations, names)
    return Effect(GROUP, parameters, _frame_each(-1.0), conditions, "station", made_by=again)


def further_stations(parameters: Sequence[Parameter]) -> dict[str, tuple[int, ...]]:
    """Return indices of the six parameters of each station but the first, by the condition of its rows."""
    found: dict[str, list[int]] = {}
    for i, parameter in enumerate(parameters):
        if parameter.group == GROUP:
            found.setdefault(STATION + parameter.owner.removeprefix(_OWNER), []).append(i)
    return {condition: tuple(indices) for condition, indices in found.items()}


def at_first_station(conditions: Sequence[str], inputs: Array) -> Array:
    """Return inputs ``(n, joints + conditions)`` with all rows at the first station."""
    first = inputs.shape[1] - len(conditions)
    columns = [first + i for i, name in enumerate(conditions) if name.startswith(STATION)]
    if not columns:
        return inputs
    there = inputs.copy()
    there[:, columns] = 0.0
    return there


def station_parameters(Ts_world_station: Array) -> Array:
    """Return the parameters ``(s - 1, 6)`` of all stations but the first, from the poses ``(s, 4, 4)`` (m) of all."""
    Ts = se3.inverse(Ts_world_station[0]) @ Ts_world_station[1:]
    return np.concatenate([Ts[:, :3, 3], se3.log(Ts[:, :3, :3])], axis=1)


@dataclass(frozen=True)
class StationPoses(SimulatedEffect, MovesTracker):
    """Poses of a virtual instrument's further stations.

    Attributes:
        Ts_first_station: poses ``(4, 4)`` (m) of the other stations in the first one's frame, by name.
    """

    Ts_first_station: Mapping[str, Array]

    @classmethod
    def none(cls, joints: int) -> Self:
        """Return a single station."""
        return cls({})

    def conditions(self, joint_names: tuple[str, ...]) -> tuple[str, ...]:
        """Return the conditions that flag the poses measured from each further station."""
        return tuple(STATION + name for name in self.Ts_first_station)

    def true_parameters(self) -> dict[str, float]:
        """Return the stations' poses."""
        truth: dict[str, float] = {}
        for name, T in self.Ts_first_station.items():
            numbers = [*T[:3, 3].tolist(), *se3.log(T[:3, :3]).tolist()]
            truth |= {f"{_OWNER}{name}.{axis}": number for axis, number in zip(AXES, numbers, strict=True)}
        return truth

    def seen_after(self, points: Array, conditions: PoseConditions) -> Array:
        """Return the points in the frame of the station from which each pose is measured."""
        for name, T in self.Ts_first_station.items():
            here = conditions.column(STATION + name) > 0
            points = np.where(here[:, None, None], se3.transform(se3.inverse(T), points), points)
        return points


@dataclass(frozen=True)
class Payloads(VirtualEffect):
    """Payloads at the flange."""

    payload_kg: tuple[float, ...] = (0.0,)
    """Payloads at the flange, one of which each pose has."""

    def check(self) -> None:
        """Refuse an empty list."""
        if not self.payload_kg:
            raise LabError(f"{option_name('payload_kg')}: give at least one payload, e.g. 0,3")

    def simulated(self, arm: ArmFacts, rngs: Sequence[np.random.Generator]) -> SimulatedEffect | None:
        """Return no effect."""
        return None


@dataclass(frozen=True)
class Duration(VirtualEffect):
    """Duration of the poses."""

    hours: float | None = None
    """How long the campaign takes: an hour, if drift or growth need to know."""

    def check(self) -> None:
        """Refuse a duration that is not above zero."""
        if self.hours is not None:
            positive(option_name("hours"), self.hours)

    def simulated(self, arm: ArmFacts, rngs: Sequence[np.random.Generator]) -> SimulatedEffect | None:
        """Return no effect."""
        return None
