"""Predict errors at poses beyond the measured joint positions.

The covariance of the parameters holds if the model does, and a model that follows every measurement may be wrong
elsewhere: a spurious wave, a nonlinear spring. Let joint j be off beyond an edge of its measured range by a slope times
the distance. Beside the fit, each outer tenth of a joint's positions gives one estimate of such a slope. Their variance
in excess of the noise (Paule & Mandel 1982) is that of the slope beyond the true edges, unless a joint's own two are
larger. Farther out than that tenth is wide the slope changes itself: its integral grows as d^1.5, as a random walk's
does, and no more than one radian of distance counts.

Within the range, poses are parted into regions of joint space. Each is left out in turn, the linear model is solved by
the others, and the errors e of the poses that the others do not cover are compared with their covariance V by noise and
parameters. Where they are larger (at 1 %), every joint is taken to be off by s d, with d the distance beyond the cover
in units of its reach: s is where the sum of e' (V + s^2 d^2 S S')^-1 e is as expected, with S the derivatives by the
joints. Effects are then trusted only where they were measured: elsewhere the model discrepancy is that of geometry
without them, and what they explain counts as unknown, beyond an end as much of it as an outer tenth's width.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import scipy  # its parts are loaded at their first use, which not every process comes to
from numpy.typing import NDArray

from lab.calibration.gauss_newton import Observations
from lab.calibration.identification import Identification
from lab.calibration.observation import observation_of, only_positions
from lab.calibration.row_groups import SAME_CONFIGURATION, configurations
from lab.calibration.statistics.joint_rounding import by_joint_positions
from lab.core.linear_model import LinearModel, matched_dof, p_value_of_squares, unit_columns
from lab.core.measurements import evenly
from lab.core.probability import chi2_sf
from lab.core.random import rng_for
from lab.core.se3 import Array
from lab.core.significance import EXTRAPOLATION
from lab.kinematics.effects.effect import LEVER_M
from lab.kinematics.effects.effect_registry import CAMPAIGN_SPECIFIC
from lab.kinematics.effects.range_errors import RANGE
from lab.kinematics.effects.sessions import GROUP as STATIONS
from lab.kinematics.effects.steps import STEPS
from lab.kinematics.model import Model
from lab.prediction.residual_spread import ResidualSpread

__all__ = [
    "MOST_UNCOVERED",
    "MeasuredRange",
    "PoseCover",
    "distinct_poses",
    "joint_regions",
    "measured_range",
    "model_covariances",
    "neighbours",
    "position_covariances",
]

MOST_UNCOVERED = 0.5  # of a workspace, targets or poses: where more is extrapolated, nothing is good without a word
_NEAREST = 3  # measured poses that are near a covered one
_COVERED = 0.95  # of the measured poses are as near to others
_FEW_PAIRS = 40_000  # of poses, whose distances are found sooner than a tree of them is built
_MAX_COVER_POSES = 4_000  # measured poses among which the near ones are sought


@dataclass(frozen=True)
class PoseCover:
    """Distinct measured joint positions, and which others are near to some of them.

    Distances are chords of hinges; those of slides are in units of a lever. A pose is covered if the third nearest
    measured one is no farther away than that of 95 % of the measured ones. Repeats of a pose cover nothing more.

    Attributes:
        poses: ``(n, joints)`` rad or m, without repeats.
        turning: ``(joints,)`` whether a whole turn leads a joint back to where it was.
    """

    poses: Array
    turning: NDArray[np.bool_]

    @classmethod
    def of(cls, joints: Array, turning: NDArray[np.bool_], *, repeated: bool = True) -> "PoseCover":
        """Build the cover of measured positions ``(n, joints)``: distinct ones, of many a subset, evenly spaced.

        Args:
            repeated: whether some may be repeats of others.
        """
        distinct = joints[distinct_poses(joints, turning)[0]] if repeated else joints
        some = evenly(len(distinct), _MAX_COVER_POSES)
        return cls(distinct if some is None else distinct[some], turning)

    def beyond(self, joints: Array) -> Array:
        """Return distances ``(n,)`` of positions ``(n, joints)`` beyond the covered ones, in units of their reach."""
        if len(self.poses) <= _NEAREST:
            return np.zeros(len(joints))
        away = self._distances(_around(joints, self.turning), _NEAREST)
        return np.asarray(np.maximum(away / self._reach - 1, 0.0))

    @cached_property
    def _around(self) -> Array:
        return _around(self.poses, self.turning)

    @cached_property
    def _reach(self) -> float:
        return float(np.quantile(self._distances(self._around, _NEAREST + 1), _COVERED))

    @cached_property
    def _tree(self) -> "scipy.spatial.cKDTree":
        return scipy.spatial.cKDTree(self._around)

    def _distances(self, around: Array, count: int) -> Array:
        """Return the distance of each of ``(n, 2 joints)`` to its ``count``-th nearest pose: of few, by all pairs."""
        if len(around) * len(self.poses) > _FEW_PAIRS:
            return np.asarray(self._tree.query(around, k=count)[0][:, -1])
        pairs = scipy.spatial.distance.cdist(around, self._around)
        return np.asarray(np.partition(pairs, count - 1, axis=1)[:, count - 1])


def distinct_poses(joints: Array, turning: NDArray[np.bool_]) -> tuple[NDArray[np.int_], NDArray[np.int_]]:
    """Find which joint positions are repeats: chords to a pose before them of no more than ``SAME_CONFIGURATION``.

    Poses of a dense path are no repeats of each other: along it, one is left at each such distance.

    Args:
        joints: ``(n, joints)`` rad or m.
        turning: ``(joints,)`` which joints turn.

    Returns:
        Rows ``(m,)`` of the distinct poses, ascending, and ``(n,)`` which of these each row repeats.
    """
    around = _around(joints, turning)
    labels = configurations(around)
    alone = np.bincount(labels)[labels] == 1
    if alone.all():
        return np.arange(len(joints)), np.arange(len(joints))
    tree, which = scipy.spatial.cKDTree(around), np.full(len(joints), -1)
    rows: list[int] = []
    for row in range(len(joints)):
        if which[row] < 0:
            near = row if alone[row] else np.array(tree.query_ball_point(around[row], SAME_CONFIGURATION, p=np.inf))
            which[near] = np.where(which[near] < 0, len(rows), which[near])
            rows.append(row)
    return np.array(rows, dtype=np.int_), which


def neighbours(joints: Array, turning: NDArray[np.bool_]) -> NDArray[np.int_]:
    """Find the rows ``(n, m)`` of the up to three other positions that are nearest to each of ``(n, joints)``."""
    around = _around(joints, turning)
    count = min(_NEAREST + 1, len(joints))
    rows = scipy.spatial.cKDTree(around).query(around, k=range(1, count + 1))[1]
    return np.asarray(rows[:, 1:], dtype=np.int_)


def _around(joints: Array, turning: NDArray[np.bool_]) -> Array:
    slides = np.where(turning, 0.0, joints / LEVER_M)
    return np.concatenate([np.where(turning, np.cos(joints), slides), np.sin(joints) * turning], axis=1)


def joint_regions(joints: Array, turning: NDArray[np.bool_], count: int, seed: int) -> NDArray[np.int_]:
    """Label regions of joint space of about as many distinct poses each: halved across the joint that spreads most.

    Args:
        joints: ``(n, joints)`` rad or m.
        turning: ``(joints,)`` which joints turn.
        count: how many; the largest region is halved until there are so many.

    Returns:
        ``(n,)`` labels; repeats of a pose have one.
    """
    rows, which = distinct_poses(joints, turning)
    distinct, rng = joints[rows], rng_for(seed, "split")
    labels = np.zeros(len(distinct), dtype=np.int_)
    for new in range(1, count):
        sizes = np.bincount(labels) + 0.5 * rng.random(new)
        part = np.flatnonzero(labels == sizes.argmax())
        across = int(np.ptp(distinct[part], axis=0).argmax())
        order = part[np.argsort(distinct[part, across], kind="stable")]
        labels[order[len(order) // 2 :]] = new
    return labels[which]


_REGIONS = 8
_MIN_REGION_POSES = 5 * _REGIONS
_LEAST_FAR = 3  # regions with poses that the others do not cover: fewer give no variance
_RIDGE = 1e-9  # of unit columns: directions that a region alone determines get a large covariance


@dataclass(frozen=True)
class _LinearRows:
    """A fitted linear problem pose by pose, in whitened units; rows of zeros where nothing was observed.

    Attributes:
        columns: ``(n, m, f)`` derivatives by the parameters that were fitted.
        prior_rows: ``(r, f)`` derivatives of what else is known of the parameters.
        by_joints: ``(n, m, joints)`` derivatives by joint positions: rad of a hinge, as much at a lever of a slide.
        numbers: ``(n,)`` how many numbers each pose has.
        sigma_given: whether the rows' variance is one at least.
    """

    columns: Array
    residual: Array
    prior_rows: Array
    by_joints: Array
    numbers: NDArray[np.int_]
    sigma_given: bool

    @property
    def variance(self) -> float:
        """Residual variance of a coordinate."""
        dof = int(self.numbers.sum()) - self.columns.shape[2]
        return float((self.residual**2).sum()) / dof if dof > 0 else 0.0

    def without(self, left_out: NDArray[np.bool_], values: Array) -> "_LinearRows":
        """Return the problem fitted without some parameters ``(f,)``, which had these values ``(left_out,)``."""
        retained = self.columns[..., ~left_out]
        before = self.residual + self.columns[..., left_out] @ values
        flat, target = retained.reshape(-1, retained.shape[2]), before.ravel()
        whole = np.concatenate([flat, self.prior_rows[:, ~left_out]])
        units, scale = unit_columns(whole)
        back = np.linalg.lstsq(units, np.concatenate([target, np.zeros(len(self.prior_rows))]), rcond=None)[0] / scale
        residual = (target - flat @ back).reshape(self.residual.shape)
        return replace(self, columns=retained, residual=residual, prior_rows=self.prior_rows[:, ~left_out])


@dataclass(frozen=True)
class _LeftOutRegion:
    """Poses of one region that the others do not cover, as the others predict them.

    Attributes:
        covariance: ``(k, m, m)`` by noise and parameters.
        by_joints: ``(k, m, joints)`` times the distance to what is covered.
        numbers: how many numbers these are.
    """

    error: Array
    covariance: Array
    by_joints: Array
    numbers: int
    p: float


def _growth_beyond_cover(rows: _LinearRows, joints: Array, turning: NDArray[np.bool_]) -> float:
    """Estimate the standard deviation (rad) of joint errors for each unit of distance beyond the covered positions.

    Zero where noise and the parameters' covariance explain the errors in regions that are left out.

    Args:
        joints: ``(n, joints)`` the positions of the poses.
        turning: ``(joints,)`` which joints turn.
    """
    distinct = len(distinct_poses(joints, turning)[0])
    if distinct < _MIN_REGION_POSES:
        return 0.0
    columns, scale = unit_columns(rows.columns.reshape(-1, rows.columns.shape[2]))
    scaled = replace(rows, columns=columns.reshape(rows.columns.shape), prior_rows=rows.prior_rows / scale)
    labels = joint_regions(joints, turning, _REGIONS, 0)
    repeated = distinct < len(joints)
    tried = [_left_out(scaled, joints, turning, labels == region, repeated=repeated) for region in range(_REGIONS)]
    parts = [part for part in tried if part is not None]
    if len(parts) < _LEAST_FAR:
        return 0.0
    logs = np.log(np.maximum([part.p for part in parts], np.finfo(float).tiny))  # of all regions (Fisher 1925)
    if float(chi2_sf(-2 * float(logs.sum()), 2 * len(parts))) >= EXTRAPOLATION:
        return 0.0
    return float(np.sqrt(_excess(parts) * len(parts) / (len(parts) - 2)))  # a new region is another draw: Student's t


def _left_out(
    rows: _LinearRows, joints: Array, turning: NDArray[np.bool_], out: NDArray[np.bool_], *, repeated: bool
) -> _LeftOutRegion | None:
    """Predict the uncovered poses of a region from the other poses; None where these cover them all."""
    away = PoseCover.of(joints[~out], turning, repeated=repeated).beyond(joints[out])
    far = np.flatnonzero(out)[away > 0]
    size = rows.columns.shape[2]
    dof = int(rows.numbers[~out].sum()) - size
    if not len(far) or dof < 1:
        return None
    # the fit of the other poses: a step from that of all, where the scores of all rows add up to nothing
    rest, left = rows.columns[~out].reshape(-1, size), rows.residual[~out].ravel()
    information = rest.T @ rest + rows.prior_rows.T @ rows.prior_rows + _RIDGE * np.eye(size)
    score_left_out = rows.columns[out].reshape(-1, size).T @ rows.residual[out].ravel()
    inverse: Array = np.asarray(np.linalg.inv(information), dtype=np.float64)
    step = inverse @ -score_left_out
    variance = float(((left - rest @ step) ** 2).sum()) / dof
    variance = max(variance, 1.0) if rows.sigma_given else variance
    # its errors at the uncovered poses, and their covariance
    far_columns = rows.columns[far]
    spread: Array = np.eye(far_columns.shape[1]) + far_columns @ inverse @ np.swapaxes(far_columns, 1, 2)
    error = rows.residual[far] - far_columns @ step
    numbers = int(rows.numbers[far].sum())
    p = _p_value(error / np.sqrt(variance), far_columns, inverse, spread, (numbers, dof))
    return _LeftOutRegion(error, variance * spread, away[away > 0][:, None, None] * rows.by_joints[far], numbers, p)


def _p_value(error: Array, columns: Array, inverse: Array, spread: Array, counts: tuple[int, int]) -> float:
    """Return the chance of as large a sum of squares of errors, each pose's by its own covariance (Satterthwaite 1946).

    Args:
        spread: ``(k, m, m)`` the poses' covariances.
        counts: numbers, and degrees of freedom of the variance.
    """
    numbers, dof = counts
    factor: Array = np.linalg.inv(np.linalg.cholesky(spread))
    squares = float(((factor @ error[..., None]) ** 2).sum())
    white = factor @ columns
    flat = white.reshape(-1, white.shape[2])
    across = inverse @ (flat.T @ flat)
    own = white @ inverse @ np.swapaxes(white, 1, 2)
    between = max(float(np.trace(across @ across)) - float((own**2).sum()), 0.0)
    like = matched_dof(float(numbers), 2 * (numbers + between))
    return float(p_value_of_squares(squares, like, dof, numbers / like))


def _excess(parts: list[_LeftOutRegion]) -> float:
    """Return the variance that makes the weighted squares of all errors as large as expected."""

    def excess(size: float) -> float:
        found = 0.0
        for part in parts:
            whole = part.covariance + size * part.by_joints @ np.swapaxes(part.by_joints, 1, 2)
            found += float((part.error * np.linalg.solve(whole, part.error[..., None])[..., 0]).sum()) - part.numbers
        return found

    low, high = 0.0, 1e-10
    if excess(low) <= 0:
        return 0.0
    while excess(high) > 0:
        if high > 1.0:  # more than a radian is no error of a calibration
            return high
        low, high = high, 10 * high
    return float(scipy.optimize.brentq(excess, low, high, rtol=1e-3))


_EDGE = 0.1  # of the measured positions of a joint, at either end of its range
_MAX_BEYOND = 1.0  # rad or m beyond, that a slope is good for
_LEAST_EDGE = 1e-3  # rad or m
_MIN_EDGE_POSES = 4  # at an edge: fewer determine no slope
_FEW_POSES = 2_000  # of an edge, in which so many configurations are looked for
_SLOPE_POSES = 20_000  # for slopes, where there are more
_REGION_POSES = 2_000  # from which regions are left out, where there are more
_LEAST_RANGE = 0.05  # rad or m: a joint that moved less has no edges to speak of
_LEAST_SLOPES = 4
_GEOMETRY = (
    "base",
    "tool",
    "link",
    STATIONS,
    RANGE,
    *CAMPAIGN_SPECIFIC,
    *STEPS,
)  # all others are effects that vary with the joints
_ROUNDING = 1e-9  # rad or m: a pose at the edge is not beyond it
_TOLERANCE = 1e-8  # of the largest singular value of unit columns
_MIN_SHARE = 1e-2  # of an edge's squares that the fit leaves: an edge that it follows determines no slope


@dataclass(frozen=True)
class MeasuredRange:
    """Range of the measured joint positions, and the model discrepancy beyond it.

    Attributes:
        lower, upper: ``(joints,)`` the smallest and the largest measured position (rad, m of a slide).
        turning: ``(joints,)`` whether a joint is a hinge.
        edge: ``(joints,)`` the width (rad, m) of the outer tenths that the slopes come from.
        slope: ``(joints,)`` one standard deviation of what a joint is off, as a share of how far it stands beyond; zero
            where the edges of the range show none.
        growth: one standard deviation (rad, at a lever of a slide) of what every joint is off, for each unit of
            distance beyond what is covered; zero where regions that are left out show none.
        unsure: as much (rad) of what effects explain where nothing near was measured; zero likewise.
        cover: the measured poses; None where only the range is known.
    """

    lower: Array
    upper: Array
    turning: NDArray[np.bool_]
    edge: Array
    slope: Array
    growth: float = 0.0
    unsure: float = 0.0
    cover: PoseCover | None = None

    @property
    def is_worse_beyond(self) -> bool:
        """Check whether prediction errors beyond the measured positions exceed the covariance."""
        return bool(self.slope.any()) or self.growth > 0

    def beyond(self, joints: Array) -> Array:
        """Return the distance ``(n, joints)`` beyond the measured range; a whole turn leads away."""
        beyond = np.maximum(self.lower - joints, joints - self.upper)
        return np.where(beyond > _ROUNDING, beyond, 0.0)

    def outside(self, joints: Array) -> NDArray[np.bool_]:
        """Check ``(n,)`` which positions ``(n, joints)`` are beyond the measured range, or near no measured one."""
        return np.asarray(self.uncovered(joints) | (self.beyond(joints) > 0).any(axis=1))

    def uncovered(self, joints: Array) -> NDArray[np.bool_]:
        """Check ``(n,)`` which positions ``(n, joints)`` no measured one is near."""
        return np.asarray(self._away(joints) > 0)

    def _away(self, joints: Array) -> Array:
        return np.zeros(len(joints)) if self.cover is None else self.cover.beyond(joints)

    def unknown(self, model: Model, inputs: Array, values: Array) -> Array:
        """Return standard deviations ``(n, k, d, joints)`` of observations by each joint's unknown error.

        Args:
            inputs: ``(n, joints + conditions)`` the poses.
            values: ``(p,)`` of the model.
        """
        size = len(self.lower)
        off = self._joint_errors(inputs[:, :size]) if self.is_worse_beyond else np.zeros((len(inputs), size))
        if not off.any():
            return np.zeros((*model.points(inputs, values).shape, size))
        return np.asarray(by_joint_positions(model, inputs, values, size) * off[:, None, None, :])

    def _joint_errors(self, joints: Array) -> Array:
        """Return standard deviations ``(n, joints)`` of joint errors (rad, m of a slide) at some positions."""
        beyond, away = self.beyond(joints), self._away(joints)[:, None]
        sloped = self.slope * np.minimum(beyond * np.sqrt(1 + beyond / self.edge), _MAX_BEYOND)
        share = np.maximum(np.clip(beyond / self.edge, 0.0, 1.0).max(axis=1, keepdims=True), away > 0)
        every = (np.minimum(self.growth * away, _MAX_BEYOND)) ** 2 + share * self.unsure**2
        return np.asarray(np.sqrt(sloped**2 + every * np.where(self.turning, 1.0, LEVER_M) ** 2))


def measured_range(
    found: Identification, observed: Observations, prismatic: Sequence[bool], *, slopes: bool = True
) -> MeasuredRange | None:
    """Return the range of the fitted poses and the discrepancy beyond; None where no positions were observed.

    Args:
        observed: its measurements, weighted as they were; of very many poses a subset.
        prismatic: ``(joints,)`` which joints slide.
        slopes: whether to estimate slopes at edges; not beside a process, which has its own uncertainty there.
    """
    observation = observation_of(found.model)
    if not only_positions(observation):
        return None
    size, turning = len(prismatic), ~np.array(prismatic, dtype=np.bool_)
    joints = observed.inputs[:, :size]
    some, few = observed.thinned(_SLOPE_POSES), observed.thinned(_REGION_POSES)
    slope = _slopes(found, observation.model, some, some.inputs[:, :size]) if slopes else np.zeros(size)
    low, high = np.quantile(joints, [_EDGE, 1 - _EDGE], axis=0)
    lower, upper = joints.min(axis=0), joints.max(axis=0)
    edge = np.maximum((low - lower + upper - high) / 2, _LEAST_EDGE)
    growth, unsure = _of_regions(found, observation.model, few, turning)
    return MeasuredRange(lower, upper, turning, edge, slope, growth, unsure, PoseCover.of(joints, turning))


def _of_regions(
    found: Identification, model: Model, observed: Observations, turning: NDArray[np.bool_]
) -> tuple[float, float]:
    """Estimate joint errors per unit of distance beyond the covered positions, and the effects' size (rad)."""
    joints = observed.inputs[:, : len(turning)]
    rows = _linear_rows(found, model, observed, turning)
    growth = _growth_beyond_cover(rows, joints, turning)
    lasting = np.array([found.model.parameters[i].group not in _GEOMETRY for i in found.fit.free], dtype=np.bool_)
    if not (growth and lasting.any()):
        return growth, 0.0
    rigid = rows.without(lasting, found.values[list(found.fit.free)][lasting])
    explained = max(rigid.variance - rows.variance, 0.0)
    made = float((rows.by_joints**2).sum()) / max(int(rows.numbers.sum()), 1)
    return max(growth, _growth_beyond_cover(rigid, joints, turning)), float(np.sqrt(explained / made)) if made else 0.0


