"""Inverse kinematics of the first three joints of an arm, and of arms of three joints, in closed form.

A vector is an array of three rows, a pose in each column; one in a plane is a complex number. Angles and lengths here
are those of the axes: joint positions times their signs.

The first three joints of an arm with a spherical wrist bring the wrist's centre to a place. Joint 1 turns all the rest
about a column (``FirstJoint``). Then follow

* an ``Elbow``: two hinges with parallel axes (an equation of type 2 for joint 1, of type 8 for the others);
* a ``_Telescope``: a hinge, and a slide across it (types 2 and 5);
* a ``_Lift``: a slide along the column, and one across it (types 1 and 5).

An arm of three joints of any kind brings a point of the last link to a place (``ThreeJoints``). Joint 3 alone moves the
point in the frame of link 2, on a circle or a line. Joints 1 and 2 leave two numbers unchanged: of a hinge 1 the
point's height along the axis and its distance from it, of a slide 1 its two coordinates across. Eliminating joint 2
from the two equations leaves one in joint 3: a trigonometric polynomial of degree 2 for a hinge, a polynomial of degree
4 for a slide (Pieper 1968; Khalil & Dombre 2002, section 4.4). Its coefficients are read off values at five positions,
its roots are eigenvalues, and a few steps of Newton's method make the joints exact.
"""

import itertools
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from lab.core import se3
from lab.core.random import rng_for
from lab.core.se3 import Array
from lab.extensions.robotics.inverse.khalil_equations import TINY, Roots, type_1, type_2, type_5, type_8
from lab.kinematics.compiled.kernels import three_joints, with_fallback
from lab.kinematics.inverse.closed_form import (
    EXACT,
    Determinant,
    Solutions,
    Term,
    ZeroAxes,
    determinant,
    in_plane,
    plane_across,
    real_part,
)
from lab.kinematics.serial.chain import Chain

__all__ = [
    "BEND",
    "Carried",
    "Carrier",
    "Elbow",
    "FirstJoint",
    "Named",
    "ThreeJoints",
    "carrier_of",
    "fitted_factor",
    "slid",
    "turned_back",
]

Named = tuple[str, Sequence[Term]]


@dataclass(frozen=True)
class FirstJoint:
    """Joint 1 of an arm, and the plane of the joints after it.

    Attributes:
        axis: ``(3,)`` of the joint, through ``root`` ``(3,)`` (m).
        plane: ``(3, 3)`` rows e, f and w: in which the joints after it move, and across it.
        parts: ``(9, 3)``: of a vector the part along the axis, the one across it, and the latter turned by 90
            degrees, each by its coordinates in the plane.
    """

    axis: Array
    root: Array
    plane: Array
    parts: Array

    @classmethod
    def of(cls, axes: ZeroAxes, plane: Array) -> "FirstJoint":
        """Return joint 1 of a nominal model."""
        axis = axes.directions[0]
        along = np.outer(axis, axis)
        parts = [plane @ part for part in (along, np.eye(3) - along, se3.skew(axis))]
        return cls(axis, axes.origins[0], plane, np.concatenate(parts))

    @property
    def level(self) -> complex:
        """W x axis, in the plane: the direction of the wrist's centre from axis 1, if it is far from it."""
        return in_plane(self.plane, np.cross(self.plane[2], self.axis))

    def split(self, vector: Array) -> tuple[Array, Array, Array]:
        """Return the three parts of a vector ``(3, n)``, in the plane."""
        first, second, third = (self.parts @ vector).reshape(3, 3, -1)
        return first, second, third

    def facing(self, split: tuple[Array, Array, Array], offset: float, preferred: Array) -> Roots:
        """Solve w . Rot(axis, -t) p = offset (m) for joint 1 t."""
        along, across, quarter = split
        return type_2(-quarter[2], across[2], offset - along[2], TINY, preferred)


@dataclass(frozen=True)
class Carried:
    """Rotation of directions by the first three joints, at their roots.

    Attributes:
        first: cosine and sine of joint 1 ``(2, n)``.
        lifted: of the turn about w ``(elbows, 2, n)``; None where no joint turns about it.
    """

    column: FirstJoint
    first: tuple[Array, Array]
    lifted: tuple[Array, Array] | None = None

    def back(self, vector: Array) -> list[Array]:
        """Turn a vector ``(3, n)`` back by these joints, along e, f and w."""
        e, f, w = turned_back(self.column.split(vector), self.first)
        if self.lifted is None:
            return [e, f, w]
        cosine, sine = self.lifted
        return [cosine * e + sine * f, cosine * f - sine * e, w]


