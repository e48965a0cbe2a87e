"""The restricted likelihood of variance components, on a linear problem pose by pose.

With whitened rows y = J b + e of covariance s V the restricted likelihood is that of what no b explains (Patterson &
Thompson 1971): minus twice its logarithm is log|V| + log|J'V^-1 J| + (N - f) log s + Q / s, with Q = r'V^-1 r at the
generalized least squares. V = 1 + g S S' + U G U' + sum d_i D_i D_i': errors within each pose, a first-order
autoregressive shift (whose inverse covariance has one band: Rue & Held 2005, section 1.1), and lasting errors. So
every product with V^-1 takes a time that grows with the number of poses alone.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import scipy  # its parts are loaded at their first use, which not every process comes to

from lab.calibration.noise.change_points import ChangePoint, Found, likeliest_change
from lab.calibration.noise.error_term import Components, ErrorShapes, ErrorTerm
from lab.calibration.noise.terms import TERMS
from lab.core.se3 import Array

__all__ = ["LEAST_SHARE", "Likelihood", "RestrictedProblem"]

_LEAST = 1e-300
(_WITHIN,) = (term for term in TERMS if term.structure == "pose")
(_IN_TIME,) = (term for term in TERMS if term.structure == "autoregressive")
_LASTING = tuple(term for term in TERMS if term.structure == "lasting")
LEAST_SHARE = 0.25  # of a known instrument's variance: half its noise
_LEAST_GAP = 1e-8
_ROUNDING = 1e-14  # added to the normal equations of unit columns


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

    def predicted(self, components: Components, of: ErrorTerm) -> Array:
        """Return the best prediction ``(c / 3, 3)`` of the coefficients of a lasting term; where nothing wanders."""
        rows, _, lasting, weight = self._white(components)
        squares = _gram(np.concatenate([rows[..., :-1], lasting, rows[..., -1:]], axis=2) * weight)
        free, size = rows.shape[2] - 1, len(squares) - 1
        squares[:size, :size] += np.diag(np.where(np.arange(size) < free, _ROUNDING, 1.0))
        found = np.linalg.solve(squares[:size, :size], squares[:size, size])
        first = free
        for term in _LASTING:
            count = self._rotated.lasting[term.name].shape[2] if components[term.name] else 0
            if term is of:
                break
            first += count
        return np.asarray(np.sqrt(components[of.name]) * found[first : first + count].reshape(-1, 3))

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
    def _rotated(self) -> "_Rotated":
        shapes = self.shapes
        within = _WITHIN.shape(shapes)
        sizes, axes = np.linalg.eigh(within @ np.swapaxes(within, 1, 2))
        turn = np.swapaxes(axes, 1, 2)
        lasting = {term.name: turn @ term.shape(shapes) for term in _LASTING}
        return _Rotated(turn @ self.rows, turn @ _IN_TIME.shape(shapes), lasting, np.maximum(sizes, 0.0))

    def _white(self, components: Components) -> tuple[Array, Array, Array, Array]:
        """Rows, shift and what lasts, ``(n, m, ...)``, and the weights ``(n, m, 1)`` that make white what does not."""
        rotated = self._rotated
        weight = 1 / np.sqrt(1 + components[_WITHIN.name] * rotated.sizes)[..., None]
        pairs = ((components[name], each) for name, each in rotated.lasting.items())
        lasting = [np.sqrt(size) * each for size, each in pairs if size]
        none = rotated.shift[..., :0]
        return rotated.rows, rotated.shift, np.concatenate(lasting or [none], axis=2), weight

    def _products(self, components: Components) -> tuple[Array, float]:
        """Z'V^-1 Z ``(f + 1, f + 1)`` of the rows Z, and log|V|."""
        rows, shift, lasting, weight = self._white(components)
        columns, count = rows.shape[2], lasting.shape[2]
        white = (np.concatenate([rows, lasting], axis=2) if count else rows) * weight
        squares, determinant = _gram(white), -2 * float(np.log(weight).sum())
        if components[_IN_TIME.name]:
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
        inner = components[_IN_TIME.name] * np.swapaxes(shift, 1, 2) @ shift
        axes = shift.shape[2]
        banded = np.zeros((axes + 1, axes * len(order)))
        for band in range(axes):
            for i in range(axes - band):
                banded[band, i::axes] = inner[:, i + band, i]
        banded[0] += np.repeat(diagonal, axes)
        banded[axes, : axes * len(carry)] = np.repeat(-carry / own, axes)
        factor = scipy.linalg.cholesky_banded(banded, lower=True, check_finite=False)
        pulls = np.sqrt(components[_IN_TIME.name]) * (np.swapaxes(shift, 1, 2) @ white).reshape(axes * len(order), -1)
        solved = scipy.linalg.cho_solve_banded((factor, True), pulls, check_finite=False)
        determinant = 2 * float(np.log(factor[0]).sum()) + axes * float(np.log(own).sum())
        return pulls.T @ solved, determinant


@dataclass(frozen=True)
class _Rotated:
    """A problem in the axes of each pose's own errors.

    Attributes:
        rows: ``(n, m, f + 1)``.
        shift: ``(n, m, 3)`` the shape of the autoregressive term.
        lasting: those of the lasting terms, by name.
        sizes: ``(n, m)`` the variances of the pose's own errors along these axes.
    """

    rows: Array
    shift: Array
    lasting: Mapping[str, Array]
    sizes: Array


def _slowness(components: Components) -> float:
    """Twice the logarithm of a weak prior, sqrt(1 - carry): no campaign shows a shift that is slower than itself."""
    return float(np.log1p(-components.carry)) if components[_IN_TIME.name] else 0.0


def _gram(rows: Array) -> Array:
    flat = rows.reshape(-1, rows.shape[2])
    return np.asarray(flat.T @ flat)
