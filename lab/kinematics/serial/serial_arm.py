"""Forward kinematics of a serial arm and its derivatives, batched over poses."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property, singledispatch
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from lab.core.errors import LabError
from lab.core.se3 import Array, exp, inverse, pose
from lab.kinematics.compiled import numpy_kernels
from lab.kinematics.compiled.kernels import CompiledChain, real, with_fallback
from lab.kinematics.differential import singular_distance
from lab.kinematics.gauge import preferred_columns
from lab.kinematics.model import Model, Skeleton
from lab.kinematics.parameter import BASE_PARAMETERS, Kind, Parameter, link_parameter, names_of, tool_parameters
from lab.kinematics.serial.chain import COLUMNS, Chain
from lab.kinematics.serial.walk import RIGID, ElementaryMotion, Torsors

__all__ = [
    "DEFAULT_TOOL",
    "BentArm",
    "SequentialBatch",
    "SerialArm",
    "Stacked",
    "StackedArm",
    "stacked",
    "target_positions",
]

DEFAULT_TOOL = {"p1": (0.030, 0.020, 0.100), "p2": (-0.025, 0.030, 0.080), "p3": (0.0, -0.040, 0.090)}

_KINDS: tuple[Kind, ...] = ("angle", "length", "length", "angle", "angle")  # of the table's columns


@dataclass(frozen=True)
class SerialArm:
    """A chain with a base in the tracker's frame and measured targets in its last frame.

    The parameters, in the order of ``names``: ``base.x y z rx ry rz`` (m; rotation vector, rad),
    ``link1.theta d a alpha`` (and ``beta`` where it exists) outward, ``tool.<target>.x y z`` (m).
    """

    chain: Chain
    targets: tuple[str, ...] = ("p1",)
    table_rows: NDArray[np.int_] = field(init=False, repr=False)  # the parameters' cells in the table
    table_columns: NDArray[np.int_] = field(init=False, repr=False)
    conditions: tuple[str, ...] = field(init=False, default=())

    def __post_init__(self) -> None:
        if not self.targets or len(set(self.targets)) < len(self.targets):
            raise LabError(f"targets {', '.join(self.targets) or '(none)'}: name at least one, and each once")
        cells = [
            (i, j) for i in range(self.chain.size) for j in range(5) if COLUMNS[j] != "beta" or self.chain.parallel[i]
        ]
        rows, columns = np.array(cells).T
        object.__setattr__(self, "table_rows", rows)
        object.__setattr__(self, "table_columns", columns)

    @cached_property
    def parameters(self) -> tuple[Parameter, ...]:
        """Parameters of the base, of the table row by row, and of the targets."""
        links = [
            link_parameter(
                f"link{i + 1}",
                COLUMNS[j],
                _KINDS[j],
                float(self.chain.table[i, j]),
                between_parallel_axes=self.chain.parallel[i] and COLUMNS[j] in ("alpha", "beta"),
            )
            for i, j in zip(self.table_rows.tolist(), self.table_columns.tolist(), strict=True)
        ]
        return (*BASE_PARAMETERS, *links, *tool_parameters(target_positions(self.targets)))

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Names of the parameters."""
        return names_of(self.parameters)

    def nominal(self, tool: dict[str, Array] | None = None) -> Array:
        """Return the nominal parameters: base at the tracker's origin, targets of ``tool``.

        A target without a position in ``tool`` (m, in the last frame) has that of the default tool, or the last frame's
        origin.
        """
        points = np.array(list(target_positions(self.targets, tool).values()))
        return self.assemble(np.zeros(6), self.chain.table, points)

    def assemble(self, base: Array, table: Array, tool: Array) -> Array:
        """Return the parameter vector of base ``(6,)``, table ``(n, 5)`` and target positions ``(k, 3)``."""
        return np.concatenate([base, table[self.table_rows, self.table_columns], np.ravel(tool)])

    def split(self, values: Array) -> tuple[Array, Array, Array]:
        """Return base ``(6,)``, table ``(n, 5)`` and targets ``(k, 3)`` of a parameter vector."""
        first_tool = len(values) - 3 * len(self.targets)
        table = self.chain.table.astype(values.dtype)
        table[self.table_rows, self.table_columns] = values[6:first_tool]
        return values[:6], table, values[first_tool:].reshape(len(self.targets), 3)

    def T_tracker_frame0(self, values: Array) -> Array:
        """Pose ``(4, 4)`` of frame 0 in the tracker's frame."""
        base = self.split(values)[0]
        return pose(exp(base[3:]), base[:3])

    @cached_property
    def _row(self) -> tuple[int]:
        return (self.chain.size,)

    def _checked(self, joints: Array) -> Array:
        if joints.shape[1:] != self._row:
            raise LabError(
                f"joints of shape {joints.shape} do not fit robot '{self.chain.name}': give (poses, {self.chain.size})"
            )
        return joints

    def _compilable(self, joints: Array, values: Array, torsors: Torsors = RIGID) -> bool:
        return not torsors and real(self._checked(joints), values)

    @with_fallback(numpy_kernels.points, when=_compilable)
    def points(self, joints: Array, values: Array, torsors: Torsors = RIGID) -> Array:
        """Return target positions ``(n, k, 3)`` in the tracker's frame (m) at joint positions ``(n, joints)``."""
        return self.compiled.points(joints, values)

    @with_fallback(numpy_kernels.observe, when=_compilable)
    def observe(self, joints: Array, values: Array, torsors: Torsors = RIGID) -> tuple[Array, Array]:
        """Return target positions ``(n, k, 3)`` and their derivatives ``(n, k, 3, parameters)``.

        Six further columns follow for each link with torsors.
        """
        return self.compiled.observe(joints, values)

    @with_fallback(numpy_kernels.joint_jacobian, when=_compilable)
    def joint_jacobian(self, joints: Array, values: Array) -> Array:
        """Return derivatives of the targets by the joint positions, ``(n, k, 3, joints)``."""
        return self.compiled.by_joints(joints, values, self._joint_slots)

    def joint_derivatives(self, jacobian: Array) -> Array:
        """Return the columns of derivatives ``(..., parameters)`` for the joint positions, ``(..., joints)``."""
        return np.asarray(jacobian[..., self.joint_columns] * self.chain.sign)

    @cached_property
    def joint_columns(self) -> list[int]:
        """Index of each joint's parameter that adds to its position: theta, or d of a slide."""
        cells = list(zip(self.table_rows.tolist(), self.table_columns.tolist(), strict=True))
        return [len(BASE_PARAMETERS) + cells.index((i, 1 if p else 0)) for i, p in enumerate(self.chain.prismatic)]

    def flange(self, joints: Array, values: Array) -> Array:
        """Return poses of the last frame in the tracker's frame, ``(n, 4, 4)``."""
        return numpy_kernels.flange(self, self._checked(joints), values)

    def _tool_compilable(self, joints: Array, values: Array, target: int = 0, torsors: Torsors = RIGID) -> bool:
        return self._compilable(joints, values, torsors)

    @with_fallback(numpy_kernels.tool, when=_tool_compilable)
    def tool(self, joints: Array, values: Array, target: int = 0, torsors: Torsors = RIGID) -> tuple[Array, Array]:
        """Return poses of a target with the rotation of the last frame, and the geometric Jacobian.

        Returns:
            ``(n, 4, 4)`` and ``(n, 6, joints)``: twist = J rates, with the target's velocity (m) and angular velocity
            (rad) in the tracker's frame. ``differential.rates`` inverts it.
        """
        return self.compiled.tool(joints, values, target)

    def singular_distance(self, joints: Array, values: Array, target: int = 0) -> tuple[Array, NDArray[np.int_]]:
        """Return ``RigidArm.singular_distance``."""
        return singular_distance(self.tool(joints, values, target)[1])

    def frame(self, joints: Array, values: Array, size: int) -> Array:
        """Return poses ``(n, 4, 4)`` of the frame ``size`` (from 1) in frame 0, at joint positions ``(n, joints)``."""
        part = SerialArm(self.dh_chain(values).first(size))
        return part.flange(joints[:, :size], part.nominal())

    def links(self, joints: Array, values: Array) -> Array:
        """Return the link matrices T_i-1,i ``(n, links, 4, 4)`` (m), without the base."""
        sizes = range(1, self.chain.size + 1)
        frames = np.stack([np.tile(np.eye(4), (len(joints), 1, 1)), *(self.frame(joints, values, i) for i in sizes)], 1)
        return np.asarray(inverse(frames[:, :-1]) @ frames[:, 1:])

    def motions(self, values: Array) -> list[ElementaryMotion]:
        """Return the chain's elementary motions at zero joint positions, base first."""
        return numpy_kernels.walk(self, np.zeros((1, self.chain.size)), values)[0]

    @property
    def rigid(self) -> "SerialArm":
        """The arm itself: it has no effects."""
        return self

    @property
    def groups(self) -> tuple[str, ...]:
        """Return no groups: the arm has no effects."""
        return ()

    def dh_chain(self, values: Array) -> Chain:
        """Return the chain with the links of these parameters ``(p,)``."""
        return self.chain.with_table(self.split(values)[1])

    def skeleton(self, joints: Array, values: Array) -> Skeleton:
        """Return the chain as one line with corners, in frame 0."""
        line = self.corners(joints, values)
        frames = line[:, ::2]
        return Skeleton([line], frames, frames, np.empty((len(joints), 0, 2, 3)), ())

    def corners(self, joints: Array, values: Array) -> Array:
        """Return the chain in frame 0 as a line ``(n, 2 joints + 1, 3)``; every other corner is a frame's origin.

        A link runs along its joint's axis and the common normal, in the order of its convention.
        """
        table = self.split(values)[1]
        corners = [np.zeros((len(joints), 3))]
        for size in range(1, self.chain.size + 1):
            Ts = self.frame(joints, values, size)
            origin, (_, d, a, _, beta) = Ts[:, :3, 3], table[size - 1]
            if self.chain.convention == "distal":
                corner = origin - a * (np.cos(beta) * Ts[:, :3, 0] + np.sin(beta) * Ts[:, :3, 2])  # x before beta
            else:
                reading = joints[:, size - 1] * self.chain.sign[size - 1] if self.chain.prismatic[size - 1] else 0.0
                corner = origin - np.atleast_1d(d + reading)[:, None] * Ts[:, :3, 2]
            corners += [corner, origin]
        return np.stack(corners, axis=1)

    def column_priority(self) -> tuple[int, ...]:
        """Return column indices in the order of preference of the canonical gauge (``gauge``)."""
        return self._column_priority

    @cached_property
    def _column_priority(self) -> tuple[int, ...]:
        return preferred_columns(self.chain, self.parameters)

    def structure_joints(self, count: int, rng: np.random.Generator) -> Array:
        """Draw joint positions for identifiability within the limits."""
        return self.chain.random_joints(count, rng)

    def rank_point(self, values: Array) -> Array:
        """Return ``values`` with nominally parallel axes exactly parallel, for decisions on rank."""
        turns, skews = self._parallel_columns
        found = values.copy()
        found[turns] = np.pi * np.round(found[turns] / np.pi)
        found[skews] = 0.0
        return found

    @cached_property
    def _parallel_columns(self) -> tuple[NDArray[np.int_], NDArray[np.int_]]:
        of_parallel = np.array(self.chain.parallel)[self.table_rows]
        turns, skews = (6 + np.flatnonzero(of_parallel & (self.table_columns == column)) for column in (3, 4))
        return turns, skews

    @with_fallback(numpy_kernels.settle)
    def settle(self, values: Array, Ts: Array, joints: Array) -> tuple[Array, Array]:
        """Refine inverse solutions ``(n, k, 5)`` of five joints near poses ``(n, 4, 4)`` by a few Gauss-Newton steps.

        Returns:
            Joint positions, and their errors ``(n, k, 2)``, m and rad.
        """
        return self.compiled.settle(values, Ts, joints)

    @cached_property
    def compiled(self) -> CompiledChain:
        """Chain for the compiled functions."""
        return CompiledChain(self.chain, len(self.targets), np.arange(len(self.names)))

    @cached_property
    def _joint_slots(self) -> NDArray[np.int64]:
        return self.compiled.some(self.joint_columns)


