"""The models of a robot at some joint positions: typed, and as plain values."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from lab.commands.result import Result, joint_values, number, tidy
from lab.commands.run_folder import joint_columns
from lab.core import se3
from lab.core.errors import LabError, counted
from lab.core.se3 import Array
from lab.core.units import MM
from lab.extensions.robotics.kinematics.nominal_robot import NominalRobot
from lab.extensions.robotics.kinematics.options import KinematicsOptions
from lab.extensions.robotics.kinematics.symbolic import SymbolicChain, textbook
from lab.formats.csv_table import write_columns
from lab.kinematics.differential import manipulability, rates
from lab.kinematics.inverse.branches import NominalInverse, nearest_whole_turns, ordered
from lab.kinematics.inverse.closed_form import Determinant
from lab.kinematics.inverse.newton import FREEDOMS, PoseTarget
from lab.kinematics.joints import JointSpec
from lab.kinematics.model import RigidArm
from lab.kinematics.serial.arm import SerialArm
from lab.render.document import (
    Block,
    Bullets,
    Document,
    Figure,
    Paragraph,
    Picture,
    Row,
    Section,
    Table,
    Warnings,
    capital,
    fixed,
    short,
)
from lab.render.scene import placement_picture, skeleton

if TYPE_CHECKING:
    from lab.extensions.robotics.closed.recognition import ClassicalModel
    from lab.kinematics.closed.mechanism import Mechanism
    from lab.kinematics.model import RigidArm
    from lab.render.document import Document

__all__ = [
    "MOST_DRAWN",
    "KinematicsResult",
    "Matrices",
    "Placement",
    "PoseSolutions",
    "Reached",
    "Solution",
    "Solver",
    "Task",
    "configurations",
    "frames_of",
    "matching",
    "placements",
]


@dataclass(frozen=True)
class Matrices:
    """Link matrices and their products.

    Attributes:
        links: ``(n, 4, 4)`` T_i-1,i (m) at the first placement; none of a robot with loops.
        letters: the chain in letters, where asked for.
        between: the two frames whose product is asked for.
    """

    links: Array
    letters: SymbolicChain | None
    between: tuple[int, int] | None

    def product(self, first: int, last: int) -> Array:
        """The pose ``(4, 4)`` (m) of frame ``last`` in frame ``first``."""
        found = np.eye(4)
        for link in self.links[first:last]:
            found = found @ link
        return found

    def texts(self) -> dict[str, list[list[str]]]:
        """The matrices in letters, T_i-1,i and T_0,n and the product that is asked for; none without letters."""
        if self.letters is None:
            return {}
        size = len(self.letters.rows)
        pairs = [*((i, i + 1) for i in range(size)), (0, size)]
        if self.between is not None and self.between not in pairs:
            pairs.append(self.between)
        made = {f"T{first},{last}": self.letters.between(first, last) for first, last in pairs}
        return {name: [[textbook(matrix[i, j]) for j in range(4)] for i in range(4)] for name, matrix in made.items()}

    def letter_values(self) -> dict[str, float]:
        """Values of the letters: lengths ``<letter>_mm``, angles ``<letter>_deg``."""
        letters: dict[str, Any] = {} if self.letters is None else dict(self.letters.letters)
        lengths = {name for name in letters if name.rstrip("0123456789") in ("d", "a")}
        return {
            f"{name}_mm" if name in lengths else f"{name}_deg": tidy(value * (1e3 if name in lengths else 180 / np.pi))
            for name, value in letters.items()
        }


_ON = 1e-9  # of a factor: smaller is at the singularity itself


def configurations(determinant: Determinant, joints: Array) -> list[dict[str, str]]:
    """Return signs (+, - or 0) of all factors of det J at joint positions ``(n, joints)``, by the singularity's name.

    An arm changes such a sign only where it passes the singularity (Borrel & Liegeois 1986). A factor that is constant
    is left out.
    """
    factors = [factor for factor in determinant.factors if factor.terms]
    signs = [np.where(np.abs(value := factor.at(joints)) <= _ON, 0, np.sign(value)).astype(int) for factor in factors]
    names = [factor.name for factor in factors]
    return [dict(zip(names, ("0+-"[sign] for sign in row), strict=True)) for row in zip(*signs, strict=True)]


_SAME = 1e-6  # rad or m: solutions nearer to each other are one
_REACHED_M = 1e-6  # a pose is written to the micron, which joints that are too few for its digits may miss


@dataclass(frozen=True)
class Solution:
    """An IK solution for a pose.

    Attributes:
        joints: ``(n,)`` joint positions, rad or m.
        configuration: on which side of each singularity it is, by its name, + or - (or 0: on it); of a mechanism with
            loops the branch of each leg, by its joint.
        free: ``(n,)`` joints that may take any position, as the arm is singular there.
        tilt_rad: by how much the rotation is missed, where an arm of fewer than six joints cannot take it.
    """

    joints: Array
    configuration: Mapping[str, str]
    free: NDArray[np.bool_]
    tilt_rad: float = 0.0


@dataclass(frozen=True)
class PoseSolutions:
    """IK solutions found for one pose.

    Attributes:
        solutions: nearest to the reference first.
        gap_m: how far the pose is out of reach, of a search by how much the nearest place that it found misses it;
            zero where there is a solution, NaN where unknown.
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
    """The inverse model of a nominal robot.

    Attributes:
        values: parameters ``(p,)``, with one target.
    """

    arm: RigidArm
    values: Array

    def __call__(self, wanted: PoseTarget, reference: Array) -> list[PoseSolutions]:
        """The solutions of each pose.

        Args:
            reference: joint positions ``(n, joints)`` near which solutions are preferred, NaN where none are given.
        """
        legs = self._legs(wanted) if self.arm.chain.has_loops else None
        if legs is not None:
            return [self._by_legs(*legs, wanted.take(np.array([i])), reference[i]) for i in range(len(wanted))]
        inverse = NominalInverse(self.arm, self.values)
        found = inverse.solutions(wanted, reference)
        joints, branches = ordered(self.arm.chain, found, reference, np.zeros(found.gap_m.shape, dtype=np.bool_))
        form, closed = inverse.closed_form, inverse.exact(wanted)
        out = []
        for i, order in enumerate(branches):
            gap, tilt, free = found.gap_m[i, order], found.tilt_rad[i, order], found.free[i, order]
            retained = _different(
                joints[i],
                np.flatnonzero(gap <= (0.0 if closed[i] else _REACHED_M)),
                self.arm.chain.prismatic,
            )
            named: list[dict[str, str]] = [{} for _ in retained]
            if form is not None and retained:
                named = configurations(form.determinant, joints[i, retained])
            elif retained and self.arm.chain.size == FREEDOMS:
                signs = np.sign(np.linalg.det(self.arm.tool(joints[i, retained], self.values)[1])).astype(int)
                named = [{"det": "0+-"[sign]} for sign in signs]
            solutions = tuple(
                Solution(joints[i, k], name, free[k], float(tilt[k])) for k, name in zip(retained, named, strict=True)
            )
            exact = bool(closed[i])
            if (
                form is not None and form.exact_only and retained and tilt[retained].any()
            ):  # near to a pose that it cannot take
                exact = False
            missed = 0.0 if retained else float(gap.min(initial=np.inf))
            out.append(PoseSolutions(solutions, missed, "closed form" if exact else "search"))
        return out

    def _legs(self, wanted: PoseTarget) -> "tuple[Mechanism, ClassicalModel] | None":
        """A mechanism with the closed form that answers such poses; None where none does."""
        from lab.extensions.robotics.closed.recognition import classical_model_of
        from lab.kinematics.closed.mechanism import Mechanism

        mechanism = self.arm.chain
        course = classical_model_of(mechanism) if isinstance(mechanism, Mechanism) else None
        if course is None or not isinstance(mechanism, Mechanism) or len(course.order) != mechanism.size:
            return None  # or a joint beside those of the legs
        return (mechanism, course) if wanted.turned.all() or not _turns(mechanism) else None

    def _by_legs(
        self, mechanism: "Mechanism", classical: "ClassicalModel", wanted: PoseTarget, reference: Array
    ) -> PoseSolutions:
        """The working modes of a mechanism with a closed form, for one pose."""
        from lab.extensions.robotics.closed.recognition import passive_values_of, working_modes

        tool = self.values[-3:]
        home = self.arm.tool(mechanism.home[None], self.values)[0][0, :3, :3]
        rotation = wanted.rotations[0] if wanted.turned[0] else home
        passive, missed = passive_values_of(mechanism, se3.pose(rotation, wanted.positions[0] - rotation @ tool))
        every = working_modes(mechanism, classical, passive) if missed <= _REACHED_M else []
        rows = np.array([mode.joints for mode in every]).reshape(-1, mechanism.size)
        there = self.arm.tool(rows, self.values)[0][:, :3, 3] if every else np.empty((0, 3))
        modes = [
            mode for mode, place in zip(every, there, strict=True)
            if np.abs(place - wanted.positions[0]).max() < _REACHED_M
        ]  # fmt: skip
        near = reference if np.isfinite(reference).all() else mechanism.home
        modes.sort(key=lambda mode: float(np.abs(mode.joints - near).max()))
        none = np.zeros(mechanism.size, dtype=np.bool_)
        names, several = mechanism.joint_names, any(any(mode.branches) for mode in modes)
        branches = tuple(
            Solution(
                nearest_whole_turns(mechanism, mode.joints, near),
                {name: "+-"[way] for name, way in zip(names, mode.branches, strict=True)} if several else {},
                none,
            )
            for mode in modes
        )
        gap = 0.0 if branches else missed if missed > _REACHED_M else np.nan
        return PoseSolutions(branches, gap, "closed form", len(every) - len(modes))


