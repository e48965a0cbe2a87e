"""Joints that give way to the weight of links whose masses nobody knows.

The torque of link l's weight about joint i is linear in the link's mass and first moment (Khalil & Dombre 2002,
section 9.3.2). A mass times a constant lever acts like a first moment of the link that holds the lever, and a moment
along axis l like one of the link before: what is left of each link are its first moments across its own axis, along x
and y of its frame. A joint that gives way by c_i then stands at q_i + c_i m_l |g| (x_l, y_l) . r_il, with r_il the
torques of a unit weight there; c_i and m_l are known as their product alone, which is the parameter.
"""

import numpy as np

from lab.core.errors import LabError
from lab.core.se3 import Array
from lab.kinematics.dynamics.gravity import Loads
from lab.kinematics.effects.effect import ArmFacts, Effect, TermFamily, joint_terms, turning_joints
from lab.kinematics.parameter import joint_parameter
from lab.kinematics.serial.chain import Chain

__all__ = ["GRAVITY"]

_DOWN = np.array([0.0, 0.0, -1.0])  # in frame 0, where a file does not say


def _of_one_link(arm: ArmFacts, joint: int, link: int) -> Effect:
    """How far a joint, from 0, gives way (rad) to a link's weight, from 1: along x of its frame, and along y."""
    name, chain = GRAVITY.name(joint, link), arm.chain
    if not isinstance(chain, Chain) or (joint, link) not in _searched(arm):
        raise LabError(f"--model {name}: give a joint that turns and a link that it carries, of a robot without loops")
    parameters = tuple(joint_parameter(name, joint, f"gravity{link}{axis}") for axis in "xy")
    down = _DOWN if arm.loads is None else arm.loads.gravity / np.linalg.norm(arm.loads.gravity)

    def offsets(joints: Array, _: Array, values: Array) -> tuple[Array, Array]:
        derivative = np.zeros((*joints.shape, 2))
        derivative[:, joint] = _unit_torques(chain, joints, down, joint, link - 1)
        return derivative @ values, derivative

    where = [(joint, ("weight", joint, link - 1, axis, down.tolist())) for axis in range(2)]
    return Effect(name, parameters, offsets, plain=lambda values: joint_terms(values, *where))


def _unit_torques(chain: Chain, joints: Array, down: Array, joint: int, link: int) -> Array:
    """Torques about a hinge of a unit weight times metre on a link, along x and y of its frame, ``(n, 2)``.

    Args:
        down: unit vector ``(3,)`` in frame 0.
        joint, link: from 0; the frame turns with the link's own joint, z along that joint's axis.
    """
    frames = Loads(chain, np.zeros(chain.size), np.zeros((chain.size, 3)), down).frames(joints)
    across = np.cross(down, frames.axes[:, joint])  # down . (z x r) = (down x z) . r
    torques: Array = np.einsum("ni,nij->nj", across, frames.rotations[:, link, :, :2])
    return torques


def _searched(arm: ArmFacts) -> list[tuple[int, int]]:
    """Every hinge with its own link and all beyond that turn."""
    if not isinstance(arm.chain, Chain):
        return []
    turning = turning_joints(arm.chain)
    return [(i, link + 1) for i in turning for link in turning if link >= i]


GRAVITY = TermFamily(
    "gravity",
    "a link, whose weight it gives way to",
    _of_one_link,
    _searched,
    lambda joint, link: f"joint {joint} gives way to the weight of link {link}",
)
