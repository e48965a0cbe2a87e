"""A campaign's outcome as the plain values that its JSON files hold. NaN becomes null."""

from typing import Any

import numpy as np

from lab.calibration.identifiability import Direction, aliases, weak_directions
from lab.calibration.identify import Identification
from lab.calibration.most_likely_parameters import most_likely_parameters
from lab.calibration.observations.protocol import observation_of
from lab.calibration.uncertainty import position_covariance
from lab.calibration.verdict import rotation_noise_rad
from lab.commands.calibrate.run import CalibrationResult
from lab.core.random import rng_for
from lab.core.se3 import Array
from lab.kinematics.model import Model, RigidArm
from lab.kinematics.parameter import targets_of

CORRELATED = 0.95  # where two parameters' errors go together
_HUMAN_UNITS = {
    "m": (1e3, "mm", 4),
    "rad/Nm": (1e6, "µrad/Nm", 3),
    "": (1e6, "ppm", 2),
    "m/N": (1e6, "µm/N", 3),
    "kg": (1.0, "kg", 3),
    "m/h": (1e3, "mm/h", 4),
    "rad/h": (1e3, "mrad/h", 4),
    "1/h": (1e6, "ppm/h", 2),
}


def summary(outcome: CalibrationResult) -> dict[str, Any]:
    """What ``result.json`` holds and ``--json`` prints. Lengths in mm."""
    identification, errors, bends = outcome.identification, outcome.validation.errors, stiffness(outcome)
    result: dict[str, Any] = {
        "robot": outcome.robot.name,
        "poses": len(outcome.fitted),
        "targets": list(outcome.fitted.targets),
        "parameters": len(identification.model.names),
        "identifiable": len(identification.base_set.kept),
        "rank": identification.fit.rank,
        "condition": number(identification.fit.condition),
        "status": identification.status,
        "iterations": identification.fit.iterations,
        "seconds": round(outcome.seconds, 4),
        "verdict": outcome.verdict.word,
        "reason": outcome.verdict.reason,
        "judged_by": outcome.validation.judged_by,
        "before_mm": None if errors is None else statistics(errors.before),
        "after_mm": None if errors is None else statistics(errors.after),
        "noise_mm": number(1e3 * identification.sigma_m),
        "noise_mrad": number(1e3 * rotation_noise_rad(identification)),
        "noise_known": identification.sigma_known,
        "residual_mm": number(1e3 * identification.residual_sigma_m),
        "freedom": identification.dof,
        "predicted_mm": number(1e3 * predicted_rms(identification)),
        "model": "+".join(("geometric", *outcome.fit.groups)),
        "groups": groups(outcome),
        "adequate": outcome.fit.adequacy.adequate,
        "adequacy": outcome.fit.adequacy.words,
        "stiffness_nm_per_rad": {joint: found["stiffness"] for joint, found in bends.items()},
        "stiffness_std_nm_per_rad": {joint: number(found["std"]) for joint, found in bends.items()},
        "correlated": correlated(identification),
        "weak_directions": weak(outcome),
        "outliers": outliers(outcome),
        "outliers_left_out": outcome.fit.left_out,
        "warnings": list(outcome.warnings),
    }
    if (comparison := outcome.comparison) is not None:
        result["truth"] = {
            "max_abs_z": number(np.abs(comparison.z).max()),
            "nees_per_parameter": number(comparison.nees_per_parameter),
            "coverage_95": number(comparison.coverage_95),
            "max_abs_error": number(np.abs(comparison.error).max()),
            "bad_readings": len(outcome.bad),
            "bad_named": len(outcome.bad & {pose.id for pose in outcome.fit.outliers}),
        }
    return result


def parameters(outcome: CalibrationResult) -> list[dict[str, Any]]:
    """What ``parameters.json`` holds: every parameter, in m and rad."""
    identification = outcome.identification
    model, free = identification.model, list(identification.fit.free)
    exported = likely(outcome)
    std = dict(zip(free, identification.std, strict=True))
    reach = dict(zip(free, identification.half_width_95 * identification.std, strict=True))
    scale = column_scale(model, identification.nominal_aligned)
    hidden = {alias.name: dict(alias.into) for alias in aliases(model, identification.base_set, scale)}
    rows = []
    for i, parameter in enumerate(model.parameters):
        name = parameter.name
        estimate, half = float(identification.values[i]), reach.get(i, np.nan)
        interval = [number(estimate - half), number(estimate + half)]
        rows.append(
            {
                "name": name,
                "unit": parameter.unit,
                "nominal": float(identification.nominal_aligned[i]),
                "estimate": estimate,
                "exported": float(exported[i]),
                "std": number(std.get(i, np.nan)),
                "interval_95": None if None in interval else interval,
                "status": _status(identification, i),
                "aliases": hidden.get(name, {}),
            }
        )
    return rows


def human_unit(name: str, unit: str | None = None) -> tuple[float, str, int]:
    """In what a person reads a parameter: the factor from SI, the unit, and how many digits after the point."""
    unit = unit or _unit_of(name)
    if unit == "rad":
        return (1e3, "mrad", 4) if _joint_of(name) else (180 / np.pi, "°", 5)
    return _HUMAN_UNITS[unit]


def column_scale(model: Model, values: Array) -> Array:
    """Norms ``(p,)`` of the Jacobian's columns at nominal links: how far a unit of each moves the targets."""
    joints = model.structure_joints(50, rng_for(0, "structure"))
    _, jacobian = model.observe(joints, model.rank_point(values))
    scale: Array = np.linalg.norm(jacobian.reshape(-1, len(model.names)), axis=0)
    return scale


