"""From the points of a file to a motion: which joint positions each has, and how the robot gets there.

Moves of several kinds one after the other: phases of the joints, and paths of the tool.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Literal, Protocol

import numpy as np
from numpy.typing import NDArray

from lab.core import se3
from lab.core.errors import LabError, error_context
from lab.core.se3 import Array
from lab.extensions.robotics.kinematics.solutions import Solver
from lab.extensions.robotics.trajectory.cartesian import CartesianPath, arc, line, path_move
from lab.extensions.robotics.trajectory.options import TrajectoryOptions
from lab.extensions.robotics.trajectory.path_csv import PathRows
from lab.kinematics.differential import rates
from lab.kinematics.inverse.newton import PoseTarget
from lab.kinematics.joints import JointSpec
from lab.kinematics.model import RigidArm
from lab.kinematics.trajectory.trajectory import blended, common_phases, independent, own_phases, through

__all__ = ["Leg", "Motion", "Move", "planned"]


class Move(Protocol):
    """A part of a motion: ``Trajectory`` and ``PathMove`` are such."""

    @property
    def seconds(self) -> float:
        """How long it takes."""

    @property
    def end(self) -> Array:
        """Joint positions ``(n,)`` at the end."""

    @property
    def peaks(self) -> tuple[Array, Array]:
        """The largest magnitudes ``(n,)`` of the joints' speeds and accelerations."""

    @property
    def peak_jerk(self) -> Array:
        """The largest magnitudes ``(n,)`` of the joints' jerks; infinite where accelerations change at once."""

    def at(self, times: Array) -> tuple[Array, Array, Array]:
        """Joint positions, speeds and accelerations ``(k, n)`` at times ``(k,)`` since its start."""

    def jerks_at(self, times: Array) -> Array:
        """Jerks ``(k, n)`` at times ``(k,)`` since its start."""


@dataclass(frozen=True)
class Motion:
    """Moves one after the other, of which each starts where the one before it ends."""

    moves: Sequence[Move]

    @cached_property
    def starts(self) -> Array:
        """When each move starts, and when the last one ends, ``(m + 1,)`` s."""
        return np.append(0.0, np.cumsum([move.seconds for move in self.moves]))

    @property
    def seconds(self) -> float:
        """How long all of it takes."""
        return float(self.starts[-1])

    @cached_property
    def peaks(self) -> tuple[Array, Array]:
        """The largest magnitudes ``(n,)`` of the joints' speeds and accelerations."""
        speeds, accelerations = zip(*(move.peaks for move in self.moves), strict=True)
        return np.max(speeds, axis=0), np.max(accelerations, axis=0)

    @cached_property
    def peak_jerk(self) -> Array:
        """The largest magnitudes ``(n,)`` of the joints' jerks; infinite where accelerations change at once."""
        return np.asarray(np.max([move.peak_jerk for move in self.moves], axis=0))

    def times(self, step_s: float) -> Array:
        """Times ``(k,)`` from 0 to the end, a step apart, with the end itself."""
        whole = np.arange(0.0, self.seconds, step_s)
        return np.append(whole[self.seconds - whole > 1e-9], self.seconds)

    def at(self, times: Array) -> tuple[Array, Array, Array]:
        """Joint positions, speeds and accelerations ``(k, n)`` at times ``(k,)`` since the start."""
        which, size = self._which(times), len(self.moves[0].end)
        out = np.empty((len(times), size)), np.empty((len(times), size)), np.empty((len(times), size))
        for i, move in enumerate(self.moves):
            rows = np.flatnonzero(which == i)
            if rows.size:
                for whole, part in zip(out, move.at(times[rows] - self.starts[i]), strict=True):
                    whole[rows] = part
        return out

    def jerks_at(self, times: Array) -> Array:
        """Jerks ``(k, n)`` at times ``(k,)`` since the start."""
        which, out = self._which(times), np.empty((len(times), len(self.moves[0].end)))
        for i, move in enumerate(self.moves):
            out[which == i] = move.jerks_at(times[which == i] - self.starts[i])
        return out

    def _which(self, times: Array) -> NDArray[np.int_]:
        """The number ``(k,)`` of the move that each time is in."""
        return np.clip(np.searchsorted(self.starts, times, side="right") - 1, 0, len(self.moves) - 1)


_LAWS = {"common": common_phases, "own": own_phases, "independent": independent}
_HAD_M = 1e-6  # m/s or rad/s: of a velocity at a point, by how much the joints may miss it


