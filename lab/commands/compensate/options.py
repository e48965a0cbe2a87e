"""What can be asked of ``lab compensate``."""

from dataclasses import dataclass
from pathlib import Path

import tyro

from lab.campaign.option_groups import Flag
from lab.core.orientation import AngleConvention
from lab.formats.programs.registry import Controller

__all__ = ["CompensateOptions"]


@dataclass(frozen=True)
class CompensateOptions:
    """Which targets to correct, for which calibrated arm."""

    targets: tyro.conf.Positional[Path]
    """Where the tool is to be, in the frame in which the arm was measured: CSV."""
    run: Path
    """The folder of a run of lab calibrate or lab identify."""
    orientation: AngleConvention | None = None
    """What the targets' angles rx, ry, rz mean."""
    force: Flag = False
    """Also for a run whose verdict is bad or not judged; of a doubtful one the result repeats the reasons."""
    accept_edited: Flag = False
    """Build on a run too whose files were changed since it was written."""
    cell: Path | None = None
    """What stands around the robot, and its narrower limits: TOML; that of the run, if not given."""
    controller: Controller | None = None
    """The language of its program; that of the robot's maker, if not given and known by the robot's name."""
    no_check: Flag = False
    """Check nothing for collisions: neither the corrected targets nor the ways between them."""
    load: Path | None = None
    """The folder of a run of lab payload: what the arm carries at each target (as heavy as payload_kg, where given)."""