def matching(found: PoseSolutions, requested: tuple[str, ...]) -> PoseSolutions:
    """The solutions of one configuration alone, e.g. ``("elbow+", "wrist-")``.

    Raises:
        LabError: no solution has a side of that name, or what is asked has no sign (the message lists those there
            are), or it is asked for with both.
    """
    known = sorted({name for each in found.solutions for name in each.configuration})
    sides: dict[str, str] = {}
    for each in requested:
        name, sign = each[:-1].strip(), each[-1:].replace("−", "-")
        if sign not in ("+", "-") or (found.solutions and name not in known):
            there = ", ".join(f"{name}+ and {name}-" for name in known) or "none: this robot's solutions have no names"
            raise LabError(f"--of {each}: no configuration is called so; there are {there}")
        if sides.setdefault(name, sign) != sign:
            raise LabError(f"--of {name}+,{name}-: a solution has one of the two; ask for one, or leave out {name}")
    kept = tuple(s for s in found.solutions if all(s.configuration.get(name) == sign for name, sign in sides.items()))
    return replace(found, solutions=kept, others=len(found.solutions) - len(kept))


def _turns(mechanism: "Mechanism") -> bool:
    """Decide whether the platform turns."""
    return any(mechanism.tree.step(*step).is_turn for step in mechanism.tree.passive)


