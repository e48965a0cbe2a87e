"""Inverse kinematics of six-axis arms with a spherical wrist or three parallel axes, in closed form.

Everything is worked out from the joints' axes at zero joint positions, so that the table's convention, its signs and
zeros do not matter. A vector is an array of three rows, a pose in each column.

Spherical wrist: the last three axes meet at right angles, each to the next. The wrist's centre is moved by joints 1 to
3 alone (``first_joints``); what is left of the rotation is the wrist's, by equations of types 2, 3 and 3 (Pieper 1968;
Khalil & Dombre 2002, section 4.3).

Three parallel axes: six hinges of which axes 2, 3 and 4 are parallel, as Universal Robots' are, with all eight
solutions. Axis 5 is square to axis 4, axis 6 to axis 5, and axes 5 and 6 meet in a point P. Joints 2 to 4 turn about
one direction w: they do not move P along w, so that P alone gives joint 1 (an equation of type 2). What joint 1 leaves
of the rotation is Rot(w, phi) Rot(a5, q5) Rot(a6, q6) with phi the sum of joints 2 to 4: the turn of axis 6 out of w is
joint 5, and the turns before and after it are phi and joint 6. Then joints 2 and 3 are a planar arm (type 8), and joint
4 is what is left of phi (Hawkins 2013, analytic inverse kinematics for the Universal Robots UR-5/UR-10 arms).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from lab.core import se3
from lab.core.se3 import Array
from lab.extensions.robotics.inverse.first_joints import (
    BEND,
    Carried,
    Carrier,
    Elbow,
    FirstJoint,
    carrier_of,
    turned_back,
)
from lab.extensions.robotics.inverse.khalil_equations import TINY, type_2, type_8
from lab.kinematics.compiled.kernels import eight_solutions, with_fallback
from lab.kinematics.inverse.closed_form import (
    EXACT,
    Determinant,
    Solutions,
    Term,
    ZeroAxes,
    determinant,
    in_plane,
    meeting_point,
    plane_across,
    real_part,
)
from lab.kinematics.serial.chain import Chain

__all__ = ["SphericalWrist", "ThreeParallel"]

_Number = TypeVar("_Number", np.float64, np.bool_)
_CHUNK = 1024  # poses at a time: what fits the processor's cache


@dataclass(frozen=True)
class SphericalWrist:
    """An arm with a spherical wrist, by its axes in frame 0 at zero joint positions.

    Attributes:
        carrier: joints 1 to 3.
        axes: ``(3, 3)`` rows a, b and c: along axes 4 and 5, and across both.
        bend: axis 6 is a cos(bend) + c sin(bend).
        centre: the wrist's centre ``(3,)`` in the last frame (m).
        R_frame0_last: rotation ``(3, 3)`` of the last frame.
    """

    chain: Chain
    carrier: Carrier
    axes: Array
    bend: float
    centre: Array
    R_frame0_last: Array
    by_point: bool = False
    exact_only: bool = False
    numbered: bool = True
    moved: str = "the displacements of the wrist's centre and all turns"

    @classmethod
    def of(cls, chain: Chain) -> "SphericalWrist | None":
        """Return the closed form of a nominal model; None where its shape is another."""
        if chain.size != 6 or any(chain.prismatic[3:]):
            return None
        joint_axes = ZeroAxes.of(chain)
        z = joint_axes.directions
        centre, missed = meeting_point(joint_axes.origins[3:], z[3:])
        if missed > EXACT or not joint_axes.square(3, 4) or not joint_axes.square(4, 5):
            return None
        carrier = carrier_of(joint_axes, centre)
        if carrier is None:
            return None
        axes = np.array([z[3], z[4], np.cross(z[3], z[4])])
        T = joint_axes.T_frame0_last
        return cls(
            chain=chain,
            carrier=carrier,
            axes=axes,
            bend=float(np.arctan2(axes[2] @ z[5], axes[0] @ z[5])),
            centre=se3.transform(se3.inverse(T), centre[None])[0],
            R_frame0_last=T[:3, :3],
        )

    @property
    def branches(self) -> int:
        """Number of roots of the wrist's, the elbow's and joint 1's equations."""
        return 2 * self.carrier.elbows * 2

    @property
    def determinant(self) -> Determinant:
        """Determinant of the geometric Jacobian at the wrist's centre: the carrier's times the wrist's."""
        sign, lengths, factors = self.carrier.factors(self.chain.sign)
        s5 = float(self.chain.sign[4])
        wrist = [
            Term(-s5 * float(np.cos(self.bend)), "sin", ((4, 1.0),)),  # sin(bend - angle 5)
            Term(float(np.sin(self.bend)), "cos", ((4, 1.0),)),
        ]
        product = [factors[0], ("wrist", wrist), *factors[1:]]
        return determinant(self.chain.joint_names, sign * float(np.prod(self.chain.sign)), lengths, product)

    def nearest_rotations(self, Rs_frame0_last: Array) -> Array:
        """See ``ClosedForm``: six joints take any rotation."""
        return Rs_frame0_last

    def _solved(self, Ts_frame0_last: Array, reference: Array | float = 0.0) -> Solutions:
        """Solve by numpy, for any carrier."""
        count, shape = len(Ts_frame0_last), (2, self.carrier.elbows, 2)
        preferred = np.broadcast_to(reference, (count, 6)) * self.chain.sign
        angles, gap = np.empty((6, *shape, count)), np.empty((*shape, count))
        free = np.zeros((6, *shape, count), dtype=np.bool_)
        for start in range(0, count, _CHUNK):
            part = slice(start, start + _CHUNK)
            self._solve(Ts_frame0_last[part], preferred[part].T, angles[..., part], gap[..., part], free[..., part])
        for i in np.flatnonzero(~np.array(self.chain.prismatic)):
            angles[i] -= 2 * np.pi * np.round(angles[i] / (2 * np.pi))
        angles *= self.chain.sign.reshape(6, 1, 1, 1, 1)
        tilt = np.zeros((count, self.branches))
        return Solutions(_by_pose(angles), gap.reshape(self.branches, count).T, tilt, _by_pose(free))

    @with_fallback(_solved, when=lambda self, *_: isinstance(self.carrier, Elbow))
    def solve(self, Ts_frame0_last: Array, reference: Array | float = 0.0) -> Solutions:
        """See ``ClosedForm``."""
        joints, gap, free = eight_solutions("inverse", self._numbers, Ts_frame0_last, reference)
        return Solutions(joints, gap, np.zeros(gap.shape), free)

    @cached_property
    def _numbers(self) -> Array:
        """Arm parameters of the compiled solution for an arm with an elbow."""
        carrier = self.carrier
        assert isinstance(carrier, Elbow)
        column, back = carrier.column, self.R_frame0_last.T
        axis_6 = np.cos(self.bend) * self.axes[0] + np.sin(self.bend) * self.axes[2]
        links = [(abs(z), np.angle(z)) for z in (carrier.upper, carrier.fore)]
        parts = (
            self.chain.sign, self.centre, column.root, column.parts, self.axes @ column.plane.T, back @ self.axes[1],
            back @ axis_6, [self.bend, carrier.offset, carrier.shoulder.real, carrier.shoulder.imag],
            links, [carrier.turning],
        )  # fmt: skip
        return np.concatenate([np.ravel(part).astype(np.float64) for part in parts])

    def _solve(self, Ts: Array, preferred: Array, angles: Array, gap: Array, free: NDArray[np.bool_]) -> None:
        """Fill in the angles ``(6, 2, elbows, 2, n)``: roots of the wrist's, the elbow's and joint 1's equation."""
        R = Ts[:, :3, :3].transpose(1, 2, 0)  # (3, 3, n)
        position = _turned(R, self.centre) + Ts[:, :3, 3].T
        carried = self.carrier.solve(position, preferred[:3], angles[:3], gap, free[:3])
        self._turn(R, carried, preferred[3:], angles[3:], free[3:])

    def _turn(self, R: Array, carried: Carried, preferred: Array, angles: Array, free: NDArray[np.bool_]) -> None:
        """Fill in the wrist's angles ``(3, 2, elbows, 2, n)``."""
        rows = self.axes @ self.carrier.column.plane.T

        def in_wrist(direction: Array) -> list[Array]:
            """Return the wanted image of a direction of the arm at zero, along a, b and c."""
            back = carried.back(_turned(R, self.R_frame0_last.T @ direction))
            return [_sum(row, back) for row in rows]

        axis_6 = np.cos(self.bend) * self.axes[0] + np.sin(self.bend) * self.axes[2]
        a6, b6, c6 = in_wrist(axis_6)
        a5, b5, c5 = in_wrist(self.axes[1])
        (angles[0],), _, (free[0],) = type_2(c6, b6, 0.0, TINY, preferred[0])  # b . Rot(a, -q4) axis 6 = 0
        cos_4, sin_4 = np.cos(angles[0]), np.sin(angles[0])
        sin_5 = b6 * sin_4 - c6 * cos_4
        angles[1] = self.bend + np.arctan2(sin_5, a6)  # type 3, as is the next
        angles[2] = np.arctan2(sin_5 * a5 + a6 * (c5 * cos_4 - b5 * sin_4), b5 * cos_4 + c5 * sin_4)


