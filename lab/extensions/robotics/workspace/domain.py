"""In which coordinates what a robot reaches is measured: a box in space, a half plane through z, or a plane."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lab.core.errors import LabError
from lab.core.random import rng_for
from lab.core.se3 import Array
from lab.extensions.robotics.workspace.membership import Membership, turns_about_z
from lab.kinematics.inverse.newton import PoseTarget
from lab.kinematics.joints import JointSpec
from lab.kinematics.model import RigidArm
from lab.kinematics.reach import extents

__all__ = ["Domain", "anyhow", "domain_of"]

_POSES = 4000
_FLAT_M = 1e-9
_MARGIN = 0.03  # of the extents, which walks find to a little less than all
_RANK = 1e-9


@dataclass(frozen=True)
class Domain:
    """A box in d coordinates around what a robot's point reaches.

    Attributes:
        kind: ``space`` (x, y, z), ``revolution`` (the distance from z, and z), or ``plane`` (two of x, y and z).
        low, high: ``(d,)`` m.
        axes: which of x, y and z the coordinates of a plane are.
        level_m: the third coordinate of a plane.
        extents: ``(3, 2)`` m, the least and largest coordinates that are reached.
    """

    kind: str
    low: Array
    high: Array
    axes: tuple[int, ...]
    level_m: float
    extents: Array

    @property
    def size(self) -> int:
        """The number of coordinates."""
        return len(self.low)

    def places(self, coordinates: Array) -> Array:
        """Places ``(n, 3)`` m in the base at coordinates ``(n, d)``; of a half plane those with y = 0."""
        if self.kind == "space":
            return coordinates
        found = np.zeros((len(coordinates), 3))
        if self.kind == "revolution":
            found[:, 0], found[:, 2] = np.abs(coordinates[:, 0]), coordinates[:, 1]
            return found
        found[:, self.axes] = coordinates
        found[:, 3 - sum(self.axes)] = self.level_m
        return found

    def coordinates(self, places: Array) -> Array:
        """Coordinates ``(n, d)`` of places ``(n, 3)`` m."""
        if self.kind == "space":
            return places
        if self.kind == "revolution":
            return np.stack([np.hypot(places[:, 0], places[:, 1]), places[:, 2]], axis=1)
        return places[:, self.axes]

    def weights(self, coordinates: Array) -> Array:
        """How much volume (m³; of a plane area, m²) there is at coordinates ``(n, d)`` for a unit of theirs."""
        return 2 * np.pi * np.abs(coordinates[:, 0]) if self.kind == "revolution" else np.ones(len(coordinates))

    def spread(self, coordinates: Array, rng: np.random.Generator) -> Array:
        """Places ``(n, 3)`` m of coordinates, of a solid of revolution each turned about z at random."""
        places = self.places(coordinates)
        if self.kind == "revolution":
            angle = rng.uniform(0, 2 * np.pi, len(places))
            places = np.stack([places[:, 0] * np.cos(angle), places[:, 0] * np.sin(angle), places[:, 2]], axis=1)
        return places

    def reached(self, membership: Membership, coordinates: Array) -> NDArray[np.bool_]:
        """Which coordinates ``(n, d)`` are of places that are reached, in some orientation."""
        return membership.reached(anyhow(self.places(coordinates)))[0]


def anyhow(places: Array) -> PoseTarget:
    """Places ``(n, 3)`` m, turned in any way."""
    return PoseTarget(places, np.full((len(places), 3, 3), np.nan))


def domain_of(arm: RigidArm, values: Array) -> Domain:
    """The box around what a robot's point reaches within its limits.

    Args:
        values: parameters ``(p,)`` with one target.

    Raises:
        LabError: the point stays on a line or a surface in space, which has no volume.
    """
    joints = JointSpec.random_joints(arm.chain, _POSES, rng_for(0, "structure"))
    Ts, jacobian = arm.tool(joints, values)
    stands = np.isfinite(Ts).all(axis=(1, 2))
    joints, places, jacobian = joints[stands], Ts[stands, :3, 3], jacobian[stands, :3]

    def places_of(tried: Array) -> Array:
        return np.asarray(arm.tool(tried, values)[0][:, :3, 3])

    ends = extents(arm.chain, places_of, joints, places)
    sizes = np.linalg.svd(jacobian, compute_uv=False)
    rank = int((sizes > _RANK * max(float(sizes.max()), _RANK)).sum(axis=1).max())
    flat = np.flatnonzero(ends[:, 1] - ends[:, 0] < _FLAT_M)
    if rank < 2 or (rank == 2 and len(flat) != 1):
        raise LabError(
            f"robot '{arm.chain.name}': its point stays on a {'line' if rank < 2 else 'surface'}, which has no volume; "
            "lab inspect tells its reach"
        )
    margin = _MARGIN * (ends[:, 1] - ends[:, 0])
    low, high = ends[:, 0] - margin, ends[:, 1] + margin
    if len(flat):
        axes = tuple(i for i in range(3) if i != flat[0])
        return Domain("plane", low[list(axes)], high[list(axes)], axes, float(ends[flat[0]].mean()), ends)
    chain = arm.dh_chain(values)
    if chain is not None and turns_about_z(chain):
        radius = float(np.abs(ends[:2]).max()) * (1 + _MARGIN)
        return Domain("revolution", np.array([0.0, low[2]]), np.array([radius, high[2]]), (), 0.0, ends)
    return Domain("space", low, high, (0, 1, 2), 0.0, ends)
