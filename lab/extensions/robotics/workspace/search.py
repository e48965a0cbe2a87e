"""Decide by a bounded search whether a robot of any kind reaches a position or pose within its joint limits.

Of many random joint positions those that bring the tool nearest are taken as starts. From each a projected Newton's
method goes on: joints at a limit that would have to pass it are fixed there, the others take a damped
step (Levenberg 1944; Bertsekas 1982 for the fixed ones), and every step ends within the limits. A place counts as
reached where one of the starts arrives; one that no start comes to may be missed, never the other way round.
"""

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
import scipy  # its parts are loaded at their first use
from numpy.typing import NDArray

from lab.core.random import rng_for
from lab.core.se3 import Array
from lab.kinematics.differential import WEIGHTS
from lab.kinematics.inverse.newton import PoseTarget, pose_landmarks, tool_at
from lab.kinematics.joints import JointSpec
from lab.kinematics.model import RigidArm

__all__ = ["Search"]

_STARTS, _STARTS_TURNED = 5, 20  # places are sampled more densely than poses
_STEPS = 20
_ARRIVED = 1e-7  # m, and a radian as ``ROTATION_M``
_LEAST_DAMPING, _LARGEST_DAMPING = 1e-7, 1.0  # beside singular values in m
_ROUNDING = 1e-15  # of the squares' sum: less damping would be lost in them
_AT_LIMIT = 1e-12  # rad or m
_STUCK = 0.15  # of the error: who makes it smaller by less in a step is at its best within the limits


