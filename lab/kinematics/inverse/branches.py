"""Inverse kinematics of the nominal model: all solutions in closed form if one exists, else by search."""

from dataclasses import dataclass, field

import numpy as np
import scipy  # its parts are loaded at their first use, which not every process comes to
from numpy.typing import NDArray

from lab.core import se3
from lab.core.random import rng_for
from lab.core.se3 import Array
from lab.kinematics.inverse.closed_form import ClosedForm, Solutions, closed_form_of
from lab.kinematics.inverse.newton_inverse import FREEDOMS, PoseTarget, pose_landmarks, reach, shortest_step, tool_at
from lab.kinematics.joints import JointSpec
from lab.kinematics.model import RigidArm

__all__ = ["NominalInverse", "nearest_whole_turns", "ordered"]

_SAMPLES = 20_000  # random poses for the starts of a search
_STARTS = 8  # the nearest of them
_MORE_STARTS = 64  # if none succeeds
_DISLIKE_COST = 2 * np.pi  # costs of a solution relative to a move of 1 rad: disliked,
_EXCESS_COST = 100.0  # 1 rad beyond limits,
_GAP_COST = 1e4  # 1 m off,
_TILT_COST = 100.0  # and 1 rad off
_SIMILAR, _SIMILAR_RAD = 1.1, 1e-6  # solutions that miss a rotation by no more than this beyond the best count
_FOLLOWED = 3.0  # Newton's steps: near a fold, a parabola, a solution moves by at most two of them


