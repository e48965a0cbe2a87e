"""Motions and poses that show a load at the hand best: D-optimal Fourier paths, and D-optimal static poses.

A path is a Fourier series of each joint (Swevers, Ganseman, Tükel, De Schutter & Van Brussel 1997). It is sought like
the poses of ``design``: the best of a batch of random paths, then an ascent (``path_search``). The score is the
determinant of the information: the condition number is reported, and no goal. The arm is seen through plain callables.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lab.core.errors import LabError
from lab.core.progress import Progress, no_progress
from lab.core.se3 import Array
from lab.kinematics.dynamics.rigid_body import Dynamics
from lab.payload_identification.fourier_path import (
    CHECKED,
    HARMONICS,
    PERIOD_S,
    FourierPath,
    Limits,
    random_path,
    rest_shapes,
)
from lab.payload_identification.path_optimizer import Allowed, PathSearch
from lab.pose_selection.criteria import Criterion, criterion
from lab.pose_selection.exchange import Feasible, ascend, exchange, information

__all__ = [
    "RATE_HZ",
    "SECONDS",
    "PathDesign",
    "PoseDesign",
    "PredictedUncertainty",
    "Regressor",
    "design_path",
    "design_poses",
    "predicted",
]

Regressor = Callable[[Array, Array, Array], Array]
"""Joints, speeds and accelerations ``(n, J)`` to rows ``(n, r, p)``: what is read is linear in the p parameters."""

SECONDS, RATE_HZ = 10.0, 1000.0
_DRAWN, _CANDIDATES = 200, 2000  # random paths and poses
_SHRUNK = (1.0, 0.7, 0.5, 0.35, 0.2, 0.1)
_UNSHOWN = 1e-12  # least eigenvalue of the information of unit columns, of the largest


@dataclass(frozen=True)
class PredictedUncertainty:
    """How well parameters will be known.

    Attributes:
        covariance: ``(p, p)`` of the parameters, in the regressor's units and order.
        condition: of the regressor with its columns scaled to unit length. A path is not better for a lower one.
        score: log det of the information.
    """

    covariance: Array
    condition: float
    score: float

    @property
    def sigma(self) -> Array:
        """``(p,)`` standard deviations."""
        return np.sqrt(np.diag(self.covariance))

    @classmethod
    def of(cls, information: Array) -> "PredictedUncertainty":
        """From an information matrix ``(p, p)``.

        Raises:
            LabError: not every parameter is shown.
        """
        size = np.sqrt(np.maximum(np.diag(information), 1e-300))
        scaled = information / np.outer(size, size)
        values = np.linalg.eigvalsh(scaled)
        if values[0] < _UNSHOWN * values[-1]:
            raise LabError("the motion does not show every parameter; let more joints move, or free fewer parameters")
        score = float(np.log(values).sum() + 2 * np.log(size).sum())
        return cls(np.linalg.inv(scaled) / np.outer(size, size), float(np.sqrt(values[-1] / values[0])), score)


@dataclass(frozen=True)
class PathDesign:
    """A path, and how well it will show the parameters."""

    path: FourierPath
    prediction: PredictedUncertainty


@dataclass(frozen=True)
class PoseDesign:
    """Static poses ``(n, J)``, and how well they will show the parameters."""

    joints: Array
    prediction: PredictedUncertainty


def predicted(
    path: FourierPath, regressor: Regressor, sigma: Array, seconds: float = SECONDS, rate_hz: float = RATE_HZ
) -> PredictedUncertainty:
    """What a path will show of the parameters.

    Args:
        sigma: ``(r,)``, standard deviation of a sample's rows.
    """
    rows = regressor(*path.at(path.period_s * np.arange(CHECKED) / CHECKED)) / sigma[:, None]
    return PredictedUncertainty.of(seconds * rate_hz / CHECKED * information(rows))


def design_path(
    regressor: Regressor,
    sigma: Array,
    limits: Limits,
    feasible: Feasible,
    rng: np.random.Generator,
    *,
    torque: Dynamics | None = None,
    seconds: float = SECONDS,
    rate_hz: float = RATE_HZ,
    period_s: float = PERIOD_S,
    goal: Criterion | None = None,
    starts: int = 4,
    rounds: int = 12,
    at_rest: bool = False,
    drawn: int = _DRAWN,
    progress: Progress = no_progress,
) -> PathDesign:
    """The path that shows the parameters best, as far as is found; one generator state gives one path.

    Args:
        regressor: of the parameters; those of no interest (offsets) may be among them.
        sigma: ``(r,)``, standard deviation of a sample's rows: of a difference of torques, √2 of one's.
        feasible: whether readings ``(n, J)`` touch nothing.
        torque: of the joints, to be kept within the limits' torque; needed where that is finite.
        seconds, rate_hz: how long and how often is measured.
        goal: another criterion than the determinant, of whitened rows in the regressor's units: to compare.
        starts: random paths to ascend from.
        rounds: ascents from each.
        at_rest: whether each period is to begin and end at rest.
        drawn: random paths, of which the best are taken.

    Raises:
        LabError: no random path is allowed, or one does not show every parameter.
    """
    allowed = _allowance(limits, feasible, torque)
    paths = [random_path(limits, rng, period_s, at_rest=at_rest) for _ in range(drawn)]
    shapes = rest_shapes(HARMONICS) if at_rest else np.eye(1 + 2 * HARMONICS)

    def whitened(joints: Array, speeds: Array, accelerations: Array) -> Array:
        rows: Array = regressor(joints, speeds, accelerations) / sigma[:, None]
        return rows

    columns = predicted(paths[0], regressor, sigma).covariance.shape[0]
    search = PathSearch(whitened, goal or criterion("O1", columns), limits.box, allowed, period_s, shapes)
    best = (-np.inf, shapes.T @ paths[0].coefficients)
    for i, start in enumerate(_started(search, [shapes.T @ path.coefficients for path in paths], starts)):
        best = max(best, (search.score(start), start), key=_first)
        for j, (path, score) in enumerate(search.ascents(start, rounds)):
            progress(i * rounds + j + 1, starts * rounds)
            best = max(best, (score, path), key=_first)
    progress(starts * rounds, starts * rounds)
    found = FourierPath(shapes @ best[1], period_s)
    return PathDesign(found, predicted(found, regressor, sigma, seconds, rate_hz))


def _first(scored: tuple[float, Array]) -> float:
    return scored[0]


def design_poses(
    regressor: Regressor,
    sigma: Array,
    count: int,
    limits: Limits,
    feasible: Feasible,
    rng: np.random.Generator,
    *,
    torque: Dynamics | None = None,
) -> PoseDesign:
    """The static poses that show the parameters best: exchange among random ones, then an ascent (``design``).

    Args:
        regressor: of parameters that show at rest: mass and first moment, a sensor's offsets.
        sigma: ``(r,)``, standard deviation of a pose's rows.
        feasible: whether readings ``(n, J)`` touch nothing.
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
    best = ascend(chosen, rows, goal, may, limits.lower, limits.upper)
    return PoseDesign(best.joints, PredictedUncertainty.of(information(best.jacobian)))


def _allowance(limits: Limits, feasible: Feasible, torque: Dynamics | None) -> Allowed:
    limited = bool(np.isfinite(limits.torque).any())
    if limited and torque is None:
        raise LabError("torques are limited, but nothing says what they are: give the arm's dynamics")

    def allowed(states: Array) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
        free = feasible(states[:, 0])
        if not limited or torque is None:
            return free, np.ones(len(states), dtype=np.bool_)
        needed = np.abs(torque(states[:, 0], states[:, 1], states[:, 2]))
        return free, np.asarray((needed <= limits.torque).all(axis=1))

    return allowed


def _started(search: PathSearch, paths: list[Array], starts: int) -> list[Array]:
    """The best of the random paths that are allowed, after each has shrunk until it is."""
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
    found.sort(key=_first, reverse=True)
    return [coefficients for _, coefficients in found[:starts]]
