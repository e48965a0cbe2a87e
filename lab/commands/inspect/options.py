"""Options of ``lab inspect``."""

from dataclasses import dataclass
from pathlib import Path

import tyro

from lab.campaign.option_groups import Fitting
from lab.campaign.option_types import Names, Numbers
from lab.core.errors import LabError

__all__ = ["InspectOptions"]


@dataclass(frozen=True)
class InspectOptions:
    """A robot, and what is to be identified of it."""

    robot: tyro.conf.Positional[str] = "irb120"
    """A model's name, or a path to an MJCF, a URDF, or a TOML table or mechanism."""
    cell: Path | None = None
    """The cell (obstacles, payload, narrower limits, instrument's position): TOML."""
    targets: Names = ("p1",)
    """Measured points of the tool."""
    tool_mm: Numbers = ()
    """Where the first of them is in the last frame; by default on the robot's tool."""
    model: str = "geometric"
    """geometric, or groups of effects joined by +."""
    fix: Names = ()
    """Fix these parameters at nominal: names or patterns."""
    free: Names = ()
    """Identify these parameters, which are usually fixed, in the place of fixed ones."""

    @property
    def groups(self) -> tuple[str, ...]:
        """The groups of effects that are asked for.

        Raises:
            LabError: one is given twice, or they are to be chosen by measurements, which there are none of.
        """
        fitting = Fitting(self.model, fix=self.fix, free=self.free)
        fitting.check()
        if self.model == "auto":
            raise LabError("--model auto: groups are chosen by measurements; name groups to inspect")
        return fitting.groups
