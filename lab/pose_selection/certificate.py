"""Bound a criterion over all designs from the candidates, by the best continuous design.

A design's value is the logarithm of its criterion's score, per e-fold of information: for O1 log det M / p, for A, G
and I of the inverse predicted variance. Over weights on the candidates a value is concave. Its tangent therefore bounds
the value of every design (Kiefer & Wolfowitz 1960). For G, the smallest of several values, a linear programme finds the
weights on these with the least bound (Dette 1997; Wong 1992).
"""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import scipy  # its parts are loaded at their first use
from numpy.typing import NDArray

from lab.core.se3 import Array
from lab.pose_selection.criteria import Criterion, worst_tests
from lab.pose_selection.exchange import information

__all__ = ["DesignCertificate", "certify", "certify_criterion", "d_value"]

_ROUNDS = 12  # of the continuous design and its bound
_SUPPORT = 120  # candidates with weight, at most, in one continuous design
_MORE = 20  # candidates with the largest gains, which join them
_TESTS = 4  # positions of the largest variance, of which G counts the worst
_VANISHED, _LEAST_START = 1e-7, 1e-4  # weights that count as none; of equal ones, where a search begins


@dataclass(frozen=True)
class DesignCertificate:
    """The best continuous design by a criterion, over a pool of candidates.

    Attributes:
        weights: ``(m,)`` of the candidates, summing to one.
        value: the criterion's at these weights, per pose.
        bound: no design from the pool has a larger value per pose.
    """

    weights: Array
    value: float
    bound: float

    @property
    def gap(self) -> float:
        """Bound of the loss of efficiency at these weights: 1 - exp(value - bound)."""
        return float(-np.expm1(self.value - self.bound))

    def efficiency(self, value: float, poses: int) -> float:
        """Return the certified efficiency of so many poses in all with this value, at most 1."""
        return float(np.exp(value - np.log(poses) - self.bound))


def certify_criterion(
    goal: Criterion,
    pool: Array,
    before: Array,
    *,
    start: Array | None = None,
    gap: float = 2e-3,
    share: float = 1.0,
) -> DesignCertificate | None:
    """Compute the best continuous design by a criterion, with a bound of all designs.

    Sequential quadratic programming finds the weights of some candidates; a linear programme over all candidates finds
    the least bound, and candidates to add.

    Args:
        pool: ``(m, r, p)`` sensitivities of the candidates.
        before: ``(n0, r, p)`` sensitivities at the poses measured before.
        start: ``(m,)`` weights to start from; equal ones if not given.
        gap: stop at this loss of efficiency.
        share: of all poses that are still to be chosen; the others are those measured before.

    Returns:
        None if the criterion has no ``growth``, so that nothing bounds it.
    """
    if goal.growth is None:
        return None
    search = _ContinuousDesign(goal, goal.growth, pool, before, share)
    weights = np.full(len(pool), 1 / len(pool)) if start is None else start / start.sum()
    best = None
    for _ in range(_ROUNDS):
        # The value and the least bound at these weights; the best of both so far.
        search.see(weights)
        value, bound, gains = search.bound(weights)
        if best is None or value > best.value:
            best = DesignCertificate(weights, value, bound if best is None else min(bound, best.bound))
        elif bound < best.bound:
            best = DesignCertificate(best.weights, best.value, bound)
        if best.gap <= gap:
            break
        # Better weights of the candidates that have any, and of those with the largest gains.
        some = np.sort(np.argsort(-weights, kind="stable")[:_SUPPORT])
        support = np.union1d(some[weights[some] > _VANISHED], np.argsort(-gains, kind="stable")[:_MORE])
        weights = search.improved(weights, support)
    assert best is not None
    return best


