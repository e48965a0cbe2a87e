"""What a study found: typed, and as the files of its folder."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

from lab.commands.result import Result
from lab.commands.study.options import StudyOptions
from lab.core.errors import LabError
from lab.studies.analysis import Analysis
from lab.studies.run import StudyDone

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from lab.render.document import Document, Picture

__all__ = ["METRICS", "StudyResult"]

METRICS = ("fresh_mean_mm", "fresh_worst_mm")  # of the figures and the page; the CSV files have all


@dataclass(frozen=True, repr=False, eq=False)
class StudyResult(Result):
    """A study that is finished, and the analysis of its simulated calibrations.

    Attributes:
        options: what was asked.
        done: where the simulated calibrations are, and what this run added to them.
        analysis: means, comparisons and ranks.
    """

    options: StudyOptions
    done: StudyDone
    analysis: Analysis

    @property
    def warnings(self) -> tuple[str, ...]:
        """None: what did not converge is in the analysis."""
        return ()

    @property
    def exit_code(self) -> int:
        """Always 0: a study that cannot be finished is an error."""
        return 0

    @cached_property
    def pictures(self) -> "dict[str, Picture]":
        """All figures, by the names of their files."""
        from lab.commands.study.figures import study_pictures

        return {name: made for metric in METRICS for name, made in study_pictures(self.analysis, metric).items()}

    def to_dict(self) -> dict[str, Any]:
        """What ``--json`` prints."""
        return self.done.summary

    def document(self) -> "Document":
        """What a person reads: the answers, means, ranks and figures."""
        from lab.commands.study.document import study_document

        return study_document(self)

    def columns(self) -> Mapping[str, Sequence[Any]]:
        """The columns of ``means.csv``: a row for each cell and metric; NaN where there is no interval."""
        from lab.commands.study.files import mean_columns

        return mean_columns(self.analysis)

    def plot(self) -> "Figure":
        """Draw the means of the first factor that varies.

        Raises:
            LabError: nothing varies.
        """
        if not self.pictures:
            raise LabError("no factor of the study can be compared: there is nothing to draw; give a factor two levels")
        return next(iter(self.pictures.values())).draw()

    def write(self, folder: Path) -> None:
        """Write the analysis: means, pairs and ranks as CSV, the figures, and ``report.html``."""
        from lab.commands.study.figures import write_figures
        from lab.commands.study.files import write_csv

        write_csv(folder, self.analysis)
        write_figures(folder, self.pictures)
        self.report(folder / "report.html")
