"""Options of ``lab workspace``."""

from dataclasses import dataclass
from pathlib import Path

import tyro

from lab.core.errors import LabError
from lab.core.limits import OPTION_SIZE, ORIENTATIONS, PLACES, SEED, whole
from lab.core.se3 import Array
from lab.extensions.robotics.kinematics.kinematics_options import tool_point
from lab.options.option_types import Flag, Numbers

__all__ = ["WorkspaceOptions"]

_CARRIERS = tuple(f"carrier/{name}" for name in ("cartesian", "cylindrical", "spherical", "scara", "anthropomorphic"))
_FEWEST_PLACES = 100


@dataclass(frozen=True)
class WorkspaceOptions:
    """Robots, and how closely their workspaces are measured."""

    robots: tyro.conf.Positional[tuple[str, ...]] = ("irb120",)
    """Models' names, or paths to an MJCF, a URDF, or a TOML table or mechanism; several are compared. carriers: the
    five classical carriers."""
    cell: Path | None = None
    """The cell (obstacles, narrower limits): TOML. Adds the workspace without collisions."""
    tool_mm: Numbers = ()
    """The tool's point in the last frame, or the platform's: x,y,z; by default its origin."""
    places: int | None = None
    """Random places that are tested; by default as many as take a few seconds."""
    orientations: int = 60
    """Orientations that are tried at a place."""
    level_mm: float | None = None
    """The height of the horizontal section in the base; by default the middle of what is reached."""
    seed: int = 0
    """Random seed of the places."""
    out: Path | None = None
    """A folder for the result, a report, meshes and a table; by default nothing is written."""
    overwrite: Flag = False
    """Replace an earlier run in that folder."""

    def check(self) -> None:
        """Refuse numbers that make no sense, with a LabError that names the option."""
        if not self.robots:
            raise LabError("name a robot, or several to compare")
        if self.places is not None:
            whole("--places", self.places, _FEWEST_PLACES, PLACES)
        whole("--orientations", self.orientations, 1, ORIENTATIONS)
        whole("--seed", self.seed, 0, SEED)
        tool_point(self.tool_mm)
        if self.level_mm is not None and abs(self.level_mm) not in OPTION_SIZE:
            raise LabError(f"--level-mm {self.level_mm:g}: give a finite number in mm, at most {OPTION_SIZE.most:g}")
        if self.cell is not None and len(self.named) > 1:
            raise LabError("--cell: a cell stands around one robot; name one")

    @property
    def named(self) -> tuple[str, ...]:
        """Names of the robots, each once."""
        every = (name for robot in self.robots for name in (_CARRIERS if robot == "carriers" else (robot,)))
        return tuple(dict.fromkeys(every))

    @property
    def tool_m(self) -> Array:
        """Tool point ``(3,)`` m in the last frame."""
        return tool_point(self.tool_mm)
