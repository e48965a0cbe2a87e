"""Design D-optimal Fourier paths and D-optimal static poses that identify a load.

A path is a Fourier series of each joint (Swevers, Ganseman, Tükel, De Schutter & Van Brussel 1997). The search is that
of ``design``: the best of a batch of random paths, then an ascent of its coefficients, within limits and around
collisions (``PathSearch``). The score is the determinant of the information.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from operator import itemgetter

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize

from lab.core.errors import LabError
from lab.core.se3 import Array
from lab.kinematics.dynamics.rigid_body import Dynamics
from lab.kinematics.serial.chain import Chain
from lab.pose_selection.criteria import Criterion, criterion
from lab.pose_selection.exchange import Feasible, OneCriterion, climb, exchange, information
from lab.pose_selection.tour import rated

__all__ = [
    "CHECKED",
    "PERIOD_S",
    "Box",
    "FourierPath",
    "Limits",
    "PathSearch",
    "Regressor",
    "design_path",
    "design_poses",
    "random_path",
]

PERIOD_S, _HARMONICS = 5.0, 5
_MARGIN = 0.02  # of a joint's range, from each limit
CHECKED = 1000  # times of a period at which limits, contacts and torques are checked
_LIMIT_SHARE = 0.999  # of a limit of speed or acceleration, with a reserve for the time between


def _basis(times: Array, period_s: float, harmonics: int) -> Array:
    """Return the functions of a Fourier series and their two derivatives by time, ``(3, n, 1 + 2 h)``."""
    rates = 2 * np.pi / period_s * np.arange(1, harmonics + 1)
    phase = np.outer(times, rates)
    one, cosine, sine = np.ones((len(times), 1)), np.cos(phase), np.sin(phase)
    return np.stack(
        [
            np.hstack([one, cosine, sine]),
            np.hstack([0 * one, -rates * sine, rates * cosine]),
            np.hstack([0 * one, -(rates**2) * cosine, -(rates**2) * sine]),
        ]
    )


def _rest_shapes(harmonics: int) -> Array:
    """Return orthonormal columns ``(1 + 2 h, 2 h - 1)`` of series at rest at the beginning and end of a period.

    A series whose speed and acceleration vanish there has coefficients with sum k s_k = 0 and sum k^2 c_k = 0 (e.g.
    Swevers, Verdonck & De Schutter 2007): the orthogonal complement of these. The first column is the constant.
    """
    order = np.arange(1, harmonics + 1, dtype=np.float64)
    shapes = np.zeros((1 + 2 * harmonics, 2 * harmonics - 1))
    shapes[0, 0] = 1.0
    for i, moving in enumerate((order**2, order)):
        rows = slice(1 + i * harmonics, 1 + (i + 1) * harmonics)
        free = np.linalg.svd(moving[None])[2][1:].T
        shapes[rows, 1 + i * (harmonics - 1) : 1 + (i + 1) * (harmonics - 1)] = free
    return shapes


@dataclass(frozen=True)
class FourierPath:
    """A periodic path: each joint a constant and h harmonics.

    Attributes:
        coefficients: ``(1 + 2 h, J)`` rad or m: the middle, h cosines, h sines.
        period_s: of the first harmonic.
    """

    coefficients: Array
    period_s: float = PERIOD_S

    def at(self, times: Array) -> tuple[Array, Array, Array]:
        """Return readings, speeds and accelerations ``(n, J)`` at times ``(n,)`` s."""
        joints, speeds, accelerations = _basis(times, self.period_s, len(self.coefficients) // 2) @ self.coefficients
        return joints, speeds, accelerations


@dataclass(frozen=True)
class Box:
    """Bounds of a path: within ``half`` of ``middle``, ``(3, J)`` of joint positions, speeds and accelerations."""

    middle: Array
    half: Array

    def fitted(self, coefficients: Array, basis: Array) -> Array:
        """Shrink and shift each joint's motion into the box: coefficients ``(1 + 2 h, J)``."""
        motion = basis[:, :, 1:] @ coefficients[1:]  # (3, n, J)
        largest = np.abs(motion[1:]).max(axis=1) / (_LIMIT_SHARE * self.half[1:])
        span = np.ptp(motion[0], axis=0) / (2 * self.half[0])
        fitted = coefficients.copy()
        fitted[1:] /= np.maximum(1.0, np.maximum(span, largest.max(axis=0)))
        swing = basis[0][:, 1:] @ fitted[1:]
        least = self.middle[0] - self.half[0] - swing.min(axis=0)
        most = self.middle[0] + self.half[0] - swing.max(axis=0)
        fitted[0] = np.clip(fitted[0], least, np.maximum(least, most))
        return fitted