def _different(joints: Array, rows: NDArray[np.int_], prismatic: tuple[bool, ...]) -> list[int]:
    """Return rows of joint positions ``(k, joints)`` without repetitions, up to whole turns; the first is retained."""
    retained: list[int] = []
    for row in rows.tolist():
        apart = joints[retained] - joints[row]
        apart = np.where(prismatic, apart, apart - 2 * np.pi * np.round(apart / (2 * np.pi)))
        if not (np.abs(apart).max(axis=1, initial=0.0) < _SAME).any():
            retained.append(row)
    return retained


_LEAST = 1e-9  # of a part of a self-motion: it is none


@dataclass(frozen=True)
class Placement:
    """A robot at some joint positions.

    Attributes:
        name: the row's id, or the solution's number.
        joints: ``(n,)`` rad or m.
        T_base_tool: pose ``(4, 4)`` (m) of the tool's point, turned as the last frame or the platform.
        jacobian: geometric ``(6, n)`` in the frame that was asked for: velocity of the point (m), then angular velocity
            (rad), by the joint positions.
        rank: of the Jacobian.
        manipulability: Yoshikawa's, sqrt(det J J') or sqrt(det J' J), SI.
        determinant: of the Jacobian, SI; of an arm with a closed form that of the rows that it can have; None where
            there is none.
        factors: each factor of the determinant by the name of its singularity; zero at the singularity.
        self_motions: ``(k, n)`` directions of the joints that move nothing, the largest part 1.
        lost: ``(l, 6)`` directions in which no joint moves the tool (m, rad), in the frame that was asked for.
        beyond: which limit is passed, in words; empty where none is.
        configuration: of a solution, on which side of each singularity it is.
        free: names of the joints that could stand anywhere, because the arm is singular.
        tilt_rad: by how much a wanted rotation is missed.
        rates: ``(n,)`` rad/s or m/s, given or found; None where neither rates nor a twist were asked for.
        twist: ``(6,)`` m/s and rad/s, what these rates give.
        missing: ``(6,)`` what of a wanted twist cannot be had.
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


@dataclass(frozen=True)
class Task:
    """Computations requested for each placement.

    Attributes:
        in_tool_frame: whether Jacobian and twist have the tool's axes.
        rates: ``(n,)`` given joint rates.
        twist: ``(6,)`` a wanted twist.
    """

    in_tool_frame: bool = False
    rates: Array | None = None
    twist: Array | None = None


def placements(
    arm: RigidArm,
    values: Array,
    determinant: Determinant | None,
    task: Task,
    rows: Array,
    names: Sequence[str],
    solved: Sequence[Solution] | None = None,
) -> tuple[Placement, ...]:
    """The nominal robot at each of ``rows`` ``(m, n)`` of joint positions.

    Args:
        names: of the rows.
        solved: the solutions that the rows are.
    """
    if not len(rows):
        return ()
    chain, size = arm.chain, arm.chain.size
    Ts, jacobians = arm.tool(rows, values)
    if task.in_tool_frame:
        back = Ts[:, :3, :3].swapaxes(1, 2)
        jacobians = np.concatenate([back @ jacobians[:, :3], back @ jacobians[:, 3:]], axis=1)
    wanted = np.zeros((len(rows), 6)) if task.twist is None else np.tile(task.twist, (len(rows), 1))
    closes: NDArray[np.bool_] = np.array(np.isfinite(jacobians).all(axis=(1, 2)))
    moved = rates(np.where(closes[:, None, None], jacobians, 0.0), wanted)
    width = np.where(closes, manipulability(np.where(closes[:, None, None], jacobians, 0.0)), np.nan)
    out = []
    for i, (joints, name) in enumerate(zip(rows, names, strict=True)):
        way = None if solved is None else solved[i]
        factors = {} if determinant is None else {f.name: float(f.at(joints)) for f in determinant.factors if f.terms}
        size_of = None if determinant is None else float(determinant.at(joints))
        if determinant is None and size == FREEDOMS:
            size_of = float(np.linalg.det(jacobians[i]))
        given = task.rates if task.rates is not None else moved.joints[i] if task.twist is not None else None
        rank = int(moved.rank[i])
        self_motions = moved.free[i, : size - rank]
        out.append(
            Placement(
                name, joints, Ts[i], jacobians[i], rank, float(width[i]), size_of, factors,
                _largest_one(self_motions), moved.lost[i, : 6 - rank], _beyond(arm, joints, bool(closes[i])),
                {} if way is None else way.configuration, () if way is None else _names(chain, way.free),
                0.0 if way is None else way.tilt_rad, given, None if given is None else jacobians[i] @ given,
                None if task.twist is None else moved.missing[i],
            )
        )  # fmt: skip
    return tuple(out)


def _largest_one(rows: Array) -> Array:
    """Rows scaled so that the largest part is 1, without what rounding left."""
    scaled = rows / np.abs(rows).max(axis=1, keepdims=True, initial=1e-300) if len(rows) else rows
    return np.asarray(np.where(np.abs(scaled) < _LEAST, 0.0, scaled))


def _names(chain: JointSpec, chosen: NDArray[np.bool_]) -> tuple[str, ...]:
    return tuple(name for name, each in zip(chain.joint_names, chosen, strict=True) if each)


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
        gap_m: how far it is out of reach, of a search by how much the nearest place that it found misses it; NaN where
            that is not known.
        how: ``closed form``, whose solutions are all, or ``search``.
        reassembled: number of further solutions in another assembly mode of a mechanism with loops.
        others: number of further solutions in configurations not requested.
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
        """Describe the distance to the pose reached; empty where it has solutions or that is unknown."""
        if self.solutions or not self.gap_m or not np.isfinite(self.gap_m):
            return ""
        gap = MM.text(self.gap_m, 6)
        return f"it is {gap} out of reach" if self.how == "closed form" else f"the nearest place found is {gap} away"


@dataclass(frozen=True, repr=False, eq=False)
class KinematicsResult(Result):
    """A robot at some joint positions, or in all solutions of some poses, with its models there.

    Attributes:
        options: what was asked.
        placements: the robot at each row of joint positions, or in each solution.
        reached: what came of each pose that was to be reached; empty where joint positions were given.
        assembly_modes: ``(m, 4, 4)`` every pose (m) that the platform of a mechanism with a closed form can have at the
            first joint positions; empty where it has none.
        matrices: the link matrices and their products at the first placement.
    """

    command = "kinematics"
    shown_by = "lab.extensions.robotics.kinematics.result:_kinematics_document"
    drawn_by = "lab.extensions.robotics.kinematics.result:_main_picture"
    recorded_by = "lab.extensions.robotics.kinematics.recording:record_kinematics"

    options: KinematicsOptions
    robot: NominalRobot
    placements: tuple[Placement, ...]
    reached: tuple[Reached, ...]
    assembly_modes: Array
    matrices: Matrices
    warnings: tuple[str, ...]

    @property
    def model_sha256(self) -> str:
        """Digest of the robot's description."""
        return self.robot.sha256

    @property
    def exit_code(self) -> int:
        """1 where a pose has no solution, or the robot cannot stand at given joint positions; else 0."""
        stands = all(np.isfinite(each.T_base_tool).all() for each in self.placements)
        return 0 if stands and all(each.solutions for each in self.reached) else 1

    def to_dict(self) -> dict[str, Any]:
        """Return the output of ``--json``: mm and degrees; Jacobians, determinants, manipulabilities in m and rad."""
        chain, options, matrices = self.robot.chain, self.options, self.matrices
        values: dict[str, Any] = {
            "robot": self.robot.name,
            "joints": list(chain.joint_names),
            "units": ["mm" if slides else "deg" for slides in chain.prismatic],
            "frame": options.frame,
            "tool_mm": [tidy(each) for each in MM.of(options.tool_m)],
            "placements": [self._placement(each) for each in self.placements],
            "poses": [_reached(each) for each in self.reached],
            "assembly_modes": [_pose_values(T) for T in self.assembly_modes],
            "warnings": list(self.warnings),
        }
        if options.matrices:
            values["link_matrices"] = [_matrix_values(T) for T in matrices.links]
            values["products"] = [_matrix_values(matrices.product(0, i + 1)) for i in range(len(matrices.links))]
        if options.between is not None:
            values["between"] = _matrix_values(matrices.product(*options.between))
        if options.symbolic:
            values["symbolic"] = {"letters": matrices.letter_values(), **matrices.texts()}
        return values

    def write_files(self, folder: Path) -> None:
        """Write ``joints.csv``."""
        write_columns(folder / "joints.csv", self.columns())

    def columns(self) -> Mapping[str, Sequence[Any] | Array]:
        """A row for each placement: its name, joint positions and the tool's pose, mm and degrees."""
        chain = self.robot.chain
        table: dict[str, Sequence[Any] | Array] = {"id": [each.name for each in self.placements]}
        table |= joint_columns(chain, np.array([each.joints for each in self.placements]).reshape(-1, chain.size))
        Ts = np.array([each.T_base_tool for each in self.placements]).reshape(-1, 4, 4)
        for i, axis in enumerate("xyz"):
            table[f"{axis}_mm"] = MM.of(Ts[:, i, 3])
        quaternions = se3.quaternion_from_rotation(Ts[:, :3, :3])
        for i, part in enumerate("wxyz"):
            table[f"q{part}"] = quaternions[:, i]
        return table

    def _placement(self, each: Placement) -> dict[str, Any]:
        chain = self.robot.chain
        names = chain.joint_names
        rates = None if each.rates is None else [number(v) for v in joint_values(chain.prismatic, each.rates)]
        return {
            "id": each.name,
            "joints": [tidy(value) for value in joint_values(chain.prismatic, each.joints)],
            **_pose_values(each.T_base_tool),
            "within_limits": not each.beyond,
            "beyond": each.beyond,
            "configuration": dict(each.configuration),
            "free": list(each.free),
            "tilt_deg": number(np.rad2deg(each.tilt_rad)),
            "jacobian": [[number(value) for value in row] for row in each.jacobian],
            "rank": each.rank,
            "manipulability": number(each.manipulability),
            "determinant": None if each.determinant is None else number(each.determinant),
            "factors": {name: number(value) for name, value in each.factors.items()},
            "self_motions": [
                {name: tidy(part) for name, part in zip(names, row, strict=True) if part} for row in each.self_motions
            ],
            "lost_directions": [[tidy(part) for part in row] for row in each.lost],
            "rates": rates,
            "twist": None if each.twist is None else _twist_values(each.twist),
            "missing": None if each.missing is None else _twist_values(each.missing),
        }


