"""Denavit-Hartenberg parameters from an arm's joint axes.

``chain_from_axes`` gives the table of a nominal arm; ``parameters_from_axes`` the parameters of a perturbed arm in the
canonical gauge.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from lab.core import se3
from lab.core.errors import LabError
from lab.core.newton import least_squares_step, newton
from lab.core.se3 import Array
from lab.kinematics.gauge import BaseSet, base_set
from lab.kinematics.model import Model
from lab.kinematics.serial.chain import PARALLEL_RAD, Chain, parallel_links
from lab.kinematics.serial.serial_arm import SerialArm
from lab.kinematics.serial.walk import ElementaryMotion

__all__ = ["JointAxes", "Truth", "chain_from_axes", "parameters_from_axes"]

_MEETING_M = 0.010  # axes nearer than this meet, on the nominal model


@dataclass(frozen=True)
class JointAxes:
    """Joint axes of an arm at zero joint positions, in one frame (m).

    Attributes:
        origins: ``(n, 3)``, a point on each axis.
        directions: ``(n, 3)``, unit vectors of positive joint motion.
        targets: ``(k, 3)``, the measured points.
    """

    origins: Array
    directions: Array
    targets: Array


@dataclass(frozen=True)
class Truth:
    """True parameters of a virtual arm in the canonical gauge, only for the assessment.

    ``values`` belong to ``arm.names``; those outside ``base_set`` are nominal. ``effects`` are other parameters by
    name, zero by default.
    """

    arm: Model
    values: Array
    base_set: BaseSet
    effects: Mapping[str, float] = field(default_factory=dict)

    def of(self, names: Sequence[str]) -> Array:
        """Return the true values of parameters by name."""
        values = {**self.effects, **dict(zip(self.arm.names, self.values.tolist(), strict=True))}
        return np.array([values.get(name, 0.0) for name in names])


def chain_from_axes(
    name: str,
    joint_names: tuple[str, ...],
    prismatic: tuple[bool, ...],
    axes: JointAxes,
    base: Array,
    flange: Array,
    limits: tuple[Array, Array, Array, Array],
) -> tuple[Chain, Array]:
    """Return the distal table of an arm, and the pose ``(4, 4)`` of its frame 0 in the axes' frame.

    Frame 0 is on axis 1, nearest to ``base`` ``(4, 4)``, with z along the axis and x nearest to the base's. x of each
    further frame is the common normal, with the smaller theta if the axes meet; d is zero between parallel axes. The
    last frame is on the last axis, nearest to ``flange``.

    Args:
        limits: lower, upper, speed and acceleration, each ``(n,)``.
    """
    n = len(joint_names)
    z, origin = axes.directions[0], axes.origins[0]
    x = _across(base[:3, 0], z, base[:3, 1])
    position = origin + z * np.dot(base[:3, 3] - origin, z)
    frame0 = se3.pose(np.stack([x, np.cross(z, x), z], axis=1), position)
    table = np.zeros((n, 5))
    for i in range(n):
        if i < n - 1:
            next_z, next_origin = axes.directions[i + 1], axes.origins[i + 1]
            next_x, foot = _common_normal(x, z, position, next_z, next_origin)
        else:
            next_z = z * (1.0 if np.dot(flange[:3, 2], z) >= 0 else -1.0)
            next_x = _across(flange[:3, 0], z, flange[:3, 1])
            foot = position + z * np.dot(flange[:3, 3] - position, z)
        table[i], x = _link(x, z, position, next_x, next_z, foot)
        z, position = next_z, foot
    table[np.abs(table) < 1e-14] = 0.0
    parallel = parallel_links("distal", table[:, 3])
    table[~np.array(parallel), 4] = 0.0
    lower, upper, speed, acceleration = limits
    chain = Chain(
        name=name, convention="distal", joint_names=joint_names, prismatic=prismatic, table=table, sign=np.ones(n),
        lower=lower, upper=upper, speed=speed, acceleration=acceleration, parallel=parallel,
    )  # fmt: skip
    return chain, frame0


def _link(x: Array, z: Array, position: Array, next_x: Array, next_z: Array, foot: Array) -> tuple[Array, Array]:
    """Return a row of the distal table, and x of the next frame after alpha and beta."""
    theta = np.arctan2(np.dot(next_x, np.cross(z, x)), np.dot(next_x, x))
    d, a = np.dot(foot - position, z), np.dot(foot - position, next_x)
    turned = np.stack([next_x, np.cross(z, next_x), z], axis=1)
    towards = turned.T @ next_z
    beta = np.arcsin(np.clip(towards[0], -1, 1))
    alpha = np.arctan2(-towards[1], towards[2])
    rotation = turned @ se3.exp(np.array([alpha, 0, 0])) @ se3.exp(np.array([0, beta, 0]))
    return np.array([theta, d, a, alpha, beta]), rotation[:, 0]


def _across(wanted: Array, z: Array, otherwise: Array) -> Array:
    """Return the unit vector normal to z nearest to ``wanted``, or to ``otherwise`` if that is along z."""
    flat = wanted - z * np.dot(wanted, z)
    if np.linalg.norm(flat) < 1e-6:
        flat = otherwise - z * np.dot(otherwise, z)
    across: Array = flat / np.linalg.norm(flat)
    return across


def _common_normal(x: Array, z: Array, position: Array, next_z: Array, next_origin: Array) -> tuple[Array, Array]:
    """Return x and the origin of the next frame."""
    normal = np.cross(z, next_z)
    apart = next_origin - position
    if np.linalg.norm(normal) < PARALLEL_RAD:  # parallel: meet the plane through this origin
        foot = next_origin - next_z * np.dot(apart, z) / np.dot(next_z, z)
        across = foot - position
        if np.linalg.norm(across) < 1e-9:
            return x, foot
        unit: Array = across / np.linalg.norm(across)
        return unit, foot
    normal /= np.linalg.norm(normal)
    distance = np.dot(apart, normal)
    if abs(distance) < _MEETING_M:  # the axes nearly meet: of the two normals the one that turns less
        distance = np.dot(normal, x) + 1e-12
    next_x = normal * np.sign(distance)
    foot = next_origin + next_z * np.dot(np.cross(normal, z), apart) / np.dot(np.cross(z, normal), next_z)
    return next_x, foot


def parameters_from_axes(arm: SerialArm, axes: JointAxes, start: Array) -> Truth:
    """Return the parameters near ``start`` of the arm with these axes, in the canonical gauge, by Newton's method.

    Each revolute axis is four equations, each slide two, each target three: as many as parameters of the gauge.

    Args:
        axes: in the tracker's frame.
        start: ``(p,)`` nominal links and targets, and roughly the base.
    """
    chosen = base_set(arm, start)
    identifiable = list(chosen.identifiable)
    values = start.copy()

    def step(unknowns: Array, _: NDArray[np.bool_]) -> tuple[Array, NDArray[np.bool_]]:
        values[identifiable] = unknowns[0]
        error, jacobian = _axis_errors(arm, axes, values)
        change = least_squares_step(jacobian[:, identifiable], -error, 1e-12)
        return change[None], np.array([np.linalg.norm(change) < 1e-8])  # the next one would be its square

    values[identifiable] = newton(step, values[identifiable][None], 30).values[0]
    values[3:6] = se3.log(se3.exp(values[3:6]))
    error, _ = _axis_errors(arm, axes, values)
    if np.abs(error).max() > 1e-11:
        raise LabError(
            f"robot '{arm.chain.name}': no chain like the nominal one has these axes "
            f"(off by {np.abs(error).max():.1g}); perturb less, or mend the model"
        )
    return Truth(arm, values, chosen)


def _axis_errors(arm: SerialArm, axes: JointAxes, values: Array) -> tuple[Array, Array]:
    """Return errors of directions, of positions across each revolute axis, and of targets, with derivatives."""
    motions = arm.motions(values)
    errors: list[Array] = []
    rows: list[Array] = []
    for at, motion in enumerate(motions):
        if motion.joint is None:
            continue
        j = motion.joint
        wanted, sign = axes.directions[j], arm.chain.sign[j]
        direction = motion.axis[:3, 0] * sign
        origin = motion.origin
        position = np.zeros(3) if origin is None else origin[:3, 0]
        turned, moved = _rates(motions[:at], direction, position, len(arm.names))
        errors.append(direction - wanted)
        rows.append(turned)
        if origin is not None:
            across = se3.skew(wanted)
            errors.append(across @ (position - axes.origins[j]))
            rows.append(across @ moved)
    points, jacobian = arm.observe(np.zeros((1, arm.chain.size)), values)
    errors.append((points[0] - axes.targets).ravel())
    rows.append(jacobian[0].reshape(-1, len(arm.names)))
    return np.concatenate(errors), np.concatenate(rows)


def _rates(motions: list[ElementaryMotion], direction: Array, position: Array, count: int) -> tuple[Array, Array]:
    """Return derivatives ``(3, count)`` of a direction and a position by these motions."""
    turned, moved = np.zeros((3, count)), np.zeros((3, count))
    columns = [motion.column for motion in motions]
    axis = np.array([motion.axis[:3, 0] for motion in motions]).T
    origin = np.array([axis[:, i] if m.origin is None else m.origin[:3, 0] for i, m in enumerate(motions)]).T
    revolute = np.array([motion.origin is not None for motion in motions])
    turned[:, columns] = np.where(revolute, -se3.skew(direction) @ axis, 0.0)
    lever = position[:, None] - origin
    swung = np.stack([axis[i - 2] * lever[i - 1] - axis[i - 1] * lever[i - 2] for i in range(3)])
    moved[:, columns] = np.where(revolute, swung, axis)
    return turned, moved
