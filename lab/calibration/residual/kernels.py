"""How alike two poses' errors are: covariances of the joints' offsets, by how far apart the joint positions are.

Each joint is off by the sum of a function of its own position, as gears are, and one of all positions, as what gives
way is. Either is a sum of stationary Gaussian processes of several lengths (Rasmussen & Williams 2006, section 4.2):
Matern's with 3/2 of the own position, with 1/2 of all, which trusts no smoothness that nobody measured. Distances of
hinges are chords, 2 sin(d / 2), so that a whole turn leads back; a slide's are in units of 0.3 m.
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
COMPONENTS = ("noise", "scatter", *(f"own {size:g}" for size in _OWN), *(f"all {size:g}" for size in _ALL))


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

    def of_numbers(self, first: tuple[Array, Array], second: tuple[Array, Array]) -> Iterator[Array]:
        """Unit covariances ``(n d, m d)`` of observed numbers, one a length.

        Args:
            first, second: joint positions ``(n, joints)`` and derivatives by them ``(n, d, joints)``.
        """
        (here, by_here), (there, by_there) = first, second
        shape = by_here.shape[0] * by_here.shape[1], by_there.shape[0] * by_there.shape[1]
        for own, kernel in self.of_offsets(here, there):
            rows = "nij,nmj,mkj->nimk" if own else "nij,nm,mkj->nimk"
            yield np.einsum(rows, by_here, kernel, by_there, optimize=True).reshape(shape)