def turned_back(split: tuple[Array, Array, Array], first: tuple[Array, Array]) -> list[Array]:
    """Turn a vector back by joint 1, in the plane."""
    cosine, sine = first
    return [fixed + cosine * level - sine * ahead for fixed, level, ahead in zip(*split, strict=True)]


BEND = 0.03  # rad, from the straight elbow: a start for Newton's method where the nominal model does not reach


@dataclass(frozen=True)
class Elbow:
    """First three joints of which 2 and 3 are hinges with parallel axes.

    Attributes:
        turning: 1 where axis 3 points as axis 2 does, else -1.
        shoulder, upper, fore: in the plane (m): axis 2 from the root, axis 3 from axis 2, and the wrist's centre
            from axis 3.
        offset: the wrist's centre from the root, along w (m).
        elbows: number of roots for each root of joint 1.
    """

    column: FirstJoint
    turning: float
    shoulder: complex
    upper: complex
    fore: complex
    offset: float
    elbows: int = 2

    @classmethod
    def of(cls, axes: ZeroAxes, centre: Array) -> "Elbow | None":
        """Return the first three joints of a nominal model; None where their shape is another."""
        if any(axes.prismatic[:3]) or axes.parallel(0, 1) or not axes.parallel(1, 2):
            return None
        (_, w, third), (root, second, elbow) = axes.directions[:3], axes.origins[:3]
        plane = plane_across(w)
        shoulder, upper, fore = (in_plane(plane, v) for v in (second - root, elbow - second, centre - elbow))
        if min(abs(upper), abs(fore)) < EXACT:
            return None
        offset = float(w @ (centre - root))
        return cls(FirstJoint.of(axes, plane), float(np.sign(w @ third)), shoulder, upper, fore, offset)

    def solve(self, position: Array, preferred: Array, angles: Array, gap: Array, free: NDArray[np.bool_]) -> Carried:
        """Solve for places ``(3, n)`` of the wrist's centre in frame 0, and fill in the arrays.

        Args:
            preferred: ``(3, n)`` reference of free joints.
            angles, free: ``(3, wrists, elbows, 2, n)``; ``gap`` ``(wrists, elbows, 2, n)`` m.
        """
        split = self.column.split(position - self.column.root[:, None])
        (first,), gap_1, (free[0],) = self.column.facing(split, self.offset, preferred[0])
        turned = np.cos(first), np.sin(first)
        e, f, _ = turned_back(split, turned)
        bent = float(np.angle(self.upper))
        (shoulder, elbow), gap_8, (free[1], _) = type_8(
            abs(self.upper), abs(self.fore), e - self.shoulder.real, f - self.shoulder.imag, TINY,
            (preferred[1] + bent, 0.0), BEND,
        )  # fmt: skip
        angles[0], angles[1] = first, shoulder - bent
        angles[2] = self.turning * (elbow + bent - np.angle(self.fore))
        gap[:] = np.maximum(gap_1, gap_8)
        lifted = shoulder + elbow - np.angle(self.fore)  # the turn about w of joints 2 and 3 together
        return Carried(self.column, turned, (np.cos(lifted), np.sin(lifted)))

    def factors(self, sign: Array) -> tuple[float, list[float], list[Named]]:
        """Factor the determinant of the axes' three columns of the Jacobian at the wrist's centre.

        Returns:
            Its sign, lengths (m), and factors with their names, for joint positions that have these signs.
        """
        second, third = (1, float(sign[1])), (2, float(self.turning * sign[2]))
        across = np.conj(self.upper) * self.fore / abs(self.upper)
        elbow = real_part(-1j * across, [third])[::-1]
        level = np.conj(self.column.level)
        shoulder = [
            *real_part(level * self.shoulder, []),
            *real_part(level * self.upper, [second]),
            *real_part(level * self.fore, [second, third]),
        ]
        return self.turning, [abs(self.upper)], [("elbow", elbow), ("shoulder", shoulder)]


