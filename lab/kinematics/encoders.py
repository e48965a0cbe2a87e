"""Encoders at the motors: whole counts, through gears and a coupled wrist, of which joint positions are made.

A drive turns G (C q) where the joints are at q: gear ratios G on the diagonal, couplings C with ones there (of a wrist
whose joints 5 and 6 share their drives, Khalil & Dombre 2002, section 2.4). A controller that counts a drive's turns
reports the joint positions q' = (N G C)^-1 round(N G C q), N counts for each radian of the motors. Its couplings and
gains are nominal: what the arm truly has beside them is an error of the arm (``effects.coupling``, ``effects.gear``).
"""

from dataclasses import dataclass

import numpy as np

from lab.core.errors import LabError
from lab.core.se3 import Array

__all__ = ["Encoders"]


@dataclass(frozen=True)
class Encoders:
    """Those of one arm with n joints.

    Attributes:
        gear_ratio: ``(n,)`` turns of each motor for one of its joint (rad per m of a slide), with their signs.
        couplings: ``(n, n)`` what each drive turns by the joints' positions, as its own joint feels it: ones on the
            diagonal.
        counts_per_turn: ``(n,)`` of the motors.
    """

    gear_ratio: Array
    couplings: Array
    counts_per_turn: Array

    def __post_init__(self) -> None:
        if not (np.isfinite(self.counts).all() and np.linalg.matrix_rank(self.couplings) == len(self.couplings)):
            raise LabError("encoders: the couplings of the drives cannot be told apart: give ratios of another motor")

    @property
    def counts(self) -> Array:
        """``(n, n)`` counts of each encoder for a radian (or metre) of each joint."""
        return (self.counts_per_turn * self.gear_ratio / (2 * np.pi))[:, None] * self.couplings

    def rounded(self, joints: Array) -> Array:
        """The joint positions ``(m, n)`` that whole counts make of joint positions ``(m, n)``."""
        counts = self.counts
        whole: Array = np.round(joints @ counts.T) @ np.linalg.inv(counts).T
        return whole

    @property
    def covariance(self) -> Array:
        """``(n, n)`` of the joint positions' errors (rad, m): each count is off by half of one at most, uniformly."""
        per_count = np.linalg.inv(self.counts)
        return np.asarray(per_count @ per_count.T / 12)
