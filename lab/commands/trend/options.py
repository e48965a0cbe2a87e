"""Options of ``lab trend``."""

from dataclasses import dataclass
from pathlib import Path

import tyro

from lab.calibration.estimate import SETUP
from lab.campaign.option_types import Flag, Names
from lab.core.errors import LabError
from lab.core.limits import check_serial

__all__ = ["TrendOptions"]


@dataclass(frozen=True)
class TrendOptions:
    """A folder of dated runs of one robot."""

    folder: tyro.conf.Positional[Path]
    """The folder that holds the folders of the runs of lab calibrate or lab identify, each made with --date."""
    kept: Names = ()
    """Parts that were not set up anew between the runs, to compare with the links: base, tool, or base,tool."""
    serial: str | None = None
    """Follow only the arm with this serial number, if the folder holds runs of several."""
    force: Flag = False
    """Also use runs whose verdict is bad or not judged."""
    accept_edited: Flag = False
    """Also read runs whose files were changed since they were written."""

    def check(self) -> None:
        """Refuse what is no part of the setup, with a LabError."""
        check_serial(self.serial)
        if stray := sorted(set(self.kept) - set(SETUP)):
            raise LabError(f"--kept {stray[0]}: unknown; give base, tool or base,tool")
