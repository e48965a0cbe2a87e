"""Direct, inverse and differential models of a nominal robot.

The equations of a robot's table are read without the simulator, which takes long to load.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import numpy as np
from numpy.typing import NDArray

from lab.core import se3
from lab.core.errors import LabError
from lab.core.se3 import Array
from lab.core.units import MM
from lab.formats.robot_toml import described_links, is_mechanism, read_table
from lab.kinematics.differential import manipulability
from lab.kinematics.differential import rates as joint_rates
from lab.kinematics.inverse.branches import NominalInverse, nearest_whole_turns, ordered
from lab.kinematics.inverse.closed_form import ClosedForm, Determinant
from lab.kinematics.inverse.newton_inverse import FREEDOMS, PoseTarget
from lab.kinematics.joints import JointSpec
from lab.kinematics.model import RigidArm
from lab.kinematics.serial.chain import Chain
from lab.kinematics.serial.serial_arm import SerialArm
from lab.robots.robot_files import description_of, parted, sha256_of

if TYPE_CHECKING:
    from lab.extensions.robotics.closed.recognition import ClassicalModel, MeasuredLegs
    from lab.kinematics.closed.mechanism import Mechanism
    from lab.robots.robot import Robot

__all__ = [
    "InverseJacobian",
    "Placement",
    "Reached",
    "Solution",
    "Solver",
    "SourcedRobot",
    "configurations",
    "inverse_of_jacobian",
    "matching",
    "nominal_robot",
    "placements",
]

_SAME = 1e-6  # rad or m: solutions nearer to each other are one
_REACHED_M = 1e-6  # a pose is written to the micron, which joints that are too few for its digits may miss
_ON_SINGULARITY = 1e-9  # of a factor of the determinant
_LEAST = 1e-9  # of a part of a self-motion: it is none


@dataclass(frozen=True)
class SourcedRobot:
    """A nominal robot, with the source of its model.

    Attributes:
        chain: the nominal model, whose joints are measured.
        sha256: of the files that it was read from.
        warnings: about the files, for the user.
        source: the name or path that it was loaded by.
        loaded: the whole loaded robot, where available.
    """

    chain: JointSpec
    sha256: str
    warnings: tuple[str, ...]
    source: str
    loaded: "Robot | None" = field(default=None, repr=False)

    @property
    def name(self) -> str:
        """Name of the robot."""
        return self.chain.name

    def arm(self, targets: tuple[str, ...]) -> RigidArm:
        """Return the equations of the arm, with these targets."""
        return SerialArm(self.chain, targets) if isinstance(self.chain, Chain) else self.whole.arm(targets)

    @cached_property
    def whole(self) -> "Robot":
        """The robot with its simulated model, loaded on first use."""
        from lab.robots.load_robot import load_robot

        return self.loaded or load_robot(self.source)


def nominal_robot(robot: "str | Path | Robot") -> SourcedRobot:
    """Load a robot's equations, by the name of a model of the lab, a path, or a loaded robot.

    Raises:
        LabError: there is no such robot, or it cannot be read.
    """
    if isinstance(robot, str | Path) and not parted(str(robot))[1]:
        path = description_of(str(robot))
        if path.suffix == ".toml" and described_links(path) is None and not is_mechanism(path):
            table = read_table(path)
            return SourcedRobot(table.chain, sha256_of(path), table.warnings, str(robot))
    from lab.robots.load_robot import load_robot

    loaded = load_robot(robot)
    return SourcedRobot(loaded.chain, loaded.sha256, loaded.warnings, loaded.source, loaded)


def configurations(determinant: Determinant, joints: Array) -> list[dict[str, str]]:
    """Return signs (+, - or 0) of all factors of det J at joint positions ``(n, joints)``, by the singularity's name.

    An arm changes such a sign only where it passes the singularity (Borrel & Liegeois 1986). A factor that is constant
    is left out.
    """
    factors = [factor for factor in determinant.factors if factor.terms]
    signs = [
        np.where(np.abs(value := factor.at(joints)) <= _ON_SINGULARITY, 0, np.sign(value)).astype(int)
        for factor in factors
    ]
    names = [factor.name for factor in factors]
    return [dict(zip(names, ("0+-"[sign] for sign in row), strict=True)) for row in zip(*signs, strict=True)]


@dataclass(frozen=True)
class Solution:
    """An IK solution for a pose.

    Attributes:
        joints: ``(n,)`` joint positions, rad or m.
        configuration: the side of each singularity, by its name: +, - or 0 (on it); of a mechanism with loops the
            branch of each leg, by its joint.
        free: ``(n,)`` joints that may take any position, as the arm is singular there.
        tilt_rad: rotation error, where an arm of fewer than six joints cannot take the rotation.
    """

    joints: Array
    configuration: Mapping[str, str]
    free: NDArray[np.bool_]
    tilt_rad: float = 0.0


@dataclass(frozen=True)
class _PoseSolutions:
    """IK solutions found for one pose.

    Attributes:
        solutions: nearest to the reference first.
        gap_m: distance out of reach, of a search the distance to the nearest place found; zero where there is a
            solution, NaN where unknown.
        how: ``closed form`` (then these are all) or ``search``.
        reassembled: number of further solutions of a mechanism with loops in another assembly mode alone.
        others: number of further solutions in configurations not requested.
    """

    solutions: tuple[Solution, ...]
    gap_m: float
    how: str
    reassembled: int = 0
    others: int = 0


@dataclass(frozen=True)
class Solver:
    """Inverse kinematics of a nominal robot.

    Attributes:
        values: parameters ``(p,)``, with one target.
    """

    arm: RigidArm
    values: Array

    def __call__(self, wanted: PoseTarget, reference: Array) -> list[_PoseSolutions]:
        """Return the solutions of each pose.

        Args:
            reference: joint positions ``(n, joints)`` near which solutions are preferred, NaN where none are given.
        """
        by_legs = self._legs(wanted) if self.arm.chain.has_loops else None
        if by_legs is not None:
            return [by_legs(wanted.take(np.array([i])), reference[i]) for i in range(len(wanted))]
        inverse = NominalInverse(self.arm, self.values)
        roots = inverse.solutions(wanted, reference)
        joints, branches = ordered(self.arm.chain, roots, reference, np.zeros(roots.gap_m.shape, dtype=np.bool_))
        form, closed = inverse.closed_form, inverse.exact(wanted)
        return [
            self._distinct(
                form, bool(closed[i]), joints[i], roots.gap_m[i, order], roots.tilt_rad[i, order], roots.free[i, order]
            )
            for i, order in enumerate(branches)
        ]

    def _distinct(
        self, form: ClosedForm | None, closed: bool, joints: Array, gap: Array, tilt: Array, free: NDArray[np.bool_]
    ) -> _PoseSolutions:
        """Select the branches ``(k, ...)`` that reach a pose, each solution once."""
        reached = np.flatnonzero(gap <= (0.0 if closed else _REACHED_M))
        retained = _different(joints, reached, self.arm.chain.prismatic)
        solutions = tuple(
            Solution(joints[k], sides, free[k], float(tilt[k]))
            for k, sides in zip(retained, self._sides(form, joints[retained]), strict=True)
        )
        nearest = form is not None and form.exact_only and retained and tilt[retained].any()  # not the pose itself
        missed = 0.0 if retained else float(gap.min(initial=np.inf))
        return _PoseSolutions(solutions, missed, "closed form" if closed and not nearest else "search")

    def _sides(self, form: ClosedForm | None, joints: Array) -> list[dict[str, str]]:
        """Return the side of each singularity at joint positions ``(k, joints)``: of the factors of det J, or det J."""
        if not len(joints):
            return []
        if form is not None:
            return configurations(form.determinant, joints)
        if self.arm.chain.size != FREEDOMS:
            return [{} for _ in joints]
        signs = np.sign(np.linalg.det(self.arm.tool(joints, self.values)[1])).astype(int)
        return [{"det": "0+-"[sign]} for sign in signs]

    def _legs(self, wanted: PoseTarget) -> "Callable[[PoseTarget, Array], _PoseSolutions] | None":
        """Return the closed form of a mechanism's legs if it solves such poses, else None."""
        from lab.extensions.robotics.closed.recognition import classical_model_of, measured_legs_of
        from lab.kinematics.closed.mechanism import Mechanism

        mechanism = self.arm.chain
        if not isinstance(mechanism, Mechanism):
            return None
        if wanted.turned.all() and (lengths := measured_legs_of(mechanism)) is not None:
            return partial(self._by_lengths, lengths)
        classical = classical_model_of(mechanism)
        if classical is None:
            return None
        turns = any(mechanism.tree.step(*step).is_turn for step in mechanism.tree.passive)
        others = _beside(mechanism, classical)
        if others and not self._independent(others, turns, wanted):
            return None  # these joints and the legs move the tool alike
        return partial(self._by_legs, mechanism, classical) if wanted.turned.all() or not turns else None

    def _independent(self, others: list[int], turns: bool, wanted: PoseTarget) -> bool:
        """Check that one joint beside those of the legs turns the tool, and that the legs do not."""
        return not turns and len(others) == 1 and self._turns_alone(others[0], wanted)

    def _turn_of(self, joint: int) -> tuple[Array, Array]:
        """Return the displacement ``(3,)`` of the tool's point by one radian of a joint, and its rotation vector."""
        moved = self.arm.chain.home + np.eye(self.arm.chain.size)[[joint]] * np.array([[0.0], [1.0]])
        Ts = self.arm.tool(moved, self.values)[0]
        return Ts[1, :3, 3] - Ts[0, :3, 3], se3.log(Ts[1, :3, :3] @ Ts[0, :3, :3].T)

    def _turns_alone(self, joint: int, wanted: PoseTarget) -> bool:
        """Check that a joint turns the tool by its own angle; where a rotation is free, about the tool's point."""
        displaced, turned = self._turn_of(joint)
        still = wanted.turned.all() or np.linalg.norm(displaced) < _SAME
        return bool(still and abs(np.linalg.norm(turned) - 1) < _SAME)

    def _by_lengths(self, legs: "MeasuredLegs", wanted: PoseTarget, reference: Array) -> _PoseSolutions:
        """Return the only joint positions of legs of measured lengths, if they belong to the nominal assembly mode."""
        joints = legs.joints(
            se3.pose(wanted.rotations[0], wanted.positions[0] - wanted.rotations[0] @ self.values[-3:])
        )
        T, jacobian = self.arm.tool(joints[None], self.values)
        if not np.abs(wanted.errors(T)).max() < _REACHED_M:  # NaN where the loops do not close
            return _PoseSolutions((), np.nan, "closed form", 1)
        side = "0+-"[int(np.sign(np.linalg.det(jacobian[0])))] if len(joints) == FREEDOMS else None
        named = {} if side is None else {"det": side}
        return _PoseSolutions((Solution(joints, named, np.zeros(len(joints), dtype=np.bool_)),), 0.0, "closed form")

    def _by_legs(
        self, mechanism: "Mechanism", classical: "ClassicalModel", wanted: PoseTarget, reference: Array
    ) -> _PoseSolutions:
        """Return the working modes of a mechanism with a closed form, for one pose.

        A joint that turns the tool in the platform takes the rotation's part about its axis.
        """
        from lab.extensions.robotics.closed.recognition import passive_values_of, working_modes

        tool, near = self.values[-3:], reference if np.isfinite(reference).all() else mechanism.home
        others = _beside(mechanism, classical)
        # the pose of the platform, p = p_wanted - R tool
        start, free = self._beside_legs(others, wanted, near)
        rotation = wanted.rotations[0] if wanted.turned[0] else self.arm.tool(start[None], self.values)[0][0, :3, :3]
        T_base_platform = se3.pose(rotation, wanted.positions[0] - rotation @ tool)
        # the branches of the legs there; those of another assembly mode do not bring the nominal tool to its place
        passive, missed = passive_values_of(mechanism, T_base_platform, start)
        modes = working_modes(mechanism, classical, passive) if missed <= _REACHED_M else []
        rows = np.array([mode.joints for mode in modes]).reshape(-1, mechanism.size)
        rows[:, others] = start[others]
        rows = nearest_whole_turns(mechanism, rows, np.broadcast_to(near, rows.shape))
        reached = self._reached(rows, wanted.positions[0])
        reached.sort(key=lambda k: float(np.abs(rows[k] - near).max()))
        sides = _sides_of_legs(mechanism.joint_names, [modes[k].branches for k in reached], classical.order)
        solutions = tuple(Solution(rows[k], side, free) for k, side in zip(reached, sides, strict=True))
        gap = 0.0 if solutions else missed if missed > _REACHED_M else np.nan
        return _PoseSolutions(solutions, gap, "closed form", len(modes) - len(reached))

    def _beside_legs(self, others: list[int], wanted: PoseTarget, near: Array) -> tuple[Array, NDArray[np.bool_]]:
        """Return joint positions turned by the rotation about joints beside the legs, and which joints are free."""
        start, free = self.arm.chain.home.copy(), np.zeros(self.arm.chain.size, dtype=np.bool_)
        home = self.arm.tool(start[None], self.values)[0][0, :3, :3]
        for joint in others:
            if wanted.turned[0]:
                start[joint] += self._turn_of(joint)[1] @ se3.log(wanted.rotations[0] @ home.T)
            else:
                start[joint], free[joint] = near[joint], True
        return start, free

    def _reached(self, rows: Array, position: Array) -> list[int]:
        """Return which joint positions ``(k, joints)`` bring the tool to a place ``(3,)`` m."""
        if not len(rows):
            return []
        places = self.arm.tool(rows, self.values)[0][:, :3, 3]
        reached: list[int] = np.flatnonzero(np.abs(places - position).max(axis=1) < _REACHED_M).tolist()
        return reached


