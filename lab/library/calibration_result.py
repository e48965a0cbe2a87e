"""Result of ``lab calibrate`` and ``lab identify``: the identified parameters and their prediction error."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from lab.calibration.gauss_newton import Observations
from lab.calibration.identifiability import Direction, weak_directions
from lab.calibration.identification import Identification
from lab.calibration.most_likely import most_likely_parameters
from lab.calibration.residual.gaussian_process import GROUP
from lab.calibration.sensor import ArmSensor
from lab.calibration.statistics.model_selection import GroupTrial
from lab.core.checks import Check, Outcome
from lab.core.linear_model import triangle_of
from lab.core.measurements import Measurements
from lab.core.se3 import Array
from lab.core.units import MM
from lab.diagnosis.hypothesis import Finding
from lab.formats.calibrated_module import MODULE_FILE
from lab.formats.measurement_csv import write_measurements
from lab.kinematics.joints import JointSpec
from lab.kinematics.model import RigidArm
from lab.kinematics.parameter import targets_of
from lab.library.arm_files import ArmExport, GeometryFiles, comment_on_missing_effects, geometry_files
from lab.library.calibration_values import calibration_values
from lab.library.hand_load import read_hand_load
from lab.library.khalil_rows import khalil_rows
from lab.library.result import ErrorStatistics, Result, error_statistics, exit_code_of, number
from lab.library.simulate import SimulatedTruth
from lab.options.measured_campaign import MeasuredCampaign
from lab.options.virtual_campaign import VirtualCampaign
from lab.phrases.phrase import phrases
from lab.phrases.verdict_phrases import gate_text
from lab.prediction.estimate import Estimate, EstimatedParameter
from lab.prediction.estimate_files import write_estimate
from lab.prediction.estimate_of_fit import estimate_of
from lab.prediction.validation import Validation
from lab.robots.robot import Robot
from lab.verdict.fitted import Fitted
from lab.verdict.verdict import Verdict

__all__ = ["CalibrationResult", "stiffnesses"]

_CORRELATED = 0.95  # the least correlation that is called strong


class _JointStiffness(NamedTuple):
    joint: str
    stiffness: float  # Nm/rad
    std: float  # NaN where it is unknown


_ADEQUATE: dict[Outcome, bool | None] = {"passed": True, "failed": False, "not tested": None, "noted": None}


def stiffnesses(identification: Identification, chain: JointSpec) -> tuple[_JointStiffness, ...]:
    """Stiffness of the hinges whose compliance was fitted and is above zero."""
    identified = []
    for i, std in zip(identification.fit.free, identification.std, strict=True):
        parameter, compliance = identification.model.parameters[i], float(identification.values[i])
        joint = parameter.joint
        if parameter.symbol == "compliance" and joint is not None and compliance > 0 and not chain.prismatic[joint]:
            identified.append(_JointStiffness(chain.joint_names[joint], 1 / compliance, float(std) / compliance**2))
    return tuple(identified)


@dataclass(frozen=True, repr=False, eq=False)
class CalibrationResult(Result):
    """An identified robot, how well it predicts, and what it was identified from.

    Positions are in the frame of the measurements; of a virtual robot that is the tracker's.

    Attributes:
        options: of the campaign, with those of the fit and of the judgement.
        robot: the nominal robot.
        state: what the pipeline ended with, for pages and for further steps.
        seconds: of the identification, its validation and its judgement.
        truth: of a virtual robot, what was simulated; None of a real one.
    """

    robot_at = "robot"

    options: VirtualCampaign | MeasuredCampaign
    robot: Robot
    state: Fitted
    seconds: float = field(compare=False)
    truth: SimulatedTruth | None = None

    @property
    def kind(self) -> ArmSensor:
        """Sensor of the measurements."""
        return self.state.fitter.kind

    @property
    def measurements(self) -> Measurements:
        """All rows that were read or measured."""
        return self.state.fitter.data

    @cached_property
    def nominal(self) -> Array:
        """``(p,)`` the nominal values of the fitted model's parameters."""
        return self.state.fitter.nominal(self.identification.model)

    @property
    def names(self) -> tuple[str, ...]:
        """``(p,)`` names of the fitted model's parameters."""
        return self.identification.model.names

    @property
    def values(self) -> Array:
        """``(p,)`` the parameters as they were identified (m, rad), in the order of ``names``.

        Those that were not identified are nominal; ``estimate.values`` are the most likely ones that predict the same.
        """
        return self.identification.values.copy()

    @property
    def checks(self) -> tuple[Check, ...]:
        """Checks of the measurements, the fit and the validation, beside those of the verdict."""
        return self.state.checks

    @property
    def diagnosis(self) -> tuple[Finding, ...]:
        """Mistakes in the measurements that a refit confirmed, the foremost first."""
        return self.state.diagnosis

    @property
    def validation(self) -> Validation:
        """Errors at poses that were not fitted."""
        return self.state.validation

    @property
    def verdict(self) -> Verdict:
        """Verdict on the calibration."""
        return self.state.verdict

    @cached_property
    def warnings(self) -> tuple[str, ...]:
        """Phrases of the checks, each once, and the files that cannot hold the arm."""
        return (*phrases(self.state.checks), *self._descriptions.messages)

    @property
    def command(self) -> str:
        """The command that this is the result of."""
        return "calibrate" if isinstance(self.options, VirtualCampaign) else "identify"

    @property
    def exit_code(self) -> int:
        """1 where the verdict is bad; 3 where a good one is required and it is doubtful or not judged; else 0."""
        return exit_code_of(self.verdict.word, self.options.require)

    @property
    def identification(self) -> Identification:
        """The fit of the parameters."""
        return self.state.identification

    @property
    def fitted(self) -> Measurements:
        """The rows that the parameters come from."""
        return self.state.rows

    @cached_property
    def exported(self) -> Array:
        """``(p,)`` the exported parameters: those of the most likely arm among those that predict the same."""
        return most_likely_parameters(self.identification, self.nominal, self.state.fitter.options.tolerance)

    @cached_property
    def estimate(self) -> Estimate:
        """The identified arm as it holds on another day: parameters with their covariance, and what they predict."""
        load, noise = self.options.fitting.load, self.state.noise
        return estimate_of(
            self.identification,
            lambda: self.exported,
            self.robot,
            [*self.state.groups, *[GROUP] * (self.state.process is not None)],
            adequate=self.adequate,
            shared=noise.shared,
            component_errors=noise.component_errors,
            tail_dof=self.state.tail_dof,
            measured=self.state.measured,
            load=None if load is None else read_hand_load(load, accept_edited=True),
        )

    @property
    def parameters(self) -> tuple[EstimatedParameter, ...]:
        """Rows of the parameters: nominal value, estimate, uncertainty."""
        return self.estimate.rows

    @cached_property
    def weak_directions(self) -> tuple[Direction, ...]:
        """Directions of the parameters that the fitted measurements weakly observe."""
        found, fitted = self.identification, self.fitted
        model, free = found.model, np.delete(found.fit.free, found.fit.aside).tolist()
        seen = Observations(fitted.inputs(model.conditions), fitted.points, np.ones(fitted.points.shape[:2]))
        triangle = triangle_of(
            each.apply(model.observe(each.inputs, found.values)[1][..., free]) for each in seen.blocks()
        )
        rows = int(fitted.seen.sum() * fitted.points.shape[2])
        return weak_directions([model.names[i] for i in free], triangle, rows=rows)

    @property
    def validated(self) -> bool:
        """Check whether there are errors at poses that were not fitted."""
        return self.validation.errors is not None

    @property
    def before(self) -> ErrorStatistics:
        """Errors of the nominal model at the poses of the validation, base and tool fitted; of none without one."""
        errors = self.validation.errors
        return error_statistics(np.empty(0) if errors is None else errors.before)

    @property
    def after(self) -> ErrorStatistics:
        """Errors of the calibrated model at the poses of the validation; of none without one."""
        errors = self.validation.errors
        return error_statistics(np.empty(0) if errors is None else errors.after)

    @property
    def after_without_outliers(self) -> ErrorStatistics | None:
        """Errors after, without the poses that the test of outliers names; None where it names none of them."""
        return None if (robust := self.validation.robust) is None else error_statistics(robust.after)

    @property
    def detected_outliers(self) -> int:
        """Number of simulated outliers that the test of outliers names."""
        return 0 if self.truth is None else len(self.truth.outliers & {pose.id for pose in self.state.outliers})

    @property
    def groups(self) -> tuple[GroupTrial, ...]:
        """Trials of the parameter groups; none if only geometry was requested."""
        return () if self.state.selection is None else self.state.selection.groups

    @property
    def adequate(self) -> bool | None:
        """Whether the residuals are no more than the noise; None where that was not tested."""
        return _ADEQUATE[self.state.adequacy.outcome]

    @property
    def correlated_pairs(self) -> tuple[tuple[str, str, float], ...]:
        """Pairs of identified parameters with strong correlations, the strongest first."""
        names, std = self.estimate.identified, self.identification.std
        if not (np.isfinite(std).all() and (std > 0).all()):
            return ()
        matrix = np.triu(self.identification.covariance / np.outer(std, std), 1)
        pairs = np.argwhere(np.abs(matrix) > _CORRELATED)
        order = sorted(pairs.tolist(), key=lambda pair: -abs(matrix[pair[0], pair[1]]))
        return tuple((names[i], names[j], round(float(matrix[i, j]), 4)) for i, j in order)

    @property
    def stiffnesses(self) -> tuple[_JointStiffness, ...]:
        """Stiffnesses of the joints whose compliance was identified."""
        return stiffnesses(self.identification, self.robot.chain)

    @property
    def poses(self) -> int:
        """Number of fitted poses: of a sensor that reads several things in a pose, rows of one pose count once."""
        return len(np.unique(self.fitted.joints, axis=0)) if self.kind.several_a_pose else len(self.fitted)

    def rigid(self, values: Array) -> tuple[RigidArm, Array]:
        """The rigid arm and its part of parameters ``(p,)``: effects and what else was observed are left out."""
        arm = self.robot.arm(targets_of(self.identification.model.parameters))
        return arm, values[: len(arm.names)]

    def to_dict(self) -> dict[str, Any]:
        """Return the values that ``result.json`` holds and ``--json`` prints. Lengths in mm."""
        return calibration_values(self)

    @cached_property
    def _export(self) -> ArmExport:
        """The arm as it holds on another day, for ``calibrated.py``."""
        observed = "" if self.kind.in_instrument_frame else self.kind.name
        verdict = f"{self.verdict.word}, {gate_text(self.options.gate_mm)}"
        return ArmExport(self.estimate, observed, verdict, self.fitted.inputs(self.estimate.arm.conditions))

    @cached_property
    def _module(self) -> tuple[str, str | None]:
        """The text of ``calibrated.py``, and why it refuses."""
        return self._export.module()

    @cached_property
    def _geometry_error_m(self) -> float | None:
        """Error of geometry alone (m, root mean square) at the fitted poses; None if no other effect is modelled."""
        return self.estimate.geometry_error(self._export.inputs)

    @cached_property
    def _descriptions(self) -> GeometryFiles:
        """The files that describe the arm's geometry; those in other formats are ``lab compensate``'s."""
        arm, values = self.rigid(self.exported)
        lacking = comment_on_missing_effects(
            self.estimate.groups, self._geometry_error_m, "at the measured poses", module=self._module[1] is None
        )
        return geometry_files(self.robot, self.robot.stored_files, arm.targets, values, lacking)

    def exports(self) -> dict[str, Any]:
        """Return what each file that holds the calibrated arm has and lacks, by its name."""
        off = self._geometry_error_m
        alone = {"has": ["geometric"], "lacks": [*self.estimate.groups, *self.estimate.left_out]}
        of_geometry = {**alone, "off_mm": None if off is None else number(MM.of(off))}
        lacks, files = ["geometric", *alone["lacks"]], self._descriptions
        left_out = {name: {"has": [], "lacks": lacks, "reason": why} for name, why in files.left_out.items()}
        module = {MODULE_FILE: self._export.to_dict(self._module[1])}
        return module | dict.fromkeys(files.texts, of_geometry) | left_out

    def columns(self) -> Mapping[str, Sequence[Any]]:
        """The parameters, in SI units."""
        names = ("name", "unit", "nominal", "estimate", "std", "status")
        return {name: [getattr(row, name) for row in self.parameters] for name in names}

    def write_files(self, folder: Path) -> None:
        """Write the measurements, the estimate, the load, and the calibrated arm for other programs."""
        robot, fitting = self.robot, self.options.fitting
        write_measurements(folder / "measurements.csv", self.measurements, robot.chain.prismatic)
        converted = khalil_rows(self.estimate, float(self.identification.half_width_95.max()))
        write_estimate(folder, self.estimate, converted)
        if fitting.load is not None:
            read_hand_load(fitting.load, accept_edited=fitting.accept_edited).write(folder)
        for name, text in self._descriptions.texts.items():
            (folder / name).write_text(text, encoding="utf-8")
        (folder / MODULE_FILE).write_text(self._module[0], encoding="utf-8")
