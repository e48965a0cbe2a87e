"""Elastic errors of an arm by its segments, and the joint positions that make up for them (Benmisra 2007, 3.21-3.38).

The rigid arm's tool is at X_R, the deformed arm's at X_D = F_d(q, u), with u the torsors of its segments: the elastic
error is dX = X_D - X_R (eq. 3.21), in all and by segment. Sent to X_C = X_R - dX (eq. 3.36 b) the deformed arm gets to
X_R: joints move by -J+ dX (eq. 3.37, 3.38), again and again where the error is large. An arm with fewer than six
joints leaves out the components of dX that no joint can make.

Tracking errors of an identified arm along a trajectory, and the joint positions that make up for them.

Quasi-static (Benmisra 2007, figure 3.7): at each instant joints and links bear gravity, a payload and the inertia of
the arm as it moves rigidly by q, q', q''. Vibration is left out.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lab.core import se3
from lab.core.se3 import Array
from lab.kinematics.differential import SINGULAR_M, WEIGHTS
from lab.kinematics.effects.arm import Arm, ArmWithEffects
from lab.kinematics.serial.arm import SerialArm
from lab.kinematics.serial.walk import RIGID, Torsors

__all__ = [
    "Correction",
    "ElasticErrors",
    "ToolAt",
    "Tracking",
    "compensated",
    "elastic_errors",
    "error_between",
    "greville",
    "tracking",
]

ToolAt = Callable[[Array], tuple[Array, Array]]
"""X_d = F_d(q, u): joint positions ``(n, joints)`` to the deformed arm's tool ``(n, 4, 4)`` there, and its Jacobian
``(n, 6, joints)`` (``SerialArm.tool``): a model of deformations, its loads in it."""

_ROUNDS = 30
_SETTLED = 1e-12  # m, a radian as ``ROTATION_M``: what is left of the components that can be made
_LEAST = 1e-9  # of a column beside those before it, that counts as none


@dataclass(frozen=True)
class ElasticErrors:
    """How far the deformed arm's tool is from the rigid one's, m and rad (a rotation vector), in the tracker's frame.

    Attributes:
        total: ``(n, 6)``.
        by_link: ``(n, links, 6)``, of each link alone, all others rigid; they add up to first order.
        links: which links those are, from 0.
    """

    total: Array
    by_link: Array
    links: tuple[int, ...]


@dataclass(frozen=True)
class Correction:
    """Joint positions that let the deformed arm's tool be where the rigid arm's would be.

    Attributes:
        joints: ``(n, joints)`` q_C.
        made: ``(6,)`` which components (x y z rx ry rz) are made up for; the others no joint can make as well.
        left: ``(n, 6)`` what is left of the elastic error, m and rad.
        rounds: how many iterations it took.
    """

    joints: Array
    made: NDArray[np.bool_]
    left: Array
    rounds: int


def elastic_errors(arm: SerialArm, values: Array, joints: Array, torsors: Torsors, target: int = 0) -> ElasticErrors:
    """The elastic errors of a target at joint positions ``(n, joints)``, for parameters ``(p,)``."""
    rigid = arm.tool(joints, values, target)[0]
    alone = [error_between(rigid, arm.tool(joints, values, target, {link: each})[0]) for link, each in torsors.items()]
    total = error_between(rigid, arm.tool(joints, values, target, torsors)[0])
    return ElasticErrors(total, np.stack(alone, axis=1) if alone else np.zeros((len(joints), 0, 6)), tuple(torsors))


def compensated(rigid: tuple[Array, Array], joints: Array, deformed: ToolAt) -> Correction:
    """Bring the deformed arm's tool to where joint positions ``(n, joints)`` bring the rigid arm's.

    The components that are made up for are the first ones, in the order x y z rx ry rz, that are independent where the
    joints are: of a planar arm with two joints, x and y.

    Args:
        rigid: the rigid arm's tool ``(n, 4, 4)`` at the joint positions, and its Jacobian ``(n, 6, joints)``.
        deformed: the deformed arm's.
    """
    wanted, made = rigid[0], _can_be_made(rigid[1])
    moved, rounds = joints.astype(np.float64), 0
    while True:
        Ts, jacobian = deformed(moved)
        left = error_between(wanted, Ts)
        if rounds == _ROUNDS or np.abs(left[:, made] * WEIGHTS[made]).max(initial=0.0) <= _SETTLED:
            return Correction(moved, made, left, rounds)
        weighted = WEIGHTS[made, None] * jacobian[:, made]
        inverse = np.stack([greville(each) for each in weighted])
        moved = moved - (inverse @ (WEIGHTS[made] * left[:, made])[:, :, None])[:, :, 0]
        rounds += 1


def greville(matrix: Array) -> Array:
    """The pseudo-inverse ``(c, r)`` of a matrix ``(r, c)``, column by column (Greville 1960).

    With d = A+ a the coordinates of the next column a among those before, and c = a - A d what is new in it, the next
    row b is c' / c'c, or d' A+ / (1 + d'd) where nothing is new; the rows above become A+ - d b.
    """
    rows, columns = matrix.shape
    inverse = np.zeros((0, rows))
    least = _LEAST * max(float(np.linalg.norm(matrix)), 1e-300)
    for k in range(columns):
        column = matrix[:, k]
        among = inverse @ column
        new = column - matrix[:, :k] @ among
        if np.linalg.norm(new) > least:
            row = new / (new @ new)
        else:
            row = among @ inverse / (1 + among @ among) if k else np.zeros(rows)
        inverse = np.concatenate([inverse - np.outer(among, row), row[None]])
    return inverse


def error_between(rigid: Array, deformed: Array) -> Array:
    """DX = X_D - X_R of poses ``(n, 4, 4)``: ``(n, 6)`` m, and the rotation vector (rad) in the tracker's frame."""
    turned = se3.log(deformed[:, :3, :3] @ rigid[:, :3, :3].swapaxes(1, 2))
    return np.concatenate([deformed[:, :3, 3] - rigid[:, :3, 3], turned], axis=1)


