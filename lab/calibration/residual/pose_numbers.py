"""Measured numbers of poses, reduced to those that the joints' offsets move, and their covariances.

All numbers of one pose depend on the same offsets of its joints. A pose with three targets has nine numbers and six
joints: an orthogonal transformation of the nine leaves six that depend on the offsets and three that have the noise
alone. The likelihood is that of all nine, and the covariance matrix is two thirds as large.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lab.calibration.residual.kernels import COMPONENTS, JointKernels
from lab.core.se3 import Array

__all__ = ["PoseNumbers", "Reduction", "covariance", "unit_covariances"]

_BLOCK = 1_000  # rows of a covariance matrix that are worked out at once, which bounds the memory


@dataclass(frozen=True)
class PoseNumbers:
    """Numbers that depend on the offsets of the joints.

    Attributes:
        joints: ``(n, joints)`` positions of the poses.
        pose: ``(N,)`` the pose of each number, ascending.
        slopes: ``(N, joints)`` derivatives by that pose's joint positions.
    """

    joints: Array
    pose: NDArray[np.int_]
    slopes: Array

    @classmethod
    def whole(cls, joints: Array, slopes: Array) -> "PoseNumbers":
        """All numbers of poses: positions ``(n, joints)``, derivatives ``(n, d, joints)``."""
        n, d, size = slopes.shape
        return cls(joints, np.repeat(np.arange(n), d), slopes.reshape(n * d, size))

    def per_joint(self, numbers: Array) -> Array:
        """The transposed derivatives times numbers ``(N, q)``: ``(joints, n, q)``."""
        first = np.flatnonzero(np.diff(self.pose, prepend=-1))
        found = np.zeros((self.slopes.shape[1], len(self.joints), numbers.shape[1]), dtype=numbers.dtype)
        there = self.pose[first]
        for joint, slope in enumerate(self.slopes.T.astype(numbers.dtype)):
            found[joint, there] = np.add.reduceat(slope[:, None] * numbers, first, axis=0)
        return found


@dataclass(frozen=True)
class Reduction:
    """An orthogonal transformation of the numbers of each pose.

    Attributes:
        numbers: those that depend on the joints' offsets, N of them.
        groups: poses that saw the same targets: their rows, the numbers seen, and the transformations ``(m, s, s)``.
        order: ``(all,)`` where each transformed number belongs: the N first, those with the noise alone after them.
        alone: ``(M,)`` the pose of each number with the noise alone, ascending.
    """

    numbers: PoseNumbers
    groups: tuple[tuple[NDArray[np.int_], NDArray[np.int_], Array], ...]
    order: NDArray[np.int_]
    alone: NDArray[np.int_]

    @classmethod
    def of(cls, joints: Array, slopes: Array, seen: NDArray[np.bool_]) -> "Reduction":
        """Of poses.

        Args:
            joints: ``(n, joints)``.
            slopes: ``(n, 3 k, joints)`` derivatives of all numbers.
            seen: ``(n, k)``.
        """
        size, groups = joints.shape[1], []
        poses, moved, reduced = [], [], []
        patterns, labels = np.unique(seen, axis=0, return_inverse=True)
        for label, pattern in enumerate(patterns):
            rows, kept = np.flatnonzero(labels.ravel() == label), np.flatnonzero(np.repeat(pattern, 3))
            some = slopes[rows][:, kept]
            if len(kept) > size:
                turn, left = np.linalg.qr(some, mode="complete")
            else:
                turn, left = np.broadcast_to(np.eye(len(kept)), (len(rows), len(kept), len(kept))), some
            groups.append((rows, kept, turn))
            poses.append(np.repeat(rows, len(kept)))
            moved.append(np.tile(np.arange(len(kept)) < size, len(rows)))
            reduced.append(left.reshape(-1, size))
        pose, by_offsets = np.concatenate(poses), np.concatenate(moved)
        order = np.lexsort((pose, ~by_offsets))
        count = int(by_offsets.sum())
        first = order[:count]
        numbers = PoseNumbers(joints, pose[first], np.concatenate(reduced)[first])
        return cls(numbers, tuple(groups), order, pose[order[count:]])

    def back(self, pose: int, matrix: Array) -> Array:
        """Transformed numbers of one pose ``(s, ...)``, those that the offsets move first, as they were measured."""
        for rows, _, turn in self.groups:
            if len(found := np.flatnonzero(rows == pose)):
                return np.asarray(turn[found[0]] @ matrix)
        raise KeyError(pose)

    def __call__(self, numbers: Array) -> tuple[Array, Array]:
        """Numbers ``(n, 3 k, ...)`` transformed: those that the offsets move ``(N, ...)``, and the others."""
        tail = numbers.shape[2:]
        parts = []
        for rows, kept, turn in self.groups:
            some = numbers[rows][:, kept].reshape(len(rows), len(kept), -1)
            parts.append((np.swapaxes(turn, 1, 2) @ some).reshape(-1, *tail))
        found, count = np.concatenate(parts)[self.order], len(self.numbers.pose)
        return found[:count], found[count:]


def covariance(kernels: JointKernels, sizes: Array, first: PoseNumbers, second: PoseNumbers | None = None) -> Array:
    """Covariance ``(N, M)`` of numbers, the noise aside, of processes with these variances.

    Args:
        sizes: ``(c,)`` of ``kernels.COMPONENTS``.
        first, second: the numbers; of one set without ``second``, and then with the scatter of each pose.
    """
    other = first if second is None else second
    found = np.zeros((len(first.pose), len(other.pose)))
    for joint, kernel in enumerate(kernels.of_joints(sizes[2:], first.joints, other.joints)):
        for start in range(0, len(found), _BLOCK):
            rows = slice(start, start + _BLOCK)
            whole = kernel[np.ix_(first.pose[rows], other.pose)]
            whole *= first.slopes[rows, joint, None]
            whole *= other.slopes[:, joint]
            found[rows] += whole
    if second is None:
        _add_scatter(found, sizes[1], first)
    return found


def unit_covariances(kernels: JointKernels, numbers: PoseNumbers) -> tuple[Array, ...]:
    """Covariances ``(N, N)`` of numbers by each component with a variance of one, the noise's first."""
    alone = np.eye(len(COMPONENTS))[2:]  # one component each
    scatter = np.zeros((len(numbers.pose), len(numbers.pose)))
    _add_scatter(scatter, 1.0, numbers)
    return np.eye(len(numbers.pose)), scatter, *(covariance(kernels, each, numbers) for each in alone)


def _add_scatter(found: Array, size: float, numbers: PoseNumbers) -> None:
    """Add the covariance of numbers by offsets of the joints that each pose has of its own."""
    for apart in range(int(np.bincount(numbers.pose).max())):
        one = np.arange(len(numbers.pose) - apart)
        one = one[numbers.pose[one] == numbers.pose[one + apart]]
        products = size * (numbers.slopes[one] * numbers.slopes[one + apart]).sum(axis=1)
        found[one, one + apart] += products
        if apart:
            found[one + apart, one] += products
