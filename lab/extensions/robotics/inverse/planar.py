"""Inverse kinematics of arms that move in a plane, and of SCARA arms, in closed form.

Arms of two or three joints: hinges are across the plane and slides in it, in any order (``PlanarJoints``). Two joints
bring a point of the last link to a place, whatever the rotation; three take a pose of the plane.

Vectors in the plane are complex numbers, and a hinge multiplies what comes after it by exp(i angle). The place of a
point is then an anchor, plus a length turned by each hinge, plus each slide's travel turned by the hinges before it.
Where three joints are given a turn as well, the last hinge is what is left of it, and two unknowns remain: two hinges
(an equation of type 8), a hinge and a slide that it turns (type 5), a hinge and a slide beside it (types 10 and 1), or
two slides (Khalil & Dombre 2002, table 4.1).

A SCARA arm has four joints with parallel axes, three of them hinges: x, y, z and the turn about z. The slide may come
anywhere among the hinges, since it moves along their axes: the height gives it (type 1). The first two hinges are a
planar arm (type 8), and the last one is what is left of the turn.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from lab.core import se3
from lab.core.random import rng_for
from lab.core.se3 import Array
from lab.extensions.robotics.inverse.first_joints import BEND, Named, slid
from lab.extensions.robotics.inverse.khalil_equations import ROUNDING, TINY, type_1, type_8, type_10, unless_tiny
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
from lab.kinematics.serial.serial_arm import SerialArm

__all__ = ["PlanarArm", "PlanarJoints", "Scara"]

_Complex = NDArray[np.complex128]
_Pair = tuple[Array, Array, Array, NDArray[np.bool_], NDArray[np.bool_]]  # two unknowns, the gap, and which are free


def _moves_in_plane(axes: ZeroAxes, joint: int, normal: Array) -> bool:
    """Check that a hinge is along a plane's normal, or a slide across it."""
    direction = axes.directions[joint]
    off = abs(float(direction @ normal)) if axes.prismatic[joint] else np.linalg.norm(np.cross(direction, normal))
    return not off > EXACT