def _can_be_made(jacobian: Array) -> NDArray[np.bool_]:
    """``(6,)`` the first components that are independent of each other at most poses, of ``(n, 6, joints)``."""
    made = np.zeros(6, dtype=np.bool_)
    for component in range(6):
        made[component] = True
        ranks = np.linalg.matrix_rank(WEIGHTS[made, None] * jacobian[:, made], tol=SINGULAR_M)
        made[component] = bool(np.median(ranks) == made.sum())
    return made


@dataclass(frozen=True)
class Tracking:
    """An arm along a trajectory, at k times.

    Attributes:
        wanted: ``(k, 4, 4)`` where the tool is to be, in the tracker's frame.
        total: ``(k, 6)`` what it is off by (m; a rotation vector, rad) with the joints as they are commanded.
        parts: ``(k, 6)`` each, what of that is the geometry's, the joints' and each link's alone; they add up to first
            order. Parts that the arm does not have are left out.
        standing: ``(k, n)`` where the joints then are.
        torsors: how far the links' ends are displaced.
        corrected: the joint positions to command instead.
    """

    wanted: Array
    total: Array
    parts: Mapping[str, Array]
    standing: Array
    torsors: Torsors
    corrected: Correction


def tracking(arm: Arm, values: Array, wanted: tuple[Array, Array], joints: Array, rest: Array, target: int) -> Tracking:
    """Errors and correction along a trajectory.

    Args:
        arm: as identified, in motion (``Robot.arm_with``).
        values: its parameters ``(p,)``.
        wanted: where the controller's model brings the tool ``(k, 4, 4)``, and how its joints move it
            ``(k, 6, joints)``.
        joints: ``(k, joints)`` as commanded.
        rest: ``(k, c)`` what the arm's effects ask for, its ``conditions``.
        target: of the tool, which one is tracked.
    """

    def deformed(there: Array) -> tuple[Array, Array]:
        return arm.tool(np.concatenate([there, rest], axis=1), values, target)

    rigid, inputs = arm.rigid, np.concatenate([joints, rest], axis=1)
    own = values[: len(rigid.names)]
    standing, torsors = joints, RIGID
    if isinstance(arm, ArmWithEffects):
        standing, torsors = arm.standing(inputs, values), arm.torsors(inputs, values)
    exact, moved = (rigid.tool(each, own, target)[0] for each in (joints, standing))
    parts = {"geometry": error_between(wanted[0], exact), "joints": error_between(exact, moved)}
    if torsors and isinstance(rigid, SerialArm):
        each = elastic_errors(rigid, own, standing, torsors, target)
        parts |= {f"link {link + 1}": each.by_link[:, i] for i, link in enumerate(each.links)}
    total = error_between(wanted[0], deformed(joints)[0])
    kept = {name: part for name, part in parts.items() if part.any()}
    return Tracking(wanted[0], total, kept, standing, torsors, compensated(wanted, joints, deformed))
