"""The Delta robot: three arms, each with a parallelogram of rods, move a platform that does not turn (Clavel 1988).

Equations after Williams (The Delta Parallel Robot: Kinematics Solutions, 2016). The frame is the base's: z upward, the
hips around the origin in the plane z = 0.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lab.core.errors import LabError
from lab.core.se3 import Array
from lab.extensions.robotics.closed.planar_platforms import Distances, independence, real_root, wrapped

__all__ = ["AZIMUTHS_RAD", "Delta"]

AZIMUTHS_RAD = np.radians([-90.0, 30.0, 150.0])  # Williams' order
_UP = np.array([0.0, 0.0, 1.0])
_FLAT = 1e-12  # of the squared rod: sphere centres that span less lie on a line


@dataclass(frozen=True)
class Delta:
    """A joint position of 0 has an arm level and outward; it counts downward.

    Attributes:
        base_radius_m: of the hips about the base's centre.
        platform_radius_m: of the rods' ends about the platform's centre P.
        arm_m, rod_m: lengths L and l.
        azimuths_rad: ``(3,)`` of the arms, about z from x.
    """

    base_radius_m: float
    platform_radius_m: float
    arm_m: float
    rod_m: float
    azimuths_rad: Array

    def __post_init__(self) -> None:
        for name in ("base_radius_m", "platform_radius_m"):
            if not 0 <= getattr(self, name) < np.inf:
                raise LabError(f"{name} is {getattr(self, name):g}: a radius is not below zero")
        for name in ("arm_m", "rod_m"):
            if not 0 < getattr(self, name) < np.inf:
                raise LabError(f"{name} is {getattr(self, name):g}: give it a positive length")
        azimuths = np.asarray(self.azimuths_rad, dtype=np.float64)
        if azimuths.shape != (3,) or not np.isfinite(azimuths).all():
            raise LabError(f"azimuths_rad has shape {azimuths.shape}: give three angles, all finite")
        object.__setattr__(self, "azimuths_rad", azimuths)

    @classmethod
    def of_triangles(cls, base_m: float, platform_m: float, arm_m: float, rod_m: float) -> "Delta":
        """Build a Delta from the sides of Williams' triangles: hips midway on the base's, rods end at the corners."""
        return cls(base_m / np.sqrt(12), platform_m / np.sqrt(3), arm_m, rod_m, AZIMUTHS_RAD)

    @property
    def outward(self) -> Array:
        """Level directions e_i ``(3, 3)`` from the base's centre to the hips."""
        return np.stack([np.cos(self.azimuths_rad), np.sin(self.azimuths_rad), np.zeros(3)], axis=1)

    @property
    def hip_axes(self) -> Array:
        """Directions ``(3, 3)`` that the arms turn about to go down: z x e_i."""
        return np.cross(_UP, self.outward)

    def inverse(self, points: Array) -> Array:
        """Joint positions ``(n, 2, 3)`` rad at P ``(n, 3)`` m, both ways of each leg: that of an elbow outward first.

        With d from the hip to the rod's end, d . (cos t e - sin t z) = K = (d^2 + L^2 - l^2) / 2L. First is the
        way of the elbow that is further out, as long as the platform is below; a leg that does not reach is NaN twice.
        """
        d = np.asarray(points)[:, None] + (self.platform_radius_m - self.base_radius_m) * self.outward
        along, down = (d * self.outward).sum(axis=2), -d[..., 2]
        K = ((d**2).sum(axis=2) + self.arm_m**2 - self.rod_m**2) / (2 * self.arm_m)
        square = along**2 + down**2
        bend = np.arctan2(real_root(square - K**2, square + K**2), K)
        toward = np.arctan2(down, along)
        return wrapped(np.stack([toward - bend, toward + bend], axis=1))

    def direct(self, joints: Array) -> Array:
        """P ``(n, 2, 3)`` m of joint positions ``(n, 3)`` rad, the lower first: where three spheres of radius l meet.

        With u and v from their first centre to the others and n = u x v, the circle through all three has its centre at
        C1 + (u^2 v - v^2 u) x n / 2 n^2. The same twice where both merge, NaN where the spheres do not meet.
        """
        C = self._centres(joints)
        u, v = C[:, 1] - C[:, 0], C[:, 2] - C[:, 0]
        n = np.cross(u, v)
        square = (n**2).sum(axis=1, keepdims=True)
        square = np.where(square > (_FLAT * self.rod_m**2) ** 2, square, np.nan)
        rise = (u**2).sum(axis=1, keepdims=True) * v - (v**2).sum(axis=1, keepdims=True) * u
        from_first = np.cross(rise, n) / (2 * square)
        radius = (from_first**2).sum(axis=1, keepdims=True)
        height = real_root(self.rod_m**2 - radius, self.rod_m**2) / np.sqrt(square)
        up = height * np.where(n[:, 2:] < 0, -n, n)  # in whatever order the arms are numbered
        return np.stack([C[:, 0] + from_first - up, C[:, 0] + from_first + up], axis=1)

    def matrices(self, points: Array, joints: Array) -> tuple[Array, Array]:
        """A and B ``(n, 3, 3)`` of A dP = B dq, from s_i^2 = l^2: rows s_i (m) of A, s_i . dC_i/dq_i (m^2) in B.

        s_i is the rod from its elbow to its end.
        """
        rods = self._rods(points, joints)
        return rods, self.arm_m * (rods * self._tangents(joints)).sum(axis=2)[:, :, None] * np.eye(3)

    def distances(self, points: Array, joints: Array) -> Distances:
        """Compute the distances from singularities of P ``(n, 3)`` reached with joint positions ``(n, 3)``.

        Parallel: all rods are along one plane. Serial: the cosine between a rod and its elbow's motion is zero
        where the arm is in line with the rod as seen along the hip's axis. Constraint: the parallelogram of leg i holds
        the platform from turning about rod x hip axis, three of which have to be independent (and none zero).
        """
        s = self._rods(points, joints) / self.rod_m
        serial = np.abs((s * self._tangents(joints)).sum(axis=2)).min(axis=1)
        return Distances(independence(s), serial, independence(np.cross(s, self.hip_axes)))

    def reachable(self, points: Array, lower: Array | float, upper: Array | float) -> NDArray[np.bool_]:
        """Decide whether all legs reach P ``(n, 3)``, elbows outward, within joint limits (rad): ``(n,)``."""
        joints = self.inverse(points)[:, 0]
        return np.asarray(((joints >= lower) & (joints <= upper)).all(axis=1))

    def _centres(self, joints: Array) -> Array:
        """C_i ``(n, 3, 3)``: where P would be if the rod of leg i had no length."""
        q = np.asarray(joints)[..., None]
        centres: Array = (
            self.base_radius_m - self.platform_radius_m + self.arm_m * np.cos(q)
        ) * self.outward - self.arm_m * np.sin(q) * _UP
        return centres

    def _tangents(self, joints: Array) -> Array:
        """Unit directions ``(n, 3, 3)`` in which the elbows move, dC_i/dq_i / L."""
        q = np.asarray(joints)[..., None]
        return np.asarray(-np.sin(q) * self.outward - np.cos(q) * _UP)

    def _rods(self, points: Array, joints: Array) -> Array:
        return np.asarray(np.asarray(points)[:, None] - self._centres(joints))
