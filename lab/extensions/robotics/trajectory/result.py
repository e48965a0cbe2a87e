"""Results of ``lab trajectory``: typed, as plain values, and as a document."""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from lab.campaign.robot import Robot
from lab.commands.result import Result, joint_values, number, tidy
from lab.commands.run_folder import joint_columns
from lab.core import se3
from lab.core.errors import LabError
from lab.core.se3 import Array
from lab.core.units import DEGREES, MM
from lab.extensions.robotics.trajectory.motion import Leg, Motion
from lab.extensions.robotics.trajectory.options import TrajectoryOptions
from lab.extensions.robotics.trajectory.tracking import Correction, TrackedArm, Tracking, tracking_along
from lab.formats.csv_table import write_columns
from lab.formats.programs.program_text import postures_of
from lab.formats.programs.protocol import MoveKind, PathMoves
from lab.formats.programs.registry import path_file, path_program, refusal
from lab.kinematics.effects.effect import AXES
from lab.kinematics.joints import JointSpec
from lab.render.charts.chart import axes_picture
from lab.render.charts.marks import Axes
from lab.render.document import Document, Figure, Paragraph, Picture, Section, Table, Warnings, fixed, sentence
from lab.render.style import SERIES
from lab.simulation.collisions import collides, describe_collisions

__all__ = ["TrajectoryResult", "path_moves", "refuse_collisions"]


