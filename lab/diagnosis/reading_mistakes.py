"""Discrete mistakes in how joint positions and points were read: units, signs, exchanges, shifts of rows."""

from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from itertools import combinations, permutations

import numpy as np
from numpy.typing import NDArray

from lab.core.measurements import Measurements
from lab.core.se3 import Array
from lab.diagnosis.hypothesis import Hypothesis
from lab.diagnosis.placement import Placement, row_misses
from lab.kinematics.joints import JointSpec

__all__ = ["joint_mistakes", "point_mistakes", "row_mistakes"]

_SHIFTS = (1, -1, 2, -2, 3, -3)
_QUARTERS = (1, 2, -1)  # quarter turns by which a zero is wrong
_LENGTH_UNITS = (("mm", 1e-3), ("m", 1e3), ("inches", 0.0254), ("inches", 25.4), ("cm", 0.01), ("cm", 10.0))
_MOST_SWAPPED = 12  # rows far off, of which pairs are tried
_CLEARLY = 3.0  # times as small a miss, of a row that is read otherwise
_MOST_TARGETS = 4  # of which exchanges are tried


def joint_mistakes(joints: JointSpec, data: Measurements) -> Iterator[Hypothesis]:
    """Yield mistakes of all rows' joint positions."""
    names, count = data.joint_names, len(data.joint_names)
    turning = ~np.array(joints.prismatic, dtype=np.bool_)

    def changed(change: Callable[[Array], Array]) -> Callable[[Measurements], Measurements]:
        return lambda rows: replace(rows, joints=change(rows.joints))

    for given, factor in (("degrees", np.pi / 180), ("rad", 180 / np.pi)):
        factors = np.where(turning, factor, 1.0)
        yield Hypothesis("joint_unit", (given,), 2, changed(lambda q, f=factors: q * f))
    moved = np.ptp(data.joints, axis=0) > 0
    for j in np.flatnonzero(moved):
        sign = np.where(np.arange(count) == j, -1.0, 1.0)
        yield Hypothesis("joint_sign", (names[j],), count, changed(lambda q, s=sign: q * s))
    for j in np.flatnonzero(turning):
        for quarters in _QUARTERS:
            offset = np.where(np.arange(count) == j, quarters * np.pi / 2, 0.0)
            data_of = (("offset_rad", float(offset[j])),)
            yield Hypothesis("joint_zero", (names[j],), 3 * count, changed(lambda q, o=offset: q + o), data=data_of)
    pairs = list(combinations(range(count), 2))
    for a, b in pairs:
        order = np.arange(count)
        order[[a, b]] = b, a
        yield Hypothesis("joints_exchanged", (names[a], names[b]), len(pairs), changed(lambda q, o=order: q[:, o]))
    for a, b in permutations(range(count), 2):
        for sign in (-1.0, 1.0):
            mixed = np.eye(count)
            mixed[b, a] = sign
            of = names[a], names[b], "-" if sign > 0 else "+"
            yield Hypothesis("joints_coupled", of, 4 * len(pairs), changed(lambda q, m=mixed: q @ m))
    yield Hypothesis("joints_reversed", (), 1, changed(lambda q: q[:, ::-1]))
    yield Hypothesis("rows_reversed", (), 1, changed(lambda q: q[::-1]))
    for by in _SHIFTS:
        yield Hypothesis("rows_shifted", (f"{by:+d}",), len(_SHIFTS), partial(_shifted, by=by, first=0))


def _shifted(rows: Measurements, by: int, first: int) -> Measurements:
    """Return the rows from one on with the joint positions of the rows ``by`` further; those at the end are skipped."""
    number = np.arange(len(rows))
    wanted = np.where(number >= first, number + by, number)
    within = (wanted >= 0) & (wanted < len(rows))
    use = tuple(use if inside else "skip" for use, inside in zip(rows.use, within, strict=True))
    return replace(rows, joints=rows.joints[np.clip(wanted, 0, len(rows) - 1)], use=use)


def point_mistakes() -> Iterator[Hypothesis]:
    """Yield mistakes of all rows' points: their unit, and a mirrored frame."""

    def scaled(rows: Measurements, by: Array) -> Measurements:
        return replace(rows, points=rows.points * by)

    for unit, factor in _LENGTH_UNITS:
        by = partial(scaled, by=np.full(3, factor))
        yield Hypothesis("point_unit", (unit,), len(_LENGTH_UNITS), by, data=(("factor", factor),))
    yield Hypothesis("points_mirrored", (), 1, partial(scaled, by=np.array([-1.0, 1.0, 1.0])))