@dataclass(frozen=True)
class Search:
    """A bounded search for a nominal robot and the point of its tool.

    Attributes:
        values: parameters ``(p,)`` with one target.
        count: of random joint positions among which searches start; half of it where loops have to be closed.
        turn_first: whether joint 1 turns by whole turns about z, so that a start may be turned to where it is wanted.
    """

    arm: RigidArm
    values: Array
    count: int = 20_000
    turn_first: bool = False
    exact: bool = field(default=False, init=False)

    @cached_property
    def samples(self) -> tuple[Array, Array]:
        """Random joint positions ``(k, n)`` within the limits, and the tool's poses ``(k, 4, 4)`` m there."""
        joints = JointSpec.random_joints(self.arm.chain, self.count, rng_for(0, "structure"))
        Ts = self.arm.tool(joints, self.values)[0]
        stands = np.isfinite(Ts).all(axis=(1, 2))
        return joints[stands], Ts[stands]

    def reached(self, wanted: PoseTarget) -> tuple[NDArray[np.bool_], Array]:
        """Decide whether targets ``(n,)`` are reached; joint positions ``(n, joints)`` of those that are, else NaN."""
        found = np.full((len(wanted), self.arm.chain.size), np.nan)
        if not len(wanted):
            return np.zeros(0, dtype=np.bool_), found
        starts = self._starts(wanted)
        for some in (starts[:, :1], starts[:, 1:]):  # most are reached from the first one
            rows = np.flatnonzero(np.isnan(found[:, 0]))
            found[rows] = _first(self._from(wanted.take(rows), some[rows]))
        return ~np.isnan(found[:, 0]), found

    def solutions(self, wanted: PoseTarget) -> Array:
        """Joint positions ``(n, k, joints)`` from every start, NaN where it does not arrive."""
        found: Array = self._from(wanted, self._starts(wanted))
        return found

    def _from(self, wanted: PoseTarget, starts: Array) -> Array:
        """Search from starts ``(n, k, joints)``; return the solutions, NaN where a start does not converge."""
        count, each = starts.shape[:2]
        rows = np.repeat(np.arange(count), each)
        joints, arrived = self._bounded(wanted.take(rows), starts.reshape(len(rows), starts.shape[2]))
        return np.where(arrived[:, None], joints, np.nan).reshape(starts.shape)

    def _starts(self, wanted: PoseTarget) -> Array:
        """Joint positions ``(n, k, joints)`` that bring the tool near, the nearest first."""
        joints, Ts = self.samples
        turned = bool(wanted.turned.all())
        if self.turn_first and not turned:
            radii = np.hypot(Ts[:, 0, 3], Ts[:, 1, 3])
            tree = scipy.spatial.cKDTree(np.stack([radii, Ts[:, 2, 3]], axis=1))
            places = wanted.positions
            near = tree.query(np.stack([np.hypot(places[:, 0], places[:, 1]), places[:, 2]], axis=1), k=_STARTS)[1]
            starts: Array = joints[near]
            towards = np.arctan2(places[:, 1], places[:, 0])[:, None] - np.arctan2(Ts[near, 1, 3], Ts[near, 0, 3])
            first, chain = starts[:, :, 0], self.arm.chain
            turn = first + chain.sign[0] * towards
            low = chain.lower[0]
            starts[:, :, 0] = np.minimum(low + (turn - low) % (2 * np.pi), chain.upper[0])
            return starts
        tree = scipy.spatial.cKDTree(pose_landmarks(Ts[:, :3, 3], Ts[:, :3, :3], turned))
        count = _STARTS_TURNED if turned else _STARTS
        return np.asarray(joints[tree.query(pose_landmarks(wanted.positions, wanted.rotations, turned), k=count)[1]])

    def _bounded(self, wanted: PoseTarget, start: Array) -> tuple[Array, NDArray[np.bool_]]:
        """Run the projected Newton's method from joint positions ``(n, joints)``; return its end and convergence."""
        chain, joints = self.arm.chain, start.copy()
        damping = np.full(len(wanted), _LEAST_DAMPING)
        error, jacobian = self._at(wanted, joints)
        size = np.linalg.norm(error, axis=1)
        for _ in range(_STEPS):
            going = np.flatnonzero((size > _ARRIVED) & (damping <= _LARGEST_DAMPING))
            if not going.size:
                break
            e, J, at = error[going], jacobian[going], joints[going]
            slope = np.einsum("nij,ni->nj", J, e)
            low, high = at <= chain.lower + _AT_LIMIT, at >= chain.upper - _AT_LIMIT
            free = ~((low & (slope < 0)) | (high & (slope > 0)))
            J = J * free[:, None, :]
            square = J @ J.swapaxes(1, 2)
            least = _ROUNDING * np.trace(square, axis1=1, axis2=2)[:, None]  # near a singularity of loops J is large
            square[:, np.arange(6), np.arange(6)] += np.maximum(damping[going, None] ** 2, least)
            step = np.einsum("nij,ni->nj", J, np.linalg.solve(square, e[:, :, None])[:, :, 0])
            moved = np.clip(at + step, chain.lower, chain.upper)
            there, ahead = self._at(wanted.take(going), moved)
            now = np.linalg.norm(there, axis=1)
            better = now < size[going]
            retained, worse = going[better], going[~better]
            little = now[better] > (1 - _STUCK) * size[retained]
            joints[retained], error[retained], jacobian[retained] = moved[better], there[better], ahead[better]
            size[retained] = now[better]
            damping[retained] = np.where(little, np.inf, np.maximum(damping[retained] / 10, _LEAST_DAMPING))
            damping[worse] = np.maximum(10 * damping[worse], 1e-3)
        return joints, size <= _ARRIVED

    def _at(self, wanted: PoseTarget, joints: Array) -> tuple[Array, Array]:
        """Return the residual ``(n, 6)`` and the Jacobian ``(n, 6, joints)``, in metres; rotations where requested."""
        Ts, jacobian = tool_at(self.arm, joints, self.values)
        weight = WEIGHTS * np.where(wanted.turned[:, None], 1.0, np.arange(6) < 3)
        return weight * wanted.errors(Ts), weight[:, :, None] * jacobian


def _first(solutions: Array) -> Array:
    """Return the first valid IK solution of ``(n, k, joints)``, NaN where there is none."""
    there = np.isfinite(solutions[:, :, 0])
    return np.asarray(np.take_along_axis(solutions, there.argmax(axis=1)[:, None, None], axis=1)[:, 0])
