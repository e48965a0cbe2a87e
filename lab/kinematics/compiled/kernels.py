"""Compiled kernels of ``kernels.c``, with numpy as a fallback.

A compiled walk of one pose takes some microseconds, in numpy half a millisecond for any number of poses.
``scripts/maintenance/build_kernels.py`` compiles it, which ``pip install`` runs.
"""

import importlib
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import wraps
from typing import Any, ParamSpec, TypeVar

import numpy as np
from numpy.typing import NDArray

from lab.core.se3 import Array
from lab.kinematics.compiled import numpy_kernels
from lab.kinematics.serial.chain import Chain

__all__ = [
    "CompiledChain",
    "compiled",
    "eight_solutions",
    "independent",
    "innovations",
    "planar_frame",
    "real",
    "solve_positive",
    "three_joints",
    "whiten",
    "with_fallback",
]

_VERSION = 10  # of kernels.c: other builds are ignored
_REAL = np.dtype(np.float64)
_NO_DERIVATIVES = np.empty(0)
_Columns = NDArray[np.int64]
_Flags = NDArray[np.bool_]
P = ParamSpec("P")
R = TypeVar("R")


def _loaded() -> Any:
    try:
        code = importlib.import_module("lab.kinematics.compiled.machine_code")
    except ImportError:
        return None
    return code if getattr(code, "VERSION", 0) == _VERSION else None


_CODE = _loaded()


def compiled() -> bool:
    """True if the package was built with a C compiler."""
    return _CODE is not None


def with_fallback(
    fallback: Callable[..., R], when: Callable[..., bool] | None = None
) -> Callable[[Callable[P, R]], Callable[P, R]]:
    """Run a compiled function if the package has it and ``when`` accepts the arguments, else ``fallback`` in numpy."""

    def decorate(fast: Callable[P, R]) -> Callable[P, R]:
        @wraps(fast)
        def chosen(*args: P.args, **kwargs: P.kwargs) -> R:
            if (when is None or when(*args, **kwargs)) and _CODE is not None:
                return fast(*args, **kwargs)
            return fallback(*args, **kwargs)

        return chosen

    return decorate


def real(first: Array, second: Array) -> bool:
    """Check that two arrays hold real numbers of 8 bytes."""
    return first.dtype == _REAL and second.dtype == _REAL


