"""Poses a robot can take: within limits and touching nothing."""

import copy
from collections.abc import Iterator
from dataclasses import replace
from typing import TypeVar

import mujoco
import numpy as np
from numpy.typing import NDArray

from lab.core.errors import LabError
from lab.core.se3 import Array
from lab.simulation.model import RobotModel

__all__ = ["at_contacts", "collides", "collision_flags", "collisions_in_words", "random_poses", "standing", "unchecked"]

Model = TypeVar("Model", bound=RobotModel)

_BLOCK = 64
_MOST_BLOCKS = 2000


def standing(robot: RobotModel, joints: Array, data: mujoco.MjData | None = None) -> Iterator[mujoco.MjData]:
    """The nominal model's kinematics at each of the joint positions ``(n, joints)``, always in the same data.

    Making an MjData takes as long as fifty poses: who asks again and again hands one in.
    """
    model = robot.model
    data = mujoco.MjData(model) if data is None else data
    for qpos in robot.qpos(joints):
        data.qpos[:] = qpos
        mujoco.mj_kinematics(model, data)
        yield data


def at_contacts(model: mujoco.MjModel, qpos: Array, data: mujoco.MjData | None = None) -> Iterator[mujoco.MjData]:
    """A model's contacts at each of the coordinates ``(n, nq)``, always in the same data."""
    data = mujoco.MjData(model) if data is None else data
    for row in qpos:
        data.qpos[:] = row
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        mujoco.mj_collision(model, data)
        yield data


def collision_flags(robot: RobotModel, joints: Array, data: mujoco.MjData | None = None) -> Iterator[bool]:
    """Whether the nominal arm touches itself or its surroundings, one row of joint positions ``(n, joints)`` at a time.

    A mechanism whose loops do not close there counts as touching.
    """
    qpos = robot.qpos(joints)
    lost = np.asarray(np.isnan(qpos).any(axis=1))
    contacts = at_contacts(robot.model, qpos[~lost], data)
    for open_loop in lost:
        yield True if open_loop else next(contacts).ncon > 0


def collides(robot: RobotModel, joints: Array) -> NDArray[np.bool_]:
    """``(n,)``: whether the nominal arm touches itself or its surroundings at joint positions ``(n, joints)``."""
    return np.fromiter(collision_flags(robot, joints), bool, len(joints))


def collisions_in_words(robot: RobotModel, joints: Array) -> tuple[str, ...]:
    """What the nominal arm touches, or comes too near to, at each of the joint positions ``(n, joints)``.

    Returns:
        One text for each row, of its deepest contact: "upper_arm is 12 mm deep in table"; "" where it touches nothing.
    """
    qpos = robot.qpos(joints)
    lost = np.asarray(np.isnan(qpos).any(axis=1))
    contacts = at_contacts(robot.model, qpos[~lost])
    return tuple("its loops do not close there" if open_loop else _deepest(next(contacts), robot) for open_loop in lost)


def _deepest(data: mujoco.MjData, robot: RobotModel) -> str:
    """The deepest of the contacts that ``data`` holds, in words; "" without any."""
    if not data.ncon:
        return ""
    deepest = int(np.argmin(data.contact.dist))
    first, second = (_name(robot.model, int(geom)) for geom in data.contact.geom[deepest][::-1])
    distance_mm = 1e3 * float(data.contact.dist[deepest])
    if distance_mm > 0:
        return f"{first} is {distance_mm:.2g} mm from {second}, nearer than the clearance"
    return f"{first} is {-distance_mm:.2g} mm deep in {second}"


def _name(model: mujoco.MjModel, geom: int) -> str:
    """What a person calls a shape: the body that it belongs to, or its own name where it stands in the world."""
    body = int(model.geom_bodyid[geom])
    return str(model.body(body).name if body else model.geom(geom).name) or f"shape {geom} of the surroundings"


def unchecked(robot: Model) -> Model:
    """A copy of a robot that touches nothing, wherever it is: for who does not want collisions to be checked."""
    model = copy.deepcopy(robot.model)
    model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONTACT)
    return replace(robot, model=model)


def random_poses(robot: RobotModel, count: int, rng: np.random.Generator) -> Array:
    """``(count, joints)`` joint positions uniform over the limits, without those that collide.

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
