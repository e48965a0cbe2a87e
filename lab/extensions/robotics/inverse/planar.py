"""Arms of two or three joints that move in a plane: its two displacements, and with three joints the turn about its
normal. Hinges are across the plane and slides in it, in any order (``planar_joints``).

Two joints bring a point of the last link somewhere, whatever the rotation; three take a pose of the plane.
"""

from dataclasses import dataclass

import numpy as np

from lab.core import se3
from lab.core.random import rng_for
from lab.core.se3 import Array
from lab.extensions.robotics.inverse.khalil_one_unknown import unless_tiny
from lab.extensions.robotics.inverse.planar_joints import PlanarJoints
from lab.kinematics.inverse.closed_form import EXACT, Axes, Determinant, Solutions, determinant, plane_across
from lab.kinematics.serial.arm import SerialArm
from lab.kinematics.serial.chain import Chain

__all__ = ["PlanarArm"]

_IN_PLANE_M = 1e-11


@dataclass(frozen=True)
class PlanarArm:
    """Such an arm, by its axes in frame 0 at zero joint positions.

    Attributes:
        plane: ``(3, 3)`` rows e, f and the plane's normal.
        point: ``(3,)`` in the last frame (m), which is brought somewhere; ``height`` along the normal.
    """

    chain: Chain
    axes: Axes
    joints: PlanarJoints
    plane: Array
    point: Array
    height: float
    exact_only: bool = False
    numbered: bool = True

    @classmethod
    def of(cls, chain: Chain, point: Array) -> "PlanarArm | None":
        """The closed form of a nominal model, for a point ``(3,)`` m of the last frame; None for other shapes."""
        if chain.size not in (2, 3):
            return None
        axes = Axes.of(chain)
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
        """How many solutions a pose has."""
        return self.joints.roots

    @property
    def by_point(self) -> bool:
        """Whether the place of a point alone is met, which is so with two joints."""
        return self.chain.size == 2

    @property
    def determinant(self) -> Determinant:
        """Of the point's displacements along e and f, and with three joints the turn about the normal."""
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
        """What motions the determinant is of."""
        return "the displacements in its plane" + ("" if self.by_point else " and the turn about the plane's normal")

    def nearest_rotations(self, Rs_frame0_last: Array) -> Array:
        """See ``ClosedForm``: turned about the normal alone; with two joints none is asked for."""
        if self.by_point:
            given = np.asarray(np.isfinite(Rs_frame0_last).all(axis=(1, 2)))
            return np.where(given[:, None, None], Rs_frame0_last, np.eye(3))
        turn = self._turn(Rs_frame0_last)[0]
        return np.asarray(se3.exp(turn[:, None] * self.plane[2]) @ self.axes.T_frame0_last[:3, :3])

    def solve(self, Ts_frame0_last: Array, reference: Array | float = 0.0) -> Solutions:
        """See ``ClosedForm``. The place of the point is met, turned as near to a pose's rotation as can be."""
        count, size = len(Ts_frame0_last), self.chain.size
        liked = (np.broadcast_to(reference, (count, size)) * self.chain.sign).T
        turn, tilt = self._turn(Ts_frame0_last[:, :3, :3])
        e, f, w = self.plane @ se3.transform(Ts_frame0_last, self.point[None])[:, 0].T
        values, gap, free = self.joints.solve(e + 1j * f, None if self.by_point else turn, liked)
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
        """By how much ``(n, k)`` rad two joints miss rotations."""
        turns = (joints * self.chain.sign * self.joints.turning * ~np.array(self.chain.prismatic)).sum(axis=2)
        made = se3.exp(turns[..., None] * self.plane[2]) @ self.axes.T_frame0_last[:3, :3]
        tilt = np.linalg.norm(se3.log(Rs[:, None] @ made.swapaxes(2, 3)), axis=2)
        return np.asarray(np.where(tilt <= EXACT, 0.0, tilt))

    def _turn(self, Rs: Array) -> tuple[Array, Array]:
        """How far ``(n,)`` rad rotations are turned about the normal, and how far they are tilted then."""
        M = self.plane @ Rs @ self.axes.T_frame0_last[:3, :3].T @ self.plane.T
        tilt = np.arctan2(np.hypot(M[:, 2, 0], M[:, 2, 1]), M[:, 2, 2])
        turn = np.arctan2(M[:, 1, 0] - M[:, 0, 1], M[:, 0, 0] + M[:, 1, 1])
        return turn, np.where(tilt <= EXACT, 0.0, tilt)
