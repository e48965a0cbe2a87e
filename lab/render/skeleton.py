"""An arm as lines, for pictures and for knowing where it is."""

from dataclasses import dataclass

import numpy as np

from lab.core.se3 import Array
from lab.kinematics.closed.arm import ClosedArm
from lab.kinematics.model import RigidArm
from lab.kinematics.serial.arm import SerialArm


@dataclass(frozen=True)
class Legs:
    """What of a mechanism is no body: its rods, and legs whose length is a reading.

    Attributes:
        ends: ``(n, legs, 2, 3)`` m, the base's side first; a serial arm has none.
        measured: of each leg, whether its length is a reading.
    """

    ends: Array
    measured: tuple[bool, ...]


def legs(arm: RigidArm, values: Array, joints: Array) -> Legs:
    """The rods and legs in the base's frame."""
    if not isinstance(arm, ClosedArm):
        return Legs(np.empty((len(joints), 0, 2, 3)), ())
    return Legs(arm.rods(joints, _from_base(values)), tuple(rod.joint is not None for rod in arm.chain.tree.rods))


def strips(arm: RigidArm, values: Array, joints: Array) -> list[Array]:
    """Lines ``(n, c, 3)`` m in the base's frame: one along a chain, one along each leg of a mechanism."""
    still = _from_base(values)
    if isinstance(arm, ClosedArm):
        return arm.legs(joints, still)
    assert isinstance(arm, SerialArm)
    return [chain_corners(arm, still, joints)]


def _from_base(values: Array) -> Array:
    """Parameters with the base at the origin."""
    return np.concatenate([np.zeros(6), values[6:]])


def frame_origins(arm: RigidArm, values: Array, joints: Array) -> Array:
    """Where the arm's frames are ``(n, f, 3)`` m in the base's frame, from the base's own outward to the targets'."""
    places = joint_places(arm, values, joints)
    return places if isinstance(arm, SerialArm) else np.concatenate([np.zeros((len(joints), 1, 3)), places], axis=1)


def joint_places(arm: RigidArm, values: Array, joints: Array) -> Array:
    """The frames on the arm's lines ``(n, f, 3)`` m in the base's frame, last the one that carries the targets."""
    lines = frame_lines(arm, values, joints)
    if isinstance(arm, ClosedArm):
        lines = [*lines, arm.platforms(joints, _from_base(values))[:, None, :3, 3]]
    return np.concatenate(lines, axis=1)


def frame_lines(arm: RigidArm, values: Array, joints: Array) -> list[Array]:
    """Lines ``(n, f, 3)`` from frame to frame, as ``strips``."""
    lines = strips(arm, values, joints)
    return [line[:, ::2] for line in lines] if isinstance(arm, SerialArm) else lines


def chain_corners(arm: SerialArm, values: Array, joints: Array) -> Array:
    """The chain in frame 0 as a strip of lines ``(n, 2 joints + 1, 3)``; every other corner is a frame's origin.

    A link runs along its joint's axis and then along the common normal (a Craig one the other
    way round): between two origins there is the corner where it turns.
    """
    table = arm.split(values)[1]
    corners = [np.zeros((len(joints), 3))]
    for size in range(1, arm.chain.size + 1):
        Ts = arm.frame(joints, values, size)
        origin, (_, d, a, _, beta) = Ts[:, :3, 3], table[size - 1]
        if arm.chain.convention == "distal":
            corner = origin - a * (np.cos(beta) * Ts[:, :3, 0] + np.sin(beta) * Ts[:, :3, 2])  # x before beta
        else:
            reading = joints[:, size - 1] * arm.chain.sign[size - 1] if arm.chain.prismatic[size - 1] else 0.0
            corner = origin - np.atleast_1d(d + reading)[:, None] * Ts[:, :3, 2]
        corners += [corner, origin]
    return np.stack(corners, axis=1)
