"""Bound a criterion over all designs from the candidates, by the best continuous design.

A design's value is the logarithm of its criterion's score, per e-fold of information: for A, G and I of the inverse
predicted variance. Over weights on the candidates a value is concave. Its tangent therefore bounds the value of every
design. For G, the smallest of several values, a linear programme finds the weights on these with the least bound
(Dette 1997; Wong 1992).
"""

from dataclasses import dataclass

import numpy as np
import scipy  # its parts are loaded at their first use
from numpy.typing import NDArray

from lab.core.se3 import Array
from lab.pose_selection.criteria import Criterion, worst_tests
from lab.pose_selection.exchange import information

__all__ = ["CriterionCertificate", "certify_criterion"]

_ROUNDS = 12  # of the continuous design and its bound
_SUPPORT = 120  # candidates with weight, at most, in one continuous design
_MORE = 20  # candidates with the largest gains, which join them
_TESTS = 4  # positions of the largest variance, of which G counts the worst
_VANISHED, _LEAST_START = 1e-7, 1e-4  # weights that count as none; of equal ones, where a search begins


@dataclass(frozen=True)
class CriterionCertificate:
    """The best continuous design by a criterion, over a pool.

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
) -> CriterionCertificate | None:
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
        support = np.flatnonzero(weights > _VANISHED)
        if len(support) > _SUPPORT and best is not None:
            support = np.sort(np.argsort(-weights, kind="stable")[:_SUPPORT])
        search.see(weights)
        value, bound, gains = search.bound(weights)
        if best is None or value > best.value:
            best = CriterionCertificate(weights, value, bound if best is None else min(bound, best.bound))
        elif bound < best.bound:
            best = CriterionCertificate(best.weights, best.value, bound)
        if best.gap <= gap:
            break
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
