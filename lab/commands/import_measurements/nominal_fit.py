"""How well points follow the nominal arm in the poses that they are taken for.

Base and tool are fitted to the points; what the nominal links then miss is millimetres. Points that belong to other
poses, or joints in another unit, order or direction, are missed by a large part of the arm's reach.
"""

import numpy as np
from numpy.typing import NDArray

from lab.calibration.gauss_newton import Observations
from lab.calibration.initial_guess import columns_of, initial_guess
from lab.campaign.robot import Robot
from lab.core.se3 import Array

__all__ = ["LEAST_POSES", "NominalFit"]

LEAST_POSES = 6  # distinct ones, which overdetermine base and tool
_TOLERANCE = 0.05  # of the points' median distance from their middle, within which a point follows the nominal arm
_DISTINCT = 0.01  # rad or m: joint positions that are closer are one pose
_KEPT = 0.6  # of the points: by the best ones base and tool are fitted again where not all follow
_REFITS = 4


class NominalFit:
    """The nominal arm, with base and tool fitted to points and the poses that they are taken for."""

    def __init__(self, robot: Robot, targets: tuple[str, ...], points: Array) -> None:
        """Take the robot, its targets, and all points ``(n, 3)`` (m), whose spread sets the tolerance."""
        self._arm, self._count = robot.arm(targets), len(targets)
        self._nominal = self._arm.nominal({target: np.zeros(3) for target in targets})
        from_middle = np.linalg.norm(points - np.median(points, axis=0), axis=1)
        self.tolerance_m = _TOLERANCE * float(np.median(from_middle))

    def usable(self, joints: Array) -> bool:
        """Return whether joint positions ``(n, joints)`` are enough distinct poses to contradict wrong points."""
        return len(np.unique(np.round(joints / _DISTINCT), axis=0)) >= LEAST_POSES

    def flanges(self, joints: Array) -> Array:
        """Return positions ``(n, 3)`` of the nominal flange in the base, m; NaN where the arm's loops do not close."""
        at_base = self._nominal.copy()
        at_base[list(columns_of(self._arm, ("base",)))] = 0.0
        flanges: Array = self._arm.points(joints, at_base)[:, 0]
        return flanges

    def distances(self, joints: Array, targets: NDArray[np.int_], points: Array) -> Array:
        """Return how far ``(n,)`` (m) points are from where the nominal arm has them; infinite where it cannot be.

        The arguments are those of ``predicted``.
        """
        apart = np.linalg.norm(self.predicted(joints, targets, points) - points, axis=1)
        return np.where(np.isfinite(apart), apart, np.inf)

    def predicted(self, joints: Array, targets: NDArray[np.int_], points: Array) -> Array:
        """Return where ``(n, 3)`` (m) the nominal arm has points; NaN where its loops do not close.

        Base and tool are fitted to all points, then again to the nearest ones as long as some do not follow (least
        trimmed squares: Rousseeuw & Van Driessen 2006).

        Args:
            joints: ``(n, joints)`` rad or m, of each point.
            targets: ``(n,)`` which of the tool's targets each point is.
            points: ``(n, 3)`` m.
        """
        n = len(joints)
        seen = np.full((n, self._count, 3), np.nan)
        seen[np.arange(n), targets] = points
        possible = np.isfinite(self.flanges(joints)).all(axis=1)
        fitted, best, most = np.flatnonzero(possible), np.full((n, 3), np.nan), -1
        if len(fitted) < LEAST_POSES:
            return best
        kept = max(LEAST_POSES, int(np.ceil(_KEPT * len(fitted))))
        for _ in range(1 + _REFITS):
            some = Observations(joints[fitted], seen[fitted], np.ones((len(fitted), self._count)))
            values = initial_guess(self._arm, some, self._nominal)
            here = np.full((n, 3), np.nan)
            here[possible] = self._arm.points(joints[possible], values)[np.arange(possible.sum()), targets[possible]]
            apart = np.nan_to_num(np.linalg.norm(here - points, axis=1), nan=np.inf)
            if (follow := int((apart <= self.tolerance_m).sum())) > most:
                best, most = here, follow
            nearest = np.sort(np.argsort(apart, kind="stable")[:kept])
            if follow == possible.sum() or np.array_equal(nearest, fitted):
                break
            fitted = nearest
        return best
