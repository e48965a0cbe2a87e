"""Pose accuracy and repeatability of a robot (ISO 9283:1998)."""

import numpy as np

from lab.core.se3 import Array

__all__ = ["CYCLES", "accuracy", "repeatability"]

CYCLES = 30


def accuracy(points: Array, wanted: Array) -> Array:
    """AP ``(k,)`` m: from each commanded place ``(k, 3)`` to the mean of the places attained ``(cycles, k, 3)``."""
    return np.asarray(np.linalg.norm(points.mean(axis=0) - wanted, axis=1))


def repeatability(points: Array) -> Array:
    """RP ``(k,)`` m: mean and three standard deviations of the distances from the mean of ``(cycles, k, 3)``."""
    distance = np.linalg.norm(points - points.mean(axis=0), axis=2)
    return np.asarray(distance.mean(axis=0) + 3 * distance.std(axis=0, ddof=1))
