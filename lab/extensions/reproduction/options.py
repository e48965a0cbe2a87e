"""Options of ``lab reproduce``."""

from dataclasses import dataclass
from pathlib import Path

import tyro

from lab.campaign.option_types import Flag
from lab.core.errors import LabError
from lab.extensions.reproduction.item import SourceName

__all__ = ["ReproduceOptions"]


@dataclass(frozen=True)
class ReproduceOptions:
    """Options: the source, and whether its answers are shown, asked, or marked."""

    source: tyro.conf.Positional[SourceName]
    """thesis: Mahdadi and Bouafia 2020; elastic: Benmisra 2007; course: Mallem 2011; staubli: the RX 130 and TX 40."""
    item: str | None = None
    """Only the items of this number (8.6, III.24, "Table IV.2") or chapter (8, III)."""
    exercise: Flag = False
    """Ask: leave the answers blank, with hints, and write exercise.csv with one row per answer."""
    solution: Flag = False
    """Of --exercise: show the solutions as well."""
    mark: Path | None = None
    """An exercise.csv that was filled in: say which of its answers are right."""

    def check(self) -> None:
        """Refuse --exercise together with --mark, and --solution without --exercise, with a LabError."""
        if self.exercise and self.mark is not None:
            raise LabError("--exercise writes the blanks and --mark reads the answers; give one of them")
        if self.solution and not self.exercise:
            raise LabError("--solution adds the solutions to an exercise; give --exercise too")
