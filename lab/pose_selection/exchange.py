"""Choose the poses to measure: exchange among candidates, then an ascent of all joint angles.

The arm is one function from joint positions ``(n, joints)`` to scaled (and mostly whitened) Jacobians ``(n, r, p)``,
for any base set, with or without effects, and any instrument.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import scipy  # its parts are loaded at their first use
from numpy.typing import NDArray

from lab.core.errors import LabError, option_name
from lab.core.se3 import Array
from lab.pose_selection.criteria import Criterion
from lab.pose_selection.own_criterion import PreparedCriterion

__all__ = [
    "Design",
    "Feasible",
    "OneCriterion",
    "Sensitivity",
    "climb",
    "exchange",
    "information",
]

Sensitivity = Callable[[Array], Array]
Feasible = Callable[[Array], NDArray[np.bool_]]
_MAX_PASSES = 30
_FIRST = 32  # candidates of the largest trace, whose determinants are computed first
_SHORTLIST = 32  # candidates for each slot that the slope of a user's criterion prefers
_SAMPLED = 256  # candidates tried for each slot if a criterion has no rank-k update
_STEP_RAD = 1e-5  # of the central differences (m for a slide)
_TOLERANCE = 1e-5  # relative gain of the score at which the first ascent ends
_RIDGE = 1e-9  # of the trace, while a design one pose short is singular
_NEARLY_SINGULAR = 1e-4  # least share of a direction left without a pose: an update would lose its digits


@dataclass(frozen=True)
class Design:
    """Chosen poses, with their score.

    Attributes:
        rows: ``(n,)`` their candidates; -1 for one that the ascent moved off the pool.
        joints: ``(n, joints)``.
        jacobian: ``(n, r, p)`` there.
        score: of the criterion.
    """

    rows: NDArray[np.int_]
    joints: Array
    jacobian: Array
    score: float


def information(jacobian: Array) -> Array:
    """Return information matrix ``(p, p)`` of Jacobians ``(n, r, p)``."""
    flat = jacobian.reshape(-1, jacobian.shape[-1])
    matrix: Array = flat.T @ flat
    return matrix


def exchange(
    joints: Array,
    jacobian: Array,
    count: int,
    goal: Criterion,
    rng: np.random.Generator,
    *,
    starts: int = 4,
    measured: Array | None = None,
    reachable: Feasible | None = None,
) -> Design:
    """Return the best of several Fedorov exchanges: each pose in turn is replaced by the best candidate.

    Args:
        joints: candidates ``(m, joints)``.
        jacobian: theirs, ``(m, r, p)``.
        count: number of poses to choose, no candidate twice.
        measured: information ``(p, p)`` of poses measured before.
        reachable: test of joint positions ``(n, joints)``, called only for
            candidates that would be chosen; all are reachable if not given.

    Raises:
        LabError: there are too few candidates, or no choice of ``count`` determines every parameter.
    """
    m, rows, p = jacobian.shape
    earlier = np.zeros((p, p)) if measured is None else measured
    if count < 1 or count > m:
        raise LabError(f"{count} poses from {m} candidates: ask for 1 to {m}, or for more candidates")
    if measured is None and count * rows < p:
        raise LabError(f"{count} poses cannot show {p} parameters: ask for {-(-p // rows)} or more")

    def allowed(row: int) -> bool:
        return reachable is None or bool(reachable(joints[row : row + 1])[0])

    ends = [_Exchange(jacobian, goal, earlier, rng, allowed).settled(count) for _ in range(starts)]
    chosen, score = max(ends, key=lambda end: end[1])
    best = Design(chosen, joints[chosen], jacobian[chosen], score)
    if np.linalg.matrix_rank(_scaled(earlier + information(best.jacobian)), tol=1e-9) < p:
        raise LabError(f"no {count} of these poses show all {p} parameters: give more poses, or free fewer joints")
    return best


def _scaled(matrix: Array) -> Array:
    size = np.sqrt(np.maximum(np.diag(matrix), 1e-300))
    scaled: Array = matrix / np.outer(size, size)
    return scaled


class _Exchange:
    """State of an exchange: the chosen poses, and the gain of every candidate.

    For O1, V is the inverse of the information M of all chosen poses, and tr(J V J') of every candidate is stored. Both
    get updates of rank r when a pose is removed or added (Sherman, Morrison & Woodbury 1950), at the cost of
    candidates by p by r instead of candidates by p by p.

    For a user's criterion with the slope S, V is S p / tr(S M): the inverse of M if it ranks as O1. Once a pass it is
    computed, and changes as for O1 in between. It picks a short list, of which the whole scores are computed.
    """

    def __init__(
        self, jacobian: Array, goal: Criterion, earlier: Array, rng: np.random.Generator, allowed: Callable[[int], bool]
    ) -> None:
        self.jacobian, self.goal, self.earlier, self.rng, self.allowed = jacobian, goal, earlier, rng, allowed
        self.barred: set[int] = set()  # unreachable
        self.columns = jacobian.transpose(2, 1, 0).reshape(jacobian.shape[2], -1)  # (p, r m), rows of one pose apart
        self.free = np.ones(len(jacobian), dtype=bool)  # neither chosen nor found unreachable
        self.by_slope = isinstance(goal, PreparedCriterion) and goal.weight is None
        self.by_trace = goal.name == "O1" or self.by_slope

    def settled(self, count: int) -> tuple[NDArray[np.int_], float]:
        """Exchange poses until no allowed candidate is better; return them and their score.

        Tests of reachability take longest: they are done for the final poses, and the exchange continues without those
        that are unreachable.
        """
        self.chosen = self.rng.choice(len(self.jacobian), count, replace=False)
        self.free[:] = True
        self.free[[*self.barred, *self.chosen.tolist()]] = False
        passes, unsettled = 0, True
        while unsettled:
            self._recompute()
            changed, passes = sum(self._changed(slot) for slot in range(count)), passes + 1
            unsettled = (changed > 0 and passes < _MAX_PASSES) or self._bar_unreachable()
        return self.chosen, float(self.goal.score(self.earlier + self._information(self.chosen)))

    def _information(self, rows: NDArray[np.int_]) -> Array:
        """Return the information of candidates."""
        return information(self.jacobian[rows])

    def _bar_unreachable(self) -> bool:
        """Bar chosen poses that are unreachable; return whether there are any."""
        out = {row for row in self.chosen.tolist() if not self.allowed(row)}
        self.barred |= out
        return bool(out)

    def _recompute(self) -> None:
        """Compute information and traces of the chosen poses without the rounding of updates."""
        self.total = self.earlier + self._information(self.chosen)
        if self.by_trace:
            self.traces = self._computed(self.total)

    def _changed(self, slot: int) -> bool:
        """Replace a pose by a better one, or by one that is allowed; return whether one was found."""
        present = int(self.chosen[slot])
        without = self.total - self._information(self.chosen[slot : slot + 1])
        left = (self._updated(self.traces, present, -1.0) or self._otherwise(without)) if self.by_trace else None
        row = self._best_candidate(without, left, present)
        if row == present:
            return False
        self.chosen[slot] = row
        self.total = without + self._information(self.chosen[slot : slot + 1])
        self.free[row] = False
        self.free[present] = present not in self.barred
        if left is not None:
            self.traces = self._updated(left, row, 1.0) or self._otherwise(self.total)
        return True

    def _otherwise(self, total: Array) -> "_Traces":
        """Return the traces at an information ``(p, p)`` that no update reaches; those of the pass by a slope."""
        return self.traces if self.by_slope else self._computed(total)

    def _best_candidate(self, without: Array, left: "_Traces | None", present: int) -> int:
        while True:
            tried, scores = self._scores(without, left, present)
            best = int(np.argmax(scores))
            own = scores[-1]
            row = int(tried[best]) if scores[best] > own + 1e-9 * max(1.0, abs(own)) else present
            if row not in self.barred:
                return row
            if row == present:  # any reachable candidate is better than an unreachable pose
                others = np.argsort(-scores[:-1], kind="stable")
                for row in tried[others].tolist():
                    if row not in self.barred:
                        return int(row)
                    self.free[row] = False
                if not self.free.any():
                    raise LabError(
                        f"no free way leads to {len(self.chosen)} of {len(self.jacobian)} candidates: ask for fewer "
                        f"poses, for more candidates, or for less {option_name('clearance_mm')} and "
                        f"{option_name('self_clearance_mm')}"
                    )
            self.free[row] = False

    def _scores(self, without: Array, left: "_Traces | None", present: int) -> tuple[NDArray[np.int_], Array]:
        """Return candidates for a slot (the present one last), and the score of the design with each."""
        if self.by_slope and left is not None:
            gains = np.where(self.free, _added(self.jacobian, left.inverse), -np.inf)
            tried = np.argsort(-gains, kind="stable")[: min(_SHORTLIST, int(self.free.sum()))]
            tried = np.append(tried, present)
            return tried, _scores_with(self.goal, without, self.jacobian[tried])
        if left is not None:
            tried = np.append(self._promising(left), present)
            return tried, _added(self.jacobian[tried], left.inverse)
        tried = np.flatnonzero(self.free)
        if self.goal.weight is None and len(tried) > _SAMPLED:  # no rank-k update: whole scores of a sample
            tried = self.rng.choice(tried, _SAMPLED, replace=False)
        tried = np.append(tried, present)
        return tried, _scores_with(self.goal, without, self.jacobian[tried])

    def _promising(self, left: "_Traces") -> NDArray[np.int_]:
        """Return the free candidates that may have the largest log det(I + J V J').

        It is at most r log(1 + t / r) with t the trace of the r x r matrix J V J', so candidates whose bound is below
        the best of those with the largest traces are out.
        """
        rows = self.jacobian.shape[1]
        trace = np.where(self.free, left.trace, -1.0)
        first = np.argpartition(-trace, min(_FIRST, len(trace) - 1))[:_FIRST]
        first = first[self.free[first]]
        best = _added(self.jacobian[first], left.inverse).max(initial=-np.inf)
        bound = rows * np.log1p(np.maximum(trace, -0.5) / rows)
        return np.flatnonzero(self.free & (bound >= best - 1e-9))

    def _computed(self, total: Array) -> "_Traces":
        inverse = self._inverse_by_slope(total) if self.by_slope else _inverse_of(total)
        by_row = np.einsum("ij,ij->j", inverse @ self.columns, self.columns)
        return _Traces(inverse, by_row.reshape(-1, len(self.jacobian)).sum(axis=0))

    def _inverse_by_slope(self, total: Array) -> Array:
        """Return V ``(p, p)`` = S p / tr(S M) at an information M; its inverse where the slope S is no use."""
        try:
            slope = self.goal.slope(total)
        except np.linalg.LinAlgError:  # of a singular information
            return _inverse_of(total)
        size = float(np.sum(slope * total))
        return slope * (len(total) / size) if np.isfinite(slope).all() and size > 0 else _inverse_of(total)

    def _updated(self, now: "_Traces", row: int, sign: float) -> "_Traces | None":
        """Return the traces with a candidate added (sign 1) or removed (-1); None if the rest is nearly singular."""
        added = self.jacobian[row]
        half = now.inverse @ added.T
        values, vectors = np.linalg.eigh(np.eye(len(added)) + sign * added @ half)
        if values[0] < _NEARLY_SINGULAR:
            return None
        root = half @ (vectors / np.sqrt(values))  # V changes by root root'
        across = (root.T @ self.columns).reshape(-1, len(self.jacobian))  # (r r, m)
        changed = sign * np.einsum("ij,ij->j", across, across)
        return _Traces(now.inverse - sign * root @ root.T, now.trace - changed)


@dataclass(frozen=True)
class _Traces:
    """The inverse ``(p, p)`` V of an information, and tr(J V J') of every candidate ``(m,)``."""

    inverse: Array
    trace: Array


def _added(jacobian: Array, inverse: Array) -> Array:
    """Return log det(I + J V J') of candidates ``(m, r, p)``: each one's gain in log det of the information."""
    core = np.eye(jacobian.shape[1]) + jacobian @ inverse @ np.swapaxes(jacobian, 1, 2)
    gains: Array = np.linalg.slogdet(core)[1]
    return gains


def _scores_with(goal: Criterion, without: Array, part: Array) -> Array:
    """Return the scores ``(m,)`` of an information ``(p, p)`` with one of candidates ``(m, r, p)`` added."""
    if goal.weight is None:  # no rank-k update: whole scores
        return goal.score(without + np.swapaxes(part, 1, 2) @ part)
    inverse = _inverse_of(without)
    moved = part @ inverse  # (m, r, p)
    core = np.eye(part.shape[1]) + moved @ np.swapaxes(part, 1, 2)
    spread = moved @ goal.weight @ np.swapaxes(moved, 1, 2)
    gain = np.trace(np.linalg.solve(core, spread), axis1=1, axis2=2)
    return np.asarray(-np.log(np.maximum(np.trace(goal.weight @ inverse) - gain, 1e-300)))


def _inverse_of(information: Array) -> Array:
    """Invert with a small ridge, as a design one pose short may be singular."""
    p = len(information)
    ridge = _RIDGE * np.trace(information) / p or _RIDGE  # without its only pose a design has no information
    return np.asarray(np.linalg.inv(information + ridge * np.eye(p)), dtype=np.float64)


@dataclass(frozen=True)
class OneCriterion:
    """A criterion of one arm's information.

    Attributes:
        earlier: information ``(p, p)`` of poses measured before.
    """

    sensitivity: Sensitivity
    goal: Criterion
    earlier: Array | float = 0.0

    def seen(self, inputs: Array) -> Array:
        """Return the Jacobians ``(n, r, p)``."""
        return self.sensitivity(inputs)

    def score(self, jacobian: Array) -> float:
        """Return the criterion's score."""
        return float(self.goal.score(self.earlier + information(jacobian)))

    def uphill(self, inputs: Array) -> tuple[float, Array]:
        """Return the criterion's score, and its derivatives."""
        stepped = _with_steps(self.sensitivity, inputs)
        here = stepped[:, 0]
        total = self.earlier + information(here)
        try:
            slope = self._slope_of_scores(stepped, total) if self._few_scores(inputs) else self._slope(stepped, total)
        except np.linalg.LinAlgError:  # a step to impossible poses without information
            slope = np.zeros_like(inputs)
        return float(self.goal.score(total)), slope

    def _few_scores(self, inputs: Array) -> bool:
        """Decide whether a slope by the inputs takes fewer scores than one by each entry of the information."""
        goal = self.goal
        return isinstance(goal, PreparedCriterion) and goal.slope_scores > 2 * inputs.size

    def _slope(self, stepped: Array, total: Array) -> Array:
        """Return the derivatives ``(n, joints)`` by the chain rule: of the score by the information, and of that."""
        ahead, back = np.split(stepped[:, 1:], 2, axis=1)
        rate = (ahead - back) / (2 * _STEP_RAD)
        slope: Array = 2 * np.einsum("nrp,njrp->nj", stepped[:, 0] @ self.goal.slope(total), rate)
        return slope

    def _slope_of_scores(self, stepped: Array, total: Array) -> Array:
        """Return the derivatives ``(n, joints)`` by differences of the score, each with one pose moved."""
        each = np.swapaxes(stepped, -1, -2) @ stepped  # (n, 1 + 2 joints, p, p)
        scores = self.goal.score(total + each[:, 1:] - each[:, :1])
        ahead, back = np.split(np.where(np.isfinite(scores), scores, np.nan), 2, axis=1)
        slope: Array = np.nan_to_num((ahead - back) / (2 * _STEP_RAD))
        return slope


def _with_steps(sensitivity: Sensitivity, inputs: Array) -> Array:
    """Return Jacobians at inputs ``(n, joints)``, and at each input more, then less: ``(n, 1 + 2 joints, r, p)``."""
    n, size = inputs.shape
    offsets = np.concatenate([np.zeros((1, size)), _STEP_RAD * np.eye(size), -_STEP_RAD * np.eye(size)])
    flat = sensitivity((inputs[:, None] + offsets).reshape(-1, size))
    return flat.reshape(n, 1 + 2 * size, *flat.shape[1:])


def climb(
    design: Design, aim: OneCriterion, feasible: Feasible, lower: Array, upper: Array, *, rounds: int = 4
) -> Design:
    """Move all joint angles uphill, each pose only to feasible positions; the score never falls.

    A quasi-Newton ascent within the limits proposes; then each pose moves as far towards its
    proposal (all of the way, a half, …) as is feasible and better.

    Args:
        design: with derivatives as the aim has them.
        feasible: joint positions ``(n, joints)`` to ``(n,)``.
        lower, upper: limits ``(joints,)``; infinite where there are none.
    """
    joints, jacobian, score = design.joints.copy(), design.jacobian.copy(), design.score
    rows = design.rows.copy()
    for k in range(rounds):
        proposal = _proposed(joints, aim, lower, upper, _TOLERANCE * 0.1**k)
        before = score
        for pose in range(len(joints)):
            for share in (1.0, 0.5, 0.25, 0.1):
                moved = joints[pose] + share * (proposal[pose] - joints[pose])
                trial = jacobian.copy()
                trial[pose] = aim.seen(moved[None])[0]
                value = aim.score(trial)
                if value > score and feasible(moved[None])[0]:
                    joints[pose], jacobian, score, rows[pose] = moved, trial, value, -1
                    break
        if score - before < 1e-6 * max(1.0, abs(score)):
            break
    return Design(rows, joints, jacobian, score)


def _proposed(joints: Array, aim: OneCriterion, lower: Array, upper: Array, tolerance: float) -> Array:
    """Move all poses by a quasi-Newton ascent within the limits, collisions aside, to a relative gain of the score."""
    n, size = joints.shape

    def downhill(flat: Array) -> tuple[float, Array]:
        score, slope = aim.uphill(flat.reshape(n, size))
        return -score, -slope.ravel()

    bounds = list(zip(np.tile(lower, n), np.tile(upper, n), strict=True))
    solved = scipy.optimize.minimize(
        downhill,
        joints.ravel(),
        jac=True,
        method="L-BFGS-B",
        bounds=bounds,
        options={"maxiter": 200, "ftol": tolerance},
    )
    proposal: Array = solved.x.reshape(n, size)
    return proposal
