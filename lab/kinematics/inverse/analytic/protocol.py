"""What every closed form returns, can say of itself, and reads off a chain."""

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from lab.core import se3
from lab.core.se3 import Array
from lab.kinematics.inverse.analytic.determinant import Determinant
from lab.kinematics.serial.arm import SerialArm
from lab.kinematics.serial.chain import Chain

__all__ = ["EXACT", "Axes", "Candidates", "ClosedForm", "Solutions", "in_plane", "meeting_point", "plane_across"]

# Some poses, and positions (k, 5, n) along the axes that may reach them, with which joints are free there
Candidates = tuple[slice | NDArray[np.int_], Array, NDArray[np.bool_]]
EXACT = 1e-9  # m or rad: by how much a nominal model may miss the shape that is asked for


@dataclass(frozen=True)
class Solutions:
    """Ways to reach some poses.

    Attributes:
        joints: ``(n, k, joints)`` joint positions, a hinge's between -pi and pi.
        gap_m: ``(n, k)`` how far the target is out of reach, zero where it is reached; else the joints are those that
            come nearest, but for a bend of the elbow (``carriers.BEND``).
        tilt_rad: ``(n, k)`` by how much the rotation is out of reach of arms with fewer than six joints, which come as
            near to it as they can; zero with six.
        free: ``(n, k, joints)``, joints that could have any joint position, because the arm is singular there.
    """

    joints: Array
    gap_m: Array
    tilt_rad: Array
    free: NDArray[np.bool_]


class ClosedForm(Protocol):
    """An arm whose inverse has a closed form."""

    @property
    def branches(self) -> int:
        """How many solutions a pose has, some of which may be out of reach or the same."""

    @property
    def by_point(self) -> bool:
        """Whether the place of a point alone is met: the rotation is not asked for, and may be missed."""

    @property
    def exact_only(self) -> bool:
        """Whether poses that the arm cannot take are not answered by the nearest: their solutions are candidates."""

    @property
    def numbered(self) -> bool:
        """Whether a branch keeps its number as the pose moves: not where the branches are roots in no lasting order."""

    @property
    def determinant(self) -> Determinant:
        """That of the Jacobian, in the factors that are zero at the arm's singularities."""

    @property
    def moved(self) -> str:
        """What motions the determinant is of, in words; all six of six joints."""

    def solve(self, Ts_frame0_last: Array, reference: Array | float = 0.0) -> Solutions:
        """All solutions for poses ``(n, 4, 4)`` of the last frame in frame 0.

        Args:
            reference: joint positions ``(n, joints)`` that a free joint takes.
        """

    def nearest_rotations(self, Rs_frame0_last: Array) -> Array:
        """The rotations ``(n, 3, 3)`` of the last frame nearest to given ones that the arm can take."""