@dataclass(frozen=True)
class PlanarJoints:
    """Two or three joints that move in a plane, at zero joint positions; angles and lengths are along their axes.

    Attributes:
        joints: which of the arm's they are.
        turning: of each 1 where a hinge's axis points as the plane's normal does, else -1; 1 of a slide.
        places: of each hinge (m), from the plane's origin; ``directions`` of each slide, of unit length.
        hand: the point that is brought somewhere (m).
        turned: whether a turn is requested beside the place.
    """

    joints: tuple[int, ...]
    prismatic: tuple[bool, ...]
    turning: tuple[float, ...]
    places: tuple[complex, ...]
    directions: tuple[complex, ...]
    hand: complex
    turned: bool

    @classmethod
    def of(
        cls, axes: ZeroAxes, joints: tuple[int, ...], plane: Array, hand: Array, origin: Array | float = 0.0
    ) -> "PlanarJoints | None":
        """Select joints of an arm if they move in a plane (rows e, f, its normal) and bring a point anywhere in it.

        Args:
            hand: the point ``(3,)`` m in frame 0; ``origin`` the plane's.
        """
        normal = plane[2]
        if len(joints) not in (2, 3) or not all(_moves_in_plane(axes, joint, normal) for joint in joints):
            return None
        slides = tuple(axes.prismatic[joint] for joint in joints)
        turning = tuple(1.0 if axes.prismatic[j] else float(np.sign(axes.directions[j] @ normal)) for j in joints)
        places = tuple(in_plane(plane, axes.origins[j] - origin) for j in joints)
        directions = tuple(in_plane(plane, axes.directions[j]) for j in joints)
        planar = cls(joints, slides, turning, places, directions, in_plane(plane, hand - origin), len(joints) == 3)
        return planar if planar._moves_anywhere else None

    # What the joints are

    @property
    def _moves_anywhere(self) -> bool:
        """The joints move the hand in both directions of the plane: no length is zero, and slides are not parallel."""
        slides = self._slides
        if len(slides) == 3:
            return False
        if len(slides) == 2 and not self._between and _parallel(*(self.directions[i] for i in slides)):
            return False
        if len(slides) == 1 and self._after(slides[0]) == 1:
            return True
        return not min(map(abs, self._lengths), default=1.0) < EXACT

    @cached_property
    def _hinges(self) -> tuple[int, ...]:
        return tuple(i for i, slides in enumerate(self.prismatic) if not slides)

    @cached_property
    def _slides(self) -> tuple[int, ...]:
        return tuple(i for i, slides in enumerate(self.prismatic) if slides)

    @cached_property
    def _ends(self) -> tuple[complex, ...]:
        return (*(self.places[i] for i in self._hinges), self.hand)

    @cached_property
    def _lengths(self) -> tuple[complex, ...]:
        """The lengths that unknown hinges turn."""
        every = [b - a for a, b in zip(self._ends, self._ends[1:], strict=False)]
        return tuple(every[:-1] if self.turned else every)

    @property
    def _between(self) -> bool:
        """A hinge lies between two slides."""
        return len(self._slides) == 2 and self._slides[1] - self._slides[0] == 2

    def _after(self, slide: int) -> int:
        return sum(hinge < slide for hinge in self._hinges)

    @property
    def roots(self) -> int:
        """Number of solutions."""
        return 1 if len(self._slides) == 2 else 2

    # Their positions

    def solve(self, place: _Complex, turn: Array | None, preferred: Array) -> tuple[Array, Array, NDArray[np.bool_]]:
        """Return all positions that bring the hand to places ``(...)``, turned by ``turn`` where that is given.

        Args:
            preferred: ``(joints, ...)`` reference of free joints.

        Returns:
            Positions ``(roots, joints, ...)``, the gap ``(...)`` m, and what is free ``(joints, ...)``.
        """
        rest = place - self._ends[0]
        last = np.zeros_like(place.real) if turn is None else turn
        if self.turned:
            rest = rest - np.exp(1j * last) * (self._ends[-1] - self._ends[-2])
        size = np.abs(place) + sum(map(abs, self._lengths), start=1e-3)
        pair = self._two_slides if len(self._slides) == 2 else self._one_slide if self._slides else self._no_slide
        first, second, gap, free_1, free_2 = pair(rest, last, preferred, size)
        values = np.empty((self.roots, len(self.joints), *place.shape))
        free = np.zeros((len(self.joints), *place.shape), dtype=np.bool_)
        unknown = [*self._hinges[: len(self._lengths)], *self._slides]
        if not self._slides:  # two turns: of the first hinge, and of both
            values[:, unknown[0]], values[:, unknown[1]] = first, second - first
        else:
            values[:, unknown[0]], values[:, unknown[1]] = first, second
        free[unknown[0]], free[unknown[1]] = free_1, free_2
        if self.turned:
            others = [i for i in self._hinges if i != self._hinges[-1]]
            values[:, self._hinges[-1]] = last - values[:, others].sum(axis=1)
        return values * np.reshape(self.turning, (-1, *(1,) * place.ndim)), gap, free

    def _no_slide(self, rest: _Complex, last: Array, preferred: Array, size: Array) -> _Pair:
        """Solve two hinges as a triangle."""
        (x, y), hinge = self._lengths, self._hinges[0]
        bent, bent_2 = float(np.angle(x)), float(np.angle(y))
        favourite = preferred[hinge] * self.turning[hinge] + bent
        (root, elbow), gap, (free, _) = type_8(abs(x), abs(y), rest.real, rest.imag, TINY, (favourite, 0.0), BEND)
        return root - bent, root + elbow - bent_2, gap, free, np.zeros_like(free)

    def _one_slide(self, rest: _Complex, last: Array, preferred: Array, size: Array) -> _Pair:
        """Solve a hinge and a slide as a line across a circle."""
        hinge, slide, (length,) = self._hinges[0], self._slides[0], self._lengths
        direction, favourite = self.directions[slide], preferred[hinge] * self.turning[hinge]
        if self._after(slide) == 1:
            turned = rest * np.conj(direction)
            roots = slid(turned.real, turned.imag, length * direction.conjugate(), favourite, preferred[slide])
            (turn, way_out), (turn_free, out_free) = roots.values, roots.free
            return turn, way_out, roots.gap, turn_free, out_free
        along = direction * np.exp(1j * last) if self._after(slide) == 2 else np.broadcast_to(direction, rest.shape)
        seen, start = rest * np.conj(along), np.angle(length * np.conj(along))
        (angle,), gap, (free,) = type_10(abs(length), seen.imag, TINY, favourite + start)
        gap = np.where(np.abs(seen.imag) - abs(length) <= ROUNDING * size, 0.0, gap)
        return angle - start, seen.real - abs(length) * np.cos(angle), gap, free, np.zeros_like(free)

    def _two_slides(self, rest: _Complex, last: Array, preferred: Array, size: Array) -> _Pair:
        """Solve two slides as a parallelogram; one side is chosen freely where they are parallel."""
        first, second = (
            self.directions[i] * np.exp(1j * last)
            if self._after(i)
            else np.broadcast_to(self.directions[i], rest.shape)
            for i in self._slides
        )
        across = np.imag(np.conj(first) * second)
        free = np.abs(across) <= TINY
        b = np.where(free, preferred[self._slides[1]], np.imag(np.conj(first) * rest) / np.where(free, 1.0, across))
        left = np.conj(first) * (rest - b * second)
        gap = unless_tiny(np.where(free, np.abs(left.imag), 0.0), ROUNDING * size)
        return left.real[None], b[None], gap, free, free

    # Where they are singular

    def factors(self, sign: Array) -> tuple[list[float], list[Named]]:
        """Factor the determinant of place and turn by these joints, but for its sign: lengths (m), and named factors.

        Args:
            sign: ``(n,)`` of all joint positions of the arm.
        """

        def angle(i: int) -> tuple[int, float]:
            return self.joints[i], float(self.turning[i] * sign[self.joints[i]])

        if not self._slides:
            (x, y), second = self._lengths, self._hinges[1]
            return [abs(x)], [("elbow", real_part(-1j * x.conjugate() * y / abs(x), [angle(second)])[::-1])]
        direction = self.directions[self._slides[0]]
        if len(self._slides) == 2:
            other = self.directions[self._slides[1]]
            across = -1j * direction.conjugate() * other
            if not self._between:
                return [abs(across.real)], []
            return [], [("slides", real_part(across, [angle(self._hinges[0])]))]
        (length,), slide, hinge = self._lengths, self._slides[0], self._hinges[0]
        joint = self.joints[slide]
        if self._after(slide) == 1:
            return [], [
                ("slide", [Term(float(sign[joint]), slides=(joint,)), Term((length * direction.conjugate()).real)])
            ]
        if self._after(slide) == 0:
            return [], [("slide", real_part(direction.conjugate() * length, [angle(hinge)]))]
        return [], [("slide", real_part(direction * length.conjugate(), [angle(self._hinges[1])]))]

    def place_along(self, direction: complex, sign: Array) -> list[Term]:
        """Return the part of the hand's place along a direction: Re(conj(direction) place)."""
        level, terms = direction.conjugate(), list[Term]()
        turned, ends = list[tuple[int, float]](), list(self._ends)
        terms += real_part(level * ends[0], [])
        for i, slides in enumerate(self.prismatic):
            joint = self.joints[i]
            if slides:
                terms += real_part(level * self.directions[i] * float(sign[joint]), turned, slides=(joint,))
            else:
                turned = [*turned, (joint, float(self.turning[i] * sign[joint]))]
                k = self._hinges.index(i)
                terms += real_part(level * (ends[k + 1] - ends[k]), turned)
        return terms


