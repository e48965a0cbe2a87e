"""Every way to assemble a mechanism at joint positions, and every way of its legs to a pose: by its closed form."""

from dataclasses import dataclass
from itertools import product

import numpy as np

from lab.core import se3
from lab.core.se3 import Array
from lab.extensions.robotics.closed.recognition import ClassicalModel
from lab.kinematics.closed.mechanism import Mechanism, platform_poses

__all__ = ["WorkingMode", "assembly_modes", "passive_values_of", "working_modes"]


@dataclass(frozen=True)
class WorkingMode:
    """One way of the legs to a pose.

    Attributes:
        joints: ``(joints,)`` joint positions, rad or m.
        ways: of each joint 0 or 1: the first or the second way of its leg; of a leg with one way 0.
    """

    joints: Array
    ways: tuple[int, ...]


def assembly_modes(mechanism: Mechanism, course: ClassicalModel, joints: Array) -> Array:
    """The poses ``(m, 4, 4)`` of the platform in every assembly mode at joint positions ``(joints,)``."""
    passive = course.modes(joints[None])[0]
    passive = passive[np.isfinite(passive).all(axis=1)]
    return platform_poses(mechanism, np.tile(joints, (len(passive), 1)), passive)


def passive_values_of(mechanism: Mechanism, T_base_platform: Array) -> tuple[Array, float]:
    """The passive values ``(z,)`` that bring the nominal platform nearest to a pose ``(4, 4)``, and what it misses.

    The platform moves by slides at right angles, and turns about one axis through its origin or not at all.

    Returns:
        The passive values, and by how much (m, a radian as a metre) the pose is missed.
    """
    tree = mechanism.tree
    turns = [i for i, step in enumerate(tree.passive) if tree.step(*step).is_turn]
    slides = [i for i in range(len(tree.passive)) if i not in turns]
    joints, found = mechanism.home[None], np.zeros(len(tree.passive))
    for i in turns:
        start, turned = (
            platform_poses(mechanism, joints, row[None])[0, :3, :3] for row in (found, np.eye(len(found))[i])
        )
        axis = se3.log(turned @ start.T)
        found[i] = float(axis @ se3.log(T_base_platform[:3, :3] @ start.T))
    start = platform_poses(mechanism, joints, found[None])[0, :3, 3]
    moved = [platform_poses(mechanism, joints, (found + np.eye(len(found))[i])[None])[0, :3, 3] - start for i in slides]
    found[slides] = np.linalg.lstsq(np.array(moved).T, T_base_platform[:3, 3] - start, rcond=None)[0]
    reached = platform_poses(mechanism, joints, found[None])[0]
    turned_off = se3.log(T_base_platform[:3, :3] @ reached[:3, :3].T)
    missed = np.concatenate([T_base_platform[:3, 3] - reached[:3, 3], turned_off])
    return found, float(np.linalg.norm(missed))


def working_modes(mechanism: Mechanism, course: ClassicalModel, passive: Array) -> list[WorkingMode]:
    """Every way of the legs to the pose of passive values ``(z,)``; none where a leg does not reach it."""
    ways = course.inverse_solutions(passive[None])[0]  # (w, joints)
    of_legs = [np.flatnonzero(np.isfinite(column)) for column in ways.T]
    choices = [found if j in course.order else found[:1] for j, found in enumerate(of_legs)]
    rows = np.arange(mechanism.size)
    return [WorkingMode(ways[list(each), rows], tuple(int(i) for i in each)) for each in product(*choices)]
