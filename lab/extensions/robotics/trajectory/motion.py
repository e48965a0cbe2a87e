"""Plan a motion through the points of a CSV file: a sequence of joint moves, lines and circles.

The file has one row per point, by joint positions or by a position of the tool. The column ``move`` gives how the point
is reached: ``joint`` (where it is empty or missing), ``line``, or ``circle`` through the point of the row above it,
whose move is ``via``. A point that is passed without a stop has a velocity: ``vx_mm_per_s``, ``vy_mm_per_s``,
``vz_mm_per_s`` of the tool, or ``speed_<joint>_deg_per_s`` (``_mm_per_s``).
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from lab.core import se3
from lab.core.errors import LabError, error_context
from lab.core.limits import PASSED
from lab.core.orientation import AngleConvention
from lab.core.se3 import Array
from lab.core.units import MM, joints_to_si
from lab.extensions.robotics.kinematics.nominal_models import Solver
from lab.extensions.robotics.trajectory.cartesian import CartesianPath, PathMove, arc, line, path_move
from lab.extensions.robotics.trajectory.trajectory_options import TrajectoryOptions
from lab.formats.csv_table import CsvTable
from lab.formats.measurement_csv import ObservedColumns, read_measurements
from lab.formats.target_csv import holds_targets, read_targets
from lab.kinematics.differential import rates
from lab.kinematics.inverse.newton_inverse import PoseTarget
from lab.kinematics.joints import JointSpec
from lab.kinematics.model import RigidArm
from lab.kinematics.trajectory.profiles import Trajectory
from lab.kinematics.trajectory.trajectory import (
    blended,
    common_phases,
    independent,
    own_phases,
    through,
    unsynchronised,
)

__all__ = ["Leg", "Motion", "planned", "read_path"]

_Move = Trajectory | PathMove
_MOVES = ("joint", "line", "via", "circle")
_VELOCITY = ("vx_mm_per_s", "vy_mm_per_s", "vz_mm_per_s")
_LAWS = {"common": common_phases, "own": own_phases, "independent": independent}
_MISSING_M = 1e-6  # m/s or rad/s: largest part of a velocity at a point that the joints may miss


@dataclass(frozen=True)
class _PathRows:
    """Points of a motion, from a file.

    Attributes:
        ids: of the rows.
        moves: how each point is reached; the motion starts at the first one.
        joints: ``(n, joints)`` rad or m; NaN where the point is given by the tool's position.
        positions: ``(n, 3)`` m, NaN where the point is given by joint positions.
        rotations: ``(n, 3, 3)``, NaN where the orientation is not given.
        velocities: ``(n, 3)`` m/s of the tool there, zero where it stops.
        speeds: ``(n, joints)`` rad/s or m/s of the joints there, zero where they stop.
        warnings: for the user.
    """

    ids: tuple[str, ...]
    moves: tuple[str, ...]
    joints: Array
    positions: Array
    rotations: Array
    velocities: Array
    speeds: Array
    warnings: tuple[str, ...]

    def __len__(self) -> int:
        return len(self.ids)


def read_path(
    path: Path, joint_names: Sequence[str], prismatic: Sequence[bool], meaning: AngleConvention | None = None
) -> _PathRows:
    """Read the points of a motion.

    Args:
        path: of the file.
        joint_names: the robot's; the file may call them q1 ... qn.
        prismatic: which of them slide.
        meaning: of three angles (``lab.core.se3``).

    Raises:
        LabError: with the file, and where there is one the line and the column.
    """
    texts, size = CsvTable(path, PASSED).texts("move"), len(joint_names)
    units = ["mm" if slides else "deg" for slides in prismatic]
    speeds = [f"speed_{name}_{unit}_per_s" for name, unit in zip(joint_names, units, strict=True)]
    columns = ObservedColumns(orientations=True, numbers=(*_VELOCITY, *speeds), texts=("move",))
    if holds_targets(path):
        targets = read_targets(path, joint_names, prismatic, meaning, columns)
        ids, rates, lines, warnings = targets.ids, targets.conditions, targets.lines, targets.warnings
        positions, rotations, joints = targets.positions, targets.rotations, targets.joints
    else:
        rows = read_measurements(path, joint_names, prismatic, points=False, columns=columns)
        ids, rates, lines, warnings = rows.ids, rows.conditions, rows.lines, rows.warnings
        positions, rotations, joints = np.full((len(ids), 3), np.nan), np.full((len(ids), 3, 3), np.nan), rows.joints
    moves = _moves_in(path, texts, lines)
    _refuse_half_circles(path, moves, lines)
    if len(ids) < 2:
        raise LabError(f"{path}: {len(ids)} point; give two or more, the first being where the motion starts")
    by_joint = np.stack([_column(rates, name, len(ids)) for name in speeds], axis=1).reshape(-1, size)
    return _PathRows(
        ids, moves, joints, positions, rotations,
        1e-3 * np.stack([_column(rates, name, len(ids)) for name in _VELOCITY], axis=1),
        joints_to_si(by_joint, prismatic), warnings,
    )  # fmt: skip


def _moves_in(path: Path, texts: Sequence[str] | None, lines: Sequence[int]) -> tuple[str, ...]:
    """Return the kind of move to each point, by default of the joints."""
    table = CsvTable(path)
    row_of = {number: i for i, number in enumerate(table.lines)}
    moves = tuple((texts[row_of[number]] if texts else "") or "joint" for number in lines)
    for number, move in zip(lines, moves, strict=True):
        if move not in _MOVES:
            raise table.fail(row_of[number], "move", f"'{move}' is unknown; write one of {', '.join(_MOVES)}")
    return moves


def _refuse_half_circles(path: Path, moves: Sequence[str], lines: Sequence[int]) -> None:
    """Refuse a via without its circle in the row below, or a circle without its via in the row above."""
    for above, move, number in zip(("", *moves[:-1]), moves, lines, strict=True):
        if (move == "circle") != (above == "via"):
            raise LabError(
                f"{path}: line {number}, column move: a circle is two rows, via and below it circle; give both"
            )
    if moves and (moves[-1] == "via" or moves[0] in ("via", "circle")):
        raise LabError(f"{path}: a circle starts where the row above it ends: give its start, via and circle")


def _column(given: Mapping[str, Array], name: str, count: int) -> Array:
    """Return a column's numbers ``(n,)``; zero where it is empty or missing."""
    return np.nan_to_num(given[name]) if name in given else np.zeros(count)


