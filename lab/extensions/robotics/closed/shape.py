"""Report what the closed form of a mechanism says of it to ``lab inspect``; registered as ``lab.shapes``."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from lab.core.random import rng_for
from lab.core.se3 import Array
from lab.extensions.robotics.closed.planar_platforms import Distances
from lab.extensions.robotics.closed.recognition import ClassicalModel, classical_model_of
from lab.extensions.robotics.workspace.membership import ByLegs
from lab.kinematics.closed.mechanism import Mechanism, platform_poses
from lab.kinematics.closed.mobility import SINGULAR, ClosedFormShape, Nearest

__all__ = ["closed_form_shape"]

GRID = 60_000  # poses, at most, of the count of what is reachable
WALKERS, STEPS = 32, 150  # of the search for singular poses
FIRST, SHRINKING = 0.05, 0.9  # its first step, beside the limits' width, and what each makes of the next
_OF_LEGS = {"serial": "a leg's length is zero"}
_WHERE = {
    "2-RPR": {**_OF_LEGS, "parallel": "the legs are in line"},
    "3-RPR": {**_OF_LEGS, "parallel": "the legs' lines meet in a point or are parallel"},
    "Delta": {
        "parallel": "all rods are along one plane",
        "serial": "an arm is in line with its rod, seen along its axis",
        "constraint": "the parallelograms let the platform tilt",
    },
}


def closed_form_shape(mechanism: Mechanism, joints: Array, passive: Array) -> ClosedFormShape | None:
    """Return what the closed form of a mechanism says of it; None where it has none that is known here.

    Args:
        joints: ``(n, joints)`` rad or m of some poses in the drawn mode.
        passive: ``(n, z)`` passive values there.
    """
    classical = classical_model_of(mechanism)
    if classical is None:
        return None
    home = mechanism.assembled(mechanism.home[None], mechanism.nominal_values).configuration
    search = _Search(mechanism, classical, joints, passive)
    modes = np.isfinite(classical.modes(mechanism.home[None])).all(axis=2).sum()
    ways = classical.inverse_solutions(home.passive.T)[..., classical.order]
    working = np.isfinite(ways).sum(axis=1).prod()
    found = search.singularities()
    flat, sizes = classical.is_planar, classical.dimensions
    return ClosedFormShape(classical.name, flat, sizes, int(modes), int(working), search.reachable(), found)


@dataclass(frozen=True)
class _Search:
    """Closed-form search, from joints ``(n, joints)`` and passive values ``(n, z)`` of some poses in the nominal mode.

    Poses on the other side of parallel singularities are of other modes.
    """

    mechanism: Mechanism
    classical: ClassicalModel
    joints: Array
    passive: Array

    @cached_property
    def legs(self) -> ByLegs:
        """Reachability by the legs' closed forms."""
        return ByLegs(self.mechanism, self.classical)

    def reachable(self) -> float:
        """Area or volume, by counting the cells of a grid whose middle is reached, however the platform is turned."""
        low, high = self.passive.min(axis=0), self.passive.max(axis=0)
        count = int(GRID ** (1 / len(low)))
        margin = (high - low) / (count - 2) / 2
        edges = [np.linspace(*ends, count + 1) for ends in zip(low - margin, high + margin, strict=True)]
        grid = np.meshgrid(*[(edge[1:] + edge[:-1]) / 2 for edge in edges], indexing="ij")
        poses = np.stack([each.ravel() for each in grid], axis=1)
        reached = self.legs.reached(poses)[0].reshape(grid[0].shape)
        turns = [self.mechanism.tree.step(*step).is_turn for step in self.mechanism.tree.passive]
        cell = np.prod([edge[1] - edge[0] for edge, turn in zip(edges, turns, strict=True) if not turn])
        return float(cell * reached.any(axis=tuple(np.flatnonzero(turns))).sum())

    def singularities(self) -> tuple[Nearest, ...]:
        """Return the nearest singularity of each kind that the robot has."""
        return tuple(self._nearest(kind) for kind in self.classical.singularities)

    def _nearest(self, kind: str) -> Nearest:
        """Search by random walks from the nearest poses with shrinking steps; a step is taken where it leads nearer."""
        mechanism, rng = self.mechanism, rng_for(0, "structure", Distances._fields.index(kind))
        starts = np.argsort(self._distance(kind, self.joints, self.passive))[:WALKERS]
        joints, passive = self.joints[starts], self.passive[starts]
        distance = self._distance(kind, joints, passive)
        step = FIRST * (mechanism.upper - mechanism.lower)
        for _ in range(STEPS):
            if distance.min() < SINGULAR:
                break
            tried = np.clip(joints + step * rng.standard_normal(joints.shape), mechanism.lower, mechanism.upper)
            closing = self._closing(tried, passive)
            found = self._distance(kind, tried, closing)
            nearer = (found < distance) & (self.classical.side(tried, closing) == self.legs.side)
            joints[nearer], passive[nearer], distance[nearer] = tried[nearer], closing[nearer], found[nearer]
            step = SHRINKING * step
        best = int(np.argmin(distance))
        place = platform_poses(mechanism, joints[best : best + 1], passive[best : best + 1])[0, :3, 3]
        return Nearest(kind, float(distance[best]), joints[best], place, _WHERE[self.classical.name][kind])

    def _closing(self, joints: Array, near: Array) -> Array:
        """Passive values ``(n, z)`` of the mode that is nearest to some; NaN where there is none."""
        modes = self.classical.modes(joints)
        away = np.nan_to_num(np.abs(modes - near[:, None]).max(axis=2), nan=np.inf)
        return np.take_along_axis(modes, away.argmin(axis=1)[:, None, None], axis=1)[:, 0]

    def _distance(self, kind: str, joints: Array, passive: Array) -> Array:
        return np.asarray(getattr(self.classical.distances(joints, passive), kind))
