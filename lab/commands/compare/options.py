"""Options of ``lab compare``."""

from dataclasses import dataclass
from pathlib import Path

import tyro

from lab.campaign.option_types import Flag
from lab.core.errors import LabError

__all__ = ["CompareOptions"]


@dataclass(frozen=True)
class CompareOptions:
    """Which calibrations of a robot to compare."""

    runs: tyro.conf.Positional[tuple[Path, ...]]
    """The folders of two or more runs of lab calibrate or lab identify, the earliest first."""
    force: Flag = False
    """Also compare runs whose verdict is bad or not judged."""
    accept_edited: Flag = False
    """Also read runs whose files were edited after writing."""

    def check(self) -> None:
        """Refuse fewer than two runs, with a LabError."""
        if len(self.runs) < 2:
            raise LabError("lab compare: give the folders of two or more runs")
