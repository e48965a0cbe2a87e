"""The restricted likelihood of variance components, on a linear problem pose by pose.

With whitened rows y = J b + e of covariance s V the restricted likelihood is that of what no b explains (Patterson &
Thompson 1971): minus twice its logarithm is log|V| + log|J'V^-1 J| + (N - f) log s + Q / s, with Q = r'V^-1 r at the
generalized least squares. V = 1 + g S S' + U G U' + d D D' + c C C': the joints' scatter within each pose, a first-
order autoregressive shift of the base (whose inverse covariance has one band: Rue & Held 2005, section 1.1), a trend,
and change points. So every product with V^-1 takes a time that grows with the number of poses alone.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import scipy  # its parts are loaded at their first use, which not every process comes to

from lab.calibration.noise.change_points import ChangePoint, Found, before_and_after, likeliest_change
from lab.calibration.noise.correlation import Correlation
from lab.core.se3 import Array

__all__ = ["LEAST_SHARE", "Components", "ErrorShapes", "Likelihood", "RestrictedProblem"]

_LEAST = 1e-300
LEAST_SHARE = 0.25  # of a known instrument's variance: half its noise
_LEAST_GAP = 1e-8
_ROUNDING = 1e-14  # added to the normal equations of unit columns


@dataclass(frozen=True)
class Components:
    """Variances in units of the instrument's.

    Attributes:
        scatter: of a joint's position, per unit of ``ErrorShapes.scatter``.
        shift: of the base's wandering shift, per unit of ``ErrorShapes.shift``.
        carry: the shift's correlation over one unit of time, in [0, 1).
        trend: of the base's drift over the campaign, per unit of ``ErrorShapes.trend``.
        step: of the base's shift at a change point, per unit of ``ErrorShapes.step``.
    """

    scatter: float = 0.0
    shift: float = 0.0
    carry: float = 0.0
    trend: float = 0.0
    step: float = 0.0


@dataclass(frozen=True)
class ErrorShapes:
    """What each kind of error does to the whitened numbers of a pose, zero where nothing was observed.

    Attributes:
        scatter: ``(n, m, j)`` by the joints' positions.
        shift: ``(n, m, 3)`` by a shift of the base.
        trend: ``(n, m, 3)`` by the shift at the end of a steady drift against its mean.
        times: ``(n,)`` when each pose was measured; far apart where a new session begins.
        changes: when the base moved at once.
    """

    scatter: Array
    shift: Array
    trend: Array
    times: Array
    changes: tuple[ChangePoint, ...] = ()

    @cached_property
    def step(self) -> Array:
        """``(n, m, 3 c)`` by the shift at each change, against the mean over the rows of its session."""
        along = before_and_after(self.times, self.changes)
        return np.asarray((along[:, None, :, None] * self.shift[:, :, None]).reshape(*self.shift.shape[:2], -1))

    def correlation(self, of: Components) -> Correlation:
        """The errors of these variances, each per unit of its shape; what has none is left out.

        A shift that nothing carries on is drawn anew at each pose, as scatter is: rows are then white pose by pose.
        """
        lasting = [np.sqrt(size) * each for size, each in ((of.trend, self.trend), (of.step, self.step)) if size]
        pairs = ((of.scatter, self.scatter), (0.0 if of.carry else of.shift, self.shift))
        alone = [np.sqrt(size) * each for size, each in pairs if size]
        shift = np.sqrt(of.shift) * self.shift if of.shift and of.carry else self.shift[..., :0]
        none = self.trend[..., :0]
        return Correlation(
            np.concatenate(alone or [none], axis=2),
            shift,
            of.carry,
            np.concatenate(lasting or [none], axis=2),
            self.times,
        )


@dataclass(frozen=True)
class Likelihood:
    """What some components give.

    Attributes:
        deviance: minus twice the restricted log-likelihood, up to a constant, with the weak prior of a slow shift.
        scale: s, the instrument's variance in units of the one assumed.
        information: ``(f, f)`` J'V^-1 J of unit columns.
    """

    deviance: float
    scale: float
    information: Array


@dataclass(frozen=True)
class RestrictedProblem:
    """Whitened rows of n poses, residuals beside derivatives, with the errors that they may share.

    Attributes:
        rows: ``(n, m, f + 1)`` derivatives of unit norm, then residuals; zero where nothing was observed.
        numbers: how many were observed.
        shapes: what the errors do.
        known: whether the instrument's variance is known, so that s is at most one.
    """

    rows: Array
    numbers: int
    shapes: ErrorShapes
    known: bool

    @property
    def dof(self) -> int:
        """Residual degrees of freedom."""
        return self.numbers - int(self.rows.shape[2]) + 1

    def changed_at(self, changes: Sequence[ChangePoint]) -> "RestrictedProblem":
        """The same with the base moved there at once."""
        return replace(self, shapes=replace(self.shapes, changes=tuple(changes)))

    def likeliest_change(self, components: Components) -> Found | None:
        """Where the base moved at once, if it did so once more; beside what lasts, but not beside a wandering shift."""
        rows, shift, lasting, weight = self._white(components)
        fitted = np.concatenate([rows[..., :-1], lasting, rows[..., -1:]], axis=2)
        return likeliest_change(fitted * weight, shift * weight, self.shapes.times)

    def shifts(self, components: Components) -> Array:
        """The best prediction ``(c, 3)`` of the shift at each change point; where nothing wanders."""
        rows, _, lasting, weight = self._white(components)
        squares = _gram(np.concatenate([rows[..., :-1], lasting, rows[..., -1:]], axis=2) * weight)
        free, size = rows.shape[2] - 1, len(squares) - 1
        squares[:size, :size] += np.diag(np.where(np.arange(size) < free, _ROUNDING, 1.0))
        found = np.linalg.solve(squares[:size, :size], squares[:size, size])
        count = self.shapes.step.shape[2]
        return np.asarray(np.sqrt(components.step) * found[size - count :].reshape(-1, self.shapes.shift.shape[2]))

    def likelihood(self, components: Components) -> Likelihood:
        """The restricted likelihood of some components, with the best s.

        A known instrument's variance is an upper bound: some of its own error may wander. But it is not left aside.
        """
        information, left, determinant = self._solved(components)
        scale = float(np.clip(left / self.dof, LEAST_SHARE, 1.0)) if self.known else left / self.dof
        deviance = determinant + self.dof * np.log(scale) + left / scale - _slowness(components)
        return Likelihood(float(deviance), scale, information)

    def at(self, components: Components, scale: float) -> Likelihood:
        """The same with the instrument's variance s as it is given."""
        information, left, determinant = self._solved(components)
        deviance = determinant + self.dof * np.log(scale) + left / scale - _slowness(components)
        return Likelihood(float(deviance), scale, information)

    def _solved(self, components: Components) -> tuple[Array, float, float]:
        """J'V^-1 J, the least r'V^-1 r, and log|V| + log|J'V^-1 J|."""
        squares, determinant = self._products(components)
        size = len(squares) - 1
        factor = np.linalg.cholesky(squares[:size, :size] + _ROUNDING * np.eye(size))
        pull = scipy.linalg.solve_triangular(factor, squares[:size, size], lower=True)
        left = max(float(squares[size, size] - pull @ pull), _LEAST)
        return squares[:size, :size], left, determinant + 2 * float(np.log(np.diag(factor)).sum())

    @cached_property
    def _rotated(self) -> tuple[Array, Array, Array, Array, Array]:
        """Rows, shift, trend and steps in the axes of each pose's scatter, and its variances ``(n, m)`` along these."""
        shapes = self.shapes
        sizes, axes = np.linalg.eigh(shapes.scatter @ np.swapaxes(shapes.scatter, 1, 2))
        turn = np.swapaxes(axes, 1, 2)
        return turn @ self.rows, turn @ shapes.shift, turn @ shapes.trend, turn @ shapes.step, np.maximum(sizes, 0.0)

    def _white(self, components: Components) -> tuple[Array, Array, Array, Array]:
        """Rows, shift and what lasts, ``(n, m, ...)``, and the weights ``(n, m, 1)`` that make white what does not."""
        rows, shift, trend, step, sizes = self._rotated
        weight = 1 / np.sqrt(1 + components.scatter * sizes)[..., None]
        pairs = ((components.trend, trend), (components.step, step))
        lasting = [np.sqrt(size) * each for size, each in pairs if size]
        return rows, shift, np.concatenate(lasting or [trend[..., :0]], axis=2), weight

    def _products(self, components: Components) -> tuple[Array, float]:
        """Z'V^-1 Z ``(f + 1, f + 1)`` of the rows Z, and log|V|."""
        rows, shift, lasting, weight = self._white(components)
        columns, count = rows.shape[2], lasting.shape[2]
        white = (np.concatenate([rows, lasting], axis=2) if count else rows) * weight
        squares, determinant = _gram(white), -2 * float(np.log(weight).sum())
        if components.shift:
            more, extra = self._wandering(white, shift * weight, components)
            squares, determinant = squares - more, determinant + extra
        if not count:
            return squares, determinant
        inner = np.eye(count) + squares[columns:, columns:]
        cross = squares[columns:, :columns]
        return (
            squares[:columns, :columns] - cross.T @ np.linalg.solve(inner, cross),
            determinant + float(np.linalg.slogdet(inner)[1]),
        )

    def _wandering(self, white: Array, shift: Array, components: Components) -> tuple[Array, float]:
        """What a first-order autoregressive shift takes off the products, and adds to log|V| (Woodbury's identity)."""
        order = np.argsort(self.shapes.times, kind="stable")
        white, shift = white[order], shift[order]
        carry = components.carry ** np.diff(self.shapes.times[order])
        own = np.maximum(1 - carry**2, _LEAST_GAP)  # of two rows at one time
        diagonal = np.ones(len(order))
        diagonal[:-1] += carry**2 / own
        diagonal[1:] += carry**2 / own
        inner = components.shift * np.swapaxes(shift, 1, 2) @ shift
        axes = shift.shape[2]
        banded = np.zeros((axes + 1, axes * len(order)))
        for band in range(axes):
            for i in range(axes - band):
                banded[band, i::axes] = inner[:, i + band, i]
        banded[0] += np.repeat(diagonal, axes)
        banded[axes, : axes * len(carry)] = np.repeat(-carry / own, axes)
        factor = scipy.linalg.cholesky_banded(banded, lower=True, check_finite=False)
        pulls = np.sqrt(components.shift) * (np.swapaxes(shift, 1, 2) @ white).reshape(axes * len(order), -1)
        solved = scipy.linalg.cho_solve_banded((factor, True), pulls, check_finite=False)
        determinant = 2 * float(np.log(factor[0]).sum()) + axes * float(np.log(own).sum())
        return pulls.T @ solved, determinant


def _slowness(components: Components) -> float:
    """Twice the logarithm of a weak prior, sqrt(1 - carry): no campaign shows a shift that is slower than itself."""
    return float(np.log1p(-components.carry)) if components.shift else 0.0


def _gram(rows: Array) -> Array:
    flat = rows.reshape(-1, rows.shape[2])
    return np.asarray(flat.T @ flat)
