"""Values of a calibration as ``result.json`` holds them and ``--json`` prints them: lengths in mm, angles in mrad."""

from collections.abc import Callable
from dataclasses import asdict
from typing import TYPE_CHECKING, Any

import numpy as np

from lab.calibration.identifiability import Direction
from lab.calibration.residual.estimation import ExpectedGain
from lab.calibration.residual.gaussian_process import GROUP
from lab.calibration.statistics.model_selection import GroupTrial
from lab.core.checks import Check
from lab.core.units import MM, MRAD, PPM
from lab.diagnosis.hypothesis import Finding
from lab.diagnosis.range_constant import FittedRange
from lab.formats.noise_model import noise_model_to_dict
from lab.kinematics.effects.effect_registry import describe_term
from lab.library.result import ErrorStatistics, number, sizes_mm
from lab.noise.rigid_distances import CoordinateNoise
from lab.phrases.diagnosis_phrases import HALF_95, deciding_measurement
from lab.phrases.fit_phrases import range_text
from lab.phrases.phrase import in_one_line, phrase, phrases
from lab.prediction.estimate_files import measured_range_to_dict, residual_to_dict
from lab.prediction.validation import TruthComparison
from lab.prediction.workspace_prediction import Distance, RegionPrediction, ValidationBounds
from lab.robots.config_file import SCHEMA
from lab.verdict.fitted import Named
from lab.verdict.remaining_error import ExplainedError, RemainingError
from lab.verdict.verdict import Answer, rotation_noise_rad

if TYPE_CHECKING:
    from lab.library.calibration_result import CalibrationResult

__all__ = ["calibration_values", "diagnosis_to_dict", "direction_to_dict"]


def calibration_values(result: "CalibrationResult") -> dict[str, Any]:
    """Return the values of a result by the keys of ``result.json``."""
    comparison = None if result.truth is None else result.truth.comparison
    return {
        "schema": SCHEMA,
        "robot": result.robot.name,
        "serial": result.options.serial,
        **_fit(result),
        **_verdict(result),
        **_noise(result),
        **_predictions(result),
        **_model(result),
        **_determination(result),
        "exports": result.exports(),
        "warnings": list(result.warnings),
        **({} if comparison is None else {"truth": _truth_to_dict(result, comparison)}),
    }


def _fit(result: "CalibrationResult") -> dict[str, Any]:
    """The measurements, and how the fit went."""
    identification = result.identification
    return {
        "poses": result.poses,
        "targets": list(result.fitted.targets),
        "parameters": len(identification.model.names),
        "identifiable": len(identification.base_set.identifiable),
        "rank": identification.fit.rank,
        "condition": number(identification.fit.condition),
        "plain_condition": number(identification.plain_condition),
        "prior": _prior(result),
        "estimator": result.options.fitting.estimator,
        "status": identification.status,
        "iterations": identification.fit.iterations,
        "seconds": round(result.seconds, 4),
        "freedom": identification.dof,
    }


def _verdict(result: "CalibrationResult") -> dict[str, Any]:
    """The verdict, its reasons, and the errors at the validation poses."""
    verdict = result.verdict
    return {
        "verdict": verdict.word,
        "reason": in_one_line(verdict.reasons),
        "reasons": list(phrases(verdict.reasons)),
        "gate_mm": result.options.gate_mm,
        "findings": [diagnosis_to_dict(each) for each in result.diagnosis],
        "answers": {name: _answer_to_dict(each) for name, each in verdict.answers.items()},
        "judged_by": result.validation.judged_by,
        "before_mm": result.before.to_dict() if result.validated else None,
        "after_mm": result.after.to_dict() if result.validated else None,
        "after_without_outliers_mm": _optional(ErrorStatistics.to_dict, result.after_without_outliers),
    }


def _noise(result: "CalibrationResult") -> dict[str, Any]:
    """The noise of the measurements, given or estimated, and what was found about the errors."""
    identification, state = result.identification, result.state
    noises, residuals = (
        {MM: float("nan")} | dict(result.kind.noises(identification.model, sigma))
        for sigma in (identification.sigma_m, identification.residual_sigma_m)
    )
    return {
        **{f"noise_{unit.key}": number(unit.of(size)) for unit, size in noises.items()},
        "noise_mrad": number(MRAD.of(rotation_noise_rad(identification))),
        "noise_known": identification.sigma_given,
        "cluster_robust": identification.dof_each is not None and state.noise.shared is None,
        "noise_tail_freedom": number(state.tail_dof),
        "noise_model": noise_model_to_dict(state.noise.shared, state.noise.component_errors),
        "noise_findings": [_finding_to_dict(each) for each in state.findings],
        "instrument_noise": _optional(_instrument_to_dict, state.instrument),
        "range_errors": _optional(_range_to_dict, state.range),
        **{f"residual_{unit.key}": number(unit.of(size)) for unit, size in residuals.items()},
        "remaining_error": _remaining_to_dict(state.remaining, state.gain),
    }


