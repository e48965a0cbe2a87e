"""Check poses for collisions, and draw poses without any.

Shapes with margins touch as soon as they are within them.
"""

import copy
from collections import Counter
from collections.abc import Iterator
from dataclasses import replace
from typing import TypeVar

import mujoco
import numpy as np
from numpy.typing import NDArray

from lab.core.errors import LabError
from lab.core.se3 import Array
from lab.core.units import MM
from lab.simulation.robot_model import RobotModel

__all__ = [
    "LOWER_CLEARANCE",
    "REFLECTOR",
    "collides",
    "colliding_pairs",
    "collision_flags",
    "contacts_at",
    "describe_collisions",
    "keeps_clearances",
    "kinematics_at",
    "most_frequent",
    "random_poses",
    "touching_bodies",
    "unchecked",
]

_Model = TypeVar("_Model", bound=RobotModel)

LOWER_CLEARANCE = (
    "lower --clearance-mm (from surroundings), --self-clearance-mm (from the arm itself) or clearance_mm of the cell"
)
REFLECTOR = "reflector at "  # before a target's name: the body of its reflector and nest
_BLOCK = 64
_MAX_BLOCKS, _PATIENCE = 2000, 200
_MAX_PAIRS = 4


def kinematics_at(robot: RobotModel, joints: Array, data: mujoco.MjData | None = None) -> Iterator[mujoco.MjData]:
    """Yield the nominal model's kinematics at joint positions ``(n, joints)``, always in the same data.

    An MjData takes as long to make as fifty poses: repeated callers give one.
    """
    model = robot.model
    data = mujoco.MjData(model) if data is None else data
    for qpos in robot.qpos(joints):
        data.qpos[:] = qpos
        mujoco.mj_kinematics(model, data)
        yield data


def contacts_at(model: mujoco.MjModel, qpos: Array, data: mujoco.MjData | None = None) -> Iterator[mujoco.MjData]:
    """Yield a model's contacts at coordinates ``(n, nq)``, always in the same data."""
    data = mujoco.MjData(model) if data is None else data
    coordinates = data.qpos  # a view
    for row in qpos:
        coordinates[:] = row
        mujoco.mj_kinematics(model, data)
        mujoco.mj_collision(model, data)
        yield data


def touching_bodies(model: mujoco.MjModel, qpos: Array) -> Iterator[set[tuple[int, int]]]:
    """Yield the pairs of bodies in contact at each configuration ``(n, nq)``, the lower number of a pair first."""
    for data in contacts_at(model, qpos):
        pairs = np.sort(model.geom_bodyid[data.contact.geom[: data.ncon]], axis=1)
        yield {(int(a), int(b)) for a, b in pairs}


def _contacts(robot: RobotModel, joints: Array, data: mujoco.MjData | None = None) -> Iterator[mujoco.MjData | None]:
    """Yield the nominal arm's contacts at joint positions ``(n, joints)``; None where its loops do not close."""
    qpos = robot.qpos(joints)
    open_loops = np.asarray(np.isnan(qpos).any(axis=1))
    contacts = contacts_at(robot.model, qpos[~open_loops], data)
    return (None if is_open else next(contacts) for is_open in open_loops)


def collision_flags(robot: RobotModel, joints: Array, data: mujoco.MjData | None = None) -> Iterator[bool]:
    """Yield for each row of joint positions ``(n, joints)`` whether the nominal arm touches itself or its surroundings.

    A mechanism whose loops do not close there counts as touching.
    """
    return (contacts is None or contacts.ncon > 0 for contacts in _contacts(robot, joints, data))


def collides(robot: RobotModel, joints: Array) -> NDArray[np.bool_]:
    """Return ``(n,)``: whether the nominal arm touches itself or its surroundings at ``joints`` ``(n, joints)``."""
    return np.fromiter(collision_flags(robot, joints), bool, len(joints))


