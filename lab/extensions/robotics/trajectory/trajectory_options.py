"""Options of ``lab trajectory``."""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

import numpy as np
import tyro

from lab.core.errors import LabError
from lab.core.limits import PAYLOAD_KG, POSITIVE_OPTION, positive
from lab.core.orientation import AngleConvention
from lab.core.se3 import Array
from lab.extensions.robotics.kinematics.kinematics_options import tool_point
from lab.extensions.robotics.trajectory.cartesian import Feed
from lab.formats.programs.languages import Controller
from lab.kinematics.joints import JointSpec
from lab.options.option_types import Flag, NoRecording, Numbers

__all__ = ["TrajectoryOptions"]


@dataclass(frozen=True)
class TrajectoryOptions:
    """Points through which a robot moves, and its limits of speed."""

    points: tyro.conf.Positional[Path]
    """CSV, a row a point: joint positions, or x_mm, y_mm, z_mm of the tool; and how it moves there."""
    robot: str = "irb120"
    """A model's name, or a path to an MJCF, a URDF, or a TOML table or mechanism."""
    law: Literal["common", "own", "independent"] = "common"
    """Moves of the joints: common phases (straight), own phases of each, or not synchronised."""
    blend_mm: float | None = None
    """Pass joint points without a stop; slides miss them by at most so much. Joints that turn: --blend-deg."""
    blend_deg: float | None = None
    """The same for joints that turn, °."""
    speeds: Numbers = ()
    """Largest speeds of the joints, ° (mm of a slide) per s; one for all, or one each; by default the robot's."""
    accelerations: Numbers = ()
    """Largest accelerations of the joints, ° (mm of a slide) per s²; one for all, or one each."""
    feed_mm_s: float = 250.0
    """Largest speed of the tool on lines and circles."""
    feed_mm_s2: float = 2000.0
    """Largest acceleration of the tool along lines and circles."""
    turn_deg_s: float = 90.0
    """Largest speed of the tool's turn on lines and circles; in half a second it is there."""
    orientation: AngleConvention | None = None
    """Convention of three angles in the file."""
    tool_mm: Numbers = ()
    """The tool's point in the last frame, or the platform's: x,y,z; by default its origin."""
    step_ms: float = 10.0
    """Time between the rows of trajectory.csv."""
    cell: Path | None = None
    """The cell (obstacles, narrower limits): TOML; that of the run by default."""
    no_check: Flag = False
    """Check nothing for collisions."""
    controller: Controller | None = None
    """The language of its program; that of the robot's maker, by default, if the robot's name shows it."""
    run: Path | None = None
    """The folder of a run of lab calibrate or lab identify: the path errors of its robot, and joint positions that
    correct them. Its robot is taken."""
    payload_kg: float | None = None
    """Payload mass along the whole path; that of --load, if not given."""
    load: Path | None = None
    """The folder of a run of lab payload: where the payload hangs, and how heavy it is."""
    no_recording: NoRecording = False
    force: Flag = False
    """Also for a run whose verdict is bad or not judged."""
    accept_edited: Flag = False
    """Also accept a run whose files were edited after writing."""

    def check(self) -> None:
        """Refuse numbers that make no sense, with a LabError that names the option."""
        for flag in ("feed_mm_s", "feed_mm_s2", "turn_deg_s", "step_ms", "blend_mm", "blend_deg"):
            if getattr(self, flag) is not None:
                positive(f"--{flag.replace('_', '-')}", getattr(self, flag))
        if self.payload_kg is not None and self.payload_kg not in PAYLOAD_KG:
            raise LabError(f"--payload-kg: {self.payload_kg:g}; give {PAYLOAD_KG.shown}")
        if self.run is not None and self.tool_mm:
            raise LabError("--tool-mm and --run: the run has the tool that it measured; leave out one")
        tool_point(self.tool_mm)

    @property
    def feed(self) -> Feed:
        """Return the limits of the tool's motion along lines and circles."""
        turn = np.deg2rad(self.turn_deg_s)
        return Feed(self.feed_mm_s / 1e3, self.feed_mm_s2 / 1e3, float(turn), float(2 * turn))

    @property
    def tool_m(self) -> Array:
        """Tool point ``(3,)`` m in the last frame."""
        return tool_point(self.tool_mm)

    def blend(self, chain: JointSpec) -> Array | None:
        """Return the distance ``(n,)`` by which each joint may miss points, rad or m; None where it stops at them.

        Raises:
            LabError: a joint has no such number.
        """
        if self.blend_mm is None and self.blend_deg is None:
            return None
        slides, turns = self.blend_mm, self.blend_deg
        for flag, given, kind in (("--blend-mm", slides, True), ("--blend-deg", turns, False)):
            if given is None and kind in chain.prismatic:
                raise LabError(f"robot {chain.name} has joints that {'slide' if kind else 'turn'}: give {flag} too")
        return np.where(chain.prismatic, 1e-3 * (slides or 0.0), np.deg2rad(turns or 0.0))

    def rated(self, chain: JointSpec) -> JointSpec:
        """Return the joints with the given speeds and accelerations.

        Raises:
            LabError: there are not as many as joints, or one is not above zero.
        """
        scale = np.where(chain.prismatic, 1e-3, np.pi / 180)
        found = dict[str, Array]()
        for name, given in (("speed", self.speeds), ("acceleration", self.accelerations)):
            if not given:
                continue
            if len(given) not in (1, chain.size) or not all(each in POSITIVE_OPTION for each in given):
                raise LabError(f"--{name}s: give one number above zero for all joints, or {chain.size} of them")
            found[name] = np.broadcast_to(given, chain.size) * scale
        return replace(
            chain,
            speed=found.get("speed", chain.speed),
            acceleration=found.get("acceleration", chain.acceleration),
        )
