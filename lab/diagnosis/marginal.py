"""Marginal model of residuals: all that a sound campaign may hold, as variances.

Whitened residuals r of a fit are r = Z u + e. The columns Z are of everything that may be off (links within tolerances,
effects of the catalogue, a smooth error of the joints): random effects u, of one variance for each kind. The errors e
are of the instrument and of joints that scatter anew at each pose. Rotated pose by pose into the axes in which the
scatter shows, the variance of e is diagonal, s + t lambda. Variances come from fixed-point steps of restricted maximum
likelihood (MacKay 1992; Harville 1977). A pose that is far off has a large variance of its own, at a price.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import scipy  # its parts are loaded at their first use, which not every process comes to
from numpy.typing import NDArray

from lab.core.se3 import Array

__all__ = ["MarginalFit", "Problem", "Variances", "compressed", "estimated", "rotated"]

_ROUNDS, _STEPS = 12, 4  # of the noise, and in each of the variances of the columns
_CONVERGED = 0.3  # of the deviance from round to round
_START_SCATTER = 0.1  # of the noise: the mean variance that scatter makes of a number
_MOST_TOLERANCES = 1.0  # variance of the columns of the first kind, the links', in squared tolerances
_LEAST, _MOST = 1e-8, 1e8
_OUTLYING = 900.0  # times the variance at least, of a pose that is far off
_PRICE = 9.0  # -2 log of the share of such poses
_MOST_OUTLYING = 0.2  # of the poses
_FLAT = 1e8  # variance of columns without a prior
_SCATTERED = 8  # numbers of a pose in which joint scatter shows
_JITTER = 1e-11  # of a column's own square: columns that others hold


@dataclass(frozen=True)
class Problem:
    """Residuals with the columns of what may be off, rotated pose by pose.

    Attributes:
        residual: ``(n, m)`` whitened; zero where not observed.
        columns: ``(n, m, c)``.
        kinds: ``(c,)`` numbers of the columns' kinds, each with a variance; -1 for columns without a prior.
        scatter: ``(n, m)`` eigenvalues of the joint scatter, in units of its variance.
        mask: ``(n, m)`` which numbers were observed.
        sigma_given: whether the noise was stated: it may be larger, but not smaller.
    """

    residual: Array
    columns: Array
    kinds: NDArray[np.int_]
    scatter: Array
    mask: NDArray[np.bool_]
    sigma_given: bool

    def with_columns(self, columns: Array) -> "Problem":
        """Return the problem with more columns ``(n, m, c)``, without a prior."""
        kinds = np.concatenate([self.kinds, np.full(columns.shape[2], -1)])
        return replace(self, columns=np.concatenate([self.columns, columns], axis=2), kinds=kinds)


def rotated(
    residual: Array, columns: Sequence[Array], slopes: Array, mask: NDArray[np.bool_]
) -> tuple[Array, list[Array], Array, NDArray[np.bool_]]:
    """Rotate the numbers of each pose into the axes in which joint scatter shows.

    Args:
        residual: ``(n, m)`` whitened.
        columns: each ``(n, m, c)`` whitened.
        slopes: ``(n, m, joints)`` whitened derivatives by the joints.
        mask: ``(n, m)`` which numbers were observed.

    Returns:
        The same rotated, the eigenvalues ``(n, m)``, and which of the rotated numbers were observed.
    """
    seen = mask[..., None]
    made = np.where(seen, slopes, 0.0)
    squares = made @ np.swapaxes(made, 1, 2)
    count = np.arange(mask.shape[1])
    squares[:, count, count] -= np.where(mask, 0.0, 1.0)  # numbers that are missing stay among themselves
    sizes, axes = np.linalg.eigh(squares)
    back = np.swapaxes(axes, 1, 2)
    turned = (back @ np.where(mask, residual, 0.0)[..., None])[..., 0]
    known = sizes > -0.5
    return turned, [back @ np.where(seen, each, 0.0) for each in columns], np.maximum(sizes, 0.0), known


def compressed(
    residual: Array, columns: Sequence[Array], scatter: Array, mask: NDArray[np.bool_], numbers: int
) -> tuple[Array, list[Array], Array, NDArray[np.bool_]]:
    """Keep the few directions of each pose's many numbers in which its columns are largest.

    Args:
        residual, columns, scatter, mask: as ``rotated`` returns them; the scatter's directions come last there.
        numbers: of each pose, to keep.
    """
    whole = np.concatenate(columns, axis=2)
    norm = np.sqrt(np.einsum("nmc,nmc->c", whole, whole))
    scaled = whole / np.where(norm > 0, norm, 1.0)
    # the axes of the scatter stay, as its variance is diagonal there; the others are turned among themselves
    kept = np.arange(residual.shape[1]) >= residual.shape[1] - _SCATTERED
    rest = np.where(mask & ~kept, 1.0, 0.0)[..., None] * scaled
    axes = np.linalg.svd(rest, full_matrices=False)[0][..., : numbers - _SCATTERED]
    known = np.linalg.norm(rest.swapaxes(1, 2) @ axes, axis=1) > 1e-12
    back = np.swapaxes(axes, 1, 2)
    turned = [np.concatenate([back @ each, each[:, kept]], axis=1) for each in (residual[..., None], *columns)]
    sizes = np.concatenate([np.zeros(known.shape), scatter[:, kept]], axis=1)
    return turned[0][..., 0], turned[1:], sizes, np.concatenate([known, mask[:, kept]], axis=1)


@dataclass(frozen=True)
class Variances:
    """Variances of a marginal model.

    Attributes:
        noise: of a whitened number.
        scatter: of the joints, in the units of the slopes.
        kinds: ``(kinds,)`` of the columns of each kind.
        factors: ``(n,)`` by which the variance of each pose is larger: 1 of all but those that are far off.
    """

    noise: float
    scatter: float
    kinds: Array
    factors: Array

    @property
    def outlying(self) -> NDArray[np.bool_]:
        """Which poses ``(n,)`` are far off."""
        return np.asarray(self.factors > 1)


@dataclass(frozen=True)
class MarginalFit:
    """A marginal model with its variances: inverse covariances of residuals, and their likelihood."""

    problem: Problem
    variances: Variances

    @cached_property
    def diagonal(self) -> Array:
        """Variance ``(n, m)`` of each rotated number's own error."""
        own = self.variances.noise + self.variances.scatter * self.problem.scatter
        return np.asarray(self.variances.factors[:, None] * own)

    @cached_property
    def _weights(self) -> Array:
        return np.where(self.problem.mask, 1 / self.diagonal, 0.0)

    @cached_property
    def _gram(self) -> tuple[Array, Array]:
        """Return Z' W Z ``(c, c)`` and Z' W r ``(c,)``."""
        weighted = (self.problem.columns * np.sqrt(self._weights)[..., None]).reshape(-1, len(self.problem.kinds))
        right = (self.problem.residual * np.sqrt(self._weights)).ravel()
        return weighted.T @ weighted, weighted.T @ right

    @cached_property
    def _precision(self) -> Array:
        """Precision ``(c,)`` of the columns' coefficients beforehand."""
        variance = np.append(self.variances.kinds, _FLAT)[self.problem.kinds]
        return np.asarray(1 / variance)

    @cached_property
    def _root(self) -> Array:
        """Root R ``(c, c)`` of the covariance R R' of the coefficients, upper triangular."""
        return _inverse_root(self._gram[0] + np.diag(self._precision))

    @cached_property
    def covariance(self) -> Array:
        """Covariance ``(c, c)`` of the coefficients afterwards."""
        return np.asarray(self._root @ self._root.T)

    @cached_property
    def coefficients(self) -> Array:
        """Coefficients ``(c,)`` that are likeliest."""
        return np.asarray(self.covariance @ self._gram[1])

    @cached_property
    def left(self) -> Array:
        """Residuals ``(n, m)`` beside the coefficients."""
        return np.asarray(self.problem.residual - self.problem.columns @ self.coefficients)

    @cached_property
    def pulls(self) -> Array:
        """V^-1 r ``(n, m)``."""
        return self._weights * self.left

    @cached_property
    def basis(self) -> Array:
        """Columns B ``(n, m, c)`` with V^-1 = W - B B'."""
        return np.asarray(self._weights[..., None] * (self.problem.columns @ self._root))

    @property
    def weights(self) -> Array:
        """W ``(n, m)``."""
        return self._weights

    @cached_property
    def deviance(self) -> float:
        """Minus twice the log-likelihood, restricted for columns without a prior, with the price of far poses."""
        random = self.problem.kinds >= 0
        own = float(np.log(self.diagonal[self.problem.mask]).sum())
        columns = -float(np.log(self._precision[random]).sum()) - 2 * float(np.log(np.diag(self._root)).sum())
        pull = float((self.problem.residual * self.pulls).sum())
        return own + columns + pull + _PRICE * int(self.variances.outlying.sum())

    def deviance_beside(self, added: int) -> float:
        """Minus twice the log-likelihood, in which the last columns are fitted: not restricted by them."""
        if not added:
            return self.deviance
        return self.deviance + float(np.linalg.slogdet(self.covariance[-added:, -added:])[1])

    def predicted_errors(self, rows: NDArray[np.int_]) -> Array:
        """Return the errors ``(rows, m)`` of poses as the others predict them."""
        mask = self.problem.mask[rows]
        basis, own = self.basis[rows][mask], self.weights[rows][mask]
        found = np.zeros(mask.shape)
        found[mask] = np.linalg.solve(np.diag(own) - basis @ basis.T, self.pulls[rows][mask])
        return found

    def effective(self) -> Array:
        """Return the share ``(c,)`` of each coefficient that the residuals determine."""
        return np.asarray(1 - np.diag(self.covariance) * self._precision)