def describe_collisions(robot: RobotModel, joints: Array) -> tuple[str, ...]:
    """Describe the nominal arm's contacts, or violated clearances, at each of the joint positions ``(n, joints)``.

    Returns:
        A text for each row, on its deepest contact: "upper_arm is 12 mm deep in table"; "" without contact.
    """
    return tuple(
        "its loops do not close there" if contacts is None else _deepest(contacts, robot)
        for contacts in _contacts(robot, joints)
    )


def _deepest(data: mujoco.MjData, robot: RobotModel) -> str:
    if not data.ncon:
        return ""
    deepest = int(np.argmin(data.contact.dist))
    first, second = _pair(robot.model, data.contact.geom[deepest])
    distance_mm, margin_mm = (MM.of(float(each[deepest])) for each in (data.contact.dist, data.contact.includemargin))
    size = f"{abs(distance_mm):.{0 if abs(distance_mm) > 10 else 1}f} mm"
    if distance_mm <= 0:
        return f"{first} is {size} deep in {second}"
    return f"{first} is {size} from {second}, nearer than the clearance, {margin_mm:.3g} mm"


def colliding_pairs(robot: RobotModel, joints: Array) -> dict[tuple[str, str], int]:
    """Count the rows of ``(n, joints)`` at which each pair of shapes touches or is too near; most frequent first.

    The first name of each pair is the moving shape's.
    """
    counts: Counter[tuple[str, str]] = Counter()
    for contacts in _contacts(robot, joints):
        if contacts is not None:
            counts.update({_pair(robot.model, pair) for pair in contacts.contact.geom})
    return dict(counts.most_common())


def most_frequent(robot: RobotModel, joints: Array) -> str:
    """Describe the most frequent contacts over the joint positions ``(n, joints)``; a few pairs at most."""
    pairs = list(colliding_pairs(robot, joints).items())[:_MAX_PAIRS]
    touches = "is too near to" if keeps_clearances(robot.model) else "touches"
    return ", ".join(f"{one} {touches} {other} in {count}" for (one, other), count in pairs) or "nothing touches"


def keeps_clearances(model: mujoco.MjModel) -> bool:
    """Decide whether some shapes of a model have a clearance: contact before they touch."""
    return bool(model.geom_margin.any() or model.pair_margin.any())


def _pair(model: mujoco.MjModel, geoms: NDArray[np.int_]) -> tuple[str, str]:
    """Return the names of two shapes in contact, the moving one first, else the one farther out."""
    bodies = model.geom_bodyid[geoms]
    outer_first = sorted(range(2), key=lambda i: (model.body_weldid[bodies[i]] > 0, bodies[i]), reverse=True)
    return _name(model, int(geoms[outer_first[0]])), _name(model, int(geoms[outer_first[1]]))


def _name(model: mujoco.MjModel, geom: int) -> str:
    """Return the name of a shape for the user: its body's, or its own where it is fixed in the world."""
    body = int(model.geom_bodyid[geom])
    return str(model.body(body).name if body else model.geom(geom).name) or f"shape {geom} of the surroundings"


def unchecked(robot: _Model) -> _Model:
    """Return a copy of a robot without contacts, so that collisions are not checked."""
    model = copy.deepcopy(robot.model)
    model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONTACT)
    return replace(robot, model=model)


def random_poses(robot: RobotModel, count: int, rng: np.random.Generator) -> Array:
    """Draw ``(count, joints)`` joint positions uniform over the limits, without those that collide.

    Blocks have a fixed size, so that a larger count keeps the first ones.

    Raises:
        LabError: hardly any pose is free of collisions.
    """
    free_poses: list[Array] = []
    have = 0
    for blocks in range(1, _MAX_BLOCKS + 1):
        block = robot.chain.random_joints(_BLOCK, rng)
        free = block[~collides(robot, block)]
        free_poses.append(free)
        have += len(free)
        if have >= count:
            return np.concatenate(free_poses)[:count]
        if blocks >= _PATIENCE and 2 * have * _MAX_BLOCKS < count * blocks:
            break  # at this rate, half of them will not be found
    raise LabError(
        f"{robot.path}: only {have} of {_BLOCK * blocks} random poses touch nothing; of {_BLOCK}, "
        f"{most_frequent(robot, block)}; give these shapes room, or exclude the contact in the model"
    )
