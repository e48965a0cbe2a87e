"""Results of ``lab trajectory``: typed, as plain values, and as a document."""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lab.core import se3
from lab.core.errors import LabError
from lab.core.se3 import Array
from lab.core.units import DEGREES, MM
from lab.extensions.robotics.trajectory.motion import Leg, Motion
from lab.extensions.robotics.trajectory.path_errors import Correction, TrackedArm, Tracking, tracking_along
from lab.extensions.robotics.trajectory.trajectory_options import TrajectoryOptions
from lab.formats.csv_table import write_columns
from lab.formats.programs.languages import path_file, path_program, refusal
from lab.formats.programs.program_text import postures_of
from lab.formats.programs.protocol import MoveKind, PathMoves
from lab.kinematics.effects.effect import AXES
from lab.kinematics.joints import JointSpec
from lab.library.result import Result, joint_values, number, tidy
from lab.library.run_folder import joint_columns
from lab.robots.robot import Robot
from lab.simulation.collisions import collides, describe_collisions

__all__ = ["TrajectoryResult", "angles_deg", "lengths_mm", "mean_and_max", "path_moves", "refuse_collisions"]


@dataclass(frozen=True)
class _Sampled:
    """A motion at some times.

    Attributes:
        times: ``(k,)`` s.
        joints, speeds, accelerations: ``(k, n)`` rad or m, per s, per s^2.
        Ts_base_tool: ``(k, 4, 4)`` m.
    """

    times: Array
    joints: Array
    speeds: Array
    accelerations: Array
    Ts_base_tool: Array