def _beside(mechanism: "Mechanism", classical: "ClassicalModel") -> list[int]:
    """Return the joints that move no leg."""
    return [j for j in range(mechanism.size) if j not in classical.order]


def _sides_of_legs(
    names: Sequence[str], branches: Sequence[tuple[int, ...]], legs: Sequence[int]
) -> list[dict[str, str]]:
    """Name the branch of each leg by its joint; nothing where every leg has one branch."""
    if not any(map(any, branches)):
        return [{} for _ in branches]
    return [{names[j]: "+-"[row[j]] for j in sorted(legs)} for row in branches]


def matching(solved: _PoseSolutions, requested: tuple[str, ...]) -> _PoseSolutions:
    """Select the solutions of one configuration, e.g. ``("elbow+", "wrist-")``.

    Raises:
        LabError: a requested name has no sign or both, or no solution has it; the message lists the names.
    """
    sides = _requested_sides(solved, requested)
    retained = tuple(s for s in solved.solutions if sides.items() <= s.configuration.items())
    return replace(solved, solutions=retained, others=len(solved.solutions) - len(retained))


def _requested_sides(solved: _PoseSolutions, requested: tuple[str, ...]) -> dict[str, str]:
    """Return the requested sign by the singularity's name."""
    names = sorted({name for solution in solved.solutions for name in solution.configuration})
    sides: dict[str, str] = {}
    for side in requested:
        name, sign = side[:-1].strip(), side[-1:].replace("−", "-")
        if sign not in ("+", "-") or (solved.solutions and name not in names):
            listed = ", ".join(f"{name}+ and {name}-" for name in names) or "none: this robot's solutions have no names"
            raise LabError(f"--of {side}: no configuration is called so; there are {listed}")
        if sides.setdefault(name, sign) != sign:
            raise LabError(f"--of {name}+,{name}-: a solution has one of the two; ask for one, or leave out {name}")
    return sides


