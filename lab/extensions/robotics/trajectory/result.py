"""A motion of a robot: typed, and as plain values."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from lab.campaign.robot import Robot
from lab.commands.result import Result
from lab.commands.values import joint_values, number, tidy
from lab.core import se3
from lab.core.errors import LabError
from lab.core.se3 import Array
from lab.extensions.robotics.trajectory.elastic import Tracking
from lab.extensions.robotics.trajectory.motion import Leg, Motion
from lab.extensions.robotics.trajectory.options import TrajectoryOptions
from lab.extensions.robotics.trajectory.tracked import TrackedArm, tracking_along
from lab.formats.csv_table import write_columns
from lab.formats.programs.registry import path_file, path_program, refusal
from lab.kinematics.effects.effect import AXES
from lab.kinematics.joints import JointSpec

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from lab.render.document import Document

__all__ = ["Sampled", "TrajectoryResult"]


@dataclass(frozen=True)
class Sampled:
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
    """How a robot moves through some points.

    Attributes:
        options: what was asked.
        chain: the joints, with the speeds and accelerations that were kept.
        legs: the parts of the motion.
        tracked: the arm whose errors along the way are known; None of a nominal robot that nothing bends.
    """

    options: TrajectoryOptions
    robot: Robot
    chain: JointSpec
    legs: tuple[Leg, ...]
    warnings: tuple[str, ...]
    tracked: TrackedArm | None = None

    @property
    def exit_code(self) -> int:
        """0: what cannot be moved is refused."""
        return 0

    @property
    def checked(self) -> bool:
        """Whether the motion is looked at for collisions."""
        return not self.unchecked_reason

    @property
    def unchecked_reason(self) -> str:
        """Why nothing is looked at for collisions; empty where it is."""
        if self.options.no_check:
            return "--no-check"
        if self.robot.model.shapes_assumed and self.robot.cell is None:
            return "its links are drawn as rods, which are checked with --cell alone"
        return self.robot.model.missing

    @cached_property
    def motion(self) -> Motion:
        """All legs, one after the other."""
        return Motion([leg.move for leg in self.legs])

    @cached_property
    def sampled(self) -> Sampled:
        """The motion at the times of ``trajectory.csv``."""
        times = self.motion.times(self.options.step_ms / 1e3)
        joints, speeds, accelerations = self.motion.at(times)
        arm = self.robot.arm(("p1",))
        Ts = arm.tool(joints, arm.nominal({"p1": self.options.tool_m}))[0]
        jerks = None if self.chain.jerk is None else self.motion.jerks_at(times)
        return Sampled(times, joints, speeds, accelerations, Ts, jerks)

    @cached_property
    def tracking(self) -> Tracking | None:
        """What the tracked arm misses at these times, and the joint positions that make up for it."""
        if self.tracked is None:
            return None
        at = self.sampled
        return tracking_along(self.tracked, at.joints, at.speeds, at.accelerations, at.times)

    def to_dict(self) -> dict[str, Any]:
        """What ``--json`` prints: seconds, mm and degrees."""
        chain = self.robot.chain
        peaks = self.motion.peaks
        return {
            "robot": self.robot.name,
            "seconds": number(self.motion.seconds),
            "joints": list(chain.joint_names),
            "units": ["mm" if slides else "deg" for slides in chain.prismatic],
            "peak_speeds": _told(chain, peaks[0]),
            "speed_limits": _told(chain, self.chain.speed),
            "peak_accelerations": _told(chain, peaks[1]),
            "acceleration_limits": _told(chain, self.chain.acceleration),
            "peak_jerks": None if self.chain.jerk is None else _told(chain, self.motion.peak_jerk),
            "jerk_limits": None if self.chain.jerk is None else _told(chain, self.chain.jerk),
            "legs": [
                {
                    "move": leg.kind,
                    "points": list(leg.points),
                    "seconds": number(leg.move.seconds),
                    "length_mm": number(1e3 * leg.length_m),
                    "turn_deg": number(np.rad2deg(leg.turn_rad)),
                    "stops": [_told(chain, row) for row in leg.stops[[0, -1]]],
                }
                for leg in self.legs
            ],
            "checked": self.checked,
            "program": path_file(chain, self.options.controller),
            "no_program": refusal(chain, self.options.controller),
            "tracking": self._tracking_values(),
            "warnings": list(self.warnings),
        }

    def _tracking_values(self) -> dict[str, Any] | None:
        """What is missed and corrected, in mm and degrees."""
        if self.tracked is None or self.tracking is None:
            return None
        corrected, joints = self.tracking.corrected, self.sampled.joints
        return {
            "payload_kg": number(self.tracked.payload_kg),
            "error_mm": _mean_and_max(self.tracking.total),
            "parts_mm": {name: _mean_and_max(part) for name, part in self.tracking.parts.items()},
            "left_mm": _mean_and_max(corrected.left),
            "largest_corrections": _told(self.chain, np.abs(corrected.joints - joints).max(axis=0)),
            "not_made_up_for": [name for name, made in zip(AXES, corrected.made, strict=True) if not made],
        }

    def document(self) -> "Document":
        """What a person reads: how long each move takes, how near the joints come to their limits, and the curves."""
        from lab.extensions.robotics.trajectory.document import trajectory_document

        return trajectory_document(self)

    def columns(self) -> Mapping[str, Sequence[Any]]:
        """A row for each time: joint positions, speeds and accelerations, mm and degrees, and where the tool is.

        Where jerks are limited these are there, too. The tool's orientation in the base is a quaternion.
        """
        chain, sampled = self.robot.chain, self.sampled
        table: dict[str, Sequence[Any]] = {"time_s": sampled.times.tolist()}
        names = [
            (name, "mm" if slides else "deg") for name, slides in zip(chain.joint_names, chain.prismatic, strict=True)
        ]
        parts = ((sampled.joints, "{0}_{1}"), (sampled.speeds, "speed_{0}_{1}_per_s"),
                 (sampled.accelerations, "acceleration_{0}_{1}_per_s2"),
                 *([] if sampled.jerks is None else [(sampled.jerks, "jerk_{0}_{1}_per_s3")]))  # fmt: skip
        for values, heading in parts:
            for (name, unit), column in zip(names, joint_values(chain.prismatic, values).T, strict=True):
                table[heading.format(name, unit)] = column.tolist()
        for i, axis in enumerate("xyz"):
            table[f"tool_{axis}_mm"] = (1e3 * sampled.Ts_base_tool[:, i, 3]).tolist()
        quaternions = _steady(se3.quaternion_from_rotation(sampled.Ts_base_tool[:, :3, :3]))
        for part, column in zip("wxyz", quaternions.T, strict=True):
            table[f"tool_q{part}"] = column.tolist()
        return table

    def corrected_columns(self) -> Mapping[str, Sequence[Any]]:
        """A row for each time: the joint positions to command instead, and what is missed without, in all and by part.

        Raises:
            LabError: nothing is known of what it misses.
        """
        if (found := self.tracking) is None:
            raise LabError("this motion is a nominal robot's, which misses nothing; give a run")
        chain, table = self.robot.chain, {"time_s": self.sampled.times.tolist()}
        shown = joint_values(chain.prismatic, found.corrected.joints).T
        for name, slides, column in zip(chain.joint_names, chain.prismatic, shown, strict=True):
            table[f"{name}_{'mm' if slides else 'deg'}"] = column.tolist()
        for i, axis in enumerate("xyz"):
            table[f"error_{axis}_mm"] = (1e3 * found.total[:, i]).tolist()
        for name, part in found.parts.items():
            table[f"{name.replace(' ', '')}_mm"] = (1e3 * np.linalg.norm(part[:, :3], axis=1)).tolist()
        return table

    def plot(self) -> "Figure":
        """Draw the joint positions over time."""
        from lab.extensions.robotics.trajectory.document import curve_pictures

        return curve_pictures(self)[0].draw()

    def write(self, folder: Path) -> None:
        """Write ``config.json``, ``result.json``, ``trajectory.csv``, ``report.html`` and ``recording.rrd``.

        Of an arm whose errors are known also ``corrected.csv``, and the program where the controller is known.
        """
        from lab.commands.run_folder import write_config, write_json
        from lab.extensions.robotics.trajectory.moves import path_moves
        from lab.extensions.robotics.trajectory.recording import record_trajectory

        write_config(folder, "trajectory", self.options, self.robot.sha256)
        write_json(folder / "result.json", self.to_dict())
        write_columns(folder / "trajectory.csv", self.columns())
        if self.tracking is not None:
            write_columns(folder / "corrected.csv", self.corrected_columns())
        if (name := path_file(self.robot.chain, self.options.controller)) is not None:
            program = path_program(self.robot.chain, self.options.controller, path_moves(self))
            (folder / name).write_bytes(program)
        self.report(folder / "report.html")
        if not self.options.no_recording:
            record_trajectory(folder / "recording.rrd", self)


def _steady(quaternions: Array) -> Array:
    """Quaternions ``(k, 4)`` of the same rotations, without a change of sign from one to the next."""
    turned = np.where((quaternions[1:] * quaternions[:-1]).sum(axis=1) < 0, -1.0, 1.0)
    return np.asarray(quaternions * np.cumprod(np.append(1.0, turned))[:, None])


def _mean_and_max(error: Array) -> dict[str, float | None]:
    """Of the lengths of places missed ``(k, 6)``, mm."""
    lengths = 1e3 * np.linalg.norm(error[:, :3], axis=1)
    return {"mean": number(float(lengths.mean())), "max": number(float(lengths.max()))}


def _told(chain: JointSpec, values: Array) -> list[float | None]:
    return [tidy(value) if np.isfinite(value) else None for value in joint_values(chain.prismatic, values)]
