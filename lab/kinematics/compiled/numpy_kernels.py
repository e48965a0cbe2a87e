"""Kernels in numpy: the fallback without compiled ones, for elastic links and for complex numbers.

Every elementary motion of a chain turns about an axis or slides along it: a target's derivative is axis x lever, or the
axis. One walk along the chain gives all columns; a joint's derivative is that of its theta or d.
"""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from lab.core import se3
from lab.core.se3 import Array
from lab.kinematics.parameter import BASE_PARAMETERS
from lab.kinematics.serial.chain import Chain
from lab.kinematics.serial.walk import (
    RIGID,
    Axes,
    Displaced,
    ElementaryMotion,
    Torsors,
    along,
    chunks,
    fill,
    padded,
    some_poses,
)

__all__ = [
    "flange",
    "innovations",
    "joint_jacobian",
    "observe",
    "observe_stacked",
    "points",
    "points_stacked",
    "settle",
    "solve_systems",
    "states",
    "tool",
    "walk",
    "walk_stacked",
    "whiten",
]

_STEPS = 4
_NEAR = 1e-2  # m, rad: candidates farther from the pose are not refined
_EXACTLY = 1e-13


class _WalkedArm(Protocol):
    """Serial arm as the kernels need it: ``serial.arm.SerialArm``."""

    @property
    def chain(self) -> Chain:
        """The links and joints."""

    @property
    def targets(self) -> tuple[str, ...]:
        """Names of the targets."""

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the parameters."""

    @property
    def table_rows(self) -> NDArray[np.int_]:
        """Row of each parameter of the table."""

    @property
    def table_columns(self) -> NDArray[np.int_]:
        """Column of each parameter of the table."""

    def split(self, values: Array) -> tuple[Array, Array, Array]:
        """Base ``(6,)``, table ``(n, 5)`` and targets ``(k, 3)`` of a parameter vector."""

    def joint_derivatives(self, jacobian: Array) -> Array:
        """Derivatives ``(..., joints)`` by the joint positions, of those by the parameters."""


class _ManyArms(Protocol):
    """Arms of one nominal model: ``serial.arm.StackedArm``."""

    @property
    def arm(self) -> _WalkedArm:
        """The nominal model."""


def walk(
    arm: _WalkedArm, joints: Array, values: Array, torsors: Torsors = RIGID
) -> tuple[list[ElementaryMotion], tuple[Array, Array, Array], Array]:
    """Return all elementary motions, then the last frame's axes and origin, each ``(5, n)``."""
    base, table, _ = arm.split(values)
    frame = [padded(column) for column in se3.exp(base[3:]).T]
    origin = padded(base[:3])
    motions = [ElementaryMotion(i, padded(np.eye(3)[i]), None) for i in range(3)]
    motions += [
        ElementaryMotion(3 + i, padded(column), origin) for i, column in enumerate(se3.left_jacobian(base[3:]).T)
    ]
    flexible = Displaced(torsors, len(arm.names))
    links, last, end = along(arm.chain, (frame[0], frame[1], frame[2]), origin, table, joints.T, flexible)
    return motions + links, last, end


def flange(arm: _WalkedArm, joints: Array, values: Array) -> Array:
    """Poses ``(n, 4, 4)`` of the last frame."""
    _, frame, origin = walk(arm, joints, values)
    return _poses(frame, origin, len(joints))


def points(arm: _WalkedArm, /, joints: Array, values: Array, torsors: Torsors = RIGID) -> Array:
    """``SerialArm.points``."""
    out = np.empty((3, len(arm.targets), len(joints)), dtype=np.result_type(joints, values, *torsors.values()))
    for part in chunks(len(joints), len(arm.targets)):
        _, frame, origin = walk(arm, joints[part], values, some_poses(torsors, part))
        out[..., part] = _targets(arm, frame, origin, values)[:3]
    return out.transpose(2, 1, 0)


def observe(arm: _WalkedArm, /, joints: Array, values: Array, torsors: Torsors = RIGID) -> tuple[Array, Array]:
    """``SerialArm.observe``."""
    kind, count = np.result_type(joints, values, *torsors.values()), len(arm.targets)
    out = np.empty((3, count, len(joints)), dtype=kind)
    jacobian = np.zeros((len(arm.names) + 6 * len(torsors), 3, count, len(joints)), dtype=kind)
    for part in chunks(len(joints), count):
        motions, frame, origin = walk(arm, joints[part], values, some_poses(torsors, part))
        there = _targets(arm, frame, origin, values)
        out[..., part] = there[:3]
        fill(jacobian[..., part], motions, there)
        for k in range(count):
            first = len(arm.names) - 3 * (count - k)
            for column, axis in enumerate(frame, start=first):
                jacobian[column, :, k, part] = axis[:3]
    return out.transpose(2, 1, 0), jacobian.transpose(3, 2, 1, 0)