@dataclass(frozen=True, repr=False, eq=False)
class TrajectoryResult(Result):
    """A motion of a robot through given points.

    Attributes:
        options: of the command.
        chain: the joints, with the limits of speed and acceleration that were applied.
        legs: the parts of the motion.
        tracked: the arm whose path errors are computed; None for a rigid nominal robot.
    """

    command = "trajectory"

    options: TrajectoryOptions
    robot: Robot
    chain: JointSpec
    legs: tuple[Leg, ...]
    warnings: tuple[str, ...]
    tracked: TrackedArm | None = None

    @property
    def model_sha256(self) -> str:
        """Digest of the robot's description."""
        return self.robot.sha256

    @property
    def checked(self) -> bool:
        """True if the motion is checked for collisions."""
        return not self.unchecked_reason

    @property
    def unchecked_reason(self) -> str:
        """Reason why collisions are not checked; empty where they are."""
        if self.options.no_check:
            return "--no-check"
        if self.robot.model.shapes_assumed and self.robot.cell is None:
            return "its links are drawn as rods, which are checked with --cell alone"
        return self.robot.model.missing

    @cached_property
    def motion(self) -> Motion:
        """The whole motion: its legs in sequence."""
        return Motion([leg.move for leg in self.legs])

    @cached_property
    def sampled(self) -> _Sampled:
        """The motion at the times of ``trajectory.csv``."""
        times = self.motion.times(self.options.step_ms / 1e3)
        joints, speeds, accelerations = self.motion.at(times)
        arm = self.robot.arm(("p1",))
        Ts = arm.tool(joints, arm.nominal({"p1": self.options.tool_m}))[0]
        return _Sampled(times, joints, speeds, accelerations, Ts)

    @cached_property
    def passed(self) -> tuple[tuple[str, ...], NDArray[np.int_]]:
        """Ids ``(p,)`` of the points, and the sampled time nearest to each, in order."""
        ids, rows = [self.legs[0].points[0]], [0]
        ends = np.searchsorted(self.sampled.times, self.motion.starts[1:] - 1e-9).tolist()
        for leg, end in zip(self.legs, ends, strict=True):
            for name, there in zip(leg.points[1:-1], leg.waypoints[1:-1], strict=True):
                part = self.sampled.joints[rows[-1] : end + 1]
                ids.append(name)
                rows.append(rows[-1] + int(np.abs(part - there).max(axis=1).argmin()))
            ids.append(leg.points[-1])
            rows.append(min(end, len(self.sampled.times) - 1))
        return tuple(ids), np.array(rows)

    @cached_property
    def tracking(self) -> Tracking | None:
        """Errors of the tracked arm at these times, and the joint positions that correct them."""
        if self.tracked is None:
            return None
        at = self.sampled
        return tracking_along(self.tracked, at.joints, at.speeds, at.accelerations, at.times)

    @cached_property
    def at_points(self) -> Correction | None:
        """Correction at the points of all moves, from the start on, with the arm at rest; None of a rigid arm."""
        if self.tracked is None:
            return None
        points = np.concatenate([self.legs[0].waypoints[:1], *(leg.waypoints[1:] for leg in self.legs)])
        still = np.zeros_like(points)
        return tracking_along(self.tracked, points, still, still, np.arange(float(len(points)))).corrected

    @property
    def incomplete_points(self) -> tuple[str, ...]:
        """Ids of points whose correction, at rest, is incomplete."""
        ids = (self.legs[0].points[0], *(name for leg in self.legs for name in leg.points[1:]))
        reasons = () if self.at_points is None else self.at_points.reasons
        return tuple(dict.fromkeys(name for name, reason in zip(ids, reasons, strict=False) if reason))

    @property
    def program(self) -> str | None:
        """Name of the controller's program; None where there is none (``no_program``)."""
        return None if self.no_program else path_file(self.robot.chain, self.options.controller)

    @property
    def no_program(self) -> str | None:
        """Reason why there is no program for the controller; None where there is one."""
        if self.incomplete_points:
            points = ", ".join(self.incomplete_points)
            return f"no program is written: the correction is incomplete at {points}; move these points"
        return refusal(self.robot.chain, self.options.controller)

    @property
    def exit_code(self) -> int:
        """1 where the correction is incomplete at a time of the motion or at a point; else 0."""
        whole = self.tracking is None or (self.tracking.corrected.complete.all() and not self.incomplete_points)
        return 0 if whole else 1

    def to_dict(self) -> dict[str, Any]:
        """Return the output of ``--json``: seconds, mm and degrees."""
        chain = self.robot.chain
        peaks = self.motion.peaks
        return {
            "robot": self.robot.name,
            "seconds": number(self.motion.seconds),
            "joints": list(chain.joint_names),
            "units": ["mm" if slides else "deg" for slides in chain.prismatic],
            "peak_speeds": _joint_list(chain, peaks[0]),
            "speed_limits": _joint_list(chain, self.chain.speed),
            "peak_accelerations": _joint_list(chain, peaks[1]),
            "acceleration_limits": _joint_list(chain, self.chain.acceleration),
            "legs": [
                {
                    "move": leg.kind,
                    "points": list(leg.points),
                    "seconds": number(leg.move.seconds),
                    "length_mm": number(MM.of(leg.length_m)),
                    "turn_deg": number(np.rad2deg(leg.turn_rad)),
                    "stops": [_joint_list(chain, row) for row in leg.waypoints[[0, -1]]],
                    **self._unsynchronised(leg),
                }
                for leg in self.legs
            ],
            "checked": self.checked,
            "program": self.program,
            "no_program": self.no_program,
            "tracking": self._tracking_values(),
            "warnings": list(self.warnings),
        }

    def _unsynchronised(self, leg: Leg) -> dict[str, Any]:
        """Return the phases of each joint alone, s, and the joints that constrain the move and each of its phases."""
        phases = leg.unsynchronised(self.chain)
        if phases is None:
            return {"own_phases": None, "constrained_by": None, "phases_constrained_by": None}
        names = self.robot.chain.joint_names
        longest = [names[int(column.argmax())] if column.max() > 0 else None for column in (phases.sum(1), *phases.T)]
        return {"own_phases": phases.tolist(), "constrained_by": longest[0], "phases_constrained_by": longest[1:]}

    def _tracking_values(self) -> dict[str, Any] | None:
        if self.tracked is None or self.tracking is None:
            return None
        corrected, joints = self.tracking.corrected, self.sampled.joints
        displacing, turning = corrected.directions
        return {
            "payload_kg": number(self.tracked.payload_kg),
            "error_mm": mean_and_max(lengths_mm(self.tracking.total)),
            "error_deg": mean_and_max(angles_deg(self.tracking.total)),
            "parts_mm": {name: mean_and_max(lengths_mm(part)) for name, part in self.tracking.parts.items()},
            "left_mm": mean_and_max(lengths_mm(corrected.left)),
            "left_deg": mean_and_max(angles_deg(corrected.left)),
            "largest_corrections": _joint_list(self.chain, np.abs(corrected.joints - joints).max(axis=0)),
            "directions": {"position": displacing, "rotation": turning},
            "not_made_up_for": [name for name, made in zip(AXES, self.tracking.movable, strict=True) if not made],
            "incomplete": dict(Counter(filter(None, corrected.reasons))),
            "incomplete_points": list(self.incomplete_points),
        }

    def write_files(self, folder: Path) -> None:
        """Write ``trajectory.csv``, and where available ``corrected.csv`` and the controller's program."""
        write_columns(folder / "trajectory.csv", self.columns())
        if self.tracking is not None:
            write_columns(folder / "corrected.csv", self.corrected_columns())
        if self.program is not None:
            program = path_program(self.robot.chain, self.options.controller, path_moves(self))
            (folder / self.program).write_bytes(program)

    def columns(self) -> Mapping[str, Array]:
        """Return a row for each time: joint positions, speeds and accelerations, mm and degrees, and the tool's pose.

        The tool's orientation in the base is a quaternion.
        """
        chain, sampled = self.robot.chain, self.sampled
        table: dict[str, Array] = {"time_s": sampled.times}
        parts = {
            "{}": sampled.joints,
            "speed_{}_per_s": sampled.speeds,
            "acceleration_{}_per_s2": sampled.accelerations,
        }
        for heading, values in parts.items():
            table |= {heading.format(name): column for name, column in joint_columns(chain, values).items()}
        table |= {f"tool_{axis}_mm": MM.of(sampled.Ts_base_tool[:, i, 3]) for i, axis in enumerate("xyz")}
        quaternions = _steady(se3.quaternion_from_rotation(sampled.Ts_base_tool[:, :3, :3]))
        return table | {f"tool_q{part}": column for part, column in zip("wxyz", quaternions.T, strict=True)}

    def corrected_columns(self) -> Mapping[str, Array | Sequence[str]]:
        """Return a row for each time: corrected joint positions, the error without correction, and what remains.

        The error is given in all and by part, and of elastic links with the torsors of their far ends in the links'
        axes (Benmisra 2007, figure 3.7). ``incomplete`` has the reason why a correction is not complete.

        Raises:
            LabError: the motion is a nominal robot's, without errors.
        """
        if (found := self.tracking) is None:
            raise LabError("this motion is a nominal robot's, which misses nothing; give a run")
        table: dict[str, Array | Sequence[str]] = {"time_s": self.sampled.times}
        table |= joint_columns(self.robot.chain, found.corrected.joints)
        table |= {f"error_{axis}_mm": MM.of(found.total[:, i]) for i, axis in enumerate("xyz")}
        table |= {f"{name.replace(' ', '')}_mm": lengths_mm(part) for name, part in found.parts.items()}
        table |= _six_columns([f"left_{axis}" for axis in AXES], found.corrected.left)
        table |= {"incomplete": found.corrected.reasons}
        for link, torsor in found.torsors.items():
            table |= _six_columns([f"link{link + 1}_{part}" for part in ("dx", "dy", "dz", "rx", "ry", "rz")], torsor)
        return table


