"""The boundary of what is reached, by dual contours of a grid: a vertex in each cell that it passes, joined by faces.

Where two neighbouring nodes of the grid differ, the place between them where it changes is narrowed down by bisection.
A cell's vertex is the mean of such places on its edges, and around every such edge the cells' vertices make a face: a
segment of two in a plane, a quadrilateral of four in space (surface nets, Gibson 1998).
"""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from lab.core.se3 import Array

__all__ = ["boundary"]


def boundary(
    inside: Callable[[Array], NDArray[np.bool_]], axes: tuple[Array, ...], halvings: int
) -> tuple[NDArray[np.bool_], Array, NDArray[np.int_]]:
    """The nodes that are inside, and the boundary between them and the others.

    Args:
        inside: whether coordinates ``(n, d)`` are inside, d = 2 or 3.
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
    """Between places ``(n, d)``, of which one is inside, where that changes."""
    for _ in range(halvings):
        middle = (low + high) / 2
        same = (inside(middle) == begins)[:, None]
        low, high = np.where(same, middle, low), np.where(same, high, middle)
    return np.asarray((low + high) / 2)


def _faces(
    shape: tuple[int, ...], first: NDArray[np.int_], axis_of: NDArray[np.int_], begins: NDArray[np.bool_], places: Array
) -> tuple[Array, NDArray[np.int_]]:
    """Vertices and faces of crossings ``(n, d)`` on edges that begin at nodes ``first`` and go along an axis."""
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