@dataclass(frozen=True)
class BentArm:
    """A serial arm with displaced ends of links, pose by pose."""

    arm: SerialArm
    torsors: Torsors

    def points(self, joints: Array, values: Array) -> Array:
        """``SerialArm.points``."""
        return self.arm.points(joints, values, self.torsors)

    def observe(self, joints: Array, values: Array) -> tuple[Array, Array]:
        """``SerialArm.observe``, with six more columns for each of the links."""
        return self.arm.observe(joints, values, self.torsors)

    def tool(self, joints: Array, values: Array, target: int = 0) -> tuple[Array, Array]:
        """``SerialArm.tool``."""
        return self.arm.tool(joints, values, target, self.torsors)


def target_positions(targets: Sequence[str], tool: Mapping[str, Array] | None = None) -> dict[str, Array]:
    """Return nominal positions ``(3,)`` (m, in the last frame) of targets: by ``tool``, the default tool, or zero."""
    positions = {**DEFAULT_TOOL, **(tool or {})}
    return {target: np.asarray(positions.get(target, (0.0, 0.0, 0.0))) for target in targets}


class Stacked(Protocol):
    """A stack of arms of one nominal model, for fits of many campaigns."""

    @property
    def arm(self) -> Model:
        """The nominal model and its targets."""

    def points(self, joints: Array, values: Array) -> Array:
        """Return target positions ``(b, k, 3, n)`` m.

        Args:
            joints: ``(n, joints)``, then columns of the model's conditions.
            values: parameters ``(b, p)``.
        """

    def observe(self, joints: Array, values: Array, free: Sequence[int]) -> tuple[Array, Array]:
        """Return the positions, and their derivatives ``(f, 3, k, b, n)`` by the ``free`` parameters."""