def estimated(problem: Problem, start: Variances | None = None) -> MarginalFit:
    """Estimate the variances of a problem.

    Args:
        start: of a problem with fewer columns, near which they are.
    """
    fit = MarginalFit(problem, start or _start(problem))
    deviance = np.inf
    for _ in range(_ROUNDS):
        for _ in range(_STEPS):
            fit = _with_kinds(fit, _next_kinds(fit))
        noise, scatter = _next_noise(fit)
        fit = MarginalFit(problem, replace(fit.variances, noise=noise, scatter=scatter))
        fit = MarginalFit(problem, replace(fit.variances, factors=_factors(fit)))
        if abs(deviance - fit.deviance) < _CONVERGED:
            break
        deviance = fit.deviance
    return fit


def _start(problem: Problem) -> Variances:
    """Return variances from which those of a problem are searched: all columns as large as the noise."""
    count = int(problem.kinds.max(initial=-1)) + 1
    scatter = _START_SCATTER / max(float(problem.scatter.mean()), 1e-300)
    return Variances(1.0, scatter, np.ones(count), np.ones(len(problem.residual)))


def _with_kinds(fit: MarginalFit, kinds: Array) -> MarginalFit:
    """Return the fit with other variances of its columns; what does not depend on them stays."""
    other = MarginalFit(fit.problem, replace(fit.variances, kinds=kinds))
    other.__dict__["diagonal"] = fit.diagonal
    other.__dict__["_weights"] = fit.weights
    other.__dict__["_gram"] = fit._gram
    return other


