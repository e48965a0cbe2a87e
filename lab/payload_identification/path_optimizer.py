"""The ascent of a Fourier path: its coefficients uphill, within limits, and around what is forbidden.

Limits of readings, speeds and accelerations are linear in the coefficients and enter as walls, squares of what is
beyond. What else is forbidden (contacts, torques) is known only as yes or no: where a proposed path is forbidden at
some time, the way there from the last allowed path is bisected, and a wall put there across it, in the space of that
time's readings (with speeds and accelerations, for torques). The walls that matter are so found one after the other,
as in a cutting-plane method (Kelley 1960).
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize

from lab.core.se3 import Array
from lab.payload_identification.fourier_path import CHECKED, Box, bases
from lab.pose_selection.criteria import Criterion
from lab.pose_selection.exchange import information

__all__ = ["Allowed", "PathSearch"]

Allowed = Callable[[Array], tuple[NDArray[np.bool_], NDArray[np.bool_]]]
"""States ``(n, 3, J)`` (reading, speed, acceleration) to whether each is free of contacts, and within the torques."""

_SAMPLES = 96  # of a period, during the ascent
_STEP = 1e-6  # of forward differences, rad or m, per s and s^2
_NEAR = 0.995  # of a limit, where its wall begins; readings, speeds and accelerations are in units of theirs
_LIMIT_WALL, _CUT_WALL = 30.0, 100.0  # weights of the squares
_BEFORE = 0.01  # of a limit: a wall stands so far before what is forbidden
_BISECTIONS, _ITERATIONS = 7, 60
_SHARES = (1.0, 0.5, 0.25, 0.1, 0.03)
_GAIN = 1e-3  # of the score: with less to win, an ascent is over


@dataclass
class _Walls:
    """What was found to be forbidden: at times ``rows`` ``(c,)``, states with normal . state above ``bound``."""

    rows: NDArray[np.int_] = field(default_factory=lambda: np.empty(0, dtype=np.int_))
    normals: Array = field(default_factory=lambda: np.empty((0, 3, 0)))  # (c, 3, J), states in units of the box
    bounds: Array = field(default_factory=lambda: np.empty(0))

    def add(self, rows: NDArray[np.int_], normals: Array, bounds: Array) -> None:
        self.rows = np.concatenate([self.rows, rows])
        self.normals = np.concatenate([self.normals.reshape(-1, *normals.shape[1:]), normals])
        self.bounds = np.concatenate([self.bounds, bounds])


class PathSearch:
    """One question: a whitened regressor, a criterion, a box, and what else is allowed."""

    def __init__(
        self,
        regressor: Callable[[Array, Array, Array], Array],
        goal: Criterion,
        box: Box,
        allowed: Allowed,
        period_s: float,
        shapes: Array,
    ) -> None:
        """The regressor gives whitened rows ``(n, r, p)`` at readings, speeds and accelerations.

        Args:
            shapes: ``(1 + 2 h, s)`` orthonormal columns, the constant first: a path's Fourier coefficients are these
                times what is sought ``(s, J)``.
        """
        self._regressor, self._goal, self.box, self._allowed = regressor, goal, box, allowed
        harmonics = len(shapes) // 2
        self._coarse = bases(period_s * np.arange(_SAMPLES) / _SAMPLES, period_s, harmonics) @ shapes
        self.fine = bases(period_s * np.arange(CHECKED) / CHECKED, period_s, harmonics) @ shapes
        order = np.concatenate([[1], *[np.arange(1, harmonics + 1)] * 2])
        self._scale = 1 / (order @ shapes**2)[:, None]  # a harmonic's speed grows with its order

    def states(self, coefficients: Array) -> Array:
        """``(n, 3, J)`` along a path, at the times checked."""
        motion: Array = self.fine @ coefficients
        return motion.transpose(1, 0, 2)

    def score(self, coefficients: Array) -> float:
        """The criterion's."""
        rows = self._regressor(*(self._coarse @ coefficients))
        return float(self._goal.score(information(rows)))

    def is_allowed(self, coefficients: Array) -> bool:
        """Whether the path touches nothing and keeps to the torques, looked at coarsely first."""
        states = self.states(coefficients)
        return all(self._may(states[part]).all() for part in (slice(None, None, 25), slice(None)))

    def _may(self, states: Array) -> NDArray[np.bool_]:
        free, strong = self._allowed(states)
        return free & strong

    def ascents(self, path: Array, rounds: int) -> Iterator[tuple[Array, float]]:
        """Better and better allowed paths with their scores; ``path`` is allowed and within the box."""
        walls, score = _Walls(), self.score(path)
        for _ in range(rounds):
            proposal = self.box.fitted(self._proposed(path, walls), self.fine)
            hoped = self.score(proposal)
            if hoped < score + _GAIN:
                return
            free, strong = self._allowed(self.states(proposal))
            if not (free & strong).all():
                self._wall_off(walls, path, proposal, free, strong)
            for share in _SHARES:
                tried = path + share * (proposal - path)
                if (reached := self.score(tried)) > score and self.is_allowed(tried):
                    path, score = tried, reached
                    break
            yield path, score

    def _wall_off(
        self, walls: _Walls, path: Array, proposal: Array, free: NDArray[np.bool_], strong: NDArray[np.bool_]
    ) -> None:
        """A wall for each time at which the proposal is forbidden, across the way to it."""
        rows = np.flatnonzero(~(free & strong))
        start = self.states(path)[rows]
        way = self.states(proposal)[rows] - start
        near, far = np.zeros((len(rows), 1, 1)), np.ones((len(rows), 1, 1))
        for _ in range(_BISECTIONS):
            middle = (near + far) / 2
            may = self._may(start + middle * way)[:, None, None]
            near, far = np.where(may, middle, near), np.where(may, far, middle)
        normals = way / self.box.half
        normals[~free[rows], 1:] = 0.0  # a contact asks for readings alone
        size = np.sqrt((normals**2).sum(axis=(1, 2)))
        normals /= np.maximum(size, 1e-12)[:, None, None]
        walls.add(rows, normals, (normals * (start + near * way) / self.box.half).sum(axis=(1, 2)) - _BEFORE)

    def _proposed(self, path: Array, walls: _Walls) -> Array:
        """Where a quasi-Newton ascent takes a path, held by walls alone."""

        def downhill(flat: Array) -> tuple[float, Array]:
            coefficients = self._scale * flat.reshape(path.shape)
            score, slope = self._slope(coefficients)
            height, steepness = self._climbed(coefficients, walls)
            return height - score, (self._scale * (steepness - slope)).ravel()

        solved = minimize(
            downhill, (path / self._scale).ravel(), jac=True, method="L-BFGS-B", options={"maxiter": _ITERATIONS}
        )
        proposal: Array = self._scale * solved.x.reshape(path.shape)
        return proposal

    def _slope(self, coefficients: Array) -> tuple[float, Array]:
        """The score, and its derivatives by the coefficients.

        With M = sum of W'W and S the score's slope by M, it is 2 <W S, dW>: dW by forward differences of each
        sample's reading, speed and acceleration, then the chain rule through the series.
        """
        motion = self._coarse @ coefficients  # (3, n, J)
        size = coefficients.shape[1]
        around = np.tile(motion[:, None], (1, 1 + 3 * size, 1, 1))  # (3, moved, n, J)
        for kind in range(3):
            for joint in range(size):
                around[kind, 1 + kind * size + joint, :, joint] += _STEP
        rows = self._regressor(*around.reshape(3, -1, size))
        here = rows[:_SAMPLES]
        total = information(here)
        pull = (here @ self._goal.slope(total)).reshape(_SAMPLES, -1)
        rows = rows.reshape(1 + 3 * size, _SAMPLES, -1)  # (moved, n, r p)
        by_state = 2 * np.einsum("nx,mnx->mn", pull, (rows[1:] - rows[0]) / _STEP)
        by_state = by_state.reshape(3, size, _SAMPLES)
        return float(self._goal.score(total)), np.einsum("kns,kjn->sj", self._coarse, by_state)

    def _climbed(self, coefficients: Array, walls: _Walls) -> tuple[float, Array]:
        """How far a path is up the walls, and the derivatives by the coefficients."""
        half = self.box.half[:, None]
        beyond = (self._coarse @ coefficients - self.box.middle[:, None]) / half  # (3, n, J)
        over = np.sign(beyond) * np.maximum(np.abs(beyond) - _NEAR, 0.0)
        height = _LIMIT_WALL * float((over**2).sum())
        slope = 2 * _LIMIT_WALL * np.einsum("kns,knj->sj", self._coarse, over / half)
        if len(walls.rows):
            basis = self.fine[:, walls.rows]
            states = (basis @ coefficients).transpose(1, 0, 2) / self.box.half
            deep = np.maximum((walls.normals * states).sum(axis=(1, 2)) - walls.bounds, 0.0)
            height += _CUT_WALL * float((deep**2).sum())
            pushed = deep[:, None, None] * walls.normals / self.box.half
            slope = slope + 2 * _CUT_WALL * np.einsum("kns,nkj->sj", basis, pushed)
        return height, slope