def _six_columns(names: Sequence[str], values: Array) -> dict[str, Array]:
    """Return columns of displacements and rotation vectors ``(k, 6)`` (m, rad), in mm and degrees."""
    units = [MM] * 3 + [DEGREES] * 3
    return {f"{name}_{unit.key}": unit.of(column) for name, unit, column in zip(names, units, values.T, strict=True)}


def _steady(quaternions: Array) -> Array:
    """Return quaternions ``(k, 4)`` of the same rotations, without a change of sign from one to the next."""
    turned = np.where((quaternions[1:] * quaternions[:-1]).sum(axis=1) < 0, -1.0, 1.0)
    return np.asarray(quaternions * np.cumprod(np.append(1.0, turned))[:, None])


def lengths_mm(error: Array) -> Array:
    """Return the lengths ``(k,)`` of position errors ``(k, 6)``."""
    return MM.of(np.linalg.norm(error[:, :3], axis=1))


def mean_and_max(lengths: Array) -> dict[str, float | None]:
    """Return the mean and the largest of lengths ``(k,)``; None where they are not finite."""
    return {"mean": number(float(lengths.mean())), "max": number(float(lengths.max()))}


def angles_deg(error: Array) -> Array:
    """Return the angles ``(k,)`` of rotation errors ``(k, 6)``."""
    return DEGREES.of(np.linalg.norm(error[:, 3:], axis=1))


