"""How alike two poses' errors are: covariances of the joints' offsets, by how far apart the joint positions are.

Each joint is off by the sum of a function of its own position, as gears are, and one of all positions, as what gives
way is. Either is a sum of stationary Gaussian processes of several lengths (Rasmussen & Williams 2006, section 4.2):
Matern's with 3/2 of the own position; with 1/2 of all, which trusts no smoothness that nobody measured, and beside it
with 5/2 and longer lengths, as the sag of springs varies: the data choose how much of each. Distances of hinges are
chords, 2 sin(d / 2), so that a whole turn leads back; a slide's are in units of 0.3 m.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lab.core.se3 import Array
from lab.kinematics.effects.effect import LEVER_M

__all__ = ["COMPONENTS", "JointKernels"]

_OWN = (0.05, 0.2, 0.8)  # rad: lengths of the functions of a joint's own position
_ALL = (0.1, 0.4, 1.6)  # of those of all positions
_SMOOTH = (1.0, 4.0)  # of smooth functions of all positions
COMPONENTS = (
    *("noise", "scatter"),
    *(f"own {size:g}" for size in _OWN),
    *(f"all {size:g}" for size in _ALL),
    *(f"smooth {size:g}" for size in _SMOOTH),
)


@dataclass(frozen=True)
class JointKernels:
    """The processes of an arm's joints.

    Attributes:
        turning: ``(joints,)`` which joints turn.
    """

    turning: NDArray[np.bool_]

    def of_offsets(self, first: Array, second: Array) -> Iterator[tuple[bool, Array]]:
        """Unit covariances of the offsets at joint positions ``(n, joints)`` and ``(m, joints)``, one a length.

        Yields:
            Whether it is of each joint's own position; ``(n, m, joints)`` if so, else ``(n, m)``, of every joint.
        """
        apart = first[:, None] - second
        apart = np.where(self.turning, 2 * np.sin(apart / 2), apart / LEVER_M)
        own = np.abs(apart)
        whole = np.sqrt((apart**2).sum(axis=2))
        for size in _OWN:
            scaled = np.sqrt(3) * own / size
            yield True, (1 + scaled) * np.exp(-scaled)
        for size in _ALL:
            yield False, np.exp(-whole / size)
        for size in _SMOOTH:
            scaled = np.sqrt(5) * whole / size
            yield False, (1 + scaled + scaled**2 / 3) * np.exp(-scaled)

    def of_joints(self, sizes: Array, first: Array, second: Array) -> Array:
        """Covariances ``(joints, n, m)`` of each joint's offsets: the sum of all lengths with these variances.

        Args:
            sizes: ``(lengths,)`` in the order of ``of_offsets``.
            first, second: joint positions ``(n, joints)`` and ``(m, joints)``.
        """
        found = np.zeros((first.shape[1], len(first), len(second)))
        for (own, kernel), size in zip(self.of_offsets(first, second), sizes, strict=True):
            if size > 0:
                found += size * (np.moveaxis(kernel, 2, 0) if own else kernel)
        return found
