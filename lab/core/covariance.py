"""What a matrix must be to be a covariance, and what makes noise of one white, or white numbers noise of one."""

import numpy as np

from lab.core.errors import LabError
from lab.core.se3 import Array

__all__ = ["covariance_root", "refuse_impossible_covariance", "whitening"]

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
