"""Mobility: degrees of freedom of mechanisms by count, and of serial arms by rank.

A serial arm's mobility index is its number of joints, its degrees of freedom the rank of the Jacobian at general
positions; the difference is its redundancy (Mallem 2011, section 6.2). Directions of the twist that no joint has at any
position are fixed: three for a planar arm.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from lab.core.errors import LabError
from lab.core.random import rng_for
from lab.core.se3 import Array
from lab.kinematics.closed.loop_closure import BASE, Step, Tree
from lab.kinematics.differential import ROTATION_M
from lab.kinematics.serial.chain import Chain
from lab.kinematics.serial.serial_arm import SerialArm

__all__ = [
    "SINGULAR",
    "BodyCount",
    "ClosedFormShape",
    "NearestSingularity",
    "body_count",
    "is_planar",
    "mobility",
    "mobility_of",
]

_SPACE, _PLANE = 6, 3


def mobility(bodies: int, joints_freedoms: Sequence[int], planar: bool = False, internal: int = 0) -> int:
    """Return Gruebler's count m (bodies - 1 - joints) + sum of freedoms - internal ones, m = 3 in the plane and 6 in
    space.

    A special geometry may leave more degrees of freedom.

    Args:
        bodies: their number, with the base.
        joints_freedoms: of each joint: a hinge or a slide 1, a universal joint 2, a ball joint 3.
        internal: degrees of freedom that move no other body, as a rod's turn about itself (m_int of Mallem 2011, 11.4).
    """
    most = _PLANE if planar else _SPACE
    if bodies < 1 or internal < 0 or not all(0 < freedoms < most for freedoms in joints_freedoms):
        raise LabError(f"mobility: at least one body, and joints of 1 to {most - 1} freedoms")
    return most * (bodies - 1 - len(joints_freedoms)) + sum(joints_freedoms) - internal


@dataclass(frozen=True)
class BodyCount:
    """Bodies and joints of a mechanism.

    Attributes:
        bodies: moving ones; each active or passive step has one.
        freedoms: of each joint between two of them, or to the base.
        internal: of rods with ball ends, which turn about themselves.
    """

    planar: bool
    bodies: int
    freedoms: tuple[int, ...]
    internal: int

    @property
    def mobility(self) -> int:
        """Gruebler's count."""
        return mobility(self.bodies + 1, self.freedoms, self.planar, self.internal)


def body_count(tree: Tree) -> BodyCount:
    """Count the bodies of a mechanism.

    A platform with all passive degrees of freedom is a free body; else slides and hinges of its passive steps guide it.
    A rod has a ball joint at both ends, in the plane a hinge; a leg of variable length is two bodies with a slide
    between them.
    """
    planar = is_planar(tree)
    most, bodies, freedoms, internal = (_PLANE if planar else _SPACE), 0, list[int](), 0
    for frame in tree.frames:
        passive = sum(step.passive for step in frame.path)
        moving = passive + sum(step.joint is not None for step in frame.path)
        if frame.on == BASE and passive == moving == most:
            bodies += 1
            continue
        bodies += moving
        freedoms += [1] * moving
    for rod in tree.rods:
        length = rod.joint is not None
        bodies += 1 + length
        freedoms += [1] * length + [1 if planar else 3] * 2
        internal += not planar
    freedoms += [most - len(pin.axes) for pin in tree.pins]
    return BodyCount(planar, bodies, tuple(freedoms), internal)


def is_planar(tree: Tree) -> bool:
    """Check by the axes of the steps whether all motions are in the plane of x and y."""
    pinned_in_plane = not any(2 in pin.axes for pin in tree.pins)
    return pinned_in_plane and not any(_leaves_plane(step) for frame in tree.frames for step in frame.path)


def _leaves_plane(step: Step) -> bool:
    """Check whether a step tilts the plane of x and y, or moves out of it."""
    if step.is_turn:
        return step.axis != 2 and (step.moves or step.value != 0.0)
    return step.axis == 2 and step.moves


SINGULAR = 1e-3  # distance of a pose at a singularity


@dataclass(frozen=True)
class NearestSingularity:
    """Pose of the nominal assembly mode nearest to a kind of singularity, within the limits.

    Attributes:
        distance: 0 at one, 1 at best (``Distances``).
        joints: ``(n,)`` readings of the pose.
        place: ``(3,)`` m, position of the platform's origin in the base.
        where: description of such poses.
    """

    kind: str
    distance: float
    joints: Array
    place: Array
    where: str


@dataclass(frozen=True)
class ClosedFormShape:
    """Results of a mechanism's closed form, in the nominal assembly mode.

    Attributes:
        name: of the mechanism.
        dimensions: by name, which ends in the unit: ``_m`` or ``_rad``.
        modes: number of assembly modes at home.
        working: number of working modes at the pose of home.
        reachable: area (m^2) of a planar robot, else volume (m^3), of the platform's passive slides.
    """

    name: str
    is_planar: bool
    dimensions: dict[str, Array]
    modes: int
    working: int
    reachable: float
    singularities: tuple[NearestSingularity, ...]


_POSES = 50
_NONE = 1e-9  # of the largest singular value


@dataclass(frozen=True)
class _Mobility:
    """Mobility of an arm.

    Attributes:
        index: number of joints.
        freedoms: rank of its Jacobian at general positions.
        moving: ``(n,)`` joints of motions that leave the last frame at rest.
        still: ``(k, 3)`` turns of the last frame, as unit vectors in frame 0, of no joint at any position.
        fixed_directions: ``(k, 3)`` likewise for its origin's displacements.
    """

    index: int
    freedoms: int
    moving: tuple[bool, ...]
    still: Array
    fixed_directions: Array

    @property
    def redundancy(self) -> int:
        """Degree of redundancy."""
        return self.index - self.freedoms

    @property
    def planar(self) -> bool:
        """True if the last frame stays in a plane and turns about its normal alone."""
        return (
            len(self.still) == 2
            and len(self.fixed_directions) == 1
            and bool(np.abs(self.still @ self.fixed_directions[0]).max() < _NONE)
        )


def mobility_of(chain: Chain) -> _Mobility:
    """Compute the mobility of a nominal arm's last frame."""
    arm = SerialArm(chain)
    joints = rng_for(0, "structure").uniform(-1.5, 1.5, (_POSES, chain.size))
    J = arm.tool(joints, arm.nominal())[1]
    J[:, 3:] *= ROTATION_M
    sizes, rows = np.linalg.svd(J)[1:]
    freedoms = int((sizes > _NONE * sizes[:, :1]).sum(axis=1).max())
    moving = np.abs(rows[:, freedoms:]).max(axis=(0, 1), initial=0.0) > 1e-6
    return _Mobility(chain.size, freedoms, tuple(moving.tolist()), _missing(J[:, 3:]), _missing(J[:, :3]))


def _missing(parts: Array) -> Array:
    sides, sizes, _ = np.linalg.svd(parts.transpose(1, 0, 2).reshape(3, -1))
    return np.asarray(sides.T[sizes <= _NONE * max(float(sizes[0]), ROTATION_M)])