@dataclass(frozen=True)
class CompiledChain:
    """A rigid chain and its targets as the compiled functions take them.

    Attributes:
        targets: their number k.
        every: ``(p,)`` row of each parameter's derivative if all are computed.
    """

    chain: Chain
    targets: int
    every: _Columns
    _shape: _Columns = field(init=False, repr=False)
    _sign: Array = field(init=False, repr=False)
    _forward: bool = field(init=False, repr=False)

    def __post_init__(self) -> None:
        chain = self.chain
        counts = (chain.convention == "distal", chain.size, self.targets)
        object.__setattr__(self, "_shape", np.array([*counts, *chain.prismatic, *chain.parallel], dtype=np.int64))
        object.__setattr__(self, "_forward", bool((chain.sign > 0).all()))
        object.__setattr__(self, "_sign", np.ascontiguousarray(chain.sign, dtype=np.float64))

    def some(self, columns: list[int]) -> _Columns:
        """Return the row ``(p,)`` of each parameter if only these columns are computed; -1 for the others."""
        slot = np.full(len(self.every), -1, dtype=np.int64)
        slot[columns] = np.arange(len(columns))
        return slot

    def points(self, joints: Array, values: Array) -> Array:
        """Return ``SerialArm.points``."""
        points = np.empty((3, self.targets, len(joints)))
        given = np.ascontiguousarray(values), np.ascontiguousarray(joints)
        _CODE.observe(self._shape, self._sign, *given, self.every, points, _NO_DERIVATIVES)
        return points.T

    def observe(self, joints: Array, values: Array, slot: _Columns | None = None, rows: int = 0) -> tuple[Array, Array]:
        """Return ``SerialArm.observe``.

        Args:
            slot: ``(p,)`` row of each parameter's derivative, or -1; by default all are computed.
            rows: their number.
        """
        if slot is None:
            slot, rows = self.every, len(self.every)
        count = len(joints)
        points, jacobian = np.empty((3, self.targets, count)), np.empty((rows, 3, self.targets, count))
        given = np.ascontiguousarray(values), np.ascontiguousarray(joints)
        _CODE.observe(self._shape, self._sign, *given, slot, points, jacobian)
        return points.T, jacobian.T

    def oriented(
        self, joints: Array, values: Array, turn: Array, quaternions: Array, *, rates: bool
    ) -> tuple[Array, Array]:
        """Return positions with the rotation's error ``(n, k + 1, 3)``, and derivatives ``(n, k + 1, 3, p + 3)``.

        Args:
            turn: ``(3,)`` rotation vector (rad) of the measured frame in the last one.
            quaternions: ``(n, 4)`` measured.
            rates: compute derivatives.
        """
        points = np.empty((3, self.targets + 1, len(joints)))
        jacobian = np.empty((len(values) + 3 if rates else 0, *points.shape))
        given = (np.ascontiguousarray(each) for each in (values, turn, quaternions, joints))
        _CODE.oriented(self._shape, self._sign, *given, points, jacobian)
        return points.transpose(2, 1, 0), jacobian.transpose(3, 2, 1, 0)

    def by_joints(self, joints: Array, values: Array, slot: _Columns) -> Array:
        """Return ``SerialArm.joint_jacobian``; ``slot`` ``(p,)`` is the joint that adds to each parameter, or -1."""
        moved = self.observe(joints, values, slot, len(self._sign))[1]
        return moved if self._forward else moved * self._sign

    def tool(self, joints: Array, values: Array, target: int = 0) -> tuple[Array, Array]:
        """Return ``SerialArm.tool``."""
        n, size = joints.shape
        Ts, jacobian = np.empty((n, 4, 4)), np.empty((6, size, n))
        given = np.ascontiguousarray(values), np.ascontiguousarray(joints)
        _CODE.tool(self._shape, self._sign, *given, target, Ts, jacobian)
        return Ts, jacobian.transpose(2, 0, 1)

    def reach(
        self, start: Array, values: Array, positions: Array, rotations: Array, target: int
    ) -> tuple[Array, Array, _Columns]:
        """Return ``newton.reach`` of six joints and more: joint positions, errors ``(n, 6)`` and steps ``(n,)``.

        Args:
            rotations: ``(n, 3, 3)``; NaN for any rotation.
        """
        n = len(start)
        joints, errors, steps = np.empty(start.shape), np.empty((n, 6)), np.empty(n, dtype=np.int64)
        given = (np.ascontiguousarray(each) for each in (values, start, positions, rotations))
        _CODE.reach(self._shape, self._sign, *given, target, joints, errors, steps)
        return joints, errors, steps

    def settle(self, values: Array, Ts: Array, joints: Array) -> tuple[Array, Array]:
        """Return ``SerialArm.settle``."""
        settled, off = np.array(joints, order="C"), np.empty((*joints.shape[:2], 2))
        _CODE.settle(self._shape, self._sign, values, np.ascontiguousarray(Ts), settled, off)
        return settled, off

    def stacked(self, joints: Array, values: Array, slot: _Columns, rows: int) -> tuple[Array, Array]:
        """Return positions ``(b, k, 3, n)`` m and derivatives ``(b, rows, k, 3, n)`` of arms with parameters ``(b,
        p)``.

        Args:
            joints: ``(n, joints)`` of all arms, or ``(b, n, joints)`` of each.
        """
        b, n = len(values), joints.shape[-2]
        points, jacobian = np.empty((b, self.targets, 3, n)), np.empty((b, rows, self.targets, 3, n))
        given = np.ascontiguousarray(values), np.ascontiguousarray(joints)
        _CODE.stacked(self._shape, self._sign, *given, slot, points, jacobian)
        return points, jacobian