@dataclass(frozen=True)
class _Telescope:
    """First three joints of which 2 is a hinge and 3 a slide across it, along e.

    Attributes:
        shoulder, upper: in the plane (m): axis 2 from the root, and the wrist's centre from axis 2, drawn in.
        offset: the wrist's centre from the root, along w (m).
    """

    column: FirstJoint
    shoulder: complex
    upper: complex
    offset: float
    elbows: int = 2

    @classmethod
    def of(cls, axes: ZeroAxes, centre: Array) -> "_Telescope | None":
        if axes.prismatic[:3] != (False, False, True) or axes.parallel(0, 1) or not axes.square(1, 2):
            return None
        (_, w, slide), (root, second, _) = axes.directions[:3], axes.origins[:3]
        plane = plane_across(w, slide)
        shoulder, upper = in_plane(plane, second - root), in_plane(plane, centre - second)
        return cls(FirstJoint.of(axes, plane), shoulder, upper, float(w @ (centre - root)))

    def solve(self, position: Array, preferred: Array, angles: Array, gap: Array, free: NDArray[np.bool_]) -> Carried:
        split = self.column.split(position - self.column.root[:, None])
        (first,), gap_1, (free[0],) = self.column.facing(split, self.offset, preferred[0])
        turned = np.cos(first), np.sin(first)
        e, f, _ = turned_back(split, turned)
        reached = slid(e - self.shoulder.real, f - self.shoulder.imag, self.upper, preferred[1], preferred[2])
        (second, slide), gap_5, (free[1], free[2]) = reached
        angles[0], angles[1], angles[2] = first, second, slide
        gap[:] = np.maximum(gap_1, gap_5)
        return Carried(self.column, turned, (np.cos(second), np.sin(second)))

    def factors(self, sign: Array) -> tuple[float, list[float], list[Named]]:
        second, level = (1, float(sign[1])), np.conj(self.column.level)
        slide = [Term(float(sign[2]), slides=(2,)), Term(self.upper.real)]
        shoulder = [
            *real_part(level * self.shoulder, []),
            *real_part(level * self.upper, [second]),
            *real_part(level * sign[2], [second], slides=(2,)),
        ]
        return -1.0, [], [("slide", slide), ("shoulder", shoulder)]


@dataclass(frozen=True)
class _Lift:
    """First three joints of which 2 is a slide along the column, and 3 one across it, along e; w is the column.

    Attributes:
        up: 1 where joint 2 slides as axis 1 points, else -1.
        middle: the wrist's centre from the root, drawn in, in the plane (m), and ``height`` along w.
    """

    column: FirstJoint
    up: float
    middle: complex
    height: float
    elbows: int = 1

    @classmethod
    def of(cls, axes: ZeroAxes, centre: Array) -> "_Lift | None":
        if axes.prismatic[:3] != (False, True, True) or not axes.parallel(0, 1) or not axes.square(0, 2):
            return None
        (w, up, slide), root = axes.directions[:3], axes.origins[0]
        plane = plane_across(w, slide)
        height = float(w @ (centre - root))
        return cls(FirstJoint.of(axes, plane), float(np.sign(w @ up)), in_plane(plane, centre - root), height)

    def solve(self, position: Array, preferred: Array, angles: Array, gap: Array, free: NDArray[np.bool_]) -> Carried:
        e, f, w = self.column.plane @ (position - self.column.root[:, None])
        (first, slide), gap_5, (free[0], free[2]) = slid(e, f, self.middle, preferred[0], preferred[2])
        first = first[None]  # (elbows, 2, n)
        angles[0], angles[1], angles[2] = first, type_1(self.up, w - self.height).values[0][0], slide
        gap[:] = gap_5
        return Carried(self.column, (np.cos(first), np.sin(first)))

    def factors(self, sign: Array) -> tuple[float, list[float], list[Named]]:
        return self.up, [], [("shoulder", [Term(float(sign[2]), slides=(2,)), Term(self.middle.real)])]


Carrier = Elbow | _Telescope | _Lift
"""Closed form of the first three joints; ``Elbow`` describes its methods."""


def carrier_of(axes: ZeroAxes, centre: Array) -> Carrier | None:
    """Return the closed form of the first three joints for a point ``(3,)`` m; None where their shape is another."""
    return Elbow.of(axes, centre) or _Telescope.of(axes, centre) or _Lift.of(axes, centre)


def slid(e: Array, f: Array, drawn_in: complex, turn_preferred: Array, slide_preferred: Array) -> Roots:
    """Solve a turn and a slide along e after it that bring the point at zero to (e, f): type 5.

    With (e, f) = size exp(i direction) and s = direction - turn: size sin s = Im drawn_in, and size cos s = Re
    drawn_in + slide.
    """
    size, direction = np.hypot(e, f), np.arctan2(f, e)
    (slide, rest), gap, (slide_free, rest_free) = type_5(
        size, drawn_in.imag, 0.0, size, drawn_in.real, 1.0, TINY, (slide_preferred, direction - turn_preferred)
    )
    return Roots((direction - rest, slide), gap, (rest_free, slide_free))


