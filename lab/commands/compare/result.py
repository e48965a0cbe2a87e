"""What a comparison of calibrations found: typed, and as plain values."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from lab.commands.calibrate.load_run import CalibrationRun
from lab.commands.compare.options import CompareOptions
from lab.commands.result import Result
from lab.core.significance import VERIFICATION
from lab.verification.difference import Difference

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from lab.render.document import Document

__all__ = ["ComparisonResult"]


@dataclass(frozen=True, repr=False, eq=False)
class ComparisonResult(Result):
    """How later calibrations of a robot differ from the first.

    Attributes:
        options: what was asked.
        runs: the calibrations, the first one the reference.
        differences: of each later run from the first.
        serial: the serial number of the arm; None where no run states it.
    """

    options: CompareOptions
    runs: tuple[CalibrationRun, ...]
    differences: tuple[Difference, ...]
    serial: str | None = None

    @property
    def warnings(self) -> tuple[str, ...]:
        """Those of the runs."""
        return tuple(dict.fromkeys(said for run in self.runs for said in run.named_warnings))

    @property
    def exit_code(self) -> int:
        """1 where the links of a later run have changed, else 0."""
        return 1 if any(each.changed for each in self.differences) else 0

    def to_dict(self) -> dict[str, Any]:
        """What ``--json`` prints: differences in SI units."""
        first, *later = self.runs
        return {
            "robot": first.robot.name,
            "serial": self.serial,
            "run": str(first.folder),
            "level": VERIFICATION,
            "compared": [
                {
                    "run": str(run.folder),
                    "changed": each.changed,
                    "p": each.p,
                    "moved": list(each.moved),
                    "differences": {
                        name: {"change": change, "interval_95": [change - half, change + half]}
                        for name, change, half in zip(
                            each.names, each.changes.tolist(), each.half_widths.tolist(), strict=True
                        )
                    },
                }
                for run, each in zip(later, self.differences, strict=True)
            ],
            "warnings": list(self.warnings),
        }

    def document(self) -> "Document":
        """What a person reads: whether anything has moved, what, and every difference with its interval."""
        from lab.commands.compare.document import comparison_document

        return comparison_document(self)

    def columns(self) -> Mapping[str, Sequence[Any]]:
        """A row for each later run and parameter: change and half of its 95 % interval, in SI units."""
        pairs = list(zip(self.runs[1:], self.differences, strict=True))
        return {
            "run": [str(run.folder) for run, each in pairs for _ in each.names],
            "parameter": [name for _, each in pairs for name in each.names],
            "change": [value for _, each in pairs for value in each.changes.tolist()],
            "half_width_95": [value for _, each in pairs for value in each.half_widths.tolist()],
        }

    def plot(self) -> "Figure":
        """Draw the differences of the last run from the first, each in the halves of its 95 % interval."""
        from lab.commands.compare.document import differences_picture

        return differences_picture(self).draw()

    def write(self, folder: Path) -> None:
        """Write ``config.json``, ``result.json`` and ``report.html``."""
        from lab.commands.run_folder import write_config, write_json

        write_config(folder, "compare", self.options, self.runs[0].robot.sha256)
        write_json(folder / "result.json", self.to_dict())
        self.report(folder / "report.html")