def _inverse_root(matrix: Array) -> Array:
    """Return the upper triangular root R of the inverse R R' of a matrix that is positive definite, or nearly."""
    scale = 1 / np.sqrt(np.diag(matrix))
    scaled = matrix * scale[:, None] * scale + _JITTER * np.eye(len(matrix))
    upper = scipy.linalg.lapack.dpotrf(scaled, clean=1)[0]
    return np.asarray(scale[:, None] * scipy.linalg.lapack.dtrtri(upper)[0])


def _next_kinds(fit: MarginalFit) -> Array:
    """Return the next variances of the columns' kinds: squares of coefficients over how many are determined."""
    kinds = fit.problem.kinds
    squares, determined = fit.coefficients**2, fit.effective()
    found = fit.variances.kinds.copy()
    for kind in range(len(found)):
        of = kinds == kind
        found[kind] = squares[of].sum() / max(float(determined[of].sum()), 1e-9)
    most = np.full(len(found), _MOST)
    most[:1] = _MOST_TOLERANCES
    return np.clip(found, _LEAST, most)


def _next_noise(fit: MarginalFit) -> tuple[float, float]:
    """Return the next variances of noise and joint scatter, by a step of Fisher's scoring on what is left."""
    mask, shape = fit.problem.mask & ~fit.variances.outlying[:, None], fit.problem.scatter
    taken = np.einsum("nmc,nmc->nm", fit.basis, fit.basis)  # of W, by the coefficients
    share = np.clip(1 - taken / np.where(fit.weights > 0, fit.weights, 1.0), 0.05, 1.0)
    squares, own, shape = (fit.left**2 / share)[mask], fit.diagonal[mask], shape[mask]
    noise, scatter = fit.variances.noise, fit.variances.scatter
    for _ in range(3):
        own = np.maximum(noise + scatter * shape, 1e-12)
        weight = share[mask] / own**2
        rows = np.stack([np.ones_like(shape), shape])
        normal = (rows * weight) @ rows.T + 1e-12 * np.eye(2)
        noise, scatter = np.linalg.solve(normal, (rows * weight) @ squares)
        if scatter < 0:
            noise, scatter = float((weight * squares).sum() / weight.sum()), 0.0
        noise = max(float(noise), 1.0 if fit.problem.sigma_given else 1e-6)
    return noise, max(float(scatter), 0.0)


def _factors(fit: MarginalFit) -> Array:
    """Return the likeliest factor of each pose's variance: 1, or what its errors show where they are far off."""
    own = fit.diagonal / fit.variances.factors[:, None]
    square = np.where(fit.problem.mask, fit.left**2 / own, 0.0).sum(axis=1)
    numbers = np.maximum(fit.problem.mask.sum(axis=1), 1)
    factors = np.maximum(square / numbers, _OUTLYING)
    excess = square * (1 - 1 / factors) - numbers * np.log(factors) - _PRICE
    far = excess > 0
    most = int(_MOST_OUTLYING * len(far))
    if far.sum() > most:
        far &= excess >= np.sort(excess)[-most] if most else False
    return np.where(far, factors, 1.0)