def _polynomial_roots(coefficients: NDArray[np.complex128]) -> NDArray[np.complex128]:
    """Return the roots ``(d, n)`` of polynomials ``(d + 1, n)`` of rising powers, by companion matrices."""
    degree = len(coefficients) - 1
    last = coefficients[-1]
    size = np.abs(coefficients).max(axis=0)
    last = np.where(np.abs(last) > 1e-14 * size, last, 1e-14 * np.maximum(size, 1e-280))
    matrix = np.zeros((coefficients.shape[1], degree, degree), dtype=np.complex128)
    matrix[:, 1:, :-1] = np.eye(degree - 1)
    matrix[:, :, -1] = -(coefficients[:-1] / last).T
    return np.asarray(np.linalg.eigvals(matrix).T, dtype=np.complex128)


_REACHED_M = 1e-11
_POLISH, _NEAREST = 8, 60  # steps
_ON_AXIS = 1e-14  # of the arm's size
_OFF_CIRCLE = 1e-3  # a root nearer to the unit circle is tried as an angle
_NODES = 5


@dataclass(frozen=True)
class ThreeJoints:
    """An arm of three joints and its point, by its axes in frame 0 at zero joint positions.

    Attributes:
        point: ``(3,)`` in the last frame (m), and ``start`` in frame 0 at zero joint positions.
        degree: of the polynomial in joint 3; of a hinge in its cosine and sine.
        roots_of_second: how many positions of joint 2 there are for each of joint 3.
    """

    axes: ZeroAxes
    point: Array
    start: Array
    scale_m: float
    degree: int = 0
    roots_of_second: int = 1
    by_point: bool = True
    exact_only: bool = False
    numbered: bool = False
    moved: str = "the displacements of the last frame's origin"

    @classmethod
    def of(cls, chain: Chain, point: Array) -> "ThreeJoints | None":
        """Return the closed form for a point ``(3,)`` m of the last frame; None where it cannot move in space."""
        if chain.size != 3:
            return None
        axes = ZeroAxes.of(chain)
        start = se3.transform(axes.T_frame0_last, point[None])[0]
        scale = float(np.abs(np.concatenate([axes.origins.ravel(), start, point])).max()) + 0.1
        plain = cls(axes, point, start, scale)
        joints = rng_for(0, "structure").uniform(-1.5, 1.5, (40, 3))
        if np.abs(np.linalg.det(plain._jacobian(joints.T).transpose(2, 0, 1))).max() < EXACT * scale:
            return None
        wanted = plain._place(joints.T)
        _, second = plain._second(plain._third(joints.T[2]), wanted)
        coefficients = np.abs(plain._coefficients(wanted))
        size = coefficients.max()
        degree = int(np.flatnonzero(coefficients.max(axis=1) > 1e-9 * size)[-1])
        if not degree or not size > EXACT**2:
            return None
        return cls(axes, point, start, scale, degree, len(second))

    @property
    def branches(self) -> int:
        """Number of solutions for a place, some of which may coincide or not exist."""
        return (self.degree if self.axes.prismatic[2] else 2 * self.degree) * self.roots_of_second

    @property
    def determinant(self) -> Determinant:
        """Determinant of the point's Jacobian: in factors for the classical carriers, else as one sum."""
        if (carrier := carrier_of(self.axes, self.start)) is not None:
            sign, lengths, factors = carrier.factors(self.axes.sign)
            return determinant(self.axes.names, sign * float(np.prod(self.axes.sign)), lengths, factors)

        def value(joints: Array) -> Array:
            J = self._jacobian((joints * self.axes.sign).T).transpose(2, 0, 1) * self.axes.sign
            return np.asarray(np.linalg.det(J))

        terms = fitted_factor(value, self.axes.prismatic, (1, 2))  # joint 1 moves the whole arm
        if len(terms) == 1 and not terms[0].function and not terms[0].slides:  # three slides: it is never singular
            return determinant(self.axes.names, float(np.sign(terms[0].coefficient)), [terms[0].size], [])
        return determinant(self.axes.names, 1.0, [], [("position", terms)])

    def nearest_rotations(self, Rs_frame0_last: Array) -> Array:
        """See ``ClosedForm``: any rotation will do; a missing one counts as no turn."""
        given = np.asarray(np.isfinite(Rs_frame0_last).all(axis=(1, 2)))
        return np.where(given[:, None, None], Rs_frame0_last, np.eye(3))

    def _solved(self, Ts_frame0_last: Array, reference: Array | float = 0.0, *, nearest: bool = True) -> Solutions:
        """Solve by numpy."""
        count = len(Ts_frame0_last)
        wanted = se3.transform(Ts_frame0_last, self.point[None])[:, 0].T
        preferred = (np.broadcast_to(reference, (count, 3)) * self.axes.sign).T
        third, real = self._roots(wanted)  # (k, n)
        target = np.broadcast_to(wanted[:, None], (3, *third.shape))
        at = self._third(third)
        _, second = self._second(at, target)  # (m, k, n)
        third = np.broadcast_to(third, second.shape)
        target = np.broadcast_to(target[:, None], (3, *second.shape))
        joints = np.stack([np.zeros_like(second), second, third])
        joints[0] = self._first(joints, target)
        joints = self._settled(joints.reshape(3, -1), target.reshape(3, -1), _POLISH).reshape(joints.shape)
        joints, free = self._freed(joints, target, preferred)
        gap = np.linalg.norm(self._place(joints) - target, axis=0)
        found = (gap <= _REACHED_M) & real
        lost = ~found.any(axis=(0, 1)) & nearest
        if lost.any():
            near = self._settled(joints[..., lost].reshape(3, -1), target[..., lost].reshape(3, -1), _NEAREST)
            joints[..., lost] = near.reshape(3, *joints.shape[1:3], -1)
            gap = np.linalg.norm(self._place(joints) - target, axis=0)
        gap = np.where(found, 0.0, np.maximum(gap, np.where(lost, 0.0, self.scale_m)))
        return self._solutions(joints, gap, free, Ts_frame0_last)

    @with_fallback(_solved)
    def solve(self, Ts_frame0_last: Array, reference: Array | float = 0.0, *, nearest: bool = True) -> Solutions:
        """See ``ClosedForm``. The point is brought to its place; the tilt is the rotation error.

        Args:
            nearest: whether places out of reach get the joints that come nearest, which takes longer.
        """
        found = Solutions(*three_joints(self._numbers, Ts_frame0_last, reference, self.branches, tilted=nearest))
        lost = np.flatnonzero((found.gap_m > 0).all(axis=1)) if nearest else np.empty(0, dtype=np.int_)
        if lost.size:
            near = self._solved(Ts_frame0_last[lost], np.broadcast_to(reference, (len(Ts_frame0_last), 3))[lost])
            for name in ("joints", "gap_m", "tilt_rad", "free"):
                getattr(found, name)[lost] = getattr(near, name)
        return found

    @cached_property
    def _numbers(self) -> Array:
        """Arm parameters of the compiled solution."""
        (first, second, _), slides = self.axes.directions, self.axes.prismatic
        eliminates, towards, level, slide = np.eye(2), 0.0, np.zeros(3), np.zeros(3)
        regular, plane_2 = True, plane_across(second)
        if not slides[1]:
            left, size, basis, regular = self._eliminated(plane_2)
            eliminates = (basis.T if regular else np.eye(2)) @ (left.T / np.where([True, regular], size, 1.0)[:, None])
            towards = float(np.arctan2(basis[0, 1], basis[0, 0]))
        elif slides[0]:
            level, slide = np.cross(first, second), np.linalg.pinv(np.stack([first, second], axis=1))[1]
        nodes, powers = self._interpolation()
        if not slides[2]:
            powers = np.stack([part for row in powers for part in (row.real, row.imag)])[[0, 2, 3, 4, 5]]
        count = self.degree if slides[2] else 2 * self.degree
        parts = (
            slides, self.axes.sign, self.axes.directions, self.axes.origins, self.point, self.start,
            self.axes.T_frame0_last[:3, :3], [self.scale_m, count, self.roots_of_second], plane_across(first), plane_2,
            eliminates, [regular, towards], level, slide, self._third(nodes).T, powers.real,
        )  # fmt: skip
        return np.concatenate([np.ravel(part).astype(np.float64) for part in parts])

    def _solutions(self, joints: Array, gap: Array, free: NDArray[np.bool_], Ts: Array) -> Solutions:
        count = len(Ts)
        hinges = ~np.array(self.axes.prismatic)
        joints[hinges] -= 2 * np.pi * np.round(joints[hinges] / (2 * np.pi))
        rows = joints.reshape(3, -1, count).transpose(2, 1, 0)
        turned = self._turned(rows.reshape(-1, 3).T) @ self.axes.T_frame0_last[:3, :3]
        wanted = np.repeat(Ts[:, :3, :3], rows.shape[1], axis=0)
        tilt = np.linalg.norm(se3.log(wanted @ turned.swapaxes(1, 2)), axis=1).reshape(count, -1)
        gaps, frees = gap.reshape(-1, count).T, free.reshape(3, -1, count).transpose(2, 1, 0)
        return Solutions(rows * self.axes.sign, gaps.copy(), np.where(tilt <= EXACT, 0.0, tilt), frees.copy())

    # The arm

    def _third(self, amount: Array) -> Array:
        """Return the point ``(3, ...)`` in link 2."""
        return self.axes.carried(
            2, amount, np.broadcast_to(self.start.reshape(3, *(1,) * amount.ndim), (3, *amount.shape))
        )

    def _place(self, joints: Array) -> Array:
        """Return the point ``(3, ...)`` in frame 0."""
        return self.axes.carried(0, joints[0], self.axes.carried(1, joints[1], self._third(joints[2])))

    def _turned(self, joints: Array) -> Array:
        """Return the rotations ``(n, 3, 3)`` of the last link from its orientation at zero joint positions."""
        R = np.tile(np.eye(3), (joints.shape[1], 1, 1))
        for axis, slides, amount in zip(self.axes.directions, self.axes.prismatic, joints, strict=True):
            R = R if slides else R @ se3.exp(amount[:, None] * axis)
        return R

    def _jacobian(self, joints: Array) -> Array:
        """Compute the Jacobian of the point ``(3, 3, n)``."""
        columns, point = list[Array](), self._third(joints[2])
        for joint in (2, 1, 0):
            axis, origin = self.axes.directions[joint], self.axes.origins[joint][:, None]
            if joint < 2:
                columns = [self.axes.carried(joint, joints[joint], point + each) for each in columns]
                point = self.axes.carried(joint, joints[joint], point)
                columns = [each - point for each in columns]
            if self.axes.prismatic[joint]:
                columns.append(np.broadcast_to(axis[:, None], point.shape))
            else:
                columns.append(np.cross(axis, point - origin, axisb=0, axisc=0))
        return np.stack(columns[::-1], axis=1)

    # The equations

    def _second(self, at: Array, wanted: Array) -> tuple[Array, Array]:
        """Return the residual equation for joint 3, and the positions ``(m, ...)`` of joint 2."""
        return self._slide(at, wanted) if self.axes.prismatic[1] else self._hinge(at, wanted)

    def _hinge(self, at: Array, wanted: Array) -> tuple[Array, Array]:
        """Solve for a hinge 2 that turns the point: two equations M w = r in its place w across the axis."""
        _, w = self.axes.directions[:2]
        plane, origin = plane_across(w), self.axes.origins[1]
        u, v, h = np.tensordot(plane, at - origin.reshape(3, *(1,) * (at.ndim - 1)), 1)
        right = self._right(plane, h, u**2 + v**2 + h**2, wanted)
        left, size, basis, regular = self._eliminated(plane)
        across = np.tensordot(left.T, right, 1)
        if regular:
            e, f = np.tensordot(basis.T, across / size.reshape(2, *(1,) * u.ndim), 1)
            return e**2 + f**2 - u**2 - v**2, (np.arctan2(f, e) - np.arctan2(v, u))[None]
        reach, first = np.hypot(u, v), across[0] / size[0]
        opening = np.arctan2(np.sqrt(np.maximum(reach**2 - first**2, 0.0)), first)
        towards = np.arctan2(basis[0, 1], basis[0, 0])
        return across[1], np.stack([towards + opening, towards - opening]) - np.arctan2(v, u)

    def _eliminated(self, plane: Array) -> tuple[Array, Array, Array, bool]:
        """Return the singular value decomposition of M, and whether M is regular."""
        axis = self.axes.directions[0]
        if self.axes.prismatic[0]:
            rows = self.scale_m * plane_across(axis)[:2] @ plane[:2].T
        else:
            apart = self.axes.origins[1] - self.axes.origins[0]
            rows = np.stack([self.scale_m * plane[:2] @ axis, plane[:2] @ apart])
        left, size, basis = np.linalg.svd(rows)
        return left, size, basis, bool(size[1] > 1e-9 * self.scale_m)

    def _right(self, plane: Array, height: Array, square: Array, wanted: Array) -> Array:
        """Return the right sides ``(2, ...)`` m of the two equations that joint 1 leaves."""
        axis, origin = self.axes.directions[0], self.axes.origins[1]
        wide = (3, *(1,) * (wanted.ndim - 1))
        if self.axes.prismatic[0]:
            across = plane_across(axis)[:2]
            right = np.tensordot(across, wanted - origin.reshape(wide), 1)
            return np.asarray(self.scale_m * (right - np.multiply.outer(across @ plane[2], height)))
        apart, lever = origin - self.axes.origins[0], wanted - self.axes.origins[0].reshape(wide)
        along = np.tensordot(axis, lever, 1) - axis @ apart - (axis @ plane[2]) * height
        far = ((lever**2).sum(axis=0) - square - apart @ apart) / 2 - (apart @ plane[2]) * height
        return np.stack([self.scale_m * along, far])

    def _slide(self, at: Array, wanted: Array) -> tuple[Array, Array]:
        """Solve for a slide 2."""
        first, along = self.axes.directions[:2]
        wide = (3, *(1,) * (at.ndim - 1))
        if self.axes.prismatic[0]:
            normal = np.cross(first, along)
            inverse = np.linalg.pinv(np.stack([first, along], axis=1))
            return np.tensordot(normal, wanted - at, 1), np.tensordot(inverse, wanted - at, 1)[1][None]
        origin = self.axes.origins[0].reshape(wide)
        lever, there = at - origin, wanted - origin
        height, cosine = np.tensordot(first, there - lever, 1), float(first @ along)
        square = (there**2).sum(axis=0)
        if abs(cosine) > EXACT:
            moved = height / cosine
            end = lever + np.multiply.outer(along, moved)
            return (end**2).sum(axis=0) - square, moved[None]
        half = np.tensordot(along, lever, 1)
        root = np.sqrt(np.maximum(half**2 - (lever**2).sum(axis=0) + square, 0.0))
        return height, np.stack([-half + root, -half - root])

    def _first(self, joints: Array, wanted: Array) -> Array:
        """Solve for joint 1, given the two others."""
        at, axis = self.axes.carried(1, joints[1], self._third(joints[2])), self.axes.directions[0]
        if self.axes.prismatic[0]:
            return np.asarray(np.tensordot(axis, wanted - at, 1))
        plane, origin = plane_across(axis)[:2], self.axes.origins[0].reshape(3, *(1,) * (at.ndim - 1))
        (a, b), (c, d) = (np.tensordot(plane, each - origin, 1) for each in (at, wanted))
        return np.asarray(np.arctan2(a * d - b * c, a * c + b * d))

    # Joint 3

    def _interpolation(self) -> tuple[Array, NDArray[np.complex128]]:
        """Return positions ``(5,)`` of joint 3, and the matrix from values there to coefficients."""
        if self.axes.prismatic[2]:
            nodes = self.scale_m * np.cos(np.pi * (np.arange(_NODES) + 0.5) / _NODES)
            return nodes, np.linalg.inv(np.vander(nodes / self.scale_m, increasing=True)).astype(np.complex128)
        nodes = 2 * np.pi * np.arange(_NODES) / _NODES
        turns = np.multiply.outer(np.arange(3), nodes)
        return nodes, (np.cos(turns) - 1j * np.sin(turns)) / _NODES

    def _coefficients(self, wanted: Array) -> NDArray[np.complex128]:
        """Compute joint 3's equation, ``(5, n)`` or ``(3, n)``: of powers, or of exp(i k q3) from k = 0 to 2."""
        nodes, makes = self._interpolation()
        return np.asarray(makes @ self._left(nodes, wanted))

    def _left(self, nodes: Array, wanted: Array) -> Array:
        """Evaluate the residual equation at nodes of joint 3, ``(nodes, n)``."""
        third = np.repeat(nodes[:, None], wanted.shape[1], axis=1)
        return self._second(self._third(third), np.broadcast_to(wanted[:, None], (3, *third.shape)))[0]

    def _roots(self, wanted: Array) -> tuple[Array, NDArray[np.bool_]]:
        """Return positions ``(k, n)`` of joint 3, and whether they are real roots, or nearly."""
        coefficients = self._coefficients(wanted)[: self.degree + 1]
        if self.axes.prismatic[2]:
            roots = _polynomial_roots(coefficients)
            return self.scale_m * roots.real, np.abs(roots.imag) <= _OFF_CIRCLE
        roots = _polynomial_roots(np.concatenate([coefficients[:0:-1].conj(), coefficients]))
        return np.angle(roots), np.abs(np.abs(roots) - 1) <= _OFF_CIRCLE

    def _settled(self, joints: Array, wanted: Array, steps: int) -> Array:
        """Take damped Newton steps of joints ``(3, n)`` towards places; none that increases the error."""
        unit = np.where(self.axes.prismatic, self.scale_m, 1.0)[:, None]
        joints, damping = joints.copy(), np.zeros(joints.shape[1])
        missing = wanted - self._place(joints)
        for _ in range(steps):
            J = (self._jacobian(joints) * unit[None, :, :]).transpose(2, 0, 1)
            normal = J.swapaxes(1, 2) @ J
            size = np.trace(normal, axis1=1, axis2=2)[:, None, None] * np.eye(3)
            slope = J.swapaxes(1, 2) @ missing.T[:, :, None]
            step = np.linalg.solve(normal + (1e-14 + damping[:, None, None]) * size, slope)
            moved = joints + unit * step[:, :, 0].T
            left = wanted - self._place(moved)
            better = (left**2).sum(axis=0) < (missing**2).sum(axis=0)
            joints, missing = np.where(better, moved, joints), np.where(better, left, missing)
            damping = np.where(better, damping / 10, np.maximum(10 * damping, 1e-6))
        return joints

    def _freed(self, joints: Array, wanted: Array, preferred: Array) -> tuple[Array, NDArray[np.bool_]]:
        """Set hinges 1 and 2 to the reference where the point is on their axes."""
        free = np.zeros(joints.shape, dtype=np.bool_)
        for joint, point in ((0, wanted), (1, self._third(joints[2]))):
            if not self.axes.prismatic[joint]:
                lever = point - self.axes.origins[joint].reshape(3, *(1,) * (point.ndim - 1))
                across = np.cross(self.axes.directions[joint], lever, axisb=0, axisc=0)
                free[joint] = np.linalg.norm(across, axis=0) <= _ON_AXIS * self.scale_m
                joints[joint] = np.where(free[joint], preferred[joint], joints[joint])
        return joints, free


