"""Short closed tours over a symmetric cost matrix: 2-opt, Or-opt and kicks, for many tours at once.

A batch of k tours over m places is an array ``(k, m)``, each row a permutation. (Lin & Kernighan 1973 and
Or 1976 for the moves; Martin, Otto & Felten 1991 for the double bridge that kicks a tour out of its rut.)
"""

import numpy as np
from numpy.typing import NDArray

from lab.core.se3 import Array

__all__ = ["double_bridge", "improve", "lengths", "random_starts"]

Tours = NDArray[np.int_]
_STARTS = 24
_LONGEST_SEGMENT = 3
_GAIN = 1e-12


def lengths(cost: Array, tours: Tours) -> Array:
    """``(k,)``: the length of each closed tour."""
    total: Array = cost[tours, np.roll(tours, -1, axis=1)].sum(axis=1)
    return total


def random_starts(cost: Array, rng: np.random.Generator, count: int = _STARTS) -> Tours:
    """``(count, m)``: half of them random, half by nearest neighbour from different places, place 0 first."""
    size = len(cost)
    starts = np.append(0, rng.permutation(np.arange(1, size)))[: max(1, count // 2)]
    nearest = [_nearest_neighbour(cost, int(start)) for start in starts]
    return np.array([*nearest, *(rng.permutation(size) for _ in range(count - len(nearest)))])


def improve(cost: Array, tours: Tours) -> Tours:
    """Each tour after the best 2-opt or Or-opt move, again and again until none shortens it."""
    tours = tours.copy()
    if tours.shape[1] < 4:
        return tours  # three places have one tour
    active = np.arange(len(tours))
    while len(active):
        moved, gained = _best_move(cost, tours[active])
        tours[active[gained]] = moved[gained]
        active = active[gained]
    return tours


def double_bridge(tours: Tours, rng: np.random.Generator) -> Tours:
    """Each tour with two neighbouring stretches of it exchanged (a double bridge)."""
    size = tours.shape[1]
    if size < 5:
        return tours
    kicks = []
    for tour in tours:
        a, b, c = np.sort(rng.choice(np.arange(1, size), 3, replace=False))
        kicks.append(np.concatenate([tour[:a], tour[b:c], tour[a:b], tour[c:]]))
    return np.array(kicks)


def _nearest_neighbour(cost: Array, start: int) -> Tours:
    tour, left = [start], np.ones(len(cost), dtype=bool)
    left[start] = False
    while left.any():
        tour.append(int(np.argmin(np.where(left, cost[tour[-1]], np.inf))))
        left[tour[-1]] = False
    return np.array(tour)


def _best_move(cost: Array, tours: Tours) -> tuple[Tours, NDArray[np.bool_]]:
    """The tours ``(k, m)`` after their best move, and which of them it shortens."""
    moved, changes = tours.copy(), []
    between = cost[tours[:, :, None], tours[:, None, :]]  # (k, m, m)
    kinds = [(0, False), *((n, turned) for n in range(1, _LONGEST_SEGMENT + 1) for turned in (False, True))]
    kinds = [kind for kind in kinds if kind[0] <= tours.shape[1] - 3]
    for length, turned in kinds:
        change = _or_change(between, length, turned) if length else _two_opt_change(between)
        changes.append(change.reshape(len(tours), -1))
    best = np.array([change.argmin(axis=1) for change in changes])  # (kinds, k)
    value = np.array([change.min(axis=1) for change in changes])
    kind, shorter = value.argmin(axis=0), value.min(axis=0) < -_GAIN
    for row in np.flatnonzero(shorter):
        i, j = divmod(int(best[kind[row], row]), tours.shape[1])
        length, turned = kinds[kind[row]]
        moved[row] = _or_moved(tours[row], i, j, length, turned) if length else _reversed(tours[row], i, j)
    return moved, shorter


def _two_opt_change(between: Array) -> Array:
    """``(k, m, m)``: what it changes to replace legs i and j by (i, j) and (i + 1, j + 1)."""
    leg = _legs(between)
    change: Array = between + np.roll(between, (-1, -1), (1, 2)) - leg[:, :, None] - leg[:, None, :]
    at = np.arange(between.shape[1])
    change[:, at, at] = np.inf
    return change


def _or_change(between: Array, length: int, turned: bool) -> Array:
    """``(k, m, m)``: what it changes to put the segment from i on between j and j + 1; inf if j is in it."""
    size, at = between.shape[1], np.arange(between.shape[1])
    before, last, after = (at - 1) % size, (at + length - 1) % size, (at + length) % size
    leg = _legs(between)
    closed = between[:, before, after] - leg[:, before] - leg[:, last]  # (k, m): the segment taken out
    first_end, second_end = (last, at) if turned else (at, last)
    opened = between[:, first_end] + np.roll(between[:, second_end], -1, axis=2) - leg[:, None, :]
    change: Array = closed[:, :, None] + opened
    change[:, (at[None] - before[:, None]) % size <= length] = np.inf
    return change


def _legs(between: Array) -> Array:
    """``(k, m)``: the leg from each stop to the next."""
    at = np.arange(between.shape[1])
    legs: Array = between[:, at, np.roll(at, -1)]
    return legs


def _reversed(tour: Tours, i: int, j: int) -> Tours:
    i, j = min(i, j), max(i, j)
    return np.concatenate([tour[: i + 1], tour[j:i:-1], tour[j + 1 :]])


def _or_moved(tour: Tours, i: int, j: int, length: int, turned: bool) -> Tours:
    around = np.roll(tour, -i)
    segment, rest = around[:length], around[length:]
    cut = (j - i) % len(tour) - length + 1
    return np.concatenate([rest[:cut], segment[::-1] if turned else segment, rest[cut:]])
