"""The volume that a carrier of three joints reaches whose first turn is a whole one about z, by exact sections.

Whether a place is reached within the joints' limits is what the arm's closed form says. The space is a solid of
revolution, so that a section across z is made of rings. A radius is sampled at each level, and every change between
neighbouring samples is narrowed down by bisection; so are the levels between which there are sections. There they are
integrated by Gauss' rule in panels, since a void bends their area. Three slides make a parallelepiped, whose volume is
the determinant times the strokes.
"""

import numpy as np
from numpy.typing import NDArray

from lab.core.errors import LabError
from lab.core.se3 import Array, pose
from lab.kinematics.inverse.analytic.three_joints import ThreeJoints
from lab.kinematics.serial.chain import Chain

__all__ = ["reached_volume"]

_SAMPLES, _LEVELS, _PANELS, _HALVINGS = 24, 16, 20, 16
_SLACK = 1e-9  # rad or m beyond a limit


def reached_volume(chain: Chain, point: Array, half_m: float) -> float:
    """The volume (m³) that a point ``(3,)`` m of the last frame reaches, within ``half_m`` of frame 0's origin.

    Raises:
        LabError: the arm has no closed form, or joint 1 (after a slide along z, joint 2) makes no whole turn about z.
    """
    form = ThreeJoints.of(chain, point)
    strokes = chain.upper - chain.lower
    if form is None:
        raise LabError(f"robot '{chain.name}': not an arm of three joints that move its point in space")
    if all(chain.prismatic):
        return float(abs(form.determinant.at(np.zeros(3))) * strokes.prod())
    turn = chain.prismatic.index(False)
    along_z = np.abs(form.axes.directions[: turn + 1] @ np.array([0.0, 0.0, 1.0])) > 1 - _SLACK
    on_z = np.abs(form.axes.origins[turn, :2]).max() < _SLACK
    if not along_z.all() or not on_z or strokes[turn] < 2 * np.pi - _SLACK:
        raise LabError(f"robot '{chain.name}': its reach is not a solid of revolution about z")
    return _Solid(chain, form, half_m).volume()


class _Solid:
    """What is reached of a half plane through z."""

    def __init__(self, chain: Chain, form: ThreeJoints, half_m: float) -> None:
        self.chain, self.form, self.half_m = chain, form, half_m
        self.whole = ~np.array(chain.prismatic) & (chain.upper - chain.lower >= 2 * np.pi - _SLACK)

    def reached(self, radius: Array, level: Array) -> NDArray[np.bool_]:
        """Whether places ``(n,)`` are reached within the limits."""
        places = np.stack([radius, np.zeros_like(radius), level], axis=1)
        found = self.form.solve(pose(np.tile(np.eye(3), (len(places), 1, 1)), places - self.form.point), nearest=False)
        low, high = self.chain.lower - _SLACK, self.chain.upper + _SLACK
        inside = ((found.joints >= low) & (found.joints <= high)) | self.whole
        return np.asarray(((found.gap_m == 0) & inside.all(axis=2)).any(axis=1))

    def volume(self) -> float:
        """By Gauss' rule of two points in panels, between the levels at which sections begin and end."""
        levels = np.linspace(-self.half_m, self.half_m, _LEVELS + 1) + 0.37 * self.half_m / _LEVELS
        there = self.areas(levels) > 0
        changes = np.flatnonzero(there[:-1] != there[1:])
        ends = self.narrowed(levels[changes], levels[changes + 1], there[changes])
        total = 0.0
        for low, high in zip(ends[::2], ends[1::2], strict=True):
            half = (high - low) / (2 * _PANELS)
            middles = low + half * (2 * np.arange(_PANELS) + 1)
            nodes = (middles[:, None] + half / np.sqrt(3) * np.array([-1.0, 1.0])).ravel()
            total += half * float(self.areas(nodes).sum())
        return total

    def narrowed(self, low: Array, high: Array, first: NDArray[np.bool_]) -> Array:
        """The levels ``(k,)`` between two others at which sections begin or end."""
        for _ in range(_HALVINGS):
            middle = (low + high) / 2
            same = (self.areas(middle) > 0) == first
            low, high = np.where(same, middle, low), np.where(same, high, middle)
        return np.asarray((low + high) / 2)

    def areas(self, levels: Array) -> Array:
        """Of the rings ``(n,)`` m² at levels."""
        radii = self.half_m * (np.arange(_SAMPLES + 1) + 1e-3) / _SAMPLES
        grid = np.broadcast_to(radii, (len(levels), len(radii)))
        inside = self.reached(grid.ravel(), np.repeat(levels, len(radii))).reshape(grid.shape)
        rows, columns = np.nonzero(inside[:, :-1] != inside[:, 1:])
        low, high, first = radii[columns], radii[columns + 1], inside[rows, columns]
        for _ in range(_HALVINGS if len(rows) else 0):
            middle = (low + high) / 2
            same = self.reached(middle, levels[rows]) == first
            low, high = np.where(same, middle, low), np.where(same, high, middle)
        edges = np.where(first, 1.0, -1.0) * ((low + high) / 2) ** 2  # a ring ends, or begins
        return np.asarray(np.pi * np.bincount(rows, weights=edges, minlength=len(levels)), dtype=float)
