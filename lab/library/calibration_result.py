"""Result of ``lab calibrate`` and ``lab identify``: the identified parameters and their prediction error."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from lab.calibration.gauss_newton import Observations
from lab.calibration.identifiability import Direction, weak_directions
from lab.calibration.identification import Identification, most_likely_parameters
from lab.calibration.residual.estimation import ExpectedGain
from lab.calibration.residual.process import GROUP
from lab.calibration.rigid_distances import CoordinateNoise
from lab.calibration.sensor import Sensor
from lab.calibration.statistics.model_selection import GroupTrial
from lab.calibration.statistics.remaining_error import ExplainedError, RemainingError
from lab.calibration.validation import TruthComparison, Validation
from lab.core import se3
from lab.core.checks import Check, Outcome
from lab.core.linear_model import triangle_of
from lab.core.measurements import Measurements
from lab.core.se3 import Array
from lab.core.units import MM, MRAD
from lab.formats.calibrated_module import MODULE_FILE
from lab.formats.measurement_csv import write_measurements
from lab.formats.noise_model import noise_model_to_dict
from lab.kinematics.effects.effect_registry import describe_term
from lab.kinematics.joints import JointSpec
from lab.kinematics.model import RigidArm
from lab.kinematics.parameter import targets_of
from lab.kinematics.serial.khalil_frames import ANGULAR, SYMBOLS, khalil_frame
from lab.library.arm_files import ArmExport, GeometryFiles, comment_on_missing_effects, geometry_files
from lab.library.hand_load import read_hand_load
from lab.library.result import ErrorStatistics, Result, error_statistics, exit_code_of, number, sizes_mm
from lab.options.measured_campaign import MeasuredCampaign
from lab.options.virtual_campaign import VirtualCampaign
from lab.phrases.phrase import in_one_line, phrase, phrases
from lab.phrases.verdict_phrases import gate_text
from lab.prediction.estimate import Estimate, EstimatedParameter, estimate_of
from lab.prediction.estimate_files import measured_range_to_dict, residual_to_dict, write_estimate
from lab.prediction.workspace_prediction import Distance, RegionPrediction, ValidationBounds
from lab.robots.robot import Robot
from lab.simulation.true_robot import TrueRobot
from lab.verdict.fitted import Fitted, Named
from lab.verdict.verdict import Answer, Verdict, rotation_noise_rad

__all__ = [
    "CalibrationResult", "correlated_pairs", "direction_to_dict", "errors_without_outliers", "khalil_rows",
    "outliers_found", "stiffnesses",
]  # fmt: skip

_CORRELATED = 0.95  # the least correlation that is called strong


class _JointStiffness(NamedTuple):
    joint: str
    stiffness: float  # Nm/rad
    std: float  # NaN where it is unknown


def stiffnesses(identification: Identification, chain: JointSpec) -> tuple[_JointStiffness, ...]:
    """Stiffness of the hinges whose compliance was fitted and is above zero."""
    found = []
    for i, std in zip(identification.fit.free, identification.std, strict=True):
        parameter, compliance = identification.model.parameters[i], float(identification.values[i])
        joint = parameter.joint
        if parameter.symbol == "compliance" and joint is not None and compliance > 0 and not chain.prismatic[joint]:
            found.append(_JointStiffness(chain.joint_names[joint], 1 / compliance, float(std) / compliance**2))
    return tuple(found)


def correlated_pairs(identification: Identification) -> tuple[tuple[str, str, float], ...]:
    """Pairs of identified parameters with strong correlations, the strongest first."""
    names, std = [identification.model.names[i] for i in identification.fit.free], identification.std
    if not (np.isfinite(std).all() and (std > 0).all()):
        return ()
    matrix = np.triu(identification.covariance / np.outer(std, std), 1)
    pairs = np.argwhere(np.abs(matrix) > _CORRELATED)
    order = sorted(pairs.tolist(), key=lambda pair: -abs(matrix[pair[0], pair[1]]))
    return tuple((names[i], names[j], round(float(matrix[i, j]), 4)) for i, j in order)


def direction_to_dict(direction: Direction) -> dict[str, Any]:
    """A weak direction as plain values; ``parts`` in SI units."""
    return {
        "singular_value": direction.singular_value,
        "moved_mm": MM.of(direction.moved),
        "parts": dict(direction.parts),
    }


@dataclass(frozen=True, repr=False, eq=False)
class CalibrationResult(Result):
    """An identified robot, how well it predicts, and what it was identified from.

    Positions are in the frame of the measurements; of a virtual robot that is the tracker's.

    Attributes:
        fit: the state that the pipeline ended with: fit, checks, validation and verdict.
        seconds: of the identification and its validation.
        real: of a virtual robot, the arm that was measured; else None.
        bad: of a virtual robot, the ids of its simulated outliers.
    """

    robot_at = "robot"

    options: VirtualCampaign | MeasuredCampaign
    robot: Robot
    fit: Fitted
    seconds: float = field(compare=False)
    real: TrueRobot | None = None
    bad: frozenset[str] = frozenset()

    @property
    def kind(self) -> Sensor:
        """Sensor of the measurements."""
        return self.fit.fitter.kind

    @property
    def measurements(self) -> Measurements:
        """All rows that were read or measured."""
        return self.fit.fitter.data

    @cached_property
    def nominal(self) -> Array:
        """``(p,)`` the nominal values of the fitted model's parameters."""
        return self.fit.fitter.nominal(self.identification.model)

    @property
    def comparison(self) -> TruthComparison | None:
        """Of a virtual robot, its true parameters beside the identified ones; else None."""
        return self.fit.comparison

    @property
    def validation(self) -> Validation:
        """Errors at poses that were not fitted."""
        return self.fit.validation

    @property
    def verdict(self) -> Verdict:
        """Verdict on the calibration."""
        return self.fit.verdict

    @cached_property
    def warnings(self) -> tuple[str, ...]:
        """Phrases of the checks, each once, and the files that cannot hold the arm."""
        return (*phrases(self.fit.checks), *self._descriptions.messages)

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
        return self.fit.identification

    @property
    def fitted(self) -> Measurements:
        """The rows that the parameters come from."""
        return self.fit.rows

    @cached_property
    def exported(self) -> Array:
        """``(p,)`` the exported parameters: those of the most likely arm among those that predict the same."""
        return most_likely_parameters(self.identification, self.nominal, self.fit.fitter.options.tolerance)

    @cached_property
    def estimate(self) -> Estimate:
        """The identified arm as it holds on another day: parameters with their covariance, and what they predict."""
        load, noise = self.options.fitting.load, self.fit.noise
        return estimate_of(
            self.identification,
            lambda: self.exported,
            self.robot,
            [*self.fit.groups, *[GROUP] * (self.fit.process is not None)],
            adequate=_ADEQUATE[self.fit.adequacy.outcome],
            shared=noise.shared,
            component_errors=noise.component_errors,
            tail_dof=self.fit.tail_dof,
            measured=self.fit.measured,
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
        model, free = found.model, list(found.fit.free)
        seen = Observations(fitted.inputs(model.conditions), fitted.points, np.ones(fitted.points.shape[:2]))
        triangle = triangle_of(
            each.apply(model.observe(each.inputs, found.values)[1][..., free]) for each in seen.blocks()
        )
        rows = int(fitted.seen.sum() * fitted.points.shape[2])
        return weak_directions([model.names[i] for i in free], triangle, rows=rows)

    @property
    def before(self) -> ErrorStatistics | None:
        """Errors of the nominal model at the poses of the validation, base and tool fitted; None without one."""
        return None if self.validation.errors is None else error_statistics(self.validation.errors.before)

    @property
    def after(self) -> ErrorStatistics | None:
        """Errors of the calibrated model at the poses of the validation; None without one."""
        return None if self.validation.errors is None else error_statistics(self.validation.errors.after)

    @property
    def groups(self) -> tuple[GroupTrial, ...]:
        """Trials of the parameter groups; none if only geometry was requested."""
        return () if self.fit.selection is None else self.fit.selection.groups

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
        from lab.robots.config_file import SCHEMA

        identification, nothing = self.identification, {MM: float("nan")}
        noises, residuals = (
            nothing | dict(self.kind.noises(identification.model, sigma))
            for sigma in (identification.sigma_m, identification.residual_sigma_m)
        )
        result: dict[str, Any] = {
            "schema": SCHEMA,
            "robot": self.robot.name,
            "serial": self.options.serial,
            "poses": self.poses,
            "targets": list(self.fitted.targets),
            "parameters": len(identification.model.names),
            "identifiable": len(identification.base_set.identifiable),
            "rank": identification.fit.rank,
            "condition": number(identification.fit.condition),
            "plain_condition": number(identification.plain_condition),
            "prior": self._prior,
            "estimator": self.options.fitting.estimator,
            "status": identification.status,
            "iterations": identification.fit.iterations,
            "seconds": round(self.seconds, 4),
            "verdict": self.verdict.word,
            "reason": in_one_line(self.verdict.reasons),
            "reasons": list(phrases(self.verdict.reasons)),
            "gate_mm": self.options.gate_mm,
            "answers": {name: _answer_to_dict(each) for name, each in self.verdict.answers.items()},
            "judged_by": self.validation.judged_by,
            "before_mm": _optional(ErrorStatistics.to_dict, self.before),
            "after_mm": _optional(ErrorStatistics.to_dict, self.after),
            "after_without_outliers_mm": _optional(ErrorStatistics.to_dict, errors_without_outliers(self)),
            **{f"noise_{unit.key}": number(unit.of(size)) for unit, size in noises.items()},
            "noise_mrad": number(MRAD.of(rotation_noise_rad(identification))),
            "noise_known": identification.sigma_given,
            "cluster_robust": identification.dof_each is not None and self.fit.noise.shared is None,
            "noise_tail_freedom": number(self.fit.tail_dof),
            "noise_model": noise_model_to_dict(self.fit.noise.shared, self.fit.noise.component_errors),
            "noise_findings": [_finding_to_dict(each) for each in self.fit.findings],
            "prediction_at_validation": _optional(_prediction_to_dict, self.verdict.prediction),
            "instrument_noise": _optional(_instrument_to_dict, self.fit.instrument),
            **{f"residual_{unit.key}": number(unit.of(size)) for unit, size in residuals.items()},
            "freedom": identification.dof,
            "predicted_mm": number(MM.of(self.verdict.workspace.rms_m)),
            "predicted_95_mm": number(MM.of(self.verdict.workspace.p95_m)),
            "prediction": _optional(_region_to_dict, self.verdict.region),
            "prediction_elsewhere": _optional(_region_to_dict, self.verdict.elsewhere),
            "validation_bounds": _optional(_bounds_to_dict, self.fit.bounds),
            "remaining_error": _remaining_to_dict(self.fit.remaining, self.fit.gain),
            "measured_range": measured_range_to_dict(self.fit.measured, self.robot.chain),
            "extrapolation": self._extrapolation,
            "farthest_link": _optional(_distance_to_dict, self.verdict.farthest),
            "model": "+".join(("geometric", *self.fit.groups, *[GROUP] * (self.fit.process is not None))),
            "residual": residual_to_dict(self.fit.process),
            "groups": [_group_to_dict(group, self.fit.explained.get(group.name)) for group in self.groups],
            "adequate": _ADEQUATE[self.fit.adequacy.outcome],
            "adequacy": phrase(self.fit.adequacy),
            "stiffness_nm_per_rad": {each.joint: each.stiffness for each in self.stiffnesses},
            "stiffness_std_nm_per_rad": {each.joint: number(each.std) for each in self.stiffnesses},
            "correlated": [
                {"parameters": [*pair], "correlation": correlation}
                for *pair, correlation in correlated_pairs(identification)
            ],
            "weak_directions": [direction_to_dict(each) for each in self.weak_directions],
            "outliers": [_outlier_to_dict(pose) for pose in self.fit.outliers],
            "outliers_left_out": self.fit.left_out,
            "exports": self._exports,
            "warnings": list(self.warnings),
        }
        if self.comparison is not None:
            result["truth"] = _truth_to_dict(self, self.comparison)
        return result

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

    @property
    def _exports(self) -> dict[str, Any]:
        """Entries in ``result.json`` for the files that hold the calibrated arm."""
        found, off = self._export, self._geometry_error_m
        alone = {"has": ["geometric"], "lacks": [*self.estimate.groups, *self.estimate.left_out]}
        of_geometry = {**alone, "off_mm": None if off is None else number(MM.of(off))}
        lacks, files = ["geometric", *alone["lacks"]], self._descriptions
        left_out = {name: {"has": [], "lacks": lacks, "reason": why} for name, why in files.left_out.items()}
        return {MODULE_FILE: found.to_dict(self._module[1]), **dict.fromkeys(files.texts, of_geometry), **left_out}

    @property
    def _prior(self) -> dict[str, Any]:
        """Entry in ``result.json`` for the tolerances as a prior: the number of directions in which it acts."""
        mode, acting = self.options.fitting.prior, self.identification.prior
        if acting is None:
            return {"mode": mode, "acts_in": 0}
        return {
            "mode": mode,
            "acts_in": acting.acts_in,
            "directions": acting.directions,
            "scale": acting.scale,
            "scale_from": acting.scale_from,
        }

    @property
    def _extrapolation(self) -> dict[str, Any] | None:
        """The part of ``result.json`` about where nothing was measured."""
        if (measured := self.fit.measured) is None:
            return None
        workspace, rows = self.verdict.workspace, self.validation.rows
        lacks = self.fit.process is not None or measured.is_worse_beyond
        return {
            "growth_mrad": MRAD.of(measured.growth),
            "unsure_mrad": MRAD.of(measured.unsure),
            "workspace_beyond_share": workspace.beyond_share,
            "workspace_extrapolated_share": workspace.uncovered_share,
            "validation_extrapolated": None if rows is None else int((measured.uncovered(rows.joints) & lacks).sum()),
        }

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


_ADEQUATE: dict[Outcome, bool | None] = {"passed": True, "failed": False, "not tested": None, "noted": None}


def _optional(to_dict: Callable[[Any], dict[str, Any]], found: Any) -> dict[str, Any] | None:
    return None if found is None else to_dict(found)


def _answer_to_dict(answer: Answer) -> dict[str, Any]:
    return {"standing": answer.standing, "words": in_one_line(answer.checks)}


def _finding_to_dict(found: Check) -> dict[str, Any]:
    """An entry of ``noise_findings``."""
    between = found.data.get("between")
    return {
        "kind": found.name.removeprefix("finding."),
        "size_mm": MM.of(found.data["size_m"]),
        "supported": found.outcome != "failed",
        "between": None if between is None else list(between),
        "words": phrase(found),
    }


def _prediction_to_dict(found: Check) -> dict[str, Any]:
    """Observed and predicted 95 % errors at the validation poses, in mm."""
    sizes = {f"{name}_95_mm": MM.of(found.data[f"{name}_p95_m"]) for name in ("observed", "predicted", "allowed")}
    return {**sizes, "exceeded": found.outcome == "failed"}


def outliers_found(result: CalibrationResult) -> int:
    """Count the simulated outliers that the outlier test names."""
    return len(result.bad & {pose.id for pose in result.fit.outliers})


def errors_without_outliers(result: CalibrationResult) -> ErrorStatistics | None:
    """Errors after, without the poses that the test of outliers names; None where it names none of them."""
    return None if (robust := result.validation.robust) is None else error_statistics(robust.after)


def _instrument_to_dict(found: CoordinateNoise) -> dict[str, Any]:
    """The noise by the distances between targets, in mm."""
    sizes = {"estimate_mm": found.sigma_m, "low_mm": found.low_m, "high_mm": found.high_m}
    return {name: MM.of(size) for name, size in sizes.items()} | {
        "freedom": found.dof,
        "rigid": found.is_rigid,
        "words": found.description,
    }


def _remaining_to_dict(found: RemainingError | None, gain: ExpectedGain | None) -> dict[str, Any] | None:
    if found is None:
        return None
    sizes = {"total_mm": found.total_m, "instrument_mm": found.instrument_m, "shared_mm": found.shared_m}
    alike = {"neighbouring_joints": found.over_joints, "successive_poses": found.over_time}
    return {name: number(MM.of(size)) for name, size in {**sizes, "rest_mm": found.rest_m}.items()} | {
        **{name: None if each is None else asdict(each) for name, each in alike.items()},
        "seen_not_taken": list(found.nearly),
        "measure_next": found.measure_next,
        "with_residual": None
        if gain is None
        else {"before_mm": MM.of(gain.before_m), "after_mm": MM.of(gain.after_m), "poses": gain.poses},
    }


def _region_to_dict(found: RegionPrediction) -> dict[str, Any]:
    """A prediction over a region, lengths in mm."""
    return {
        "region": found.kind,
        "poses": found.poses,
        **sizes_mm(found, "rms", "mean", "p95", "uncalibrated_rms"),
        "extrapolated_share": found.extrapolated_share,
    }


def _bounds_to_dict(found: ValidationBounds) -> dict[str, Any]:
    """Predicted and observed errors at the validation poses, lengths in mm."""
    return {
        **sizes_mm(found, "predicted_95", "observed_95"),
        "inside_share": found.inside_share,
        "inside_low": found.inside_low,
        "inside_high": found.inside_high,
        "extrapolated_share": found.extrapolated_share,
    }


def _truth_to_dict(result: CalibrationResult, comparison: TruthComparison) -> dict[str, Any]:
    return {
        "max_abs_z": number(np.abs(comparison.z).max()),
        "nees_per_parameter": number(comparison.nees_per_parameter),
        "coverage_95": number(comparison.coverage_95),
        "max_abs_error": number(np.abs(comparison.error).max()),
        "bad_readings": len(result.bad),
        "bad_named": outliers_found(result),
    }


def _group_to_dict(group: GroupTrial, explained: ExplainedError | None) -> dict[str, Any]:
    return {
        "name": group.name,
        "words": describe_term(group.name),
        "parameters": group.parameters,
        "holdout_mm": number(MM.of(group.holdout_m)),
        "f_p": number(group.f_p),
        "bic": number(group.bic),
        "chosen": group.chosen,
        "explains_mm": None if explained is None else number(MM.of(explained.size_m)),
        "explained_share": None if explained is None else number(explained.share),
        "why_not": group.infeasibility_reason,
        "configurations_p": None if group.configurations is None else number(group.configurations.p),
        "configurations_dof": None if group.configurations is None else number(group.configurations.dof),
        "holdout_gain_p": None if group.gain is None else number(group.gain.p),
    }


def _distance_to_dict(found: Distance) -> dict[str, Any]:
    """The link that is farthest from its nominal value, in mm or mrad and in tolerances."""
    unit = MRAD if found.is_angle else MM
    return {"name": found.name, f"distance_{unit.key}": unit.of(found.size), "tolerances": found.tolerances}


def _outlier_to_dict(pose: Named) -> dict[str, Any]:
    where = {} if pose.line is None else {"line": pose.line}
    return {"id": pose.id, **where, "size_mm": MM.of(pose.size_m), "p": pose.p, "held_out": pose.held_out}


_STEP = 1e-6  # m or rad, of central differences
_BASE = tuple(f"base.{axis}" for axis in ("x", "y", "z", "rx", "ry", "rz"))
_TURN = ("tool.rx", "tool.ry", "tool.rz")


def khalil_rows(estimate: Estimate, width_95: float) -> list[dict[str, Any]]:
    """Return rows of Z (the base in the instrument's frame) and of E of each target (in the last frame), if any.

    Their intervals are those of the base and the tool, carried over by the derivatives. Where no orientation of the
    tool was measured, E's is that of the last frame, so that its axes are parallel; a ``note`` explains it. Without a
    base there are none.

    Args:
        estimate: of any model.
        width_95: half of the widest 95 % interval of a parameter, in standard deviations.
    """
    names = list(estimate.params)
    if not set(_BASE) <= set(names):
        return []
    owners = {"Z": list(_BASE)}
    turn = [name for name in _TURN if name in names]
    for target in estimate.rigid.targets:
        owners[f"E.{target}"] = [*(f"tool.{target}.{axis}" for axis in "xyz"), *turn]
    return [row for owner, index in owners.items() for row in _rows(owner, index, estimate, width_95)]


def _pose(values: Array) -> Array:
    """A pose of a position (m) and a rotation vector (rad), which may be left out."""
    return se3.pose(se3.exp(values[3:] if len(values) == 6 else np.zeros(3)), values[:3])


def _six(values: Array) -> Array:
    return khalil_frame(_pose(values)).values


def _rows(owner: str, names: Sequence[str], estimate: Estimate, wide: float) -> list[dict[str, Any]]:
    given = [estimate.params[name] for name in names]
    values = np.array([each.estimate for each in given])
    frame = khalil_frame(_pose(values))
    nominal, exported = (_six(np.array([getattr(row, key) for row in given])) for key in ("nominal", "exported"))
    std = _deviations(values, names, estimate)
    rows = []
    for i, symbol in enumerate(SYMBOLS):
        value, deviation = float(frame.values[i]), None if frame.note else number(float(std[i]))
        row: dict[str, Any] = {
            "name": f"{owner}.{symbol}",
            "unit": "rad" if ANGULAR[i] else "m",
            "nominal": float(nominal[i]),
            "estimate": value,
            "exported": float(exported[i]),
            "std": deviation,
            "interval_95": None if deviation is None else [value - wide * deviation, value + wide * deviation],
            "status": "converted",
            "weakly_observable": False,
            "aliases": {},
        }
        rows.append(row | ({"note": frame.note} if frame.note else {}))
    return rows


def _deviations(values: Array, names: Sequence[str], estimate: Estimate) -> Array:
    """Standard deviations ``(6,)`` of the six, from those of the fitted ones among these parameters."""
    fitted = [k for k, name in enumerate(names) if name in estimate.identified]
    steps = _STEP * np.eye(len(names))[fitted]
    slopes = np.array([(_six(values + step) - _six(values - step)) / (2 * _STEP) for step in steps]).reshape(-1, 6)
    at = [estimate.identified.index(names[k]) for k in fitted]
    return np.sqrt(np.maximum(np.diag(slopes.T @ estimate.covariance[np.ix_(at, at)] @ slopes), 0.0))