def _pose_values(T: Array) -> dict[str, Any]:
    """A pose ``(4, 4)`` as position in mm, rotation, fixed angles about x, y and z in degrees, and quaternion."""
    if not np.isfinite(T).all():
        return {"position_mm": None, "rotation": None, "fixed_xyz_deg": None, "quaternion": None}
    return {
        "position_mm": [tidy(each) for each in MM.of(T[:3, 3])],
        "rotation": [[tidy(each) for each in row] for row in T[:3, :3]],
        "fixed_xyz_deg": [tidy(each) for each in np.rad2deg(se3.roll_pitch_yaw(T[:3, :3]))],
        "quaternion": [tidy(each) for each in se3.quaternion_from_rotation(T[:3, :3])],
    }


def _matrix_values(T: Array) -> list[list[float]]:
    """A pose ``(4, 4)`` as rows, its position in mm."""
    scaled = T.copy()
    scaled[:3, 3] *= 1e3
    return [[tidy(each) for each in row] for row in scaled]


def _twist_values(twist: Array) -> list[float | None]:
    """mm/s and degrees/s."""
    return [number(tidy(each)) for each in twist * np.repeat([1e3, 180 / np.pi], 3)]


def _reached(each: Reached) -> dict[str, Any]:
    turned = np.isfinite(each.rotation).all()
    return {
        "id": each.name,
        "position_mm": [tidy(value) for value in MM.of(each.position)],
        "rotation": [[tidy(value) for value in row] for row in each.rotation] if turned else None,
        "solutions": len(each.solutions),
        "placements": list(each.solutions),
        "out_of_reach_mm": number(MM.of(each.gap_m)),
        "by": each.how,
        "in_other_assembly_modes": each.reassembled,
        "in_other_configurations": each.others,
    }


