"""A serial arm in some placements, drawn as lines with its frames."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from lab.core.se3 import Array
from lab.kinematics.serial.arm import SerialArm
from lab.render.scene import placement_picture, skeleton

if TYPE_CHECKING:
    from lab.render.document import Picture

__all__ = ["placements"]


def placements(arm: SerialArm, values: Array, titles: Sequence[str], joints: Array) -> "tuple[Picture, ...]":
    """A picture for each row of joint positions ``(n, joints)``."""
    lines = skeleton(arm, values, joints).lines
    base = np.tile(np.eye(4), (len(joints), 1, 1))
    frames = np.stack([base, *(arm.frame(joints, values, size) for size in range(1, arm.chain.size + 1))], axis=1)
    return tuple(placement_picture(i, title, lines, frames) for i, title in enumerate(titles))
