"""Which poses to measure: exchange among candidates, then an ascent of all joint angles.

A design sees the arm through one callable: joint positions ``(n, joints)`` in, scaled (and mostly whitened)
Jacobians ``(n, r, p)`` out. So it serves any base set, with or without effects, any instrument.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import scipy  # its parts are loaded at their first use, which not every process comes to
from numpy.typing import NDArray

from lab.core.errors import LabError
from lab.core.se3 import Array
from lab.pose_selection.criteria import Criterion

__all__ = ["Design", "Feasible", "Sensitivity", "ascend", "exchange", "information"]

Sensitivity = Callable[[Array], Array]
Feasible = Callable[[Array], NDArray[np.bool_]]
MOST_PASSES = 30
LOOKED_AT = 32  # candidates of the largest trace, whose determinants are computed first
SAMPLED = 256  # candidates tried at each place where a criterion has no rank-k update
STEP_RAD = 1e-5  # of the central differences (m for a slide)
_RIDGE = 1e-9  # of the trace, while a design one pose short is singular


@dataclass(frozen=True)
class Design:
    """Poses chosen, and how good they are.

    Attributes:
        rows: ``(n,)`` which candidates they are; -1 for one that the ascent moved off the pool.
        joints: ``(n, joints)``.
        jacobian: ``(n, r, p)`` there.
        score: the criterion's.
    """

    rows: NDArray[np.int_]
    joints: Array
    jacobian: Array
    score: float


def information(jacobian: Array) -> Array:
    """Information matrix ``(p, p)`` of Jacobians ``(n, r, p)``."""
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
    first: NDArray[np.int_] | None = None,
) -> Design:
    """The best of several Fedorov exchanges: each pose in turn gives way to the best candidate.

    Args:
        joints: candidates ``(m, joints)``.
        jacobian: theirs, ``(m, r, p)``.
        count: how many poses to choose, no candidate twice.
        measured: information ``(p, p)`` of poses that were measured already.
        first: rows ``(count,)`` that the first start begins with, e.g. those of a design that has lost some; by chance
            if not given.

    Raises:
        LabError: there are too few candidates, or no choice of ``count`` shows every parameter.
    """
    m, rows, p = jacobian.shape
    held = np.zeros((p, p)) if measured is None else measured
    if count < 1 or count > m:
        raise LabError(f"{count} poses from {m} candidates: ask for 1 to {m}, or for more candidates")
    if measured is None and count * rows < p:
        raise LabError(f"{count} poses cannot show {p} parameters: ask for {-(-p // rows)} or more")
    best: Design | None = None
    for start in range(starts):
        begun = first.copy() if first is not None and start == 0 else rng.choice(m, count, replace=False)
        chosen, score = _exchanged(jacobian, begun, goal, held, rng)
        if best is None or score > best.score:
            best = Design(chosen, joints[chosen], jacobian[chosen], score)
    assert best is not None
    if np.linalg.matrix_rank(_scaled(held + information(best.jacobian)), tol=1e-9) < p:
        raise LabError(f"no {count} of these poses show all {p} parameters: ask for more poses, or free fewer joints")
    return best


def _scaled(matrix: Array) -> Array:
    size = np.sqrt(np.maximum(np.diag(matrix), 1e-300))
    scaled: Array = matrix / np.outer(size, size)
    return scaled


def _exchanged(
    jacobian: Array, chosen: NDArray[np.int_], goal: Criterion, held: Array, rng: np.random.Generator
) -> tuple[NDArray[np.int_], float]:
    total = held + information(jacobian[chosen])
    for _ in range(MOST_PASSES):
        changed = False
        for slot in range(len(chosen)):
            without = total - information(jacobian[chosen[slot : slot + 1]])
            tried, scores = _scores_with(jacobian, without, chosen, slot, goal, rng)
            own = scores[tried == chosen[slot]][0]
            winner = int(np.argmax(scores))
            if scores[winner] > own + 1e-9 * max(1.0, abs(own)):
                chosen[slot] = tried[winner]
                total = without + information(jacobian[chosen[slot : slot + 1]])
                changed = True
        total = held + information(jacobian[chosen])
        if not changed:
            break
    return chosen, float(goal.score(total))


def _scores_with(
    jacobian: Array, without: Array, chosen: NDArray[np.int_], slot: int, goal: Criterion, rng: np.random.Generator
) -> tuple[NDArray[np.int_], Array]:
    """Candidates that may take a place (the present one last), and the score of the design with each there."""
    free = np.ones(len(jacobian), dtype=bool)
    free[chosen] = False
    tried = np.flatnonzero(free)
    if goal.name != "O1" and goal.weight is None:  # no rank-k update: whole scores of a sample
        if len(tried) > SAMPLED:
            tried = rng.choice(tried, SAMPLED, replace=False)
        tried = np.append(tried, chosen[slot])
        part = jacobian[tried]
        return tried, goal.score(without + np.swapaxes(part, 1, 2) @ part)
    inverse = _inverse(without)
    if goal.weight is None:
        tried = _promising(jacobian, free, inverse)
    tried = np.append(tried, chosen[slot])
    part = jacobian[tried]
    moved = part @ inverse  # (m, r, p)
    core = np.eye(part.shape[1]) + moved @ np.swapaxes(part, 1, 2)
    if goal.weight is None:
        return tried, np.linalg.slogdet(core)[1]
    spread = moved @ goal.weight @ np.swapaxes(moved, 1, 2)
    gain = np.trace(np.linalg.solve(core, spread), axis1=1, axis2=2)
    return tried, -np.log(np.maximum(np.trace(goal.weight @ inverse) - gain, 1e-300))


def _inverse(information: Array) -> Array:
    """The inverse, with a trace of a ridge where a design one pose short is singular."""
    p = len(information)
    return np.asarray(np.linalg.inv(information + _RIDGE * np.trace(information) / p * np.eye(p)), dtype=np.float64)


def _promising(jacobian: Array, free: NDArray[np.bool_], inverse: Array) -> NDArray[np.int_]:
    """Free candidates that may have the largest log det(I + J V J').

    It is at most r log(1 + t / r) with t the trace of the r x r matrix J V J', so whoever stays
    below the best of those with the largest traces is out.
    """
    rows = jacobian.shape[1]
    flat = jacobian.reshape(-1, jacobian.shape[2])
    trace = np.einsum("ij,ij->i", flat @ inverse, flat).reshape(-1, rows).sum(axis=1)
    trace[~free] = -1.0
    first = np.argpartition(-trace, min(LOOKED_AT, len(trace) - 1))[:LOOKED_AT]
    part = jacobian[first[trace[first] >= 0]]
    best = np.linalg.slogdet(np.eye(rows) + part @ inverse @ np.swapaxes(part, 1, 2))[1].max(initial=-np.inf)
    bound = rows * np.log1p(np.maximum(trace, -0.5) / rows)
    return np.flatnonzero(free & (bound >= best - 1e-9))


def ascend(
    design: Design,
    sensitivity: Sensitivity,
    goal: Criterion,
    feasible: Feasible,
    lower: Array,
    upper: Array,
    *,
    rounds: int = 4,
    measured: Array | None = None,
) -> Design:
    """Move all joint angles uphill, each pose only to where it is feasible; the score never falls.

    A quasi-Newton ascent within the limits proposes; then each pose goes as far towards its
    proposal (all of the way, a half, …) as is feasible and better.

    The loop is its own: it maximizes, pose by pose, and what is infeasible or no better is not taken.

    Args:
        sensitivity: joint positions to Jacobians, scaled as the design's.
        feasible: joint positions ``(n, joints)`` to ``(n,)``.
        lower, upper: limits ``(joints,)``; infinite where there are none.
    """
    held = 0.0 if measured is None else measured
    joints, jacobian, score = design.joints.copy(), design.jacobian.copy(), design.score
    rows = design.rows.copy()
    for _ in range(rounds):
        proposal = _proposed(joints, sensitivity, goal, held, lower, upper)
        before = score
        for pose in range(len(joints)):
            for share in (1.0, 0.5, 0.25, 0.1):
                moved = joints[pose] + share * (proposal[pose] - joints[pose])
                trial = jacobian.copy()
                trial[pose] = sensitivity(moved[None])[0]
                value = float(goal.score(held + information(trial)))
                if value > score and feasible(moved[None])[0]:
                    joints[pose], jacobian, score, rows[pose] = moved, trial, value, -1
                    break
        if score - before < 1e-6 * max(1.0, abs(score)):
            break
    return Design(rows, joints, jacobian, score)


def _proposed(
    joints: Array, sensitivity: Sensitivity, goal: Criterion, held: Array | float, lower: Array, upper: Array
) -> Array:
    """Where a quasi-Newton ascent within the limits takes all poses, collisions aside."""
    n, size = joints.shape
    offsets = np.concatenate([np.zeros((1, size)), STEP_RAD * np.eye(size), -STEP_RAD * np.eye(size)])

    def downhill(flat: Array) -> tuple[float, Array]:
        around = (flat.reshape(n, 1, size) + offsets).reshape(-1, size)
        jacobian = sensitivity(around).reshape(n, 1 + 2 * size, -1, goal_size)
        here = jacobian[:, 0]
        total = held + information(here)
        rate = (jacobian[:, 1 : 1 + size] - jacobian[:, 1 + size :]) / (2 * STEP_RAD)
        try:
            slope = 2 * np.einsum("nrp,njrp->nj", here @ goal.slope(total), rate)
        except np.linalg.LinAlgError:  # a step too far, to poses that cannot be and tell nothing
            slope = np.zeros_like(joints)
        return -float(goal.score(total)), -slope.ravel()

    goal_size = sensitivity(joints[:1]).shape[-1]
    bounds = list(zip(np.tile(lower, n), np.tile(upper, n), strict=True))
    solved = scipy.optimize.minimize(
        downhill, joints.ravel(), jac=True, method="L-BFGS-B", bounds=bounds, options={"maxiter": 200}
    )
    proposal: Array = solved.x.reshape(n, size)
    return proposal
