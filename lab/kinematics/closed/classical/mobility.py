"""How many freedoms a mechanism has by count."""

from collections.abc import Sequence

from lab.core.errors import LabError

__all__ = ["mobility"]


def mobility(bodies: int, joints_freedoms: Sequence[int], planar: bool = False) -> int:
    """Gruebler's count m (bodies - 1 - joints) + sum of freedoms, m = 3 in the plane and 6 in space.

    A special geometry may leave more freedoms than that, and some may be a body's idle turn about itself.

    Args:
        bodies: how many there are, the base among them.
        joints_freedoms: of each joint: a hinge or a slide 1, a universal joint 2, a ball joint 3.

    Raises:
        LabError: there is no body, or a joint has freedoms that no joint has.
    """
    most = 3 if planar else 6
    if bodies < 1 or not all(0 < freedoms < most for freedoms in joints_freedoms):
        raise LabError(f"mobility: at least one body, and joints of 1 to {most - 1} freedoms")
    return most * (bodies - 1 - len(joints_freedoms)) + sum(joints_freedoms)
