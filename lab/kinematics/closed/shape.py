"""Hold what the closed form of a mechanism says of its shape; extensions register such forms as ``lab.shapes``."""

from dataclasses import dataclass

from lab.core.se3 import Array

__all__ = ["SINGULAR", "ClosedFormShape", "Nearest"]

SINGULAR = 1e-3  # a distance below which a pose is at a singularity


@dataclass(frozen=True)
class Nearest:
    """How near the drawn mode comes to a kind of singularity, within the limits.

    Attributes:
        distance: 0 at one, 1 at best (``Distances``).
        joints: ``(n,)`` readings of the pose that is nearest to one.
        place: ``(3,)`` m, where the platform's origin is there in the base.
        where: what is special about such poses, in words.
    """

    kind: str
    distance: float
    joints: Array
    place: Array
    where: str


@dataclass(frozen=True)
class ClosedFormShape:
    """What the closed form of a mechanism says of it, in the drawn mode.

    Attributes:
        name: what people call the mechanism.
        dimensions: of the closed form by name, which ends in the unit: ``_m`` or ``_rad``.
        modes: ways to assemble it at the joint positions of home.
        working: ways of its legs to reach the pose of home.
        reachable: area (m^2) of a planar robot, else volume (m^3), that the platform gets to by its passive slides.
    """

    name: str
    is_planar: bool
    dimensions: dict[str, Array]
    modes: int
    working: int
    reachable: float
    singularities: tuple[Nearest, ...]
