"""What a calibration says of poses beyond the joint positions that were measured.

The covariance of the parameters holds if the model does, and a model that follows every measurement may be wrong
where none was made: a wave that is none, a spring that is not linear. How wrong, the edges of the measured range say.
Let joint j be off beyond an edge by a slope times how far beyond it stands. Beside the fit, each outer tenth of a
joint's measured positions gives one estimate of such a slope, as if the rest of that joint's range were all that was
measured. Their variance beyond what noise makes of them (Paule & Mandel 1982) is that of the slope beyond the true
edges, unless a joint's own two say more. Farther out than that tenth is wide a slope changes itself: its integral grows
as d^1.5, as a random walk's does; and what joints do is bounded, so that no more than one radian of it counts.

What is missing within the range, regions that are left out say (``left_out_regions``). Where the model fails there, its
effects are believed where they were measured alone: elsewhere what geometry without them lacks is what may be lacking,
and what they explain counts as unknown, beyond an end as much of it as an outer tenth's width.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy  # its parts are loaded at their first use, which not every process comes to
from numpy.typing import NDArray

from lab.calibration.gauss_newton import Observations
from lab.calibration.identify import Identification
from lab.calibration.left_out_regions import LinearRows, growth_beyond_cover
from lab.calibration.observation import observation_of, only_positions
from lab.calibration.pose_cover import PoseCover
from lab.calibration.residual_spread import ResidualSpread
from lab.calibration.statistics.joint_rounding import by_joint_positions
from lab.calibration.validation import configurations
from lab.core.linear_model import LinearModel, p_value_of_squares
from lab.core.measurements import evenly
from lab.core.se3 import Array
from lab.core.significance import EXTRAPOLATION
from lab.kinematics.effects.effect import LEVER_M
from lab.kinematics.effects.registry import CAMPAIGN_SPECIFIC
from lab.kinematics.model import Model

__all__ = [
    "MeasuredRange",
    "measured_range",
    "model_covariances",
    "position_covariances",
    "prediction_covariances",
    "prediction_squares",
]

_EDGE = 0.1  # of the measured positions of a joint, at either end of its range
_MOST = 1.0  # rad or m beyond, that a slope is good for
_LEAST_EDGE = 1e-3  # rad or m
_LEAST_POSES = 4  # at an edge: fewer say nothing of a slope
_FEW_POSES = 2_000  # of an edge, in which so many configurations are looked for
_SLOPE_POSES = 20_000  # from which slopes are told, where there are more
_REGION_POSES = 2_000  # from which regions are left out, where there are more
_LEAST_RANGE = 0.05  # rad or m: a joint that moved less has no edges to speak of
_LEAST_SLOPES = 4
_GEOMETRY = ("base", "tool", "link", *CAMPAIGN_SPECIFIC)  # all others are effects that vary with the joints
_ROUNDING = 1e-9  # rad or m: a pose at the edge is not beyond it
_TOLERANCE = 1e-8  # of the largest singular value of unit columns
_TOLD = 1e-2  # of an edge's squares that the fit leaves: an edge that it can follow says nothing of how it leaves it


@dataclass(frozen=True)
class MeasuredRange:
    """The joint positions that were measured, and how much worse than its covariance a model may be beyond.

    Attributes:
        lower, upper: ``(joints,)`` the smallest and the largest measured position (rad, m of a slide).
        turning: ``(joints,)`` whether a joint is a hinge.
        edge: ``(joints,)`` the width (rad, m) of the outer tenths that the slopes come from.
        slope: ``(joints,)`` one standard deviation of what a joint is off, as a share of how far it stands beyond; zero
            where the edges of the range say of none.
        growth: one standard deviation (rad, at a lever of a slide) of what every joint is off, for each unit of
            distance beyond what is covered; zero where regions that are left out say of none.
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
        """Whether the model is known to be worse than its covariance where nothing was measured."""
        return bool(self.slope.any()) or self.growth > 0

    def beyond(self, joints: Array) -> Array:
        """``(n, joints)`` how far beyond the measured range positions ``(n, joints)`` are; a whole turn leads away."""
        beyond = np.maximum(self.lower - joints, joints - self.upper)
        return np.where(beyond > _ROUNDING, beyond, 0.0)

    def uncovered(self, joints: Array) -> NDArray[np.bool_]:
        """``(n,)`` which positions ``(n, joints)`` no measured one is near: a region that nobody measured."""
        return np.asarray(self._away(joints) > 0)

    def _away(self, joints: Array) -> Array:
        """``(n,)`` how far positions are beyond what is covered; zero where that is not known."""
        return np.zeros(len(joints)) if self.cover is None else self.cover.beyond(joints)

    def unknown(self, model: Model, inputs: Array, values: Array) -> Array:
        """``(n, k, d, joints)`` one standard deviation of what each joint's unknown error makes of observations.

        Args:
            inputs: ``(n, joints + conditions)`` the poses.
            values: ``(p,)`` of the model.
        """
        size = len(self.lower)
        off = self._off(inputs[:, :size]) if self.is_worse_beyond else np.zeros((len(inputs), size))
        if not off.any():
            return np.zeros((*model.points(inputs, values).shape, size))
        return np.asarray(by_joint_positions(model, inputs, values, size) * off[:, None, None, :])

    def _off(self, joints: Array) -> Array:
        """``(n, joints)`` one standard deviation of what joints are off (rad, m of a slide) at some positions."""
        beyond, away = self.beyond(joints), self._away(joints)[:, None]
        sloped = self.slope * np.minimum(beyond * np.sqrt(1 + beyond / self.edge), _MOST)
        share = np.maximum(np.clip(beyond / self.edge, 0.0, 1.0).max(axis=1, keepdims=True), away > 0)
        every = (np.minimum(self.growth * away, _MOST)) ** 2 + share * self.unsure**2
        return np.asarray(np.sqrt(sloped**2 + every * np.where(self.turning, 1.0, LEVER_M) ** 2))