def _parallel(a: complex, b: complex) -> bool:
    return abs((a.conjugate() * b).imag) <= EXACT


_IN_PLANE_M = 1e-11


@dataclass(frozen=True)
class PlanarArm:
    """An arm of two or three joints in a plane, by its axes in frame 0 at zero joint positions.

    Attributes:
        plane: ``(3, 3)`` rows e, f and the plane's normal.
        point: ``(3,)`` in the last frame (m), which is brought somewhere; ``height`` along the normal.
    """

    chain: Chain
    axes: ZeroAxes
    joints: PlanarJoints
    plane: Array
    point: Array
    height: float
    exact_only: bool = False
    numbered: bool = True

    @classmethod
    def of(cls, chain: Chain, point: Array) -> "PlanarArm | None":
        """Return the closed form for a point ``(3,)`` m of the last frame; None where the shape is another."""
        if chain.size not in (2, 3):
            return None
        axes = ZeroAxes.of(chain)
        hinges = [i for i in range(chain.size) if not chain.prismatic[i]]
        normal = axes.directions[hinges[0]] if hinges else np.cross(*axes.directions[:2])
        if np.linalg.norm(normal) < EXACT:
            return None
        plane = plane_across(normal / np.linalg.norm(normal))
        start = se3.transform(axes.T_frame0_last, point[None])[0]
        joints = PlanarJoints.of(axes, tuple(range(chain.size)), plane, start)
        return None if joints is None else cls(chain, axes, joints, plane, point, float(plane[2] @ start))

    @property
    def branches(self) -> int:
        """Number of solutions for a pose."""
        return self.joints.roots

    @property
    def by_point(self) -> bool:
        """True with two joints: only the place of a point is met."""
        return self.chain.size == 2

    @property
    def determinant(self) -> Determinant:
        """Determinant of the point's displacements along e and f, and with three joints the turn about the normal."""
        lengths, factors = self.joints.factors(self.chain.sign)
        plain = determinant(self.chain.joint_names, 1.0, lengths, factors)
        arm = SerialArm(self.chain)
        joints = rng_for(0, "structure").uniform(-1.0, 1.0, (1, self.chain.size))
        J = arm.tool(joints, arm.nominal({arm.targets[0]: self.point}))[1][0]
        rows = np.concatenate([self.plane[:2] @ J[:3], self.plane[2:] @ J[3:]])[: self.chain.size]
        sign = float(np.sign(np.linalg.det(rows) * plain.at(joints[0])))
        return determinant(self.chain.joint_names, sign, lengths, factors)

    @property
    def moved(self) -> str:
        """Description of the determinant's motions."""
        return "the displacements in its plane" + ("" if self.by_point else " and the turn about the plane's normal")

    def nearest_rotations(self, Rs_frame0_last: Array) -> Array:
        """See ``ClosedForm``: turned about the normal alone; with two joints a missing rotation is no turn."""
        if self.by_point:
            given = np.asarray(np.isfinite(Rs_frame0_last).all(axis=(1, 2)))
            return np.where(given[:, None, None], Rs_frame0_last, np.eye(3))
        turn = self._turn(Rs_frame0_last)[0]
        return np.asarray(se3.exp(turn[:, None] * self.plane[2]) @ self.axes.T_frame0_last[:3, :3])

    def solve(self, Ts_frame0_last: Array, reference: Array | float = 0.0) -> Solutions:
        """See ``ClosedForm``. The point's place is met, turned as near to a pose's rotation as possible."""
        count, size = len(Ts_frame0_last), self.chain.size
        preferred = (np.broadcast_to(reference, (count, size)) * self.chain.sign).T
        turn, tilt = self._turn(Ts_frame0_last[:, :3, :3])
        e, f, w = self.plane @ se3.transform(Ts_frame0_last, self.point[None])[:, 0].T
        values, gap, free = self.joints.solve(e + 1j * f, None if self.by_point else turn, preferred)
        hinges = ~np.array(self.chain.prismatic)
        values[:, hinges] -= 2 * np.pi * np.round(values[:, hinges] / (2 * np.pi))
        joints = values.transpose(2, 0, 1) * self.chain.sign
        gap = np.hypot(gap, unless_tiny(np.abs(w - self.height), _IN_PLANE_M))
        if self.by_point:
            tilt = self._missed(joints, Ts_frame0_last[:, :3, :3])
        shape = (count, self.branches)
        return Solutions(
            joints,
            np.broadcast_to(gap[:, None], shape).copy(),
            np.broadcast_to(tilt.reshape(count, -1), shape).copy(),
            np.broadcast_to(free.T[:, None], joints.shape).copy(),
        )

    def _missed(self, joints: Array, Rs: Array) -> Array:
        turns = (joints * self.chain.sign * self.joints.turning * ~np.array(self.chain.prismatic)).sum(axis=2)
        made = se3.exp(turns[..., None] * self.plane[2]) @ self.axes.T_frame0_last[:3, :3]
        tilt = np.linalg.norm(se3.log(Rs[:, None] @ made.swapaxes(2, 3)), axis=2)
        return np.asarray(np.where(tilt <= EXACT, 0.0, tilt))

    def _turn(self, Rs: Array) -> tuple[Array, Array]:
        """Return the turn ``(n,)`` rad of rotations about the normal, and their remaining tilt."""
        return _turn_about_normal(self.plane @ Rs @ self.axes.T_frame0_last[:3, :3].T @ self.plane.T)