@dataclass(frozen=True)
class Axes:
    """An arm's joints in frame 0 at zero joint positions.

    Attributes:
        names: the joints'.
        prismatic: which of them slide.
        sign: ``(n,)`` how their joint positions count along the axes.
        directions: ``(n, 3)`` unit vectors along the axes, whatever the joint positions' signs.
        origins: ``(n, 3)`` m, a point on each hinge's axis; zero of a slide.
        T_frame0_last: pose ``(4, 4)`` of the last frame.
    """

    names: tuple[str, ...]
    prismatic: tuple[bool, ...]
    sign: Array
    directions: Array
    origins: Array
    T_frame0_last: Array

    @classmethod
    def of(cls, chain: Chain) -> "Axes":
        """The axes of a nominal model."""
        arm = SerialArm(chain)
        moving = [motion for motion in arm.motions(arm.nominal()) if motion.joint is not None]
        origins = [np.zeros(3) if motion.origin is None else motion.origin[:3, 0] for motion in moving]
        directions = np.array([motion.axis[:3, 0] for motion in moving])
        T = arm.flange(np.zeros((1, chain.size)), arm.nominal())[0]
        return cls(chain.joint_names, chain.prismatic, chain.sign, directions, np.array(origins), T)

    @property
    def size(self) -> int:
        """How many joints there are."""
        return len(self.names)

    @property
    def backwards(self) -> "Axes":
        """The arm held at its last frame: its joints in the reverse order, and its frame 0 as the last one."""
        back = se3.inverse(self.T_frame0_last)
        origins = np.where(np.array(self.prismatic)[:, None], 0.0, se3.transform(back, self.origins))
        directions = -self.directions @ back[:3, :3].T
        return Axes(
            self.names[::-1], self.prismatic[::-1], self.sign[::-1], directions[::-1], origins[::-1], back
        )  # fmt: skip

    def first(self, count: int) -> "Axes":
        """The first joints alone, with a last frame that stands as frame 0 does."""
        kinds, places = (self.names[:count], self.prismatic[:count]), (self.directions[:count], self.origins[:count])
        return Axes(*kinds, self.sign[:count], *places, np.eye(4))

    def carried(self, joint: int, amount: Array, points: Array) -> Array:
        """Points ``(3, ...)`` carried by one joint, by amounts ``(...)`` along its axis."""
        axis = self.directions[joint]
        if self.prismatic[joint]:
            return np.asarray(points + np.multiply.outer(axis, amount))
        origin = self.origins[joint].reshape(3, *(1,) * (points.ndim - 1))
        lever = points - origin
        along = np.multiply.outer(axis, np.tensordot(axis, lever, 1))
        across = np.cross(axis, lever, axisb=0, axisc=0)
        return np.asarray(origin + along + np.cos(amount) * (lever - along) + np.sin(amount) * across)

    def jacobian(self, joints: Array, point: Array) -> Array:
        """Geometric ``(6, n)`` of a point ``(3,)`` of the last frame at joint positions ``(n,)``, in frame 0."""
        columns, end, turns = list[Array](), se3.transform(self.T_frame0_last, point[None])[0], np.eye(3)
        origins, directions = list[Array](), list[Array]()
        for i in range(self.size):
            origin = self.origins[i]
            for j in range(i - 1, -1, -1):
                origin = self.carried(j, np.asarray(self.sign[j] * joints[j]), origin)
            origins.append(origin)
            directions.append(turns @ self.directions[i])
            if not self.prismatic[i]:
                turns = turns @ se3.exp(self.sign[i] * joints[i] * self.directions[i])
        for j in range(self.size - 1, -1, -1):
            end = self.carried(j, np.asarray(self.sign[j] * joints[j]), end)
        for i, slides in enumerate(self.prismatic):
            axis = self.sign[i] * directions[i]
            columns.append(np.concatenate([axis, np.zeros(3)] if slides else [np.cross(axis, end - origins[i]), axis]))
        return np.stack(columns, axis=1)

    def parallel(self, i: int, j: int) -> bool:
        """Whether two axes are."""
        return bool(np.linalg.norm(np.cross(self.directions[i], self.directions[j])) <= EXACT)

    def square(self, i: int, j: int) -> bool:
        """Whether two axes are at right angles."""
        return bool(abs(self.directions[i] @ self.directions[j]) <= EXACT)


def plane_across(normal: Array, first: Array | None = None) -> Array:
    """Unit vectors as rows ``(3, 3)``, right-handed: two across a unit vector, the first as given, and itself."""
    if first is None:
        first = np.cross(normal, np.eye(3)[np.argmin(np.abs(normal))])
    first = first - normal * (normal @ first)
    first = first / np.linalg.norm(first)
    return np.array([first, np.cross(normal, first), normal])


def in_plane(plane: Array, vector: Array) -> complex:
    """A vector ``(3,)`` along the first two rows of a plane, as a complex number."""
    x, y = plane[:2] @ vector
    return complex(x, y)


def meeting_point(origins: Array, axes: Array) -> tuple[Array, float]:
    """The point ``(3,)`` nearest to some lines, and how far the farthest one misses it."""
    across = np.eye(3) - axes[:, :, None] * axes[:, None, :]
    point = np.linalg.lstsq(across.reshape(-1, 3), (across @ origins[:, :, None]).ravel(), rcond=None)[0]
    return np.asarray(point, dtype=np.float64), float(
        np.linalg.norm(across @ (point - origins)[:, :, None], axis=1).max()
    )
