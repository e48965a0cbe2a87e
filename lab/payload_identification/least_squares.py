"""Weighted least squares of rows in channels (joints, or a sensor's axes), whose noise may be estimated along."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from lab.core.errors import LabError
from lab.core.se3 import Array

RANK_TOLERANCE = 1e-9  # of the largest singular value of the scaled columns
NOTHING = 1e-10  # of the largest column's norm: a column below is zero
ROUNDING = 1e-6  # of the signal: noise below is what computing leaves, and not fitted to
OWN_NOISE = 20  # rows from which on a channel's noise is estimated by itself
_ROUNDS, _SETTLED = 20, 1e-6


@dataclass(frozen=True)
class LinearSolution:
    """What least squares found.

    Attributes:
        names: of the parameters, p of them.
        values: ``(p,)``; zero where not told.
        told: ``(p,)`` whether the rows determine it.
        rank: of the columns.
        parts: ``(g, p, p)`` covariance, as the noise of each group of channels makes it.
        freedom: ``(g,)`` of each group's noise; infinite where sigma was given.
        sigma: ``(d,)`` noise of a row in each channel, in its unit.
        seen: ``(n, d)`` what was to be explained.
        residual: ``(n, d)`` seen less fitted, by sigma.
        basis: ``(n d, rank)`` orthonormal, of the whitened columns.
        back: ``(p, rank)`` from the basis to the parameters.
        rounding: whether some channel's noise is too small to be noise.
    """

    names: tuple[str, ...]
    values: Array
    told: NDArray[np.bool_]
    rank: int
    parts: Array
    dof: Array
    sigma: Array
    seen: Array
    residual: Array
    basis: Array
    back: Array
    rounding: bool

    @property
    def covariance(self) -> Array:
        """``(p, p)``."""
        return np.asarray(self.parts.sum(axis=0))

    @property
    def known(self) -> bool:
        """Whether sigma was given."""
        return bool(np.isinf(self.dof).all())

    def half_widths(self, slopes: Array) -> Array:
        """Half-widths ``(k,)`` of 95 % intervals of what moves by ``slopes`` ``(k, p)`` with the parameters.

        Student's t, with the degrees of freedom of a sum of variances (Satterthwaite 1946).
        """
        shares = np.einsum("kp,gpq,kq->kg", slopes, self.parts, slopes)
        variance = shares.sum(axis=1)
        spread = (shares**2 / self.dof).sum(axis=1)
        dof = np.full(len(variance), np.inf)
        np.divide(variance**2, spread, out=dof, where=spread > 0)
        half: Array = stats.t.ppf(0.975, dof) * np.sqrt(variance)
        return half


def least_squares(
    names: Sequence[str], columns: Array, seen: Array, groups: Sequence[int], sigma: Array | None = None
) -> LinearSolution:
    """Parameters from ``columns`` ``(n, d, p)`` and what was ``seen`` ``(n, d)``.

    Without sigma, channels of a group share one, found from the residuals in turn with the parameters: the sum of
    squares by the rows less what the fit takes of them (its leverages), which is unbiased where all is linear.

    Args:
        groups: ``(d,)`` labels from 0 on; where there are ``OWN_NOISE`` rows every channel is its own.
        sigma: ``(d,)`` of a row, if known.

    Raises:
        LabError: no more rows than parameters, and no sigma.
    """
    label = np.arange(seen.shape[1]) if len(seen) >= OWN_NOISE else np.asarray(groups)
    count = int(label.max()) + 1
    least = ROUNDING * max(float(np.sqrt((seen**2).mean())), 1e-300)
    if sigma is None:
        spread = np.array([np.sqrt((seen[:, label == g] ** 2).mean()) for g in range(count)])
        found = _solved(names, columns, seen, np.maximum(spread, least)[label])
        for _ in range(_ROUNDS):
            before, free = found.sigma, _freedom(found, label, count)
            if free.sum() < 0.5:
                raise LabError(
                    f"{seen.size} readings for {found.rank} unknowns leave none to tell the noise: give more samples "
                    "or poses, or the noise's sigma"
                )
            squares = np.array([(found.residual[:, label == g] ** 2).sum() for g in range(count)])
            scale = np.sqrt(np.where(free > 0.5, squares / np.maximum(free, 0.5), squares.sum() / free.sum()))
            found = _solved(names, columns, seen, np.maximum(before * scale[label], least))
            if np.abs(found.sigma / before - 1).max() < _SETTLED:
                break
        dof = np.maximum(_freedom(found, label, count), 1.0)
        rounding = bool((found.sigma <= 1.001 * least).any())
        return replace(found, parts=_parts(found, label, dof), dof=dof, rounding=rounding)
    found, dof = _solved(names, columns, seen, np.maximum(sigma, least)), np.full(count, np.inf)
    return replace(found, parts=_parts(found, label, dof), dof=dof)


def _freedom(found: LinearSolution, label: NDArray[np.int_], count: int) -> Array:
    """Rows of each group less its leverages."""
    left = 1 - (found.basis**2).sum(axis=1).reshape(found.residual.shape).sum(axis=0) / len(found.residual)
    return np.array([left[label == g].sum() for g in range(count)]) * len(found.residual)


def _parts(found: LinearSolution, label: NDArray[np.int_], dof: Array) -> Array:
    """The covariance ``(g, p, p)`` by groups, larger for weights that were estimated (Kenward & Roger 1997).

    In the coordinates of the basis the information of group j is H_j, and all of it 1: the covariance has its part
    H_j + 4 / nu_j (H_j - H_j^2).
    """
    rows = found.basis.reshape(*found.residual.shape, -1)
    parts = []
    for g, nu in enumerate(dof):
        own = np.einsum("ndr,nds->rs", rows[:, label == g], rows[:, label == g])
        parts.append(found.back @ (own + 4 / nu * (own - own @ own)) @ found.back.T)
    return np.array(parts)


def _solved(names: Sequence[str], columns: Array, seen: Array, sigma: Array) -> LinearSolution:
    """For a given sigma; parts and freedom are left open."""
    p = columns.shape[2]
    rows, target = (columns / sigma[:, None]).reshape(-1, p), (seen / sigma).ravel()
    scale = np.linalg.norm(rows, axis=0)
    there = scale > NOTHING * scale.max(initial=0.0)
    scale = np.where(there, scale, 1.0)
    q, triangle = np.linalg.qr(np.where(there, rows / scale, 0.0))
    u, sizes, vt = np.linalg.svd(triangle)
    rank = int((sizes > RANK_TOLERANCE * sizes.max(initial=0.0)).sum())
    basis, inverse = q @ u[:, :rank], vt[:rank].T / sizes[:rank] / scale[:, None]
    told = (vt[:rank] ** 2).sum(axis=0) > 1 - 1e-6
    values = np.where(told, inverse @ (basis.T @ target), 0.0)
    residual = (target - basis @ (basis.T @ target)).reshape(seen.shape)
    back, nothing = np.where(told[:, None], inverse, 0.0), np.empty(0)
    return LinearSolution(tuple(names), values, told, rank, nothing, nothing, sigma, seen, residual, basis, back, False)
