"""Posture of an arm in a controller's position data: on which side its wrist and its elbow are.

The wrist's centre is where axis 5 comes nearest to axis 4. In front means on the side of axis 1 on which it is at zero
joint positions; the upper elbow is the one that is above the line from axis 2 to the wrist while that is in front.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lab.core import se3
from lab.core.se3 import Array
from lab.kinematics.inverse.closed_form import Axes
from lab.kinematics.model import RigidArm
from lab.kinematics.serial.chain import Chain

__all__ = ["ArmShape", "Postures", "postures_of"]

_ACROSS = 1e-9  # two axes whose cross product is smaller are parallel


@dataclass(frozen=True)
class ArmShape:
    """The nominal model of an arm with six revolute joints, as far as configurations ask for it.

    Attributes:
        chain: nominal.
        directions, origins: ``(6, 3)`` of the axes in frame 0 at zero joint positions (m).
        wrist: ``(3,)`` m, the wrist's centre there.
        forward: ``(3,)`` the side of axis 1 on which it is, a unit vector across axes 1 and 2.
    """

    chain: Chain
    directions: Array
    origins: Array
    wrist: Array
    forward: Array

    @classmethod
    def of(cls, chain: Chain) -> "ArmShape":
        """The shape of a nominal model."""
        axes = Axes.of(chain)
        wrist = _nearest_point(axes.origins[4], axes.directions[4], axes.origins[3], axes.directions[3])
        forward = np.cross(axes.directions[1], axes.directions[0])
        length = np.linalg.norm(forward)
        forward = forward / length if length > _ACROSS else np.array([1.0, 0.0, 0.0])
        if (wrist - axes.origins[0]) @ forward < 0:
            forward = -forward
        return cls(chain, axes.directions, axes.origins, wrist, forward)

    def in_front(self, joints: Array) -> NDArray[np.bool_]:
        """``(n,)``: whether the wrist is in front of axis 1 at joint positions ``(n, 6)`` rad."""
        return np.asarray((self._moved(self.wrist, joints, 1, 4) - self.origins[0]) @ self.forward >= 0)

    def elbow_up(self, joints: Array) -> NDArray[np.bool_]:
        """``(n,)``: whether it is the upper of the two elbows at joint positions ``(n, 6)`` rad."""
        shoulder, across = self.origins[1], self.directions[1]
        elbow = self._moved(self.origins[2], joints, 1, 2) - shoulder
        wrist = self._moved(self.wrist, joints, 1, 4) - shoulder
        side = np.cross(elbow, wrist) @ across
        return np.asarray(side * (np.cross(self.directions[0], self.forward) @ across) >= 0)

    def _moved(self, point: Array, joints: Array, first: int, last: int) -> Array:
        """Return the point ``(3,)`` m given at zero after joints ``first`` up to before ``last`` move, ``(n, 3)``."""
        found = np.broadcast_to(point, (len(joints), 3))
        for i in reversed(range(first, last)):
            turns = se3.exp((self.chain.sign[i] * joints[:, i])[:, None] * self.directions[i])
            found = self.origins[i] + np.einsum("nij,nj->ni", turns, found - self.origins[i])
        return np.asarray(found)


@dataclass(frozen=True)
class Postures:
    """The nominal arm at some joint positions.

    Attributes:
        Ts_frame0_last: ``(s, 4, 4)`` poses (m) of the table's last frame in its frame 0.
        in_front, elbow_up: ``(s,)`` as ``ArmShape`` says.
    """

    Ts_frame0_last: Array
    in_front: NDArray[np.bool_]
    elbow_up: NDArray[np.bool_]


def postures_of(arm: RigidArm, values: Array, joints: Array) -> Postures | None:
    """The postures at joint positions ``(s, 6)`` rad of an arm with these parameters; None for one without a table."""
    chain = arm.dh_chain(values)
    if chain is None or chain.size != 6:
        return None
    shape = ArmShape.of(chain)
    Ts_tracker_tool = arm.tool(joints, values)[0]
    T_last_tool = np.eye(4)
    T_last_tool[:3, 3] = values[-3 * len(arm.targets) :][:3]
    Ts = se3.inverse(arm.T_tracker_frame0(values)) @ Ts_tracker_tool @ se3.inverse(T_last_tool)
    return Postures(Ts, shape.in_front(joints), shape.elbow_up(joints))


def _nearest_point(on: Array, along: Array, other: Array, other_along: Array) -> Array:
    """The point ``(3,)`` of a line that comes nearest to another line; of parallel ones the point that is given."""
    normal = np.cross(along, other_along)
    square = float(normal @ normal)
    if square < _ACROSS:
        return on
    return np.asarray(on + along * (np.cross(other - on, other_along) @ normal) / square)
