"""How freely a serial arm moves its last frame: mobility index, degrees of freedom, redundancy, and what it cannot do.

The mobility index is the number of joints, the degrees of freedom the rank of the Jacobian at positions in general; an
arm is redundant by their difference (Mallem 2011, section 6.2). Directions of the twist that no joint makes at any
position are missing for good: a planar arm has three.
"""

from dataclasses import dataclass

import numpy as np

from lab.core.random import rng_for
from lab.core.se3 import Array
from lab.kinematics.differential import ROTATION_M
from lab.kinematics.serial.arm import SerialArm
from lab.kinematics.serial.chain import Chain

__all__ = ["Mobility", "mobility_of"]

_POSES = 50
_NONE = 1e-9  # of the largest singular value


@dataclass(frozen=True)
class Mobility:
    """Of an arm.

    Attributes:
        index: how many joints it has.
        freedoms: the rank of its Jacobian at positions in general.
        moving: ``(n,)`` which joints take part in motions that leave the last frame where it is, at positions in
            general; none of an arm that is not redundant.
        still: ``(k, 3)`` the turns of the last frame, as unit vectors in frame 0, that no joint makes at any position.
        held: ``(k, 3)`` the same of its origin's displacements.
    """

    index: int
    freedoms: int
    moving: tuple[bool, ...]
    still: Array
    held: Array

    @property
    def redundancy(self) -> int:
        """Degree of redundancy."""
        return self.index - self.freedoms

    @property
    def planar(self) -> bool:
        """Whether the last frame stays in a plane and turns about its normal alone."""
        return len(self.still) == 2 and len(self.held) == 1 and bool(np.abs(self.still @ self.held[0]).max() < _NONE)


def mobility_of(chain: Chain) -> Mobility:
    """What a nominal arm's joints can do with its last frame."""
    arm = SerialArm(chain)
    joints = rng_for(0, "structure").uniform(-1.5, 1.5, (_POSES, chain.size))
    J = arm.tool(joints, arm.nominal())[1]
    J[:, 3:] *= ROTATION_M
    sizes, rows = np.linalg.svd(J)[1:]
    freedoms = int((sizes > _NONE * sizes[:, :1]).sum(axis=1).max())
    moving = np.abs(rows[:, freedoms:]).max(axis=(0, 1), initial=0.0) > 1e-6
    return Mobility(chain.size, freedoms, tuple(moving.tolist()), _missing(J[:, 3:]), _missing(J[:, :3]))


def _missing(parts: Array) -> Array:
    """Directions ``(k, 3)`` in which none of the columns of ``(n, 3, joints)`` has a part."""
    sides, sizes, _ = np.linalg.svd(parts.transpose(1, 0, 2).reshape(3, -1))
    return np.asarray(sides.T[sizes <= _NONE * max(float(sizes[0]), ROTATION_M)])
