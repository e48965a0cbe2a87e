"""What rounded joint readings alone make of an observation: often the limit of a file from a teach pendant."""

from dataclasses import dataclass

import numpy as np

from lab.frames import Array
from lab.geometry.model import Model
from lab.measurements import Measurements, seen_mask

STEPS_DEG = (1.0, 0.5, 0.1, 0.05, 0.01, 0.005, 0.001)  # that displays and files round to, coarse ones first
_WRITTEN_RAD = 1e-9  # how near to a multiple a reading is that was written as one
_LEAST_DIFFERENT = 3  # readings of a joint: fewer may be round by choice
_DIFFERENCE = 1e-6


@dataclass(frozen=True)
class Rounding:
    """Readings rounded to ``step_rad``, and the root mean square ``rms_m`` that this makes of an observation."""

    step_rad: float
    rms_m: float


def rounding(model: Model, data: Measurements, values: Array, things: int | None = None) -> Rounding | None:
    """What the rounding of the readings alone makes; None where they do not look rounded.

    An error within half a step is uniform, of variance step^2 / 12 for each joint on its own; through the
    derivatives by the readings it is the observation's: rms^2 = mean over rows of step^2 / 12 tr(J J').

    Args:
        data: with what the model observes.
        things: how many of the observed things, from the first, are lengths; all where None.
    """
    turning = [j for j in range(data.joints.shape[1]) if len(np.unique(data.joints[:, j])) >= _LEAST_DIFFERENT]
    step = _step_of(data.joints[:, turning])
    if step is None:
        return None
    settings = data.settings(model.conditions)
    squares = np.zeros(data.points[:, :things].shape[:2])
    for j in turning:
        ahead, back = settings.copy(), settings.copy()
        ahead[:, j] += _DIFFERENCE
        back[:, j] -= _DIFFERENCE
        slope = (model.points(ahead, values) - model.points(back, values))[:, :things] / (2 * _DIFFERENCE)
        squares += (slope**2).sum(axis=2)
    seen = seen_mask(data.points[:, :things])
    return Rounding(step, float(step * np.sqrt(squares[seen].mean() / 12)))


def _step_of(joints: Array) -> float | None:
    """The coarsest step (rad) of which all readings ``(n, j)`` are multiples."""
    if not joints.size:
        return None
    for degrees in STEPS_DEG:
        step = float(np.deg2rad(degrees))
        if np.abs(joints - step * np.round(joints / step)).max() < _WRITTEN_RAD:
            return step
    return None
