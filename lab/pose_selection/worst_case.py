"""Choose poses that are good for the worst of several arms and models.

A case is an arm with a model of its errors. A design's value in a case is the logarithm of its criterion's score, per
e-fold of information: for O1 of the D-efficiency in that case, for A, G and I of the inverse predicted variance. The
design maximizes the smallest value of all cases (Dette 1997; Wong 1992).

Over weights on the candidates each value is concave, and so is any mean of them over the cases, which is never below
the smallest. Its tangent therefore bounds the smallest value of every design, for any weights on the cases: a linear
programme finds those with the least bound.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy  # its parts are loaded at their first use
from numpy.typing import NDArray

from lab.core.se3 import Array
from lab.pose_selection.criteria import Criterion, worst_tests
from lab.pose_selection.exchange import (
    Design,
    Exchange,
    Feasible,
    Sensitivity,
    added,
    certify,
    information,
    inverse_of,
    scores_with,
    with_steps,
)

__all__ = ["Case", "WorstCase", "WorstCertificate", "certify_worst", "exchange_worst"]

_SHARPNESS = (30.0, 300.0)  # of the smooth minimum, in the first exchange and in the second
_SHORTLIST = 32  # candidates of the steepest ascent, whose scores are computed
_MINOR = 1e-3  # a case with less weight in the smooth minimum gives no slope
_RIDGE = 1e-6  # of the trace, for the slope of a design one pose short, which may be singular
_REFERENCE_GAP = 5e-3  # of the D-efficiency that is attainable in a case


@dataclass(frozen=True)
class Case:
    """An arm with a model of its errors.

    Attributes:
        arm: number of the perturbed arm; 0 for the nominal one.
        model: its groups of effects, as in ``--model``.
        pool: ``(m, r, p)`` scaled sensitivities of the candidates.
        sensitivity: from inputs ``(n, joints + conditions)`` to such sensitivities.
        goal: the criterion.
        before: ``(n0, r, p)`` sensitivities at the poses measured before.
        whitened: sensitivities in standard deviations of the noise, to unscaled parameters.
        test: ``(t, 3, p)`` m, Jacobians of the targets at the poses where the error is predicted.
    """

    arm: int
    model: str
    pool: Array
    sensitivity: Sensitivity
    goal: Criterion
    before: Array
    whitened: Sensitivity
    test: Array

    @cached_property
    def reference(self) -> float:
        """Score per pose to which others are compared: the largest possible for O1, zero for other criteria."""
        return certify(self.pool, gap=_REFERENCE_GAP).bound if self.goal.name == "O1" else 0.0

    def value(self, scores: Array | float) -> Array:
        """Return the values of scores of the criterion, in all cases alike."""
        return np.asarray((np.asarray(scores) - self.reference) / (self.goal.growth or 1.0))


class WorstCase:
    """Objective of a design: the smallest value of all cases.

    Information matrices are stacked, ``(s, p, p)``, smaller ones in the upper left corner.
    """

    def __init__(self, cases: Sequence[Case], sharpness: float = _SHARPNESS[-1]) -> None:
        self.cases, self.sharpness = tuple(cases), sharpness
        self._size = max(case.pool.shape[2] for case in self.cases)
        self.earlier = np.stack([self._wide(information(case.before)) for case in self.cases])

    def _wide(self, array: Array) -> Array:
        """Return an array with as many last columns, and rows of a square one, as the largest case has parameters."""
        p = array.shape[-1]
        square = array.ndim == 2 and array.shape[0] == p
        return np.pad(array, [(0, self._size - p if square else 0)] * (array.ndim - 1) + [(0, self._size - p)])

    def of(self, jacobians: Sequence[Array]) -> Array:
        """Return the information ``(s, p, p)`` of Jacobians ``(n, r, p)`` of each case."""
        return np.stack([self._wide(information(each)) for each in jacobians])

    def values(self, total: Array) -> Array:
        """Return the value ``(s,)`` of an information in each case."""
        return np.array(
            [case.value(case.goal.score(own)) for case, own in zip(self.cases, self.parts(total), strict=True)]
        )

    def parts(self, total: Array) -> list[Array]:
        """Return the information ``(p, p)`` of each case."""
        return [own[: case.pool.shape[2], : case.pool.shape[2]] for case, own in zip(self.cases, total, strict=True)]

    def smooth(self, values: Array) -> tuple[Array, Array]:
        """Return the smooth minimum ``(...)`` of values ``(s, ...)``, and its derivatives ``(s, ...)`` by them."""
        least = values.min(axis=0)
        shares = np.exp(-self.sharpness * (values - least))
        total = shares.sum(axis=0)
        return least - np.log(total) / self.sharpness, shares / total

    def slopes(self, total: Array, weights: Array) -> list[tuple[int, Array]]:
        """Return the cases that matter with the derivative ``(p, p)`` of the weighted value by their information."""
        parts = self.parts(total)
        return [
            (i, weights[i] / (self.cases[i].goal.growth or 1.0) * self.cases[i].goal.slope(parts[i]))
            for i in np.flatnonzero(weights > _MINOR).tolist()
        ]

    def seen(self, inputs: Array) -> Array:
        """Return the Jacobians ``(n, s, r, p)`` of all cases."""
        each = [case.sensitivity(inputs) for case in self.cases]
        wide = np.zeros((len(inputs), len(each), each[0].shape[1], self._size))
        for i, jacobian in enumerate(each):
            wide[:, i, :, : jacobian.shape[2]] = jacobian
        return wide

    def score(self, jacobian: Array) -> float:
        """Return the smallest value of Jacobians ``(n, s, r, p)``."""
        return float(self.values(self._total(jacobian)).min())

    def _total(self, jacobian: Array) -> Array:
        flat = jacobian.swapaxes(0, 1).reshape(len(self.cases), -1, self._size)
        total: Array = self.earlier + flat.swapaxes(1, 2) @ flat
        return total

    def uphill(self, inputs: Array) -> tuple[float, Array]:
        """Return the smooth minimum at inputs ``(n, joints)``, and its derivatives ``(n, joints)``."""
        total = self._total(self.seen(inputs))
        score, weights = self.smooth(self.values(total))
        slope = np.zeros_like(inputs)
        try:
            for i, by_information in self.slopes(total, weights):
                here, rate = with_steps(self.cases[i].sensitivity, inputs)
                slope += 2 * np.einsum("nrp,njrp->nj", here @ by_information, rate)
        except np.linalg.LinAlgError:  # a step to impossible poses without information
            slope = np.zeros_like(inputs)
        return float(score), slope


class _WorstExchange(Exchange):
    """State of an exchange for the worst case.

    For each pose the slope of the smooth minimum picks a short list of candidates, and the values of all cases with
    each of these decide.
    """

    def __init__(self, aim: WorstCase, rng: np.random.Generator, allowed: Callable[[int], bool]) -> None:
        first = aim.cases[0]
        super().__init__(first.pool, first.goal, aim.earlier, rng, allowed)
        self.aim, self.by_trace = aim, False

    def _information(self, rows: NDArray[np.int_]) -> Array:
        return self.aim.of([case.pool[rows] for case in self.aim.cases])

    def _score(self, total: Array) -> float:
        return float(self.aim.values(total).min())

    def _scores(self, without: Array, left: object, present: int) -> tuple[NDArray[np.int_], Array]:
        now = without + self._information(np.array([present]))
        ridge = _RIDGE * np.trace(now, axis1=1, axis2=2)[:, None, None] * np.eye(now.shape[1])
        weights = self.aim.smooth(self.aim.values(now))[1]
        rows = np.flatnonzero(self.free)
        rise = np.zeros(len(rows))
        for i, slope in self.aim.slopes(without + ridge, weights):
            pool = self.aim.cases[i].pool
            rise += _gains(pool, slope)[rows]
        best = np.argpartition(-rise, min(_SHORTLIST, len(rise) - 1))[:_SHORTLIST] if len(rise) else np.empty(0, int)
        tried = np.append(rows[best], present)
        values = [
            case.value(_scores_with(case.goal, own, case.pool[tried]))
            for case, own in zip(self.aim.cases, self.aim.parts(without), strict=True)
        ]
        return tried, self.aim.smooth(np.stack(values))[0]


def _scores_with(goal: Criterion, without: Array, part: Array) -> Array:
    """Return ``exchange.scores_with``, by an update for O1 too."""
    if goal.name != "O1":
        return scores_with(goal, without, part)
    inverse = inverse_of(without)
    return added(part, inverse) - float(np.linalg.slogdet(inverse)[1])


def _gains(pool: Array, slope: Array) -> Array:
    """Return the derivatives ``(m,)`` by the weights of candidates ``(m, r, p)``, from that by the information."""
    m, rows, p = pool.shape
    flat = pool.reshape(m * rows, p)
    return np.asarray(np.einsum("ij,ij->i", flat @ slope, flat).reshape(m, rows).sum(axis=1))


def exchange_worst(
    joints: Array,
    aim: WorstCase,
    rng: np.random.Generator,
    count: int,
    *,
    first: NDArray[np.int_] | None = None,
    reachable: Feasible | None = None,
) -> Design:
    """Return the better of two exchanges for the worst case, the second one sharper and from the first.

    The design is never worse than ``first``. Its Jacobians are those of all cases, ``(n, s, r, p)``.

    Args:
        joints: candidates ``(m, joints)``, as the cases' pools.
        first: ``(count,)`` candidates to start from; random ones if not given.
        reachable: test of joint positions ``(n, joints)``; all are reachable if not given.

    Raises:
        LabError: too few candidates are reachable.
    """

    def allowed(row: int) -> bool:
        return reachable is None or bool(reachable(joints[row : row + 1])[0])

    state = _WorstExchange(aim, rng, allowed)
    found: list[tuple[float, NDArray[np.int_]]] = []
    if first is not None and all(allowed(row) for row in first.tolist()):
        found.append((state._score(aim.earlier + state._information(first)), first))
    for sharpness in _SHARPNESS:
        state.aim = WorstCase(aim.cases, sharpness)
        chosen, score = state.settled(count, first)
        first = chosen.copy()
        found.append((score, first))
    score, rows = max(found, key=lambda each: each[0])
    jacobian = aim.seen(joints[rows])
    return Design(rows, joints[rows], jacobian, score)


_ROUNDS = 12  # of the continuous design and its bound
_SUPPORT = 120  # candidates with weight, at most, in one continuous design
_MORE = 20  # candidates with the largest gains, which join them
_TESTS = 4  # positions of the largest variance, of which G counts the worst
_NEAR = 0.03  # of the smallest value: cases that count in the bound
_VANISHED, _LEAST_START = 1e-7, 1e-4  # weights that count as none; of equal ones, where a search begins


@dataclass(frozen=True)
class WorstCertificate:
    """The best continuous design for the worst case, over a pool.

    Attributes:
        weights: ``(m,)`` of the candidates, summing to one.
        cases: ``(s,)`` weights of the cases that give the bound, summing to one.
        value: smallest value of all cases at the candidates' weights, per pose.
        bound: no design from the pool has a larger smallest value per pose.
    """

    weights: Array
    cases: Array
    value: float
    bound: float

    @property
    def gap(self) -> float:
        """Bound of the loss of efficiency at these weights: 1 - exp(value - bound)."""
        return float(-np.expm1(self.value - self.bound))

    def efficiency(self, value: float, poses: int) -> float:
        """Return the certified efficiency of so many poses in all with this smallest value, at most 1."""
        return float(np.exp(value - np.log(poses) - self.bound))


@dataclass(frozen=True)
class _Part:
    """A concave part of a case's value: the value itself; for G, the variance at one position.

    Attributes:
        case: index of the case.
        goal: the criterion of the part.
    """

    case: int
    goal: Criterion


def certify_worst(
    cases: Sequence[Case],
    pools: Sequence[Array] | None = None,
    *,
    start: Array | None = None,
    gap: float = 2e-3,
    share: float = 1.0,
) -> WorstCertificate | None:
    """Compute the best continuous design for the worst of the cases, with a bound of all designs.

    Sequential quadratic programming finds the weights of some candidates; a linear programme over all candidates finds
    the cases' weights with the least bound, and candidates to add.

    Args:
        pools: ``(m, r, p)`` candidates of each case; those of the cases if not given.
        start: ``(m,)`` weights to start from; equal ones if not given.
        gap: stop at this loss of efficiency.
        share: of all poses that are still to be chosen; the others are those measured before.

    Returns:
        None if the criterion has no ``growth``, so that nothing bounds it.
    """
    if any(case.goal.growth is None for case in cases):
        return None
    search = _ContinuousDesign(cases, [case.pool for case in cases] if pools is None else pools, share)
    weights = np.full(search.count, 1 / search.count) if start is None else start / start.sum()
    best = None
    for _ in range(_ROUNDS):
        support = np.flatnonzero(weights > _VANISHED)
        if len(support) > _SUPPORT and best is not None:
            support = np.sort(np.argsort(-weights, kind="stable")[:_SUPPORT])
        search.see(weights)
        value, by_case, bound, gains = search.bound(weights)
        if best is None or value > best.value:
            best = WorstCertificate(weights, by_case, value, bound if best is None else min(bound, best.bound))
        elif bound < best.bound:
            best = WorstCertificate(best.weights, by_case, best.value, bound)
        if best.gap <= gap:
            break
        some = np.sort(np.argsort(-weights, kind="stable")[:_SUPPORT])
        support = np.union1d(some[weights[some] > _VANISHED], np.argsort(-gains, kind="stable")[:_MORE])
        weights = search.improved(weights, support)
    assert best is not None
    return best


class _ContinuousDesign:
    """Continuous designs for the worst of several cases."""

    def __init__(self, cases: Sequence[Case], pools: Sequence[Array], share: float) -> None:
        self.cases, self.pools, self.share, self.count = cases, pools, share, len(pools[0])
        self.alone = not len(cases[0].before)
        self.before = [
            (1 - share) * information(case.before) / max(len(case.before), 1) if not self.alone else 0.0
            for case in cases
        ]
        self.parts: list[_Part] = []
        self._tests = [set[int]() for _ in cases]

    def totals(self, weights: Array, rows: NDArray[np.int_]) -> list[Array]:
        """Return the information ``(p, p)`` per pose of each case, at weights ``(k,)`` of candidates ``(k,)``."""
        root = np.sqrt(np.maximum(self.share * weights, 0.0))[:, None, None]
        return [before + information(root * pool[rows]) for before, pool in zip(self.before, self.pools, strict=True)]

    def see(self, weights: Array) -> None:
        """Add the parts that matter at weights ``(m,)``: cases of small values, for G by their largest variances."""
        rows = np.flatnonzero(weights > 0)
        totals = self.totals(weights[rows], rows)
        value = np.array([case.value(case.goal.score(own)) for case, own in zip(self.cases, totals, strict=True)])
        for i in np.flatnonzero(value <= value.min() + _NEAR).tolist():
            case, total = self.cases[i], totals[i]
            if case.goal.name != "G":
                if not self._tests[i]:
                    self._tests[i].add(0)
                    self.parts.append(_Part(i, case.goal))
                continue
            for at, goal in worst_tests(case.goal, total, _TESTS):
                if at not in self._tests[i]:
                    self._tests[i].add(at)
                    self.parts.append(_Part(i, goal))

    def values(self, totals: Sequence[Array]) -> Array:
        """Return the value of each part."""
        return np.array([self.cases[part.case].value(part.goal.score(totals[part.case])) for part in self.parts])

    def gains(self, totals: Sequence[Array], rows: NDArray[np.int_] | slice) -> Array:
        """Return the derivatives ``(parts, k)`` of each part's value by candidates' weights."""
        found = []
        for part in self.parts:
            slope = part.goal.slope(totals[part.case]) * self.share / (self.cases[part.case].goal.growth or 1.0)
            found.append(_gains(self.pools[part.case][rows], slope))
        return np.array(found)

    def bound(self, weights: Array) -> tuple[float, Array, float, Array]:
        """Return the smallest value, the cases' weights ``(s,)`` with the least bound, it, and gains ``(m,)`` then."""
        rows = np.flatnonzero(weights > 0)
        totals = self.totals(weights[rows], rows)
        value = float(min(case.value(case.goal.score(own)) for case, own in zip(self.cases, totals, strict=True)))
        values, gains = self.values(totals), self.gains(totals, slice(None))
        offset, n = values - gains @ weights, len(self.parts)
        found = scipy.optimize.linprog(
            np.append(offset, 1.0),
            A_ub=np.column_stack([gains.T, np.full(self.count, -1.0)]),
            b_ub=np.zeros(self.count),
            A_eq=np.append(np.ones(n), 0.0)[None],
            b_eq=[1.0],
            bounds=[*[(0.0, None)] * n, (None, None)],
            method="highs",
        )
        by_part = np.zeros(n) if found.x is None else np.maximum(found.x[:n], 0.0)
        by_part = by_part / by_part.sum() if by_part.sum() > 0 else np.full(n, 1 / n)
        mixed = by_part @ gains
        # Without earlier poses, exp(value) is homogeneous: its tangent is the tighter bound.
        rest = np.log(mixed.max()) if self.alone else mixed.max() - mixed @ weights
        by_case = np.zeros(len(self.cases))
        np.add.at(by_case, [part.case for part in self.parts], by_part)
        return value, by_case, float(by_part @ values + rest), mixed

    def improved(self, weights: Array, support: NDArray[np.int_]) -> Array:
        """Return weights ``(m,)`` on some candidates ``(k,)`` with a larger smallest value."""
        k = len(support)
        start = np.maximum(weights[support], _LEAST_START / k)
        start = start / start.sum()
        seen: dict[bytes, list[Array]] = {}

        def totals(x: Array) -> list[Array]:
            key = x[:k].tobytes()
            if key not in seen:
                seen.clear()
                seen[key] = self.totals(np.maximum(x[:k], 0.0), support)
            return seen[key]

        try:
            found = scipy.optimize.minimize(
                lambda x: -x[k],
                np.append(start, self.values(self.totals(start, support)).min()),
                jac=lambda x: np.append(np.zeros(k), -1.0),
                bounds=[*[(0.0, 1.0)] * k, (None, None)],
                constraints=[
                    {
                        "type": "ineq",
                        "fun": lambda x: self.values(totals(x)) - x[k],
                        "jac": lambda x: np.column_stack([self.gains(totals(x), support), -np.ones(len(self.parts))]),
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
            shares = np.maximum(found.x[:k], 0.0)
        except (np.linalg.LinAlgError, ValueError):  # a step to a design without information
            shares = start
        out = np.zeros(self.count)
        out[support] = shares / shares.sum() if np.isfinite(shares).all() and shares.sum() > 0 else start
        return out
