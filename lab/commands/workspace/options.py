"""What can be asked of ``lab workspace``."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import tyro

from lab.campaign.option_groups import Flag, Numbers
from lab.core.errors import LabError
from lab.core.numbers import LARGEST
from lab.core.se3 import Array

__all__ = ["CARRIERS", "WorkspaceOptions"]

CARRIERS = tuple(f"carrier/{name}" for name in ("cartesian", "cylindrical", "spherical", "scara", "anthropomorphic"))
_MOST_PLACES, _MOST_ORIENTATIONS = 2_000_000, 10_000


@dataclass(frozen=True)
class WorkspaceOptions:
    """Robots, and how closely their workspaces are looked at."""

    robots: tyro.conf.Positional[tuple[str, ...]] = ("irb120",)
    """Models' names, or paths to an MJCF, a URDF, or a TOML table or mechanism; several are compared. carriers: the
    five classical carriers."""
    cell: Path | None = None
    """What stands around the robot, its narrower limits: TOML. Then also what is reached without a collision."""
    tool_mm: Numbers = ()
    """The tool's point in the last frame, or the platform's: x,y,z; by default its origin."""
    places: int | None = None
    """Random places that are looked at; by default as many as take a few seconds."""
    orientations: int = 60
    """Orientations that are tried at a place."""
    level_mm: float | None = None
    """The height of the horizontal section in the base; by default the middle of what is reached."""
    seed: int = 0
    """Of the random places."""
    out: Path | None = None
    """A folder for the result, a report, a recording, meshes and a table; by default nothing is written."""
    overwrite: Flag = False
    """Replace an earlier run in that folder."""

    def check(self) -> None:
        """Refuse numbers that make no sense, with a LabError that names the option."""
        if not self.robots:
            raise LabError("name a robot, or several to compare")
        if self.places is not None and not 100 <= self.places <= _MOST_PLACES:
            raise LabError(f"--places {self.places}: give a whole number from 100 to {_MOST_PLACES:,}")
        if not 1 <= self.orientations <= _MOST_ORIENTATIONS:
            raise LabError(f"--orientations {self.orientations}: give a whole number from 1 to {_MOST_ORIENTATIONS:,}")
        if self.tool_mm and (len(self.tool_mm) != 3 or not all(abs(each) <= LARGEST for each in self.tool_mm)):
            raise LabError("--tool-mm: give x,y,z of the tool's point in the last frame, e.g. 0,0,100")
        if self.level_mm is not None and not abs(self.level_mm) <= LARGEST:
            raise LabError(f"--level-mm {self.level_mm:g}: give a finite number in mm, at most {LARGEST:g}")
        if self.cell is not None and len(self.named) > 1:
            raise LabError("--cell: a cell stands around one robot; name one")

    @property
    def named(self) -> tuple[str, ...]:
        """The robots, each once."""
        every = (name for robot in self.robots for name in (CARRIERS if robot == "carriers" else (robot,)))
        return tuple(dict.fromkeys(every))

    @property
    def tool_m(self) -> Array:
        """The tool's point ``(3,)`` m in the last frame."""
        return np.array(self.tool_mm) / 1e3 if self.tool_mm else np.zeros(3)