def _range_to_dict(found: FittedRange) -> dict[str, Any]:
    return {
        "constant_mm": MM.of(found.constant_m),
        "std_mm": MM.of(found.std_m),
        "interval_95_mm": [MM.of(found.constant_m + sign * found.half_width_95_m) for sign in (-1, 1)],
        "prior_mm": None if found.prior_m is None else MM.of(found.prior_m),
        "scale_std_ppm": PPM.of(found.scale_std),
        "in_frame": found.in_frame,
        "in_shape": found.in_shape,
        "words": range_text(found),
    }


def _predictions(result: "CalibrationResult") -> dict[str, Any]:
    """The errors that are to be expected."""
    verdict, state = result.verdict, result.state
    return {
        "prediction_at_validation": _optional(_prediction_to_dict, verdict.prediction),
        "predicted_mm": number(MM.of(verdict.workspace.rms_m)),
        "predicted_95_mm": number(MM.of(verdict.workspace.p95_m)),
        "prediction": _optional(_region_to_dict, verdict.region),
        "prediction_elsewhere": _optional(_region_to_dict, verdict.elsewhere),
        "validation_bounds": _optional(_bounds_to_dict, state.bounds),
        "measured_range": measured_range_to_dict(state.measured, result.robot.chain),
        "extrapolation": _extrapolation(result),
        "farthest_link": _optional(_distance_to_dict, verdict.farthest),
    }


def _model(result: "CalibrationResult") -> dict[str, Any]:
    """The model that was fitted, and whether it is enough."""
    state = result.state
    return {
        "model": "+".join(("geometric", *state.groups, *[GROUP] * (state.process is not None))),
        "residual": residual_to_dict(state.process),
        "groups": [_group_to_dict(group, state.explained.get(group.name)) for group in result.groups],
        "adequate": result.adequate,
        "adequacy": phrase(state.adequacy),
        "stiffness_nm_per_rad": {each.joint: each.stiffness for each in result.stiffnesses},
        "stiffness_std_nm_per_rad": {each.joint: number(each.std) for each in result.stiffnesses},
    }


def _determination(result: "CalibrationResult") -> dict[str, Any]:
    """How well the measurements determine the parameters, and which of them are outliers."""
    return {
        "correlated": [
            {"parameters": [*pair], "correlation": correlation} for *pair, correlation in result.correlated_pairs
        ],
        "weak_directions": [direction_to_dict(each) for each in result.weak_directions],
        "outliers": [_outlier_to_dict(pose) for pose in result.state.outliers],
        "outliers_left_out": result.state.left_out,
    }


def _prior(result: "CalibrationResult") -> dict[str, Any]:
    """The tolerances as a prior: the number of directions in which it acts."""
    mode, acting = result.options.fitting.prior, result.identification.prior
    if acting is None:
        return {"mode": mode, "acts_in": 0}
    return {
        "mode": mode,
        "acts_in": acting.acts_in,
        "directions": acting.directions,
        "scale": acting.scale,
        "scale_from": acting.scale_from,
    }


def _extrapolation(result: "CalibrationResult") -> dict[str, Any] | None:
    """What the model may lack where nothing was measured."""
    if (measured := result.state.measured) is None:
        return None
    workspace, rows = result.verdict.workspace, result.validation.rows
    lacks = result.state.process is not None or measured.is_worse_beyond
    return {
        "growth_mrad": MRAD.of(measured.growth),
        "unsure_mrad": MRAD.of(measured.unsure),
        "workspace_beyond_share": workspace.beyond_share,
        "workspace_extrapolated_share": workspace.uncovered_share,
        "validation_extrapolated": None if rows is None else int((measured.uncovered(rows.joints) & lacks).sum()),
    }


def direction_to_dict(direction: Direction) -> dict[str, Any]:
    """A weak direction as plain values; ``parts`` in SI units."""
    return {
        "singular_value": direction.singular_value,
        "moved_mm": MM.of(direction.moved),
        "parts": dict(direction.parts),
    }


def _optional(to_dict: Callable[[Any], dict[str, Any]], value: Any) -> dict[str, Any] | None:
    return None if value is None else to_dict(value)


def _answer_to_dict(answer: Answer) -> dict[str, Any]:
    return {"standing": answer.standing, "words": in_one_line(answer.checks)}


def _finding_to_dict(finding: Check) -> dict[str, Any]:
    """An entry of ``noise_findings``."""
    return {
        "kind": finding.name.removeprefix("finding."),
        "size_mm": MM.of(finding.data["size_m"]),
        "supported": finding.outcome != "failed",
        "words": phrase(finding),
    }