def row_mistakes(data: Measurements, at: Placement, ordinary_m: float) -> Iterator[Hypothesis]:
    """Yield mistakes of single rows, and of all rows from one on, by how a placed arm misses them read otherwise.

    Args:
        data: points of the rows.
        at: the arm, placed among most of them.
        ordinary_m: a miss that a sound row has.
    """
    far = at.misses > _CLEARLY * ordinary_m
    for order in permutations(range(min(len(data.targets), _MOST_TARGETS))):
        if list(order) == sorted(order):
            continue
        whole = [*order, *range(len(order), len(data.targets))]
        misses = row_misses(data.points[:, whole], at.predicted)
        names = tuple(data.targets[k] for k in range(len(whole)) if whole[k] != k)
        yield from _exchanged_targets(data, at, misses, far, (whole, names))
    for by in (1, -1):
        yield from _shifted_from(data, at, by, far)
    yield from _exchanged_rows(data, at, far)


def _exchanged_targets(
    data: Measurements,
    at: Placement,
    misses: Array,
    far: NDArray[np.bool_],
    exchange: tuple[list[int], tuple[str, ...]],
) -> Iterator[Hypothesis]:
    """Yield targets that are exchanged in some rows, or in all from a row on."""
    order, names = exchange
    better = far & (_CLEARLY * misses < at.misses)
    if not better.any():
        return

    def read(rows: Measurements, which: NDArray[np.bool_]) -> Measurements:
        return replace(rows, points=np.where(which[:, None, None], rows.points[:, order], rows.points))

    n, ids = len(data), data.ids
    if (cut := _stretch(better)) is not None:
        first, last = cut
        which = (np.arange(n) >= first) & (np.arange(n) <= last)
        of = (*names, ids[first], ids[last])
        yield Hypothesis("targets_exchanged", of, n, partial(read, which=which), data=(("rows", int(which.sum())),))
    if better.mean() < 0.5:
        of = (*names, *(ids[i] for i in np.flatnonzero(better)))
        count = int(better.sum())
        yield Hypothesis(
            "targets_exchanged_once",
            of,
            float(n) ** count,
            partial(read, which=better),
            data=(("targets", len(names)),),
        )


def _stretch(better: NDArray[np.bool_]) -> tuple[int, int] | None:
    """Return the first and last row of the stretch to either end that holds the rows; None where there is none."""
    n = len(better)
    gain = np.where(better, 1, -1)
    from_row, to_row = np.cumsum(gain[::-1])[::-1], np.cumsum(gain)
    first, last = int(np.argmax(from_row)), int(np.argmax(to_row))
    if max(from_row[first], to_row[last]) < 2:
        return None
    return (first, n - 1) if from_row[first] >= to_row[last] else (0, last)


def _shifted_from(data: Measurements, at: Placement, by: int, far: NDArray[np.bool_]) -> Iterator[Hypothesis]:
    """Yield rows that are shifted from one of them on, where a row is missing or twice there."""
    n = len(data)
    wanted = np.clip(np.arange(n) + by, 0, n - 1)
    better = far & (_CLEARLY * row_misses(data.points, at.predicted[wanted]) < at.misses)
    if (cut := _stretch(better)) is not None and cut[0] > 0:
        of = (f"{by:+d}", data.ids[cut[0]])
        yield Hypothesis("rows_shifted_from", of, 2 * n, partial(_shifted, by=by, first=cut[0]))


def _exchanged_rows(data: Measurements, at: Placement, far: NDArray[np.bool_]) -> Iterator[Hypothesis]:
    """Yield pairs of rows whose joint positions are exchanged."""
    rows = np.flatnonzero(far)
    rows = rows[np.argsort(-at.misses[rows])][:_MOST_SWAPPED]

    def read(measured: Measurements, pair: tuple[int, int]) -> Measurements:
        order = np.arange(len(measured))
        order[list(pair)] = pair[::-1]
        return replace(measured, joints=measured.joints[order])

    for i, j in combinations(rows.tolist(), 2):
        exchanged = row_misses(data.points[[i, j]], at.predicted[[j, i]])
        if (_CLEARLY * exchanged < at.misses[[i, j]]).all():
            of = data.ids[i], data.ids[j]
            yield Hypothesis("rows_exchanged", of, len(data) ** 2, partial(read, pair=(i, j)))