def _by_pose(values: NDArray[_Number]) -> NDArray[_Number]:
    """Reshape ``(6, 2, elbows, 2, n)`` to ``(n, branches, 6)``."""
    return values.reshape(len(values), -1, values.shape[-1]).transpose(2, 1, 0)


def _turned(R: Array, vector: Array) -> Array:
    """Turn a vector ``(3,)`` by each of the rotations ``(3, 3, n)``."""
    return np.stack([_sum(vector, row) for row in R])


def _sum(weights: Array, rows: Sequence[Array]) -> Array:
    """Return a weighted sum, without terms of no weight."""
    used = [weight * row for weight, row in zip(weights, rows, strict=True) if abs(weight) > TINY]
    total: Array = sum(used[1:], start=used[0]) if used else 0.0 * rows[0]
    return total


def _turn_in_parallel(axes: ZeroAxes) -> bool:
    """Check that axes 2, 3 and 4 are parallel, axis 1 is not, and axes 4, 5 and 6 are square, each to the next."""
    parallel = axes.parallel(1, 2) and axes.parallel(1, 3) and not axes.parallel(0, 1)
    return bool(parallel and axes.square(3, 4) and axes.square(4, 5))


@dataclass(frozen=True)
class ThreeParallel:
    """An arm with three parallel axes, by its axes in frame 0 at zero joint positions.

    Attributes:
        column: joint 1, and the plane of joints 2 to 4: rows e = a5 x w, f = a5 and w.
        turning: ``(2,)`` 1 where axis 3, and axis 4, points as w does, else -1.
        shoulder, upper, fore, hand: in the plane (m): axis 2 from the root of axis 1, axis 3 from axis 2, axis 4 from
            axis 3, and P from axis 4.
        offset: P from the root, along w (m).
        bend: axis 6 is w cos(bend) + e sin(bend).
        centre: P ``(3,)`` in the last frame (m).
        R_frame0_last: rotation ``(3, 3)`` of the last frame.
    """

    chain: Chain
    column: FirstJoint
    turning: tuple[float, float]
    shoulder: complex
    upper: complex
    fore: complex
    hand: complex
    offset: float
    bend: float
    centre: Array
    R_frame0_last: Array
    branches: int = 8
    by_point: bool = False
    exact_only: bool = False
    numbered: bool = True
    moved: str = "the displacements of the wrist's centre and all turns"

    @classmethod
    def of(cls, chain: Chain) -> "ThreeParallel | None":
        """Return the closed form of a nominal model; None where its shape is another."""
        if chain.size != 6 or any(chain.prismatic):
            return None
        axes = ZeroAxes.of(chain)
        z, origins = axes.directions, axes.origins
        point, missed = meeting_point(origins[4:], z[4:])
        if missed > EXACT or not _turn_in_parallel(axes):
            return None
        w = z[1]
        plane = plane_across(w, np.cross(z[4], w))
        places = (origins[0], origins[1], origins[2], origins[3], point)
        shoulder, upper, fore, hand = (in_plane(plane, b - a) for a, b in pairwise(places))
        if min(abs(upper), abs(fore)) < EXACT:
            return None
        T = axes.T_frame0_last
        return cls(
            chain=chain,
            column=FirstJoint.of(axes, plane),
            turning=(float(np.sign(w @ z[2])), float(np.sign(w @ z[3]))),
            shoulder=shoulder,
            upper=upper,
            fore=fore,
            hand=hand,
            offset=float(w @ (point - origins[0])),
            bend=float(np.arctan2(plane[0] @ z[5], w @ z[5])),
            centre=se3.transform(se3.inverse(T), point[None])[0],
            R_frame0_last=T[:3, :3],
        )

    @property
    def determinant(self) -> Determinant:
        """Determinant of the geometric Jacobian at P: factors of P beside axis 1, planar arm and last axes."""
        sign = self.chain.sign
        second, third, fourth = (1, float(sign[1])), (2, self.turning[0] * sign[2]), (3, self.turning[1] * sign[3])
        level = np.conj(self.column.level)
        across = np.conj(self.upper) * self.fore / abs(self.upper)
        shoulder = [
            *real_part(level * self.shoulder, []),
            *real_part(level * self.upper, [second]),
            *real_part(level * self.fore, [second, third]),
            *real_part(level * self.hand, [second, third, fourth]),
        ]
        wrist = [
            Term(float(sign[4] * np.cos(self.bend)), "sin", ((4, 1.0),)),
            Term(float(np.sin(self.bend)), "cos", ((4, 1.0),)),
        ]
        factors = [("elbow", real_part(-1j * across, [third])[::-1]), ("wrist", wrist), ("shoulder", shoulder)]
        whole = -self.turning[0] * self.turning[1] * float(np.prod(sign))
        return determinant(self.chain.joint_names, whole, [abs(self.upper)], factors)

    def nearest_rotations(self, Rs_frame0_last: Array) -> Array:
        """See ``ClosedForm``: six joints take any rotation."""
        return Rs_frame0_last

    def _solved(self, Ts_frame0_last: Array, reference: Array | float = 0.0) -> Solutions:
        """Solve by numpy."""
        count = len(Ts_frame0_last)
        preferred = (np.broadcast_to(reference, (count, 6)) * self.chain.sign).T
        position = (Ts_frame0_last[:, :3, :3] @ self.centre + Ts_frame0_last[:, :3, 3]).T
        split = self.column.split(position - self.column.root[:, None])
        (first,), gap_1, (free_1,) = self.column.facing(split, self.offset, preferred[0])  # (2, n)
        turned = np.cos(first), np.sin(first)
        e, f, _ = turned_back(split, turned)
        phi, fifth, sixth, free_6 = self._turns(
            Ts_frame0_last[:, :3, :3], first, preferred[5]
        )  # (2, 2, n): joints 5, 1
        bent, place = float(np.angle(self.upper)), (e + 1j * f)[None] - self.shoulder
        if free_6.any():
            near = np.where(free_6, self._within_reach(place, phi), phi)
            sixth = sixth - np.where(np.cos(fifth + self.bend) > 0, 1.0, -1.0) * (near - phi)
            phi = near
        place = place - self.hand * np.exp(1j * phi)
        (root, elbow), gap_8, (free_2, _) = type_8(
            abs(self.upper), abs(self.fore), place.real, place.imag, TINY, (preferred[1] + bent, 0.0), BEND
        )  # (2, 2, 2, n): elbow, joint 5, joint 1
        angles, shape = np.empty((6, 2, 2, 2, count)), (2, 2, 2, count)
        angles[0], angles[4], angles[5] = first, fifth, sixth
        angles[1] = root - bent
        third = elbow + bent - np.angle(self.fore)
        angles[2] = self.turning[0] * third
        angles[3] = self.turning[1] * (phi - angles[1] - third)
        angles -= 2 * np.pi * np.round(angles / (2 * np.pi))
        free = np.zeros(angles.shape, dtype=np.bool_)
        free[0], free[1], free[5] = free_1, free_2, free_6
        gap = np.broadcast_to(np.maximum(gap_1, gap_8), shape)
        joints = angles * self.chain.sign[:, None, None, None, None]
        return Solutions(
            joints.reshape(6, 8, count).transpose(2, 1, 0),
            np.array(gap.reshape(8, count).T),
            np.zeros((count, 8)),
            free.reshape(6, 8, count).transpose(2, 1, 0),
        )

    @with_fallback(_solved)
    def solve(self, Ts_frame0_last: Array, reference: Array | float = 0.0) -> Solutions:
        """See ``ClosedForm``. The branches are the roots of joint 1, of joint 5 and of the elbow, in this order."""
        joints, gap, free = eight_solutions("three_parallel", self._numbers, Ts_frame0_last, reference)
        found = Solutions(joints, gap, np.zeros(gap.shape), free)
        rows = np.flatnonzero(free[:, :, 5].any(axis=1))
        if rows.size:
            part = self._solved(Ts_frame0_last[rows], np.broadcast_to(reference, (len(gap), 6))[rows])
            for name in ("joints", "gap_m", "free"):
                getattr(found, name)[rows] = getattr(part, name)
        return found

    @cached_property
    def _numbers(self) -> Array:
        """Arm parameters of the compiled solution."""
        column, links = self.column, [(abs(z), np.angle(z)) for z in (self.upper, self.fore)]
        places = [(z.real, z.imag) for z in (self.shoulder, self.hand)]
        parts = (
            self.chain.sign, self.centre, column.root, column.parts, column.plane @ self.R_frame0_last, self.turning,
            places, links, [self.offset, self.bend],
        )  # fmt: skip
        return np.concatenate([np.ravel(part).astype(np.float64) for part in parts])

    def _within_reach(self, place: NDArray[np.complex128], phi: Array) -> Array:
        """Return the turns ``(2, 2, n)`` nearest to phi within the planar arm's reach, where joint 6 is free.

        Axis 4 is |place| and |hand| from the two ends of a triangle, and nears axis 2 as the hand turns to it.
        """
        product, squares = np.abs(place) * abs(self.hand), np.abs(place) ** 2 + abs(self.hand) ** 2
        towards = np.angle(place) - np.angle(self.hand)
        away = phi - towards - 2 * np.pi * np.round((phi - towards) / (2 * np.pi))
        twice = np.maximum(2 * product, TINY)
        nearest, farthest = abs(abs(self.upper) - abs(self.fore)), abs(self.upper) + abs(self.fore)
        low, high = ((squares - bound**2) / twice for bound in (farthest, nearest))
        cosine = np.clip(np.clip(np.cos(away), low, high), -1.0, 1.0)
        moved = np.copysign(np.arccos(cosine), away)
        return np.asarray(np.where(np.cos(away) == cosine, phi, towards + moved))

    def _turns(self, Rs: Array, first: Array, preferred: Array) -> tuple[Array, Array, Array, Array]:
        """Return phi about w, joints 5 and 6, and where joint 6 is free ``(2, 2, n)``, for joint 1 ``(2, n)``."""
        plane = self.column.plane
        back = se3.exp(-first[..., None] * self.column.axis)  # (2, n, 3, 3)
        M = plane @ back @ Rs @ self.R_frame0_last.T @ plane.T  # in the axes e, f, w
        axis_6 = np.array([np.sin(self.bend), 0.0, np.cos(self.bend)])
        hand, w = M @ axis_6, M[..., 2, :]  # axis 6 in the plane's axes, and w in the last frame's
        size = np.hypot(hand[..., 0], hand[..., 1])
        sign = np.array([1.0, -1.0])[:, None, None]
        bent = sign * np.arctan2(size, hand[..., 2])  # joint 5 and the bend
        across = np.array([np.cos(self.bend), 0.0, -np.sin(self.bend)])
        free = np.broadcast_to(size <= TINY, bent.shape)
        sixth = np.where(free, preferred, np.arctan2(sign * w[..., 1], -sign * (w @ across)))
        fifth = bent - self.bend
        # phi is what is left when joints 5 and 6 are undone, so that it is right near the singularity as well
        level = np.stack([np.cos(fifth), np.zeros_like(fifth), np.sin(fifth)], axis=-1)
        undone = np.einsum("...ij,...j->...i", se3.exp(-sixth[..., None] * axis_6), level)
        left = np.einsum("...ij,...j->...i", np.broadcast_to(M, (2, *M.shape)), undone)
        return np.arctan2(left[..., 1], left[..., 0]), fifth, sixth, free
