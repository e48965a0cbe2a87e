"""Certificate of a calibration: as values, and as a document."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from lab.certification.budget import COVERAGE, Budget, BudgetLine, InputQuantity
from lab.certification.characteristics import CHARACTERISTICS, Accuracy, Conformity, PoseAccuracy, Repeats
from lab.certification.lack_of_fit import LackOfFit
from lab.compensation.iso9283 import CYCLES
from lab.core.checks import Check
from lab.core.se3 import Array
from lab.core.units import MM
from lab.formats.certificate_toml import CertificateDetails
from lab.library.load_run import CalibrationRun
from lab.library.result import ErrorStatistics, Result, error_statistics, number, sizes_mm
from lab.noise.instruments import Instrument
from lab.options.command_options import CertifyOptions
from lab.options.virtual_campaign import VirtualCampaign
from lab.phrases.phrase import phrase
from lab.phrases.verdict_phrases import gate_text

__all__ = ["Certificate", "RobotFound", "Unseen", "called", "missing_text", "not_measured"]


@dataclass(frozen=True)
class RobotFound:
    """Accuracy and repeatability of the robot at the measured points.

    Attributes:
        before, after: pose accuracy, commanded through the nominal and the calibrated model; ``after`` is None where
            the parameters were identified from all rows, whose residuals are no accuracy.
        distances_before, distances_after: errors of distances (m), measured less commanded; ``after`` empty likewise.
    """

    before: PoseAccuracy
    after: PoseAccuracy | None
    distances_before: Array
    distances_after: Array
    repeats: Repeats | None  # of all rows, fitted or not; None where no pose was repeated
    repeated_in: tuple[str, ...]  # which rows have repeats

    @property
    def of_fitted_rows(self) -> bool:
        """True where all rows were fitted, so that none shows the accuracy of the calibrated model."""
        return self.after is None


@dataclass(frozen=True)
class Unseen:
    """An effect that neither the measurements nor the instrument's specification covers, with its remedy."""

    quantity: InputQuantity
    limit: float  # its largest size in unit
    unit: str
    remedy: str  # what to do to make it observable

    @property
    def description(self) -> str:
        """The quantity with its size, for a person."""
        return f"{self.quantity.label}, up to {self.limit:.2g} {self.unit}"


