"""The volume of what an arm reaches whose first turn is a whole one about z, by exact sections.

Whether a place is reached within the joints' limits is what the arm's closed form says, or a search. The space is a
solid of revolution, so that a section across z is made of rings. A radius is sampled at each level, and every change
between neighbouring samples is narrowed down by bisection; so are the levels between which there are sections. There
they are integrated by Gauss' rule in panels, since a void bends their area. Three slides make a parallelepiped, whose
volume is the determinant times the strokes.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lab.core.errors import LabError
from lab.core.se3 import Array, pose
from lab.extensions.robotics.inverse.three_joints import ThreeJoints
from lab.extensions.robotics.workspace.membership import by_closed_form, turns_about_z
from lab.kinematics.serial.chain import Chain

__all__ = ["carrier_volume", "solid_volume"]

_SAMPLES, _LEVELS, _PANELS, _HALVINGS = 24, 16, 20, 14

Reached = Callable[[Array, Array], NDArray[np.bool_]]
"""Whether places at radii ``(n,)`` from z and at levels ``(n,)`` along it are reached, m."""


def carrier_volume(chain: Chain, point: Array, half_m: float) -> float:
    """The volume (m³) that a point ``(3,)`` m of the last frame of three joints reaches.

    Args:
        half_m: no place farther than this from frame 0's origin is looked at.

    Raises:
        LabError: the arm has no closed form, or joint 1 (after a slide along z, joint 2) makes no whole turn about z.
    """
    form = ThreeJoints.of(chain, point)
    if form is None:
        raise LabError(f"robot '{chain.name}': not an arm of three joints that move its point in space")
    if all(chain.prismatic):
        return float(abs(form.determinant.at(np.zeros(3))) * (chain.upper - chain.lower).prod())
    if not turns_about_z(chain):
        raise LabError(f"robot '{chain.name}': its reach is not a solid of revolution about z")

    def reached(radius: Array, level: Array) -> NDArray[np.bool_]:
        places = np.stack([radius, np.zeros_like(radius), level], axis=1)
        return by_closed_form(form, chain, pose(np.tile(np.eye(3), (len(places), 1, 1)), places - form.point))[0]

    return solid_volume(reached, (-half_m, half_m), half_m)


def solid_volume(reached: Reached, levels_m: tuple[float, float], radius_m: float) -> float:
    """The volume (m³) of a solid of revolution about z.

    By Gauss' rule of two points in panels, between the levels at which sections begin and end.

    Args:
        levels_m: from where to where it is looked at along z.
        radius_m: to which distance from z.
    """
    solid = _Solid(reached, radius_m)
    first, last = levels_m
    levels = np.linspace(first, last, _LEVELS + 1) + 0.37 * (last - first) / 2 / _LEVELS
    there = solid.meets(levels)
    changes = np.flatnonzero(there[:-1] != there[1:])
    ends = solid.narrowed(levels[changes], levels[changes + 1], there[changes])
    total = 0.0
    for low, high in zip(ends[::2], ends[1::2], strict=True):
        half = (high - low) / (2 * _PANELS)
        middles = low + half * (2 * np.arange(_PANELS) + 1)
        nodes = (middles[:, None] + half / np.sqrt(3) * np.array([-1.0, 1.0])).ravel()
        total += half * float(solid.areas(nodes).sum())
    return total


@dataclass(frozen=True)
class _Solid:
    """What is reached of a half plane through z."""

    reached: Reached
    radius_m: float

    def narrowed(self, low: Array, high: Array, first: NDArray[np.bool_]) -> Array:
        """The levels ``(k,)`` between two others at which sections begin or end."""
        for _ in range(_HALVINGS):
            middle = (low + high) / 2
            same = self.meets(middle) == first
            low, high = np.where(same, middle, low), np.where(same, high, middle)
        return np.asarray((low + high) / 2)

    @property
    def radii(self) -> Array:
        """At which it is looked ``(k,)``."""
        return np.asarray(self.radius_m * (np.arange(_SAMPLES + 1) + 1e-3) / _SAMPLES)

    def inside(self, levels: Array) -> NDArray[np.bool_]:
        """``(n, k)`` which radii are reached at levels ``(n,)``."""
        grid = np.broadcast_to(self.radii, (len(levels), _SAMPLES + 1))
        return self.reached(grid.ravel(), np.repeat(levels, _SAMPLES + 1)).reshape(grid.shape)

    def meets(self, levels: Array) -> NDArray[np.bool_]:
        """``(n,)`` whether there are rings at levels."""
        return np.asarray(self.inside(levels).any(axis=1))

    def areas(self, levels: Array) -> Array:
        """Of the rings ``(n,)`` m² at levels."""
        radii, inside = self.radii, self.inside(levels)
        rows, columns = np.nonzero(inside[:, :-1] != inside[:, 1:])
        low, high, first = radii[columns], radii[columns + 1], inside[rows, columns]
        for _ in range(_HALVINGS if len(rows) else 0):
            middle = (low + high) / 2
            same = self.reached(middle, levels[rows]) == first
            low, high = np.where(same, middle, low), np.where(same, high, middle)
        edges = np.where(first, 1.0, -1.0) * ((low + high) / 2) ** 2  # a ring ends, or begins
        return np.asarray(np.pi * np.bincount(rows, weights=edges, minlength=len(levels)), dtype=float)
