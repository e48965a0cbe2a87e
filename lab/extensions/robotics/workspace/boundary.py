"""Compute the boundary of a workspace from a grid, and the volume of a solid of revolution by sections.

Boundary: dual contours of a grid, with a vertex in each cell that the boundary passes (surface nets, Gibson 1998).
Where two neighbouring nodes of the grid differ, the crossing between them is narrowed down by bisection. A cell's
vertex is the mean of the crossings on its edges, and around every such edge the cells' vertices make a face: a segment
of two in a plane, a quadrilateral of four in space.

Volume: an arm whose first turn is a whole one about z reaches a solid of revolution, so that a section across z is made
of rings. A radius is sampled at each level, and every change between neighbouring samples is narrowed down by
bisection; so are the levels at which sections begin and end. Between them the sections are integrated by Gauss' rule of
two points in panels, since a void bends their area. Three slides make a parallelepiped, whose volume is the determinant
times the strokes.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lab.core.errors import LabError
from lab.core.se3 import Array, pose
from lab.extensions.robotics.inverse.first_joints import ThreeJoints
from lab.extensions.robotics.workspace.membership import by_closed_form, turns_about_z
from lab.kinematics.serial.chain import Chain

__all__ = ["boundary", "carrier_volume", "solid_volume"]


def boundary(
    inside: Callable[[Array], NDArray[np.bool_]], axes: tuple[Array, ...], halvings: int
) -> tuple[NDArray[np.bool_], Array, NDArray[np.int_]]:
    """Return which nodes of a grid are inside, and the boundary between them and the others.

    Args:
        inside: decides whether coordinates ``(n, d)`` are inside, d = 2 or 3.
        axes: the grid's coordinates along each of the d axes, in rising order. No node of its rim should be inside,
            as the boundary is open there.
        halvings: how often each crossing is narrowed down.

    Returns:
        Which nodes are inside ``(n1, ..., nd)``; vertices ``(k, d)``; and faces ``(f, 2)`` or ``(f, 4)`` of vertices,
        counter-clockwise around what is inside, or seen from outside.
    """
    size, shape = len(axes), tuple(map(len, axes))
    nodes = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, size)
    flags = inside(nodes).reshape(shape)
    starts, ends, along = [], [], []
    for axis in range(size):
        here = [slice(None)] * size
        here[axis] = slice(0, -1)
        changed = np.argwhere(np.diff(flags, axis=axis))
        step = np.eye(size, dtype=np.int_)[axis]
        starts.append(changed)
        ends.append(changed + step)
        along.append(np.full(len(changed), axis))
    first, last, axis_of = np.concatenate(starts), np.concatenate(ends), np.concatenate(along)
    if not len(first):
        return flags, np.empty((0, size)), np.empty((0, 2 if size == 2 else 4), dtype=np.int_)
    begins = flags[tuple(first.T)]
    crossings = _narrowed(inside, _at(axes, first), _at(axes, last), begins, halvings)
    return flags, *_faces(shape, first, axis_of, begins, crossings)


def _at(axes: tuple[Array, ...], rows: NDArray[np.int_]) -> Array:
    return np.stack([axis[column] for axis, column in zip(axes, rows.T, strict=True)], axis=1)


def _narrowed(
    inside: Callable[[Array], NDArray[np.bool_]], low: Array, high: Array, begins: NDArray[np.bool_], halvings: int
) -> Array:
    """Narrow down the crossings between places ``(n, d)`` or ``(n,)``, of which one is inside."""
    for _ in range(halvings):
        middle = (low + high) / 2
        same = (inside(middle) == begins).reshape(-1, *(1,) * (low.ndim - 1))
        low, high = np.where(same, middle, low), np.where(same, high, middle)
    return np.asarray((low + high) / 2)


def _faces(
    shape: tuple[int, ...], first: NDArray[np.int_], axis_of: NDArray[np.int_], begins: NDArray[np.bool_], places: Array
) -> tuple[Array, NDArray[np.int_]]:
    """Return vertices and faces for crossings ``(n, d)`` on edges from nodes ``first`` along an axis."""
    size = len(shape)
    cells = np.array(shape) - 1
    corners = [(0,), (-1,)] if size == 2 else [(0, 0), (-1, 0), (-1, -1), (0, -1)]
    around = np.zeros((len(first), len(corners), size), dtype=np.int_)
    for axis in range(size):
        rows = np.flatnonzero(axis_of == axis)
        others = [(axis + 1 + i) % size for i in range(size - 1)]
        for k, offset in enumerate(corners[::-1] if size == 2 and axis == 0 else corners):  # counter-clockwise
            around[rows, k] = first[rows]
            for other, shift in zip(others, offset, strict=True):
                around[rows, k, other] += shift
    within = np.asarray(((around >= 0) & (around < cells)).all(axis=2))
    strides = np.append(np.cumprod(cells[:0:-1])[::-1], 1)
    names = np.asarray((around * strides).sum(axis=2))
    used, vertex = np.unique(names[within], return_inverse=True)
    count = np.bincount(vertex, minlength=len(used))
    repeated = np.repeat(np.arange(len(first)), within.sum(axis=1))
    vertices = np.stack(
        [np.bincount(vertex, weights=places[repeated, i], minlength=len(used)) / count for i in range(size)], axis=1
    )
    numbers = np.full(within.shape, -1, dtype=np.int_)
    numbers[within] = vertex
    whole = within.all(axis=1)
    faces = np.where(begins[whole, None], numbers[whole], numbers[whole, ::-1])
    return vertices, faces


_SAMPLES, _LEVELS, _PANELS, _HALVINGS = 24, 16, 20, 14

_Reached = Callable[[Array, Array], NDArray[np.bool_]]  # of radii from z and levels along it ``(n,)`` m


def carrier_volume(chain: Chain, point: Array, half_m: float) -> float:
    """Compute the volume (m³) that a point ``(3,)`` m of the last frame of three joints reaches.

    Args:
        half_m: largest distance of a place from frame 0's origin.

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
        Ts = pose(np.tile(np.eye(3), (len(places), 1, 1)), places - form.point)
        return np.asarray(by_closed_form(form, chain, Ts)[1].any(axis=1))

    return solid_volume(reached, (-half_m, half_m), half_m)


