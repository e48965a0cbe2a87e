"""Base and tool in the six parameters of Khalil and Kleinfinger.

A pose is T = Rz(gamma) Tz(b) Rx(alpha) Tx(d) Rz(theta) Tz(r) (Khalil & Dombre 2002, sections 7.2 and 11.2: Z from the
instrument's frame to frame 0, E from the last frame to the tool's). alpha is the angle between the z axes, d their
distance. With position p, q = Rz(-gamma) p = (d, -r sin alpha, b + r cos alpha). Parallel axes determine only gamma +
theta and b + r (opposite ones gamma - theta and b - r): then r = 0, and gamma points to the other axis, or is 0 for one
axis.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from lab.core import se3
from lab.core.se3 import Array
from lab.core.units import DEGREES

__all__ = ["ANGULAR", "SYMBOLS", "KhalilFrame", "khalil_frame", "pose_of"]

SYMBOLS = ("gamma", "b", "alpha", "d", "theta", "r")
ANGULAR = (True, False, True, False, True, False)
_PARALLEL = 1e-12  # of sin alpha
_NEARLY = 0.035  # of sin alpha: 2 degrees
_ONE_AXIS_M = 1e-12


@dataclass(frozen=True)
class KhalilFrame:
    """A pose in six parameters.

    Attributes:
        values: ``(6,)`` gamma, b, alpha, d, theta, r; rad and m.
        note: message on parameters that are not or weakly determined, or "".
    """

    values: Array
    note: str

    @property
    def named(self) -> Mapping[str, float]:
        """Values by symbol."""
        return dict(zip(SYMBOLS, self.values.tolist(), strict=True))


def pose_of(values: Array) -> Array:
    """Return the pose ``(4, 4)`` (m) of six parameters ``(6,)``: gamma, b, alpha, d, theta, r."""
    gamma, b, alpha, d, theta, r = values
    z, x = np.array([0.0, 0.0, 1.0]), np.array([1.0, 0.0, 0.0])
    first, tilt, last = se3.pose(se3.exp(gamma * z), b * z), se3.pose(se3.exp(alpha * x), np.zeros(3)), r * z
    pose: Array = first @ tilt @ se3.pose(np.eye(3), d * x) @ se3.pose(se3.exp(theta * z), last)
    return pose


def khalil_frame(pose: Array) -> KhalilFrame:
    """Return the six parameters of a pose ``(4, 4)`` (m), alpha from 0 to pi."""
    rotation, position = pose[:3, :3], pose[:3, 3]
    sine = float(np.hypot(rotation[0, 2], rotation[1, 2]))
    alpha = float(np.arctan2(sine, rotation[2, 2]))
    if sine < _PARALLEL:
        return _of_parallel_axes(rotation, position)
    gamma = float(np.arctan2(rotation[0, 2], -rotation[1, 2]))
    turned = se3.exp(np.array([0.0, 0.0, -gamma])) @ rotation  # Rx(alpha) Rz(theta): its first row is cos, -sin, 0
    theta = float(np.arctan2(-turned[0, 1], turned[0, 0]))
    d, across, along = se3.exp(np.array([0.0, 0.0, -gamma])) @ position
    r = -across / sine
    values = np.array([gamma, along - r * np.cos(alpha), alpha, d, theta, r])
    nearly = f"the z axes are nearly parallel ({DEGREES.text(np.arcsin(sine), 2)}): gamma, theta, b and r are uncertain"
    return KhalilFrame(values, nearly if sine < _NEARLY else "")


def _of_parallel_axes(rotation: Array, position: Array) -> KhalilFrame:
    opposite = rotation[2, 2] < 0
    d = float(np.hypot(position[0], position[1]))
    gamma = float(np.arctan2(position[1], position[0])) if d > _ONE_AXIS_M else 0.0
    turned = se3.exp(np.array([0.0, 0.0, -gamma])) @ rotation
    theta = float(np.arctan2(-turned[0, 1], turned[0, 0]))
    values = np.array([gamma, position[2], np.pi if opposite else 0.0, d if d > _ONE_AXIS_M else 0.0, theta, 0.0])
    sums = ("gamma - theta", "b - r") if opposite else ("gamma + theta", "b + r")
    free = sums[1] if d > _ONE_AXIS_M else " and ".join(sums)
    return KhalilFrame(values, f"the z axes are parallel: only {free} {'are' if 'and' in free else 'is'} determined")
