"""Evaluate an arm with parameter values on plain arrays, with any leading axes.

It is built once, and then runs at the kernels' speed. Lengths are in m, angles in rad.
"""

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from lab.core import se3
from lab.core.errors import LabError
from lab.core.se3 import Array
from lab.kinematics.compiled.kernels import CompiledChain, compiled
from lab.kinematics.effects.arm_with_effects import Arm
from lab.kinematics.inverse.branches import NominalInverse, nearest_whole_turns
from lab.kinematics.inverse.closed_form import ClosedForm
from lab.kinematics.inverse.newton_inverse import FREEDOMS, PoseTarget, reach
from lab.kinematics.serial.serial_arm import SerialArm

__all__ = ["ArrayArm", "as_numbers", "with_leading_axes"]

_TURNED_RAD = 1e-6  # largest rotation error of a solution of an arm with fewer than six joints
_FEW = 100  # numbers whose sum in Python takes less time than numpy's check of each


@dataclass(frozen=True, eq=False)
class ArrayArm:
    """An arm with parameter values.

    Attributes:
        arm: the arm as equations, of which every array of parameters has the order.
        values: ``(p,)`` parameters, unless a call gives others.
        nominal: ``(p,)`` those of the nominal model.
    """

    arm: Arm
    values: Array
    nominal: Array

    @cached_property
    def inputs(self) -> tuple[str, ...]:
        """Names of the columns of ``joints``: the joints, then the conditions of effects."""
        return (*self.arm.rigid.chain.joint_names, *self.arm.conditions)

    @cached_property
    def _row(self) -> tuple[int, ...]:
        """Shape of one configuration."""
        return (len(self.inputs),)

    @cached_property
    def _compiled_chain(self) -> CompiledChain | None:
        return self.arm.compiled if isinstance(self.arm, SerialArm) else None

    @property
    def _fast(self) -> Arm | CompiledChain:
        """The arm, or its compiled chain, which lacks the checks that are made here."""
        chain = self._compiled_chain
        return self.arm if chain is None or not compiled() else chain

    def rows(self, joints: ArrayLike, argument: str = "joints") -> tuple[Array, tuple[int, ...]]:
        """Return joint positions as rows ``(n, inputs)``, and the leading axes that they came with.

        Raises:
            LabError: their last axis has another length, or they are not finite.
        """
        numbers = as_numbers(argument, joints)
        shape = numbers.shape
        if shape[-1:] != self._row:
            width = len(self.inputs)
            raise LabError(
                f"{argument} have shape {shape}; give ({width},) or (..., {width}) finite numbers: "
                f"{', '.join(self.inputs)}"
            )
        if not _finite(numbers):
            first = tuple(np.argwhere(~np.isfinite(numbers))[0].tolist())
            raise LabError(f"{argument}: {self.inputs[first[-1]]} is {numbers[first]}; give a finite number")
        return numbers[None] if len(shape) == 1 else numbers.reshape(-1, *self._row), shape[:-1]

    def parameters(self, values: ArrayLike | None) -> Array:
        """Return parameters ``(p,)``: given ones, checked, or the arm's own.

        Raises:
            LabError: they have another shape or are not finite.
        """
        if values is None:
            return self.values
        numbers = as_numbers("values", values)
        if numbers.shape != self.values.shape or not _finite(numbers):
            raise LabError(
                f"values have shape {numbers.shape}; give {len(self.values)} finite numbers in the order of "
                "parameter_names()"
            )
        return numbers

    def points(self, joints: ArrayLike, values: ArrayLike | None = None) -> Array:
        """Return the positions ``(..., k, 3)`` of the targets at joint positions ``(..., inputs)``."""
        rows, leading = self.rows(joints)
        return with_leading_axes(leading, self._fast.points(rows, self.parameters(values)))

    def poses(self, joints: ArrayLike, values: ArrayLike | None = None) -> Array:
        """Return the poses ``(..., 4, 4)`` of the first target, with the orientation of the last frame."""
        rows, leading = self.rows(joints)
        return with_leading_axes(leading, self._fast.tool(rows, self.parameters(values))[0])

    def jacobian(self, joints: ArrayLike, values: ArrayLike | None = None) -> Array:
        """Return the geometric Jacobian ``(..., 6, joints)`` of the first target."""
        rows, leading = self.rows(joints)
        return with_leading_axes(leading, self._fast.tool(rows, self.parameters(values))[1])

    def parameter_jacobian(self, joints: ArrayLike, values: ArrayLike | None = None) -> Array:
        """Return the derivatives ``(..., k, 3, p)`` of the positions by the parameters."""
        rows, leading = self.rows(joints)
        return with_leading_axes(leading, self._fast.observe(rows, self.parameters(values))[1])

    def inverse(self, poses: ArrayLike, near: ArrayLike | None = None) -> Array:
        """Return joint positions at which the first target has some poses; NaN where there are none.

        Args:
            poses: ``(..., 4, 4)``.
            near: ``(..., inputs)`` or ``(inputs,)``, of which the nearest solution is returned; without it all.

        Returns:
            ``(..., k, joints)`` all solutions in closed form; ``(..., joints)`` with ``near``.
        """
        Ts = as_numbers("poses", poses)
        if Ts.shape[-2:] != (4, 4) or not _finite(Ts):
            raise LabError(f"poses have shape {Ts.shape}; give (4, 4) or (..., 4, 4) finite numbers")
        leading, Ts = Ts.shape[:-2], Ts.reshape(-1, 4, 4)
        if near is None:
            return with_leading_axes(leading, self._solutions(Ts, 0.0))
        start = self.rows(near, "near")[0]
        if len(start) not in (1, len(Ts)):
            raise LabError(f"near has {len(start)} rows for {len(Ts)} poses; give one, or one of each pose")
        start = np.broadcast_to(start, (len(Ts), len(self.inputs)))
        found = self._followed(Ts, start) if self._closed_form is None else self._nearest(Ts, start)
        return with_leading_axes(leading, found)

    @cached_property
    def _nominal_inverse(self) -> NominalInverse:
        """The inverse of the rigid arm; its closed form is built once."""
        return NominalInverse(self.arm.rigid, self.values[: len(self.arm.rigid.names)])

    @cached_property
    def _closed_form(self) -> ClosedForm | None:
        """The closed form of the inverse; None with effects, or without one."""
        return None if self.arm.groups else self._nominal_inverse.closed_form

    @cached_property
    def _T_frame0_world(self) -> Array | None:
        """Pose of the frame of the points in the arm's frame 0; None where they are one."""
        T = self.arm.rigid.T_tracker_frame0(self.values)
        return None if np.array_equal(T, np.eye(4)) else se3.inverse(T)

    @cached_property
    def _T_target_last(self) -> Array:
        """Pose of the last frame in the first target, which has its orientation."""
        return se3.pose(np.eye(3), -self._nominal_inverse.tools[0])

    def _solutions(self, Ts: Array, reference: Array | float) -> Array:
        """Return all solutions ``(n, k, joints)`` in closed form, NaN where there are fewer."""
        form = self._closed_form
        if form is None:
            raise LabError("the inverse of this arm has no closed form; give near=, joint positions to start from")
        # from the target to the last frame, and from the frame of the points to frame 0
        last = Ts @ self._T_target_last
        if self._T_frame0_world is not None:
            last = self._T_frame0_world @ last
        # what misses the position, or the rotation with fewer than six joints, is no solution
        solved = form.solve(last, reference)
        missed = solved.gap_m > 0
        if self.arm.rigid.chain.size < FREEDOMS:
            missed |= solved.tilt_rad > _TURNED_RAD
        solved.joints[missed] = np.nan
        return solved.joints

    def _nearest(self, Ts: Array, near: Array) -> Array:
        """Return the solutions ``(n, joints)`` in closed form that are nearest to others."""
        solutions = nearest_whole_turns(self.arm.rigid.chain, self._solutions(Ts, near), near[:, None])
        distances = np.abs(solutions - near[:, None]).max(axis=2)
        best = np.where(np.isnan(distances), np.inf, distances).argmin(axis=1)
        return np.asarray(solutions[np.arange(len(Ts)), best])

    def _followed(self, Ts: Array, near: Array) -> Array:
        """Return the ends ``(n, joints)`` of Newton's method from joint positions; NaN where it does not arrive."""
        size = self.arm.rigid.chain.size
        wanted = PoseTarget(Ts[:, :3, 3], Ts[:, :3, :3])
        ended = reach(self.arm, self.values, wanted, near[:, :size].copy(), near[:, size:])
        turned_off = np.linalg.norm(ended.errors[:, 3:], axis=1)
        return np.where((ended.arrived & (turned_off < _TURNED_RAD))[:, None], ended.joints, np.nan)


def as_numbers(argument: str, values: ArrayLike) -> Array:
    """Return an argument as an array of real numbers.

    Raises:
        LabError: it is none.
    """
    try:
        if np.iscomplexobj(values):
            raise LabError(f"{argument}: complex numbers; give real ones")
        return np.asarray(values, dtype=np.float64)
    except LabError:
        raise
    except (TypeError, ValueError) as error:
        raise LabError(f"{argument}: not numbers in rows of one length ({error})") from None


def with_leading_axes(leading: tuple[int, ...], results: Array) -> Array:
    """Return results ``(n, ...)`` with the leading axes ``leading``, whose product is n."""
    if not leading:
        first: Array = results[0]
        return first
    return results if len(leading) == 1 else results.reshape(*leading, *results.shape[1:])


def _finite(numbers: Array) -> bool:
    """Check that all numbers are finite: a few by their sum, unless it overflows, and many one by one."""
    if numbers.size <= _FEW:
        few = numbers if numbers.ndim == 1 else numbers.ravel()
        if math.isfinite(sum(few.tolist())):
            return True
    return bool(np.isfinite(numbers).all())
