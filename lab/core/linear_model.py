"""A linear model of whitened rows, solved once, and the tests and intervals that stand on it.

With columns X of whitened rows y = X b + e, noise e of variance one, X has the orthonormal basis Q and b = B Q' y
with B what leads from the basis to the parameters (``back``): the covariance is B B', the fit is Q Q' y. One
orthogonal factorization X = Q R and the singular values of the triangle R give both, also where columns depend on
each other (Golub & Van Loan 2013, section 5.5). Everything that fits least squares and asks what it means uses this
one: payloads, the statistics of a calibration, verification.
"""

from collections.abc import Iterable
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import scipy  # its solvers are loaded at their first use
from numpy.typing import NDArray

from lab.core.errors import LabError
from lab.core.probability import chi2_sf, f_sf, t_ppf
from lab.core.se3 import Array

__all__ = [
    "WELL_CONDITIONED",
    "LinearModel",
    "condition_bound",
    "covariance_root",
    "half_width_95",
    "matched_dof",
    "p_value_of_squares",
    "pseudo_inverse",
    "refuse_impossible_covariance",
    "triangle",
    "triangle_of",
    "unit_columns",
    "whitening",
]

_TALL = 4_096  # rows that a processor factorizes faster than more at once
_FAR_FROM_DEPENDENT = 1e-4  # least eigenvalue of products of unit columns whose Cholesky factor keeps twelve digits
_ZERO_COLUMN = 1e-10  # of the largest column's norm: a column below is zero
WELL_CONDITIONED = 1e6  # by Frobenius norms: no singular value is near a tolerance, and ten digits are kept
WHOLE = 1e-6  # of a parameter's unit vector that may lie outside of the determined directions
_NORMAL_HALF_WIDTH_95 = 1.959963984540054


@dataclass(frozen=True)
class LinearModel:
    """Least squares on whitened columns ``(n, p)``, for whatever is to be explained.

    Attributes:
        basis: ``(n, rank)`` Q, orthonormal in the rows that were fitted.
        back: ``(p, rank)`` B, from the basis to the parameters.
        singular_values: ``(min(n, p),)`` of the columns, descending.
        identifiable: ``(p,)`` which parameters the rows determine, each alone.
    """

    basis: Array
    back: Array
    singular_values: Array
    identifiable: NDArray[np.bool_]

    @classmethod
    def of(cls, columns: Array, tolerance: float, *, scaled: bool = False) -> "LinearModel":
        """Decompose columns ``(n, p)``.

        Args:
            tolerance: of the largest singular value, below which one is zero.
            scaled: whether the columns are comparable as they are; else each is scaled to unit norm first.
        """
        scale = None
        if not scaled:
            size = np.linalg.norm(columns, axis=0)
            there = size > _ZERO_COLUMN * size.max(initial=0.0)
            scale = np.where(there, size, 1.0)
            columns = np.where(there, columns / scale, 0.0)
        q, triangle = np.linalg.qr(columns)
        u, sizes, vt = np.linalg.svd(triangle)
        rank = _rank(sizes, tolerance)
        back = vt[:rank].T / sizes[:rank]
        back = back if scale is None else back / scale[:, None]
        return cls(q @ u[:, :rank], back, sizes, _identifiable(vt[:rank]))

    @property
    def rank(self) -> int:
        """Rank of the columns."""
        return int(self.basis.shape[1])

    @property
    def dof(self) -> int:
        """Residual degrees of freedom, where all rows were fitted."""
        return len(self.basis) - self.rank

    @property
    def full_rank(self) -> bool:
        """True if the rows determine every parameter."""
        return self.rank == len(self.back)

    @property
    def covariance(self) -> Array:
        """``(p, p)`` of the parameters, where the rows' noise has variance one."""
        covariance: Array = self.back @ self.back.T
        return covariance

    @property
    def leverages(self) -> Array:
        """``(n,)`` the share of each row that the fit takes up: the diagonal of Q Q'."""
        return np.asarray((self.basis**2).sum(axis=1))

    def coordinates(self, rows: Array) -> Array:
        """Q' y ``(rank, ...)`` of rows ``(n, ...)``: their squares are what the fit explains."""
        coordinates: Array = self.basis.T @ rows
        return coordinates

    def solve(self, rows: Array) -> Array:
        """The shortest parameters ``(p, ...)`` that fit rows ``(n, ...)`` best."""
        solution: Array = self.back @ self.coordinates(rows)
        return solution

    def residual(self, rows: Array) -> Array:
        """Return the residuals of rows ``(n, ...)``."""
        left: Array = rows - self.basis @ self.coordinates(rows)
        return left


