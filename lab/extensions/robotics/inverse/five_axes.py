"""Inverse kinematics of arms of five joints in closed form: all solutions of the poses that they can take.

A pose has six degrees of freedom, and five joints give it five; other poses get candidates, from which a search starts.
The shape with a closed form is that of most arms of five axes: joints 2 to 4 are a planar arm between a joint and a
last hinge. They turn about one direction w and do not change heights along it. So joints 1 and 5 alone make w fit: the
place of a point of axis 5 along w gives joint 1, and so does the angle between axis 5 and w (both equations of type 2,
of which the better conditioned one is taken). Joint 5 and the turn phi about w are what is left of the rotation, and
joints 2 to 4 the planar arm's. Candidates that meet the whole pose, to rounding after a few Gauss-Newton steps, are its
solutions.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from lab.core import se3
from lab.core.random import rng_for
from lab.core.se3 import Array
from lab.extensions.robotics.inverse.first_joints import FirstJoint, Named, turned_back
from lab.extensions.robotics.inverse.khalil_equations import TINY, type_2
from lab.extensions.robotics.inverse.planar import PlanarJoints
from lab.kinematics.compiled.kernels import planar_frame, with_fallback
from lab.kinematics.inverse.closed_form import EXACT, Determinant, Solutions, ZeroAxes, determinant, plane_across
from lab.kinematics.serial.chain import Chain
from lab.kinematics.serial.serial_arm import SerialArm

__all__ = ["FiveAxes"]

_REACHED = 1e-11
_CHUNK = 4096  # poses at a time: what fits the processor's cache

_PlanarFrame = tuple[Array, NDArray[np.bool_]]  # see FiveAxes._frame


@dataclass(frozen=True)
class FiveAxes:
    """Five joints of which 2 to 4 are a planar arm: hinges with parallel axes, or slides across them.

    Attributes:
        column: joint 1 where it is a hinge; of a slide its plane alone is used.
        joints: 2 to 4, and the point of axis 5 that they move.
        start: that point ``(3,)`` m in frame 0 at zero joint positions, and ``centre`` in the last frame.
    """

    chain: Chain
    arm: SerialArm
    axes: ZeroAxes
    column: FirstJoint
    joints: PlanarJoints
    start: Array
    centre: Array
    by_point: bool = False
    exact_only: bool = True
    numbered: bool = False
    moved: str = (
        "the displacements of a point of axis 5 and the turn about the parallel axes; the other joints turn the rest"
    )

    @classmethod
    def of(cls, chain: Chain) -> "FiveAxes | None":
        """Return the closed form of a nominal model; None where its shape has none."""
        if chain.size != 5:
            return None
        axes = ZeroAxes.of(chain)
        middle = [i for i in (1, 2, 3) if not axes.prismatic[i]]
        if not middle or axes.prismatic[4] or axes.parallel(middle[0], 4):
            return None
        w = axes.directions[middle[0]]
        along = abs(float(w @ axes.directions[0]))
        if (along <= EXACT) if axes.prismatic[0] else axes.parallel(middle[0], 0):
            return None
        start = axes.origins[4]
        centre = se3.transform(se3.inverse(axes.T_frame0_last), start[None])[0]
        plane = plane_across(w)
        joints = PlanarJoints.of(axes, (1, 2, 3), plane, start, axes.origins[0])
        column = FirstJoint.of(axes, plane)
        return None if joints is None else cls(chain, SerialArm(chain), axes, column, joints, start, centre)

    @property
    def branches(self) -> int:
        """Largest number of solutions for a pose."""
        return (1 if self.axes.prismatic[0] else 2) * self.joints.roots

    @property
    def determinant(self) -> Determinant:
        """Determinant of the place of the centre and of the turn about the parallel axes by joints 1 to 4."""
        lengths, factors = self._factors()
        plain = determinant(self.chain.joint_names, 1.0, lengths, factors)
        joints = rng_for(0, "structure").uniform(-1.0, 1.0, 5)
        value = np.linalg.det(self.rows(self.axes.jacobian(joints, self.centre)))
        return determinant(self.chain.joint_names, float(np.sign(value * plain.at(joints))), lengths, factors)

    def nearest_rotations(self, Rs_frame0_last: Array) -> Array:
        """See ``ClosedForm``: the nearest rotation depends on the place, so that rotations stay unchanged."""
        return Rs_frame0_last

    def solve(self, Ts_frame0_last: Array, reference: Array | float = 0.0) -> Solutions:
        """See ``ClosedForm``. Poses that the arm cannot take get the gap and the tilt of candidates."""
        count, shape = len(Ts_frame0_last), (len(Ts_frame0_last), self.branches)
        preferred = np.broadcast_to(reference, (count, 5)) * self.chain.sign
        frees = np.empty((*shape, 5), dtype=np.bool_)
        whole = Solutions(np.empty((*shape, 5)), np.empty(shape), np.empty(shape), frees)
        for start in range(0, count, _CHUNK):
            part = slice(start, start + _CHUNK)
            joints, whole.free[part] = self._candidates(Ts_frame0_last[part], preferred[part].T)
            joints, off = self.arm.settle(self._values, Ts_frame0_last[part], joints * self.chain.sign)
            size = off.max(axis=2)
            least = size.min(axis=1, keepdims=True)
            meets = size <= np.where(least <= _REACHED, _REACHED, EXACT)  # EXACT at singularities
            whole.joints[part] = joints
            whole.gap_m[part] = np.where(meets, 0.0, off[..., 0])
            whole.tilt_rad[part] = np.where(meets, 0.0, off[..., 1])
        return whole

    @cached_property
    def _values(self) -> Array:
        """The arm's parameters, with the target in the last frame's origin."""
        return self.arm.nominal({self.arm.targets[0]: np.zeros(3)})

    def _candidates(self, Ts: Array, preferred: Array) -> tuple[Array, NDArray[np.bool_]]:
        """Return candidates for poses ``(n, 4, 4)`` and which of their joints are free, each ``(n, branches, 5)``.

        Args:
            preferred: ``(5, n)`` reference of free joints.
        """
        (first, fifth, phi, e, f), free_1 = self._frame(Ts, preferred)
        values, _, free = self.joints.solve(e + 1j * f, phi, np.broadcast_to(preferred[1:4, None], (3, *first.shape)))
        out = np.empty((first.shape[1], self.joints.roots, first.shape[0], 5))  # (n, roots, m, 5)
        out[..., 0], out[..., 4] = first.T[:, None], fifth.T[:, None]
        frees = np.zeros(out.shape, dtype=np.bool_)
        frees[..., 0] = free_1[:, None, None]
        for i in range(3):
            out[..., i + 1], frees[..., i + 1] = values[:, i].transpose(2, 0, 1), free[i].T[:, None]
        shape = (len(out), -1, 5)
        return out.reshape(shape), frees.reshape(shape)

    def _frame_by_numpy(self, Ts: Array, preferred: Array) -> _PlanarFrame:
        plane, root = self.column.plane, self.column.root
        R = Ts[:, :3, :3] @ self.axes.T_frame0_last[:3, :3].T
        lever = (Ts[:, :3, :3] @ self.centre + Ts[:, :3, 3] - root).T
        first, free_1 = self._first(lever, (R @ self.axes.directions[4]).T, preferred[0])  # (m, n)
        if self.axes.prismatic[0]:
            e, f, _ = np.tensordot(plane, lever[:, None] - np.multiply.outer(self.column.axis, first), 1)
            back = R[None]
        else:
            back = se3.exp(-first[..., None] * self.column.axis) @ R
            e, f, _ = turned_back(self.column.split(lever), (np.cos(first), np.sin(first)))
        M = plane @ back @ plane.T
        a = plane @ self.axes.directions[4]
        fifth = _turn_about(a, M[..., 2, :])
        left = M @ se3.exp(-fifth[..., None] * a)
        phi = np.arctan2(left[..., 1, 0] - left[..., 0, 1], left[..., 0, 0] + left[..., 1, 1])
        return np.stack([first, fifth, phi, e, f]), free_1[0]

    @with_fallback(_frame_by_numpy)
    def _frame(self, Ts: Array, preferred: Array) -> _PlanarFrame:
        """Solve joints 1 and 5, and return the planar arm's targets.

        Returns:
            ``(5, m, n)``: positions of joints 1 and 5, the turn about w, and the place (m) in the plane; and ``(n,)``
            where joint 1 is free.
        """
        return planar_frame(self._numbers, 1 if self.axes.prismatic[0] else 2, Ts, preferred)

    @cached_property
    def _numbers(self) -> Array:
        """Arm parameters of the compiled frame."""
        axes, back = self.axes, self.axes.T_frame0_last[:3, :3]
        a5, plane = axes.directions[4], self.column.plane
        parts = (
            [float(axes.prismatic[0])], axes.directions[:2], axes.origins[:2], plane, plane @ back, self.centre,
            back.T @ a5, plane @ a5, self.start, [self._size, 0.0, 0.0, 0.0],
        )  # fmt: skip
        return np.concatenate([np.ravel(part) for part in parts])

    @property
    def _size(self) -> float:
        return max(float(np.abs(self.axes.origins - self.axes.origins[0]).max()), 1e-3)

    def _first(self, lever: Array, axis_5: Array, preferred: Array) -> tuple[Array, NDArray[np.bool_]]:
        """Solve joint 1 ``(m, n)`` by the equation that determines it best, and mark where it is free."""
        w = self.column.plane[2]
        offset = float(w @ (self.start - self.column.root))
        if self.axes.prismatic[0]:
            return ((w @ lever - offset) / (w @ self.column.axis))[None], np.zeros((1, lever.shape[1]), dtype=np.bool_)
        size = self._size
        equations = []
        for vector, height in ((lever / size, offset / size), (axis_5, float(w @ self.axes.directions[4]))):
            along, across, quarter = self.column.split(vector)
            equations.append((-quarter[2], across[2], height - along[2]))
        slopes = [x * x + y * y - z * z for x, y, z in equations]
        better = slopes[1] > slopes[0]
        x, y, z = (np.where(better, *pair[::-1]) for pair in zip(*equations, strict=True))
        (first,), _, (free,) = type_2(x, y, z, TINY, preferred)
        return first, np.broadcast_to(free, first.shape)

    def _factors(self) -> tuple[list[float], list[Named]]:
        """Factor the determinant, but for its sign: lengths (m), and named factors."""
        sign = self.axes.sign
        lengths, factors = self.joints.factors(sign)
        if self.axes.prismatic[0]:
            return [*lengths, abs(float(self.column.plane[2] @ self.column.axis))], factors
        return lengths, [*factors, ("shoulder", self.joints.place_along(self.column.level, sign))]

    def rows(self, jacobian: Array) -> Array:
        """Return the square part of a Jacobian ``(6, 5)`` of the centre that has this determinant."""
        hinge = next(i for i in (1, 2, 3) if not self.axes.prismatic[i])
        return np.concatenate([jacobian[:3, :4], (jacobian[3:, hinge] @ jacobian[3:, :4])[None]])


def _turn_about(axis: Array, seen: Array) -> Array:
    """Return turns q ``(...)`` with Rot(axis, -q) e3 nearest to directions ``(..., 3)``, for an axis not along e3."""
    e3 = np.array([0.0, 0.0, 1.0])
    level = e3 - axis * axis[2]
    ahead = np.cross(axis, e3)
    return np.asarray(np.arctan2(-(seen @ ahead), seen @ level))
