"""Points of a virtual arm: what a tracker reads of its targets, with the instrument's noise and bad readings."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from lab.core.instruments import Instrument
from lab.core.measurements import Measurements, measured
from lab.core.se3 import Array
from lab.kinematics.effects.conditions import BUMPED
from lab.simulation.effects import NOTHING_SET
from lab.simulation.true_robot import TrueRobot

__all__ = ["measure_with_outlier_mask", "recorded", "track"]


def track(
    real: TrueRobot,
    joints: Array,
    targets: tuple[str, ...],
    instrument: Instrument,
    rng: np.random.Generator,
    readings: int = 1,
    conditions: Mapping[str, Array] = NOTHING_SET,
) -> Measurements:
    """What the tracker reads where these joint positions settle: ``measure_with_outlier_mask`` without the mask."""
    return measure_with_outlier_mask(real, joints, targets, instrument, rng, readings, conditions)[0]


def measure_with_outlier_mask(
    real: TrueRobot,
    joints: Array,
    targets: tuple[str, ...],
    instrument: Instrument,
    rng: np.random.Generator,
    readings: int = 1,
    conditions: Mapping[str, Array] = NOTHING_SET,
) -> tuple[Measurements, NDArray[np.bool_]]:
    """What the tracker reads where these joint positions settle, each point the mean of some readings.

    Scatter and bad readings are drawn from children of ``rng`` each: the instrument's noise is the same without.

    Args:
        real: the arm as it truly is, before its tracker.
        joints: ``(m, n)`` rad or m.
        targets: of the tool.
        instrument: whose noise and systematic errors the points have.
        rng: of the noise, the scatter, the bad readings and the systematic errors.
        readings: how many each point is the mean of.
        conditions: what is set at each pose, ``(m,)`` each.

    Returns:
        The measurements, points in the tracker's frame, and ``(m,)`` which poses' readings are bad, for the
        assessment alone.
    """
    effects, (scattering, failing, shaping, misaligned) = real.effects, rng.spawn(4)
    exact = real.points(joints, targets, conditions, effects.scatter(len(joints), scattering))
    displaced, bad = effects.displacements(len(joints), failing)
    noise = effects.shaped_noise(instrument.sample(exact, rng, readings) - exact, shaping)
    points = exact + instrument.errors.sample(exact, misaligned) + noise + displaced[:, None]
    return recorded(real, effects.shown(joints), targets, points, conditions), bad


def recorded(
    real: TrueRobot, joints: Array, targets: tuple[str, ...], points: Array, conditions: Mapping[str, Array]
) -> Measurements:
    """Measurements of points ``(m, k, 3)`` m under these conditions; those after a bump are a session of their own."""
    data = measured(real.robot.chain.joint_names, joints, targets, points)
    rest = {name: column for name, column in conditions.items() if name != BUMPED}
    if BUMPED not in conditions:
        return replace(data, conditions=rest)
    sessions = tuple("2" if after else "1" for after in conditions[BUMPED])
    return replace(data, conditions=rest, sessions=sessions)