_FIT_NODES = 7
_NO_TERM = 1e-12


def fitted_factor(value: Callable[[Array], Array], prismatic: tuple[bool, ...], varied: tuple[int, ...]) -> list[Term]:
    """Return the terms of a function of joint positions ``(n, joints)``, read off its values on a grid.

    It is a trigonometric polynomial in a hinge and a polynomial in a slide, of degree 3 at most.

    Args:
        varied: the joints on which it depends.
    """
    slides = [prismatic[joint] for joint in varied]
    nodes = [
        np.linspace(-1, 1, _FIT_NODES) if slide else 2 * np.pi * np.arange(_FIT_NODES) / _FIT_NODES for slide in slides
    ]
    grid = np.full((_FIT_NODES ** len(varied), len(prismatic)), 0.3)
    grid[:, list(varied)] = np.stack(np.meshgrid(*nodes, indexing="ij"), axis=-1).reshape(-1, len(varied))
    spectrum = value(grid).reshape((_FIT_NODES,) * len(varied)).astype(np.complex128)
    for axis, slide in enumerate(slides):
        if slide:
            inverse = np.linalg.inv(np.vander(nodes[axis], increasing=True))
            spectrum = np.moveaxis(np.tensordot(inverse, spectrum, (1, axis)), 0, axis)
        else:
            spectrum = np.fft.fft(spectrum, axis=axis) / _FIT_NODES
    return list(_terms(spectrum, varied, slides))


