"""A certificate: typed, and as plain values."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from lab.calibration.verdict import gate_words
from lab.certification.budget import COVERAGE, Budget, BudgetLine
from lab.certification.characteristics import CHARACTERISTICS, Accuracy, PoseCharacteristics
from lab.certification.conformity import Conformity
from lab.commands.calibrate.load_run import Calibrated
from lab.commands.certify.options import CertifyOptions
from lab.commands.result import Result
from lab.commands.values import ErrorStatistics, error_statistics, number
from lab.compensation.iso9283 import CYCLES
from lab.core.instruments import Instrument
from lab.core.se3 import Array
from lab.formats.certificate_toml import CertificateDetails

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from lab.render.document import Document

__all__ = ["Certificate", "RobotFound", "not_measured"]


@dataclass(frozen=True)
class RobotFound:
    """What the measured points say of the robot.

    Attributes:
        before, after: pose accuracy and repeatability, commanded through the nominal and the calibrated model.
        distances_before, distances_after: errors of distances (m), measured less commanded.
        of_fitted_rows: whether the parameters were identified from the same rows.
    """

    before: PoseCharacteristics
    after: PoseCharacteristics
    distances_before: Array
    distances_after: Array
    of_fitted_rows: bool


@dataclass(frozen=True, repr=False, eq=False)
class Certificate(Result):
    """A calibration's certificate.

    Attributes:
        options: what was asked.
        calibrated: the run.
        details: who measured what, when, where and with which instrument.
        device: the instrument; None where it is not known.
        budgets: of a position, and of a distance between two.
        robot: how the robot was found.
        conformity: None without a tolerance, or without validation.
        poses: how many were fitted.
    """

    options: CertifyOptions
    calibrated: Calibrated
    details: CertificateDetails
    device: Instrument | None
    budgets: tuple[Budget, ...]
    robot: RobotFound
    conformity: Conformity | None
    warnings: tuple[str, ...]
    poses: int

    @property
    def exit_code(self) -> int:
        """1 where the robot does not conform, or that cannot be decided, else 0."""
        return 0 if self.conformity is None or self.conformity.decision == "conforms" else 1

    @property
    def distances(self) -> tuple[ErrorStatistics, ErrorStatistics] | None:
        """Errors of distances before and after; None where there is one pose only."""
        before, after = self.robot.distances_before, self.robot.distances_after
        return (error_statistics(np.abs(before)), error_statistics(np.abs(after))) if before.size else None

    def to_dict(self) -> dict[str, Any]:
        """What ``--json`` prints: lengths in mm, other quantities in the units that they name."""
        from lab.commands.run_folder import SCHEMA

        result = self.calibrated.result
        return {
            "schema": SCHEMA,
            "run": str(self.calibrated.folder),
            "robot": self.calibrated.robot.name,
            "poses": self.poses,
            "run_verdict": result.to_dict(),
            "details": self.details.to_dict(),
            "missing": list(self.details.missing),
            "instrument": None if self.device is None else self.device.name,
            "validated_on": result.judged_by,
            "before_mm": _statistics_to_dict(result.before_mm),
            "after_mm": _statistics_to_dict(result.after_mm),
            "coverage": COVERAGE,
            "budgets": {each.measurand: _budget_to_dict(each) for each in self.budgets},
            "conformity": None if self.conformity is None else self._conformity_to_dict(self.conformity),
            "iso_9283": self._iso_to_dict(),
            "warnings": list(self.warnings),
        }

    def document(self) -> "Document":
        """What a person reads, prints and signs."""
        from lab.commands.certify.document import certificate_document

        return certificate_document(self)

    def columns(self) -> Mapping[str, Sequence[Any]]:
        """The lines of both budgets."""
        rows = [(budget, line) for budget in self.budgets for line in budget.lines]
        return {
            "measurand": [budget.measurand for budget, _ in rows],
            "quantity": [line.quantity.words for _, line in rows],
            "contribution_mm": [1e3 * line.contribution_m for _, line in rows],
            "share": [line.share for _, line in rows],
        }

    def plot(self) -> "Figure":
        """Draw what each quantity contributes to the uncertainty of a position."""
        from lab.commands.certify.document import contributions_picture

        return contributions_picture(self.budgets[0]).draw()

    def write(self, folder: Path) -> None:
        """Write ``config.json``, ``result.json`` and ``report.html``."""
        from lab.commands.run_folder import write_config, write_json

        write_config(folder, "certify", self.options, self.calibrated.robot.sha256)
        write_json(folder / "result.json", self.to_dict())
        self.report(folder / "report.html")

    def _conformity_to_dict(self, found: Conformity) -> dict[str, Any]:
        return {
            "statistic": self.options.statistic,
            "value_mm": 1e3 * found.value_m,
            "tolerance_mm": 1e3 * found.tolerance_m,
            "expanded_mm": 1e3 * found.expanded_m,
            "rule": found.rule,
            "rule_words": found.words,
            "decision": found.decision,
            "gate": gate_words(self.calibrated.result.gate_mm),
        }

    def _iso_to_dict(self) -> dict[str, Any]:
        robot, distances = self.robot, self.distances
        return {
            "of_fitted_rows": robot.of_fitted_rows,
            "poses": robot.after.poses,
            "cycles": list(robot.after.cycles),
            "cycles_of_the_standard": CYCLES,
            "pose_accuracy_before_mm": _accuracy_to_dict(robot.before.accuracy),
            "pose_accuracy_mm": _accuracy_to_dict(robot.after.accuracy),
            "pose_repeatability_mm": _accuracy_to_dict(robot.after.repeatability),
            "distance_accuracy_before_mm": None if distances is None else distances[0].to_dict(),
            "distance_accuracy_mm": None if distances is None else distances[1].to_dict(),
            "not_measured": list(not_measured(robot)),
        }


def not_measured(robot: RobotFound) -> tuple[str, ...]:
    """The standard's characteristics that these measurements say nothing of."""
    unrepeated = () if robot.after.repeatability is not None else ("pose repeatability",)
    return (*unrepeated, *CHARACTERISTICS)


