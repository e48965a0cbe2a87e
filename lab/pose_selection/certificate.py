"""How far a design is from the best possible one: the continuous D-optimal design bounds them all.

Kiefer & Wolfowitz (1960): over weights w on the candidates, log det M(w) is concave, so its tangent
bounds it everywhere; the bound holds for every exact design from these candidates.
"""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from lab.core.se3 import Array

__all__ = ["Certificate", "certify"]

MOST_ROUNDS, UPDATES = 400, 50  # looks at all candidates, and updates of those with weight in between
VANISHED = 1e-9  # a weight this small counts as none
_BLOCK = 500  # candidates whose whole matrices are held at a time


@dataclass(frozen=True)
class Certificate:
    """The best continuous design over a pool.

    Attributes:
        weights: ``(m,)``, summing to one.
        log_det: of the information per pose at these weights.
        bound: no design from the pool has a larger log det per pose.
        parameters: p.
    """

    weights: Array
    log_det: float
    bound: float
    parameters: int

    @property
    def gap(self) -> float:
        """How much D-efficiency the weights may be short of the best: 1 - exp(-(bound - log_det)/p)."""
        return float(-np.expm1(-(self.bound - self.log_det) / self.parameters))

    def efficiency(self, jacobian: Array) -> float:
        """Certified D-efficiency of a design ``(n, r, p)``: (det(M/n) / bound)^(1/p), at most 1."""
        flat = jacobian.reshape(-1, self.parameters)
        sign, log_det = np.linalg.slogdet(flat.T @ flat / len(jacobian))
        return float(np.exp((log_det - self.bound) / self.parameters)) if sign > 0 else 0.0


def certify(jacobian: Array, *, gap: float = 1e-3, measured: Array | None = None, share: float = 1.0) -> Certificate:
    """The continuous D-optimal design over candidates ``(m, r, p)``, by multiplicative updates.

    Candidates whose weight vanishes are set aside and looked at again; the bound itself is taken
    over all of them.

    Args:
        gap: stop at this gap of the D-efficiency.
        measured: information ``(p, p)`` per pose of poses measured already, with weight 1 - share.
        share: of all poses, those still to be chosen.
    """
    m, _, p = jacobian.shape
    held = np.zeros((p, p)) if measured is None else (1 - share) * measured
    each, weights, bound = _information(jacobian), np.full(m, 1 / m), np.inf
    for _ in range(MOST_ROUNDS):
        total = held + share * _weighted(each, weights, p)
        gains = _gains(each, total)
        log_det = float(np.linalg.slogdet(total)[1])
        bound = min(bound, _bound(log_det, gains, weights, p, share, measured is None))
        if -np.expm1(-(bound - log_det) / p) <= gap:
            break
        keep = (weights > VANISHED) | (gains > (1 - 0.2 * gap) * gains[weights > VANISHED].max())
        weights = np.where(keep, np.maximum(weights, VANISHED), 0.0) / np.maximum(weights, VANISHED)[keep].sum()
        weights[keep] = _multiplied(each if keep.all() else each[keep], weights[keep], held, share)
    return Certificate(weights, log_det, bound, p)


def _multiplied(each: Array, weights: Array, held: Array, share: float) -> Array:
    """Weights after a round of updates ``w <- w d / sum(w d)`` (Titterington 1976), which raise the log det."""
    for _ in range(UPDATES):
        gains = _gains(each, held + share * _weighted(each, weights, len(held)))
        weights = weights * gains / (weights @ gains)
    return weights


def _information(jacobian: Array) -> Array:
    """J'J of each candidate ``(m, r, p)``, its upper half row by row, ``(m, p (p + 1) / 2)``.

    Every update asks for weighted sums of these matrices and for their inner products with one other: with each kept
    as a row, both are a product of a matrix with a vector.
    """
    m, _, p = jacobian.shape
    rows, columns = _upper(p)
    each = np.empty((m, len(rows)))
    for first in range(0, m, _BLOCK):
        part = jacobian[first : first + _BLOCK]
        each[first : first + _BLOCK] = (part.swapaxes(1, 2) @ part)[:, rows, columns]
    return each


def _weighted(each: Array, weights: Array, p: int) -> Array:
    """The sum of w J'J over candidates, ``(p, p)``."""
    total = np.empty((p, p))
    rows, columns = _upper(p)
    total[rows, columns] = total[columns, rows] = weights @ each
    return total


@lru_cache(maxsize=8)
def _upper(p: int) -> tuple[NDArray[np.int_], NDArray[np.int_]]:
    """Rows and columns of the upper half of a ``(p, p)`` matrix: asked for at every update."""
    rows, columns = np.triu_indices(p)
    return rows, columns


def _gains(each: Array, information: Array) -> Array:
    """For each candidate d = tr(J M^-1 J'), the inner product of J'J and M^-1, ``(m,)``."""
    inverse = np.linalg.inv(information)
    both = inverse + inverse.T
    np.fill_diagonal(both, np.diag(inverse))
    gains: Array = each @ both[_upper(len(both))]
    return gains


def _bound(log_det: float, gains: Array, weights: Array, p: int, share: float, alone: bool) -> float:
    """The tangent's largest value; where nothing was measured before, the tighter one of the logarithm."""
    if alone:
        return log_det + p * float(np.log(gains.max() / p))
    return log_det + share * float(gains.max() - weights @ gains)