class _ContinuousDesign:
    """Continuous designs by a criterion."""

    def __init__(self, goal: Criterion, growth: float, pool: Array, before: Array, share: float) -> None:
        self.goal, self.growth, self.pool, self.share = goal, growth, pool, share
        self.alone = not len(before)
        self.before = 0.0 if self.alone else (1 - share) * information(before) / len(before)
        self.parts: list[Criterion] = []  # concave: the criterion itself; for G, the variance at one position each
        self._tests = set[int]()

    def total(self, weights: Array, rows: NDArray[np.int_]) -> Array:
        """Return the information ``(p, p)`` per pose at weights ``(k,)`` of candidates ``(k,)``."""
        root = np.sqrt(np.maximum(self.share * weights, 0.0))[:, None, None]
        return np.asarray(self.before + information(root * self.pool[rows]))

    def see(self, weights: Array) -> None:
        """Add the parts that matter at weights ``(m,)``: for G those of the largest variances."""
        if self.goal.name != "G":
            self.parts = [self.goal]
            return
        rows = np.flatnonzero(weights > 0)
        for at, goal in worst_tests(self.goal, self.total(weights[rows], rows), _TESTS):
            if at not in self._tests:
                self._tests.add(at)
                self.parts.append(goal)

    def values(self, total: Array) -> Array:
        """Return the value of each part."""
        return np.array([part.score(total) / self.growth for part in self.parts])

    def gains(self, total: Array, rows: NDArray[np.int_] | slice) -> Array:
        """Return the derivatives ``(parts, k)`` of each part's value by candidates' weights."""
        return np.array([_gains(self.pool[rows], part.slope(total) * self.share / self.growth) for part in self.parts])

    def bound(self, weights: Array) -> tuple[float, float, Array]:
        """Return the criterion's value, the least bound, and the gains ``(m,)`` of the candidates then."""
        rows = np.flatnonzero(weights > 0)
        total = self.total(weights[rows], rows)
        value = float(np.asarray(self.goal.score(total)) / self.growth)
        values, gains = self.values(total), self.gains(total, slice(None))
        offset, n = values - gains @ weights, len(self.parts)
        solved = scipy.optimize.linprog(
            np.append(offset, 1.0),
            A_ub=np.column_stack([gains.T, np.full(len(self.pool), -1.0)]),
            b_ub=np.zeros(len(self.pool)),
            A_eq=np.append(np.ones(n), 0.0)[None],
            b_eq=[1.0],
            bounds=[*[(0.0, None)] * n, (None, None)],
            method="highs",
        )
        by_part = np.zeros(n) if solved.x is None else np.maximum(solved.x[:n], 0.0)
        by_part = by_part / by_part.sum() if by_part.sum() > 0 else np.full(n, 1 / n)
        mixed = by_part @ gains
        # Without earlier poses, exp(value) is homogeneous: its tangent is the tighter bound.
        rest = np.log(mixed.max()) if self.alone else mixed.max() - mixed @ weights
        return value, float(by_part @ values + rest), mixed

    def improved(self, weights: Array, support: NDArray[np.int_]) -> Array:
        """Return weights ``(m,)`` on some candidates ``(k,)`` with a larger value."""
        k = len(support)
        start = np.maximum(weights[support], _LEAST_START / k)
        start = start / start.sum()
        seen: dict[bytes, Array] = {}

        def total(x: Array) -> Array:
            key = x[:k].tobytes()
            if key not in seen:
                seen.clear()
                seen[key] = self.total(np.maximum(x[:k], 0.0), support)
            return seen[key]

        try:
            solved = scipy.optimize.minimize(
                lambda x: -x[k],
                np.append(start, self.values(self.total(start, support)).min()),
                jac=lambda x: np.append(np.zeros(k), -1.0),
                bounds=[*[(0.0, 1.0)] * k, (None, None)],
                constraints=[
                    {
                        "type": "ineq",
                        "fun": lambda x: self.values(total(x)) - x[k],
                        "jac": lambda x: np.column_stack([self.gains(total(x), support), -np.ones(len(self.parts))]),
                    },
                    {
                        "type": "eq",
                        "fun": lambda x: x[:k].sum() - 1.0,
                        "jac": lambda x: np.append(np.ones(k), 0.0)[None],
                    },
                ],
                method="SLSQP",
                options={"maxiter": 60, "ftol": 1e-5},
            )
            shares = np.maximum(solved.x[:k], 0.0)
        except (np.linalg.LinAlgError, ValueError):  # a step to a design without information
            shares = start
        out = np.zeros(len(self.pool))
        out[support] = shares / shares.sum() if np.isfinite(shares).all() and shares.sum() > 0 else start
        return out


def _gains(pool: Array, slope: Array) -> Array:
    """Return the derivatives ``(m,)`` by the weights of candidates ``(m, r, p)``, from that by the information."""
    m, rows, p = pool.shape
    flat = pool.reshape(m * rows, p)
    return np.asarray(np.einsum("ij,ij->i", flat @ slope, flat).reshape(m, rows).sum(axis=1))


