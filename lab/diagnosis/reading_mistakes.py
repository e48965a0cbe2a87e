"""Discrete mistakes in how joint positions and points were read: units, signs, exchanges, shifts of rows."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import partial
from itertools import combinations, permutations

import numpy as np
from numpy.typing import NDArray

from lab.core.measurements import Measurements
from lab.core.se3 import Array
from lab.diagnosis.hypothesis import Correction, Hypothesis
from lab.diagnosis.placement import Placement, row_misses
from lab.kinematics.joints import JointSpec
from lab.kinematics.model import RigidArm

__all__ = ["joint_mistakes", "point_mistakes", "row_mistakes", "zero_mistakes"]

_TURNS = 4 * np.pi  # rad: no joint turns farther
_MOST_SIGNS = 3  # joints that are counted the other way at once
_SHIFTS = (1, -1, 2, -2, 3, -3)
_QUARTERS = (1, 2, -1)  # quarter turns by which a zero is wrong
_LENGTH_UNITS = (
    ("mm", 1e-3),
    ("m", 1e3),
    ("inches", 0.0254),
    ("inches", 25.4),
    ("cm", 0.01),
    ("cm", 10.0),
    ("mm", 0.1),
)
_MOST_SWAPPED = 12  # rows far off, of which pairs are tried
_CLEARLY = 3.0  # times as small a miss, of a row that is read otherwise
_MOST_TARGETS = 4  # of which exchanges are tried
_FAR_ZERO = 0.05  # rad, m
_LEAST_STUCK, _MOSTLY = 3, 0.8  # rows in which a reading stays, and the share of them that a moving joint explains
_STARTS, _STUCK_STEPS, _DIFFERENCE = 8, 6, 1e-6


def joint_mistakes(joints: JointSpec, data: Measurements) -> Iterator[Hypothesis]:
    """Yield mistakes of all rows' joint positions."""
    names, turning = data.joint_names, ~np.array(joints.prismatic, dtype=np.bool_)
    yield from _units(names, turning, np.abs(data.joints).max(axis=0))
    yield from _signs(names, np.flatnonzero(np.ptp(data.joints, axis=0) > 0).tolist())
    yield from _zeros(names, np.flatnonzero(turning).tolist())
    yield from _pairs(names)
    yield Hypothesis("joints_reversed", (), 1, _changed(lambda q: q[:, ::-1]))
    yield Hypothesis("rows_reversed", (), 1, _changed(lambda q: q[::-1]))
    for by in _SHIFTS:
        yield Hypothesis("rows_shifted", (f"{by:+d}",), len(_SHIFTS), partial(_shifted, by=by))


def _changed(change: Callable[[Array], Array]) -> Correction:
    """Return a correction of the joint positions."""
    return lambda rows: replace(rows, joints=change(rows.joints))


def _scaled(factors: Array) -> Correction:
    return _changed(lambda q: q * factors)


def _units(names: Sequence[str], turning: NDArray[np.bool_], largest: Array) -> Iterator[Hypothesis]:
    """Yield another unit of all turning joints, or of one.

    Args:
        largest: ``(joints,)`` readings: those of an angle in degrees are beyond any turn of a joint in rad.
    """
    number = np.arange(len(names))
    for given, factor in (("degrees", np.pi / 180), ("rad", 180 / np.pi)):
        likely = turning & ((largest > _TURNS) if given == "degrees" else (largest < _TURNS * np.pi / 180))
        if likely.any():
            yield Hypothesis("joint_unit", (given,), 2, _scaled(np.where(turning, factor, 1.0)))
        for j in np.flatnonzero(likely).tolist():
            yield Hypothesis("joint_unit", (given, names[j]), 2 * len(names), _scaled(np.where(number == j, factor, 1)))


def _signs(names: Sequence[str], moved: Sequence[int]) -> Iterator[Hypothesis]:
    """Yield joints that are counted the other way: one, a few, or all."""
    count = len(names)
    for several in dict.fromkeys((*range(1, min(_MOST_SIGNS, len(moved)) + 1), len(moved))):
        for negated in combinations(moved, several):
            signs = np.where(np.isin(np.arange(count), negated), -1.0, 1.0)
            alternatives = float(count ** min(several, _MOST_SIGNS))
            yield Hypothesis("joint_sign", tuple(names[j] for j in negated), alternatives, _scaled(signs))


