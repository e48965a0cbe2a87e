"""The planar robot 2-RPR: a point P held by two legs, which is where both are pinned to each other."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lab.core.errors import LabError
from lab.core.se3 import Array
from lab.extensions.robotics.closed.plane import circles_meet, usable
from lab.extensions.robotics.closed.singularity import Distances, independence, unit

__all__ = ["TwoLegs"]


@dataclass(frozen=True)
class TwoLegs:
    """Anchors A1 = (0, 0) and A2 = (L, 0), from which P = (x, y) is rho1 and rho2 away (m).

    f1 = x^2 + y^2 - rho1^2 and f2 = (x - L)^2 + y^2 - rho2^2 are zero.

    Attributes:
        span_m: L.
    """

    span_m: float

    def __post_init__(self) -> None:
        if not 0 < self.span_m < np.inf:
            raise LabError(f"span_m is {self.span_m:g}: the anchors are a positive distance apart")

    def inverse(self, points: Array) -> Array:
        """Lengths ``(n, 2)`` m of the legs to points ``(n, 2)`` m."""
        return np.asarray(np.linalg.norm(self._legs(points), axis=2))

    def direct(self, lengths: Array) -> Array:
        """Points ``(n, 2, 2)`` m of lengths ``(n, 2)``: y > 0 first; the same twice where y = 0, NaN out of reach."""
        rho1, rho2 = usable(lengths).T
        return circles_meet(np.zeros(2), np.array([self.span_m, 0.0]), rho1, rho2)

    def matrices(self, points: Array) -> tuple[Array, Array]:
        """A = df/dP and B = df/drho, ``(n, 2, 2)`` m each: A dP + B drho = 0, so that dP = -A^-1 B drho.

        det A = 4 L y.
        """
        return 2 * self._legs(points), -2 * self.inverse(points)[:, :, None] * np.eye(2)

    def distances(self, points: Array) -> Distances:
        """How far points ``(n, 2)`` are from singular. Serial is a leg that is zero, measured as rho / |(rho, L)|."""
        lengths = self.inverse(points)
        serial = (lengths / np.hypot(lengths, self.span_m)).min(axis=1)
        return Distances(independence(unit(self._legs(points))), serial, np.ones(len(lengths)))

    def reachable(self, points: Array, lower: Array | float, upper: Array | float) -> NDArray[np.bool_]:
        """Which points ``(n, 2)`` have legs within limits (m), of each or of both: ``(n,)``."""
        lengths = self.inverse(points)
        return np.asarray(((lengths >= lower) & (lengths <= upper)).all(axis=1))

    def _legs(self, points: Array) -> Array:
        """From the anchors to P, ``(n, 2, 2)``, a row a leg."""
        return np.asarray(np.asarray(points)[:, None, :] - np.array([[0.0, 0.0], [self.span_m, 0.0]]))
