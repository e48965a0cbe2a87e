"""Inverse kinematics of five-joint arms with a planar arm in the middle or at the end, in closed form.

Middle: joints 2 to 4 turn about one direction w and do not change heights along it. So joints 1 and 5 alone make w
fit: the place of a point of axis 5 along w gives joint 1, and so does the angle between axis 5 and w (both equations of
type 2, of which the better conditioned one is taken). Joint 5 and the turn phi about w are what is left of the
rotation, and joints 2 to 4 the planar arm's.

End: joints 3 to 5 turn about one direction w and do not change heights along it. So joints 1 and 2 alone turn w to its
direction in a pose. Of two hinges, the angle between w and axis 1 gives joint 2 (an equation of type 2), and then the
direction of w joint 1. Of two hinges with parallel axes the direction gives their sum, and the height joint 1 (type 2);
of a hinge and a slide after it the direction gives the hinge, and the height the slide. Joints 3 to 5 are then the
planar arm's.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from lab.core import se3
from lab.core.se3 import Array
from lab.extensions.robotics.inverse.first_joints import FirstJoint, Named, turned_back
from lab.extensions.robotics.inverse.khalil_equations import TINY, type_2
from lab.extensions.robotics.inverse.planar import PlanarJoints
from lab.kinematics.compiled.kernels import planar_frame, with_fallback
from lab.kinematics.inverse.closed_form import EXACT, Axes, Candidates, Term, plane_across

__all__ = ["PlanarEnd", "PlanarMiddle", "turn_between"]

_PlanarFrame = tuple[Array, NDArray[np.bool_]]  # see PlanarMiddle._frame


@dataclass(frozen=True)
class PlanarMiddle:
    """Five joints of which 2 to 4 are a planar arm: hinges with parallel axes, or slides across them.

    Attributes:
        column: joint 1 where it is a hinge; of a slide its plane alone is used.
        joints: 2 to 4, and the point of axis 5 that they move.
        start: that point ``(3,)`` m in frame 0 at zero joint positions, and ``centre`` in the last frame.
        repeats: whether a few Newton steps may lead two candidates of a pose to one solution.
    """

    axes: Axes
    column: FirstJoint
    joints: PlanarJoints
    start: Array
    centre: Array
    repeats: bool = False

    @classmethod
    def of(cls, axes: Axes) -> "PlanarMiddle | None":
        """Return the shape of an arm of five joints; None where it is another."""
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
        return None if joints is None else cls(axes, FirstJoint.of(axes, plane), joints, start, centre)

    @property
    def roots(self) -> int:
        """Number of candidates for a pose."""
        return (1 if self.axes.prismatic[0] else 2) * self.joints.roots

    def candidates(self, Ts: Array, preferred: Array) -> Iterator[Candidates]:
        """Return candidates for poses ``(n, 4, 4)``, in groups of poses with equally many.

        Args:
            preferred: ``(5, n)`` reference of free joints.
        """
        yield _candidates_of(self.joints, (0, 4), (1, 2, 3), self._frame(Ts, preferred), preferred)

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

    def factors(self) -> tuple[list[float], list[Named]]:
        """Factor the determinant, but for its sign: lengths (m), and named factors."""
        sign = self.axes.sign
        lengths, factors = self.joints.factors(sign)
        if self.axes.prismatic[0]:
            return [*lengths, abs(float(self.column.plane[2] @ self.column.axis))], factors
        return lengths, [*factors, ("shoulder", self.joints.place_along(self.column.level, sign))]

    def moved(self, backwards: bool) -> str:
        """Describe the determinant's motions, for an arm fixed at its base or at its last frame."""
        seen = "axis 1, seen from the last frame," if backwards else "axis 5"
        return f"the displacements of a point of {seen} and the turn about the parallel axes"

    def rows(self, jacobian: Array) -> Array:
        """Return the square part of a Jacobian ``(6, 5)`` of the centre that has this determinant."""
        hinge = next(i for i in (1, 2, 3) if not self.axes.prismatic[i])
        return np.concatenate([jacobian[:3, :4], (jacobian[3:, hinge] @ jacobian[3:, :4])[None]])


def _candidates_of(
    arm: PlanarJoints, two: tuple[int, int], three: tuple[int, int, int], frame: _PlanarFrame, preferred: Array
) -> Candidates:
    """Return candidates of all poses, from a planar arm and the two other joints.

    Args:
        two, three: which joints they are.
        preferred: ``(5, n)``.
    """
    (first, second, phi, e, f), free_1 = frame
    values, _, free = arm.solve(e + 1j * f, phi, np.broadcast_to(preferred[list(three), None], (3, *first.shape)))
    out = np.empty((first.shape[1], arm.roots, first.shape[0], 5))  # (n, roots, m, 5)
    out[..., two[0]], out[..., two[1]] = first.T[:, None], second.T[:, None]
    frees = np.zeros(out.shape, dtype=np.bool_)
    frees[..., two[0]] = free_1[:, None, None]
    for i, joint in enumerate(three):
        out[..., joint], frees[..., joint] = values[:, i].transpose(2, 0, 1), free[i].T[:, None]
    shape = (len(out), -1, 5)
    return slice(None), out.reshape(shape).transpose(1, 2, 0), frees.reshape(shape).transpose(1, 2, 0)