@dataclass(frozen=True)
class Motion:
    """Moves one after the other, each of which starts at the end of the one before it."""

    moves: Sequence[_Move]

    @cached_property
    def starts(self) -> Array:
        """Start time of each move, and the end of the last one, ``(m + 1,)`` s."""
        return np.append(0.0, np.cumsum([move.seconds for move in self.moves]))

    @property
    def seconds(self) -> float:
        """Total duration, s."""
        return float(self.starts[-1])

    @cached_property
    def peaks(self) -> tuple[Array, Array]:
        """Largest magnitudes ``(n,)`` of the joints' speeds and accelerations."""
        speeds, accelerations = zip(*(move.peaks for move in self.moves), strict=True)
        return np.max(speeds, axis=0), np.max(accelerations, axis=0)

    def times(self, step_s: float) -> Array:
        """Return times ``(k,)`` from 0 to the end, a step apart, with the end itself."""
        whole = np.arange(0.0, self.seconds, step_s)
        return np.append(whole[self.seconds - whole > 1e-9], self.seconds)

    def at(self, times: Array) -> tuple[Array, Array, Array]:
        """Return joint positions, speeds and accelerations ``(k, n)`` at times ``(k,)`` since the start."""
        which, size = self._which(times), len(self.moves[0].end)
        out = np.empty((len(times), size)), np.empty((len(times), size)), np.empty((len(times), size))
        for i, move in enumerate(self.moves):
            rows = np.flatnonzero(which == i)
            if rows.size:
                for whole, part in zip(out, move.at(times[rows] - self.starts[i]), strict=True):
                    whole[rows] = part
        return out

    def _which(self, times: Array) -> NDArray[np.int_]:
        """Return the number ``(k,)`` of the move at each time."""
        return np.clip(np.searchsorted(self.starts, times, side="right") - 1, 0, len(self.moves) - 1)


