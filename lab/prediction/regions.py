"""Choose the poses over which the errors of a calibrated arm are predicted.

By default these are the measured configurations, each as a new one: predicted by the fit of all others, its covariance
is larger by the leverage that the configuration has in its own prediction (Cook & Weisberg 1982, section 2.2). A task
names its own region by points, which the arm reaches from the measured configuration whose point is nearest.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lab.calibration.gauss_newton import Observations
from lab.calibration.identification import Identification
from lab.calibration.observation import ArmObservation, observation_of
from lab.calibration.row_groups import configurations
from lab.calibration.statistics.joint_rounding import by_joint_positions
from lab.calibration.statistics.linearized import linearized
from lab.core.errors import LabError
from lab.core.measurements import evenly
from lab.core.random import rng_for
from lab.core.se3 import Array
from lab.kinematics.effects.sessions import at_first_station
from lab.kinematics.joints import JointSpec
from lab.kinematics.model import Model
from lab.kinematics.parameter import indices_of_groups
from lab.kinematics.tree import first_of_tips
from lab.prediction.extrapolation import neighbours
from lab.prediction.task_region import RegionKind

__all__ = [
    "Region",
    "TargetSlopes",
    "first_targets",
    "measured_region",
    "of_first_targets",
    "region_of_points",
    "slopes_placed_anew",
    "without_columns",
    "workspace_region",
]

_REGION_POSES = 200
_MAX_POSES = 20_000  # by which leverages are judged
_MAX_STARTS = 4_000  # measured poses from which points are reached
_LEAST_LEFT = 1e-6  # of a direction's variance, that the other configurations leave
_SAME_POINT = 1e-9  # m: a turn that moves the target by less has no meaning
_TURN_POSES = 5  # at which a turn is tried
_STEPS, _REACHED = 60, 1e-6  # Gauss-Newton steps to a point, and how near (m) it comes
_LONGEST_STEP = 0.3  # rad or m of a joint
_DAMPING = 1e-6  # of the largest eigenvalue


@dataclass(frozen=True)
class Region:
    """Poses of a part of the workspace.

    Attributes:
        inputs: ``(n, joints + conditions)`` its poses.
        factors: ``(n,)`` how many times the parameters' covariance is larger at each, as it was fitted; None for once.
        reached: ``(m,)`` whether there is a pose for each of the points that name the region; None without points.
    """

    kind: RegionKind
    inputs: Array
    factors: Array | None = None
    reached: NDArray[np.bool_] | None = None


def first_targets(model: Model) -> tuple[int, ...]:
    """Return the first measured target, and the first of each further tip."""
    return first_of_tips(model.targets[: getattr(model, "positions", None)])  # an arm alone has positions only


def of_first_targets(model: Model, each: Array) -> Array:
    """Return what ``(n, k, ...)`` holds of the first target of each of t tips, ``(n, t, ...)``."""
    first = first_targets(model)
    return each[:, :1] if first == (0,) else each[:, list(first)]  # a slice is no copy


@dataclass(frozen=True)
class TargetSlopes:
    """Positions of an arm's first target, or of the first of each of t tips, at some poses of a region.

    Attributes:
        arm: measured by points.
        jacobian: ``(n t, 3, p)`` by its parameters.
        by_free: ``(n, t, 3, f)`` by the parameters that were fitted, these groups placed anew.
        reached: ``(m,)`` which of the poses the arm takes.
        groups: base and tool where no reading places them.
    """

    arm: Model
    jacobian: Array
    by_free: Array
    reached: NDArray[np.bool_]
    groups: tuple[str, ...]


def slopes_placed_anew(found: Identification, inputs: Array) -> TargetSlopes | None:
    """Return derivatives of target positions where readings are no positions; None where they are, or no pose is taken.

    Where no position in an instrument's frame is observed, arm and fixtures may move together: an error is what is
    left after the base (and a tool that no reading shows) is placed anew over these poses, as by measured points.

    Args:
        inputs: ``(m, joints + conditions)`` poses of the identified model.
    """
    observation = observation_of(found.model)
    if observation.positions or found.process is not None or not isinstance(observation, ArmObservation):
        return None
    arm, width = _points_of(found.model, inputs.shape[1])
    size = len(arm.names)
    slopes = of_first_targets(arm, arm.observe(inputs[:, :width], found.values[:size])[1])
    reached = np.asarray(np.isfinite(slopes).all(axis=(1, 2, 3)))
    if not reached.any():
        return None
    jacobian, own = slopes[reached].reshape(-1, *slopes.shape[2:]), [i for i in found.fit.free if i < size]
    by_free = np.zeros((*jacobian.shape[:2], len(found.fit.free)))
    by_free[..., [found.fit.free.index(i) for i in own]] = jacobian[..., own]
    groups = () if "base" in observation.placed else found.unplaced
    if groups:
        by_free = without_columns(by_free, jacobian[..., list(indices_of_groups(arm.parameters, groups))])
    return TargetSlopes(arm, jacobian, by_free.reshape(int(reached.sum()), -1, *by_free.shape[1:]), reached, groups)


def _points_of(model: Model, width: int) -> tuple[Model, int]:
    """Return the model of the targets' positions, and how many of ``width`` columns of inputs are its own."""
    observation = observation_of(model)
    if observation.positions or not isinstance(observation, ArmObservation):
        return model, width
    return observation.arm, width - len(model.conditions) + len(observation.arm.conditions)


