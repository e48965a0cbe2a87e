"""Options of ``lab status``."""

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import tyro

from lab.campaign.option_types import Flag
from lab.core.limits import DAYS, day, whole

__all__ = ["StatusOptions"]


@dataclass(frozen=True)
class StatusOptions:
    """A folder of runs of one or many arms."""

    folder: tyro.conf.Positional[Path]
    """The folder that contains the runs, at any depth."""
    every_days: int = 35
    """An arm is due this many days after its last calibration or verification (five weeks suit a monthly check), and a
    bad one at once."""
    on: str | None = None
    """Date of the state, YYYY-MM-DD, today by default; later runs are ignored."""
    require: Literal["good"] | None = None
    """Exit with code 3 if no arm is bad but one is not good."""
    out: Path | None = None
    """A folder for the page, status.csv, result.json and status.prom; by default nothing is written."""
    overwrite: Flag = False
    """Replace an earlier run in that folder."""

    def check(self) -> None:
        """Refuse what is no day or no number of days, with a LabError."""
        whole("--every-days", self.every_days, 1, DAYS)
        if self.on is not None:
            day("--on", self.on)
