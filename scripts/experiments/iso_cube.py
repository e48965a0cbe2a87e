"""Poses and paths of the test cube of a robot (ISO 9283:1998)."""

import numpy as np

from lab.core.se3 import Array

__all__ = ["SIDES_M", "circle_positions", "cube_positions", "line_positions"]

SIDES_M = (1.0, 0.63, 0.4, 0.25)  # of test cubes, table 1
_NEAR_CORNERS = 0.8  # of half a diagonal: the poses are 10 % of it away from the corners
_DIAGONALS = np.array([[1.0, 1.0, 1.0], [1.0, 1.0, -1.0]]) / 2  # of the plane through two opposite edges, side one
_ACROSS, _ALONG = np.array([0.0, 0.0, 1.0]), np.array([1.0, 1.0, 0.0]) / np.sqrt(2)  # unit vectors of that plane


def cube_positions(side_m: float) -> Array:
    """Return the five poses P1 to P5 ``(5, 3)`` m from the cube's centre, in a plane through two opposite edges."""
    out = _NEAR_CORNERS * side_m * _DIAGONALS
    return np.array([np.zeros(3), out[0], -out[0], out[1], -out[1]])


def circle_positions(side_m: float, count: int) -> Array:
    """Return a circle ``(count, 3)`` m in the same plane, 0.8 sides across, from the cube's centre."""
    angle = 2 * np.pi * np.arange(count) / count
    circle: Array = _NEAR_CORNERS / 2 * side_m * (np.cos(angle)[:, None] * _ALONG + np.sin(angle)[:, None] * _ACROSS)
    return circle


def line_positions(side_m: float, count: int) -> Array:
    """Return the straight line from P2 to P3 ``(count, 3)`` m."""
    line: Array = np.linspace(1, -1, count)[:, None] * _NEAR_CORNERS * side_m * _DIAGONALS[0]
    return line
