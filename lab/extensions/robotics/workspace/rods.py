"""A platform on rods whose lengths are the joints, as a hexapod's: a pose says the lengths without a search."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from lab.core import se3
from lab.core.se3 import Array
from lab.kinematics.closed.configuration import Configuration
from lab.kinematics.closed.mechanism import Mechanism
from lab.kinematics.inverse.newton import FREEDOMS, PoseTarget

__all__ = ["ByRods"]

_SLACK_M = 1e-9  # beyond a limit


@dataclass(frozen=True)
class ByRods:
    """Such a mechanism and the point of its tool.

    The lengths from the base to the platform are distances of points, so that each pose has one set of joint positions
    (e.g. Merlet 2006, Parallel Robots, section 3.1). Of two poses with the same lengths that one counts which is on the
    same side of the parallel singularities as the nominal position.

    Attributes:
        anchors: ``(6, 3)`` m, the rods' ends in the base, and ``corners`` in the platform's frame.
        zeros: ``(6,)`` m, the rods' lengths at joint positions zero.
        order: ``(6,)`` the joint that measures each rod.
        tool: ``(3,)`` m in the platform's frame.
    """

    mechanism: Mechanism
    anchors: Array
    corners: Array
    zeros: Array
    order: NDArray[np.int_]
    T_home: Array
    tool: Array
    exact: bool = True

    @classmethod
    def of(cls, mechanism: Mechanism, tool: Array) -> "ByRods | None":
        """Such a mechanism with a point ``(3,)`` m of its platform; None of another."""
        tree = mechanism.tree
        joints = [rod.joint for rod in tree.rods]
        if tree.pins or len(joints) != FREEDOMS or None in joints or len(set(joints)) != mechanism.size:
            return None
        if any({step[0] for step in tree.passive} - {tree.platform} for _ in tree.passive):
            return None
        home, dimensions = mechanism.home[None], mechanism.dimensions(mechanism.nominal_values)
        passive = mechanism.assembled(home, mechanism.nominal_values).configuration.passive
        at = Configuration.of(tree, dimensions, home, passive)
        axes, origin = at.frames[tree.platform]
        T = se3.pose(np.stack([_flat(axis) for axis in axes], axis=1), _flat(origin))
        moves = [[tree.loose[end] for end in rod.ends] for rod in tree.rods]
        if any(sum(each) != 1 for each in moves):
            return None
        ends = np.array([[_flat(at.frames[end][1]) for end in rod.ends] for rod in tree.rods])
        rows, held = np.arange(FREEDOMS), np.array([each.index(False) for each in moves])
        corners = se3.transform(se3.inverse(T), ends[rows, 1 - held])
        order = np.array(joints, dtype=np.int_)
        return cls(mechanism, ends[rows, held], corners, np.array(dimensions.lengths), order, T, tool)

    def reached(self, wanted: PoseTarget) -> tuple[NDArray[np.bool_], Array]:
        """Which poses ``(n,)`` are reached, and joint positions ``(n, joints)`` that do, NaN where there are none."""
        Ts = se3.pose(wanted.rotations, wanted.positions - wanted.rotations @ self.tool)
        lengths, sides = self._seen(Ts)
        joints = np.empty((len(wanted), FREEDOMS))
        joints[:, self.order] = (lengths - self.zeros) * self.mechanism.sign[self.order]
        reached = ~self.mechanism.beyond_limits(joints, _SLACK_M).any(axis=1) & (sides == self._side)
        return reached, np.where(reached[:, None], joints, np.nan)

    def ways(self, wanted: PoseTarget) -> Array:
        """The one."""
        return self.reached(wanted)[1][:, None]

    @cached_property
    def _side(self) -> float:
        return float(self._seen(self.T_home[None])[1][0])

    def _seen(self, Ts: Array) -> tuple[Array, Array]:
        """Lengths ``(n, 6)`` m of the rods at poses ``(n, 4, 4)``, and the sign of the determinant of their lines."""
        levers = np.einsum("nij,kj->nki", Ts[:, :3, :3], self.corners)
        rods = levers + Ts[:, None, :3, 3] - self.anchors
        lengths = np.linalg.norm(rods, axis=2)
        lines = np.concatenate([rods, np.cross(levers, rods)], axis=2)
        return lengths, np.sign(np.linalg.det(lines))


def _flat(vector: Array) -> Array:
    """The first three rows of a vector of one pose, ``(3,)``."""
    return np.broadcast_to(vector[:3].reshape(3, -1), (3, 1))[:, 0].copy()