MOST_DRAWN = 12  # placements in a page's figure
_SHORT_ENTRY = 14  # characters, of which four stand side by side on a terminal and on a phone
_NOTHING = 1e-15  # of a determinant (SI): it is zero
MOST_ROWS = 50  # of a table of placements
_POSE = ("x, mm", "y", "z", "rx, °", "ry", "rz")
_TWIST = ("vx", "vy", "vz", "ωx", "ωy", "ωz")


def _main_picture(result: KinematicsResult) -> Picture:
    """Return the robot in its first placement, with its frames."""
    return _placement_pictures(result)[0]


def _kinematics_document(result: KinematicsResult) -> Document:
    """Poses or solutions, then the models at the first of them, then matrices where asked for."""
    first = next(iter(result.placements), None)
    at = "" if len(result.placements) < 2 else f" at {first.name}" if first is not None else ""
    return Document(
        _title(result),
        (
            Warnings(result.warnings),
            Section("Solutions" if result.reached else "Poses", (*_reached_blocks(result), *_placements(result))),
            Section("Assembly modes", _modes(result)),
            Section(f"Differential model{at}", () if first is None else _differential(result, first)),
            Section(f"Link matrices{at}", _matrices(result)),
            Section("Matrices in letters", _letters(result)),
            Section("Placements", (_figure(result),)),
        ),
    )


