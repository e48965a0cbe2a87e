"""Linear least squares of whitened rows, with its tests and intervals.

With columns X of whitened rows y = X b + e, noise e of variance one, X has the orthonormal basis Q, and b = B Q' y:
the covariance is B B', the fit is Q Q' y. The factorization X = Q R and the singular values of R give both, also for
dependent columns (Golub & Van Loan 2013, section 5.5).
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
    "least_squares",
    "matched_dof",
    "p_value_of_squares",
    "pseudo_inverse",
    "refuse_impossible_covariance",
    "triangle",
    "triangle_of",
    "unit_columns",
    "whitening",
]

_TALL = 4_096  # rows to factorize at once: the fastest number
_FAR_FROM_DEPENDENT = 1e-4  # least eigenvalue of products of unit columns whose Cholesky factor keeps twelve digits
_ZERO_COLUMN = 1e-10  # of the largest column's norm: a column below is zero
WELL_CONDITIONED = 1e6  # condition number by Frobenius norms: ten digits are kept
_UNDETERMINED_SHARE = 1e-6  # of an identifiable parameter's unit vector outside the determined directions
_NORMAL_HALF_WIDTH_95 = 1.959963984540054


@dataclass(frozen=True)
class LinearModel:
    """Decomposed columns ``(n, p)`` of a linear model.

    Attributes:
        basis: ``(n, rank)`` Q, orthonormal in the fitted rows.
        back: ``(p, rank)`` B, from the basis to the parameters.
        singular_values: ``(min(n, p),)`` of the columns, descending.
        identifiable: ``(p,)`` parameters that the rows determine.
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
            scaled: keep the columns' scale; otherwise each is scaled to unit norm first.
        """
        scale = None
        if not scaled:
            size = np.linalg.norm(columns, axis=0)
            nonzero = size > _ZERO_COLUMN * size.max(initial=0.0)
            scale = np.where(nonzero, size, 1.0)
            columns = np.where(nonzero, columns / scale, 0.0)
        q, triangle = np.linalg.qr(columns)
        u, sizes, vt = np.linalg.svd(triangle)
        rank = int((sizes > tolerance * sizes.max(initial=0.0)).sum())
        back = vt[:rank].T / sizes[:rank]
        back = back if scale is None else back / scale[:, None]
        identifiable = np.asarray((vt[:rank] ** 2).sum(axis=0) > 1 - _UNDETERMINED_SHARE)
        return cls(q @ u[:, :rank], back, sizes, identifiable)

    @property
    def rank(self) -> int:
        """Rank of the columns."""
        return int(self.basis.shape[1])

    @property
    def dof(self) -> int:
        """Residual degrees of freedom if all rows were fitted."""
        return len(self.basis) - self.rank

    @property
    def full_rank(self) -> bool:
        """True if the rows determine every parameter."""
        return self.rank == len(self.back)

    @property
    def covariance(self) -> Array:
        """Covariance ``(p, p)`` of the parameters."""
        return np.asarray(self.back @ self.back.T)

    @property
    def leverages(self) -> Array:
        """Leverages ``(n,)``: the diagonal of Q Q'."""
        return np.asarray((self.basis**2).sum(axis=1))

    def coordinates(self, rows: Array) -> Array:
        """Return Q' y ``(rank, ...)`` of rows ``(n, ...)``, whose squares the fit explains."""
        return np.asarray(self.basis.T @ rows)

    def solve(self, rows: Array) -> Array:
        """Return the least-squares solution ``(p, ...)`` of least norm for rows ``(n, ...)``."""
        return np.asarray(self.back @ self.coordinates(rows))

    def residual(self, rows: Array) -> Array:
        """Return the residuals of rows ``(n, ...)``."""
        return np.asarray(rows - self.basis @ self.coordinates(rows))


def unit_columns(columns: Array, axis: int = -2) -> tuple[Array, Array]:
    """Return columns divided by their norms over ``axis``, and the norms; one for columns of zeros."""
    scale = np.sqrt((columns * columns).sum(axis=axis, keepdims=True))
    scale[scale == 0] = 1.0
    return columns / scale, scale.squeeze(axis)


def pseudo_inverse(upper: Array, tolerance: float) -> Array:
    """Return the pseudo-inverse of a triangle ``(f, f)``, or of its upper rows ``(r, f)``.

    Args:
        tolerance: of the largest singular value, below which one is zero.
    """
    inverse, bound = _inverse(upper)
    return inverse if bound < WELL_CONDITIONED else np.asarray(np.linalg.pinv(upper, rcond=tolerance), dtype=float)