def _zeros(names: Sequence[str], turning: Sequence[int]) -> Iterator[Hypothesis]:
    """Yield zeros that are off by quarter turns."""
    for j in turning:
        for quarters in _QUARTERS:
            offset = np.eye(len(names))[j] * quarters * np.pi / 2
            told = (("offset_rad", float(offset[j])),)
            yield Hypothesis("joint_zero", (names[j],), 3 * len(names), partial(_moved, by=offset), data=told)


def _pairs(names: Sequence[str]) -> Iterator[Hypothesis]:
    """Yield pairs of joints that are exchanged, or of which one reading holds the other."""
    count = len(names)
    pairs = list(combinations(range(count), 2))
    for a, b in pairs:
        order = np.arange(count)
        order[[a, b]] = b, a
        exchanged = _changed(partial(_in_order, order=order))
        yield Hypothesis("joints_exchanged", (names[a], names[b]), len(pairs), exchanged)
    for a, b in permutations(range(count), 2):
        for sign in (-1.0, 1.0):
            mixed = np.eye(count)
            mixed[b, a] = sign
            of = names[a], names[b], "-" if sign > 0 else "+"
            yield Hypothesis("joints_coupled", of, 4 * len(pairs), _changed(partial(_mixed, by=mixed)))


def _in_order(joints: Array, order: NDArray[np.int_]) -> Array:
    return joints[:, order]


def _mixed(joints: Array, by: Array) -> Array:
    return np.asarray(joints @ by)


def _shifted(rows: Measurements, by: int) -> Measurements:
    """Return the rows with the joint positions of the rows ``by`` further; those at the end are skipped."""
    wanted = np.arange(len(rows)) + by
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


def zero_mistakes(arm: RigidArm, data: Measurements, nominal: Array, at: Placement) -> Iterator[Hypothesis]:
    """Yield zeros of joints that a refined placement finds far off."""
    directions = arm.joint_derivatives(np.eye(len(nominal)))  # (p, joints)
    offsets = (at.values - nominal) @ directions / np.maximum((directions**2).sum(axis=0), 1e-300)
    for j in np.flatnonzero(np.abs(offsets) > _FAR_ZERO):
        offset = np.eye(len(offsets))[j] * offsets[j]
        corrected = partial(_moved, by=offset)
        of, size = data.joint_names[j], float(offsets[j])
        yield Hypothesis("joint_zero", (of,), 10 * len(offsets), corrected, data=(("offset_rad", size),))


def _moved(rows: Measurements, by: Array) -> Measurements:
    return replace(rows, joints=rows.joints + by)


def row_mistakes(
    arm: RigidArm, data: Measurements, at: Placement, ordinary_m: float, whole: Sequence[Hypothesis]
) -> Iterator[Hypothesis]:
    """Yield mistakes of single rows, and of all rows from one on, by how a placed arm misses them read otherwise.

    Args:
        data: points of the rows.
        at: the arm, placed among most of them.
        ordinary_m: a miss that a sound row has.
        whole: mistakes of all rows, which may be of a part of them.
    """
    far = at.misses > _CLEARLY * ordinary_m
    if not far.any():
        return
    for hypothesis in (*whole, *_exchanged_targets(data)):
        assert hypothesis.corrected is not None
        read = hypothesis.corrected(data)
        same = read.joints is data.joints
        predicted = at.predicted if same else arm.points(read.joints, at.values)
        better = far & (_CLEARLY * row_misses(read.points, predicted) < at.misses)
        yield from _in_a_part(hypothesis, data, better)
    yield from _exchanged_rows(data, at, far)
    yield from _stuck(arm, data, at, far)


def _exchanged_targets(data: Measurements) -> Iterator[Hypothesis]:
    """Yield exchanges of targets, which show where they are in some of the rows."""
    for order in permutations(range(min(len(data.targets), _MOST_TARGETS))):
        if list(order) == sorted(order):
            continue
        whole = [*order, *range(len(order), len(data.targets))]
        names = tuple(data.targets[k] for k in range(len(whole)) if whole[k] != k)

        def read(rows: Measurements, order: Sequence[int] = whole) -> Measurements:
            return replace(rows, points=rows.points[:, list(order)])

        yield Hypothesis("targets_exchanged", names, 1, read)


