"""Score statistics of columns beside a model of residuals: how much of r' V^-1 r each would explain."""

from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from lab.core.se3 import Array

__all__ = ["Residuals", "score", "scores_of_poses", "scores_of_steps"]

_LEAST_ROWS = 3  # on either side of a step
_RIDGE = 1e-9


class Residuals(Protocol):
    """Residuals r ``(n, m)`` of n poses with the inverse covariance V^-1 = W - B B'."""

    @property
    def pulls(self) -> Array:
        """V^-1 r ``(n, m)``."""
        ...

    @property
    def basis(self) -> Array:
        """B ``(n, m, c)``."""
        ...

    @property
    def weights(self) -> Array:
        """W ``(n, m)``, which is diagonal."""
        ...


def score(fit: Residuals, columns: Array) -> float:
    """Return the score statistic of columns ``(n, m, c)``: the fall of r' V^-1 r at these variances."""
    pull = np.einsum("nmc,nm->c", columns, fit.pulls)
    crossed = np.einsum("nmc,nmr->cr", columns, fit.basis, optimize=True)
    normal = np.einsum("nmc,nm,nmd->cd", columns, fit.weights, columns, optimize=True)
    return float(_quadratic((normal - crossed @ crossed.T)[None], pull[None], np.diag(normal)[None])[0])


def scores_of_steps(fit: Residuals, columns: Array, order: NDArray[np.int_]) -> Array:
    """Return the score statistics ``(n,)`` of columns that count from each row in time on; zero near the ends."""
    part, n = columns[order], len(order)
    pulls = np.einsum("nmc,nm->nc", part, fit.pulls[order])
    crossed = np.swapaxes(part, 1, 2) @ fit.basis[order]
    normal = np.swapaxes(part, 1, 2) @ (fit.weights[order][..., None] * part)
    pulls, crossed, normal = (np.cumsum(each[::-1], axis=0)[::-1] for each in (pulls, crossed, normal))
    left = normal - crossed @ np.swapaxes(crossed, 1, 2)
    scores = _quadratic(left, pulls, np.einsum("ncc->nc", normal))
    number = np.arange(n)
    return np.where((number >= _LEAST_ROWS) & (number <= n - _LEAST_ROWS), scores, 0.0)


def _quadratic(left: Array, pulls: Array, whole: Array) -> Array:
    """Return u' G^-1 u ``(n,)`` with directions that other columns hold left out."""
    scale = 1 / np.sqrt(np.maximum(whole, 1e-300))
    sizes, axes = np.linalg.eigh(left * scale[:, :, None] * scale[:, None, :])
    turned = (np.swapaxes(axes, 1, 2) @ (pulls * scale)[..., None])[..., 0]
    return np.asarray(np.where(sizes > _RIDGE, turned**2 / np.maximum(sizes, _RIDGE), 0.0).sum(axis=1))


def scores_of_poses(fit: Residuals, mask: NDArray[np.bool_]) -> Array:
    """Return the score statistic ``(n,)`` of each pose's own error: how much less r' V^-1 r is without the pose.

    Args:
        mask: ``(n, m)`` which numbers were observed.
    """
    number = np.arange(mask.shape[1])
    left = -fit.basis @ np.swapaxes(fit.basis, 1, 2)
    left[:, number, number] += fit.weights
    return _quadratic(np.where(mask[:, :, None] & mask[:, None, :], left, 0.0), fit.pulls, np.where(mask, 1.0, 0.0))
