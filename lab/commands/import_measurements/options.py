"""Options of ``lab import``."""

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import tyro

from lab.campaign.option_types import Names
from lab.core.errors import LabError
from lab.core.limits import CLOCK_DRIFT_PPM, CLOCKS_S, TARGETS, checked_name, positive

__all__ = ["By", "ImportOptions"]

By = Literal["auto", "name", "order", "time"]


@dataclass(frozen=True)
class ImportOptions:
    """Which files to merge, and how."""

    points: tyro.conf.Positional[Path]
    """The tracker's export: SpatialAnalyzer, PolyWorks or Leica text, or plain name, x, y, z."""
    joints: Path
    """The controller's file: joint positions, a row for each pose, or a log over time."""
    robot: str = "irb120"
    """A model's name, or a path to an MJCF, a URDF, or a TOML table or mechanism."""
    by: By = "auto"
    """How points find their poses: by name, order or time; auto: names if both have them, else times, else order."""
    targets: Names = ("p1",)
    """The measured points of each pose, in the order of measurement."""
    unit: Literal["mm", "m", "in"] | None = None
    """The tracker's unit of lengths, if its file does not state it."""
    joint_unit: Literal["deg", "rad"] | None = None
    """The unit of joints that turn, if the controller's file does not state it."""
    coverage: float = 1.0
    """Coverage factor of the tracker's uncertainties: 2 if they are expanded with k = 2."""
    columns: Path | None = None
    """A TOML file that names the columns if the header does not."""
    clock_offset_s: float | None = None
    """By how much the tracker's clock is ahead of the controller's, at the first point. Without it they are taken to
    agree; where the points contradict that, the error proposes an offset."""
    clock_drift_ppm: float = 0.0
    """By how many millionths the tracker's clock runs faster than the controller's: up to 100."""
    still_deg_s: float = 0.1
    """In a log: the largest speed of a joint at rest, °/s (mm/s of a slide)."""
    settled_s: float = 0.5
    """In a log: the shortest rest at a pose."""
    station: str | None = None
    """The instrument's station, if there are several: it fills the column station and starts each id."""

    def check(self) -> None:
        """Refuse numbers and names that make no sense, with a LabError that names the option."""
        for flag in ("coverage", "still_deg_s", "settled_s"):
            positive(f"--{flag.replace('_', '-')}", getattr(self, flag))
        if not self.targets or len(set(self.targets)) < len(self.targets):
            raise LabError("--targets: give one name or more, each once, e.g. p1,p2,p3")
        TARGETS("--targets", self.targets)
        for name in self.targets:
            checked_name("--targets", name)
        if self.station is not None:
            checked_name("--station", self.station)
        if self.clock_offset_s is not None and abs(self.clock_offset_s) not in CLOCKS_S:
            raise LabError("--clock-offset-s: give the seconds between two clocks")
        CLOCK_DRIFT_PPM("--clock-drift-ppm: its size", abs(self.clock_drift_ppm))