def _configuration_text(configuration: Mapping[str, str]) -> str:
    """A configuration as ``elbow +, wrist −``."""
    return ", ".join(f"{name} {sign.replace('-', '−')}" for name, sign in configuration.items())


def _placement_pictures(result: KinematicsResult) -> tuple[Picture, ...]:
    """The robot with its frames in each of the first placements, all to one scale."""
    shown = [each for each in result.placements if np.isfinite(each.T_base_tool).all()][:MOST_DRAWN]
    if not shown:
        return ()
    arm = result.robot.arm(("p1",))
    values = arm.nominal({"p1": result.options.tool_m})
    rows = np.array([each.joints for each in shown])
    lines, frames = skeleton(arm, values, rows).lines, frames_of(arm, values, rows)
    Ts = np.array([each.T_base_tool for each in shown])[:, None]
    frames = np.concatenate([frames, Ts], axis=1)
    titles = [
        f"{each.name}: {_configuration_text(each.configuration)}" if each.configuration else each.name for each in shown
    ]
    return tuple(placement_picture(i, titles[i], lines, frames) for i in range(len(shown)))


def frames_of(arm: "RigidArm", values: Array, joints: Array) -> Array:
    """Poses ``(n, f, 4, 4)`` (m) of the frames to draw in the base: of a serial arm those of its table."""
    base = np.tile(np.eye(4), (len(joints), 1, 1))
    if not isinstance(arm, SerialArm):
        return base[:, None]
    sizes = range(1, arm.chain.size + 1)
    return np.stack([base, *(arm.frame(joints, values, size) for size in sizes)], axis=1)


def _title(result: KinematicsResult) -> str:
    count = len(result.placements)
    if len(result.reached) == 1:
        return f"{result.robot.name}: {counted(count, 'solution')} of the pose"
    if result.reached:
        return f"{result.robot.name}: {counted(count, 'solution')} of {len(result.reached)} poses"
    return f"{result.robot.name}: {counted(count, 'pose')} by the direct model"


def _reached_blocks(result: KinematicsResult) -> tuple[Block, ...]:
    """Report the number of solutions of each pose, and the method that found them."""
    lines = []
    for each in result.reached:
        at = ", ".join(fixed(MM.of(value), 3) for value in each.position)
        turned = "" if np.isfinite(each.rotation).all() else ", the orientation is free"
        missed = f"; {each.away}" if each.away else ""
        none = "there are no others" if each.solutions else "there is none"
        others = f"{each.others} more in other configurations" if each.others else none
        more = "there may be others" if each.solutions else "there may be some"
        how = f"in closed form: {others}" if each.how == "closed form" else f"by search: {more}"
        name = f"{each.name}: " if each.name else ""
        modes = f"; {each.reassembled} more in another assembly mode" if each.reassembled else ""
        lines.append(f"{name}({at}) mm{turned}: {counted(len(each.solutions), 'solution')} {how}{modes}{missed}")
    return (Bullets(tuple(lines[:MOST_ROWS])),)


