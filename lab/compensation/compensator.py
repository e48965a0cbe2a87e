"""Targets that an identified arm really hits: three schemes that end at the same place.

(a) The identified arm's inverse, by Newton's method. (b) The differential scheme: joints moved by dq = -J+ dX, with
the nominal model's Jacobian J and the error dX evaluated anew where they then stand. (c) Targets corrected in space,
X_C = X_R - dX, for a controller that goes on computing with the nominal model; dX is evaluated at the joints that it
finds for X_C. The last two are how elastic errors are compensated (e.g. Khalil & Besnard 2002; Klimchik 2011).

An arm with fewer than six joints is brought to the place, and as near to the rotation as it can be turned there. One
or two joints move the tool on a line or a surface: it is brought to the place there that is nearest to the target.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lab.core.errors import LabError
from lab.core.progress import Progress, no_progress
from lab.core.random import rng_for
from lab.core.se3 import Array
from lab.core.units import DEGREES, MM
from lab.kinematics.differential import SINGULAR_M
from lab.kinematics.effects.arm_with_effects import Arm
from lab.kinematics.inverse.branches import NominalInverse, nearest_whole_turns, ordered
from lab.kinematics.inverse.closed_form import Solutions
from lab.kinematics.inverse.newton_inverse import (
    FREEDOMS,
    PLACES,
    PoseTarget,
    reach,
    shortest_step,
    tool_at,
    within_reach,
)
from lab.kinematics.joints import JointSpec

__all__ = ["AGREED_M", "CLEAR_RAD", "NEAR_RAD", "REQUESTED_BRANCH", "Compensation", "Compensator"]

CLEAR_RAD = np.deg2rad(5.0)  # of a singularity, where the rotation is free to choose
_MOST_LEFT_OUT_M = 10e-3  # of a place, by an arm with one or two joints; what is farther off is out of its reach
_AIMINGS = 3  # of the nominal model's inverse at what the arm misses, before Newton's method begins
_ROUNDS = 50  # of the schemes (b) and (c)
_SETTLED_M, _SETTLED_RAD = 1e-9, 1e-9  # an error that they leave
_NO_OTHER = "; no other solution avoids it within the limits"
REQUESTED_BRANCH = "the row's joint positions choose this solution; leave them empty to try others"
_BLOCK = 2_000  # targets that are worked out at a time
_TRIED = 20  # random poses, in one of which the arm moves its tool every way if it ever does

_Texts = NDArray[np.object_]  # (n,) of str
NEAR_RAD = np.deg2rad(1.0)  # of a singularity (m for a slide)
AGREED_M = 1e-6  # what schemes of compensation may end apart, m or rad
_EDGE_M = 1e-3  # missed by less, a target is at the edge of the workspace
_LIMIT_SLACK = 1e-9  # rad or m: rounding

_Moved = Callable[
    [NDArray[np.int_], Array, Array], Array
]  # rows, their joint positions, what is missing: to new joint positions
_Refusals = Callable[[Array], Sequence[str]]  # joint positions (n, joints): why the arm may not be there; "" if it may


@dataclass
class _Attempts:
    """Best attempts so far.

    Attributes:
        start: ``(n, joints)`` the nominal model's joint positions, of its solutions ``branch`` ``(n,)``.
        joints: ``(n, joints)`` the identified arm's.
        errors: ``(n, 6)`` what is missing, m and rad.
        arrived: ``(n,)`` whether nothing is, or nothing that so many joints could make up for.
        excess: ``(n, joints)`` beyond limits.
        steps: ``(n,)``.
        refusals: one each: why the arm may not stand there, though it can; "" where it may.
        passed_over: one each: why the solution that was tried first was left for another one; "" where it was not.
    """

    start: Array
    branch: NDArray[np.int_]
    joints: Array
    errors: Array
    arrived: NDArray[np.bool_]
    excess: Array
    steps: NDArray[np.int_]
    refusals: _Texts
    passed_over: _Texts

    @property
    def possible(self) -> NDArray[np.bool_]:
        """Check ``(n,)`` which targets are reached within limits."""
        return np.asarray(self.arrived & (self.excess.max(axis=1) <= _LIMIT_SLACK))

    @property
    def fits(self) -> NDArray[np.bool_]:
        """Check ``(n,)`` which targets are reached, within limits, and not refused."""
        return np.asarray(self.possible & (self.refusals == ""))

    @property
    def cost(self) -> Array:
        """Cost ``(n,)``: a refusal costs less than a joint beyond its limits or a target not reached."""
        beyond = np.where(self.refusals == "", self.excess.max(axis=1), 2 * _LIMIT_SLACK)
        return np.where(self.arrived, beyond, 1e3 + np.abs(self.errors).max(axis=1))

    def take_better(self, rows: NDArray[np.int_], other: "_Attempts", chain: JointSpec) -> None:
        """Replace worse results by those of another method for some rows, and report what was wrong with them."""
        better = other.cost < self.cost[rows]
        for i in rows[better].tolist():
            self.passed_over[i] = self.passed_over[i] or self.refusals[i] or self._not_within_limits(i, chain)
        for name in ("start", "branch", "joints", "errors", "arrived", "excess", "steps", "refusals"):
            getattr(self, name)[rows[better]] = getattr(other, name)[better]

    def _not_within_limits(self, i: int, chain: JointSpec) -> str:
        """Describe the solution as beyond a limit, or as not found."""
        beyond = int(self.excess[i].argmax())
        return _beyond_limit(chain, self.joints[i], beyond) if self.arrived[i] else "no solution was found near it"

    def reason(self, i: int, chain: JointSpec, singular: tuple[float, int], scheme_disagreement_m: float) -> str:
        """Return the reason why a target is not reached; empty if it is.

        Args:
            singular: how far it is from a singularity (rad, m of a slide), and the joint that leads there.
            scheme_disagreement_m: how far apart the schemes of compensation end; NaN where they were not tried.
        """
        if scheme_disagreement_m <= AGREED_M:
            return ""
        if self.possible[i] and self.refusals[i]:
            return str(self.refusals[i])
        beyond = int(self.excess[i].argmax())
        if self.arrived[i] and self.excess[i, beyond] > _LIMIT_SLACK:
            return f"joint limit: {_beyond_limit(chain, self.joints[i], beyond)}"
        distance, joint = singular
        near = f"{chain.unit(joint).text(distance, 2)} from a singularity of the arm ({chain.joint_names[joint]})"
        if distance < NEAR_RAD:
            near = f"within 1° of a singularity: {near}"
        if self.arrived[i]:
            return f"{near}, where the schemes of compensation do not meet"
        short_m, missed = self._missed(i)
        return f"out of reach by {missed}" + (f", {near}" if distance < NEAR_RAD and short_m < _EDGE_M else "")

    def _missed(self, i: int) -> tuple[float, str]:
        """Return by how much a place is missed (m), and the text of that, or of the rotation where the place is met."""
        short, turned = (float(np.linalg.norm(part)) for part in (self.errors[i, :3], self.errors[i, 3:]))
        return short, MM.text(short) if short > AGREED_M else DEGREES.text(turned)


@dataclass(frozen=True)
class Compensation:
    """Corrected targets.

    Attributes:
        joints: ``(n, joints)`` that bring the identified arm's tool to each target; where that fails, those that come
            nearest.
        uncorrected: ``(n, joints)`` by the nominal model, in the same branch.
        positions, rotations: ``(n, 3)`` m, ``(n, 3, 3)``: the corrected targets in space, in the tracker's frame.
        reasons: why a target cannot be reached, one each; empty where it is reached.
        differential, cartesian: ``(n, joints)`` joint positions of the schemes (b) and (c).
        scheme_disagreement_m: ``(n,)`` the largest distance between the schemes' tools; NaN where one has none.
        singular_rad: ``(n,)`` distance to the nearest singularity (m of a slide), and ``singular_joint`` the joint
            that leads there.
        steps: ``(n,)`` of scheme (a), from the nominal model's inverse.
        unturned_rad: ``(n,)`` by how much the rotation is missed because it takes more joints than the arm has; zero
            where it has six, where any rotation will do, and where a target is not reached.
        unplaced_m: ``(n,)`` by how much the place is missed because it takes more than one or two joints; else zero.
        passed_over: one each: why the solution that was nearest is not the one that is given; empty where it is.
    """

    joints: Array
    uncorrected: Array
    positions: Array
    rotations: Array
    reasons: tuple[str, ...]
    differential: Array
    cartesian: Array
    scheme_disagreement_m: Array
    singular_rad: Array
    singular_joint: NDArray[np.int_]
    steps: NDArray[np.int_]
    unturned_rad: Array
    unplaced_m: Array
    passed_over: tuple[str, ...]

    @property
    def converged(self) -> NDArray[np.bool_]:
        """Check ``(n,)`` which targets are reached."""
        return np.array([not reason for reason in self.reasons], dtype=np.bool_)


@dataclass(frozen=True)
class Compensator:
    """Compensator of an identified arm for a controller that computes with the nominal model.

    Attributes:
        nominal: nominal links, base and tool: the controller's.
        arm, values: as identified, with its effects.
        refusals: why a configuration is refused; None without given obstacles.
        bound: message on why no other IK solution is tried where reference joint positions are given.
        progress: takes how many targets are corrected of how many, as the work goes on.

    Raises:
        LabError: the arm cannot bring its tool to places all around it.
    """

    nominal: NominalInverse
    arm: Arm
    values: Array
    refusals: _Refusals | None = None
    bound: str = REQUESTED_BRANCH
    progress: Progress = no_progress

    def __post_init__(self) -> None:
        arm, chain = self.nominal.arm, self.nominal.arm.chain
        _, jacobian = self.nominal.tool(chain.random_joints(_TRIED, rng_for(0, "structure")))
        directions = int(np.linalg.matrix_rank(jacobian[:, :3], tol=SINGULAR_M).max())
        if directions < min(PLACES, chain.size):
            raise LabError(
                f"robot '{chain.name}': its joints ({', '.join(chain.joint_names)}) move "
                f"{arm.targets[self.nominal.target]} in {directions} of three directions, so it cannot be brought to a "
                "place that is off by a little; compensation takes three joints that do"
            )

    def __call__(self, wanted: PoseTarget, conditions: Array, reference: Array) -> Compensation:
        """Correct targets, each by itself, in parts of a bounded size.

        Args:
            conditions: ``(n, c)``, what the arm's effects ask for.
            reference: ``(n, joints)`` joint positions that choose the IK branch; NaN where that is free.
        """
        count, before, whole = len(wanted), self.nominal.arm.chain.home, dict[str, Any]()
        for first in range(0, max(count, 1), _BLOCK):
            part = np.arange(first, min(first + _BLOCK, count))
            some, before = self._corrected(wanted.take(part), conditions[part], reference[part], before)
            for name, values in ((each.name, getattr(some, each.name)) for each in fields(Compensation)):
                texts = isinstance(values, tuple)
                if not first:
                    whole[name] = [] if texts else np.empty((count, *values.shape[1:]), values.dtype)
                if texts:
                    whole[name] += values
                else:
                    whole[name][part] = values
            self.progress(part.size + first, count)
        whole |= {name: tuple(texts) for name, texts in whole.items() if isinstance(texts, list)}
        return Compensation(**whole)

    def _corrected(
        self, wanted: PoseTarget, conditions: Array, reference: Array, before: Array
    ) -> tuple[Compensation, Array]:
        """Compensate some targets; also return the nominal joint positions ``(joints,)`` preferred for the last.

        Args:
            before: those for the target before the first.
        """
        chain, requested = self.nominal.arm.chain, wanted
        if chain.size < PLACES:
            wanted = PoseTarget(requested.positions, np.full_like(requested.rotations, np.nan))
        # Scheme (a), which decides what is reached.
        attempts, last = self._first_that_fits(wanted, conditions, reference, before)
        fits = np.flatnonzero(attempts.fits)
        joints, start, there = attempts.joints[fits], attempts.start[fits], conditions[fits]
        # Schemes (b) and (c) for these, and how far apart the three end.
        some = self._on_surface(wanted.take(fits), joints, there)
        schemes = [self._differential(some, there, start)]
        aimed, by_space = self._cartesian(self._as_poses(some, joints, there), there, start, attempts.branch[fits])
        schemes.append(by_space)
        differential, cartesian = (_spread(part, fits, attempts.joints.shape) for part in schemes)
        positions = _spread(aimed.positions, fits, wanted.positions.shape)
        rotations = _spread(aimed.rotations, fits, wanted.rotations.shape)
        apart = self._apart(there, some.turned, joints, *schemes)
        apart[chain.beyond_limits(by_space, _LIMIT_SLACK).any(axis=1)] = np.nan  # the controller would refuse it
        apart = _spread(apart, fits, (len(wanted),))
        # What fewer than six joints leave out, and how near a singularity is.
        unplaced, unturned = self._left_out(requested, attempts.joints, conditions)
        rigid = self.arm.rigid
        distance, joint = rigid.singular_distance(attempts.joints, self.values[: len(rigid.names)], self.nominal.target)
        done = Compensation(
            attempts.joints,
            attempts.start,
            positions,
            rotations,
            tuple(attempts.reason(i, chain, (distance[i], joint[i]), apart[i]) for i in range(len(wanted))),
            differential,
            cartesian,
            apart,
            distance,
            joint,
            attempts.steps,
            np.where(attempts.fits & (chain.size < FREEDOMS), unturned, 0.0),
            np.where(attempts.fits & (chain.size < PLACES), unplaced, 0.0),
            tuple(attempts.passed_over),
        )
        return done, last

    def _first_that_fits(
        self, wanted: PoseTarget, conditions: Array, reference: Array, before: Array
    ) -> tuple[_Attempts, Array]:
        """Return the identified arm's inverse, by the nominal model's first solution within limits, else the best."""
        chain = self.nominal.arm.chain
        solutions = self.nominal.solutions(wanted, reference)
        starts, order = ordered(chain, solutions, reference, self._near_singular(wanted, solutions), before)
        order[~wanted.turned] = -1  # found by search: of no branch
        free = np.asarray(~np.isfinite(reference).all(axis=1))
        attempts = self._tried(wanted, conditions, starts[:, 0], order[:, 0])
        for rank in range(1, order.shape[1]):
            rows = np.flatnonzero(free & ~attempts.fits)
            if not rows.size:
                break
            other = self._tried(wanted.take(rows), conditions[rows], starts[rows, rank], order[rows, rank])
            attempts.take_better(rows, other, chain)
        for i in np.flatnonzero(attempts.possible & ~attempts.fits).tolist():
            attempts.refusals[i] += _NO_OTHER if free[i] else f"; {self.bound}"
        return attempts, starts[-1, 0] if len(starts) else before

    def _on_surface(self, wanted: PoseTarget, joints: Array, conditions: Array) -> PoseTarget:
        """Project targets of arms with fewer than three joints onto the reachable set; return others unchanged."""
        if joints.shape[1] >= PLACES:
            return wanted
        return PoseTarget(self._tool(joints, conditions)[0][:, :3, 3], wanted.rotations)

    def _left_out(self, asked: PoseTarget, joints: Array, conditions: Array) -> tuple[Array, Array]:
        missing = asked.errors(self._tool(joints, conditions)[0])
        return np.linalg.norm(missing[:, :3], axis=1), np.linalg.norm(missing[:, 3:], axis=1)

    def _near_singular(self, wanted: PoseTarget, solutions: Solutions) -> NDArray[np.bool_]:
        """Check ``(n, k)``, where any rotation will do, which IK solutions are too near to a singularity."""
        near, rows = np.zeros(solutions.gap_m.shape, dtype=np.bool_), np.flatnonzero(~wanted.turned)
        joints = solutions.joints[rows]
        distance, _ = self.nominal.arm.singular_distance(
            joints.reshape(-1, joints.shape[2]), self.nominal.values, self.nominal.target
        )
        near[rows] = (distance < CLEAR_RAD).reshape(near[rows].shape)
        return near

    def _tried(self, wanted: PoseTarget, conditions: Array, start: Array, branch: NDArray[np.int_]) -> _Attempts:
        """Run Newton's method from one IK solution of the nominal model, aimed a few times at the arm's error there."""
        chain = self.nominal.arm.chain
        joints, aimings = start.copy(), np.zeros(len(wanted), dtype=np.int_)
        going = np.arange(len(wanted))
        for _ in range(_AIMINGS):
            aimed = self._aimed(wanted.take(going), joints[going], conditions[going])
            joints[going], reached = self.nominal.again(aimed, joints[going], branch[going])
            aimings[going] += 1
            going = going[reached]
        ended = reach(self.arm, self.values, wanted, joints, conditions, self.nominal.target)
        turned = nearest_whole_turns(chain, ended.joints, start)
        arrived = ended.arrived & (np.linalg.norm(ended.errors[:, :3], axis=1) < _MOST_LEFT_OUT_M)
        start = nearest_whole_turns(chain, start, turned)  # the other schemes end where this one does
        attempts = _Attempts(start, branch, turned, ended.errors, arrived, chain.excess(turned),
                             aimings + ended.steps, _no_texts(len(turned)), _no_texts(len(turned)))  # fmt: skip
        if self.refusals is not None:
            rows = np.flatnonzero(attempts.possible)
            attempts.refusals[rows] = self.refusals(turned[rows])
        return attempts

    def _differential(self, wanted: PoseTarget, conditions: Array, start: Array) -> Array:
        def moved(rows: NDArray[np.int_], joints: Array, missing: Array) -> Array:
            return joints + shortest_step(self.nominal.tool(joints)[1], missing, wanted.turned[rows])

        return self._iterated(wanted, conditions, start, moved)

    def _cartesian(
        self, wanted: PoseTarget, conditions: Array, start: Array, branch: NDArray[np.int_]
    ) -> tuple[PoseTarget, Array]:
        """Apply scheme (c): return corrected targets, and the joint positions that the controller finds for them."""
        aimed = PoseTarget(wanted.positions.copy(), wanted.rotations.copy())

        def moved(rows: NDArray[np.int_], joints: Array, _: Array) -> Array:
            corrected = self._aimed(wanted.take(rows), joints, conditions[rows])
            aimed.positions[rows], aimed.rotations[rows] = corrected.positions, corrected.rotations
            return self.nominal.again(aimed.take(rows), joints, branch[rows])[0]

        return aimed, self._iterated(wanted, conditions, start, moved)

    def _as_poses(self, wanted: PoseTarget, joints: Array, conditions: Array) -> PoseTarget:
        """Give targets without a wanted or reachable rotation the one that scheme (a) ends with, as a controller
        needs one.
        """
        Ts, reachable = self._tool(joints, conditions)[0], wanted.turned & (joints.shape[1] >= FREEDOMS)
        return PoseTarget(wanted.positions, np.where(reachable[:, None, None], wanted.rotations, Ts[:, :3, :3]))

    def _iterated(self, wanted: PoseTarget, conditions: Array, start: Array, moved: _Moved) -> Array:
        """Joint positions ``(n, joints)`` moved again and again, until the tool is where it is wanted.

        A fixed point, not Newton's method: ``moved`` may be a controller's own inverse, which gives joint positions,
        not steps.
        """
        joints, going = start.copy(), np.arange(len(wanted))
        for _ in range(_ROUNDS):
            some = wanted.take(going)
            Ts, jacobian = self._tool(joints[going], conditions[going])
            missing = within_reach(jacobian, some.errors(Ts), some.turned)
            far = ~_settled(missing)
            going = going[far]
            if not going.size:
                break
            joints[going] = moved(going, joints[going], missing[far])
        return joints

    def _aimed(self, wanted: PoseTarget, joints: Array, conditions: Array) -> PoseTarget:
        """Return the aim of the nominal model X_C = X_R - dX, by the arm's error at these joint positions."""
        real, drawn = self._tool(joints, conditions)[0], self.nominal.tool(joints)[0]
        positions = wanted.positions - (real[:, :3, 3] - drawn[:, :3, 3])
        return PoseTarget(positions, drawn[:, :3, :3] @ real[:, :3, :3].swapaxes(1, 2) @ wanted.rotations)

    def _tool(self, joints: Array, conditions: Array) -> tuple[Array, Array]:
        return tool_at(self.arm, np.concatenate([joints, conditions], axis=1), self.values, self.nominal.target)

    def _apart(self, conditions: Array, turned: NDArray[np.bool_], *schemes: Array) -> Array:
        """Return the largest distance ``(n,)`` m between the tool's poses, a radian of turned ones as a metre."""
        Ts = [self._tool(joints, conditions)[0] for joints in schemes]
        apart = np.zeros(len(turned))
        for other in Ts[1:]:
            missing = PoseTarget(Ts[0][:, :3, 3], Ts[0][:, :3, :3]).errors(other)
            missing[~turned, 3:] = 0.0
            apart = np.maximum(apart, np.abs(missing).max(axis=1))
        return apart


def _no_texts(count: int) -> _Texts:
    return np.full(count, "", dtype=object)


def _settled(missing: Array) -> NDArray[np.bool_]:
    place, turn = np.linalg.norm(missing[:, :3], axis=1), np.linalg.norm(missing[:, 3:], axis=1)
    return np.asarray((place < _SETTLED_M) & (turn < _SETTLED_RAD))


def _spread(part: Array, rows: NDArray[np.int_], shape: tuple[int, ...]) -> Array:
    whole = np.full(shape, np.nan)
    whole[rows] = part
    return whole


def _beyond_limit(chain: JointSpec, joints: Array, joint: int) -> str:
    at = joints[joint]
    limit = chain.upper[joint] if at > chain.upper[joint] else chain.lower[joint]
    unit = chain.unit(joint)
    return f"{chain.joint_names[joint]} would be at {unit.text(at, 5)}, beyond {unit.text(limit, 5)}"