def _linear_rows(
    found: Identification, model: Model, observed: Observations, turning: NDArray[np.bool_]
) -> _LinearRows:
    free, seen = list(found.fit.free), observed.seen
    points, jacobian = model.observe(observed.inputs, found.values)
    moved = by_joint_positions(model, observed.inputs, found.values, len(turning)) * np.where(turning, 1.0, LEVER_M)

    def whole(vectors: Array) -> Array:
        rows = np.zeros(vectors.shape)
        rows[seen] = observed.apply(vectors).reshape(-1, *vectors.shape[2:])
        return rows.reshape(len(rows), -1, *vectors.shape[3:])

    residual = whole(observed.points - points)
    known = found.extra_residuals(found.values)[1][:, free]
    numbers = seen.sum(axis=1) * observed.points.shape[2]
    return _LinearRows(whole(jacobian[..., free]), residual, known, whole(moved), numbers, found.sigma_given)


def _slopes(found: Identification, model: Model, observed: Observations, joints: Array) -> Array:
    """Estimate each joint's standard deviation of slopes beyond the edges; zeros where noise explains them."""
    edges, nothing = _edges(joints), np.zeros(joints.shape[1])
    # what the fit leaves of the residuals, and of the slopes at each edge
    predicted, jacobian = model.observe(observed.inputs, found.values)
    known, slopes = found.extra_residuals(found.values)
    free = list(found.fit.free)
    fitted = LinearModel.of(np.concatenate([observed.apply(jacobian[..., free]), slopes[:, free]]), _TOLERANCE)
    residual = np.concatenate([observed.apply(observed.points - predicted), known])
    dof = len(residual) - fitted.rank
    if len(edges) < _LEAST_SLOPES or dof < 1:
        return nothing
    moved = by_joint_positions(model, observed.inputs, found.values, joints.shape[1])
    columns = np.stack([moved[..., joint] * beyond[:, None, None] for joint, beyond in edges], axis=-1)
    whole = np.zeros((len(residual), len(edges)))
    whole[: len(residual) - len(known)] = observed.apply(columns)
    left = fitted.residual(whole)
    weights = (left**2).sum(axis=0)
    significant = weights > _MIN_SHARE * (whole**2).sum(axis=0)
    if significant.sum() < _LEAST_SLOPES:
        return nothing
    # each edge's slope with its error, and the variance that all share
    estimates = (left.T @ residual)[significant] / weights[significant]
    variance = max(float(residual @ residual) / dof, 1.0 if found.sigma_given else 0.0)
    errors = variance / weights[significant]
    if not (shared := _shared_variance(estimates, errors, dof)):
        return nothing
    trust = shared**2 / (shared**2 + errors)  # uncertain edges shrink to all others (empirical Bayes)
    joint = np.array([joint for joint, _ in edges])[significant]
    own = np.bincount(joint, (trust * estimates) ** 2 + trust * errors, joints.shape[1])
    count = np.bincount(joint, minlength=len(nothing))
    return np.asarray(np.sqrt(np.maximum(own / np.maximum(count, 1), shared**2)))