def diagnosis_to_dict(finding: Finding) -> dict[str, Any]:
    """An entry of ``findings``: sizes in the units of their names, with the half-widths of their 95 % intervals."""
    of = finding.hypothesis
    units = [{"m": MM, "rad": MRAD}.get(unit, PPM) for unit in of.units]
    lengths = {"explains": finding.explains_m, "before": finding.before_m, "after": finding.after_m}
    return {
        "name": finding.name,
        "key": of.key,
        "of": list(of.of),
        "reading": finding.is_discrete,
        "accepted": finding.accepted,
        "sizes": [
            {"size": unit.of(size), "half_width_95": unit.of(HALF_95 * std), "unit": unit.name}
            for size, std, unit in zip(finding.sizes, finding.stds, units, strict=True)
        ],
        **{f"{name}_mm": number(MM.of(length)) for name, length in lengths.items()},
        "evidence": finding.evidence if np.isfinite(finding.evidence) else None,
        "rivals": list(finding.rivals),
        "deciding_measurement": deciding_measurement(finding.name, finding.rivals) or None,
        "words": phrase(finding.check),
    }


def _prediction_to_dict(prediction: Check) -> dict[str, Any]:
    """Observed and predicted 95 % errors at the validation poses, in mm."""
    sizes = {f"{name}_95_mm": MM.of(prediction.data[f"{name}_p95_m"]) for name in ("observed", "predicted", "allowed")}
    return {**sizes, "exceeded": prediction.outcome == "failed"}


def _instrument_to_dict(noise: CoordinateNoise) -> dict[str, Any]:
    """The noise by the distances between targets, in mm."""
    sizes = {"estimate_mm": noise.sigma_m, "low_mm": noise.low_m, "high_mm": noise.high_m}
    return {name: MM.of(size) for name, size in sizes.items()} | {
        "freedom": noise.dof,
        "rigid": noise.is_rigid,
        "words": noise.description,
    }


def _remaining_to_dict(remaining: RemainingError | None, gain: ExpectedGain | None) -> dict[str, Any] | None:
    if remaining is None:
        return None
    sizes = {"total_mm": remaining.total_m, "instrument_mm": remaining.instrument_m, "shared_mm": remaining.shared_m}
    alike = {"neighbouring_joints": remaining.over_joints, "successive_poses": remaining.over_time}
    return {name: number(MM.of(size)) for name, size in {**sizes, "rest_mm": remaining.rest_m}.items()} | {
        **{name: None if each is None else asdict(each) for name, each in alike.items()},
        "seen_not_taken": list(remaining.nearly),
        "measure_next": remaining.measure_next,
        "with_residual": None
        if gain is None
        else {"before_mm": MM.of(gain.before_m), "after_mm": MM.of(gain.after_m), "poses": gain.poses},
    }


def _region_to_dict(region: RegionPrediction) -> dict[str, Any]:
    """A prediction over a region, lengths in mm."""
    return {
        "region": region.kind,
        "poses": region.poses,
        **sizes_mm(region, "rms", "mean", "p95", "uncalibrated_rms"),
        "extrapolated_share": region.extrapolated_share,
    }


def _bounds_to_dict(bounds: ValidationBounds) -> dict[str, Any]:
    """Predicted and observed errors at the validation poses, lengths in mm."""
    return {
        **sizes_mm(bounds, "predicted_95", "observed_95"),
        "inside_share": bounds.inside_share,
        "inside_low": bounds.inside_low,
        "inside_high": bounds.inside_high,
        "extrapolated_share": bounds.extrapolated_share,
    }


def _truth_to_dict(result: "CalibrationResult", comparison: TruthComparison) -> dict[str, Any]:
    return {
        "max_abs_z": number(np.abs(comparison.z).max()),
        "nees_per_parameter": number(comparison.nees_per_parameter),
        "coverage_95": number(comparison.coverage_95),
        "max_abs_error": number(np.abs(comparison.error).max()),
        "bad_readings": 0 if result.truth is None else len(result.truth.outliers),
        "bad_named": result.detected_outliers,
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


def _distance_to_dict(distance: Distance) -> dict[str, Any]:
    """The link that is farthest from its nominal value, in mm or mrad and in tolerances."""
    unit = MRAD if distance.is_angle else MM
    return {"name": distance.name, f"distance_{unit.key}": unit.of(distance.size), "tolerances": distance.tolerances}


def _outlier_to_dict(pose: Named) -> dict[str, Any]:
    where = {} if pose.line is None else {"line": pose.line}
    return {"id": pose.id, **where, "size_mm": MM.of(pose.size_m), "p": pose.p, "held_out": pose.held_out}