_MAX_ROUNDS, _UPDATES = 400, 50  # checks of all candidates, and updates of those with weight in between
_NO_WEIGHT = 1e-9  # a smaller weight counts as zero
_BLOCK = 500  # candidates whose whole matrices are in memory at a time


def d_value(jacobian: Array) -> float:
    """Return the value log det(M) / p of a design ``(n, r, p)`` by O1; minus infinity where M is singular."""
    sign, log_det = np.linalg.slogdet(information(jacobian))
    return float(log_det) / jacobian.shape[-1] if sign > 0 else -np.inf


def certify(
    jacobian: Array, *, gap: float = 1e-3, measured: Array | None = None, share: float = 1.0
) -> DesignCertificate:
    """Compute the continuous D-optimal design over candidates ``(m, r, p)``, by multiplicative updates.

    Candidates whose weight vanishes are set aside and checked again; the bound is over all of them.

    Args:
        gap: stop at this gap of the D-efficiency.
        measured: information ``(p, p)`` per pose of poses measured before, with weight 1 - share.
        share: share of all poses that are still to be chosen.
    """
    m, _, p = jacobian.shape
    earlier = np.zeros((p, p)) if measured is None else (1 - share) * measured
    each, weights, bound = _rows_of(jacobian), np.full(m, 1 / m), np.inf
    for _ in range(_MAX_ROUNDS):
        total = earlier + share * _weighted(each, weights, p)
        gains = _gains_of(each, total)
        value = float(np.linalg.slogdet(total)[1]) / p
        bound = min(bound, _bound(value, gains / p, weights, share, measured is None))
        if -np.expm1(value - bound) <= gap:
            break
        keep = (weights > _NO_WEIGHT) | (gains > (1 - 0.2 * gap) * gains[weights > _NO_WEIGHT].max())
        weights = np.where(keep, np.maximum(weights, _NO_WEIGHT), 0.0) / np.maximum(weights, _NO_WEIGHT)[keep].sum()
        weights[keep] = _multiplied(each if keep.all() else each[keep], weights[keep], earlier, share)
    return DesignCertificate(weights, value, bound)


def _multiplied(each: Array, weights: Array, earlier: Array, share: float) -> Array:
    """Update weights by ``w <- w d / sum(w d)`` (Titterington 1976), which raises the log det."""
    for _ in range(_UPDATES):
        gains = _gains_of(each, earlier + share * _weighted(each, weights, len(earlier)))
        weights = weights * gains / (weights @ gains)
    return weights


def _rows_of(jacobian: Array) -> Array:
    """Return J'J of each candidate ``(m, r, p)``, its upper half row by row, ``(m, p (p + 1) / 2)``.

    Every update needs weighted sums of these matrices and their inner products with one other: with each stored as a
    row, both are a product of a matrix with a vector.
    """
    m, _, p = jacobian.shape
    rows, columns = _upper(p)
    each = np.empty((m, len(rows)))
    for first in range(0, m, _BLOCK):
        part = jacobian[first : first + _BLOCK]
        each[first : first + _BLOCK] = (part.swapaxes(1, 2) @ part)[:, rows, columns]
    return each


def _weighted(each: Array, weights: Array, p: int) -> Array:
    """Return the sum of w J'J over candidates, ``(p, p)``."""
    total = np.empty((p, p))
    rows, columns = _upper(p)
    total[rows, columns] = total[columns, rows] = weights @ each
    return total


@lru_cache(maxsize=8)
def _upper(p: int) -> tuple[NDArray[np.int_], NDArray[np.int_]]:
    rows, columns = np.triu_indices(p)
    return rows, columns


def _gains_of(each: Array, information: Array) -> Array:
    """Return d = tr(J M^-1 J') of each candidate, the inner product of J'J and M^-1, ``(m,)``."""
    inverse = np.linalg.inv(information)
    both = inverse + inverse.T
    np.fill_diagonal(both, np.diag(inverse))
    gains: Array = each @ both[_upper(len(both))]
    return gains


def _bound(value: float, gains: Array, weights: Array, share: float, alone: bool) -> float:
    """Return the tangent's largest value; without earlier poses, the tighter one of the logarithm."""
    if alone:
        return value + float(np.log(gains.max()))
    return value + share * float(gains.max() - weights @ gains)