def _different(joints: Array, rows: NDArray[np.int_], prismatic: tuple[bool, ...]) -> list[int]:
    """Return rows of joint positions ``(k, joints)`` without repetitions, up to whole turns; the first is retained."""
    retained: list[int] = []
    for row in rows.tolist():
        apart = joints[retained] - joints[row]
        apart = np.where(prismatic, apart, apart - 2 * np.pi * np.round(apart / (2 * np.pi)))
        if not (np.abs(apart).max(axis=1, initial=0.0) < _SAME).any():
            retained.append(row)
    return retained


@dataclass(frozen=True)
class Placement:
    """A robot at some joint positions.

    Attributes:
        name: the row's id, or the solution's number.
        joints: ``(n,)`` rad or m.
        T_base_tool: pose ``(4, 4)`` (m) of the tool's point, turned as the last frame or the platform.
        jacobian: geometric ``(6, n)`` in the requested frame: velocity of the point (m), then angular velocity
            (rad), by the joint positions.
        rank: of the Jacobian.
        manipulability: Yoshikawa's, sqrt(det J J') or sqrt(det J' J), SI.
        determinant: of the Jacobian, SI; of an arm with a closed form that of the rows that it can have; None where
            there is none.
        factors: each factor of the determinant by the name of its singularity; zero at the singularity.
        self_motions: ``(k, n)`` directions of the joints that move nothing, the largest part 1.
        lost: ``(l, 6)`` directions in which no joint moves the tool (m, rad), in the requested frame.
        beyond: description of the exceeded limit; empty where none is.
        configuration: of a solution, as ``Solution`` has it.
        free: names of the joints that may take any position, because the arm is singular.
        tilt_rad: rotation error of a wanted pose.
        rates: ``(n,)`` rad/s or m/s, given or found; None where neither rates nor a twist were requested.
        twist: ``(6,)`` m/s and rad/s of these rates.
        missing: ``(6,)`` the part of a wanted twist that the robot cannot have.
    """

    name: str
    joints: Array
    T_base_tool: Array
    jacobian: Array
    rank: int
    manipulability: float
    determinant: float | None
    factors: Mapping[str, float]
    self_motions: Array
    lost: Array
    beyond: str
    configuration: Mapping[str, str]
    free: tuple[str, ...] = ()
    tilt_rad: float = 0.0
    rates: Array | None = None
    twist: Array | None = None
    missing: Array | None = None

    @property
    def inverse_jacobian(self) -> "InverseJacobian | None":
        """Inverse or pseudo-inverse of the Jacobian; None where the loops do not close."""
        return inverse_of_jacobian(self.jacobian, self.rank) if np.isfinite(self.jacobian).all() else None


