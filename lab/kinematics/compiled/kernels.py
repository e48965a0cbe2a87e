"""The functions of ``kernels.c``, as a build with a C compiler left them; numpy's do the same without.

numpy spends half a millisecond a walk on its calls alone, however few the poses. A compiled walk of one pose takes some
microseconds, and nothing has to be loaded or warmed up before: it serves at every size. ``scripts/build_kernels.py``
compiles it, which ``pip install`` runs.
"""

import importlib
from dataclasses import dataclass, field
from types import ModuleType

import numpy as np
from numpy.typing import NDArray

from lab.core.se3 import Array
from lab.kinematics.serial.chain import Chain

__all__ = ["CompiledChain", "machine_code", "solve_positive"]

_VERSION = 9  # of kernels.c: what an earlier build left behind is not taken
Columns = NDArray[np.int64]


def _loaded() -> ModuleType | None:
    try:
        code = importlib.import_module("lab.kinematics.compiled.machine_code")
    except ImportError:
        return None
    return code if getattr(code, "VERSION", 0) == _VERSION else None


_CODE = _loaded()


def machine_code() -> ModuleType | None:
    """The compiled functions; None where there are none."""
    return _CODE


@dataclass(frozen=True)
class CompiledChain:
    """A rigid chain and its targets as the compiled functions take them.

    Attributes:
        code: the compiled functions.
        targets: k, how many.
        every: ``(p,)`` which row of the derivatives each parameter takes, where all are wanted.
    """

    code: ModuleType
    chain: Chain
    targets: int
    every: Columns
    _shape: Columns = field(init=False, repr=False)
    _sign: Array = field(init=False, repr=False)
    _forward: bool = field(init=False, repr=False)

    def __post_init__(self) -> None:
        chain = self.chain
        counts = (chain.convention == "distal", chain.size, self.targets)
        object.__setattr__(self, "_shape", np.array([*counts, *chain.prismatic, *chain.parallel], dtype=np.int64))
        object.__setattr__(self, "_forward", bool((chain.sign > 0).all()))
        object.__setattr__(self, "_sign", np.ascontiguousarray(chain.sign, dtype=np.float64))

    def some(self, columns: list[int]) -> Columns:
        """``(p,)`` which row each parameter takes, where these columns are wanted: -1 for none."""
        slot = np.full(len(self.every), -1, dtype=np.int64)
        slot[columns] = np.arange(len(columns))
        return slot

    def observe(self, joints: Array, values: Array, slot: Columns, rows: int) -> tuple[Array, Array]:
        """Target positions ``(n, k, 3)`` m and derivatives ``(n, k, 3, rows)``: ``SerialArm.observe``.

        Args:
            joints: ``(n, joints)``.
            values: ``(p,)``.
            slot: ``(p,)`` which row each parameter's derivative takes, or -1.
            rows: so many, or 0 for positions alone.
        """
        points = np.empty((3, self.targets, len(joints)))
        jacobian = np.empty((rows, *points.shape))
        given = np.ascontiguousarray(values), np.ascontiguousarray(joints)
        self.code.observe(self._shape, self._sign, *given, slot, points, jacobian)
        return points.transpose(2, 1, 0), jacobian.transpose(3, 2, 1, 0)

    def oriented(
        self, joints: Array, values: Array, turn: Array, quaternions: Array, *, rates: bool
    ) -> tuple[Array, Array]:
        """Positions, then the rotation's error, ``(n, k + 1, 3)``; derivatives ``(n, k + 1, 3, p + 3)``: ``Poses``.

        Args:
            joints: ``(n, joints)``.
            turn: ``(3,)`` rotation vector (rad) of the measured frame in the last one.
            quaternions: ``(n, 4)`` measured.
            rates: whether derivatives are wanted.
        """
        points = np.empty((3, self.targets + 1, len(joints)))
        jacobian = np.empty((len(values) + 3 if rates else 0, *points.shape))
        given = (np.ascontiguousarray(each) for each in (values, turn, quaternions, joints))
        self.code.oriented(self._shape, self._sign, *given, points, jacobian)
        return points.transpose(2, 1, 0), jacobian.transpose(3, 2, 1, 0)

    def by_joints(self, joints: Array, values: Array, slot: Columns) -> Array:
        """Derivatives ``(n, k, 3, joints)`` of the targets by the joint positions: ``SerialArm.joint_jacobian``.

        Args:
            slot: ``(p,)`` the joint whose position adds to each parameter, or -1.
        """
        moved = self.observe(joints, values, slot, len(self._sign))[1]
        return moved if self._forward else moved * self._sign

    def tool(self, joints: Array, values: Array, target: int) -> tuple[Array, Array]:
        """Poses ``(n, 4, 4)`` and the geometric Jacobian ``(n, 6, joints)`` of a target: ``SerialArm.tool``."""
        n, size = joints.shape
        Ts, jacobian = np.empty((n, 4, 4)), np.empty((6, size, n))
        given = np.ascontiguousarray(values), np.ascontiguousarray(joints)
        self.code.tool(self._shape, self._sign, *given, target, Ts, jacobian)
        return Ts, jacobian.transpose(2, 0, 1)

    def reach(
        self, start: Array, values: Array, positions: Array, rotations: Array, target: int
    ) -> tuple[Array, Array, Columns]:
        """Joint positions ``(n, joints)``, what is missing there ``(n, 6)``, and steps ``(n,)``: ``newton.reach``.

        Of six joints and more.

        Args:
            start: ``(n, joints)``.
            positions: ``(n, 3)`` m.
            rotations: ``(n, 3, 3)``; NaN where any will do.
        """
        n = len(start)
        joints, errors, steps = np.empty(start.shape), np.empty((n, 6)), np.empty(n, dtype=np.int64)
        given = (np.ascontiguousarray(each) for each in (values, start, positions, rotations))
        self.code.reach(self._shape, self._sign, *given, target, joints, errors, steps)
        return joints, errors, steps

    def settle(self, values: Array, Ts: Array, joints: Array) -> tuple[Array, Array]:
        """Candidates ``(n, k, joints)`` and what they miss of poses ``(n, 4, 4)``: ``FiveAxes._settled``."""
        settled, off = np.array(joints, order="C"), np.empty((*joints.shape[:2], 2))
        self.code.settle(self._shape, self._sign, values, np.ascontiguousarray(Ts), settled, off)
        return settled, off

    def stacked(self, joints: Array, values: Array, slot: Columns, rows: int) -> tuple[Array, Array]:
        """Positions ``(b, k, 3, n)`` m and derivatives ``(b, rows, k, 3, n)`` of many arms.

        Args:
            joints: ``(n, joints)`` of all arms, or ``(b, n, joints)`` of each.
            values: ``(b, p)``.
        """
        b, n = len(values), joints.shape[-2]
        points, jacobian = np.empty((b, self.targets, 3, n)), np.empty((b, rows, self.targets, 3, n))
        given = np.ascontiguousarray(values), np.ascontiguousarray(joints)
        self.code.stacked(self._shape, self._sign, *given, slot, points, jacobian)
        return points, jacobian


def solve_positive(matrices: Array, right: Array) -> Array:
    """The solutions ``(b, f)`` of systems with symmetric matrices ``(b, f, f)`` and right sides ``(b, f)``.

    By Cholesky factors where all matrices are positive definite to rounding, else by elimination.
    """
    if _CODE is not None:
        step = np.empty_like(right)
        if _CODE.cholesky(np.ascontiguousarray(matrices), right.shape[1], np.ascontiguousarray(right), step):
            return step
    return np.asarray(np.linalg.solve(matrices, right[:, :, None]), dtype=np.float64)[:, :, 0]
