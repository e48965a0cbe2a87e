"""Errors that several measured numbers share, and how they are made white.

In units of the instrument's noise the errors of pose t are y_t = e_t + S_t s_t + H_t x_t: white noise e_t; the joints'
scatter s_t, drawn anew at each pose; and a state x_t that all poses share, which follows x_t = F_t x_(t-1) + w_t.
Rows are whitened by the innovations of the Kalman filter (Durbin & Koopman 2012, section 4.3): a triangular factor of
the inverse covariance, in a time that grows with the number of poses.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from lab.core.se3 import Array
from lab.kinematics.compiled.kernels import machine_code

__all__ = ["Correlation"]


@dataclass(frozen=True)
class Correlation:
    """Shared errors of n poses of m numbers each, in units of the instrument's noise.

    Numbers that were not observed have rows of zeros.

    Attributes:
        scatter: ``(n, m, j)`` what one standard deviation of each joint's scatter does.
        shift: ``(n, m, s)`` what one standard deviation of each component of the wandering state does.
        carry: correlation of that state over one unit of time, in [0, 1).
        trend: ``(n, m, q)`` what one standard deviation of each coefficient that is the same in all poses does.
        times: ``(n,)`` when each pose was measured; a new session is far from the one before.
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
        """Rows ``(n, m, ...)`` of unit variance and without correlation, from rows in units of the instrument's."""
        factors, _, _ = self._filter
        if not self._states:
            return np.asarray(np.einsum("nij,nj...->ni...", factors, rows))
        flat = np.ascontiguousarray(rows, dtype=np.float64).reshape(*rows.shape[:2], -1)
        done = np.empty_like(flat)
        if (code := machine_code()) is not None:
            _, gains, through = self._filter
            sizes = self.scatter.shape[1], self._states
            code.whiten(*sizes, factors, self._observed, gains, through, self._order, flat, done)
            return done.reshape(rows.shape)
        for t, state in self._walk(flat.shape[2]):
            done[t] = factors[t] @ (flat[t] - self._observed[t] @ state)
            state += self._filter[1][t] @ done[t]
        return done.reshape(rows.shape)

    def coloured(self, rows: Array) -> Array:
        """The inverse of ``white``."""
        factors = np.linalg.inv(self._filter[0])
        if not self._states:
            return np.asarray(np.einsum("nij,nj...->ni...", factors, rows))
        flat = rows.reshape(*rows.shape[:2], -1)
        done = np.empty_like(flat)
        for t, state in self._walk(flat.shape[2]):
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
        wandering = np.arange(self._states) < self.shift.shape[2]
        gaps = np.diff(self.times[self._order], prepend=-np.inf)
        through = np.ones((n, self._states))
        through[self._order] = np.where(wandering, (self.carry**gaps)[:, None], 1.0)
        factors, gains = np.empty((n, m, m)), np.empty((n, self._states, m))
        if (code := machine_code()) is not None:
            if not code.innovations(m, self._states, own, self._observed, through, self._order, factors, gains):
                raise np.linalg.LinAlgError("Matrix is not positive definite")
            return factors, gains, through
        spread = np.eye(self._states)
        for t in self._order.tolist():
            spread = through[t][:, None] * spread * through[t] + np.diag(1 - through[t] ** 2)
            pull = spread @ self._observed[t].T
            factors[t] = np.linalg.inv(np.linalg.cholesky(own[t] + self._observed[t] @ pull))
            gains[t] = pull @ factors[t].T
            spread = spread - gains[t] @ gains[t].T
        return factors, gains, through

    def _walk(self, columns: int) -> Iterator[tuple[int, Array]]:
        """Yield each pose in order of time, with the predicted state ``(s + q, columns)``, which the caller updates."""
        state, through = np.zeros((self._states, columns)), self._filter[2]
        for t in self._order.tolist():
            state *= through[t][:, None]
            yield t, state