@dataclass(frozen=True)
class NominalInverse:
    """Inverse kinematics with nominal links, and a base and a tool.

    Attributes:
        values: ``(p,)`` of the arm.
        target: index of the tool's target.
    """

    arm: RigidArm
    values: Array
    target: int = 0
    closed_form: ClosedForm | None = field(init=False, repr=False)

    def __post_init__(self) -> None:
        chain = self.arm.dh_chain(self.values)
        form = None if chain is None else closed_form_of(chain, self.tools[self.target])
        object.__setattr__(self, "closed_form", form)

    def solutions(self, wanted: PoseTarget, reference: Array) -> Solutions:
        """Return IK solutions ``(n, k, joints)`` of each target, all of them if a closed form exists.

        A target with fewer solutions than others is filled with zeros, with an infinite gap.

        Args:
            reference: joint positions ``(n, joints)`` near which to search, or NaN.
        """
        exact = self.exact(wanted)
        parts = [
            (rows, by(wanted.take(rows), reference[rows]))
            for rows, by in ((np.flatnonzero(exact), self._by_closed_form), (np.flatnonzero(~exact), self._searched))
            if rows.size
        ]
        shape = (len(wanted), max((part.gap_m.shape[1] for _, part in parts), default=0), self.arm.chain.size)
        free = np.zeros(shape, dtype=np.bool_)
        found = Solutions(np.zeros(shape), np.full(shape[:2], np.inf), np.zeros(shape[:2]), free)
        for rows, part in parts:
            for name in ("joints", "gap_m", "tilt_rad", "free"):
                getattr(found, name)[rows, : part.gap_m.shape[1]] = getattr(part, name)
        return found

    def exact(self, wanted: PoseTarget) -> NDArray[np.bool_]:
        """Flag the targets ``(n,)`` for the closed form."""
        if self.closed_form is None:
            return np.zeros(len(wanted), dtype=np.bool_)
        return wanted.turned | self.closed_form.by_point

    def again(self, wanted: PoseTarget, joints: Array, branch: NDArray[np.int_]) -> tuple[Array, NDArray[np.bool_]]:
        """Return joint positions ``(n, joints)`` for other targets, in the branches and turns of ``joints``, and a mask
        of success.

        Args:
            branch: ``(n,)`` of the closed form; negative for Newton's method from ``joints``.
        """
        found, reached = joints.copy(), np.ones(len(wanted), dtype=np.bool_)
        by_branch = self.closed_form is not None and not self.closed_form.exact_only
        exact = np.flatnonzero((branch >= 0) & by_branch)
        other = np.setdiff1d(np.arange(len(wanted)), exact)
        if self.closed_form is not None and exact.size:
            solutions = self.closed_form.solve(self.last_frames(wanted.take(exact)), joints[exact])
            if self.closed_form.numbered:
                rows = np.arange(exact.size)
                found[exact] = nearest_whole_turns(self.arm.chain, solutions.joints[rows, branch[exact]], joints[exact])
                reached[exact] = solutions.gap_m[rows, branch[exact]] == 0
            else:
                found[exact], reached[exact] = self._followed(wanted.take(exact), joints[exact], solutions)
        if other.size:
            conditions = np.empty((len(other), 0))
            near = reach(self.arm, self.values, wanted.take(other), joints[other], conditions, self.target)
            found[other] = near.joints
        return found, reached

    def _followed(self, wanted: PoseTarget, joints: Array, solutions: Solutions) -> tuple[Array, NDArray[np.bool_]]:
        """Return the continuations ``(n, joints)`` of ``joints``, for roots in no lasting order, and a mask of success.

        The nearest solution is one if it is about as near as Newton's step predicts. Otherwise the target is beyond a
        fold, where two solutions end, and the others belong to other branches.
        """
        Ts, J = self.tool(joints)
        step = np.abs(shortest_step(J, wanted.errors(Ts), wanted.turned)).max(axis=1)
        turned = nearest_whole_turns(self.arm.chain, solutions.joints, joints[:, None])
        apart = np.where(solutions.gap_m == 0, np.abs(turned - joints[:, None]).max(axis=2), np.inf)
        rows, nearest = np.arange(len(joints)), apart.argmin(axis=1)
        there = self.tool(turned[rows, nearest])[1]
        kept = np.sign(np.linalg.det(there[:, :3])) == np.sign(np.linalg.det(J[:, :3]))
        reached = np.asarray((apart[rows, nearest] <= _FOLLOWED * step + _SIMILAR_RAD) & kept)
        return np.where(reached[:, None], turned[rows, nearest], joints), reached

    def tool(self, joints: Array) -> tuple[Array, Array]:
        """Return ``newton.tool_at``."""
        return tool_at(self.arm, joints, self.values, self.target)

    @property
    def tools(self) -> Array:
        """Positions ``(k, 3)`` m of the targets in the last frame."""
        return self.values[-3 * len(self.arm.targets) :].reshape(-1, 3)

    def last_frames(self, wanted: PoseTarget) -> Array:
        """Return poses ``(n, 4, 4)`` of the last frame in frame 0 for targets, at the nearest possible rotation."""
        Ts: Array = se3.inverse(self.arm.T_tracker_frame0(self.values)) @ se3.pose(wanted.rotations, wanted.positions)
        rotations = Ts[:, :3, :3] if self.closed_form is None else self.closed_form.nearest_rotations(Ts[:, :3, :3])
        return se3.pose(rotations, Ts[:, :3, 3] - rotations @ self.tools[self.target])

    def _by_closed_form(self, wanted: PoseTarget, reference: Array) -> Solutions:
        assert self.closed_form is not None
        found = self.closed_form.solve(self.last_frames(wanted), np.nan_to_num(reference))
        if self.closed_form.exact_only:
            return self._made_exact(wanted, found)
        found.tilt_rad[~wanted.turned] = 0.0
        return found

    def _made_exact(self, wanted: PoseTarget, found: Solutions) -> Solutions:
        """Return candidates that meet the whole pose, else results of Newton's method from them.

        Of the latter those count that reach the position, and the rotation nearly as well as the best. Others have an
        infinite gap.
        """
        joints, gap, tilt = found.joints.copy(), found.gap_m.copy(), found.tilt_rad.copy()
        meets = (gap == 0) & (tilt == 0)
        gap[~meets] = np.inf
        rows, many = np.flatnonzero(~meets.any(axis=1)), gap.shape[1]
        if rows.size:
            each = wanted.take(np.repeat(rows, many))
            start = joints[rows].reshape(-1, joints.shape[2])
            ended = reach(self.arm, self.values, each, start, np.empty((len(each), 0)), self.target)
            missed, turned_off = (
                np.linalg.norm(part, axis=1).reshape(-1, many) for part in (ended.errors[:, :3], ended.errors[:, 3:])
            )
            arrived = ended.arrived.reshape(-1, many)
            least = np.where(arrived, turned_off, np.inf).min(axis=1, keepdims=True)
            counts = arrived & (turned_off <= _SIMILAR * least + _SIMILAR_RAD)
            joints[rows] = ended.joints.reshape(joints[rows].shape)
            none = ~arrived.any(axis=1, keepdims=True)
            gap[rows] = np.where(counts, 0.0, np.where(none, missed, np.inf))
            tilt[rows] = turned_off
        return Solutions(joints, gap, np.where(np.isfinite(gap), tilt, 0.0), found.free)

    def _searched(self, wanted: PoseTarget, reference: Array) -> Solutions:
        """Search by Newton's method from the reference and the nearest of many random poses; if none succeeds, from
        more.
        """
        samples = self.arm.chain.random_joints(_SAMPLES, rng_for(0, "structure"))
        Ts, shape = self.tool(samples)[0], (len(wanted), _STARTS, self.arm.chain.size)
        free = np.zeros(shape, dtype=np.bool_)
        found = Solutions(np.zeros(shape), np.full(shape[:2], np.inf), np.full(shape[:2], np.inf), free)
        for turned in (True, False):
            rows = np.flatnonzero(wanted.turned == turned)
            if not rows.size:
                continue
            tree = scipy.spatial.cKDTree(pose_landmarks(Ts[:, :3, 3], Ts[:, :3, :3], turned))
            for starting in (_STARTS, _MORE_STARTS):
                landmarks = pose_landmarks(wanted.positions[rows], wanted.rotations[rows], turned)
                starts = samples[tree.query(landmarks, k=starting)[1]]
                given = np.isfinite(reference[rows]).all(axis=1)
                starts[given, 0] = reference[rows[given]]
                best = self._nearest_ends(wanted.take(rows), starts)
                for name in ("joints", "gap_m", "tilt_rad"):
                    getattr(found, name)[rows] = getattr(best, name)
                rows = rows[~((best.gap_m == 0) & (best.tilt_rad <= _SIMILAR_RAD)).any(axis=1)]
                if not rows.size:
                    break
        return found

    def _nearest_ends(self, wanted: PoseTarget, starts: Array) -> Solutions:
        """Return the best results of Newton's method from starts ``(n, some, joints)``."""
        each = wanted.take(np.repeat(np.arange(len(wanted)), starts.shape[1]))
        flat = starts.reshape(-1, starts.shape[2])
        ended = reach(self.arm, self.values, each, flat, np.empty((len(each), 0)), self.target)
        missed, turned_off = (np.linalg.norm(part, axis=1) for part in (ended.errors[:, :3], ended.errors[:, 3:]))
        gap = np.where(ended.arrived, 0.0, missed).reshape(starts.shape[:2])
        tilt = (turned_off if starts.shape[2] < FREEDOMS else np.zeros(len(each))).reshape(gap.shape)
        least = np.sort(np.argsort(gap + tilt, axis=1, kind="stable")[:, :_STARTS], axis=1)
        gap, tilt = (np.take_along_axis(part, least, axis=1) for part in (gap, tilt))
        joints = np.take_along_axis(ended.joints.reshape(starts.shape), least[..., None], axis=1)
        return Solutions(joints, gap, tilt, np.zeros(joints.shape, dtype=np.bool_))


