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
    """Ask the questions of --item and write exercise.csv, with a row per answer; without --item, list what there is."""
    solution: Flag = False
    """Of --exercise and --mark: show the solutions with their steps."""
    mark: Path | None = None
    """An exercise.csv that was filled in: mark each answer, with a hint where one is wrong."""

    @property
    def lists_only(self) -> bool:
        """True of the list of exercises, which is no run."""
        return self.exercise and self.item is None

    def check(self) -> None:
        """Refuse --exercise together with --mark, and --solution without either, with a LabError."""
        if self.exercise and self.mark is not None:
            raise LabError("--exercise writes the blanks and --mark reads the answers; give one of them")
        if self.solution and not self.exercise and self.mark is None:
            raise LabError("--solution adds the solutions to an exercise; give --exercise too")
        if self.solution and self.exercise and self.item is None:
            raise LabError("--solution shows the solutions of chosen items; give --item too")
        if self.mark is not None and not self.mark.exists():
            raise LabError(f"{self.mark}: cannot be read (no such file); give the exercise.csv of a run's folder")
