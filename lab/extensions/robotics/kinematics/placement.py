"""What a robot does at given joint positions: where its tool is, and how its joints move it."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lab.core.se3 import Array
from lab.extensions.robotics.kinematics.solutions import Solution
from lab.kinematics.differential import manipulability, rates
from lab.kinematics.inverse.closed_form import Determinant
from lab.kinematics.inverse.newton import FREEDOMS
from lab.kinematics.joints import JointSpec
from lab.kinematics.model import RigidArm

__all__ = ["Placement", "Task", "placements"]

_LEAST = 1e-9  # of a part of a self-motion: it is none


@dataclass(frozen=True)
class Placement:
    """A robot at some joint positions.

    Attributes:
        name: the row's id, or the solution's number.
        joints: ``(n,)`` rad or m.
        T_base_tool: pose ``(4, 4)`` (m) of the tool's point, turned as the last frame or the platform.
        jacobian: geometric ``(6, n)`` in the frame that was asked for: velocity of the point (m), then angular velocity
            (rad), by the joint positions.
        rank: of the Jacobian.
        manipulability: Yoshikawa's, sqrt(det J J') or sqrt(det J' J), SI.
        determinant: of the Jacobian, SI; of an arm with a closed form that of the rows that it can have; None where
            there is none.
        factors: each factor of the determinant by the name of its singularity; zero at the singularity.
        self_motions: ``(k, n)`` directions of the joints that move nothing, the largest part 1.
        lost: ``(l, 6)`` directions in which no joint moves the tool (m, rad), in the frame that was asked for.
        beyond: which limit is passed, in words; empty where none is.
        configuration: of a solution, on which side of each singularity it is.
        free: names of the joints that could stand anywhere, because the arm is singular.
        tilt_rad: by how much a wanted rotation is missed.
        rates: ``(n,)`` rad/s or m/s, given or found; None where neither rates nor a twist were asked for.
        twist: ``(6,)`` m/s and rad/s, what these rates give.
        missing: ``(6,)`` what of a wanted twist cannot be had.
    """

    name: str
    joints: Array
    T_base_tool: Array
    jacobian: Array
    rank: int
    manipulability: float
    determinant: float | None
    factors: Mapping[str, float]
    self_motions: Array
    lost: Array
    beyond: str
    configuration: Mapping[str, str]
    free: tuple[str, ...] = ()
    tilt_rad: float = 0.0
    rates: Array | None = None
    twist: Array | None = None
    missing: Array | None = None


@dataclass(frozen=True)
class Task:
    """What is asked of each placement.

    Attributes:
        in_tool_frame: whether Jacobian and twist have the tool's axes.
        rates: ``(n,)`` given ones.
        twist: ``(6,)`` a wanted one.
    """

    in_tool_frame: bool = False
    rates: Array | None = None
    twist: Array | None = None


def placements(
    arm: RigidArm,
    values: Array,
    determinant: Determinant | None,
    task: Task,
    rows: Array,
    names: Sequence[str],
    solved: Sequence[Solution] | None = None,
) -> tuple[Placement, ...]:
    """The nominal robot at each of ``rows`` ``(m, n)`` of joint positions.

    Args:
        names: of the rows.
        solved: the solutions that the rows are.
    """
    if not len(rows):
        return ()
    chain, size = arm.chain, arm.chain.size
    Ts, jacobians = arm.tool(rows, values)
    if task.in_tool_frame:
        back = Ts[:, :3, :3].swapaxes(1, 2)
        jacobians = np.concatenate([back @ jacobians[:, :3], back @ jacobians[:, 3:]], axis=1)
    wanted = np.zeros((len(rows), 6)) if task.twist is None else np.tile(task.twist, (len(rows), 1))
    closes: NDArray[np.bool_] = np.array(np.isfinite(jacobians).all(axis=(1, 2)))
    moved = rates(np.where(closes[:, None, None], jacobians, 0.0), wanted)
    width = np.where(closes, manipulability(np.where(closes[:, None, None], jacobians, 0.0)), np.nan)
    out = []
    for i, (joints, name) in enumerate(zip(rows, names, strict=True)):
        way = None if solved is None else solved[i]
        factors = {} if determinant is None else {f.name: float(f.at(joints)) for f in determinant.factors if f.terms}
        size_of = None if determinant is None else float(determinant.at(joints))
        if determinant is None and size == FREEDOMS:
            size_of = float(np.linalg.det(jacobians[i]))
        given = task.rates if task.rates is not None else moved.joints[i] if task.twist is not None else None
        rank = int(moved.rank[i])
        self_motions = moved.free[i, : size - rank]
        out.append(
            Placement(
                name, joints, Ts[i], jacobians[i], rank, float(width[i]), size_of, factors,
                _largest_one(self_motions), moved.lost[i, : 6 - rank], _beyond(arm, joints, bool(closes[i])),
                {} if way is None else way.configuration, () if way is None else _names(chain, way.free),
                0.0 if way is None else way.tilt_rad, given, None if given is None else jacobians[i] @ given,
                None if task.twist is None else moved.missing[i],
            )
        )  # fmt: skip
    return tuple(out)


def _largest_one(rows: Array) -> Array:
    """Rows scaled so that the largest part is 1, without what rounding left."""
    scaled = rows / np.abs(rows).max(axis=1, keepdims=True, initial=1e-300) if len(rows) else rows
    return np.asarray(np.where(np.abs(scaled) < _LEAST, 0.0, scaled))


def _names(chain: JointSpec, chosen: NDArray[np.bool_]) -> tuple[str, ...]:
    return tuple(name for name, each in zip(chain.joint_names, chosen, strict=True) if each)


def _beyond(arm: RigidArm, joints: Array, closes: bool) -> str:
    """Which limit some joint positions pass the farthest, or why the loops do not close, in words."""
    if not closes:
        return arm.chain.infeasibility_reason(joints)
    excess = arm.chain.excess(joints)
    j = int(np.argmax(excess))
    return arm.chain.said_beyond(j, joints[j]) if excess[j] > _LEAST else ""