@dataclass(frozen=True)
class Leg:
    """A part of a motion.

    Attributes:
        kind: how the tool or the joints move.
        points: ids of the points from its start to its end.
        stops: ``(k, n)`` joint positions at these points; of points that are passed at a distance, those they pass.
        move: how it moves.
        length_m, turn_rad: of the tool's path; NaN of moves of the joints.
        speed_m_s: the tool's largest one on it; NaN of moves of the joints.
    """

    kind: Literal["joint", "line", "circle"]
    points: tuple[str, ...]
    stops: Array
    move: Move
    length_m: float = float("nan")
    turn_rad: float = float("nan")
    speed_m_s: float = float("nan")


def planned(options: TrajectoryOptions, arm: RigidArm, values: Array, chain: JointSpec, rows: PathRows) -> list[Leg]:
    """The legs of the motion through all points.

    Args:
        chain: the joints, with their speeds and accelerations.

    Raises:
        LabError: naming the file and the point that cannot be reached, or passed like that.
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
    """Goes through the points one after the other; ``here`` are the joint positions ``(n,)`` that it has come to."""

    options: TrajectoryOptions
    arm: RigidArm
    values: Array
    chain: JointSpec
    rows: PathRows
    legs: list[Leg] = field(default_factory=list)

    def at(self, i: int, joints: Array) -> None:
        """Stand at a point."""
        self.here, self.point = joints, self.rows.ids[i]

    def joints_of(self, i: int, near: Array) -> Array:
        """Joint positions ``(n,)`` of a point, in the configuration nearest to some.

        Raises:
            LabError: there are none, or they are beyond the limits.
        """
        joints, name = self.rows.joints[i], self.rows.ids[i]
        if not np.isnan(self.rows.positions[i]).any():
            wanted = PoseTarget(self.rows.positions[i : i + 1], self.rows.rotations[i : i + 1])
            reference = joints if np.isfinite(joints).all() else near
            found = Solver(self.arm, self.values)(wanted, reference[None])[0]
            if not found.solutions:
                far = "" if np.isnan(found.gap_m) else f" by {1e3 * found.gap_m:.4g} mm"
                raise LabError(f"point {name} is out of reach{far}; move it")
            joints = found.solutions[0].joints
        excess = self.chain.excess(joints)
        if excess.max() > 1e-9:
            j = int(np.argmax(excess))
            raise LabError(f"point {name}: {self.chain.said_beyond(j, joints[j])}; move it within them")
        return np.asarray(joints)

    def joint_leg(self, i: int) -> int:
        """Moves of the joints from point ``i - 1`` on, as far as they go on; the next point's row."""
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
        stops = np.array(points)
        if allowed is not None and len(points) > 2:
            if speeds.any():
                raise LabError("points with a velocity are passed exactly; leave out --blend-deg and --blend-mm")
            self.legs.append(Leg("joint", tuple(ids), stops, blended(self.chain, stops, allowed)))
            return
        for k in range(len(points) - 1):
            move = through(self.chain, stops[k : k + 2], speeds[k : k + 2], law)
            self.legs.append(Leg("joint", tuple(ids[k : k + 2]), stops[k : k + 2], move))

    def _speeds(self, row: int, joints: Array) -> Array:
        """Speeds ``(n,)`` of the joints at a point, by the file's or by the tool's velocity there."""
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
        if np.abs(found.missing).max() > _HAD_M:
            raise LabError(f"point {name}: the arm cannot have that velocity there, where it is singular; mend it")
        return np.asarray(found.joints[0])

    def path_leg(self, i: int) -> int:
        """A line or a circle from the last point on; the next point's row."""
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
        speed = path.length_m * float(move.pace.peak_speed[0])
        kind: Literal["line", "circle"] = "circle" if circle else "line"
        self.legs.append(Leg(kind, ids, move.joints_at(places), move, path.length_m, path.turn_rad, speed))
        self.at(end, move.end)
        return end + 1

    def _arc(self, T_start: Array, i: int) -> CartesianPath:
        via = self._pose(i, T_start)[:3, 3]
        with error_context(f"the circle to point {self.rows.ids[i + 1]}"):
            return arc(T_start, via, self._pose(i + 1, T_start))

    def _pose(self, i: int, T_before: Array) -> Array:
        """The pose ``(4, 4)`` of a point; without an orientation of its own it keeps the one before."""
        if np.isnan(self.rows.positions[i]).any():
            return np.asarray(self.arm.tool(self.rows.joints[i : i + 1], self.values)[0][0])
        rotation = self.rows.rotations[i]
        return se3.pose(rotation if np.isfinite(rotation).all() else T_before[:3, :3], self.rows.positions[i])