@dataclass(frozen=True)
class InverseJacobian:
    """Inverse of a Jacobian.

    Attributes:
        matrix: ``(n, 6)``.
        kind: ``blocks``, ``inverse``, pseudo-inverse from the ``left`` or the ``right``, or ``singular``.
    """

    matrix: Array
    kind: str


def inverse_of_jacobian(jacobian: Array, rank: int) -> InverseJacobian:
    """Invert a Jacobian ``(6, n)`` (Mallem 2011, section 5.6, with the pseudo-inverse's misprint mended).

    Where the last three joints of six only turn the tool, J = [A 0; C D] is inverted by blocks of 3 by 3. A Jacobian
    of fewer columns has J⁺ = (J'J)^-1 J', one of more J' (J J')^-1. Of less than full rank it is found by singular
    values.
    """
    size = jacobian.shape[1]
    if rank < min(6, size):
        return InverseJacobian(np.asarray(np.linalg.pinv(jacobian, rcond=_ON_SINGULARITY)), "singular")
    if size < FREEDOMS:
        return InverseJacobian(np.asarray(np.linalg.solve(jacobian.T @ jacobian, jacobian.T)), "left")
    if size > FREEDOMS:
        return InverseJacobian(np.asarray(np.linalg.solve(jacobian @ jacobian.T, jacobian).T), "right")
    A, B, C, D = jacobian[:3, :3], jacobian[:3, 3:], jacobian[3:, :3], jacobian[3:, 3:]
    if np.abs(B).max() > _LEAST:
        return InverseJacobian(np.asarray(np.linalg.inv(jacobian)), "inverse")
    A_back, D_back = np.linalg.inv(A), np.linalg.inv(D)
    return InverseJacobian(np.block([[A_back, np.zeros((3, 3))], [-D_back @ C @ A_back, D_back]]), "blocks")


