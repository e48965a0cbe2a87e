"""Describe a mechanism by its closed form, for ``lab inspect``; registered as ``lab.shapes``."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from lab.core.random import rng_for
from lab.core.se3 import Array
from lab.extensions.robotics.closed.classical_mechanisms import Distances
from lab.extensions.robotics.closed.recognition import ClassicalModel, classical_model_of
from lab.extensions.robotics.workspace.membership import ByLegs
from lab.kinematics.closed.mechanism import Mechanism, platform_poses
from lab.kinematics.closed.mobility import SINGULAR, ClosedFormShape, NearestSingularity

__all__ = ["closed_form_shape"]

_MAX_GRID_POSES = 60_000  # of the reachable area or volume
_WALKERS, _STEPS = 32, 150  # of the search for singular poses
_FIRST_STEP, _SHRINKING = 0.05, 0.9  # its first step, as a share of the limits' width, and the ratio of steps
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
    """Describe a mechanism by its closed form; None where it has none.

    Args:
        joints: ``(n, joints)`` rad or m of some poses in the nominal assembly mode.
        passive: ``(n, z)`` passive values there.
    """
    classical = classical_model_of(mechanism)
    if classical is None:
        return None
    home = mechanism.assembled(mechanism.home[None], mechanism.nominal_values).configuration
    search = _ShapeSearch(mechanism, classical, joints, passive)
    modes = np.isfinite(classical.modes(mechanism.home[None])).all(axis=2).sum()
    solutions = classical.inverse_solutions(home.passive.T)[..., classical.order]
    return ClosedFormShape(
        name=classical.name,
        is_planar=classical.is_planar,
        dimensions=classical.dimensions,
        modes=int(modes),
        working=int(np.isfinite(solutions).sum(axis=1).prod()),
        reachable=search.reachable(),
        singularities=tuple(search.nearest(kind) for kind in classical.singularities),
    )


@dataclass(frozen=True)
class _ShapeSearch:
    """Closed-form search, from joints ``(n, joints)`` and passive values ``(n, z)`` of some poses in the nominal mode.

    Poses on the other side of parallel singularities are of other modes.
    """

    mechanism: Mechanism
    classical: ClassicalModel
    joints: Array
    passive: Array

    @cached_property
    def legs(self) -> ByLegs:
        """Reachability by the closed forms of the legs."""
        return ByLegs(self.mechanism, self.classical)

    def reachable(self) -> float:
        """Estimate the reachable area or volume by the cells of a grid whose middle is reached in some orientation."""
        low, high = self.passive.min(axis=0), self.passive.max(axis=0)
        count = int(_MAX_GRID_POSES ** (1 / len(low)))
        margin = (high - low) / (count - 2) / 2
        edges = [np.linspace(*ends, count + 1) for ends in zip(low - margin, high + margin, strict=True)]
        grid = np.meshgrid(*[(edge[1:] + edge[:-1]) / 2 for edge in edges], indexing="ij")
        poses = np.stack([each.ravel() for each in grid], axis=1)
        reached = self.legs.reached(poses)[0].reshape(grid[0].shape)
        turns = [self.mechanism.tree.step(*step).is_turn for step in self.mechanism.tree.passive]
        cell = np.prod([edge[1] - edge[0] for edge, turn in zip(edges, turns, strict=True) if not turn])
        return float(cell * reached.any(axis=tuple(np.flatnonzero(turns))).sum())

    def nearest(self, kind: str) -> NearestSingularity:
        """Find the nearest singularity of a kind by random walks with shrinking steps, from the nearest poses."""
        mechanism, rng = self.mechanism, rng_for(0, "structure", Distances._fields.index(kind))
        starts = np.argsort(self._distance(kind, self.joints, self.passive))[:_WALKERS]
        joints, passive = self.joints[starts], self.passive[starts]
        distance = self._distance(kind, joints, passive)
        step = _FIRST_STEP * (mechanism.upper - mechanism.lower)
        for _ in range(_STEPS):
            if distance.min() < SINGULAR:
                break
            tried = np.clip(joints + step * rng.standard_normal(joints.shape), mechanism.lower, mechanism.upper)
            closing = self._closing(tried, passive)
            found = self._distance(kind, tried, closing)
            nearer = (found < distance) & (self.classical.side(tried, closing) == self.legs.side)
            joints[nearer], passive[nearer], distance[nearer] = tried[nearer], closing[nearer], found[nearer]
            step = _SHRINKING * step
        best = int(np.argmin(distance))
        place = platform_poses(mechanism, joints[best : best + 1], passive[best : best + 1])[0, :3, 3]
        return NearestSingularity(kind, float(distance[best]), joints[best], place, _WHERE[self.classical.name][kind])

    def _closing(self, joints: Array, near: Array) -> Array:
        """Return the passive values ``(n, z)`` of the nearest mode; NaN where there is none."""
        modes = self.classical.modes(joints)
        away = np.nan_to_num(np.abs(modes - near[:, None]).max(axis=2), nan=np.inf)
        return np.take_along_axis(modes, away.argmin(axis=1)[:, None, None], axis=1)[:, 0]

    def _distance(self, kind: str, joints: Array, passive: Array) -> Array:
        return np.asarray(getattr(self.classical.distances(joints, passive), kind))
