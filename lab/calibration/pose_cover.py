"""How far a pose is from all those that were measured, and regions of joint space."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy  # its parts are loaded at their first use, which not every process comes to
from numpy.typing import NDArray

from lab.calibration.validation import SAME_CONFIGURATION, configurations
from lab.core.measurements import evenly
from lab.core.random import rng_for
from lab.core.se3 import Array
from lab.kinematics.effects.effect import LEVER_M

__all__ = ["MOST_UNCOVERED", "PoseCover", "distinct_poses", "joint_regions", "neighbours"]

MOST_UNCOVERED = 0.5  # of a workspace, targets or poses: where more is extrapolated, nothing is good without a word
_NEAREST = 3  # measured poses that are near a covered one
_COVERED = 0.95  # of the measured poses are as near to others
_MOST = 4_000  # measured poses among which the near ones are sought


@dataclass(frozen=True)
class PoseCover:
    """Distinct measured joint positions, and which others are near to some of them.

    Distances are chords of hinges; those of slides are in units of a lever. A pose is covered if the third nearest
    measured one is no farther away than that of 95 % of the measured ones. Repeats of a pose cover nothing more.

    Attributes:
        poses: ``(n, joints)`` rad or m, without repeats.
        turning: ``(joints,)`` whether a whole turn leads a joint back to where it was.
    """

    poses: Array
    turning: NDArray[np.bool_]

    @classmethod
    def of(cls, joints: Array, turning: NDArray[np.bool_]) -> "PoseCover":
        """Cover what measured positions ``(n, joints)`` reach: repeats left out, of very many some, evenly spaced."""
        distinct = joints[distinct_poses(joints, turning)[0]]
        some = evenly(len(distinct), _MOST)
        return cls(distinct if some is None else distinct[some], turning)

    def beyond(self, joints: Array) -> Array:
        """``(n,)`` how far positions ``(n, joints)`` are beyond what is covered, in units of how far that reaches."""
        if len(self.poses) <= _NEAREST:
            return np.zeros(len(joints))
        tree, reach = self._tree
        away = tree.query(_around(joints, self.turning), k=_NEAREST)[0][:, -1]
        return np.asarray(np.maximum(away / reach - 1, 0.0))

    @cached_property
    def _tree(self) -> "tuple[scipy.spatial.cKDTree, float]":
        """The measured poses, and how far 95 % of them are from the third of the others."""
        around = _around(self.poses, self.turning)
        tree = scipy.spatial.cKDTree(around)
        away = tree.query(around, k=_NEAREST + 1)[0][:, -1]
        return tree, float(np.quantile(away, _COVERED))


def distinct_poses(joints: Array, turning: NDArray[np.bool_]) -> tuple[NDArray[np.int_], NDArray[np.int_]]:
    """Find which joint positions are repeats: chords to a pose before them of no more than ``SAME_CONFIGURATION``.

    Poses of a dense path are no repeats of each other: along it, one is left at each such distance.

    Args:
        joints: ``(n, joints)`` rad or m.
        turning: ``(joints,)`` which joints turn.

    Returns:
        Rows ``(m,)`` of the distinct poses, ascending, and ``(n,)`` which of these each row repeats.
    """
    around = _around(joints, turning)
    tree, which = scipy.spatial.cKDTree(around), np.full(len(joints), -1)
    labels = configurations(around)
    alone = np.bincount(labels)[labels] == 1
    rows: list[int] = []
    for row in range(len(joints)):
        if which[row] < 0:
            near = row if alone[row] else np.array(tree.query_ball_point(around[row], SAME_CONFIGURATION, p=np.inf))
            which[near] = np.where(which[near] < 0, len(rows), which[near])
            rows.append(row)
    return np.array(rows, dtype=np.int_), which


def neighbours(joints: Array, turning: NDArray[np.bool_]) -> NDArray[np.int_]:
    """Find the rows ``(n, m)`` of the up to three other positions that are nearest to each of ``(n, joints)``."""
    around = _around(joints, turning)
    count = min(_NEAREST + 1, len(joints))
    rows = scipy.spatial.cKDTree(around).query(around, k=range(1, count + 1))[1]
    return np.asarray(rows[:, 1:], dtype=np.int_)


def _around(joints: Array, turning: NDArray[np.bool_]) -> Array:
    """Positions ``(n, 2 joints)`` between which distances are chords."""
    slides = np.where(turning, 0.0, joints / LEVER_M)
    return np.concatenate([np.where(turning, np.cos(joints), slides), np.sin(joints) * turning], axis=1)


def joint_regions(joints: Array, turning: NDArray[np.bool_], count: int, seed: int) -> NDArray[np.int_]:
    """Label regions of joint space of about as many distinct poses each: halved across the joint that spreads most.

    Args:
        joints: ``(n, joints)`` rad or m.
        turning: ``(joints,)`` which joints turn.
        count: how many; the largest region is halved until there are so many.
        seed: of the order among regions that are as large.

    Returns:
        ``(n,)`` labels; repeats of a pose have one.
    """
    rows, which = distinct_poses(joints, turning)
    distinct, rng = joints[rows], rng_for(seed, "split")
    labels = np.zeros(len(distinct), dtype=np.int_)
    for new in range(1, count):
        sizes = np.bincount(labels) + 0.5 * rng.random(new)
        part = np.flatnonzero(labels == sizes.argmax())
        across = int(np.ptp(distinct[part], axis=0).argmax())
        order = part[np.argsort(distinct[part, across], kind="stable")]
        labels[order[len(order) // 2 :]] = new
    return labels[which]