def _terms(spectrum: NDArray[np.complex128], varied: tuple[int, ...], slides: list[bool]) -> Iterator[Term]:
    """Combine each pair of a frequency and its negative into a cosine and a sine."""
    least = _NO_TERM * max(1.0, float(np.abs(spectrum).max()))
    for index in itertools.product(range(_FIT_NODES), repeat=len(varied)):
        # powers of slides, and frequencies of hinges: those above half the nodes are negative ones
        orders = [i if slide or 2 * i < _FIT_NODES else i - _FIT_NODES for i, slide in zip(index, slides, strict=True)]
        joints = list(zip(varied, orders, slides, strict=True))
        turns = tuple((joint, float(order)) for joint, order, slide in joints if order and not slide)
        powers = tuple(itertools.chain(*((joint,) * order for joint, order, slide in joints if slide)))
        yield from _wave(complex(spectrum[index]), turns, powers, least)


def _wave(
    coefficient: complex, turns: tuple[tuple[int, float], ...], powers: tuple[int, ...], least: float
) -> Iterator[Term]:
    """Yield 2 Re(c) cos and -2 Im(c) sin of an angle, or the constant c, where they are not tiny."""
    if abs(coefficient) <= least or (turns and turns[0][1] < 0):  # a negative frequency repeats its positive one
        return
    if not turns:
        if abs(coefficient.real) > least:
            yield Term(coefficient.real, "", turns, slides=powers)
        return
    parts: tuple[tuple[float, Literal["cos", "sin"]], ...]
    parts = (2.0 * coefficient.real, "cos"), (-2.0 * coefficient.imag, "sin")
    for amplitude, function in parts:
        if abs(amplitude) > least:
            yield Term(amplitude, function, turns, slides=powers)
