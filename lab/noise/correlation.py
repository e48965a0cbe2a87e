"""Whiten errors that several measured numbers share.

In units of the instrument's noise the errors of pose t are y_t = e_t + S_t s_t + H_t x_t: white noise e_t; the joints'
scatter s_t, independent at each pose; and a state x_t that all poses share, which follows x_t = F_t x_(t-1) + w_t.
Rows are whitened by the innovations of the Kalman filter (Durbin & Koopman 2012, section 4.3): a triangular factor of
the inverse covariance, in a time that grows with the number of poses.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from lab.core.se3 import Array
from lab.kinematics.compiled.kernels import innovations, whiten
from lab.kinematics.compiled.numpy_kernels import states

__all__ = ["Correlation"]


@dataclass(frozen=True)
class Correlation:
    """Shared errors of n poses of m numbers each, in units of the instrument's noise.

    Numbers that were not observed have rows of zeros.

    Attributes:
        scatter: ``(n, m, j)`` effect of one standard deviation of each joint's scatter.
        shift: ``(n, m, s)`` that of each component of the autoregressive state.
        carry: correlation of that state over one unit of time, in [0, 1).
        trend: ``(n, m, q)`` that of each coefficient common to all poses.
        times: ``(n,)`` of each pose; sessions are far apart.
    """

    scatter: Array
    shift: Array
    carry: float
    trend: Array
    times: Array

    def take(self, rows: NDArray[np.int_]) -> "Correlation":
        """Return the correlation of some of the poses."""
        return Correlation(self.scatter[rows], self.shift[rows], self.carry, self.trend[rows], self.times[rows])

    def joined(self, other: "Correlation") -> "Correlation":
        """Return the joint correlation of these poses followed by others, with the same errors."""
        mine, others = ((each.scatter, each.shift, each.trend, each.times) for each in (self, other))
        scatter, shift, trend, times = (np.concatenate(pair) for pair in zip(mine, others, strict=True))
        return Correlation(scatter, shift, self.carry, trend, times)

    @property
    def squares(self) -> Array:
        """``(n, m)`` the variance of each number, beside the instrument's, which is one."""
        return np.asarray(sum((part**2).sum(axis=2) for part in (self.scatter, self.shift, self.trend)))

    def of_single_poses(self) -> "Correlation":
        """Return the same variances within each pose, without correlation between poses."""
        shared = np.concatenate([self.scatter, self.shift, self.trend], axis=2)
        nothing = np.zeros((*shared.shape[:2], 0))
        return Correlation(shared, nothing, 0.0, nothing, self.times)

    def white(self, rows: Array) -> Array:
        """Whiten rows ``(n, m, ...)`` that are in units of the instrument's noise."""
        factors, gains, through = self._filter
        if not self._states:
            return np.asarray(np.einsum("nij,nj...->ni...", factors, rows))
        flat = np.ascontiguousarray(rows, dtype=np.float64).reshape(*rows.shape[:2], -1)
        return whiten(factors, self._observed, gains, through, self._order, flat).reshape(rows.shape)

    def coloured(self, rows: Array) -> Array:
        """Apply the inverse of ``white``."""
        factors = np.linalg.inv(self._filter[0])
        if not self._states:
            return np.asarray(np.einsum("nij,nj...->ni...", factors, rows))
        flat = rows.reshape(*rows.shape[:2], -1)
        done = np.empty_like(flat)
        for t, state in states(self._filter[2], self._order, flat.shape[2]):
            done[t] = factors[t] @ flat[t] + self._observed[t] @ state
            state += self._filter[1][t] @ flat[t]
        return done.reshape(rows.shape)

    @property
    def between_poses(self) -> bool:
        """True if errors are correlated between poses."""
        return self._states > 0

    @property
    def _states(self) -> int:
        return int(self.shift.shape[2] + self.trend.shape[2])

    @cached_property
    def _observed(self) -> Array:
        """``(n, m, s + q)`` H."""
        return np.concatenate([self.shift, self.trend], axis=2)

    @cached_property
    def _order(self) -> NDArray[np.int64]:
        return np.argsort(self.times, kind="stable").astype(np.int64)

    @cached_property
    def _filter(self) -> tuple[Array, Array, Array]:
        """Inverse Cholesky factors ``(n, m, m)`` of the innovations, gains ``(n, s + q, m)``, and F's diagonal."""
        n, m = self.scatter.shape[:2]
        own = np.eye(m) + self.scatter @ np.swapaxes(self.scatter, 1, 2)
        if not self._states:
            return np.linalg.inv(np.linalg.cholesky(own)), np.zeros((n, 0, m)), np.ones((n, 0))
        autoregressive = np.arange(self._states) < self.shift.shape[2]
        gaps = np.diff(self.times[self._order], prepend=-np.inf)
        through = np.ones((n, self._states))
        through[self._order] = np.where(autoregressive, (self.carry**gaps)[:, None], 1.0)
        return *innovations(own, self._observed, through, self._order), through