def _rank(sizes: Array, tolerance: float) -> int:
    return int((sizes > tolerance * sizes.max(initial=0.0)).sum())


def _identifiable(directions: Array) -> NDArray[np.bool_]:
    """Decide which unit vectors lie in the span of orthonormal rows ``(rank, p)``."""
    return np.asarray((directions**2).sum(axis=0) > 1 - WHOLE)


def unit_columns(columns: Array, axis: int = -2) -> tuple[Array, Array]:
    """Columns divided by their norms over the rows' ``axis``, and the norms; columns of zeros by one."""
    scale = np.sqrt((columns * columns).sum(axis=axis))
    scale[scale == 0] = 1.0
    return columns / np.expand_dims(scale, axis), scale


def pseudo_inverse(upper: Array, tolerance: float) -> Array:
    """The inverse ``(f, f)`` of a triangle; where it is not far from singular, that of its larger singular values.

    Far from it both are the same, and the inverse takes a small part of the time.

    Args:
        upper: ``(f, f)``, a triangle; of fewer rows than columns its upper ones ``(r, f)``, for ``(f, r)``.
        tolerance: of the largest singular value, below which one is zero.
    """
    inverse, bound = _inverse(upper)
    return inverse if bound < WELL_CONDITIONED else np.asarray(np.linalg.pinv(upper, rcond=tolerance), dtype=float)


def condition_bound(upper: Array) -> float:
    """Return an upper bound, by Frobenius norms, of a triangle's ``(f, f)`` condition number; infinite if singular."""
    return _inverse(upper)[1]


def _inverse(upper: Array) -> tuple[Array, float]:
    """The inverse of a triangle, and a bound of its condition."""
    if len(upper) < upper.shape[1] or not np.diag(upper).all():
        return upper, np.inf
    inverse = np.asarray(scipy.linalg.lapack.dtrtri(upper)[0], dtype=float)
    return inverse, float(np.linalg.norm(upper) * np.linalg.norm(inverse))


def triangle(rows: Array, *, overwrite: bool = False) -> Array:
    """R ``(min(n, p), p)`` of rows ``(n, p)``, one at least.

    Args:
        overwrite: whether rows in Fortran's order may be lost, which saves a copy.
    """
    factor = scipy.linalg.lapack.dgeqrf(rows, overwrite_a=overwrite)[0][: min(rows.shape)]
    factor[_below_diagonal(*factor.shape)] = 0.0
    return np.asarray(factor, dtype=float)


@lru_cache(maxsize=64)
def _below_diagonal(rows: int, columns: int) -> NDArray[np.bool_]:
    return np.tri(rows, columns, -1, dtype=np.bool_)


def triangle_of(parts: Iterable[Array]) -> Array:
    """R of all rows ``(n, p)``, which come in parts and are not held together.

    Args:
        parts: one at least, each ``(some, p)``.
    """
    known: Array | None = None
    for part in parts:
        step = _TALL if len(part) > 2 * _TALL else max(len(part), 1)
        own = _triangle_by_products(part) if step < len(part) else None
        firsts = range(0, max(len(part), 1), step)
        for rows in [own] if own is not None else [part[first : first + step] for first in firsts]:
            known = np.asarray(np.linalg.qr(rows if known is None else np.concatenate([known, rows]), mode="r"))
    assert known is not None
    return known


def _triangle_by_products(rows: Array) -> Array | None:
    """R of very many rows by the Cholesky factor of their products; None where columns are too nearly dependent.

    It takes a fifth of the time. The condition of the columns is squared (Golub & Van Loan 2013, section 5.3.2).
    """
    products = rows.T @ rows
    size = np.sqrt(np.diag(products))
    if not (np.isfinite(size).all() and size.all()):
        return None
    products /= np.outer(size, size)
    if np.linalg.eigvalsh(products)[0] < _FAR_FROM_DEPENDENT:
        return None
    return np.asarray(np.linalg.cholesky(products).T * size)


