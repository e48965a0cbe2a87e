"""What an elastic link is made of: its section and material as compliances, and its line."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from lab.core.se3 import Array

__all__ = ["MATERIALS", "LinkSections", "Material", "tube"]


@dataclass(frozen=True)
class Material:
    """An elastic material: Young's modulus and the shear modulus, Pa."""

    young_pa: float
    shear_pa: float


MATERIALS: Mapping[str, Material] = {  # Gere & Goodno 2009, table H-2, the middle of each range
    "aluminium": Material(70e9, 26e9),
    "steel": Material(210e9, 80e9),
    "cast iron": Material(125e9, 50e9),
    "magnesium": Material(43e9, 16e9),
}


@dataclass(frozen=True)
class LinkSections:
    """The links of an arm as beams, by what their maker says of them.

    Attributes:
        compliances: ``(n, 4)`` of each link, as ``beam.COMPLIANCES``; zero where a link is stiff.
        paths: by link (from 0), ``(k, 3)`` m: corners of its line in its own axes (``beam.Beam``), its far end last; a
            link that is not named is straight.
    """

    compliances: Array
    paths: Mapping[int, Array]


def tube(outer_m: float, wall_m: float, material: Material) -> Array:
    """Compliances ``(4,)`` (``beam.COMPLIANCES``) of a round tube, by its outer diameter and its wall.

    I = pi (D^4 - d^4) / 64 about any axis across, the polar one twice that, and A = pi (D^2 - d^2) / 4.
    """
    inner = outer_m - 2 * wall_m
    area, second = np.pi * (outer_m**2 - inner**2) / 4, np.pi * (outer_m**4 - inner**4) / 64
    bending, twisting = material.young_pa * second, material.shear_pa * 2 * second
    found: Array = 1 / np.array([bending, bending, twisting, material.young_pa * area])
    return found
