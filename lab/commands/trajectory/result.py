"""A motion of a robot: typed, and as plain values."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from lab.campaign.robot import Robot
from lab.commands.inspect.format import tidy
from lab.commands.result import Result
from lab.commands.trajectory.motion import Leg
from lab.commands.trajectory.options import TrajectoryOptions
from lab.commands.values import joint_values, number
from lab.core.se3 import Array
from lab.formats.csv_table import write_columns
from lab.kinematics.joints import JointSpec
from lab.kinematics.trajectory.motion import Motion

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
    """

    times: Array
    joints: Array
    speeds: Array
    accelerations: Array
    Ts_base_tool: Array


@dataclass(frozen=True, repr=False, eq=False)
class TrajectoryResult(Result):
    """How a robot moves through some points.

    Attributes:
        options: what was asked.
        chain: the joints, with the speeds and accelerations that were kept.
        legs: the parts of the motion.
    """

    options: TrajectoryOptions
    robot: Robot
    chain: JointSpec
    legs: tuple[Leg, ...]
    warnings: tuple[str, ...]

    @property
    def exit_code(self) -> int:
        """0: what cannot be moved is refused."""
        return 0

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
        return Sampled(times, joints, speeds, accelerations, Ts)

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
            "warnings": list(self.warnings),
        }

    def document(self) -> "Document":
        """What a person reads: how long each move takes, how near the joints come to their limits, and the curves."""
        from lab.commands.trajectory.document import trajectory_document

        return trajectory_document(self)

    def columns(self) -> Mapping[str, Sequence[Any]]:
        """A row for each time: joint positions, speeds and accelerations, and the tool's position, mm and degrees."""
        chain, sampled = self.robot.chain, self.sampled
        table: dict[str, Sequence[Any]] = {"time_s": sampled.times.tolist()}
        names = [
            (name, "mm" if slides else "deg") for name, slides in zip(chain.joint_names, chain.prismatic, strict=True)
        ]
        parts = ((sampled.joints, "{0}_{1}"), (sampled.speeds, "speed_{0}_{1}_per_s"),
                 (sampled.accelerations, "acceleration_{0}_{1}_per_s2"))  # fmt: skip
        for values, heading in parts:
            for (name, unit), column in zip(names, joint_values(chain.prismatic, values).T, strict=True):
                table[heading.format(name, unit)] = column.tolist()
        for i, axis in enumerate("xyz"):
            table[f"tool_{axis}_mm"] = (1e3 * sampled.Ts_base_tool[:, i, 3]).tolist()
        return table

    def plot(self) -> "Figure":
        """Draw the joint positions over time."""
        from lab.commands.trajectory.document import curve_pictures

        return curve_pictures(self)[0].draw()

    def write(self, folder: Path) -> None:
        """Write ``config.json``, ``result.json``, ``trajectory.csv``, ``report.html`` and ``recording.rrd``."""
        from lab.commands.run_folder import config, write_json
        from lab.commands.trajectory.recording import record_trajectory

        write_json(folder / "config.json", config("trajectory", self.options, self.robot.sha256))
        write_json(folder / "result.json", self.to_dict())
        write_columns(folder / "trajectory.csv", self.columns())
        self.report(folder / "report.html")
        record_trajectory(folder / "recording.rrd", self)


def _told(chain: JointSpec, values: Array) -> list[float]:
    return [tidy(value) for value in joint_values(chain.prismatic, values)]
