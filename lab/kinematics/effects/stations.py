"""Stations of an instrument: it measures some poses from one place, and others from another, each in its own frame.

The frame of the first station is that in which the arm's base is. A session is the same, but for its size: it begins
where the frame was moved by a little (``sessions``), a station stands anywhere.
"""

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np

from lab.core import se3
from lab.core.measurements import STATION
from lab.core.se3 import Array
from lab.kinematics.effects.conditions import PoseConditions
from lab.kinematics.effects.effect import AXES, Effect, MovesTracker, SimulatedEffect
from lab.kinematics.effects.sessions import frame_each
from lab.kinematics.parameter import Parameter, placed_parameters

__all__ = ["GROUP", "StationPoses", "at_first_station", "further_stations", "station_parameters", "stations"]

GROUP = "stations"  # of the parameters
_OWNER = "station."


def stations(names: Sequence[str]) -> tuple[Effect, ...]:
    """Where every station but the first stands, in the first one's frame: its head's position, its rotation vector.

    None where there is one station alone. Nothing is known of them beforehand: they are placed like the base
    (``initial_guess``).
    """
    placed = [placed_parameters(_OWNER + name, GROUP, AXES) for name in names[1:]]
    parameters = tuple(itertools.chain.from_iterable(placed))
    conditions = tuple(STATION + name for name in names[1:])
    return (Effect(GROUP, parameters, frame_each(-1.0), conditions, "station"),) if parameters else ()


def further_stations(parameters: Sequence[Parameter]) -> dict[str, tuple[int, ...]]:
    """The conditions that say which rows are of each station but the first, and where its six parameters stand."""
    found: dict[str, list[int]] = {}
    for i, parameter in enumerate(parameters):
        if parameter.group == GROUP:
            found.setdefault(STATION + parameter.owner.removeprefix(_OWNER), []).append(i)
    return {condition: tuple(indices) for condition, indices in found.items()}


def at_first_station(conditions: Sequence[str], inputs: Array) -> Array:
    """Settings ``(n, joints + conditions)`` as if the first station measured all of them."""
    first = inputs.shape[1] - len(conditions)
    columns = [first + i for i, name in enumerate(conditions) if name.startswith(STATION)]
    if not columns:
        return inputs
    there = inputs.copy()
    there[:, columns] = 0.0
    return there


def station_parameters(Ts_world_station: Array) -> Array:
    """The parameters ``(s - 1, 6)`` of all stations but the first, from the poses ``(s, 4, 4)`` (m) of all."""
    Ts = se3.inverse(Ts_world_station[0]) @ Ts_world_station[1:]
    return np.concatenate([Ts[:, :3, 3], se3.log(Ts[:, :3, :3])], axis=1)


@dataclass(frozen=True)
class StationPoses(SimulatedEffect, MovesTracker):
    """Where a virtual instrument stands when it is not at its first station.

    Attributes:
        Ts_first_station: poses ``(4, 4)`` (m) of the other stations in the first one's frame, by name.
    """

    Ts_first_station: Mapping[str, Array]

    @classmethod
    def none(cls, joints: int) -> Self:
        """One station alone."""
        return cls({})

    def conditions(self, joint_names: tuple[str, ...]) -> tuple[str, ...]:
        """Which poses are measured from each of them."""
        return tuple(STATION + name for name in self.Ts_first_station)

    def true_parameters(self) -> dict[str, float]:
        """Their places."""
        truth: dict[str, float] = {}
        for name, T in self.Ts_first_station.items():
            numbers = [*T[:3, 3].tolist(), *se3.log(T[:3, :3]).tolist()]
            truth |= {f"{_OWNER}{name}.{axis}": number for axis, number in zip(AXES, numbers, strict=True)}
        return truth

    def seen_after(self, points: Array, conditions: PoseConditions) -> Array:
        """In the frame of the station from which each pose is measured."""
        for name, T in self.Ts_first_station.items():
            here = conditions.column(STATION + name) > 0
            points = np.where(here[:, None, None], se3.transform(se3.inverse(T), points), points)
        return points