def _placements(result: KinematicsResult) -> tuple[Block, ...]:
    """Joint positions, and beside them the pose of the tool's point, or the configuration of each solution."""
    chain, placed = result.robot.chain, result.placements
    pairs = zip(chain.joint_names, chain.prismatic, strict=True)
    names = tuple(f"{name}, {'mm' if slides else '°'}" for name, slides in pairs)
    joints = tuple(
        (each.name, *(fixed(value, 3) for value in joint_values(chain.prismatic, each.joints))) for each in placed
    )
    numbers = _numbers(result.options.tool_mm)
    point = f"({numbers}) mm in its frame" if numbers else "its frame's origin"
    caption = f"The tool is the {'platform' if chain.has_loops else 'last frame'}; its point is {point}."
    poses = tuple((each.name, *_pose_cells(each.T_base_tool)) for each in placed)
    told = tuple((each.name, _configuration_text(each.configuration), _note(each)) for each in placed)
    blocks: list[Block] = [Table(("", *names), joints, "Joint positions", most_rows=MOST_ROWS, rest_in="--json")]
    if not result.reached:
        blocks.append(Table(("", *_POSE), poses, caption, most_rows=MOST_ROWS, rest_in="--json"))
    elif any(configuration or note for _, configuration, note in told):
        blocks.append(_table_of_configurations(told))
    return tuple(blocks)


def _table_of_configurations(told: Sequence[tuple[str, str, str]]) -> Table:
    """Name, configuration and remark of each solution, without a column that is empty in all."""
    heads = ("", "configuration", "remark")
    kept = [i for i in range(len(heads)) if i == 0 or any(row[i] for row in told)]
    rows = tuple(tuple(row[i] for i in kept) for row in told)
    return Table(tuple(heads[i] for i in kept), rows, "", most_rows=MOST_ROWS, rest_in="--json")


def _pose_cells(T: Array) -> tuple[str, ...]:
    values = _pose_values(T)
    if values["position_mm"] is None:
        return ("–",) * 6
    return tuple(fixed(value, 3) for value in (*values["position_mm"], *values["fixed_xyz_deg"]))


def _note(each: Placement) -> str:
    free = f"singular: {' and '.join(each.free)} may have any position" if each.free else ""
    return "; ".join(part for part in (each.beyond, free) if part)


def _modes(result: KinematicsResult) -> tuple[Block, ...]:
    """List the platform's assembly modes at the first joint positions."""
    rows = tuple((str(i + 1), *_pose_cells(T)) for i, T in enumerate(result.assembly_modes))
    caption = "Every pose of the tool's point at the first joint positions, in closed form; limits aside."
    return (Table(("", *_POSE), rows, caption),)


def _differential(result: KinematicsResult, first: Placement) -> tuple[Block, ...]:
    """The Jacobian, its determinant, and what is singular; rates and twist where asked for."""
    if not np.isfinite(first.jacobian).all():
        return ()
    names, axes = result.robot.chain.joint_names, "the base" if result.options.frame == "base" else "the tool"
    table = Table(
        ("", *names),
        tuple(
            (name, *(fixed(value, 4) for value in row))
            for name, row in zip(_TWIST, _clean(first.jacobian), strict=True)
        ),
        f"Jacobian in the axes of {axes}, m and rad: velocity of the tool's point, then angular velocity",
    )
    width = f"manipulability {_size(first.manipulability)}"
    size = "" if first.determinant is None else f", determinant{_part_of(len(names))} {_size(first.determinant)}"
    factors = "; ".join(f"{name} factor {_size(value)}" for name, value in first.factors.items())
    text = f"rank {first.rank} of {min(6, len(names))}, {width}{size}{f' ({factors})' if factors else ''} (m, rad)"
    free = [f"self-motion: {_parts(names, row)}" for row in first.self_motions]
    lost = (
        [f"no joint moves the tool along {_parts(_TWIST, row / np.abs(row).max())}" for row in first.lost]
        if len(names) >= 6
        else []
    )
    return (table, Paragraph(capital(text)), Bullets((*free, *lost)), *_rates(result, first))


def _part_of(joints: int) -> str:
    """Describe the part of the Jacobian whose determinant is reported, where it is not the whole."""
    return " of the rows by which the closed form solves the pose" if joints < len(_TWIST) else ""