def p_value_of_squares(
    squares: Array | float, numbers: Array | int, dof: Array | float | None = None, variance: Array | float = 1.0
) -> Array:
    """The chance that so many whitened numbers have a larger sum of squares by noise alone.

    F where the variance was estimated with ``dof`` degrees of freedom (Seber & Lee 2003, section 4.3), else chi
    squared.

    Args:
        squares: the sums of squares.
        numbers: how many numbers each is of, one at least.
        dof: of the variance; None where it is known.
        variance: of one number.
    """
    if dof is None:
        return np.asarray(chi2_sf(squares / variance, numbers))
    return np.asarray(f_sf(squares / numbers / variance, numbers, dof))


def matched_dof(mean: Array | float, variance: Array | float) -> Array:
    """Degrees of freedom of the scaled chi squared that has a mean and a variance (Satterthwaite 1946).

    Infinite where there is no variance.
    """
    mean, variance = np.asarray(mean, dtype=np.float64), np.asarray(variance, dtype=np.float64)
    dof = np.full(np.broadcast_shapes(mean.shape, variance.shape), np.inf)
    np.divide(2 * mean**2, variance, out=dof, where=variance > 0)
    return dof


def half_width_95(dof: Array | float) -> Array:
    """Half of a 95 % interval in standard deviations: Student's t, with infinite ``dof`` the normal's."""
    return np.asarray(np.where(np.isinf(dof), _NORMAL_HALF_WIDTH_95, t_ppf(0.975, dof)))


_ROUNDING = 1e-9  # relative to the standard deviations: what writing, reading and projecting a matrix may change


def refuse_impossible_covariance(where: object, matrix: Array) -> None:
    """Refuse a matrix ``(f, f)`` that is no covariance: finite, symmetric and positive semidefinite.

    It is judged with unit diagonal, so that the units of its parameters do not matter.

    Raises:
        LabError: it is none.
    """
    if matrix.ndim != 2 or matrix.shape[0] != matrix.shape[1]:
        raise LabError(f"{where}: the covariance is no square matrix; identify again")
    if not np.isfinite(matrix).all():
        raise LabError(f"{where}: the covariance has numbers that are not finite; identify again")
    variances = np.diag(matrix)
    if (variances < 0).any():
        raise LabError(f"{where}: the covariance has a variance below zero; identify again")
    sigma = np.sqrt(variances)
    if (matrix[:, sigma == 0] != 0).any() or (matrix[sigma == 0] != 0).any():
        raise LabError(f"{where}: the covariance correlates what has no variance; identify again")
    scale = np.where(sigma > 0, sigma, 1.0)
    correlation = matrix / scale / scale[:, None]
    if np.abs(correlation - correlation.T).max(initial=0.0) > _ROUNDING:
        raise LabError(f"{where}: the covariance is not symmetric; identify again")
    if len(matrix) and np.linalg.eigvalsh((correlation + correlation.T) / 2)[0] < -_ROUNDING * len(matrix):
        raise LabError(f"{where}: the covariance is not positive semidefinite; identify again")


def covariance_root(covariance: Array) -> Array:
    """Return a square root ``(f, f)`` of a covariance, which may be singular, of parameters in several units.

    NaN where a variance is not finite: nothing is known of it.
    """
    if not np.isfinite(covariance).all():
        return np.full_like(covariance, np.nan)
    scale = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    scale = np.where(scale > 0, scale, 1.0)
    sizes, axes = np.linalg.eigh(covariance / np.outer(scale, scale))
    return np.asarray(scale[:, None] * axes * np.sqrt(np.maximum(sizes, 0.0)))


def whitening(covariance: Array) -> Array:
    """Matrices ``(..., 3, 3)`` that make noise of these covariances white: inverse Cholesky factors."""
    return np.asarray(np.linalg.inv(np.linalg.cholesky(covariance)), dtype=np.float64)