@dataclass(frozen=True)
class Limits:
    """Limits of the joints, ``(J,)`` each in rad or m; infinite where a torque (Nm, N) has no limit."""

    lower: Array
    upper: Array
    speed: Array
    acceleration: Array
    torque: Array

    def __post_init__(self) -> None:
        for name in ("speed", "acceleration", "torque"):
            value = getattr(self, name)
            if not (value > 0).all() or (name != "torque" and not np.isfinite(value).all()):
                raise LabError(f"a path's largest {name} is {value}; give a number above zero for every joint")

    @property
    def box(self) -> Box:
        """Limits of readings, speeds and accelerations."""
        middle, still = (self.lower + self.upper) / 2, np.zeros_like(self.lower)
        half = np.array([(self.upper - self.lower) / 2, self.speed, self.acceleration])
        return Box(np.array([middle, still, still]), half)

    @classmethod
    def of(cls, chain: Chain, torque: Array | None = None, margin: float = _MARGIN) -> "Limits":
        """Return a chain's limits with a margin of each range; representative rates by default (``tour.rated``)."""
        distance, rates = margin * (chain.upper - chain.lower), rated(chain)[0]
        return cls(
            chain.lower + distance,
            chain.upper - distance,
            rates.speed,
            rates.acceleration,
            np.full(chain.size, np.inf) if torque is None else torque,
        )


def random_path(
    limits: Limits, rng: np.random.Generator, period_s: float = PERIOD_S, *, at_rest: bool = False
) -> FourierPath:
    """Draw a path of random coefficients, each joint as fast and as far as its limits allow.

    Args:
        at_rest: begin and end each period at rest.
    """
    order = np.arange(1, _HARMONICS + 1)
    drawn = rng.standard_normal((1 + 2 * _HARMONICS, len(limits.lower)))
    drawn[1:] *= 10 * limits.box.half[0] / np.concatenate([order, order])[:, None] ** rng.uniform(0.0, 2.0)
    drawn[0] = rng.uniform(limits.lower, limits.upper)
    if at_rest:
        shapes = _rest_shapes(_HARMONICS)
        drawn = shapes @ (shapes.T @ drawn)
    times = period_s * np.arange(CHECKED) / CHECKED
    return FourierPath(limits.box.fitted(drawn, _basis(times, period_s, _HARMONICS)), period_s)


_Allowed = Callable[[Array], tuple[NDArray[np.bool_], NDArray[np.bool_]]]
"""States ``(n, 3, J)`` (reading, speed, acceleration) to whether each is free of contacts, and within the torques."""

_SAMPLES = 96  # of a period, during the ascent
_STEP = 1e-6  # of forward differences, rad or m, per s and s^2
_NEAR = 0.995  # of a limit, where its penalty begins; readings, speeds and accelerations are in units of theirs
_LIMIT_WALL, _CUT_WALL = 30.0, 100.0  # weights of the squares
_BEFORE = 0.01  # of a limit: distance of a wall before a forbidden state
_BISECTIONS, _ITERATIONS = 7, 60
_SHARES = (1.0, 0.5, 0.25, 0.1, 0.03)
_MIN_GAIN = 1e-3  # of the score: below, an ascent ends


