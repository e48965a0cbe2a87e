"""Options of ``lab migrate``."""

from dataclasses import dataclass
from pathlib import Path

import tyro

from lab.core.limits import day

__all__ = ["MigrateOptions"]


@dataclass(frozen=True)
class MigrateOptions:
    """Runs of an older lab."""

    folder: tyro.conf.Positional[Path]
    """The folder of a run, or the folder that holds the folders of runs."""
    date: str | None = None
    """Measurement date for a run without one, YYYY-MM-DD."""

    def check(self) -> None:
        """Refuse what is no day, with a LabError."""
        if self.date is not None:
            day("--date", self.date)
