"""Posture of an arm in a controller's position data: the sides of its wrist and its elbow.

The wrist's centre is the point of axis 5 nearest to axis 4. In front is its side of axis 1 at zero joint positions; the
upper elbow is above the line from axis 2 to a wrist in front.
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

_PARALLEL = 1e-9  # cross product of parallel axes


@dataclass(frozen=True)
class ArmShape:
    """Nominal model of an arm with six revolute joints, for its postures.

    Attributes:
        chain: nominal.
        directions, origins: ``(6, 3)`` of the axes in frame 0 at zero joint positions (m).
        wrist: ``(3,)`` m, the wrist's centre there.
        forward: ``(3,)`` unit vector across axes 1 and 2, to its side of axis 1.
    """

    chain: Chain
    directions: Array
    origins: Array
    wrist: Array
    forward: Array

    @classmethod
    def of(cls, chain: Chain) -> "ArmShape":
        """Return the shape of a nominal model."""
        axes = Axes.of(chain)
        wrist = _nearest_point(axes.origins[4], axes.directions[4], axes.origins[3], axes.directions[3])
        forward = np.cross(axes.directions[1], axes.directions[0])
        length = np.linalg.norm(forward)
        forward = forward / length if length > _PARALLEL else np.array([1.0, 0.0, 0.0])
        if (wrist - axes.origins[0]) @ forward < 0:
            forward = -forward
        return cls(chain, axes.directions, axes.origins, wrist, forward)

    def in_front(self, joints: Array) -> NDArray[np.bool_]:
        """Flag joint positions ``(n, 6)`` rad with the wrist in front of axis 1."""
        return np.asarray((self._moved(self.wrist, joints, 1, 4) - self.origins[0]) @ self.forward >= 0)

    def elbow_up(self, joints: Array) -> NDArray[np.bool_]:
        """Flag joint positions ``(n, 6)`` rad with the upper elbow."""
        shoulder, across = self.origins[1], self.directions[1]
        elbow = self._moved(self.origins[2], joints, 1, 2) - shoulder
        wrist = self._moved(self.wrist, joints, 1, 4) - shoulder
        side = np.cross(elbow, wrist) @ across
        return np.asarray(side * (np.cross(self.directions[0], self.forward) @ across) >= 0)

    def _moved(self, point: Array, joints: Array, first: int, last: int) -> Array:
        """Move the point ``(3,)`` m given at zero by joints ``first`` up to before ``last``, to ``(n, 3)``."""
        found = np.broadcast_to(point, (len(joints), 3))
        for i in reversed(range(first, last)):
            turns = se3.exp((self.chain.sign[i] * joints[:, i])[:, None] * self.directions[i])
            found = self.origins[i] + np.einsum("nij,nj->ni", turns, found - self.origins[i])
        return np.asarray(found)


@dataclass(frozen=True)
class Postures:
    """Postures of the nominal arm at some joint positions.

    Attributes:
        Ts_frame0_last: ``(s, 4, 4)`` poses (m) of the table's last frame in its frame 0.
        in_front, elbow_up: ``(s,)`` of ``ArmShape``.
    """

    Ts_frame0_last: Array
    in_front: NDArray[np.bool_]
    elbow_up: NDArray[np.bool_]


def postures_of(arm: RigidArm, values: Array, joints: Array) -> Postures | None:
    """Return the postures at joint positions ``(s, 6)`` rad of an arm with these parameters; None without a table."""
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
    """Return the point ``(3,)`` of a line nearest to another line; ``on`` for parallel lines."""
    normal = np.cross(along, other_along)
    square = float(normal @ normal)
    if square < _PARALLEL:
        return on
    return np.asarray(on + along * (np.cross(other - on, other_along) @ normal) / square)
