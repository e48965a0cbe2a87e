"""A Gaussian process of the joints' offsets, conditioned on measurements, beside parameters that are estimated with it.

What is measured is y = X b + Z f + e: parameters b without a prior, offsets f of the joints (``kernels``) through the
derivatives Z by their positions, and noise. The best linear unbiased prediction and its covariance are those of
universal kriging (Cressie 1993, section 3.4). The variances of f are estimates themselves: the offsets are predicted
by the likeliest, the covariance of their error is by the upper quartile of each.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy  # its parts are loaded at their first use, which not every process comes to
from numpy.typing import NDArray

from lab.calibration.residual.kernels import JointKernels
from lab.calibration.statistics.joint_rounding import by_joint_positions
from lab.core.linear_model import unit_columns
from lab.core.se3 import Array
from lab.kinematics.effects.arm import Arm, ArmWithEffects, affected
from lab.kinematics.effects.effect import Effect
from lab.kinematics.model import RigidArm
from lab.kinematics.parameter import Parameter

__all__ = ["GROUP", "SHARE", "JointProcess", "PredictedBy", "precisions", "total_covariance"]

GROUP = "residual"
SHARE = Parameter(GROUP, "share", GROUP, "ratio", "", 1.0)
_BLOCK = 400  # poses that are worked out at once
_AWAY = (5e-3, 15e-3)  # m and rad: one standard deviation of how far a link is from where least squares alone puts it


@dataclass(frozen=True)
class JointProcess:
    """The offsets of an arm's joints, as measurements say them.

    Attributes:
        inputs: ``(s, joints + conditions)`` the poses that say it.
        seen: ``(s, k)`` which targets were measured there.
        variances, upper: ``(c,)`` of ``kernels.COMPONENTS``, m^2 of the noise and rad^2 (m^2 of a slide) of the others:
            the likeliest, and the upper quartile of each.
        weights: ``(s, joints)`` by which the processes' covariances with these poses give the offsets.
        turning: ``(joints,)`` which joints turn.
        p: the chance of as large a likelihood if there were noise and scatter alone.
    """

    inputs: Array
    seen: NDArray[np.bool_]
    variances: Array
    upper: Array
    weights: Array
    turning: NDArray[np.bool_]
    p: float

    @property
    def kernels(self) -> JointKernels:
        """Of its joints."""
        return JointKernels(self.turning)

    @property
    def noise_m(self) -> float:
        """One standard deviation of what is neither the joints' offsets nor their scatter, of one coordinate."""
        return float(np.sqrt(self.variances[0]))

    @property
    def scatter_rad(self) -> float:
        """One standard deviation of what a joint is off by at one pose and not at the next one like it."""
        return float(np.sqrt(self.variances[1]))

    def offsets(self, joints: Array) -> Array:
        """How far the joints are off ``(n, joints)`` (rad, m of a slide) at positions ``(n, joints)``."""
        there = self.inputs[:, : len(self.turning)]
        found = np.zeros(joints.shape)
        for first in range(0, len(joints), _BLOCK):
            some = joints[first : first + _BLOCK]
            for (own, kernel), size in zip(self.kernels.of_offsets(some, there), self.variances[2:], strict=True):
                rows = "nmj,mj->nj" if own else "nm,mj->nj"
                found[first : first + _BLOCK] += size * np.einsum(rows, kernel, self.weights)
        return found

    def effect(self) -> Effect:
        """The offsets as a group of one parameter: the share of them that is taken, zero in the nominal model."""

        def moved(joints: Array, _: Array, values: Array) -> tuple[Array, Array]:
            offsets = self.offsets(np.real(joints))
            return offsets * values[0], offsets[..., None]

        return Effect(GROUP, (SHARE,), moved)

    def added_to(self, arm: Arm) -> ArmWithEffects:
        """The arm with these offsets, whose share is its last parameter."""
        effects = arm.effects if isinstance(arm, ArmWithEffects) else ()
        added = affected(arm.rigid, (*effects, self.effect()))
        assert isinstance(added, ArmWithEffects)
        return added


def precisions(parameters: Sequence[Parameter]) -> Array:
    """``(f,)`` how surely each parameter is near where least squares alone puts it: links to ten usual tolerances.

    A direction that the poses hardly tell would else take up what the process does not, and lead far away.
    """
    return np.array([1 / _AWAY[each.is_angle] ** 2 if each.is_link else 0.0 for each in parameters])


