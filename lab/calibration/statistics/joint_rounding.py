"""Derivatives of observations by the joint positions, and the effect of rounding these."""

from dataclasses import dataclass

import numpy as np

from lab.core.measurements import Measurements, seen_mask
from lab.core.se3 import Array
from lab.kinematics.joints import Encoders
from lab.kinematics.model import Model

__all__ = ["by_joint_positions", "counting", "rounding"]

_STEP = 1e-6  # rad or m, of central differences: exact to about 1e-10 of a lever
_STEPS_DEG = (1.0, 0.5, 0.1, 0.05, 0.01, 0.005, 0.001)  # that displays and files round to, coarse ones first
_WRITTEN_RAD = 1e-9  # how near to a multiple a reading is that was written as one
_LEAST_DIFFERENT = 3  # positions of a joint: fewer may be round by choice


@dataclass(frozen=True)
class _Rounding:
    """Readings rounded to ``step_rad``, and the root mean square ``rms_m`` that this makes of an observation."""

    step_rad: float
    rms_m: float


def rounding(model: Model, data: Measurements, values: Array, things: int | None = None) -> _Rounding | None:
    """Return the effect of rounded joint positions; None where they do not look rounded.

    An error within half a step is uniform, of variance step^2 / 12 for each joint on its own; through the
    derivatives by the joint positions it is the observation's: rms^2 = mean over rows of step^2 / 12 tr(J J').

    Args:
        things: how many of the observed things, from the first, are lengths; all where None.
    """
    turning = [j for j in range(data.joints.shape[1]) if len(np.unique(data.joints[:, j])) >= _LEAST_DIFFERENT]
    step = _step_of(data.joints[:, turning])
    if step is None:
        return None
    slope = by_joint_positions(model, data.inputs(model.conditions), values, data.joints.shape[1])[:, :things]
    squares = (slope[..., turning] ** 2).sum(axis=(2, 3))
    visible = seen_mask(data.points[:, :things])
    return _Rounding(step, float(step * np.sqrt(squares[visible].mean() / 12)))


def _step_of(joints: Array) -> float | None:
    if not joints.size:
        return None
    for degrees in _STEPS_DEG:
        step = float(np.deg2rad(degrees))
        if np.abs(joints - step * np.round(joints / step)).max() < _WRITTEN_RAD:
            return step
    return None


def counting(model: Model, data: Measurements, values: Array, encoders: Encoders, things: int | None = None) -> float:
    """Return the root mean square (m) that whole counts of known encoders alone make of an observation.

    Args:
        things: how many of the observed things, from the first, are lengths; all where None.
    """
    joints = data.joints.shape[1]
    slope = by_joint_positions(model, data.inputs(model.conditions), values, joints)[:, :things]
    squares = np.einsum("nkdi,ij,nkdj->nk", slope, encoders.covariance, slope)
    return float(np.sqrt(squares[seen_mask(data.points[:, :things])].mean()))


def by_joint_positions(model: Model, inputs: Array, values: Array, joints: int) -> Array:
    """Derivatives ``(n, k, d, joints)`` of observations by the joint positions, the first columns of ``inputs``."""
    columns = []
    for joint in range(joints):
        step = np.zeros(inputs.shape[1])
        step[joint] = _STEP
        ahead, behind = (model.points(inputs + sign * step, values) for sign in (1, -1))
        columns.append((ahead - behind) / (2 * _STEP))
    return np.stack(columns, axis=-1)