_UNITS = dict.fromkeys(("x", "y", "z", "d", "a", "offset", "length"), "m")
_UNITS |= dict.fromkeys(("rx", "ry", "rz", "theta", "alpha", "beta", "sin", "cos", "backlash"), "rad")
_UNITS |= {"compliance": "rad/Nm", "mass": "kg"}


def _unit_of(name: str) -> str:
    """The SI unit of a parameter that a document has by name alone."""
    group, _, last = name.rpartition(".")
    unit = _UNITS.get(last.rstrip("0123456789"), "")
    return (f"{unit}/h" if unit else "1/h") if group == "drift" else unit


def _joint_of(name: str) -> str:
    """The number, from 1, of the joint that has an effect by this name; "" of a link's or another parameter."""
    joint = name.split(".")[0].removeprefix("joint")
    return joint if joint.isdigit() else ""


def _status(identification: Identification, parameter: int) -> str:
    if parameter in identification.fit.free:
        return "identified"
    if parameter in identification.base_set.held:
        return "held"
    return "not seen" if parameter in identification.unobservable else "fixed"


def likely(outcome: CalibrationResult) -> Array:
    """The exported parameters: those of the most likely arm among those that predict the same."""
    identification = outcome.identification
    return most_likely_parameters(identification, outcome.nominal, outcome.tolerance)


def rigid(outcome: CalibrationResult, values: Array) -> tuple[RigidArm, Array]:
    """The rigid arm and its part of parameters ``(p,)``: effects and what else was observed are left out."""
    arm = outcome.robot.arm(targets_of(outcome.identification.model.parameters))
    return arm, values[: len(arm.names)]


def groups(outcome: CalibrationResult) -> list[dict[str, Any]]:
    """What each group of parameters bought; none where geometry alone was asked for."""
    selection = outcome.fit.selection
    if selection is None:
        return []
    return [
        {
            "name": group.name,
            "parameters": group.parameters,
            "holdout_mm": number(1e3 * group.holdout_m),
            "f_p": number(group.f_p),
            "bic": number(group.bic),
            "chosen": group.chosen,
            "why_not": group.infeasibility_reason,
        }
        for group in selection.groups
    ]


def stiffness(outcome: CalibrationResult) -> dict[str, dict[str, float]]:
    """Stiffness of the hinges (Nm/rad) whose compliance was fitted and is above zero, with its standard deviation."""
    identification, chain = outcome.identification, outcome.robot.chain
    found = {}
    for i, std in zip(identification.fit.free, identification.std, strict=True):
        parameter = identification.model.parameters[i]
        if parameter.kind != "compliance" or parameter.joint is None or identification.values[i] <= 0:
            continue
        if not chain.prismatic[parameter.joint]:
            compliance = float(identification.values[i])
            found[chain.joint_names[parameter.joint]] = {"stiffness": 1 / compliance, "std": float(std) / compliance**2}
    return found


def correlated(identification: Identification) -> list[dict[str, Any]]:
    """Pairs of identified parameters that can hardly be told apart, the strongest first."""
    names, std = [identification.model.names[i] for i in identification.fit.free], identification.std
    if not (np.isfinite(std).all() and (std > 0).all()):
        return []
    matrix = np.triu(identification.covariance / np.outer(std, std), 1)
    pairs = np.argwhere(np.abs(matrix) > CORRELATED)
    order = sorted(pairs.tolist(), key=lambda pair: -abs(matrix[pair[0], pair[1]]))
    return [{"parameters": [names[i], names[j]], "correlation": round(float(matrix[i, j]), 4)} for i, j in order]


def weak(outcome: CalibrationResult) -> list[dict[str, Any]]:
    """Directions of the identified parameters that these measurements nearly do not see."""
    found = outcome.identification
    _, jacobian = found.model.observe(outcome.fitted.inputs(found.model.conditions), found.values)
    rows = jacobian[outcome.fitted.seen][..., list(found.fit.free)].reshape(-1, len(found.fit.free))
    return [direction_as_values(each) for each in weak_directions([found.model.names[i] for i in found.fit.free], rows)]


def direction_as_values(direction: Direction) -> dict[str, Any]:
    """A weak direction as plain values; ``parts`` in SI units."""
    return {
        "singular_value": direction.singular_value,
        "moved_mm": 1e3 * direction.moved,
        "parts": dict(direction.parts),
    }


def predicted_rms(identification: Identification) -> float:
    """Predicted position uncertainty (m) over the workspace: sqrt(tr J C J'), root mean square over random poses."""
    model = identification.model
    inputs = model.structure_joints(200, rng_for(0, "structure"))
    if not observation_of(model).positions:
        return float("nan")
    squares = np.trace(position_covariance(identification, inputs), axis1=1, axis2=2)
    return float(np.sqrt(squares.mean()))


def outliers(outcome: CalibrationResult) -> list[dict[str, Any]]:
    """Poses that are off by a test, the largest first."""
    found = []
    for pose in outcome.fit.outliers:
        where = {} if pose.line is None else {"line": pose.line}
        found.append({"id": pose.id, **where, "size_mm": 1e3 * pose.size_m, "p": pose.p, "held_out": pose.held_out})
    return found


def statistics(errors: Array) -> dict[str, float | int]:
    """Statistics in mm of errors in m; NaN is left out."""
    seen = 1e3 * errors[np.isfinite(errors)]
    return {
        "mean": float(seen.mean()),
        "rms": float(np.sqrt(np.mean(seen**2))),
        "p95": float(np.percentile(seen, 95)),
        "max": float(seen.max()),
        "count": int(seen.size),
    }


def number(value: float) -> float | None:
    """The value, or None where it is not finite."""
    return float(value) if np.isfinite(value) else None
