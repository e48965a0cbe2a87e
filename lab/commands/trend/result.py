"""What the history of a robot's calibrations shows: typed, and as plain values."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import date
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from lab.calibration.estimate import IdentifiedSubset
from lab.commands.calibrate.load_run import CalibrationRun
from lab.commands.result import Result
from lab.commands.trend.options import TrendOptions
from lab.commands.values import number
from lab.core.linear_model import half_width_95
from lab.core.se3 import Array
from lab.core.significance import TREND_YEAR
from lab.kinematics.parameter import Parameter
from lab.verification.change_points import POWER, ChangePoint

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from lab.render.document import Document

__all__ = ["DatedRun", "DetectableChange", "TrendResult"]


@dataclass(frozen=True)
class DatedRun:
    """A calibration and its day."""

    date: date
    run: CalibrationRun


@dataclass(frozen=True)
class DetectableChange:
    """How far a joint's zero has to move for one more calibration to find it in 95 of 100 (rad; m of a slide).

    Attributes:
        joint: counted from one.
        slides: whether it is prismatic.
        links_alone: where only the links are compared (and what else is kept); infinite where that does not show it.
        all_kept: where neither base nor tool was set up anew.
    """

    joint: int
    slides: bool
    links_alone: float
    all_kept: float

    @property
    def unit(self) -> str:
        """In which a person reads it."""
        return "mm" if self.slides else "mrad"


@dataclass(frozen=True, repr=False, eq=False)
class TrendResult(Result):
    """The calibrations of a robot in order, and the changes between them.

    Attributes:
        options: what was asked.
        runs: the calibrations, in the order of their days.
        estimates: of each the compared parameters.
        changes: between them, in order.
        detectable: of each joint.
        left_out: what of the folder was not taken, a sentence each.
        serial: the serial number of the arm; None where no run states it.
    """

    options: TrendOptions
    runs: tuple[DatedRun, ...]
    estimates: tuple[IdentifiedSubset, ...]
    changes: tuple[ChangePoint, ...]
    detectable: tuple[DetectableChange, ...]
    left_out: tuple[str, ...]
    serial: str | None = None

    @property
    def warnings(self) -> tuple[str, ...]:
        """What was left out, and those of the runs."""
        said = [words for each in self.runs for words in each.run.named_warnings]
        return tuple(dict.fromkeys([*self.left_out, *said]))

    @property
    def exit_code(self) -> int:
        """1 where the robot has changed, else 0."""
        return 1 if self.changes else 0

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """Those that are compared."""
        of = {each.name: each for each in self.runs[0].run.estimate.arm.parameters}
        return tuple(of[name] for name in self.estimates[0].names)

    @property
    def shifts(self) -> Array:
        """Differences ``(n, f)`` of the parameters from the first calibration (SI), angles by less than half a turn."""
        values = np.array([each.values - self.estimates[0].values for each in self.estimates])
        turned = np.remainder(values + np.pi, 2 * np.pi) - np.pi
        return np.where(np.array(self.estimates[0].is_angle), turned, values)

    @property
    def half_widths(self) -> Array:
        """Of the parameters' 95 % intervals ``(n, f)``."""
        halves = [half_width_95(each.dof or np.inf) * np.sqrt(np.diag(each.covariance)) for each in self.estimates]
        return np.array(halves)

    def to_dict(self) -> dict[str, Any]:
        """What ``--json`` prints: parameters in SI units, errors in mm."""
        shifts, halves = self.shifts, self.half_widths
        return {
            "robot": self.runs[0].run.robot.name,
            "serial": self.serial,
            "folder": str(self.options.folder),
            "level_per_year": TREND_YEAR,
            "power": POWER,
            "runs": [
                {
                    "run": str(each.run.folder),
                    "date": each.date.isoformat(),
                    "verdict": each.run.result.verdict,
                    "gate_mm": each.run.result.gate_mm,
                    "after_mm": None if each.run.result.after_mm is None else dict(each.run.result.after_mm),
                }
                for each in self.runs
            ],
            "changes": [self._change_to_dict(each) for each in self.changes],
            "parameters": {
                name: {"change": shifts[:, i].tolist(), "half_width_95": halves[:, i].tolist()}
                for i, name in enumerate(self.estimates[0].names)
            },
            "minimum_detectable_change": {
                f"joint{each.joint}_{each.unit}": {
                    "set_up_anew": number(1e3 * each.links_alone),
                    "base_and_tool_kept": number(1e3 * each.all_kept),
                }
                for each in self.detectable
            },
            "warnings": list(self.warnings),
        }

    def _change_to_dict(self, change: ChangePoint) -> dict[str, Any]:
        before, after, found = (self.runs[i] for i in (change.after, change.after + 1, change.found_at))
        return {
            "between": [before.date.isoformat(), after.date.isoformat()],
            "runs": [str(before.run.folder), str(after.run.folder)],
            "found_by": str(found.run.folder),
            "named": [
                {"name": name, "change": size, "interval_95": [size - half, size + half]}
                for name, size, half in zip(change.named, change.changes, change.half_widths, strict=True)
            ],
            "several": change.several,
            "p": change.p,
            "level": change.level,
        }

    def document(self) -> "Document":
        """What a person reads: whether and when anything changed, what, and how the parameters went."""
        from lab.commands.trend.document import trend_document

        return trend_document(self)

    def columns(self) -> Mapping[str, Sequence[Any]]:
        """A row for each run and parameter: change since the first run and half of its 95 % interval, in SI units."""
        names, count = self.estimates[0].names, len(self.runs)
        return {
            "run": [str(each.run.folder) for each in self.runs for _ in names],
            "date": [each.date.isoformat() for each in self.runs for _ in names],
            "parameter": list(names) * count,
            "change": self.shifts.ravel().tolist(),
            "half_width_95": self.half_widths.ravel().tolist(),
        }

    def plot(self) -> "Figure":
        """Draw all parameters over time."""
        from lab.commands.trend.figures import parameters_picture

        return parameters_picture(self).draw()

    def write(self, folder: Path) -> None:
        """Write ``config.json``, ``result.json`` and ``report.html``."""
        from lab.commands.run_folder import write_config, write_json

        write_config(folder, "trend", self.options, self.runs[0].run.robot.sha256)
        write_json(folder / "result.json", self.to_dict())
        self.report(folder / "report.html")
