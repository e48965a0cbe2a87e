"""A ball on a virtual arm that is put into sockets: pairs of them, at some locations."""

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from lab.core.instruments import Instrument
from lab.core.se3 import Array, inverse
from lab.simulation.observations.contact import (
    Chance,
    Contacts,
    fixture_measurements,
    reachable_points,
    without_sessions,
)
from lab.simulation.observations.protocol import Setup, SimulatedDay, refuse_several_targets
from lab.simulation.true_robot import TrueRobot

__all__ = ["observe_sockets"]

_APART_M = 0.1  # of a location's two sockets, where nobody knows it
_NAMES = ("a", "b")


def observe_sockets(
    real: TrueRobot,
    joints: Array,
    targets: tuple[str, ...],
    instrument: Instrument,
    rng: np.random.Generator,
    readings: int,
    conditions: Mapping[str, Array],
    setup: Setup,
) -> SimulatedDay:
    """The ball in one socket after the other, in as many poses as ``joints`` ``(n, joints)``, which are new ones."""
    refuse_several_targets("socket", targets)
    chance, placing = Chance.of(real, instrument, (len(joints), 3), rng, readings), rng.spawn(1)[0]
    set_there = without_sessions(conditions)
    apart_m = _APART_M if setup.socket_distance_m is None else setup.socket_distance_m
    first, near = reachable_points(real, setup.fixtures, placing)
    second = first + apart_m * _around(real, first) * placing.choice([-1.0, 1.0], (len(first), 1))
    centres = np.stack([first, second], axis=1).reshape(-1, 3)
    number = np.arange(len(joints)) % len(centres)

    def gap(points: Array, rows: NDArray[np.int_]) -> Array:
        return np.asarray(points - centres[number[rows]] - chance.noise[rows] - chance.displaced[rows])

    touching = Contacts(real, set_there, chance.scatter, gap, near[number // 2]).joints(placing)
    names = [(f"l{1 + i // 2}", _NAMES[i % 2]) for i in number.tolist()]
    locations, sockets = zip(*names, strict=True)
    data = fixture_measurements(real, touching, set_there, {"location": locations, "socket": sockets})
    placed = {f"socket.l{1 + i // 2}.{_NAMES[i % 2]}": centre for i, centre in enumerate(centres)}
    return SimulatedDay(data, chance.bad, placed)


def _around(real: TrueRobot, points: Array) -> Array:
    """Unit vectors ``(m, 3)`` around the base's axis at places ``(m, 3)`` m in the instrument's frame: within reach."""
    T = inverse(real.T_world_tracker) @ real.robot.T_world_frame0
    around = np.cross(T[:3, 2], points - T[:3, 3])
    return np.asarray(around / np.linalg.norm(around, axis=1, keepdims=True))