@dataclass(frozen=True)
class _Sampled:
    """A motion at some times.

    Attributes:
        times: ``(k,)`` s.
        joints, speeds, accelerations: ``(k, n)`` rad or m, per s, per s^2.
        Ts_base_tool: ``(k, 4, 4)`` m.
        jerks: ``(k, n)`` rad or m per s^3; None where they are not limited.
    """

    times: Array
    joints: Array
    speeds: Array
    accelerations: Array
    Ts_base_tool: Array
    jerks: Array | None = None


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
    shown_by = "lab.extensions.robotics.trajectory.result:_trajectory_document"
    drawn_by = "lab.extensions.robotics.trajectory.result:_main_picture"
    recorded_by = "lab.extensions.robotics.trajectory.recording:record_trajectory"

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
        jerks = None if self.chain.jerk is None else self.motion.jerks_at(times)
        return _Sampled(times, joints, speeds, accelerations, Ts, jerks)

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
            "peak_jerks": None if self.chain.jerk is None else _joint_list(chain, self.motion.peak_jerk),
            "jerk_limits": None if self.chain.jerk is None else _joint_list(chain, self.chain.jerk),
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
            "error_mm": _mean_and_max(_lengths_mm(self.tracking.total)),
            "error_deg": _mean_and_max(_angles_deg(self.tracking.total)),
            "parts_mm": {name: _mean_and_max(_lengths_mm(part)) for name, part in self.tracking.parts.items()},
            "left_mm": _mean_and_max(_lengths_mm(corrected.left)),
            "left_deg": _mean_and_max(_angles_deg(corrected.left)),
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

        Where jerks are limited these are there, too. The tool's orientation in the base is a quaternion.
        """
        chain, sampled = self.robot.chain, self.sampled
        table: dict[str, Array] = {"time_s": sampled.times}
        parts = {
            "{}": sampled.joints,
            "speed_{}_per_s": sampled.speeds,
            "acceleration_{}_per_s2": sampled.accelerations,
        }
        if sampled.jerks is not None:
            parts["jerk_{}_per_s3"] = sampled.jerks
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
        table |= {f"{name.replace(' ', '')}_mm": _lengths_mm(part) for name, part in found.parts.items()}
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


def _lengths_mm(error: Array) -> Array:
    """Return the lengths ``(k,)`` of position errors ``(k, 6)``."""
    return MM.of(np.linalg.norm(error[:, :3], axis=1))


def _mean_and_max(lengths: Array) -> dict[str, float | None]:
    return {"mean": number(float(lengths.mean())), "max": number(float(lengths.max()))}


def _angles_deg(error: Array) -> Array:
    """Return the angles ``(k,)`` of rotation errors ``(k, 6)``."""
    return DEGREES.of(np.linalg.norm(error[:, 3:], axis=1))


def _joint_list(chain: JointSpec, values: Array) -> list[float | None]:
    return [tidy(value) if np.isfinite(value) else None for value in joint_values(chain.prismatic, values)]


_STILL = 1e-9  # rad/s or m/s
_MAX_LEGS = 40  # rows of the table of moves
_LAWS = {
    "common": "In moves of the joints all have their phases in common: from rest to rest they move in a straight line.",
    "own": "In moves of the joints all start and stop together, each with phases of its own.",
    "independent": "In moves of the joints all start together, and each stops as soon as it can.",
}


def _main_picture(result: TrajectoryResult) -> Picture:
    return _curve_pictures(result)[0]


def _trajectory_document(result: TrajectoryResult) -> Document:
    seconds = result.motion.seconds
    points = sum(len(leg.points) - 1 for leg in result.legs) + 1
    smooth = "Jerk is limited" if result.chain.jerk is not None else "Jerk is not limited (--jerks)"
    return Document(
        f"{result.robot.name}: {fixed(seconds, 5)} s through {points} points",
        (
            Warnings(result.warnings),
            Section("Moves", (_legs(result), *_own_times(result))),
            Section("Joints", (_joints(result), Paragraph(f"{_LAWS[result.options.law]} {smooth}.", "note"))),
            *_errors(result),
            Section("Over time", (_figure(result),)),
            Section("Files", (_files(result),)),
        ),
    )


def _files(result: TrajectoryResult) -> Paragraph:
    """Report the checks, the program, and the decisions it leaves to the controller."""
    checked = (
        "The whole motion was checked for collisions, with the arm itself and with the surroundings that are known."
        if result.checked
        else f"Nothing was checked for collisions: {result.unchecked_reason}."
    )
    if result.program is None:
        return Paragraph(f"{checked} {sentence(result.no_program or '')}")
    text = f"{checked} {result.program} has the moves; the controller stops at each point and finds the way between."
    ends = [leg.move.at(np.array([leg.move.seconds]))[1] for leg in result.legs[:-1] if leg.kind == "joint"]
    passed = result.options.blend(result.chain) is not None or any(np.abs(speeds).max() > _STILL for speeds in ends)
    return Paragraph(f"{text} Points that are passed without a stop here are stopped at there." if passed else text)


def _errors(result: TrajectoryResult) -> tuple[Section, ...]:
    if result.tracked is None or result.tracking is None:
        return ()
    found, values = result.tracking, result.to_dict()["tracking"]
    errors = {"in all": found.total, **found.parts, "left after the correction, by the model": found.corrected.left}
    cells = tuple(
        (
            name,
            *map(_um, _mean_and_max(_lengths_mm(each)).values()),
            *map(_um, _mean_and_max(_angles_deg(each)).values()),
        )
        for name, each in errors.items()
    )
    chain, largest = result.chain, values["largest_corrections"]
    joints = ", ".join(
        f"{name} {size:.3g}{' mm' if slides else '°'}"
        for name, size, slides in zip(chain.joint_names, largest, chain.prismatic, strict=True)
    )
    text = (
        f"With {values['payload_kg']:.4g} kg, under gravity and the inertia of the motion, at rest at each instant: "
        f"vibration is left out. Joint positions that make up for it are in corrected.csv: by up to {joints}."
    )
    displacing, turning = found.corrected.directions
    if displacing + turning < len(AXES):
        text += (
            f" The joints correct the position in {displacing} of 3 directions and the rotation in {turning} of 3. "
            "These change with the pose; the rest of the error remains."
        )
    if values["not_made_up_for"]:
        text += f" No joint moves the tool along {', '.join(values['not_made_up_for'])} at any time."
    figure = Figure("errors", (_error_picture(result, found),), "What the tool misses its path by, in all and by part.")
    table = Table(("part", "mean, µm", "max, µm", "mean, m°", "max, m°"), cells)
    return (Section("Errors along the way", (Paragraph(text), table, figure)),)


def _um(length_mm: float | None) -> str:
    return "–" if length_mm is None else f"{1e3 * length_mm:.3g}" if length_mm >= 1e-6 else "< 0.001"


def _error_picture(result: TrajectoryResult, found: Tracking) -> Picture:
    curves = {"in all": found.total, **found.parts}

    def draw(axes: Axes) -> None:
        for i, (name, error) in enumerate(curves.items()):
            axes.plot(
                result.sampled.times,
                _lengths_mm(error),
                "-",
                color=SERIES[i % len(SERIES)][0],
                linewidth=1.3,
                label=name,
            )
        axes.set(xlabel="time, s", ylabel="mm", title="errors of the tool")
        axes.legend(loc="best", fontsize=7)

    return axes_picture("errors", "Errors of the tool over time", (7.5, 2.4), draw, (0.8, 0.5, 0.2, 0.3))


def _curve_pictures(result: TrajectoryResult) -> tuple[Picture, ...]:
    """Draw joint positions over time; then rates as percentages of their limits."""
    sampled, chain = result.sampled, result.chain
    units = {"mm" if slides else "°" for slides in chain.prismatic}
    positions = joint_values(chain.prismatic, sampled.joints)
    rates = [("speeds", sampled.speeds, chain.speed), ("accelerations", sampled.accelerations, chain.acceleration)]
    if sampled.jerks is not None and chain.jerk is not None:
        rates.append(("jerks", sampled.jerks, chain.jerk))
    return (
        _curves("positions", result, positions, f"{' or '.join(sorted(units))}", limited=False),
        *(_curves(name, result, 100 * values / limit, "% of the limit", limited=True) for name, values, limit in rates),
    )


def _curves(name: str, result: TrajectoryResult, shown: Array, unit: str, *, limited: bool) -> Picture:
    times, steps = result.sampled.times, name == ("accelerations" if result.chain.jerk is None else "jerks")

    def draw(axes: Axes) -> None:
        for j, (joint, column) in enumerate(zip(result.robot.chain.joint_names, shown.T, strict=True)):
            colour, style = SERIES[j % len(SERIES)][0], "steps-post" if steps else "default"
            axes.plot(times, column, "-", color=colour, linewidth=1.3, label=joint, drawstyle=style)
        for start in result.motion.starts[1:-1]:
            axes.axvline(start, color="0.85", linewidth=0.8, zorder=0)
        for limit in (-100, 100) if limited else ():
            axes.axhline(limit, color="0.4", linewidth=0.9, linestyle="--", zorder=0)
        axes.set(xlabel="time, s", ylabel=unit, title=name)
        if limited:
            axes.set(ylim=(-112, 112), yticks=(-100, -50, 0, 50, 100))
        else:
            axes.legend(loc="center left", bbox_to_anchor=(1.01, 0.5), fontsize=7)

    return axes_picture(name, f"Joint {name} over time", (7.5, 2.4), draw, (0.8, 0.5, 0.8, 0.3))


def _legs(result: TrajectoryResult) -> Table:
    rows = []
    for leg, start in zip(result.legs, result.motion.starts, strict=False):
        along = "" if np.isnan(leg.length_m) else f"{fixed(MM.of(leg.length_m), 2)} mm"
        along += f", turns {fixed(np.rad2deg(leg.turn_rad), 2)}°" if leg.turn_rad > 1e-9 else ""
        rows.append((" → ".join(leg.points), leg.kind, fixed(start, 5), fixed(leg.move.seconds, 5), along))
    columns = ("points", "move", "starts at, s", "takes, s", "path of the tool")
    return Table(columns, tuple(rows), most_rows=_MAX_LEGS)


def _own_times(result: TrajectoryResult) -> tuple[Table, ...]:
    """Tabulate the shortest time of each joint alone, and the joint that constrains the move."""
    rows = []
    for leg, values in zip(result.legs, result.to_dict()["legs"], strict=True):
        if values["constrained_by"] is not None:
            times = (fixed(sum(phases), 5) for phases in values["own_phases"])
            by_phase = ", ".join(name or "–" for name in values["phases_constrained_by"])
            rows.append((" → ".join(leg.points), *times, f"{values['constrained_by']} ({by_phase})"))
    names = (f"{name}, s" for name in result.robot.chain.joint_names)
    caption = (
        "Shortest time of each joint alone, not synchronised, and the joint that constrains the move (and each of its "
        "phases: change of speed, cruise, change of speed)."
    )
    heads = ("points", *names, "constrained by")
    return (Table(heads, tuple(rows), caption, most_rows=_MAX_LEGS, rest_in="--json"),) if rows else ()


def _joints(result: TrajectoryResult) -> Table:
    chain, sampled = result.chain, result.sampled
    low, high = (joint_values(chain.prismatic, each(sampled.joints, axis=0)) for each in (np.min, np.max))
    speeds, accelerations = result.motion.peaks
    rates = {"speed, per s": (speeds, chain.speed), "acceleration, per s²": (accelerations, chain.acceleration)}
    if chain.jerk is not None:
        rates["jerk, per s³"] = (result.motion.peak_jerk, chain.jerk)
    columns = [_peaks(result, *each) for each in rates.values()]
    rows = tuple(
        (name, "mm" if chain.prismatic[j] else "°", f"{fixed(low[j], 2)} … {fixed(high[j], 2)}",
         *(column[j] for column in columns))
        for j, name in enumerate(chain.joint_names)
    )  # fmt: skip
    return Table(("joint", "", "from … to", *(f"peak {name}" for name in rates)), rows)


def _peaks(result: TrajectoryResult, peaks: Array, limits: Array) -> list[str]:
    """Format the largest rate of each joint, beside its limit."""
    shown = (joint_values(result.chain.prismatic, each) for each in (peaks, limits))
    return [
        f"{fixed(peak, 2)} of {fixed(most, 1)}" if most < np.inf else "not limited"
        for peak, most in zip(*shown, strict=True)
    ]


def _figure(result: TrajectoryResult) -> Figure:
    rates = "speeds and accelerations" if result.chain.jerk is None else "speeds, accelerations and jerks"
    caption = f"Joint positions; {rates} as shares of each joint's limit (dashed). Grey lines part the moves."
    return Figure("curves", _curve_pictures(result), caption)


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