def _edges(joints: Array) -> list[tuple[int, Array]]:
    """Return joint and distance ``(n,)`` of each pose within its outer tenth; edges of too few poses are left out."""
    edges = []
    repeated = len(np.unique(configurations(joints))) < len(joints)
    for joint, positions in enumerate(joints.T):
        if np.ptp(positions) < _LEAST_RANGE:
            continue
        low, high = np.quantile(positions, [_EDGE, 1 - _EDGE])
        both = np.maximum(low - positions, 0.0), np.maximum(positions - high, 0.0)
        edges += [(joint, beyond) for beyond in both if _is_enough(joints[beyond > 0], repeated=repeated)]
    return edges


def _is_enough(joints: Array, *, repeated: bool) -> bool:
    """Check whether the poses, repeats aside, suffice to estimate a slope.

    Args:
        repeated: whether some of them may be repeats.
    """
    few = evenly(len(joints), _FEW_POSES)
    joints = joints if few is None else joints[few]
    distinct = len(np.unique(configurations(joints))) if repeated and len(joints) >= _MIN_EDGE_POSES else len(joints)
    return distinct >= _MIN_EDGE_POSES


def _shared_variance(estimates: Array, variances: Array, dof: int) -> float:
    """Return the standard deviation of numbers beyond their errors: weighted squares are then as expected.

    The slope of a new edge is another draw of a variance from few estimates: that of Student's t.
    """
    count = len(estimates)
    squares = float((estimates**2 / variances).sum())
    if p_value_of_squares(squares, count, dof) >= EXTRAPOLATION:
        return 0.0
    most = float((estimates**2).sum())
    excess = scipy.optimize.brentq(lambda size: float((estimates**2 / (variances + size)).sum()) - count, 0.0, most)
    return float(np.sqrt(excess * count / (count - 2)))


