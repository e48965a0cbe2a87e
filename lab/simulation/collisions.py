"""Poses a robot can take: within limits and touching nothing.

Where a model's shapes have margins, they touch as soon as they are within them.
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
from lab.simulation.model import RobotModel

__all__ = [
    "LOWER_CLEARANCE",
    "REFLECTOR",
    "at_contacts",
    "collides",
    "colliding_pairs",
    "collision_flags",
    "describe_collisions",
    "keeps_clearances",
    "most_frequent",
    "random_poses",
    "standing",
    "unchecked",
]

Model = TypeVar("Model", bound=RobotModel)

LOWER_CLEARANCE = (
    "lower --clearance-mm (from surroundings), --self-clearance-mm (from the arm itself) or clearance_mm of the cell"
)
REFLECTOR = "reflector at "  # before a target's name: the body that its reflector and nest are
_BLOCK = 64
_MOST_BLOCKS, _PATIENCE = 2000, 200
_NAMED_PAIRS = 4


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
    """A model's contacts at each of the coordinates ``(n, nq)``, always in the same data.

    Contacts follow from where the shapes are: of the positions that MuJoCo computes nothing else is asked for.
    """
    data = mujoco.MjData(model) if data is None else data
    coordinates = data.qpos  # a view
    for row in qpos:
        coordinates[:] = row
        mujoco.mj_kinematics(model, data)
        mujoco.mj_collision(model, data)
        yield data


def collision_flags(robot: RobotModel, joints: Array, data: mujoco.MjData | None = None) -> Iterator[bool]:
    """Yield for each row of joint positions ``(n, joints)`` whether the nominal arm touches itself or its surroundings.

    A mechanism whose loops do not close there counts as touching.
    """
    qpos = robot.qpos(joints)
    lost = np.asarray(np.isnan(qpos).any(axis=1))
    contacts = at_contacts(robot.model, qpos[~lost], data)
    return (True if open_loop else next(contacts).ncon > 0 for open_loop in lost)


def collides(robot: RobotModel, joints: Array) -> NDArray[np.bool_]:
    """``(n,)``: whether the nominal arm touches itself or its surroundings at joint positions ``(n, joints)``."""
    return np.fromiter(collision_flags(robot, joints), bool, len(joints))


def describe_collisions(robot: RobotModel, joints: Array) -> tuple[str, ...]:
    """Describe the nominal arm's contacts, or violated clearances, at each of the joint positions ``(n, joints)``.

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
    first, second = _pair(robot.model, data.contact.geom[deepest])
    distance_mm = MM.of(float(data.contact.dist[deepest]))
    size = f"{abs(distance_mm):.{0 if abs(distance_mm) > 10 else 1}f} mm"
    if distance_mm <= 0:
        return f"{first} is {size} deep in {second}"
    return f"{first} is {size} from {second}, nearer than the clearance, {_margin_mm(data, deepest):.3g} mm"


def colliding_pairs(robot: RobotModel, joints: Array) -> dict[tuple[str, str], int]:
    """Count the rows of ``(n, joints)`` at which each pair of shapes touches or is too near; most frequent first.

    Of each pair of names, the first one moves.
    """
    qpos = robot.qpos(joints)
    found: Counter[tuple[str, str]] = Counter()
    for data in at_contacts(robot.model, qpos[~np.isnan(qpos).any(axis=1)]):
        found.update({_pair(robot.model, pair) for pair in data.contact.geom})
    return dict(found.most_common())


def most_frequent(robot: RobotModel, joints: Array) -> str:
    """Describe the most frequent contacts over the joint positions ``(n, joints)``; a few pairs at most."""
    pairs = list(colliding_pairs(robot, joints).items())[:_NAMED_PAIRS]
    touches = "is too near to" if keeps_clearances(robot.model) else "touches"
    return ", ".join(f"{one} {touches} {other} in {count}" for (one, other), count in pairs) or "nothing touches"


def keeps_clearances(model: mujoco.MjModel) -> bool:
    """Decide whether some shapes of a model have a clearance: contact before they touch."""
    return bool(model.geom_margin.any() or model.pair_margin.any())


def _margin_mm(data: mujoco.MjData, contact: int) -> float:
    return MM.of(float(data.contact.includemargin[contact]))


def _pair(model: mujoco.MjModel, geoms: NDArray[np.int_]) -> tuple[str, str]:
    """The names of two shapes that touch, what moves before what stands still, else what is farther out first."""
    bodies = model.geom_bodyid[geoms]
    outer_first = sorted(range(2), key=lambda i: (model.body_weldid[bodies[i]] > 0, bodies[i]), reverse=True)
    return _name(model, int(geoms[outer_first[0]])), _name(model, int(geoms[outer_first[1]]))


def _name(model: mujoco.MjModel, geom: int) -> str:
    """Return the name of a shape for the user: its body's, or its own where it is fixed in the world."""
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
    for blocks in range(1, _MOST_BLOCKS + 1):
        block = robot.chain.random_joints(_BLOCK, rng)
        free = block[~collides(robot, block)]
        found.append(free)
        have += len(free)
        if have >= count:
            return np.concatenate(found)[:count]
        if blocks >= _PATIENCE and 2 * have * _MOST_BLOCKS < count * blocks:
            break  # as it goes, half of them will not be found
    raise LabError(
        f"{robot.path}: only {have} of {_BLOCK * blocks} random poses touch nothing; of {_BLOCK}, "
        f"{most_frequent(robot, block)}; give these shapes room, or exclude the contact in the model"
    )