def _turn_about(axis: Array, seen: Array) -> Array:
    """Return turns q ``(...)`` with Rot(axis, -q) e3 nearest to directions ``(..., 3)``, for an axis not along e3."""
    e3 = np.array([0.0, 0.0, 1.0])
    level = e3 - axis * axis[2]
    ahead = np.cross(axis, e3)
    return np.asarray(np.arctan2(-(seen @ ahead), seen @ level))


@dataclass(frozen=True)
class PlanarEnd:
    """Five joints of which 3 to 5 are a planar arm: hinges with parallel axes, or slides across them.

    Attributes:
        joints: 3 to 5, and the last frame's origin, which they move; its place at zero joint positions is ``start``.
        plane: ``(3, 3)`` rows e, f and w in frame 0 at zero joint positions.
    """

    axes: Axes
    joints: PlanarJoints
    plane: Array
    start: Array
    centre: Array
    repeats: bool = False

    @classmethod
    def of(cls, axes: Axes) -> "PlanarEnd | None":
        """Return the shape of an arm of five joints; None where it is another."""
        hinges = [i for i in (2, 3, 4) if not axes.prismatic[i]]
        if not hinges or axes.prismatic[0]:
            return None
        w = axes.directions[hinges[0]]
        plane, start = plane_across(w), axes.T_frame0_last[:3, 3]
        joints = PlanarJoints.of(axes, (2, 3, 4), plane, start)
        made = None if joints is None else cls(axes, joints, plane, start, np.zeros(3))
        return None if made is None or made._still(hinges[0]) else made

    def _still(self, hinge: int) -> bool:
        """Decide whether joints 1 and 2 do not both move w or its height, or may turn w along axis 1.

        Four axes are parallel then, and joint 1 is free, but not anywhere: the search answers for such arms.
        """
        axes, slides = self.axes, self.axes.prismatic[1]
        w, (first, second) = self.plane[2], axes.directions[:2]
        if slides:
            return axes.parallel(0, hinge) or abs(float(w @ second)) <= EXACT
        if axes.parallel(1, hinge):
            return True
        if not self._sum and abs(abs(float(w @ second)) - abs(float(first @ second))) <= EXACT:
            return True
        return float(np.hypot(*self._turned_part(self._lever)[1:])) <= EXACT

    @property
    def _sum(self) -> bool:
        """Joints 1 and 2 are hinges with parallel axes."""
        return not self.axes.prismatic[1] and self.axes.parallel(0, 1)

    @property
    def _lever(self) -> Array:
        """The vector ``(3,)`` whose part along w, turned by joint 2, is zero where the two joints are singular."""
        first, second = self.axes.directions[:2]
        return np.asarray(np.cross(first, self.axes.origins[1] - self.axes.origins[0] if self._sum else second))

    def _turned_part(self, vector: Array) -> tuple[float, float, float]:
        """Split the part along a vector of w, turned by joint 2, into its constant, cosine and sine terms."""
        w, axis = self.plane[2], self.axes.directions[1]
        along = axis * (axis @ w)
        return float(vector @ along), float(vector @ (w - along)), float(vector @ np.cross(axis, w))

    @property
    def roots(self) -> int:
        """See ``PlanarMiddle``."""
        return (1 if self.axes.prismatic[1] else 2) * self.joints.roots

    def candidates(self, Ts: Array, preferred: Array) -> Iterator[Candidates]:
        """See ``PlanarMiddle``."""
        yield _candidates_of(self.joints, (0, 1), (2, 3, 4), self._frame(Ts, preferred), preferred)

    def _frame_by_numpy(self, Ts: Array, preferred: Array) -> _PlanarFrame:
        R, place = Ts[:, :3, :3] @ self.axes.T_frame0_last[:3, :3].T, Ts[:, :3, 3].T
        first, second = self._first_two(R @ self.plane[2], place, preferred)  # (m, n)
        back, axes = np.broadcast_to(R, (*first.shape, 3, 3)), self.axes
        at = np.broadcast_to(place[:, None], (3, *first.shape))
        for joint, amount in ((0, first), (1, second)):
            at = axes.carried(joint, -amount, at)
            if not axes.prismatic[joint]:
                back = se3.exp(-amount[..., None] * axes.directions[joint]) @ back
        M = self.plane @ back @ self.plane.T
        phi = np.arctan2(M[..., 1, 0] - M[..., 0, 1], M[..., 0, 0] + M[..., 1, 1])
        e, f, _ = np.tensordot(self.plane, at, 1)
        return np.stack([first, second, phi, e, f]), np.zeros(len(Ts), dtype=np.bool_)

    @with_fallback(_frame_by_numpy)
    def _frame(self, Ts: Array, preferred: Array) -> _PlanarFrame:
        """Solve joints 1 and 2, and return the planar arm's targets as ``PlanarMiddle`` does; neither is free."""
        return planar_frame(self._numbers, 1 if self.axes.prismatic[1] else 2, Ts, preferred)

    @cached_property
    def _numbers(self) -> Array:
        """Arm parameters of the compiled frame."""
        axes, kind = self.axes, 4.0 if self.axes.prismatic[1] else 3.0 if self._sum else 2.0
        nothing, back = np.zeros(3), self.plane @ self.axes.T_frame0_last[:3, :3]
        parts = (
            [kind], axes.directions[:2], axes.origins[:2], self.plane, back, nothing, nothing, nothing, self.start,
            [1.0, *self._turned_part(axes.directions[0])],
        )  # fmt: skip
        return np.concatenate([np.ravel(part) for part in parts])

    def _first_two(self, seen: Array, place: Array, preferred: Array) -> tuple[Array, Array]:
        """Solve joints 1 and 2 ``(m, n)`` that turn w to directions ``(n, 3)``.

        Args:
            place: ``(3, n)`` m, where the last frame's origin is wanted.
        """
        w, (first_axis, axis), (root, origin) = self.plane[2], self.axes.directions[:2], self.axes.origins[:2]
        if self.axes.prismatic[1]:
            rest = (seen * (place.T - root)).sum(axis=1) - w @ (self.start - root)
            return turn_between(first_axis, w, seen)[None], (rest / (w @ axis))[None]
        if self._sum:
            lever = root - origin
            rest = w @ (self.start - origin) - (seen * (place.T - root)).sum(axis=1)
            along = first_axis * (first_axis @ lever)
            (roots,), _, _ = type_2(
                seen @ np.cross(first_axis, lever), seen @ (lever - along), rest - seen @ along, TINY, preferred[0]
            )
            return roots, float(np.sign(first_axis @ axis)) * (turn_between(first_axis, w, seen) - roots)
        fixed, cosine, sine = (np.full(len(seen), part) for part in self._turned_part(first_axis))
        (second,), _, _ = type_2(sine, cosine, seen @ first_axis - fixed, TINY, preferred[1])
        turned = se3.exp(second[..., None] * axis) @ w
        return turn_between(first_axis, turned, np.broadcast_to(seen, turned.shape)), second

    def factors(self) -> tuple[list[float], list[Named]]:
        """See ``PlanarMiddle``: the planar arm's, and how joints 1 and 2 turn w or lift along it."""
        lengths, factors = self.joints.factors(self.axes.sign)
        w, (first, second) = self.plane[2], self.axes.directions[:2]
        if self.axes.prismatic[1]:
            return [*lengths, abs(float(w @ second)), float(np.linalg.norm(np.cross(first, w)))], factors
        if self._sum:
            lengths = [*lengths, float(np.linalg.norm(np.cross(second, w)))]
        fixed, cosine, sine = self._turned_part(self._lever)
        turn = ((1, 1.0),)
        terms = [Term(fixed), Term(cosine, "cos", turn), Term(float(self.axes.sign[1]) * sine, "sin", turn)]
        return lengths, [*factors, ("shoulder", terms)]

    def moved(self, backwards: bool) -> str:
        """See ``PlanarMiddle``."""
        what = "base's origin, seen from the last frame," if backwards else "last frame's origin"
        both = "direction" if not (self.axes.prismatic[1] or self._sum) else "direction and the height"
        return f"the displacements of the {what} across the parallel axes, the turn about them, and their {both}"

    def rows(self, jacobian: Array) -> Array:
        """See ``PlanarMiddle``: place and turn of the planar arm; direction of w, or one turn and the height."""
        hinge = next(i for i in (2, 3, 4) if not self.axes.prismatic[i])
        w = jacobian[3:, hinge]
        across = plane_across(w)[:2]
        turns = across @ jacobian[3:]
        if self._sum or self.axes.prismatic[1]:
            turn = turns[:, 0]
            turns = np.stack([w @ jacobian[:3], turn @ turns / np.linalg.norm(turn)])
            planar = np.concatenate([across @ jacobian[:3], (w @ jacobian[3:])[None]])
            return np.concatenate([planar, turns])
        return np.concatenate([across @ jacobian[:3], (w @ jacobian[3:])[None], turns])


def turn_between(axis: Array, start: Array, end: Array) -> Array:
    """Return turns ``(...)`` about an axis that bring directions nearest to others ``(..., 3)``."""
    along, ahead = start - (start @ axis)[..., None] * axis, np.cross(axis, start)
    return np.asarray(np.arctan2((ahead * end).sum(axis=-1), (along * end).sum(axis=-1)))