def position_covariances(
    found: Identification, measured: MeasuredRange | None, inputs: Array, targets: int | None = None
) -> Array:
    """Covariances ``(n, k, 3, 3)`` (m^2) of the predicted points' errors at some poses, the instrument's noise aside.

    Args:
        measured: what the model may lack where nothing was measured.
        inputs: ``(n, joints + conditions)``.
        targets: how many, from the first; all where None.
    """
    if found.process is not None:
        squares = found.process.covariances(inputs, targets)
    else:
        slopes = found.model.observe(inputs, found.values)[1][:, :targets][..., list(found.fit.free)]
        squares = slopes @ found.covariance @ np.swapaxes(slopes, 2, 3)
    if measured is not None and measured.is_worse_beyond:
        unknown = measured.unknown(found.model, inputs, found.values)[:, :targets]
        squares = squares + unknown @ np.swapaxes(unknown, 2, 3)
    return np.asarray(squares)


def model_covariances(
    found: Identification, measured: MeasuredRange | None, inputs: Array, left: ResidualSpread
) -> Array:
    """Covariances ``(n, k, 3, 3)`` (m^2) of the model's errors, with configurations in the place of rows as clusters.

    Args:
        measured: what the model may lack where nothing was measured.
        inputs: ``(n, joints + conditions)``.
        left: what the fit left, by which the parameters' covariance is widened.
    """
    whole = position_covariances(found, measured, inputs)
    if found.process is not None or left.widened == 1:
        return whole
    return np.asarray(whole + (left.widened - 1) * position_covariances(found, None, inputs))