@dataclass
class _Walls:
    """Linear constraints: at times ``rows`` ``(c,)``, states with normal . state above ``bound`` are forbidden."""

    rows: NDArray[np.int_] = field(default_factory=lambda: np.empty(0, dtype=np.int_))
    normals: Array = field(default_factory=lambda: np.empty((0, 3, 0)))  # (c, 3, J), states in units of the box
    bounds: Array = field(default_factory=lambda: np.empty(0))

    def add(self, rows: NDArray[np.int_], normals: Array, bounds: Array) -> None:
        self.rows = np.concatenate([self.rows, rows])
        self.normals = np.concatenate([self.normals.reshape(-1, *normals.shape[1:]), normals])
        self.bounds = np.concatenate([self.bounds, bounds])


class PathSearch:
    """An optimal excitation problem: a whitened regressor, a criterion, bounds and further constraints."""

    def __init__(
        self,
        regressor: Callable[[Array, Array, Array], Array],
        goal: Criterion,
        box: Box,
        allowed: _Allowed,
        period_s: float,
        shapes: Array,
    ) -> None:
        """Create a search for a regressor of whitened rows ``(n, r, p)`` at readings, speeds and accelerations.

        Args:
            shapes: ``(1 + 2 h, s)`` orthonormal columns, the constant first: a path's Fourier coefficients are these
                times the coefficients of the search ``(s, J)``.
        """
        self._regressor, self._goal, self.box, self._allowed = regressor, goal, box, allowed
        harmonics = len(shapes) // 2
        self._coarse = _basis(period_s * np.arange(_SAMPLES) / _SAMPLES, period_s, harmonics) @ shapes
        self.fine = _basis(period_s * np.arange(CHECKED) / CHECKED, period_s, harmonics) @ shapes
        order = np.concatenate([[1], *[np.arange(1, harmonics + 1)] * 2])
        self._scale = 1 / (order @ shapes**2)[:, None]  # a harmonic's speed grows with its order

    def states(self, coefficients: Array) -> Array:
        """Return the states ``(n, 3, J)`` along a path, at the checked times."""
        motion: Array = self.fine @ coefficients
        return motion.transpose(1, 0, 2)

    def score(self, coefficients: Array) -> float:
        """Return the criterion's score."""
        rows = self._regressor(*(self._coarse @ coefficients))
        return float(self._goal.score(information(rows)))

    def is_allowed(self, coefficients: Array) -> bool:
        """Decide whether the path is free of collisions and within torque limits, on a coarse grid first."""
        states = self.states(coefficients)
        return all(self._may(states[part]).all() for part in (slice(None, None, 25), slice(None)))

    def _may(self, states: Array) -> NDArray[np.bool_]:
        free, strong = self._allowed(states)
        return free & strong

    def ascents(self, path: Array, rounds: int) -> Iterator[tuple[Array, float]]:
        """Yield ever better allowed paths with their scores; ``path`` is allowed and within the box."""
        walls, score = _Walls(), self.score(path)
        for _ in range(rounds):
            proposal = self.box.fitted(self._proposed(path, walls), self.fine)
            hoped = self.score(proposal)
            if hoped < score + _MIN_GAIN:
                return
            free, strong = self._allowed(self.states(proposal))
            if not (free & strong).all():
                self._add_walls(walls, path, proposal, free, strong)
            for share in _SHARES:
                tried = path + share * (proposal - path)
                if (reached := self.score(tried)) > score and self.is_allowed(tried):
                    path, score = tried, reached
                    break
            yield path, score

    def _add_walls(
        self, walls: _Walls, path: Array, proposal: Array, free: NDArray[np.bool_], strong: NDArray[np.bool_]
    ) -> None:
        """Add a wall for each time at which the proposal is forbidden, across the line to it."""
        rows = np.flatnonzero(~(free & strong))
        start = self.states(path)[rows]
        change = self.states(proposal)[rows] - start
        near, far = np.zeros((len(rows), 1, 1)), np.ones((len(rows), 1, 1))
        for _ in range(_BISECTIONS):
            middle = (near + far) / 2
            may = self._may(start + middle * change)[:, None, None]
            near, far = np.where(may, middle, near), np.where(may, far, middle)
        normals = change / self.box.half
        normals[~free[rows], 1:] = 0.0  # a contact depends on readings alone
        size = np.sqrt((normals**2).sum(axis=(1, 2)))
        normals /= np.maximum(size, 1e-12)[:, None, None]
        walls.add(rows, normals, (normals * (start + near * change) / self.box.half).sum(axis=(1, 2)) - _BEFORE)

    def _proposed(self, path: Array, walls: _Walls) -> Array:
        """Return the path of a quasi-Newton ascent, with the linear constraints alone."""

        def downhill(flat: Array) -> tuple[float, Array]:
            coefficients = self._scale * flat.reshape(path.shape)
            score, slope = self._slope(coefficients)
            height, steepness = self._penalty(coefficients, walls)
            return height - score, (self._scale * (steepness - slope)).ravel()

        solved = minimize(
            downhill, (path / self._scale).ravel(), jac=True, method="L-BFGS-B", options={"maxiter": _ITERATIONS}
        )
        proposal: Array = self._scale * solved.x.reshape(path.shape)
        return proposal

    def _slope(self, coefficients: Array) -> tuple[float, Array]:
        """Return the score, and its derivatives by the coefficients.

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

    def _penalty(self, coefficients: Array, walls: _Walls) -> tuple[float, Array]:
        """Return the penalty of a path for its constraint violations, with its gradient by the coefficients."""
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


Regressor = Callable[[Array, Array, Array], Array]
"""Joints, speeds and accelerations ``(n, J)`` to rows ``(n, r, p)``: readings are linear in the p parameters."""

_PATHS, _CANDIDATES = 200, 2000  # random paths and poses
_SHRUNK = (1.0, 0.7, 0.5, 0.35, 0.2, 0.1)
_MIN_EIGENVALUE = 1e-12  # least eigenvalue of the information of unit columns, of the largest


def _refuse_unshown(information: Array) -> None:
    """Refuse a motion whose information ``(p, p)`` does not show every parameter, with a LabError."""
    size = np.sqrt(np.maximum(np.diag(information), 1e-300))
    values = np.linalg.eigvalsh(information / np.outer(size, size))
    if values[0] < _MIN_EIGENVALUE * values[-1]:
        raise LabError("the motion does not show every parameter; let more joints move, or free fewer parameters")


def design_path(
    regressor: Regressor,
    sigma: Array,
    limits: Limits,
    feasible: Feasible,
    rng: np.random.Generator,
    *,
    torque: Dynamics | None = None,
    period_s: float = PERIOD_S,
    starts: int = 4,
    rounds: int = 12,
    at_rest: bool = False,
    drawn: int = _PATHS,
) -> FourierPath:
    """Search the D-optimal path; one generator state gives one path.

    Args:
        regressor: of the parameters, with nuisances (offsets).
        sigma: ``(r,)``, standard deviation of a sample's rows: of a difference of torques, √2 of one's.
        feasible: readings ``(n, J)`` to collision-free ones.
        torque: of the joints, within the limits' torque; needed where that is finite.
        starts: random paths to ascend from.
        rounds: ascents from each.
        at_rest: begin and end each period at rest.
        drawn: number of random paths, of which the best are taken.

    Raises:
        LabError: no random path is allowed, or one does not show every parameter.
    """
    allowed = _allowance(limits, feasible, torque)
    paths = [random_path(limits, rng, period_s, at_rest=at_rest) for _ in range(drawn)]
    shapes = _rest_shapes(_HARMONICS) if at_rest else np.eye(1 + 2 * _HARMONICS)

    def whitened(joints: Array, speeds: Array, accelerations: Array) -> Array:
        rows: Array = regressor(joints, speeds, accelerations) / sigma[:, None]
        return rows

    rows = whitened(*paths[0].at(period_s * np.arange(CHECKED) / CHECKED))
    _refuse_unshown(information(rows))
    search = PathSearch(whitened, criterion("O1", rows.shape[2]), limits.box, allowed, period_s, shapes)
    best = (-np.inf, shapes.T @ paths[0].coefficients)
    for start in _started(search, [shapes.T @ path.coefficients for path in paths], starts):
        best = max(best, (search.score(start), start), key=itemgetter(0))
        for path, score in search.ascents(start, rounds):
            best = max(best, (score, path), key=itemgetter(0))
    return FourierPath(shapes @ best[1], period_s)


def design_poses(
    regressor: Regressor,
    sigma: Array,
    count: int,
    limits: Limits,
    feasible: Feasible,
    rng: np.random.Generator,
    *,
    torque: Dynamics | None = None,
) -> Array:
    """Search D-optimal static poses ``(count, J)``: exchange among random ones, then an ascent (``design``).

    Args:
        regressor: of parameters observable at rest: mass and first moment, a sensor's offsets.
        sigma: ``(r,)``, standard deviation of a pose's rows.
        feasible: readings ``(n, J)`` to collision-free ones.
        torque: as in ``design_path``.

    Raises:
        LabError: too few poses are allowed, or so many do not show every parameter.
    """
    allowed = _allowance(limits, feasible, torque)

    def may(joints: Array) -> NDArray[np.bool_]:
        free, strong = allowed(np.stack([joints, 0 * joints, 0 * joints], axis=1))
        return free & strong

    def rows(joints: Array) -> Array:
        whitened: Array = regressor(joints, 0 * joints, 0 * joints) / sigma[:, None]
        return whitened

    drawn = rng.uniform(limits.lower, limits.upper, (_CANDIDATES, len(limits.lower)))
    candidates = drawn[may(drawn)]
    if len(candidates) < count:
        raise LabError(
            f"only {len(candidates)} of {_CANDIDATES} random poses are allowed, {count} asked for: ask fewer"
        )
    jacobian = rows(candidates)
    goal = criterion("O1", jacobian.shape[2])
    chosen = exchange(candidates, jacobian, count, goal, rng)
    best = climb(chosen, OneCriterion(rows, goal), may, limits.lower, limits.upper)
    _refuse_unshown(information(best.jacobian))
    return np.asarray(best.joints)


def _allowance(limits: Limits, feasible: Feasible, torque: Dynamics | None) -> _Allowed:
    limited = bool(np.isfinite(limits.torque).any())
    if limited and torque is None:
        raise LabError("torques are limited, but unknown: give the arm's dynamics")

    def allowed(states: Array) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
        free = feasible(states[:, 0])
        if not limited or torque is None:
            return free, np.ones(len(states), dtype=np.bool_)
        needed = np.abs(torque(states[:, 0], states[:, 1], states[:, 2]))
        return free, np.asarray((needed <= limits.torque).all(axis=1))

    return allowed


def _started(search: PathSearch, paths: list[Array], starts: int) -> list[Array]:
    """Return the best of the random paths, each shrunk until it is allowed."""
    found: list[tuple[float, Array]] = []
    for path in paths:
        for share in _SHRUNK:
            tried = path * np.append(1.0, np.full(len(path) - 1, share))[:, None]
            if search.is_allowed(tried):
                found.append((search.score(tried), tried))
                break
    if not found:
        raise LabError(
            f"none of {len(paths)} random paths keeps free of contacts and within the torques: give more room"
        )
    found.sort(key=itemgetter(0), reverse=True)
    return [coefficients for _, coefficients in found[:starts]]
