"""Sample the orientations of a robot's tool at a place: any, turns about one axis, or none that can be chosen."""

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from lab.core import se3
from lab.core.random import rng_for
from lab.core.se3 import Array
from lab.extensions.robotics.workspace.membership import Membership
from lab.kinematics.differential import WEIGHTS
from lab.kinematics.inverse.newton import PoseTarget
from lab.kinematics.joints import JointSpec
from lab.kinematics.model import RigidArm

__all__ = ["Orientations", "orientation_shares", "orientations_of"]

_POSES = 200
_NONE = 1e-6  # of the largest


@dataclass(frozen=True)
class Orientations:
    """Those among which a robot can choose at a place.

    Attributes:
        axis: ``(3,)`` in the base, about which alone the tool turns; None where it turns in any way.
        rotation: ``(3, 3)`` one that it can have.
    """

    axis: Array | None
    rotation: Array

    def some(self, count: int, rng: np.random.Generator) -> Array:
        """Rotations ``(count, 3, 3)``: uniformly at random of all, or evenly spread about the axis."""
        if self.axis is None:
            return np.asarray(Rotation.random(count, rng=rng).as_matrix())
        angles = 2 * np.pi * (np.arange(count) + 0.5) / count - np.pi
        return np.asarray(se3.exp(angles[:, None] * self.axis) @ self.rotation)


def orientations_of(arm: RigidArm, values: Array) -> Orientations | None:
    """Return the orientations a robot can choose; None where orientation follows from the place, or in part.

    Args:
        values: parameters ``(p,)`` with one target.
    """
    joints = JointSpec.random_joints(arm.chain, _POSES, rng_for(0, "structure"))
    Ts, jacobian = arm.tool(joints, values)
    stands = np.isfinite(Ts).all(axis=(1, 2))
    rotations, jacobian = Ts[stands, :3, :3], WEIGHTS[:, None] * jacobian[stands]
    freedoms, places = (_rank(each) for each in (jacobian, jacobian[:, :3]))
    turns = se3.log(rotations @ rotations[0].T)
    sizes, directions = np.linalg.svd(turns)[1:]
    kinds = int((sizes > _NONE).sum())
    if kinds == 3 and freedoms == places + 3:
        return Orientations(None, rotations[0])
    if kinds == 1 and freedoms == places + 1:
        return Orientations(directions[0], rotations[0])
    return None


def _rank(jacobians: Array) -> int:
    sizes = np.linalg.svd(jacobians, compute_uv=False)
    return int((sizes > _NONE * sizes[:, :1]).sum(axis=1).max(initial=0))


def orientation_shares(membership: Membership, places: Array, rotations: Array) -> Array:
    """Compute the share ``(n,)`` of rotations ``(k, 3, 3)`` reached at each of the places ``(n, 3)`` m."""
    wanted = PoseTarget(np.repeat(places, len(rotations), axis=0), np.tile(rotations, (len(places), 1, 1)))
    return np.asarray(membership.reached(wanted)[0].reshape(len(places), -1).mean(axis=1))
