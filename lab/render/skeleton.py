"""An arm's lines in the frame of its base, whatever base its parameters say."""

from dataclasses import dataclass

import numpy as np

from lab.core.se3 import Array
from lab.kinematics.model import RigidArm
from lab.kinematics.skeleton import Skeleton

__all__ = ["Legs", "frame_lines", "frame_origins", "legs", "line_frames", "skeleton", "strips"]


@dataclass(frozen=True)
class Legs:
    """What of a mechanism is no body: its rods, and legs whose length is a joint position.

    Attributes:
        ends: ``(n, legs, 2, 3)`` m, the base's side first; a serial arm has none.
        measured: of each leg, whether its length is a joint position.
    """

    ends: Array
    measured: tuple[bool, ...]


def skeleton(arm: RigidArm, values: Array, joints: Array) -> Skeleton:
    """The arm with parameters ``values`` ``(p,)`` as lines at joint positions ``(n, joints)``."""
    return arm.skeleton(joints, np.concatenate([np.zeros(6), values[6:]]))


def legs(arm: RigidArm, values: Array, joints: Array) -> Legs:
    """The rods and legs."""
    found = skeleton(arm, values, joints)
    return Legs(found.rods, found.measured)


def strips(arm: RigidArm, values: Array, joints: Array) -> list[Array]:
    """Lines ``(n, c, 3)`` m: one along a chain, one along each leg of a mechanism."""
    return skeleton(arm, values, joints).lines


def frame_origins(arm: RigidArm, values: Array, joints: Array) -> Array:
    """Where the arm's frames are ``(n, f, 3)`` m, from the base's own outward to the targets'."""
    return skeleton(arm, values, joints).origins


def line_frames(arm: RigidArm, values: Array, joints: Array) -> Array:
    """The frames on the arm's lines ``(n, f, 3)`` m, last the one that carries the targets."""
    return skeleton(arm, values, joints).frames


def frame_lines(arm: RigidArm, values: Array, joints: Array) -> list[Array]:
    """Lines ``(n, f, 3)`` from frame to frame, as ``strips``."""
    return skeleton(arm, values, joints).frame_lines
