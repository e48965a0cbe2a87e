"""What every recording's scene needs, as arrays in the world: which poses are drawn, legs, magnified ellipsoids."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lab.calibration.uncertainty import Ellipsoids
from lab.core import se3
from lab.core.se3 import Array
from lab.kinematics.model import RigidArm
from lab.render.document import Strong, Text
from lab.render.skeleton import Legs, skeleton

__all__ = [
    "LARGEST_FACTOR",
    "MOST_POSES",
    "MagnifiedEllipsoids",
    "drawn_rows",
    "legs_legend",
    "magnification",
    "magnified",
    "moved",
    "reach_of",
    "world_legs",
]

MOST_POSES = 300  # whose bodies, points and ellipsoids are drawn
LARGEST_FACTOR = 1e6  # of error arrows: what is still too short to be seen is nothing
_HALF_AXIS = 0.11  # of the reach: the longest half-axis of an ellipsoid as drawn, in the median over the poses


@dataclass(frozen=True)
class MagnifiedEllipsoids:
    """Ellipsoids in the world, one for each drawn pose, magnified.

    Attributes:
        centers: ``(m, 3)`` m.
        axes: ``(m, 3, 3)``, columns unit and right-handed.
        half_sizes: ``(m, 3)``, descending, times ``factor``.
    """

    centers: Array
    axes: Array
    half_sizes: Array
    factor: float


def drawn_rows(count: int) -> NDArray[np.int_]:
    """All rows, or ``MOST_POSES`` of them evenly spaced from the first to the last."""
    if count <= MOST_POSES:
        return np.arange(count)
    return np.round(np.linspace(0, count - 1, MOST_POSES)).astype(np.int_)


def magnification(length: float, wanted: float) -> float:
    """The factor out of 1, 2, 5 times a power of ten that draws ``length`` nearest to ``wanted``; 1 for nothing."""
    if not (np.isfinite(length) and length > 0):
        return 1.0
    power = np.log10(wanted / length)
    steps = [(float(mantissa), int(np.floor(power)) + ten) for ten in (0, 1) for mantissa in (1, 2, 5)]
    mantissa, ten = min(steps, key=lambda step: abs(np.log10(step[0]) + step[1] - power))
    return float(f"{mantissa}e{ten}")


def magnified(shapes: Ellipsoids, centers: Array, T_world_instrument: Array, reach_m: float) -> MagnifiedEllipsoids:
    """Ellipsoids given in the instrument's frame, in the world, magnified by a round factor."""
    factor = magnification(float(np.median(shapes.half_lengths[:, 0])), _HALF_AXIS * reach_m)
    return MagnifiedEllipsoids(centers, T_world_instrument[:3, :3] @ shapes.axes, factor * shapes.half_lengths, factor)


def moved(T_a_b: Array, points: Array) -> Array:
    """Points ``(…, 3)`` given in b, in a."""
    return se3.transform(T_a_b, points.reshape(-1, 3)).reshape(points.shape)


def world_legs(T_world_frame0: Array, arm: RigidArm, values: Array, joints: Array) -> Legs:
    """The legs of an arm, in the world."""
    found = skeleton(arm, values, joints)
    return Legs(moved(T_world_frame0, found.rods), found.measured)


def reach_of(T_world_frame0: Array, points: Array, between: Legs) -> float:
    """How far (m) points ``(…, 3)`` and legs' ends, in the world, get from frame 0."""
    every = np.concatenate([points.reshape(-1, 3), between.ends.reshape(-1, 3)])
    return float(np.linalg.norm(every - T_world_frame0[:3, 3], axis=1).max())


def legs_legend(legs: Legs) -> Text:
    """What the lines of a mechanism are; no words for an arm without legs."""
    kinds = {
        True: (Strong("orange"), ": legs whose length is a joint position"),
        False: (Strong("grey"), ": rods"),
    }
    parts = [words for kind, words in kinds.items() if kind in legs.measured]
    joined = [part for words in parts for part in ("; ", *words)][1:]
    return ("lines of the robot, ", *joined) if joined else ""