def without_columns(rows: Array, columns: Array) -> Array:
    """Return rows ``(n, 3, f)`` less what parameters with derivatives ``(n, 3, k)`` follow of them, fitted to all."""
    flat, wide = rows.reshape(-1, rows.shape[-1]), columns.reshape(-1, columns.shape[-1])
    return np.asarray((flat - wide @ np.linalg.lstsq(wide, flat, rcond=None)[0]).reshape(rows.shape))


def measured_region(found: Identification, observed: Observations, turning: NDArray[np.bool_]) -> Region:
    """Return poses like the measured ones: some of these, each as if it had not been fitted.

    Where a process predicts the offsets of the joints, which it follows at each measured pose, these are poses between
    neighbouring measured ones and as far beyond them.

    Args:
        turning: ``(joints,)`` which joints are hinges.
    """
    # some of the distinct poses
    observed, size = observed.thinned(_MAX_POSES), len(turning)
    labels = configurations(observed.inputs[:, :size])
    first = np.unique(labels, return_index=True)[1]
    rng = rng_for(0, "bootstrap")
    if found.process is not None:
        return Region("measured", _between_neighbours(observed.inputs[first], turning, rng))
    some = np.sort(rng.permutation(len(first))[:_REGION_POSES])
    inputs = observed.inputs[first[some]]
    # derivatives of the first target by the fitted parameters
    anew = slopes_placed_anew(found, inputs)
    if not observation_of(found.model).positions:
        if anew is None or not anew.reached.all():
            return Region("measured", inputs)
        slopes = anew.by_free
    else:
        slopes = of_first_targets(found.model, found.model.observe(inputs, found.values)[1])[..., list(found.fit.free)]
    # the rows Q_i of each pose in an orthonormal basis of the fit, and its target's P_i
    linear = linearized(found.model, observed, found.values, found.fit.free, found.extra_residuals).by_cluster(labels)
    whole = linear.everywhere()
    Q = linear.jacobian[some] @ whole.directions  # (n, m, rank)
    P = slopes.reshape(len(inputs), -1, slopes.shape[-1]) / linear.scale @ whole.directions  # (n, 3, rank)
    # without the pose the variance P_i P_i' grows by P_i Q_i' (I - Q_i Q_i')^-1 Q_i P_i'
    left_over, axes = np.linalg.eigh(np.eye(Q.shape[1]) - Q @ np.swapaxes(Q, 1, 2))
    turned = np.swapaxes(axes, 1, 2) @ Q @ np.swapaxes(P, 1, 2)
    growth = ((turned**2).sum(axis=2) / np.maximum(left_over, _LEAST_LEFT)).sum(axis=1)
    return Region("measured", inputs, np.asarray(1 + growth / np.maximum((P**2).sum(axis=(1, 2)), 1e-300)))


