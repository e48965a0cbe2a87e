"""The 3-RPR whose legs 1 and 3 end in one pin P of the platform: its direct model in closed form."""

from dataclasses import dataclass

import numpy as np

from lab.core.errors import LabError
from lab.core.se3 import Array
from lab.extensions.robotics.closed.plane import as_sorted, circles_meet, cross, real_root, usable, wrapped
from lab.extensions.robotics.closed.rpr3 import ThreeLegs
from lab.extensions.robotics.closed.singularity import unit

__all__ = ["SharedPin"]


@dataclass(frozen=True)
class SharedPin:
    """The platform is a bar from P, its origin, along its x axis to the pin of leg 2; a pose is x, y of P and phi.

    Attributes:
        base: anchors ``(3, 2)`` m, the first and the third apart.
        bar_m: length L of the platform.
    """

    base: Array
    bar_m: float

    def __post_init__(self) -> None:
        if not 0 < self.bar_m < np.inf:
            raise LabError(f"bar_m is {self.bar_m:g}: give the platform a positive length")
        object.__setattr__(self, "base", self.legs.base)

    @property
    def legs(self) -> ThreeLegs:
        """This robot as a 3-RPR like others."""
        return ThreeLegs(self.base, np.array([[0.0, 0.0], [self.bar_m, 0.0], [0.0, 0.0]]))

    def direct(self, lengths: Array) -> Array:
        """All poses ``(n, 4, 3)`` of lengths ``(n, 3)`` m by rising phi, then NaN: none, two or four.

        P is where circles 1 and 3 meet. With g = P - A2 and e the bar's direction, leg 2 is g + L e, so that
        g . e = k = (rho2^2 - L^2 - g^2) / 2L. Modes that merge are given twice.
        """
        rho1, rho2, rho3 = usable(lengths).T
        points = circles_meet(self.base[0], self.base[2], rho1, rho3)  # (n, 2, 2)
        g = points - self.base[1]
        square = (g**2).sum(axis=-1)
        k = (rho2[:, None] ** 2 - self.bar_m**2 - square) / (2 * self.bar_m)
        bend = np.arctan2(real_root(square - k**2, square + k**2), k)
        angle = np.arctan2(g[..., 1], g[..., 0])[..., None] + np.stack([bend, -bend], axis=-1)  # (n, 2, 2)
        points = np.broadcast_to(points[:, :, None], (*angle.shape, 2))
        poses = np.concatenate([points, wrapped(angle)[..., None]], axis=-1)
        poses = np.where(np.isfinite(angle)[..., None], poses, np.nan)
        return as_sorted(poses.reshape(len(rho1), 4, 3))

    def determinant(self, poses: Array) -> Array:
        """Of ``ThreeLegs.matrices`` det A ``(n,)`` m as a product: -L (u1 x u3)(e x u2), u_i the legs' directions.

        Singular are legs 1 and 3 in line, and leg 2 in line with the bar.
        """
        poses = np.asarray(poses)
        e = np.stack([np.cos(poses[:, 2]), np.sin(poses[:, 2])], axis=1)
        u1, u3 = (unit(poses[:, :2] - self.base[i]) for i in (0, 2))
        u2 = unit(poses[:, :2] + self.bar_m * e - self.base[1])
        return np.asarray(-self.bar_m * cross(u1, u3) * cross(e, u2))