def least_squares(columns: Array, right: Array, tolerance: float) -> tuple[Array, Array]:
    """Return the shortest least-squares solutions ``(f, s)``, and the pseudo-inverse ``(f, r)`` of the columns' R.

    Args:
        columns: ``(n, f)``; they keep their scale.
        right: ``(n, s)`` right sides.
        tolerance: of the largest singular value, below which one is zero.
    """
    size = columns.shape[1]
    both = triangle(np.concatenate([columns, right], axis=1))
    inverse = pseudo_inverse(both[:size, :size], tolerance)
    return inverse @ both[:size, size:], inverse


def condition_bound(upper: Array) -> float:
    """Return an upper bound, by Frobenius norms, of a triangle's ``(f, f)`` condition number; infinite if singular."""
    return _inverse(upper)[1]


def _inverse(upper: Array) -> tuple[Array, float]:
    """Return the inverse of a triangle, and an upper bound of its condition number."""
    if len(upper) < upper.shape[1] or not np.diag(upper).all():
        return upper, np.inf
    inverse = np.asarray(scipy.linalg.lapack.dtrtri(upper)[0], dtype=float)
    return inverse, float(np.sqrt(np.vdot(upper, upper)) * np.sqrt(np.vdot(inverse, inverse)))


def triangle(rows: Array, *, overwrite: bool = False) -> Array:
    """Return R ``(min(n, p), p)`` of rows ``(n, p)``, one at least; ``overwrite`` saves a copy in Fortran's order."""
    factor = scipy.linalg.lapack.dgeqrf(rows, overwrite_a=overwrite)[0][: min(rows.shape)]
    factor[_below_diagonal(*factor.shape)] = 0.0
    return np.asarray(factor, dtype=float)


@lru_cache(maxsize=64)
def _below_diagonal(rows: int, columns: int) -> NDArray[np.bool_]:
    return np.tri(rows, columns, -1, dtype=np.bool_)


def triangle_of(parts: Iterable[Array]) -> Array:
    """Return R of rows that come in parts ``(some, p)``, one at least."""
    upper: Array | None = None
    for part in parts:
        step = _TALL if len(part) > 2 * _TALL else max(len(part), 1)
        own = _triangle_by_products(part) if step < len(part) else None
        firsts = range(0, max(len(part), 1), step)
        for rows in [own] if own is not None else [part[first : first + step] for first in firsts]:
            upper = np.asarray(np.linalg.qr(rows if upper is None else np.concatenate([upper, rows]), mode="r"))
    assert upper is not None
    return upper


def _triangle_by_products(rows: Array) -> Array | None:
    """Return R of many rows by Cholesky factorization; None if columns are nearly dependent.

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
    """Return the p-value of sums of squares of whitened numbers.

    It is from F if the variance was estimated with ``dof`` degrees of freedom (Seber & Lee 2003, section 4.3), else
    from chi squared.

    Args:
        numbers: count of the numbers of each sum, one at least.
        variance: of one number.
    """
    if dof is None:
        return np.asarray(chi2_sf(squares / variance, numbers))
    return np.asarray(f_sf(squares / numbers / variance, numbers, dof))


def matched_dof(mean: Array | float, variance: Array | float) -> Array:
    """Return degrees of freedom of the scaled chi squared with this mean and variance (Satterthwaite 1946)."""
    mean, variance = np.asarray(mean, dtype=np.float64), np.asarray(variance, dtype=np.float64)
    dof = np.full(np.broadcast_shapes(mean.shape, variance.shape), np.inf)
    np.divide(2 * mean**2, variance, out=dof, where=variance > 0)
    return dof


def half_width_95(dof: Array | float) -> Array:
    """Return half a 95 % interval in standard deviations: Student's t, or normal for infinite ``dof``."""
    return np.asarray(np.where(np.isinf(dof), _NORMAL_HALF_WIDTH_95, t_ppf(0.975, dof)))


_ROUNDING = 1e-9  # relative to the standard deviations: what writing, reading and projecting a matrix may change


def refuse_impossible_covariance(where: object, matrix: Array) -> None:
    """Refuse a matrix that is not finite, symmetric and positive semidefinite, at unit diagonal, with a LabError."""
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
    """Return a square root ``(f, f)`` of a covariance, which may be singular; NaN if one number is not finite."""
    if not np.isfinite(covariance).all():
        return np.full_like(covariance, np.nan)
    scale = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    scale = np.where(scale > 0, scale, 1.0)
    sizes, axes = np.linalg.eigh(covariance / np.outer(scale, scale))
    return np.asarray(scale[:, None] * axes * np.sqrt(np.maximum(sizes, 0.0)))


def whitening(covariance: Array) -> Array:
    """Return the inverse Cholesky factors ``(..., 3, 3)`` of covariances, which whiten their noise."""
    return np.asarray(np.linalg.inv(np.linalg.cholesky(covariance)), dtype=np.float64)
