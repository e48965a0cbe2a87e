"""Prepare a user's criterion for a search: its score, its slope, its errors in one line."""

import inspect
from collections.abc import Callable

import numpy as np

from lab.core.errors import LabError
from lab.core.se3 import Array
from lab.extension_points import own_errors
from lab.pose_selection.criteria import Criterion, DesignTask, is_singular, weighted_slope

__all__ = ["PreparedCriterion", "prepared"]

_TRIED_SETS = 8  # random sets of poses by which a criterion is checked
_TRIED_DIRECTIONS = 3  # candidates along which a slope is checked
_STEP = 1e-5  # of the information of a set, for differences of a score
_STEP_OF_VALUES = 1e-3  # of an eigenvalue, for differences of fourth order
_SLOPE_TOLERANCE = 1e-3  # of the largest derivative


def prepared(own: Criterion, task: DesignTask, pool: Array, measured: Array | float = 0.0) -> Criterion:
    """Return a user's criterion for a search. It is tried on some random sets of poses.

    Args:
        task: with p parameters.
        pool: ``(m, r, p)``, Jacobians of the candidates.
        measured: information ``(p, p)`` of poses measured before.

    Raises:
        LabError: it raises an error, returns no scores, scores all sets alike, scores twice the information lower, or
            has a weight or a slope that is not that of its score.
    """
    m, rows, p = pool.shape
    count = min(m, 2 * -(-p // rows))
    rng = np.random.default_rng(0)
    sets = np.stack([pool[rng.choice(m, count, replace=False)].reshape(-1, p) for _ in range(_TRIED_SETS)])
    matrices = np.swapaxes(sets, 1, 2) @ sets + measured
    matrices = matrices[~is_singular(matrices)]
    goal = PreparedCriterion(own, task, matrices)
    if len(matrices) < 2:  # the search says what is missing
        return goal
    scores, twice = goal.score(matrices), goal.score(2 * matrices)
    goal.score(matrices[0])  # one matrix is scored as well
    margin = 1e-9 * np.maximum(1.0, np.abs(scores))
    if (scores == scores[0]).all():
        raise LabError(
            f"criterion '{own.name}' gives {len(scores)} random sets of {count} poses the same score, {scores[0]:g}: "
            "it cannot choose; return a number that depends on the information"
        )
    if (np.isfinite(scores) & (twice < scores - margin)).all():
        raise LabError(
            f"criterion '{own.name}' gives {count} poses {scores[0]:.4g}, and {twice[0]:.4g} if each is measured twice"
            "; larger is better: turn the sign of its score"
        )
    goal.refuse_wrong_weight(matrices, scores)
    goal.refuse_wrong_slope(matrices[0], pool[:: -(-m // _TRIED_DIRECTIONS)])
    return goal


class PreparedCriterion(Criterion):
    """A user's criterion, whose errors name it, with a slope found by the cheapest differences.

    Attributes:
        inner: it, with the task.
        has_slope: whether it has a slope of its own.
        of_values: whether its score is a function of the singular values alone.
        takes_task: whether its score is a function of the matrix and the task.
        one_by_one: whether it takes one matrix at a time.
    """

    def __init__(self, own: Criterion, task: DesignTask, matrices: Array) -> None:
        """Prepare a criterion.

        Args:
            matrices: ``(k, p, p)`` some regular information matrices, on which it is tried.

        Raises:
            LabError: it cannot be copied, or its weight is none.
        """
        self.name = own.name
        self.task: DesignTask = task
        with own_errors("criterion", own.name):
            self.inner = own.for_task(task)
            self.weight = None if self.inner.weight is None else np.asarray(self.inner.weight, dtype=np.float64)
            self.growth = self.inner.growth
        p = len(task.parameters)
        if self.weight is not None and self.weight.shape != (p, p):
            raise LabError(
                f"criterion '{self.name}' has a weight of shape {self.weight.shape} for {p} parameters; give ({p}, {p})"
            )
        self.takes_task = _required(self.inner.score) > 1
        self.has_slope = type(self.inner).slope is not Criterion.slope
        self.one_by_one = len(matrices) > 1 and self._takes_one_matrix(matrices[:2])
        self.of_values = len(matrices) > 1 and not self.has_slope and self._is_of_values(matrices)

    @property
    def slope_scores(self) -> int:
        """Number of scores that a slope takes."""
        p = len(self.task.parameters)
        if self.has_slope or self.weight is not None:
            return 0
        return 4 * p if self.of_values else p * (p + 1)

    def score(self, information: Array) -> Array:
        """Return the scores ``(...)`` of information matrices ``(..., p, p)``; -inf where their inverse is not there.

        Raises:
            LabError: the user's function raises an error, or returns another shape or NaN.
        """
        batch = information.shape[:-2]
        with own_errors("criterion", self.name):
            if self.one_by_one and batch:
                matrices = information.reshape(-1, *information.shape[-2:])
                scores = np.array([self._of_one(matrix) for matrix in matrices], dtype=np.float64).reshape(batch)
            else:
                scores = np.asarray(self._of_one(information), dtype=np.float64)
        if scores.shape != batch:
            raise LabError(
                f"criterion '{self.name}' returns scores of shape {scores.shape} for information of shape "
                f"{information.shape}; return {batch}"
            )
        if not (scores < np.inf).all():
            what = "NaN" if np.isnan(scores).any() else "inf"
            raise LabError(
                f"criterion '{self.name}' returns {what}; return a finite score, and -inf where information is singular"
            )
        return scores

    def _plain(self, information: Array) -> Array:
        """Return what the user's score returns."""
        further = (self.task,) if self.takes_task else ()
        scores = self.inner.score(information, *further)
        if np.iscomplexobj(scores):
            raise LabError(f"criterion '{self.name}': its scores are complex numbers; return real ones")
        return scores

    def _of_one(self, information: Array) -> Array | float:
        """Return the score of a matrix, -inf where its inverse does not exist; of several if none of them is such."""
        try:
            return self._plain(information)
        except np.linalg.LinAlgError:
            if information.ndim > 2:
                return np.stack([np.asarray(self._of_one(matrix)) for matrix in information])
            return -np.inf

    def _takes_one_matrix(self, pair: Array) -> bool:
        """Decide whether the score is written for one matrix: right for each of a pair, and not for both together."""
        try:
            apart = np.array([self._plain(matrix) for matrix in pair], dtype=np.float64)
        except Exception:  # what is wrong is reported when it is scored
            return False
        if apart.shape != (2,):
            return False
        try:
            with np.errstate(all="ignore"):  # of a trial
                together = np.asarray(self._plain(pair), dtype=np.float64)
        except Exception:
            return True
        return together.shape != (2,) or not np.allclose(together, apart, rtol=1e-6, atol=0, equal_nan=True)

    def _is_of_values(self, matrices: Array) -> bool:
        """Decide whether a rotation of the parameters leaves the scores of matrices ``(k, p, p)`` as they are."""
        rotation = np.linalg.qr(np.random.default_rng(1).normal(size=matrices.shape[1:]))[0]
        scores, turned = self.score(matrices), self.score(rotation @ matrices @ rotation.T)
        return bool(np.isfinite(scores).all() and np.allclose(turned, scores, rtol=1e-6, atol=1e-6 * np.ptp(scores)))

    def slope(self, information: Array) -> Array:
        """Return the symmetric derivative ``(p, p)`` of the score by the information ``(p, p)``.

        Raises:
            LabError: the user's function raises an error, or returns another shape.
        """
        if not self.has_slope:
            if self.weight is not None:
                return weighted_slope(self.weight, information)
            return self._slope_of_values(information) if self.of_values else super().slope(information)
        with own_errors("criterion", self.name, np.linalg.LinAlgError):  # a search goes on from an impossible step
            slope = np.asarray(self.inner.slope(information), dtype=np.float64)
        if slope.shape != information.shape:
            raise LabError(
                f"criterion '{self.name}' returns a slope of shape {slope.shape}; return {information.shape}"
            )
        return (slope + slope.T) / 2

    def _slope_of_values(self, information: Array) -> Array:
        """Return V diag(df/dl) V' of a score f of the eigenvalues l of M = V diag(l) V' (Lewis 1996).

        The derivatives by log l are differences of fourth order, ``(8 (f(h) - f(-h)) - (f(2h) - f(-2h))) / 12h``.
        """
        values, vectors = np.linalg.eigh(information)
        if values[0] <= 0:
            raise np.linalg.LinAlgError("singular information")
        unit, h = np.eye(len(values)), _STEP_OF_VALUES
        moved = values * (1 + h * np.array([1.0, -1.0, 2.0, -2.0])[:, None, None] * unit)  # (4, p, p)
        ahead, back, far_ahead, far_back = self.score(moved[..., None] * unit)
        by_log = (8 * (ahead - back) - (far_ahead - far_back)) / (12 * h)
        slope: Array = (vectors * (by_log / values)) @ vectors.T
        return slope

    def refuse_wrong_weight(self, matrices: Array, scores: Array) -> None:
        """Refuse a weight W if the scores ``(k,)`` of matrices ``(k, p, p)`` are not -log tr(W M^-1)."""
        if self.weight is None:
            return
        stated = -np.log(np.einsum("pq,nqp->n", self.weight, np.linalg.inv(matrices)))
        if not np.allclose(np.diff(stated), np.diff(scores), rtol=1e-3, atol=1e-6):
            raise LabError(
                f"criterion '{self.name}' has a weight W, but its score is not -log tr(W M^-1); set weight to None"
            )

    def refuse_wrong_slope(self, information: Array, poses: Array) -> None:
        """Refuse a slope that is not the derivative of the score ``(p, p)`` along that of poses ``(k, r, p)``."""
        if not self.has_slope:
            return
        along = np.swapaxes(poses, 1, 2) @ poses  # (k, p, p)
        size = np.trace(np.linalg.solve(information, along), axis1=1, axis2=2)
        along, size = along[size > 0], size[size > 0]
        along = along / size[:, None, None]
        stated = np.einsum("pq,kpq->k", self.slope(information), along)
        ahead, back = self.score(information + _STEP * along), self.score(information - _STEP * along)
        measured = (ahead - back) / (2 * _STEP)
        rounding = 1e-14 * np.abs(ahead).max(initial=1.0) / _STEP
        wrong = np.abs(stated - measured) > _SLOPE_TOLERANCE * np.abs(measured).max(initial=0.0) + rounding
        if wrong.any():
            i = int(np.argmax(wrong))
            raise LabError(
                f"criterion '{self.name}' has a slope that is not its score's: {stated[i]:.4g} along a pose where "
                f"differences of the score give {measured[i]:.4g}; correct it, or leave slope out"
            )


def _required(function: Callable[..., Array]) -> int:
    """Return the number of positional arguments that a function cannot do without."""
    try:
        parameters = inspect.signature(function).parameters.values()
    except ValueError:  # a function in C that does not describe itself
        return 1
    return sum(each.default is each.empty and each.kind < each.VAR_POSITIONAL for each in parameters)
