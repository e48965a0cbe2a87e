"""Planes that a virtual arm touches with a point of its tool."""

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from lab.core.instruments import Instrument
from lab.core.se3 import Array
from lab.simulation.observations.contact import (
    Chance,
    Contacts,
    fixture_measurements,
    reachable_points,
    without_sessions,
)
from lab.simulation.observations.protocol import Setup, SimulatedDay, refuse_several_targets
from lab.simulation.true_robot import TrueRobot

__all__ = ["observe_planes"]


def observe_planes(
    real: TrueRobot,
    joints: Array,
    targets: tuple[str, ...],
    instrument: Instrument,
    rng: np.random.Generator,
    readings: int,
    conditions: Mapping[str, Array],
    setup: Setup,
) -> SimulatedDay:
    """Touches of one plane after the other, in as many poses as ``joints`` ``(n, joints)``, which are new ones."""
    refuse_several_targets("plane", targets)
    chance, placing = Chance.of(real, instrument, (len(joints), 1), rng, readings), rng.spawn(1)[0]
    set_there = without_sessions(conditions)
    on, near = reachable_points(real, setup.fixtures, placing)
    normals = placing.standard_normal(on.shape)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    heights, number = (normals * on).sum(axis=1), np.arange(len(joints)) % len(on)

    def gap(points: Array, rows: NDArray[np.int_]) -> Array:
        plane = number[rows]
        along = (normals[plane] * (points - chance.displaced[rows])).sum(axis=1)
        return np.asarray(along - heights[plane] - chance.noise[rows, 0])[:, None]

    touching = Contacts(real, set_there, chance.scatter, gap, near[number]).joints(placing)
    locations = tuple(str(1 + i) for i in number.tolist())
    data = fixture_measurements(real, touching, set_there, {"location": locations})
    placed = {
        f"plane.{1 + i}": np.append(normal, z) for i, (normal, z) in enumerate(zip(normals, heights, strict=True))
    }
    return SimulatedDay(data, chance.bad, placed)