def _statistics_to_dict(found: Mapping[str, float] | None) -> dict[str, float | int] | None:
    """As the run has them, the count a whole number."""
    return None if found is None else {name: int(v) if name == "count" else v for name, v in found.items()}


def _accuracy_to_dict(found: Accuracy | None) -> dict[str, float] | None:
    return None if found is None else {"mean": 1e3 * found.mean_m, "max": 1e3 * found.largest_m}


def _budget_to_dict(budget: Budget) -> dict[str, Any]:
    return {
        "lines": [_line_to_dict(line) for line in budget.lines],
        "combined_mm": 1e3 * budget.combined_m,
        "freedom": number(budget.freedom),
        "coverage_factor": budget.coverage_factor,
        "expanded_mm": 1e3 * budget.expanded_m,
        "propagated_mm": 1e3 * budget.propagated_m,
        "monte_carlo_mm": 1e3 * budget.drawn_m,
        "monte_carlo_std_mm": 1e3 * budget.drawn_std_m,
        "monte_carlo_draws": budget.draws,
        "tolerance_mm": 1e3 * budget.tolerance_m,
        "agrees": budget.agrees,
        "kinematics": {
            "linear_mm": 1e3 * budget.kinematics.linear_m,
            "full_mm": 1e3 * budget.kinematics.full_m,
            "draws": budget.kinematics.draws,
            "is_linear": budget.is_linear,
        },
    }


def _line_to_dict(line: BudgetLine) -> dict[str, Any]:
    quantity = line.quantity
    return {
        "group": quantity.group,
        "quantity": quantity.words,
        "source": quantity.source,
        "distribution": quantity.uncertainty.distribution,
        "unit": quantity.unit,
        "standard_uncertainty": quantity.factor * quantity.uncertainty.standard,
        "freedom": number(quantity.uncertainty.freedom),
        "sensitivity_mm_per_unit": 1e3 * line.sensitivity / quantity.factor,
        "contribution_mm": 1e3 * line.contribution_m,
        "share": line.share,
    }