def solid_volume(reached: _Reached, levels_m: tuple[float, float], radius_m: float) -> float:
    """Compute the volume (m³) of a solid of revolution about z, between two levels and up to a distance from z."""
    solid = _Solid(reached, radius_m)
    first, last = levels_m
    levels = np.linspace(first, last, _LEVELS + 1) + 0.37 * (last - first) / 2 / _LEVELS
    there = solid.meets(levels)
    changes = np.flatnonzero(there[:-1] != there[1:])
    ends = _narrowed(solid.meets, levels[changes], levels[changes + 1], there[changes], _HALVINGS)
    total = 0.0
    for low, high in zip(ends[::2], ends[1::2], strict=True):
        half = (high - low) / (2 * _PANELS)
        middles = low + half * (2 * np.arange(_PANELS) + 1)
        nodes = (middles[:, None] + half / np.sqrt(3) * np.array([-1.0, 1.0])).ravel()
        total += half * float(solid.areas(nodes).sum())
    return total


@dataclass(frozen=True)
class _Solid:
    """The reached part of a half plane through z."""

    reached: _Reached
    radius_m: float

    @property
    def radii(self) -> Array:
        """Radii ``(k,)`` that are sampled."""
        return np.asarray(self.radius_m * (np.arange(_SAMPLES + 1) + 1e-3) / _SAMPLES)

    def inside(self, levels: Array) -> NDArray[np.bool_]:
        """Mark the radii ``(n, k)`` that are reached at levels ``(n,)``."""
        grid = np.broadcast_to(self.radii, (len(levels), _SAMPLES + 1))
        return self.reached(grid.ravel(), np.repeat(levels, _SAMPLES + 1)).reshape(grid.shape)

    def meets(self, levels: Array) -> NDArray[np.bool_]:
        """Mark the levels ``(n,)`` with rings."""
        return np.asarray(self.inside(levels).any(axis=1))

    def areas(self, levels: Array) -> Array:
        """Compute the areas of the rings ``(n,)`` m² at levels."""
        radii, inside = self.radii, self.inside(levels)
        rows, columns = np.nonzero(inside[:, :-1] != inside[:, 1:])
        low, high, first = radii[columns], radii[columns + 1], inside[rows, columns]
        if len(rows):
            low = _narrowed(lambda middle: self.reached(middle, levels[rows]), low, high, first, _HALVINGS)
        edges = np.where(first, 1.0, -1.0) * low**2  # a ring ends, or begins
        return np.asarray(np.pi * np.bincount(rows, weights=edges, minlength=len(levels)), dtype=float)
