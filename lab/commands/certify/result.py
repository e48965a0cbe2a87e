"""A certificate: typed, and as plain values."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from lab.certification.budget import COVERAGE, Budget, BudgetLine, InputQuantity
from lab.certification.characteristics import CHARACTERISTICS, Accuracy, PoseAccuracy, Repeats
from lab.certification.conformity import Conformity
from lab.certification.lack_of_fit import LackOfFit
from lab.commands.calibrate.load_run import CalibrationRun
from lab.commands.certify.options import CertifyOptions
from lab.commands.result import Result
from lab.commands.values import ErrorStatistics, error_statistics, number
from lab.compensation.iso9283 import CYCLES
from lab.core.checks import Check
from lab.core.se3 import Array
from lab.formats.certificate_toml import CertificateDetails
from lab.noise.instruments import Instrument
from lab.render.phrases.registry import phrase
from lab.render.phrases.verdict import gate_words

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from lab.render.document import Document

__all__ = ["Certificate", "RobotFound", "Unseen", "not_measured"]


@dataclass(frozen=True)
class RobotFound:
    """What the measured points say of the robot.

    Attributes:
        before, after: pose accuracy, commanded through the nominal and the calibrated model; ``after`` is None where
            the parameters were identified from all rows, whose errors are no accuracy.
        distances_before, distances_after: errors of distances (m), measured less commanded; ``after`` empty likewise.
        repeats: of all rows, fitted or not; None where no pose was repeated.
        repeated_in: which rows have repeats.
    """

    before: PoseAccuracy
    after: PoseAccuracy | None
    distances_before: Array
    distances_after: Array
    repeats: Repeats | None
    repeated_in: tuple[str, ...]

    @property
    def of_fitted_rows(self) -> bool:
        """True where all rows were fitted, so that none shows the accuracy of the calibrated model."""
        return self.after is None


@dataclass(frozen=True)
class Unseen:
    """What neither the measurements nor the instrument's statements show, and how they would.

    Attributes:
        limit: its largest size in ``unit``.
        remedy: what to do, so that it is seen.
    """

    quantity: InputQuantity
    limit: float
    unit: str
    remedy: str

    @property
    def words(self) -> str:
        """The quantity with its size, for a person."""
        return f"{self.quantity.words}, up to {self.limit:.2g} {self.unit}"


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
        conformity: None without a tolerance, without validation, or where the certificate is not issued.
        poses: how many were fitted.
        implausible: details that cannot be right, or are unusual.
        validation: what validation shows beside the budget; None where the run was not validated.
        unseen: what U does not contain, as nothing shows it.
        with_unseen_m: expanded uncertainty of each budget's measurand with that, too.
    """

    options: CertifyOptions
    calibrated: CalibrationRun
    details: CertificateDetails
    device: Instrument | None
    budgets: tuple[Budget, ...]
    robot: RobotFound
    conformity: Conformity | None
    warnings: tuple[str, ...]
    poses: int
    implausible: tuple[Check, ...]
    validation: LackOfFit | None
    unseen: tuple[Unseen, ...]
    with_unseen_m: tuple[float, ...]

    @property
    def issued(self) -> bool:
        """True where the details allow a certificate."""
        return not any(each.outcome == "failed" for each in self.implausible)

    @property
    def exit_code(self) -> int:
        """1 where the robot does not conform, that cannot be decided, or the certificate is not issued, else 0."""
        return 0 if self.issued and (self.conformity is None or self.conformity.decision == "conforms") else 1

    @property
    def distances(self) -> tuple[ErrorStatistics | None, ErrorStatistics | None]:
        """Errors of distances before and after; None where there is one pose only, or all rows were fitted."""
        before, after = (
            error_statistics(np.abs(each)) if each.size else None
            for each in (self.robot.distances_before, self.robot.distances_after)
        )
        return before, after

    def to_dict(self) -> dict[str, Any]:
        """What ``--json`` prints: lengths in mm, other quantities in the units that they name."""
        from lab.commands.run_folder import SCHEMA

        result = self.calibrated.result
        return {
            "schema": SCHEMA,
            "run": str(self.calibrated.folder),
            "robot": self.calibrated.robot.name,
            "serial": self.calibrated.serial,
            "poses": self.poses,
            "run_verdict": result.to_dict(),
            "details": self.details.to_dict(),
            "missing": list(self.details.missing),
            "instrument": None if self.device is None else self.device.name,
            "validated_on": result.judged_by,
            "before_mm": _statistics_to_dict(result.before_mm),
            "after_mm": _statistics_to_dict(result.after_mm),
            "coverage": COVERAGE,
            "budgets": {
                each.measurand: _budget_to_dict(each) | {"expanded_with_unseen_mm": 1e3 * more}
                for each, more in zip(self.budgets, self.with_unseen_m, strict=True)
            },
            "validation": None if self.validation is None else _validation_to_dict(self.validation),
            "unseen": [_unseen_to_dict(each) for each in self.unseen],
            "issued": self.issued,
            "implausible": [_implausible_to_dict(each) for each in self.implausible],
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
        robot, (before, after), repeats = self.robot, self.distances, self.robot.repeats
        return {
            "of_fitted_rows": robot.of_fitted_rows,
            "poses": robot.before.poses,
            "cycles": list(robot.before.cycles),
            "cycles_of_the_standard": CYCLES,
            "pose_accuracy_before_mm": _accuracy_to_dict(robot.before.accuracy),
            "pose_accuracy_mm": None if robot.after is None else _accuracy_to_dict(robot.after.accuracy),
            "pose_repeatability_mm": None if repeats is None else _accuracy_to_dict(repeats.repeatability),
            "repeats": None if repeats is None else _repeats_to_dict(repeats, robot.repeated_in),
            "distance_accuracy_before_mm": None if before is None else before.to_dict(),
            "distance_accuracy_mm": None if after is None else after.to_dict(),
            "not_measured": list(not_measured(robot)),
        }


def not_measured(robot: RobotFound) -> tuple[str, ...]:
    """The standard's characteristics that these measurements say nothing of."""
    fitted = ("pose accuracy and distance accuracy of the calibrated model",) if robot.of_fitted_rows else ()
    unrepeated = () if robot.repeats is not None else ("pose repeatability",)
    return (*fitted, *unrepeated, *CHARACTERISTICS)


def _repeats_to_dict(found: Repeats, where: Sequence[str]) -> dict[str, Any]:
    return {
        "rows": list(where),
        "poses": found.poses,
        "cycles": list(found.cycles),
        "scatter_mm": 1e3 * found.scatter_m,
        "freedom": found.freedom,
    }


def _validation_to_dict(found: LackOfFit) -> dict[str, Any]:
    return {
        "poses": found.poses,
        "observed_rms_mm": 1e3 * found.observed_rms_m,
        "expected_rms_mm": 1e3 * found.expected_rms_m,
        "observed_95_mm": 1e3 * found.observed_95_m,
        "expected_95_mm": 1e3 * found.expected_95_m,
        "p": found.p,
        "lack_of_fit_mm": 1e3 * found.sigma_m,
    }


def _implausible_to_dict(found: Check) -> dict[str, Any]:
    return {"where": found.data["where"], "words": phrase(found), "impossible": found.outcome == "failed"}


def _unseen_to_dict(found: Unseen) -> dict[str, Any]:
    return {"quantity": found.quantity.words, "limit": found.limit, "unit": found.unit, "remedy": found.remedy}


def _statistics_to_dict(found: Mapping[str, float] | None) -> dict[str, float | int] | None:
    """As the run has them, the count a whole number."""
    return None if found is None else {name: int(v) if name == "count" else v for name, v in found.items()}


def _accuracy_to_dict(found: Accuracy) -> dict[str, float]:
    return {"mean": 1e3 * found.mean_m, "max": 1e3 * found.largest_m}


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