def measured_range(
    found: Identification, observed: Observations, prismatic: Sequence[bool], *, slopes: bool = True
) -> MeasuredRange | None:
    """The range of the fitted poses, with what edges and regions show; None where no positions were observed.

    Args:
        found: the identification.
        observed: what it comes from, weighed as it was; of very many poses some tell slopes and regions.
        prismatic: ``(joints,)`` which joints slide.
        slopes: whether edges are asked; of a process that says itself what it does not know beyond they are not.
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
    """What joints are off beyond what is covered, for each unit of distance, and of what effects explain (rad)."""
    joints = observed.inputs[:, : len(turning)]
    rows = _linear_rows(found, model, observed, turning)
    growth = growth_beyond_cover(rows, joints, turning)
    lasting = np.array([found.model.parameters[i].group not in _GEOMETRY for i in found.fit.free], dtype=np.bool_)
    if not (growth and lasting.any()):
        return growth, 0.0
    rigid = rows.without(lasting, found.values[list(found.fit.free)][lasting])
    explained = max(rigid.variance - rows.variance, 0.0)
    made = float((rows.by_joints**2).sum()) / max(int(rows.numbers.sum()), 1)
    return max(growth, growth_beyond_cover(rigid, joints, turning)), float(np.sqrt(explained / made)) if made else 0.0


def _linear_rows(found: Identification, model: Model, observed: Observations, turning: NDArray[np.bool_]) -> LinearRows:
    """The identification's linear problem pose by pose."""
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
    return LinearRows(whole(jacobian[..., free]), residual, known, whole(moved), numbers, found.sigma_known)


def _slopes(found: Identification, model: Model, observed: Observations, joints: Array) -> Array:
    """Each joint's standard deviation of slopes beyond; zeros where noise alone explains those at the edges."""
    edges, nothing = _edges(joints), np.zeros(joints.shape[1])
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
    told = weights > _TOLD * (whole**2).sum(axis=0)
    if told.sum() < _LEAST_SLOPES:
        return nothing
    estimates = (left.T @ residual)[told] / weights[told]
    variance = max(float(residual @ residual) / dof, 1.0 if found.sigma_known else 0.0)
    errors = variance / weights[told]
    if not (shared := _excess(estimates, errors, dof)):
        return nothing
    trust = shared**2 / (shared**2 + errors)  # an edge that says little says what all of them do (empirical Bayes)
    joint = np.array([joint for joint, _ in edges])[told]
    own = np.bincount(joint, (trust * estimates) ** 2 + trust * errors, joints.shape[1])
    count = np.bincount(joint, minlength=len(nothing))
    return np.asarray(np.sqrt(np.maximum(own / np.maximum(count, 1), shared**2)))


def _edges(joints: Array) -> list[tuple[int, Array]]:
    """Joint and how far ``(n,)`` each pose is within its outer tenth; edges of too few poses are left out."""
    found = []
    for joint, positions in enumerate(joints.T):
        if np.ptp(positions) < _LEAST_RANGE:
            continue
        low, high = np.quantile(positions, [_EDGE, 1 - _EDGE])
        both = np.maximum(low - positions, 0.0), np.maximum(positions - high, 0.0)
        found += [(joint, beyond) for beyond in both if _is_enough(joints[beyond > 0])]
    return found


def _is_enough(joints: Array) -> bool:
    """Whether so many poses, repeats aside, say something of a slope."""
    few = evenly(len(joints), _FEW_POSES)
    joints = joints if few is None else joints[few]
    return len(joints) >= _LEAST_POSES and len(np.unique(configurations(joints))) >= _LEAST_POSES


def _excess(estimates: Array, variances: Array, dof: int) -> float:
    """The standard deviation of numbers beyond that of their own errors: where the weighted squares are as expected.

    The slope of a new edge is another draw of a variance that so few estimates say: Student's t has this one.
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
        found: of points.
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
        found: of points.
        measured: what the model may lack where nothing was measured.
        inputs: ``(n, joints + conditions)``.
        left: what the fit left, by which the parameters' covariance is widened.
    """
    whole = position_covariances(found, measured, inputs)
    if found.process is not None or left.widened == 1:
        return whole
    return np.asarray(whole + (left.widened - 1) * position_covariances(found, None, inputs))


def prediction_covariances(
    found: Identification, measured: MeasuredRange | None, inputs: Array, left: ResidualSpread
) -> Array:
    """Covariances ``(n, k, 3, 3)`` (m^2) of measured less predicted points: the model's, with what the fit left."""
    return np.asarray(model_covariances(found, measured, inputs, left) + left.total_m**2 * np.eye(3))


def prediction_squares(
    found: Identification, measured: MeasuredRange | None, inputs: Array, points: Array, left: ResidualSpread
) -> tuple[Array, Array]:
    """Squares e' V^-1 e ``(n, k)`` of measured less predicted points, and the same by noise and parameters alone.

    V is that of the noise (as large as the residuals are), of the parameters, and of what is beyond the range.

    Args:
        found: of points.
        inputs: ``(n, joints + conditions)``.
        points: ``(n, k, 3)`` m.
        left: what the fit left of the measurements that it comes from.
    """
    error = points - found.model.points(inputs, found.values)[:, : points.shape[1]]
    with_range, without = (
        np.einsum("nki,nki->nk", error, np.linalg.solve(each, error[..., None])[..., 0])
        for each in (prediction_covariances(found, what, inputs, left) for what in (measured, None))
    )
    return with_range, without