def _joint_list(chain: JointSpec, values: Array) -> list[float | None]:
    return [tidy(value) if np.isfinite(value) else None for value in joint_values(chain.prismatic, values)]


_STEP_M = 0.01  # largest motion of a point of the arm between two checks


def refuse_collisions(result: TrajectoryResult) -> None:
    """Check the whole motion for collisions, where its shapes are known and checks are on.

    Raises:
        LabError: the arm collides; the message gives what it touches, the time and the move.
    """
    if not result.checked:
        return
    model, joints = result.robot.model, result.sampled.joints
    travel = np.append(0.0, np.cumsum(np.abs(np.diff(joints, axis=0)) @ model.travel_per_joint()))
    checks = np.unique(np.append(np.linspace(0, travel[-1], 1 + int(np.ceil(travel[-1] / _STEP_M))), travel))
    configurations = np.stack([np.interp(checks, travel, column) for column in joints.T], axis=1)
    touched = np.flatnonzero(collides(model, configurations))
    if not touched.size:
        return
    seconds = float(np.interp(checks[touched[0]], travel, result.sampled.times))
    leg = result.legs[min(int(np.searchsorted(result.motion.starts, seconds, side="right")) - 1, len(result.legs) - 1)]
    kind = {"joint": "move", "line": "line", "circle": "circle"}[leg.kind]
    message = describe_collisions(model, configurations[touched[:1]])[0] or "something is touched"
    raise LabError(
        f"{result.options.points}: on the {kind} from point {leg.points[0]} to {leg.points[-1]}, at {seconds:.3f} s, "
        f"{message}; move the points, pass by another one, or give --no-check"
    )


def path_moves(result: TrajectoryResult) -> PathMoves:
    """Return the waypoints of all moves of a motion, and of circles the points that they pass.

    With a run these are the joint positions at which the calibrated arm, at rest, is where the nominal one would be.
    """
    first, rated = result.legs[0], result.robot.chain.speed
    rated = np.where(np.isfinite(rated), rated, result.chain.speed)  # by the robot's table, where it has one
    ids, kinds = [first.points[0]], list[MoveKind](["joint"])
    waypoints, seconds, shares, speeds = [first.waypoints[0]], [np.nan], [0.0], [np.nan]
    for leg in result.legs:
        share = float((leg.move.peaks[0] / rated).max())
        count = len(leg.points) - 1
        reached: list[MoveKind] = ["via", "circle"] if leg.kind == "circle" else [leg.kind] * count
        for name, kind, stop in zip(leg.points[1:], reached, leg.waypoints[1:], strict=True):
            ids.append(name)
            kinds.append(kind)
            waypoints.append(stop)
            seconds.append(np.nan if kind == "via" else leg.move.seconds / (1 if kind == "circle" else count))
            shares.append(share)
            speeds.append(leg.speed_m_s)
    tracked, corrected = result.tracked, np.array(waypoints)
    if tracked is None:
        arm = result.robot.arm(("p1",))
        values = arm.nominal({"p1": result.options.tool_m})
    else:
        arm, values = tracked.arm.rigid, tracked.nominal
        corrected = corrected if result.at_points is None else result.at_points.joints
    T_last_tool = se3.pose(np.eye(3), values[-3 * len(arm.targets) :][:3])
    return PathMoves(
        robot=result.robot.name,
        ids=ids,
        kinds=kinds,
        waypoints=corrected,
        Ts_base_tool=arm.tool(corrected, values)[0],
        seconds=np.array(seconds),
        shares=np.array(shares),
        speeds_m_s=np.array(speeds),
        T_last_tool=T_last_tool,
        T_frame0_base=se3.inverse(arm.T_tracker_frame0(values)),
        checked=result.checked,
        corrected=tracked is not None,
        postures=postures_of(arm, values, corrected),
    )
