"""Five joints of which 3 to 5 are a planar arm at the end: hinges with parallel axes, or slides across them.

Joints 3 to 5 turn about one direction w and leave the heights along it as they are. So joints 1 and 2 alone turn w to
where a pose has it. Of two hinges, the angle between w and axis 1 says joint 2 (an equation of type 2), and then the
direction of w joint 1. Of two hinges with parallel axes the direction says their sum, and the height joint 1 (type 2);
of a hinge and a slide after it the direction says the hinge, and the height the slide. Joints 3 to 5 are then the
planar arm's.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from lab.core import se3
from lab.core.se3 import Array
from lab.extensions.robotics.inverse.first_joint import Named
from lab.extensions.robotics.inverse.five_axes_planar import PlanarFrame, candidates_of, compiled_frame
from lab.extensions.robotics.inverse.khalil_one_unknown import TINY, type_2
from lab.extensions.robotics.inverse.planar_joints import PlanarJoints
from lab.kinematics.inverse.closed_form import EXACT, Axes, Candidates, Term, plane_across

__all__ = ["PlanarEnd"]


@dataclass(frozen=True)
class PlanarEnd:
    """Such an arm.

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
        """The shape of an arm of five joints; None where it is another."""
        hinges = [i for i in (2, 3, 4) if not axes.prismatic[i]]
        if not hinges or axes.prismatic[0]:
            return None
        w = axes.directions[hinges[0]]
        plane, start = plane_across(w), axes.T_frame0_last[:3, 3]
        joints = PlanarJoints.of(axes, (2, 3, 4), plane, start)
        made = None if joints is None else cls(axes, joints, plane, start, np.zeros(3))
        return None if made is None or made._still(hinges[0]) else made

    def _still(self, hinge: int) -> bool:
        """Whether joints 1 and 2 do not both move w or its height, or may turn w along axis 1.

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
        """Whether joints 1 and 2 are hinges with parallel axes."""
        return not self.axes.prismatic[1] and self.axes.parallel(0, 1)

    @property
    def _lever(self) -> Array:
        """The vector ``(3,)`` whose part along w, turned by joint 2, is zero where the two joints are singular."""
        first, second = self.axes.directions[:2]
        return np.asarray(np.cross(first, self.axes.origins[1] - self.axes.origins[0] if self._sum else second))

    def _turned_part(self, vector: Array) -> tuple[float, float, float]:
        """Of w, turned by joint 2, the part along a vector: what is fixed, and what goes with cosine and sine."""
        w, axis = self.plane[2], self.axes.directions[1]
        along = axis * (axis @ w)
        return float(vector @ along), float(vector @ (w - along)), float(vector @ np.cross(axis, w))

    @property
    def roots(self) -> int:
        """See ``Shape``."""
        return (1 if self.axes.prismatic[1] else 2) * self.joints.roots

    def candidates(self, Ts: Array, liked: Array) -> Iterator[Candidates]:
        """See ``Shape``."""
        frame = compiled_frame(self._numbers, 1 if self.axes.prismatic[1] else 2, Ts, liked)
        yield candidates_of(self.joints, (0, 1), (2, 3, 4), frame or self._frame(Ts, liked), liked)

    def _frame(self, Ts: Array, liked: Array) -> PlanarFrame:
        """What joints 1 and 2 leave to the planar arm, as ``PlanarMiddle`` has it; neither is free."""
        R, place = Ts[:, :3, :3] @ self.axes.T_frame0_last[:3, :3].T, Ts[:, :3, 3].T
        first, second = self._first_two(R @ self.plane[2], place, liked)  # (m, n)
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

    @cached_property
    def _numbers(self) -> Array:
        """What the compiled frame asks of the arm."""
        axes, kind = self.axes, 4.0 if self.axes.prismatic[1] else 3.0 if self._sum else 2.0
        nothing, back = np.zeros(3), self.plane @ self.axes.T_frame0_last[:3, :3]
        parts = (
            [kind], axes.directions[:2], axes.origins[:2], self.plane, back, nothing, nothing, nothing, self.start,
            [1.0, *self._turned_part(axes.directions[0])],
        )  # fmt: skip
        return np.concatenate([np.ravel(part) for part in parts])

    def _first_two(self, seen: Array, place: Array, liked: Array) -> tuple[Array, Array]:
        """Joints 1 and 2 ``(m, n)`` that turn w to directions ``(n, 3)``.

        Args:
            place: ``(3, n)`` m, where the last frame's origin is wanted.
        """
        w, (first_axis, axis), (root, origin) = self.plane[2], self.axes.directions[:2], self.axes.origins[:2]
        if self.axes.prismatic[1]:
            rest = (seen * (place.T - root)).sum(axis=1) - w @ (self.start - root)
            return _turn(first_axis, w, seen)[None], (rest / (w @ axis))[None]
        if self._sum:
            lever = root - origin
            rest = w @ (self.start - origin) - (seen * (place.T - root)).sum(axis=1)
            along = first_axis * (first_axis @ lever)
            (roots,), _, _ = type_2(
                seen @ np.cross(first_axis, lever), seen @ (lever - along), rest - seen @ along, TINY, liked[0]
            )
            return roots, float(np.sign(first_axis @ axis)) * (_turn(first_axis, w, seen) - roots)
        fixed, cosine, sine = (np.full(len(seen), part) for part in self._turned_part(first_axis))
        (second,), _, _ = type_2(sine, cosine, seen @ first_axis - fixed, TINY, liked[1])
        turned = se3.exp(second[..., None] * axis) @ w
        return _turn(first_axis, turned, np.broadcast_to(seen, turned.shape)), second

    def factors(self) -> tuple[list[float], list[Named]]:
        """See ``Shape``: the planar arm's, and how joints 1 and 2 turn w or lift along it."""
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
        """See ``Shape``."""
        what = "base's origin, seen from the last frame," if backwards else "last frame's origin"
        both = "direction" if not (self.axes.prismatic[1] or self._sum) else "direction and the height"
        return f"the displacements of the {what} across the parallel axes, the turn about them, and their {both}"

    def rows(self, jacobian: Array) -> Array:
        """See ``Shape``: place and turn of the planar arm, and of w the direction, or one turn and the height."""
        hinge = next(i for i in (2, 3, 4) if not self.axes.prismatic[i])
        w = jacobian[3:, hinge]
        across = plane_across(w)[:2]
        held = across @ jacobian[3:]
        if self._sum or self.axes.prismatic[1]:
            turn = held[:, 0]
            held = np.stack([w @ jacobian[:3], turn @ held / np.linalg.norm(turn)])
            planar = np.concatenate([across @ jacobian[:3], (w @ jacobian[3:])[None]])
            return np.concatenate([planar, held])
        return np.concatenate([across @ jacobian[:3], (w @ jacobian[3:])[None], held])


def _turn(axis: Array, start: Array, end: Array) -> Array:
    """Turns ``(...)`` about an axis that bring directions nearest to others ``(..., 3)``."""
    along, ahead = start - (start @ axis)[..., None] * axis, np.cross(axis, start)
    return np.asarray(np.arctan2((ahead * end).sum(axis=-1), (along * end).sum(axis=-1)))