@singledispatch
def stacked(arm: Model) -> Stacked:
    """Return a stack of arms: a sequential one, unless one is registered for the kind of arm."""
    return SequentialBatch(arm)


@dataclass(frozen=True)
class SequentialBatch:
    """A stack of arms, computed one after the other."""

    arm: Model

    def points(self, joints: Array, values: Array) -> Array:
        """Return ``Stacked.points``."""
        return np.stack([self.arm.points(joints, row).transpose(1, 2, 0) for row in values])

    def observe(self, joints: Array, values: Array, free: Sequence[int]) -> tuple[Array, Array]:
        """Return ``Stacked.observe``."""
        both = [self.arm.observe(joints, row) for row in values]
        points = np.stack([points.transpose(1, 2, 0) for points, _ in both])
        columns = np.stack([jacobian[..., list(free)].transpose(3, 2, 1, 0) for _, jacobian in both], axis=3)
        return points, columns


@dataclass(frozen=True)
class StackedArm:
    """A stack of serial arms, computed at once."""

    arm: SerialArm

    def _compilable(self, joints: Array, values: Array, *_: Sequence[int]) -> bool:
        return real(joints, values)

    @with_fallback(numpy_kernels.points_stacked, when=_compilable)
    def points(self, joints: Array, values: Array) -> Array:
        """Return ``Stacked.points``."""
        code = self.arm.compiled
        return code.stacked(joints, values, code.every, 0)[0]

    @with_fallback(numpy_kernels.observe_stacked, when=_compilable)
    def observe(self, joints: Array, values: Array, free: Sequence[int]) -> tuple[Array, Array]:
        """Return ``Stacked.observe``."""
        code = self.arm.compiled
        points, columns = code.stacked(joints, values, code.some(list(free)), len(free))
        return points, columns.transpose(1, 3, 2, 0, 4)


@stacked.register
def _(arm: SerialArm) -> Stacked:
    return StackedArm(arm)
