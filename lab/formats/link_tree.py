"""A serial arm as a tree of links, for formats whose joints move along z of the moved link's own frame.

A Denavit-Hartenberg row is ``before`` * Rz(theta) Tz(d) * ``after``: Rx(alpha) Tx(a) Ry(beta) is ``before`` in a Craig
table, ``after`` in a distal one. A joint's link is between the two, with z on the joint's axis; the table's frame is
fixed to it.
"""

from collections.abc import Collection
from dataclasses import dataclass

import numpy as np

from lab.core import se3
from lab.core.se3 import Array
from lab.kinematics.serial.chain import Convention
from lab.kinematics.serial.serial_arm import SerialArm

__all__ = ["Link", "free_name", "last_axis_frame", "link_tree"]


@dataclass(frozen=True)
class Link:
    """A link of the tree.

    Attributes:
        parent: name of the parent link; None for the root, the frame of the measurements.
        T_parent_link: pose ``(4, 4)`` in the parent's frame (m), joint positions zero.
        T_link_frame: pose ``(4, 4)`` of the table's frame that moves with it.
        joint: the joint (from 0) that moves it, or None.
        sign: +1 or -1, direction of the joint position along z.
    """

    name: str
    parent: str | None
    T_parent_link: Array
    T_link_frame: Array
    joint: int | None = None
    sign: float = 1.0


@dataclass(frozen=True)
class _LinkTree:
    """Links of an arm, every parent before its children.

    Attributes:
        instrument: root, the frame of the base's pose.
        base: frame 0 of the table.
        moving: a link a joint, outward.
        flange: the table's last frame.
        targets: at each target, with the axes of the last frame.
    """

    instrument: Link
    base: Link
    moving: tuple[Link, ...]
    flange: Link
    targets: tuple[Link, ...]

    @property
    def links(self) -> tuple[Link, ...]:
        return (self.instrument, self.base, *self.moving, self.flange, *self.targets)


def link_tree(arm: SerialArm, values: Array) -> _LinkTree:
    """Return the links of an arm with parameters ``values`` ``(p,)``.

    A target's link has the target's name; others are ``instrument``, ``base``, ``link1`` ... and ``flange``, unless a
    target has that name.
    """
    one = np.eye(4)
    _, table, tool = arm.split(values)
    root = Link(free_name("instrument", arm.targets), None, one, one)
    still = parent = Link(free_name("base", arm.targets), root.name, arm.T_tracker_frame0(values), one)
    moving = []
    for i, row in enumerate(table):
        before, at_joint, after = _parts(arm.chain.convention, row)
        T_parent_link = parent.T_link_frame @ before @ at_joint
        name = free_name(f"link{i + 1}", arm.targets)
        parent = Link(name, parent.name, T_parent_link, after, i, float(arm.chain.sign[i]))
        moving.append(parent)
    flange = Link(free_name("flange", arm.targets), parent.name, parent.T_link_frame, one)
    targets = (
        Link(target, flange.name, se3.pose(np.eye(3), point), one)
        for target, point in zip(arm.targets, tool, strict=True)
    )
    return _LinkTree(root, still, tuple(moving), flange, tuple(targets))


def last_axis_frame(arm: SerialArm, values: Array) -> Array:
    """Return the pose ``(4, 4)`` (m) in frame 0 of the last joint's link, at zero joint positions."""
    pose = np.eye(4)
    for link in link_tree(arm, values).moving:
        pose = pose @ link.T_parent_link
    return pose


def free_name(name: str, taken: Collection[str]) -> str:
    """Append underscores to a name until it is not taken."""
    while name in taken:
        name += "_"
    return name


def _parts(convention: Convention, row: Array) -> tuple[Array, Array, Array]:
    """Split a row ``(5,)`` into the transforms ``(4, 4)`` before the joint, Rz(theta) Tz(d), and after it."""
    theta, d, a, alpha, beta = row
    across = _turn(0, alpha) @ _turn(1, beta)
    link = se3.pose(across, np.array([a, 0.0, 0.0]))  # Rx and Tx commute
    at_joint = se3.pose(_turn(2, theta), np.array([0.0, 0.0, d]))
    return (np.eye(4), at_joint, link) if convention == "distal" else (link, at_joint, np.eye(4))


def _turn(axis: int, angle: float) -> Array:
    return se3.exp(angle * np.eye(3)[axis])