def placements(
    arm: RigidArm,
    values: Array,
    determinant: Determinant | None,
    rows: Array,
    names: Sequence[str],
    solved: Sequence[Solution] | None = None,
    *,
    frame: Literal["base", "tool"] | int = "base",
    rates: Array | None = None,
    twist: Array | None = None,
) -> tuple[Placement, ...]:
    """Place the nominal robot at each of ``rows`` ``(m, n)`` of joint positions.

    Args:
        names: of the rows.
        solved: the solutions, if the rows are such.
        frame: whose axes Jacobian and twist have: the base's, the tool's, or those of a link by its number.
        rates: ``(n,)`` given joint rates.
        twist: ``(6,)`` a wanted twist.
    """
    if not len(rows):
        return ()
    # poses T, and Jacobians J in the requested axes; zero in place of J where the loops do not close
    Ts, jacobians = _jacobians_in(arm, values, rows, frame)
    closes: NDArray[np.bool_] = np.array(np.isfinite(jacobians).all(axis=(1, 2)))
    finite = np.where(closes[:, None, None], jacobians, 0.0)
    # rates q' = J+ V of the wanted twist, with ranks, self-motions and lost directions
    wanted = np.zeros((len(rows), 6)) if twist is None else np.tile(twist, (len(rows), 1))
    moved = joint_rates(finite, wanted)
    width = np.where(closes, manipulability(finite), np.nan)
    placed = []
    for i, (joints, name) in enumerate(zip(rows, names, strict=True)):
        whole, factors = _determinant_at(determinant, joints, jacobians[i])
        q_rates = rates if rates is not None else moved.joints[i] if twist is not None else None
        rank = int(moved.rank[i])
        placement = Placement(
            name, joints, Ts[i], jacobians[i], rank, float(width[i]), whole, factors,
            _largest_one(moved.free[i, : arm.chain.size - rank]), moved.lost[i, : 6 - rank],
            _beyond(arm, joints, bool(closes[i])), {}, rates=q_rates,
            twist=None if q_rates is None else jacobians[i] @ q_rates,
            missing=None if twist is None else moved.missing[i],
        )  # fmt: skip
        placed.append(placement if solved is None else _of_solution(placement, arm.chain, solved[i]))
    return tuple(placed)