@dataclass(frozen=True)
class Leg:
    """A part of a motion.

    Attributes:
        kind: how the tool or the joints move.
        points: ids of the points from its start to its end.
        waypoints: ``(k, n)`` joint positions at these points, also where the motion passes them at a distance.
        move: how it moves.
        length_m, turn_rad: of the tool's path; NaN of joint moves.
        speed_m_s: largest speed of the tool; NaN of joint moves.
    """

    kind: Literal["joint", "line", "circle"]
    points: tuple[str, ...]
    waypoints: Array
    move: _Move
    length_m: float = float("nan")
    turn_rad: float = float("nan")
    speed_m_s: float = float("nan")

    def unsynchronised(self, chain: JointSpec) -> Array | None:
        """Return the phases ``(n, 3)`` s of each joint alone, before they are synchronised; None but of single moves.

        Args:
            chain: the joints, with their speeds and accelerations.
        """
        if not isinstance(self.move, Trajectory) or len(self.waypoints) > 2:
            return None
        start, end = self.waypoints
        return unsynchronised(chain, start, end, self.move.start_speed, self.move.end_speed)


def planned(options: TrajectoryOptions, arm: RigidArm, values: Array, chain: JointSpec, rows: _PathRows) -> list[Leg]:
    """Plan the motion through all points.

    Args:
        chain: the joints, with their speeds and accelerations.

    Raises:
        LabError: a point cannot be reached or passed; the message names it and the file.
    """
    planner = _Planner(options, arm, values, chain, rows)
    with error_context(options.points):
        start = planner.joints_of(0, np.full(chain.size, np.nan))
        planner.at(0, start)
        i = 1
        while i < len(rows):
            i = planner.joint_leg(i) if rows.moves[i] == "joint" else planner.path_leg(i)
    return planner.legs