def _in_a_part(of: Hypothesis, data: Measurements, better: NDArray[np.bool_]) -> Iterator[Hypothesis]:
    """Yield a mistake in the rows from one on, or up to one; of targets, in single rows, too."""
    assert of.corrected is not None
    n, number, count = len(data), np.arange(len(data)), int(better.sum())
    if (cut := _stretch(better)) is not None and cut != (0, n - 1):
        which = (number >= cut[0]) & (number <= cut[1])
        ids: tuple[str, ...] = (data.ids[cut[0]], data.ids[cut[1]])
        told = (*of.data, ("rows", int(which.sum())))
        part = partial(_read_in_part, of.corrected, which)
        yield Hypothesis(of.name, (*of.of, *ids), n * of.alternatives, part, data=told)
    if of.name == "targets_exchanged" and 0 < count < n / 2:
        ids = tuple(data.ids[i] for i in np.flatnonzero(better))
        part = partial(_read_in_part, of.corrected, better)
        told = (("targets", len(of.of)),)
        yield Hypothesis("targets_exchanged_once", (*of.of, *ids), float(n) ** count, part, data=told)


def _read_in_part(correct: Correction, which: NDArray[np.bool_], rows: Measurements) -> Measurements:
    """Return the rows, some of them read otherwise."""
    read = correct(rows)
    use = tuple(one if here else other for one, other, here in zip(read.use, rows.use, which, strict=True))
    return replace(
        rows,
        joints=np.where(which[:, None], read.joints, rows.joints),
        points=np.where(which[:, None, None], read.points, rows.points),
        use=use,
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


def _stuck(arm: RigidArm, data: Measurements, at: Placement, far: NDArray[np.bool_]) -> Iterator[Hypothesis]:
    """Yield joints whose reading stays where it is while the joint moves; its positions follow from the points."""
    for j, name in enumerate(data.joint_names):
        still = np.concatenate([[False], np.diff(data.joints[:, j]) == 0])
        which = far & (still | np.append(still[1:], False))
        if which.sum() < _LEAST_STUCK or which.all():
            continue
        joints = data.joints.copy()
        joints[which, j] = _followed(arm, data.points[which], joints[which], j, at)
        better = _CLEARLY * row_misses(data.points[which], arm.points(joints[which], at.values)) < at.misses[which]
        if better.mean() > _MOSTLY:
            ids = [data.ids[i] for i in np.flatnonzero(which)]
            told = (("rows", int(which.sum())),)
            solved = partial(_with_joint, which=which, joint=j, positions=joints[which, j])
            yield Hypothesis("joint_stuck", (name, ids[0], ids[-1]), len(data) ** 2, solved, data=told)


def _with_joint(rows: Measurements, which: NDArray[np.bool_], joint: int, positions: Array) -> Measurements:
    joints = rows.joints.copy()
    joints[which, joint] = positions
    return replace(rows, joints=joints)


def _followed(arm: RigidArm, points: Array, joints: Array, joint: int, at: Placement) -> Array:
    """Return the position ``(m,)`` of one joint at which points are nearest, by Gauss-Newton from several starts."""
    best, misses = joints[:, joint], row_misses(points, arm.points(joints, at.values))
    for start in np.linspace(-np.pi, np.pi, _STARTS, endpoint=False):
        tried = joints.copy()
        tried[:, joint] += start
        for _ in range(_STUCK_STEPS):
            ahead = tried + _DIFFERENCE * np.eye(joints.shape[1])[joint]
            predicted = arm.points(tried, at.values)
            slope = np.nan_to_num((arm.points(ahead, at.values) - predicted) / _DIFFERENCE) * np.isfinite(points)
            left = np.nan_to_num(points - predicted)
            step = (slope * left).sum(axis=(1, 2)) / np.maximum((slope**2).sum(axis=(1, 2)), 1e-12)
            tried[:, joint] += np.clip(step, -0.5, 0.5)
        own = row_misses(points, arm.points(tried, at.values))
        best, misses = np.where(own < misses, tried[:, joint], best), np.fmin(own, misses)
    return best