def joint_jacobian(arm: _WalkedArm, /, joints: Array, values: Array) -> Array:
    """``SerialArm.joint_jacobian``."""
    return arm.joint_derivatives(observe(arm, joints, values)[1])


def tool(
    arm: _WalkedArm, /, joints: Array, values: Array, target: int = 0, torsors: Torsors = RIGID
) -> tuple[Array, Array]:
    """``SerialArm.tool``."""
    kind = np.result_type(joints, values, *torsors.values())
    Ts, jacobian = np.empty((len(joints), 4, 4), dtype=kind), np.zeros((6, arm.chain.size, len(joints)), dtype=kind)
    for part in chunks(len(joints), 1):
        motions, frame, origin = walk(arm, joints[part], values, some_poses(torsors, part))
        position = _targets(arm, frame, origin, values)[:, target]
        Ts[part] = _poses(frame, position, len(joints[part]))
        for motion in motions:
            if motion.joint is None:
                continue
            column, axis = jacobian[:, motion.joint, part], arm.chain.sign[motion.joint] * motion.axis
            if motion.origin is None:
                column[:3] = axis[:3]
                continue
            lever = position - motion.origin
            column[:3] = axis[1:4] * lever[2:5] - axis[2:5] * lever[1:4]
            column[3:] = axis[:3]
    return Ts, jacobian.transpose(2, 0, 1)


def _targets(arm: _WalkedArm, frame: Sequence[Array], origin: Array, values: Array) -> Array:
    x, y, z = frame
    return np.stack([origin + px * x + py * y + pz * z for px, py, pz in arm.split(values)[2]], axis=1)


def _poses(frame: Sequence[Array], origin: Array, count: int) -> Array:
    poses = np.zeros((count, 4, 4), dtype=np.result_type(*frame, origin))
    for column, vector in enumerate((*frame, origin)):
        poses[:, :3, column] = vector[:3].T
    poses[:, 3, 3] = 1
    return poses


# Many arms


def walk_stacked(
    arm: _WalkedArm, joints: Array, values: Array, rows: int
) -> tuple[list[ElementaryMotion], Array, Axes]:
    """Return all motions, targets ``(rows, k, b, n)``, and the last frame's axes ``(rows, b, n)``: x y z (x y).

    Args:
        joints: ``(n, joints)`` of all arms, or ``(b, n, joints)`` of each.
        values: ``(b, p)``.
    """

    def stacked(vectors: Array) -> Array:
        return np.concatenate([vectors.T, vectors.T[: rows - 3]])[:, :, None]

    columns = values.T[:, :, None]  # (p, b, 1)
    first_tool = len(columns) - 3 * len(arm.targets)
    table = np.broadcast_to(arm.chain.table[:, :, None, None], (*arm.chain.table.shape, len(values), 1)).copy()
    table[arm.table_rows, arm.table_columns] = columns[len(BASE_PARAMETERS) : first_tool]
    base = values[:, : len(BASE_PARAMETERS)]
    axes = [stacked(column) for column in np.moveaxis(se3.exp(base[:, 3:]), 2, 0)]
    origin = stacked(base[:, :3])
    motions = [ElementaryMotion(i, stacked(np.eye(3)[None, i]), None) for i in range(3)]
    turning = np.moveaxis(se3.left_jacobian(base[:, 3:]), 2, 0)
    motions += [ElementaryMotion(3 + i, stacked(column), origin) for i, column in enumerate(turning)]
    each = np.moveaxis(joints if joints.ndim == 3 else joints[None], 2, 0)
    links, frame, end = along(arm.chain, (axes[0], axes[1], axes[2]), origin, table, each)
    places = columns[first_tool:].reshape(len(arm.targets), 3, len(values), 1)
    x, y, z = frame
    there = np.stack([end + px * x + py * y + pz * z for px, py, pz in places], axis=1)
    return motions + links, there, frame


def points_stacked(many: _ManyArms, /, joints: Array, values: Array) -> Array:
    """``StackedArm.points``."""
    return walk_stacked(many.arm, joints, values, 3)[1].transpose(2, 1, 0, 3)