def _between_neighbours(inputs: Array, turning: NDArray[np.bool_], rng: np.random.Generator) -> Array:
    """Move each of distinct poses up to the whole way to or from one of its neighbours, within the range of each."""
    size = len(turning)
    joints, near = inputs[:, :size], neighbours(inputs[:, :size], turning)
    order = np.concatenate([rng.permutation(len(inputs)) for _ in range(-(-_REGION_POSES // len(inputs)))])[
        :_REGION_POSES
    ]
    drawn = inputs[order].copy()
    if near.shape[1]:
        toward = joints[near[order, rng.integers(near.shape[1], size=len(order))]] - joints[order]
        toward = np.where(turning, np.remainder(toward + np.pi, 2 * np.pi) - np.pi, toward)
        moved = joints[order] + rng.uniform(-1, 1, (len(order), 1)) * toward
        drawn[:, :size] = np.clip(moved, joints.min(axis=0), joints.max(axis=0))
    return np.asarray(drawn)


def workspace_region(
    model: Model, values: Array, measured: Array | None = None, turning: NDArray[np.bool_] | None = None
) -> Region:
    """Draw random poses within the joints' limits; with measured ones, hinges are turned by whole turns toward these.

    Args:
        values: ``(p,)`` its parameters.
        measured: ``(n, joints)`` the measured positions.
        turning: ``(joints,)`` which joints are hinges.
    """
    inputs = at_first_station(model.conditions, model.structure_joints(_REGION_POSES, rng_for(0, "structure")))
    if measured is None or turning is None:
        return Region("workspace", inputs)
    return Region("workspace", _turned_toward(model, values, inputs, measured, turning))


def _turned_toward(model: Model, values: Array, inputs: Array, measured: Array, turning: NDArray[np.bool_]) -> Array:
    """Turn hinges by whole turns to the measured range, where the model is the same after a turn."""
    turned, few = inputs.copy(), inputs[:_TURN_POSES]
    points = model.points(few, values)
    middle = (measured.min(axis=0) + measured.max(axis=0)) / 2
    for joint in np.flatnonzero(turning):
        after = few.copy()
        after[:, joint] += 2 * np.pi
        if np.allclose(model.points(after, values), points, rtol=0, atol=_SAME_POINT, equal_nan=True):
            turned[:, joint] -= 2 * np.pi * np.round((turned[:, joint] - middle[joint]) / (2 * np.pi))
    return turned


def region_of_points(
    kind: RegionKind,
    points: Array,
    *,
    model: Model,
    values: Array,
    inputs: Array,
    joints: JointSpec,
    name: str,
) -> Region:
    """Find poses in which the first target is at points, each near the measured pose whose target is nearest to it.

    Args:
        points: ``(m, 3)`` m, in the frame of the measurements.
        values: ``(p,)`` its parameters.
        inputs: ``(n, joints + conditions)`` the measured poses.

    Raises:
        LabError: the arm reaches none of the points.
    """
    inputs = at_first_station(model.conditions, inputs)
    if (some := evenly(len(inputs), _MAX_STARTS)) is not None:
        inputs = inputs[some]
    (arm, width), size = _points_of(model, inputs.shape[1]), joints.size
    values = values[: len(arm.names)]
    # begin at the measured pose whose target is nearest
    measured = arm.points(inputs[:, :width], values)[:, 0]
    possible = np.isfinite(measured).all(axis=1)
    inputs, measured = inputs[possible], measured[possible]
    nearest = ((points[:, None] - measured) ** 2).sum(axis=2).argmin(axis=1)
    poses = inputs[nearest].copy()
    distance = points - arm.points(poses[:, :width], values)[:, 0]
    # damped Newton steps of the joints, of bounded length
    for _ in range(_STEPS):
        slopes = by_joint_positions(arm, poses[:, :width], values, size)[:, 0]
        square = slopes @ np.swapaxes(slopes, 1, 2)
        damping = _DAMPING * np.trace(square, axis1=1, axis2=2)[:, None, None] * np.eye(3)
        step = (np.swapaxes(slopes, 1, 2) @ np.linalg.solve(square + damping, distance[..., None]))[..., 0]
        longest = np.abs(step).max(axis=1, keepdims=True)
        poses[:, :size] += step * np.minimum(1.0, _LONGEST_STEP / np.maximum(longest, 1e-300))
        distance = points - arm.points(poses[:, :width], values)[:, 0]
        if np.nanmax(np.abs(distance), initial=0.0) < _REACHED:
            break
    reached = (np.abs(distance) < _REACHED).all(axis=1) & ~joints.beyond_limits(poses[:, :size], _REACHED).any(axis=1)
    if not reached.any():
        raise LabError(
            f"{name}: the arm reaches none of its {len(points)} points near the measured poses; name another"
        )
    return Region(kind, poses[reached], reached=np.asarray(reached))