@dataclass(frozen=True, repr=False, eq=False)
class Certificate(Result):
    """A calibration's certificate.

    Attributes:
        calibrated: the run that is certified.
        details: who measured what, when, where and with which instrument.
        device: the instrument; None where it is not known.
        budgets: uncertainty of a position (m), and of a distance between two.
        robot: the robot's performance, by ISO 9283 as far as the run shows it.
        conformity: None without a tolerance, without validation, or where the certificate is not issued.
        poses: number of fitted poses.
        implausible: details that cannot be right, or are unusual.
        validation: what validation shows beside the budget; None where the run was not validated.
        unseen: effects that U does not contain.
        with_unseen_m: expanded uncertainty of each measurand with the unseen effects.
        digests: SHA-256, by file, of what the numbers come from, and of the run's list of checksums.
    """

    command = "certify"
    robot_at = "calibrated.robot"

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
    digests: Mapping[str, str]

    @property
    def serial(self) -> str | None:
        """Serial number of the arm; None where it is not given."""
        return self.calibrated.serial

    @property
    def is_example(self) -> bool:
        """True where the robot is virtual, so that nothing was measured."""
        return isinstance(self.calibrated.options, VirtualCampaign)

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
        """Return the values that ``--json`` prints: lengths in mm, other quantities in the units that they name."""
        from lab.robots.config_file import SCHEMA

        result = self.calibrated.result
        return {
            "schema": SCHEMA,
            "run": str(self.calibrated.folder),
            "run_sha256": dict(self.digests),
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
                each.measurand: _budget_to_dict(each) | {"expanded_with_unseen_mm": MM.of(more)}
                for each, more in zip(self.budgets, self.with_unseen_m, strict=True)
            },
            "validation": None if self.validation is None else _validation_to_dict(self.validation),
            "unseen": [
                {"quantity": each.quantity.label, "limit": each.limit, "unit": each.unit, "remedy": each.remedy}
                for each in self.unseen
            ],
            "issued": self.issued,
            "implausible": [
                {"where": each.data["where"], "words": phrase(each), "impossible": each.outcome == "failed"}
                for each in self.implausible
            ],
            "conformity": None if self.conformity is None else self._conformity_to_dict(self.conformity),
            "iso_9283": self._iso_to_dict(),
            "warnings": list(self.warnings),
        }

    def columns(self) -> Mapping[str, Sequence[Any]]:
        """The lines of both budgets."""
        rows = [(budget, line) for budget in self.budgets for line in budget.lines]
        return {
            "measurand": [budget.measurand for budget, _ in rows],
            "quantity": [line.quantity.label for _, line in rows],
            "contribution_mm": [MM.of(line.contribution_m) for _, line in rows],
            "share": [line.share for _, line in rows],
        }

    def _conformity_to_dict(self, found: Conformity) -> dict[str, Any]:
        return {
            "statistic": self.options.statistic,
            **sizes_mm(found, "value", "tolerance", "expanded"),
            "rule": found.rule,
            "rule_words": found.rule_text,
            "decision": found.decision,
            "gate": gate_text(self.calibrated.result.gate_mm),
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
    """Return the standard's characteristics that were not measured."""
    fitted = ("pose accuracy and distance accuracy of the calibrated model",) if robot.of_fitted_rows else ()
    unrepeated = () if robot.repeats is not None else ("pose repeatability",)
    return (*fitted, *unrepeated, *CHARACTERISTICS)


def _repeats_to_dict(found: Repeats, where: Sequence[str]) -> dict[str, Any]:
    return {
        "rows": list(where),
        "poses": found.poses,
        "cycles": list(found.cycles),
        "scatter_mm": MM.of(found.scatter_m),
        "freedom": found.dof,
    }


def _validation_to_dict(found: LackOfFit) -> dict[str, Any]:
    return {
        "poses": found.poses,
        **sizes_mm(found, "observed_rms", "expected_rms", "observed_95", "expected_95"),
        "p": found.p,
        "lack_of_fit_mm": MM.of(found.sigma_m),
    }


def _statistics_to_dict(found: Mapping[str, float] | None) -> dict[str, float | int] | None:
    return None if found is None else {name: int(v) if name == "count" else v for name, v in found.items()}


def _accuracy_to_dict(found: Accuracy) -> dict[str, float]:
    return {"mean": MM.of(found.mean_m), "max": MM.of(found.largest_m)}


def _budget_to_dict(budget: Budget) -> dict[str, Any]:
    return {
        "lines": [_line_to_dict(line) for line in budget.lines],
        "combined_mm": MM.of(budget.combined_m),
        "freedom": number(budget.dof),
        "coverage_factor": budget.coverage_factor,
        **sizes_mm(budget, "expanded", "propagated"),
        "monte_carlo_mm": MM.of(budget.drawn_m),
        "monte_carlo_std_mm": MM.of(budget.drawn_std_m),
        "monte_carlo_draws": budget.draws,
        "tolerance_mm": MM.of(budget.tolerance_m),
        "agrees": budget.agrees,
        "kinematics": {
            **sizes_mm(budget.kinematics, "linear", "full"),
            "draws": budget.kinematics.draws,
            "is_linear": budget.is_linear,
        },
    }


def _line_to_dict(line: BudgetLine) -> dict[str, Any]:
    quantity = line.quantity
    return {
        "group": quantity.group,
        "quantity": quantity.label,
        "source": quantity.source,
        "distribution": quantity.uncertainty.distribution,
        "unit": quantity.unit.name,
        "standard_uncertainty": quantity.unit.of(quantity.uncertainty.standard),
        "freedom": number(quantity.uncertainty.dof),
        "sensitivity_mm_per_unit": MM.of(line.sensitivity) / quantity.unit.factor,
        "contribution_mm": MM.of(line.contribution_m),
        "share": line.share,
    }


_NAMES = {
    "date": "date of issue",
    "temperature_c": "temperature, °C",
    "pressure_hpa": "pressure, hPa",
    "humidity_percent": "humidity, %",
    "repeatability_mm": "repeatability (RP), as stated, mm",
    "expansion_ppm_per_k": "expansion, ppm/K",
}
_MISSING = {
    "certificate.number": "the number of the certificate",
    "certificate.date": "its date of issue",
    "certificate.issued_by": "who issues it",
    "certificate.operator": "the operator",
    "certificate.place": "the place",
    "environment.temperature_c": "the temperature of the room",
}  # of other details the section's name follows their own


def called(key: str) -> str:
    """Return a detail's key in words."""
    return _NAMES.get(key, key.replace("_", " "))


def missing_text(missing: Sequence[str]) -> str:
    """Name details that are not stated, as ``section.name``, in words."""
    named = (
        _MISSING.get(name, f"the {called(name.partition('.')[2])} of the {name.partition('.')[0]}") for name in missing
    )
    return ", ".join(named)
