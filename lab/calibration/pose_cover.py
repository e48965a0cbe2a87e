"""How far a pose is from all those that were measured, and regions of joint space."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy  # its parts are loaded at their first use, which not every process comes to
from numpy.typing import NDArray

from lab.core.measurements import evenly
from lab.core.random import rng_for
from lab.core.se3 import Array
from lab.kinematics.effects.effect import LEVER_M

__all__ = ["MOST_UNCOVERED", "PoseCover", "joint_regions"]

MOST_UNCOVERED = 0.5  # of a workspace, targets or poses: where more is extrapolated, nothing is good without a word
_NEAREST = 3  # measured poses that are near a covered one
_COVERED = 0.95  # of the measured poses are as near to others
_MOST = 4_000  # measured poses among which the near ones are sought


@dataclass(frozen=True)
class PoseCover:
    """Measured joint positions, and which others are near to some of them.

    Distances are chords of hinges; those of slides are in units of a lever. A pose is covered if the third nearest
    measured one is no farther away than that of 95 % of the measured ones.

    Attributes:
        poses: ``(n, joints)`` rad or m.
        turning: ``(joints,)`` whether a whole turn leads a joint back to where it was.
    """

    poses: Array
    turning: NDArray[np.bool_]

    @classmethod
    def of(cls, joints: Array, turning: NDArray[np.bool_]) -> "PoseCover":
        """Of measured positions ``(n, joints)``, of very many so many that they tell as well, evenly spaced."""
        some = evenly(len(joints), _MOST)
        return cls(joints if some is None else joints[some], turning)

    def beyond(self, joints: Array) -> Array:
        """``(n,)`` how far positions ``(n, joints)`` are beyond what is covered, in units of how far that reaches."""
        if len(self.poses) <= _NEAREST:
            return np.zeros(len(joints))
        tree, reach = self._tree
        away = tree.query(self._around(joints), k=_NEAREST)[0][:, -1]
        return np.asarray(np.maximum(away / reach - 1, 0.0))

    @cached_property
    def _tree(self) -> "tuple[scipy.spatial.cKDTree, float]":
        """The measured poses, and how far 95 % of them are from the third of the others."""
        around = self._around(self.poses)
        tree = scipy.spatial.cKDTree(around)
        away = tree.query(around, k=_NEAREST + 1)[0][:, -1]
        return tree, max(float(np.quantile(away, _COVERED)), np.finfo(float).tiny)

    def _around(self, joints: Array) -> Array:
        """Positions ``(n, 2 joints)`` between which distances are chords."""
        slides = np.where(self.turning, 0.0, joints / LEVER_M)
        return np.concatenate([np.where(self.turning, np.cos(joints), slides), np.sin(joints) * self.turning], axis=1)


def joint_regions(joints: Array, count: int, seed: int) -> NDArray[np.int_]:
    """``(n,)`` labels of regions of joint space of about as many poses each: halved across the joint that spreads most.

    Args:
        joints: ``(n, joints)`` rad or m.
        count: how many; the largest region is halved until there are so many.
        seed: of the order among regions that are as large.
    """
    labels, rng = np.zeros(len(joints), dtype=np.int_), rng_for(seed, "split")
    for new in range(1, count):
        sizes = np.bincount(labels) + 0.5 * rng.random(new)
        part = np.flatnonzero(labels == sizes.argmax())
        across = int(np.ptp(joints[part], axis=0).argmax())
        order = part[np.argsort(joints[part, across], kind="stable")]
        labels[order[len(order) // 2 :]] = new
    return labels