def _jacobians_in(
    arm: RigidArm, values: Array, rows: Array, frame: Literal["base", "tool"] | int
) -> tuple[Array, Array]:
    """Return the poses of the tool, and the Jacobians ``(m, 6, n)`` in the axes of a frame: R'v and R'w."""
    Ts, jacobians = arm.tool(rows, values)
    if frame in ("base", 0):
        return Ts, jacobians
    axes = Ts if isinstance(frame, str) or not isinstance(arm, SerialArm) else arm.frame(rows, values, frame)
    back = axes[:, :3, :3].swapaxes(1, 2)
    return Ts, np.concatenate([back @ jacobians[:, :3], back @ jacobians[:, 3:]], axis=1)


def _determinant_at(
    determinant: Determinant | None, joints: Array, jacobian: Array
) -> tuple[float | None, dict[str, float]]:
    """Return det J and its factors by their names; without a closed form det J alone, of six joints."""
    if determinant is None:
        return (float(np.linalg.det(jacobian)) if len(joints) == FREEDOMS else None), {}
    factors = {factor.name: float(factor.at(joints)) for factor in determinant.factors if factor.terms}
    return float(determinant.at(joints)), factors


def _of_solution(placement: Placement, chain: JointSpec, solution: Solution) -> Placement:
    """Return a placement with what the inverse model says of it."""
    free = tuple(np.array(chain.joint_names)[solution.free].tolist())
    return replace(placement, configuration=solution.configuration, free=free, tilt_rad=solution.tilt_rad)


def _largest_one(rows: Array) -> Array:
    """Scale rows so that the largest part is 1, and remove rounding errors."""
    scaled = rows / np.abs(rows).max(axis=1, keepdims=True, initial=1e-300) if len(rows) else rows
    return np.asarray(np.where(np.abs(scaled) < _LEAST, 0.0, scaled))


def _beyond(arm: RigidArm, joints: Array, closes: bool) -> str:
    """Describe the limit exceeded the most by some joint positions, or why the loops do not close."""
    if not closes:
        return arm.chain.infeasibility_reason(joints)
    excess = arm.chain.excess(joints)
    j = int(np.argmax(excess))
    return arm.chain.limit_note(j, joints[j]) if excess[j] > _LEAST else ""


@dataclass(frozen=True)
class Reached:
    """Result of the inverse kinematics of one pose.

    Attributes:
        name: the row's id.
        position: ``(3,)`` m.
        rotation: ``(3, 3)``, NaN where the orientation is free.
        solutions: numbers of its placements, from 0.
        gap_m, how, reassembled, others: as the solver has them.
    """

    name: str
    position: Array
    rotation: Array
    solutions: tuple[int, ...]
    gap_m: float
    how: str
    reassembled: int = 0
    others: int = 0

    @property
    def away(self) -> str:
        """Description of the distance to a pose without a solution; empty where there is one, or it is unknown."""
        if self.solutions or not self.gap_m or not np.isfinite(self.gap_m):
            return ""
        gap = MM.text(self.gap_m, 6)
        return f"it is {gap} out of reach" if self.how == "closed form" else f"the nearest place found is {gap} away"
