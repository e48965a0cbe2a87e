"""The planar robot 3-RPR: a platform held by three legs, in up to six modes (``sextic``)."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lab.core.errors import LabError
from lab.core.se3 import Array
from lab.extensions.robotics.closed.plane import as_sorted, cross, turned, usable
from lab.extensions.robotics.closed.sextic import Sextic
from lab.extensions.robotics.closed.singularity import Distances, independence, unit

__all__ = ["ThreeLegs"]


@dataclass(frozen=True)
class ThreeLegs:
    """Leg i goes from anchor a_i in the base to p + R(phi) b_i on the platform; a pose is x, y of p (m) and phi (rad).

    Attributes:
        base: anchors ``(3, 2)`` m.
        platform: attachments ``(3, 2)`` m in the platform's frame.
    """

    base: Array
    platform: Array

    def __post_init__(self) -> None:
        for name in ("base", "platform"):
            points = np.asarray(getattr(self, name), dtype=np.float64)
            if points.shape != (3, 2) or not np.isfinite(points).all():
                raise LabError(f"{name} has shape {points.shape}: give three points (x, y), all finite")
            if not np.ptp(points, axis=0).any():
                raise LabError(f"{name}: its three points are one, so that the platform turns freely about it")
            object.__setattr__(self, name, points)
        if len(np.unique(np.hstack([self.base, self.platform]), axis=0)) < 3:
            raise LabError("base and platform: two legs share both ends, so that one of them holds nothing")

    def inverse(self, poses: Array) -> Array:
        """Lengths ``(n, 3)`` m of the legs at poses ``(n, 3)``."""
        return np.asarray(np.linalg.norm(self._legs(poses)[0], axis=2))

    def direct(self, lengths: Array) -> Array:
        """All poses ``(n, 6, 3)`` with lengths ``(n, 3)``, by rising phi between -pi and pi, then NaN.

        Modes that merge are given once. A platform that moves with its legs locked has no modes to list there.
        """
        lengths = usable(lengths)
        reach = float(np.ptp(self.base, axis=0).max() + np.ptp(self.platform, axis=0).max())
        size = np.maximum(np.nanmax(lengths, axis=1, initial=0.0), reach)[:, None, None]  # (n, 1, 1)
        rows = (self.base - self.base[0]) / size, (self.platform - self.platform[0]) / size
        modes = Sextic(*rows, lengths / size[:, 0]).modes()
        first = turned(modes[..., 2], np.broadcast_to(self.platform[0], modes[..., :2].shape))
        return as_sorted(np.concatenate([self.base[0] + modes[..., :2] * size - first, modes[..., 2:]], axis=2))

    def matrices(self, poses: Array) -> tuple[Array, Array]:
        """A and B ``(n, 3, 3)`` of A dX + B drho = 0: rows (u_i, R b_i x u_i) of A, u_i the leg's direction; B = -I.

        The third column of A is in m. A leg of length zero has no direction, and a row of zeros.
        """
        legs, arms = self._legs(poses)
        u = unit(legs)
        return np.concatenate([u, cross(arms, u)[..., None]], axis=2), np.broadcast_to(-np.eye(3), (len(u), 3, 3))

    def distances(self, poses: Array) -> Distances:
        """How far poses ``(n, 3)`` are from singular, whatever the origin of the platform's frame.

        The platform turns about the centre of its attachments, and a radian counts as their distance r from it (root
        mean square). Serial is a leg that is zero, measured as rho / |(rho, r)|; it has no direction, so that
        parallel is 0 there too.
        """
        legs, arms = self._legs(poses)
        arms = arms - arms.mean(axis=1, keepdims=True)
        radius = np.sqrt(((self.platform - self.platform.mean(axis=0)) ** 2).sum(axis=1).mean())
        rows = np.concatenate([legs, cross(arms, legs)[..., None] / radius], axis=2)
        lengths = np.linalg.norm(legs, axis=2)
        serial = (lengths / np.hypot(lengths, radius)).min(axis=1)
        return Distances(independence(unit(rows)), serial, np.ones(len(lengths)))

    def reachable(self, poses: Array, lower: Array | float, upper: Array | float) -> NDArray[np.bool_]:
        """Which poses ``(n, 3)`` have legs within limits (m), of each or of all: ``(n,)``."""
        lengths = self.inverse(poses)
        return np.asarray(((lengths >= lower) & (lengths <= upper)).all(axis=1))

    def _legs(self, poses: Array) -> tuple[Array, Array]:
        """The legs' vectors and R b_i, both ``(n, 3, 2)`` in the base's axes."""
        poses = np.asarray(poses)
        arms = turned(poses[:, None, 2], np.broadcast_to(self.platform, (len(poses), 3, 2)))
        return poses[:, None, :2] + arms - self.base, arms