@with_fallback(numpy_kernels.innovations)
def innovations(own: Array, observed: Array, through: Array, order: _Columns) -> tuple[Array, Array]:
    """Return inverse Cholesky factors ``(n, m, m)`` of the innovations of a Kalman filter, and gains ``(n, s, m)``.

    Args:
        own: ``(n, m, m)`` covariances of each pose's own errors.
        observed: ``(n, m, s)`` effect of each state component on the observations.
        through: ``(n, s)`` autocorrelation of each component from the pose before.
        order: ``(n,)`` of the poses in time.

    Raises:
        LinAlgError: a variance is not positive.
    """
    n, m, s = observed.shape
    factors, gains = np.empty((n, m, m)), np.empty((n, s, m))
    if not _CODE.innovations(m, s, own, observed, through, order, factors, gains):
        raise np.linalg.LinAlgError("Matrix is not positive definite")
    return factors, gains


@with_fallback(numpy_kernels.whiten)
def whiten(factors: Array, observed: Array, gains: Array, through: Array, order: _Columns, rows: Array) -> Array:
    """Whiten rows ``(n, m, c)`` by the filter of ``innovations``."""
    done = np.empty_like(rows)
    _CODE.whiten(*observed.shape[1:], factors, observed, gains, through, order, rows, done)
    return done


def independent(columns: Array, order: _Columns, tolerance: float) -> NDArray[np.bool_]:
    """Flag, in ``order``, the columns ``(r, p)`` that earlier ones do not span: ``gauge._gram_schmidt``."""
    found = np.empty(len(order), dtype=np.int64)
    _CODE.independent(np.ascontiguousarray(columns.T), len(columns), order, tolerance, found)
    return found > 0


@with_fallback(numpy_kernels.solve_systems)
def solve_positive(matrices: Array, right: Array) -> Array:
    """Solve systems with symmetric matrices ``(b, f, f)`` and right sides ``(b, f)``.

    By Cholesky factors if all matrices are positive definite, else by elimination.
    """
    step = np.empty_like(right)
    if _CODE.cholesky(np.ascontiguousarray(matrices), right.shape[1], np.ascontiguousarray(right), step):
        return step
    return numpy_kernels.solve_systems(matrices, right)


# Closed forms of the inverse, by the numbers of an arm in the order of ``inverse.c``. Their numpy fallback is in the
# extension's classes.


def eight_solutions(shape: str, numbers: Array, Ts: Array, reference: Array | float) -> tuple[Array, Array, _Flags]:
    """Return joint positions ``(n, 8, 6)``, gaps ``(n, 8)`` and free joints of an arm of six joints.

    Args:
        shape: ``inverse`` for a spherical wrist, or ``three_parallel``.
        reference: joint positions ``(n, 6)`` of free joints.
    """
    n = len(Ts)
    joints, gap, free = np.empty((n, 8, 6)), np.empty((n, 8)), np.empty((n, 8, 6), dtype=np.bool_)
    getattr(_CODE, shape)(numbers, np.ascontiguousarray(Ts), _liked(reference, n, 6), joints, gap, free)
    return joints, gap, free


def three_joints(
    numbers: Array, Ts: Array, reference: Array | float, branches: int, *, tilted: bool
) -> tuple[Array, Array, Array, _Flags]:
    """Return joint positions ``(n, k, 3)``, gaps and tilts ``(n, k)``, and free joints of an arm of three joints."""
    n, k = len(Ts), branches
    joints, gap, free = np.empty((n, k, 3)), np.empty((n, k)), np.empty((n, k, 3), dtype=np.bool_)
    tilt = (np.empty if tilted else np.zeros)((n, k))
    given = numbers, np.ascontiguousarray(Ts), _liked(reference, n, 3)
    _CODE.three_joints(*given, joints, gap, tilt if tilted else None, free)
    return joints, gap, tilt, free


def _liked(reference: Array | float, count: int, joints: int) -> Array | None:
    if isinstance(reference, float) and reference == 0.0:
        return None
    return np.ascontiguousarray(np.broadcast_to(reference, (count, joints)), dtype=np.float64)


def planar_frame(numbers: Array, roots: int, Ts: Array, liked: Array) -> tuple[Array, _Flags]:
    """Return targets ``(5, m, n)`` of a planar arm beyond two joints, and poses with a free first joint."""
    found, free = np.empty((5, roots, len(Ts))), np.empty(len(Ts), dtype=np.bool_)
    _CODE.planar_frame(numbers, np.ascontiguousarray(Ts), np.ascontiguousarray(liked[:2].T), found, free)
    return found, free
