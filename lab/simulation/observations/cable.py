"""A draw-wire on a virtual arm: lengths from its point to anchors around it, a session each."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from lab.core.instruments import Instrument
from lab.core.se3 import Array, inverse, transform
from lab.simulation.observations.contact import POINT, Chance, fixture_measurements, without_sessions
from lab.simulation.observations.protocol import Setup, SimulatedDay, refuse_several_targets
from lab.simulation.true_robot import TrueRobot

__all__ = ["observe_cable"]

_OFFSET_M = 0.01  # standard deviation of the length at which the instrument reads zero
_AWAY = 1.5  # times the farthest point of the arm: where anchors are, on a circle about the base
_LOWEST, _HIGHEST = -0.3, 0.5  # times the same: how high


def observe_cable(
    real: TrueRobot,
    joints: Array,
    targets: tuple[str, ...],
    instrument: Instrument,
    rng: np.random.Generator,
    readings: int,
    conditions: Mapping[str, Array],
    setup: Setup,
) -> SimulatedDay:
    """Lengths to one anchor after the other, in as many poses each as can be; the cable bends around nothing."""
    refuse_several_targets("cable", targets)
    chance, placing = Chance.of(real, instrument, (len(joints), 1), rng, readings), rng.spawn(1)[0]
    set_there = without_sessions(conditions)
    points = real.points(joints, POINT, set_there, chance.scatter)[:, 0] + chance.displaced
    anchors, offset_m = _anchors(real, points, setup.fixtures, placing), _OFFSET_M * float(placing.standard_normal())
    number = np.arange(len(joints)) * setup.fixtures // len(joints)
    lengths = np.linalg.norm(points - anchors[number], axis=1) + offset_m + chance.noise[:, 0]
    data = fixture_measurements(real, joints, {**set_there, "cable_mm": 1e3 * lengths})
    data = replace(data, sessions=tuple(str(1 + i) for i in number.tolist()))
    placed = {f"anchor.{1 + i}": anchor for i, anchor in enumerate(anchors)}
    return SimulatedDay(data, chance.bad, {**placed, "cable": np.array([offset_m])})


def _anchors(real: TrueRobot, points: Array, count: int, rng: np.random.Generator) -> Array:
    """Anchors ``(count, 3)`` m in the instrument's frame, evenly around the base from a random side on."""
    T_tracker_base = inverse(real.T_world_tracker) @ real.robot.T_world_frame0
    reach = float(np.linalg.norm(transform(inverse(T_tracker_base), points), axis=1).max())
    angle = rng.uniform(0, 2 * np.pi) + 2 * np.pi * np.arange(count) / count
    heights = reach * rng.uniform(_LOWEST, _HIGHEST, count)
    return transform(
        T_tracker_base, np.stack([_AWAY * reach * np.cos(angle), _AWAY * reach * np.sin(angle), heights], axis=1)
    )