def observe_stacked(many: _ManyArms, /, joints: Array, values: Array, free: Sequence[int]) -> tuple[Array, Array]:
    """``StackedArm.observe``."""
    motions, there, frame = walk_stacked(many.arm, joints, values, 5)
    slot = {parameter: i for i, parameter in enumerate(free)}
    jacobian = np.zeros((len(free), 3, *there.shape[1:]))
    wanted = [replace(motion, column=slot[motion.column]) for motion in motions if motion.column in slot]
    fill(jacobian, wanted, there)
    targets = len(many.arm.targets)
    first = len(many.arm.names) - 3 * targets
    for k in range(targets):
        for i, axis in enumerate(frame):
            if (column := first + 3 * k + i) in slot:
                jacobian[slot[column], :, k] = axis[:3]
    return there[:3].transpose(2, 1, 0, 3), jacobian


# Candidates of five joints


def settle(arm: _WalkedArm, /, values: Array, Ts: Array, joints: Array) -> tuple[Array, Array]:
    """``SerialArm.settle``."""
    count, many = joints.shape[:2]
    flat, each = joints.reshape(-1, 5).copy(), np.repeat(np.arange(count), many)
    apart = Ts[:, None] - flange(arm, flat, values).reshape(count, many, 4, 4)
    chord = np.sqrt((apart[..., :3, :3] ** 2).sum(axis=(2, 3)) / 8)  # sin(angle / 2)
    error = np.stack([np.sqrt((apart[..., :3, 3] ** 2).sum(axis=2)), 2 * np.arcsin(np.minimum(chord, 1.0))], axis=2)
    size = error.reshape(-1, 2)

    def missed(rows: NDArray[np.int_], at: Array) -> tuple[Array, Array]:
        (there, jacobian), wanted = tool(arm, at, values), Ts[each[rows]]
        turned = se3.log(wanted[:, :3, :3] @ there[:, :3, :3].swapaxes(1, 2))
        return np.concatenate([wanted[:, :3, 3] - there[:, :3, 3], turned], axis=1), jacobian

    rows = np.flatnonzero((size.max(axis=1) < _NEAR) & (size.max(axis=1) > _EXACTLY))
    missing, jacobian = missed(rows, flat[rows])
    for _ in range(_STEPS):
        if not rows.size:
            break
        normal = jacobian.swapaxes(1, 2) @ jacobian
        normal[:, range(5), range(5)] += 1e-15 * np.trace(normal, axis1=1, axis2=2)[:, None]
        step = np.linalg.solve(normal, jacobian.swapaxes(1, 2) @ missing[:, :, None])[:, :, 0]
        left, ahead = missed(rows, flat[rows] + step)
        better = np.linalg.norm(left, axis=1) < np.linalg.norm(missing, axis=1)
        rows, missing, jacobian = rows[better], left[better], ahead[better]
        flat[rows] += step[better]
        size[rows] = np.linalg.norm(missing.reshape(-1, 2, 3), axis=2)
        inexact = np.abs(missing).max(axis=1) > _EXACTLY
        rows, missing, jacobian = rows[inexact], missing[inexact], jacobian[inexact]
    hinges = ~np.array(arm.chain.prismatic)
    flat[:, hinges] -= 2 * np.pi * np.round(flat[:, hinges] / (2 * np.pi))
    return flat.reshape(joints.shape), error


# Errors that poses share, and small systems


def innovations(own: Array, observed: Array, through: Array, order: NDArray[np.int64]) -> tuple[Array, Array]:
    """``kernels.innovations``."""
    n, m, s = observed.shape
    factors, gains, spread = np.empty((n, m, m)), np.empty((n, s, m)), np.eye(s)
    for t in order.tolist():
        spread = through[t][:, None] * spread * through[t] + np.diag(1 - through[t] ** 2)
        pull = spread @ observed[t].T
        factors[t] = np.linalg.inv(np.linalg.cholesky(own[t] + observed[t] @ pull))
        gains[t] = pull @ factors[t].T
        spread = spread - gains[t] @ gains[t].T
    return factors, gains


def states(through: Array, order: NDArray[np.int64], columns: int) -> Iterator[tuple[int, Array]]:
    """Yield each pose in order of time, with the predicted state ``(s, columns)``, which the caller updates."""
    state = np.zeros((through.shape[1], columns))
    for t in order.tolist():
        state *= through[t][:, None]
        yield t, state


def whiten(
    factors: Array, observed: Array, gains: Array, through: Array, order: NDArray[np.int64], rows: Array
) -> Array:
    """``kernels.whiten``."""
    done = np.empty_like(rows)
    for t, state in states(through, order, rows.shape[2]):
        done[t] = factors[t] @ (rows[t] - observed[t] @ state)
        state += gains[t] @ done[t]
    return done


def solve_systems(matrices: Array, right: Array) -> Array:
    """``kernels.solve_positive``, by elimination."""
    return np.asarray(np.linalg.solve(matrices, right[:, :, None]), dtype=np.float64)[:, :, 0]
