"""An arm's lines in the frame of its base, whatever base its parameters say."""

from dataclasses import dataclass

import numpy as np

from lab.core.se3 import Array
from lab.kinematics.model import RigidArm
from lab.kinematics.skeleton import Skeleton

__all__ = ["Legs", "skeleton"]


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
