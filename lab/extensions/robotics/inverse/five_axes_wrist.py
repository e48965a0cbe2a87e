"""Five joints of which 4 and 5 are hinges whose axes meet in a point P: a wrist without its last axis.

Joints 1 to 3 bring P to its place: in closed form, whatever they are (``first_three_joints``, ``three_joints``). Then
joint 4 turns axis 5, and joint 5 what is left. Where P comes onto a hinge's axis its place does not say that joint; the
angle between axes 4 and 5 does, by an equation of type 2.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from lab.core import se3
from lab.core.se3 import Array
from lab.extensions.robotics.inverse.first_joint import Carrier, Named
from lab.extensions.robotics.inverse.first_three_joints import Elbow, Lift, Telescope
from lab.extensions.robotics.inverse.khalil_one_unknown import TINY, type_2
from lab.extensions.robotics.inverse.three_joints import ThreeJoints
from lab.kinematics.compiled.kernels import machine_code
from lab.kinematics.inverse.closed_form import EXACT, Axes, Candidates, meeting_point

__all__ = ["TwoAxisWrist"]

_ON_AXIS = 1e-6  # m: so near to a hinge's axis the place says little of its turn


@dataclass(frozen=True)
class TwoAxisWrist:
    """Such an arm.

    Attributes:
        carrier: joints 1 to 3, where they are a classical carrier; ``three`` what else they are.
        start: P ``(3,)`` m in frame 0 at zero joint positions, and ``centre`` in the last frame.
    """

    axes: Axes
    carrier: Carrier | None
    three: ThreeJoints
    start: Array
    centre: Array
    repeats: bool = False

    @classmethod
    def of(cls, axes: Axes) -> "TwoAxisWrist | None":
        """The shape of an arm of five joints; None where it is another."""
        if any(axes.prismatic[3:]) or axes.parallel(3, 4):
            return None
        start, missed = meeting_point(axes.origins[3:], axes.directions[3:])
        if missed > EXACT:
            return None
        three = ThreeJoints.by_axes(axes.first(3), start)
        if three is None:
            return None
        carrier = Elbow.of(axes, start) or Telescope.of(axes, start) or Lift.of(axes, start)
        centre = se3.transform(se3.inverse(axes.T_frame0_last), start[None])[0]
        return cls(axes, carrier, three, start, centre)

    @property
    def roots(self) -> int:
        """See ``Shape``."""
        return self.three.branches if self.carrier is None else 2 * self.carrier.elbows

    def candidates(self, Ts: Array, liked: Array) -> Iterator[Candidates]:
        """See ``Shape``: where P is on a hinge's axis there are more of them."""
        R = Ts[:, :3, :3] @ self.axes.T_frame0_last[:3, :3].T
        place = (Ts[:, :3, :3] @ self.centre + Ts[:, :3, 3]).T
        first, free = self._placed(place, liked[:3])  # (k, 3, n)
        compiled = self._compiled(Ts, first)
        found, near = (self._wrist(R, first), self._near(first)) if compiled is None else compiled
        if not near.any():
            yield slice(None), found, _with_wrist(free)
            return
        away, there = np.flatnonzero(~near), np.flatnonzero(near)
        yield away, found[..., away], _with_wrist(free[..., away])
        first, free = self._by_rotation(R[there], first[..., there], free[..., there])
        yield there, self._wrist(R[there], first), _with_wrist(free)

    def _wrist(self, R: Array, first: Array) -> Array:
        """Candidates ``(k, 5, n)`` by their first three joints: axis 4 turns axis 5, which turns what is left."""
        back = self._turned(first).swapaxes(2, 3) @ R  # (k, n, 3, 3)
        a4, a5 = self.axes.directions[3:]
        fourth = _turn_between(a4, np.broadcast_to(a5, back.shape[:-1]), back @ a5)
        left = se3.exp(-fourth[..., None] * a4) @ back
        fifth = _turn_between(a5, np.broadcast_to(self._across, back.shape[:-1]), left @ self._across)
        return np.concatenate([first, fourth[:, None], fifth[:, None]], axis=1)

    @property
    def _across(self) -> Array:
        """A direction across axis 5."""
        a5 = self.axes.directions[4]
        return np.asarray(np.cross(a5, np.eye(3)[np.argmin(np.abs(a5))]))

    def _compiled(self, Ts: Array, first: Array) -> tuple[Array, NDArray[np.bool_]] | None:
        """``_wrist`` and ``_near`` in machine code; None where there is none."""
        if (code := machine_code()) is None or Ts.dtype != np.float64:
            return None
        count = first.shape[2]
        out, near = np.empty((count, len(first), 5)), np.empty(count, dtype=np.bool_)
        out[:, :, :3] = first.transpose(2, 0, 1)
        code.two_axes(self._numbers, np.ascontiguousarray(Ts), out, near)
        return out.transpose(1, 2, 0), near

    @cached_property
    def _numbers(self) -> Array:
        """What the compiled wrist asks of the arm."""
        back, axes = self.axes.T_frame0_last[:3, :3].T, self.axes
        vectors = (self.start, back @ axes.directions[4], back @ self._across, self._across)
        parts = (axes.prismatic[:3], axes.directions, axes.origins[:3], *vectors)
        return np.concatenate([np.ravel(part).astype(np.float64) for part in parts])

    def _placed(self, place: Array, liked: Array) -> tuple[Array, NDArray[np.bool_]]:
        """Joints 1 to 3 ``(k, 3, n)`` that bring P to places ``(3, n)``."""
        count = place.shape[1]
        if self.carrier is not None:
            shape = (1, self.carrier.elbows, 2, count)
            angles, gap, free = np.empty((3, *shape)), np.empty(shape), np.zeros((3, *shape), dtype=np.bool_)
            self.carrier.solve(place, liked, angles, gap, free)
            return angles.reshape(3, -1, count).swapaxes(0, 1), free.reshape(3, -1, count).swapaxes(0, 1)
        Ts = se3.pose(np.broadcast_to(np.eye(3), (count, 3, 3)), place.T - self.start)
        sign = self.three.axes.sign
        found = self.three.solve(Ts, liked.T * sign, nearest=False)
        return (found.joints * sign).transpose(1, 2, 0), found.free.transpose(1, 2, 0)

    def _by_rotation(self, R: Array, first: Array, free: NDArray[np.bool_]) -> tuple[Array, NDArray[np.bool_]]:
        """More candidates where P is on a hinge's axis: that hinge by the angle between axes 4 and 5."""
        a4, a5 = self.axes.directions[3:]
        for joint in (0, 1):
            if self.axes.prismatic[joint] or not (near := self._on_axis(joint, first)).any():
                continue
            before, after = (self._turned(first, span) for span in (range(joint), range(joint + 1, 3)))
            axis = self.axes.directions[joint]
            held, wanted = after @ a4, before.swapaxes(2, 3) @ R @ a5
            level = wanted - (wanted @ axis)[..., None] * axis
            x = -(np.cross(axis, wanted) * held).sum(axis=-1)
            z = float(a4 @ a5) - (wanted @ axis) * (held @ axis)
            (roots,), _, (still,) = type_2(x, (level * held).sum(axis=-1), z, TINY, first[:, joint])
            more = np.stack([first, first])
            more[:, :, joint] = np.where(near, roots, more[:, :, joint])
            flags = np.stack([free, free])
            flags[:, :, joint] &= still | ~near
            first = np.concatenate([first, *more])
            free = np.concatenate([free, *flags])
        return first, free

    def _near(self, first: Array) -> NDArray[np.bool_]:
        """``(n,)`` where P is on the axis of a hinge in one of the candidates."""
        near = np.zeros(first.shape[2], dtype=np.bool_)
        for joint in (0, 1):
            if not self.axes.prismatic[joint]:
                near |= self._on_axis(joint, first).any(axis=0)
        return near

    def _on_axis(self, joint: int, first: Array) -> NDArray[np.bool_]:
        """``(k, n)`` where P, carried by the joints after it, is on a hinge's axis."""
        at = np.broadcast_to(self.start[:, None], (3, first.shape[0] * first.shape[2]))
        rows = first.transpose(1, 0, 2).reshape(3, -1)
        for each in range(2, joint, -1):
            at = self.axes.carried(each, rows[each], at)
        lever = at - self.axes.origins[joint][:, None]
        off = np.linalg.norm(np.cross(self.axes.directions[joint], lever, axisb=0), axis=1)
        return np.asarray((off < _ON_AXIS).reshape(first.shape[0], -1))

    def _turned(self, first: Array, span: range = range(3)) -> Array:
        """Rotations ``(k, n, 3, 3)`` of the last of some joints, from where it is at zero joint positions."""
        R = np.broadcast_to(np.eye(3), (first.shape[0], first.shape[2], 3, 3))
        for joint in span:
            if not self.axes.prismatic[joint]:
                R = R @ se3.exp(first[:, joint, :, None] * self.axes.directions[joint])
        return np.asarray(R)

    def factors(self) -> tuple[list[float], list[Named]]:
        """See ``Shape``: those of joints 1 to 3."""
        found = self.three.determinant
        return list(found.lengths), [(each.name, each.terms) for each in found.factors]

    def moved(self, backwards: bool) -> str:
        """See ``Shape``."""
        meet = "axes 1 and 2 meet, seen from the last frame" if backwards else "axes 4 and 5 meet"
        return f"the displacements of where {meet}"

    def rows(self, jacobian: Array) -> Array:
        """See ``Shape``: of joints 1 to 3, the place."""
        return jacobian[:3, :3]


def _with_wrist(free: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """What is free ``(k, 5, n)`` of all joints, of which the last two never are."""
    return np.concatenate([free, np.zeros_like(free[:, :2])], axis=1)


def _turn_between(axis: Array, start: Array, end: Array) -> Array:
    """Turns ``(...)`` about an axis that bring directions ``(..., 3)`` nearest to others."""
    along, ahead = start - (start @ axis)[..., None] * axis, np.cross(axis, start)
    return np.asarray(np.arctan2((ahead * end).sum(axis=-1), (along * end).sum(axis=-1)))