def ordered(
    chain: JointSpec, solutions: Solutions, reference: Array, disliked: NDArray[np.bool_], before: Array | None = None
) -> tuple[Array, NDArray[np.int_]]:
    """Order IK solutions by preference: reached, within limits, not disliked, and near.

    Near to a row's reference, or to the preferred solution of the row before, by whole turns.

    Args:
        reference: ``(n, joints)`` joint positions, or NaN.
        disliked: ``(n, k)``.
        before: ``(joints,)`` joint positions before the first row; home by default.

    Returns:
        ``(n, k, joints)`` joint positions, and their branches ``(n, k)``.
    """
    joints, order = np.empty_like(solutions.joints), np.empty(solutions.gap_m.shape, dtype=np.int_)
    given = np.asarray(np.isfinite(reference).all(axis=1), dtype=np.bool_)
    near = np.where(given[:, None], reference, chain.home if before is None else before)
    fixed = _DISLIKE_COST * disliked + _GAP_COST * solutions.gap_m + _TILT_COST * solutions.tilt_rad
    rows = np.arange(len(joints))
    while rows.size:  # all rows at once, then those again for which the row before has changed
        turned = nearest_whole_turns(chain, solutions.joints[rows], near[rows, None])
        cost = np.abs(turned - near[rows, None]).max(axis=2) + fixed[rows]
        cost += _EXCESS_COST * chain.excess(turned).sum(axis=2)
        order[rows] = np.argsort(cost, axis=1, kind="stable")
        joints[rows] = np.take_along_axis(turned, order[rows, :, None], axis=1)
        after = rows[rows + 1 < len(joints)] + 1
        after = after[~given[after]]
        rows = after[np.any(near[after] != joints[after - 1, 0], axis=1)]
        near[rows] = joints[rows - 1, 0]
    return joints, order


def nearest_whole_turns(chain: JointSpec, joints: Array, near: Array) -> Array:
    """Turn hinges of ``(..., joints)`` by whole turns: nearest to others, within limits if possible."""
    full_turn = np.where(chain.prismatic, 0.0, 2 * np.pi)
    found = joints + full_turn * np.round((near - joints) / (2 * np.pi))
    found = np.where((found > chain.upper) & (found - full_turn >= chain.lower), found - full_turn, found)
    return np.asarray(np.where((found < chain.lower) & (found + full_turn <= chain.upper), found + full_turn, found))