def _turn_about_normal(M: Array) -> tuple[Array, Array]:
    """Return the turn ``(n,)`` rad of rotations, in the axes of a plane, about its normal, and their remaining tilt."""
    tilt = np.arctan2(np.hypot(M[:, 2, 0], M[:, 2, 1]), M[:, 2, 2])
    turn = np.arctan2(M[:, 1, 0] - M[:, 0, 1], M[:, 0, 0] + M[:, 1, 1])
    return turn, np.where(tilt <= EXACT, 0.0, tilt)


@dataclass(frozen=True)
class Scara:
    """A SCARA arm, by its axes in frame 0 at zero joint positions.

    Attributes:
        hinges, slide: which joints they are.
        up: ``(4,)`` 1 where an axis points as that of the first hinge does, else -1, times the joint position's sign.
        plane: ``(3, 3)`` rows e and f, across the axes, and w, along that of the first hinge.
        root: on it ``(3,)`` m.
        upper, fore: in the plane (m): the second hinge from the first one, and the third from the second.
        height: of the wrist over the root, along w (m), the slide drawn in.
        wrist: where the third hinge is ``(3,)`` in the last frame (m).
        R_frame0_last: rotation ``(3, 3)`` of the last frame.
    """

    chain: Chain
    hinges: tuple[int, ...]
    slide: int
    up: Array
    plane: Array
    root: Array
    upper: complex
    fore: complex
    height: float
    wrist: Array
    R_frame0_last: Array
    branches: int = 2
    by_point: bool = False
    exact_only: bool = False
    numbered: bool = True
    moved: str = "all displacements and the turn about the axes"

    @classmethod
    def of(cls, chain: Chain) -> "Scara | None":
        """Return the closed form of a nominal model; None where its shape is another."""
        if chain.size != 4 or sum(chain.prismatic) != 1:
            return None
        axes, slide = ZeroAxes.of(chain), chain.prismatic.index(True)
        hinges = tuple(i for i in range(4) if i != slide)
        if not all(axes.parallel(0, i) for i in range(1, 4)):
            return None
        root, elbow, wrist = axes.origins[list(hinges)]
        w = axes.directions[hinges[0]]
        plane = plane_across(w)
        upper, fore = in_plane(plane, elbow - root), in_plane(plane, wrist - elbow)
        if min(abs(upper), abs(fore)) < EXACT:
            return None
        return cls(
            chain=chain,
            hinges=hinges,
            slide=slide,
            up=np.sign(axes.directions @ w) * chain.sign,
            plane=plane,
            root=root,
            upper=upper,
            fore=fore,
            height=float(w @ (wrist - root)),
            wrist=se3.transform(se3.inverse(axes.T_frame0_last), wrist[None])[0],
            R_frame0_last=axes.T_frame0_last[:3, :3],
        )

    @property
    def determinant(self) -> Determinant:
        """Determinant for x, y, z of the last hinge and the turn about w, in a right-handed frame whose z is w."""
        across = np.conj(self.upper) * self.fore / abs(self.upper)
        elbow = real_part(-1j * across, [(self.hinges[1], float(self.up[self.hinges[1]]))])
        sign = float(np.prod(self.up)) * (-1.0) ** self.slide  # the slide's column moved to the third place
        return determinant(self.chain.joint_names, sign, [abs(self.upper)], [("elbow", elbow)])

    def nearest_rotations(self, Rs_frame0_last: Array) -> Array:
        """See ``ClosedForm``: turned about w alone."""
        return self._at(self._turn(Rs_frame0_last)[0])

    def solve(self, Ts_frame0_last: Array, reference: Array | float = 0.0) -> Solutions:
        """See ``ClosedForm``. Of a tilted pose the place is met, turned as near to it as possible."""
        count = len(Ts_frame0_last)
        yaw, tilt = self._turn(Ts_frame0_last[:, :3, :3])
        preferred = np.broadcast_to(reference, (count, 4)) * self.up
        e, f, w = self.plane @ (Ts_frame0_last[:, :3, 3] + self._at(yaw) @ self.wrist - self.root).T
        bent = float(np.angle(self.upper))
        first, second, third = self.hinges
        (shoulder, elbow), gap, (free, _) = type_8(
            abs(self.upper), abs(self.fore), e, f, TINY, (preferred[:, first] + bent, 0.0), BEND
        )
        joints = np.empty((count, 2, 4))
        joints[:, :, first] = (shoulder - bent).T
        joints[:, :, second] = (elbow + bent - np.angle(self.fore)).T
        joints[:, :, third] = yaw[:, None] - joints[:, :, first] - joints[:, :, second]
        hinges = list(self.hinges)
        joints[:, :, hinges] -= 2 * np.pi * np.round(joints[:, :, hinges] / (2 * np.pi))
        joints[:, :, self.slide] = type_1(1.0, w - self.height).values[0].T
        frees = np.zeros(joints.shape, dtype=np.bool_)
        frees[:, :, first] = free[:, None]
        shape = (count, 2)
        return Solutions(
            joints * self.up,
            np.broadcast_to(gap[:, None], shape).copy(),
            np.broadcast_to(tilt[:, None], shape).copy(),
            frees,
        )

    def _turn(self, Rs: Array) -> tuple[Array, Array]:
        """Return the turn ``(n,)`` rad of rotations about w, and their remaining tilt."""
        return _turn_about_normal(self.plane @ Rs @ self.R_frame0_last.T @ self.plane.T)

    def _at(self, yaw: Array) -> Array:
        """Return rotations ``(n, 3, 3)`` of the last frame, turned about w."""
        return np.asarray(se3.exp(yaw[:, None] * self.plane[2]) @ self.R_frame0_last)