def _rates(result: KinematicsResult, first: Placement) -> tuple[Block, ...]:
    """Rates, and the twist that they give; what of a wanted twist cannot be had."""
    if first.rates is None or first.twist is None:
        return ()
    chain = result.robot.chain
    names = zip(chain.joint_names, chain.prismatic, strict=True)
    units = tuple(f"{name}, {'mm' if slides else '°'}/s" for name, slides in names)
    scale = np.repeat([1e3, 180 / np.pi], 3)
    heads = tuple(f"{name}, {'mm' if i < 3 else '°'}/s" for i, name in enumerate(_TWIST))
    rows: list[Row] = [("twist", *(fixed(value, 3) for value in _clean(scale * first.twist)))]
    if first.missing is not None and np.abs(first.missing).max() > 0:
        rows.append(("cannot be had", *(fixed(value, 3) for value in _clean(scale * first.missing))))
    joints = tuple(fixed(value, 3) for value in _clean(joint_values(chain.prismatic, first.rates)))
    return Table(("", *units), (("rates", *joints),)), Table(("", *heads), tuple(rows))


def _matrices(result: KinematicsResult) -> tuple[Block, ...]:
    """T_i-1,i and T_0,i, and what ``--between`` names, with positions in mm."""
    options, matrices, tables = result.options, result.matrices, []
    if options.matrices:
        tables += [_matrix(f"T{i},{i + 1}", T) for i, T in enumerate(matrices.links)]
        tables += [_matrix(f"T0,{i + 1}", matrices.product(0, i + 1)) for i in range(1, len(matrices.links))]
    if options.between is not None:
        first, last = options.between
        tables.append(_matrix(f"T{first},{last}", matrices.product(first, last)))
    return tuple(tables)


def _matrix(name: str, T: Array) -> Table:
    scale = np.where(np.arange(4) == 3, 1e3, 1.0)
    rows = [[fixed(value, 6 if j < 3 else 3) for j, value in enumerate(row)] for row in _clean(T[:3] * scale)]
    return Table(("", "", "", ""), tuple(tuple(row) for row in (*rows, ["0", "0", "0", "1"])), f"{name}, mm")


def _letters(result: KinematicsResult) -> tuple[Block, ...]:
    """Show each matrix, and the meaning of its letters."""
    matrices = result.matrices.texts()
    if not matrices:
        return ()
    letters = ", ".join(
        f"{name.rpartition('_')[0]} = {value:.6g} {'mm' if name.endswith('mm') else '°'}".replace("-", "−")
        for name, value in result.matrices.letter_values().items()
    )
    names = ", ".join(
        f"q{i + 1} is {name}" for i, name in enumerate(result.robot.chain.joint_names) if name != f"q{i + 1}"
    )
    text = f"Here c1 is cos q1, s23 is sin(q2 + q3){f'; {names}' if names else ''}"
    return (
        Paragraph(f"{text}. {letters}." if letters else f"{text}."),
        *(_matrix_in_letters(name, rows) for name, rows in matrices.items()),
    )


def _matrix_in_letters(name: str, rows: Sequence[Sequence[str]]) -> Table:
    """A matrix as it is written; one with long entries as a list of these."""
    if max(len(entry) for row in rows for entry in row) <= _SHORT_ENTRY:
        return Table(("", "", "", ""), tuple(tuple(row) for row in rows), name)
    entries = tuple((f"{name}({i + 1},{j + 1})", rows[i][j]) for i in range(3) for j in range(4))
    return Table(("", ""), entries, name)


def _figure(result: KinematicsResult) -> Figure:
    more = f" The first {MOST_DRAWN} are drawn." if len(result.placements) > MOST_DRAWN else ""
    caption = f"The robot as lines with its frames (x red, y green, z blue), seen from above at an angle.{more}"
    return Figure("placements", _placement_pictures(result), caption)


def _size(value: float) -> str:
    """Format a product that rounding may keep from being zero."""
    return short(0.0 if abs(value) < _NOTHING else value)


def _parts(names: Sequence[str], row: Array) -> str:
    """The parts of a direction that are not zero."""
    return " ".join(
        f"{value:+.4g} {name}" for name, value in zip(names, row, strict=True) if abs(value) > 1e-9
    ).replace("-", "−")


def _numbers(values: Sequence[float]) -> str:
    return ", ".join(f"{value:g}".replace("-", "−") for value in values)


def _clean(values: Array) -> Array:
    """Without what rounding left, and without minus zero."""
    return np.where(np.abs(values) < 1e-12 * max(1.0, float(np.abs(values).max(initial=0.0))), 0.0, values)
