"""Poses a robot can take: within limits and touching nothing."""

from collections.abc import Iterator

import mujoco
import numpy as np
from numpy.typing import NDArray

from lab.core.errors import LabError
from lab.core.se3 import Array
from lab.simulation.model import RobotModel

_BLOCK = 64
_MOST_BLOCKS = 2000


def standing(robot: RobotModel, joints: Array, data: mujoco.MjData | None = None) -> Iterator[mujoco.MjData]:
    """The nominal model's kinematics at each of the readings ``(n, joints)``, always in the same data.

    Making an MjData takes as long as fifty poses: who asks again and again hands one in.
    """
    model = robot.model
    data = mujoco.MjData(model) if data is None else data
    for qpos in robot.qpos(joints):
        data.qpos[:] = qpos
        mujoco.mj_kinematics(model, data)
        yield data


def collision_flags(robot: RobotModel, joints: Array, data: mujoco.MjData | None = None) -> Iterator[bool]:
    """Whether the nominal arm touches itself or its surroundings, one reading of ``(n, joints)`` after the other.

    So does, as it were, a mechanism whose loops do not close.
    """
    data = mujoco.MjData(robot.model) if data is None else data
    stands = robot.qpos(joints)
    lost = np.asarray(np.isnan(stands).any(axis=1))
    for i, qpos in enumerate(stands):
        if lost[i]:
            yield True
            continue
        data.qpos[:] = qpos
        mujoco.mj_kinematics(robot.model, data)
        mujoco.mj_comPos(robot.model, data)
        mujoco.mj_collision(robot.model, data)
        yield data.ncon > 0


def collides(robot: RobotModel, joints: Array) -> NDArray[np.bool_]:
    """``(n,)``: whether the nominal arm touches itself or its surroundings at readings ``(n, joints)``."""
    return np.fromiter(collision_flags(robot, joints), bool, len(joints))


def random_poses(robot: RobotModel, count: int, rng: np.random.Generator) -> Array:
    """``(count, joints)`` readings uniform over the limits, without those that collide.

    Drawn in blocks of a fixed size, so that asking for more keeps the first ones.

    Raises:
        LabError: hardly any pose is free of collisions.
    """
    found: list[Array] = []
    have = 0
    for _ in range(_MOST_BLOCKS):
        block = robot.chain.random_joints(_BLOCK, rng)
        free = block[~collides(robot, block)]
        found.append(free)
        have += len(free)
        if have >= count:
            return np.concatenate(found)[:count]
    raise LabError(
        f"{robot.path}: only {have} of {_BLOCK * _MOST_BLOCKS} random poses touch nothing; "
        "check the collision shapes at the zero pose"
    )