@dataclass
class _Planner:
    """Plans the motion from point to point; ``here`` are the current joint positions ``(n,)``."""

    options: TrajectoryOptions
    arm: RigidArm
    values: Array
    chain: JointSpec
    rows: _PathRows
    legs: list[Leg] = field(default_factory=list)

    def at(self, i: int, joints: Array) -> None:
        self.here, self.point = joints, self.rows.ids[i]

    def joints_of(self, i: int, near: Array) -> Array:
        """Return joint positions ``(n,)`` of a point, in the configuration nearest to given ones.

        Raises:
            LabError: there are none, or they are beyond the limits.
        """
        joints, name = self.rows.joints[i], self.rows.ids[i]
        if not np.isnan(self.rows.positions[i]).any():
            wanted = PoseTarget(self.rows.positions[i : i + 1], self.rows.rotations[i : i + 1])
            reference = joints if np.isfinite(joints).all() else near
            found = Solver(self.arm, self.values)(wanted, reference[None])[0]
            if not found.solutions:
                far = "" if np.isnan(found.gap_m) else f" by {MM.text(found.gap_m, 4)}"
                raise LabError(f"point {name} is out of reach{far}; move it")
            joints = found.solutions[0].joints
        excess = self.chain.excess(joints)
        if excess.max() > 1e-9:
            j = int(np.argmax(excess))
            raise LabError(f"point {name}: {self.chain.limit_note(j, joints[j])}; move it within them")
        return np.asarray(joints)

    def joint_leg(self, i: int) -> int:
        """Add joint moves from point ``i - 1`` on, as many as follow each other; return the next point's row."""
        last = i
        while last < len(self.rows) and self.rows.moves[last] == "joint":
            last += 1
        points, ids = [self.here], [self.point]
        for row in range(i, last):
            points.append(self.joints_of(row, points[-1]))
            ids.append(self.rows.ids[row])
        speeds = np.array([self._speeds(row, joints) for row, joints in zip(range(i - 1, last), points, strict=True)])
        self._add(points, ids, speeds)
        self.at(last - 1, points[-1])
        return last

    def _add(self, points: Sequence[Array], ids: Sequence[str], speeds: Array) -> None:
        allowed, law = self.options.blend(self.chain), _LAWS[self.options.law]
        waypoints = np.array(points)
        if allowed is not None and len(points) > 2:
            if speeds.any():
                raise LabError("points with a velocity are passed exactly; leave out --blend-deg and --blend-mm")
            self.legs.append(Leg("joint", tuple(ids), waypoints, blended(self.chain, waypoints, allowed)))
            return
        for k in range(len(points) - 1):
            move = through(self.chain, waypoints[k : k + 2], speeds[k : k + 2], law)
            self.legs.append(Leg("joint", tuple(ids[k : k + 2]), waypoints[k : k + 2], move))

    def _speeds(self, row: int, joints: Array) -> Array:
        """Return speeds ``(n,)`` of the joints at a point, from the file or from the tool's velocity there."""
        speeds, velocity = self.rows.speeds[row], self.rows.velocities[row]
        if not velocity.any():
            return np.asarray(speeds)
        name = self.rows.ids[row]
        if speeds.any():
            raise LabError(f"point {name} has a velocity of the tool and speeds of the joints; give one")
        jacobian = self.arm.tool(joints[None], self.values)[1]
        if self.chain.size < 6:  # its rotation follows
            jacobian = np.concatenate([jacobian[:, :3], np.zeros_like(jacobian[:, 3:])], axis=1)
        found = rates(jacobian, np.concatenate([velocity, np.zeros(3)])[None])
        if np.abs(found.missing).max() > _MISSING_M:
            raise LabError(f"point {name}: the arm cannot have that velocity there, where it is singular; mend it")
        return np.asarray(found.joints[0])

    def path_leg(self, i: int) -> int:
        """Add a line or a circle from the last point; return the next point's row."""
        circle = self.rows.moves[i] == "via"
        end = i + 1 if circle else i
        T_start = self.arm.tool(self.here[None], self.values)[0][0]
        path = self._arc(T_start, i) if circle else line(T_start, self._pose(end, T_start))
        ids = (self.point, *self.rows.ids[i : end + 1])
        if any(self.rows.velocities[row].any() or self.rows.speeds[row].any() for row in range(i - 1, end + 1)):
            raise LabError(f"point {ids[-1]}: lines and circles start and end at rest; leave out the velocities there")
        with error_context(f"the {'circle' if circle else 'line'} to point {ids[-1]}"):
            move = path_move(self.arm, self.values, self.chain, path, self.here, self.options.feed)
        places = np.array([0.0, path.place_of(self._pose(i, T_start)[:3, 3]), 1.0] if circle else [0.0, 1.0])
        speed = path.length_m * float(move.pace.peaks[0][0])
        kind: Literal["line", "circle"] = "circle" if circle else "line"
        self.legs.append(Leg(kind, ids, move.joints_at(places), move, path.length_m, path.turn_rad, speed))
        self.at(end, move.end)
        return end + 1

    def _arc(self, T_start: Array, i: int) -> CartesianPath:
        via = self._pose(i, T_start)[:3, 3]
        with error_context(f"the circle to point {self.rows.ids[i + 1]}"):
            return arc(T_start, via, self._pose(i + 1, T_start))

    def _pose(self, i: int, T_before: Array) -> Array:
        """Return the pose ``(4, 4)`` of a point; without an orientation of its own it keeps the one before."""
        if np.isnan(self.rows.positions[i]).any():
            return np.asarray(self.arm.tool(self.rows.joints[i : i + 1], self.values)[0][0])
        rotation = self.rows.rotations[i]
        return se3.pose(rotation if np.isfinite(rotation).all() else T_before[:3, :3], self.rows.positions[i])