def total_covariance(
    kernels: JointKernels, sizes: Array, first: tuple[Array, Array], second: tuple[Array, Array] | None = None
) -> Array:
    """Covariance ``(n d, m d)`` of observed numbers, the noise aside, of processes with these variances.

    Args:
        sizes: ``(c,)`` as ``JointProcess.variances``.
        first, second: joint positions ``(n, joints)`` and derivatives ``(n, d, joints)``; of one set without
            ``second``, and then with the scatter of each pose.
    """
    other = first if second is None else second
    found = np.zeros((first[1].shape[0] * first[1].shape[1], other[1].shape[0] * other[1].shape[1]))
    for size, kernel in zip(sizes[2:], kernels.of_numbers(first, other), strict=True):
        found += size * kernel
    if second is None:
        slopes = first[1]
        n, d = slopes.shape[:2]
        blocks = found.reshape(n, d, n, d)
        blocks[np.arange(n), :, np.arange(n)] += sizes[1] * (slopes @ np.swapaxes(slopes, 1, 2))
    return np.asarray(found)


@dataclass(frozen=True)
class PredictedBy:
    """A process beside the parameters of an arm.

    Attributes:
        model: the arm without the process.
        values: ``(p,)`` of it.
        free: those that were estimated together with the process.
    """

    process: JointProcess
    model: RigidArm | ArmWithEffects
    values: Array
    free: tuple[int, ...]

    def covariances(self, inputs: Array) -> Array:
        """Covariances ``(n, k, 3, 3)`` (m^2) of the predicted points' errors at poses ``(n, joints + conditions)``."""
        k = len(self.model.targets)
        found = np.empty((len(inputs), k, 3, 3))
        for first in range(0, len(inputs), _BLOCK // k):
            some = inputs[first : first + _BLOCK // k]
            n = len(some)
            whole = self.covariance(some).reshape(n, k, 3, n, k, 3)
            rows, target = np.meshgrid(np.arange(n), np.arange(k), indexing="ij")
            found[first : first + n] = whole[rows, target, :, rows, target]
        return found

    def covariance(self, inputs: Array) -> Array:
        """Covariance ``(n k 3, n k 3)`` (m^2) of the predicted points' errors, of all poses together."""
        here, columns = self._at(inputs)
        there, support, kernels = self._there, self._support, self.process.kernels
        weights = total_covariance(kernels, self.process.variances, here, there)[:, self._rows]
        weights = scipy.linalg.cho_solve(support.factor, weights.T).T
        lacking = columns / support.scale - weights @ support.columns
        weights = weights + lacking @ np.linalg.solve(support.information, support.whitened.T)
        biased = (columns / support.scale - weights @ support.columns)[:, support.precision > 0]
        upper = self.process.upper
        crossed = weights @ total_covariance(kernels, upper, here, there)[:, self._rows].T
        return np.asarray(
            total_covariance(kernels, upper, here)
            - crossed
            - crossed.T
            + weights @ support.upper @ weights.T
            + (biased / support.precision[support.precision > 0]) @ biased.T
        )

    def _at(self, inputs: Array) -> tuple[tuple[Array, Array], Array]:
        """Joint positions with derivatives ``(n, k 3, joints)`` by them, and ``(n k 3, f)`` by the parameters."""
        size, n = len(self.process.turning), len(inputs)
        jacobian = self.model.observe(inputs, self.values)[1][..., list(self.free)]
        slopes = by_joint_positions(self.model, inputs, self.values, size)
        return (inputs[:, :size], slopes.reshape(n, -1, size)), jacobian.reshape(-1, len(self.free))

    @cached_property
    def _rows(self) -> NDArray[np.int_]:
        return np.flatnonzero(np.repeat(self.process.seen.ravel(), 3))

    @cached_property
    def _there(self) -> tuple[Array, Array]:
        return self._at(self.process.inputs)[0]

    @cached_property
    def _support(self) -> "_Support":
        here, columns = self._at(self.process.inputs)
        kept = np.ix_(self._rows, self._rows)
        likely, upper = (
            total_covariance(self.process.kernels, sizes, here)[kept] + sizes[0] * np.eye(len(self._rows))
            for sizes in (self.process.variances, self.process.upper)
        )
        near = precisions([self.model.parameters[i] for i in self.free])
        return _Support.of(likely, upper, columns[self._rows], near)


@dataclass(frozen=True)
class _Support:
    """What the poses of a process say, rows of the numbers that were seen.

    Attributes:
        factor: of their covariance, by Cholesky.
        upper: that covariance by the upper quartiles.
        columns, scale: derivatives by the parameters as unit columns, and the norms that they had.
        whitened: the covariance's inverse times ``columns``.
        precision: of the parameters beforehand, in these units.
        information: of the parameters, in these units, ``precision`` included.
    """

    factor: tuple[Array, bool]
    upper: Array
    columns: Array
    scale: Array
    whitened: Array
    precision: Array
    information: Array

    @classmethod
    def of(cls, likely: Array, upper: Array, columns: Array, near: Array) -> "_Support":
        factor = scipy.linalg.cho_factor(likely, lower=True)
        units, scale = unit_columns(columns)
        whitened = scipy.linalg.cho_solve(factor, units)
        precision = near / scale**2
        return cls(factor, upper, units, scale, whitened, precision, units.T @ whitened + np.diag(precision))
