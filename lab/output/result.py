"""A campaign's outcome as the plain values that its JSON files hold. NaN becomes null."""

from typing import Any

import numpy as np

from lab.calibration.identifiability import aliases
from lab.frames import Array
from lab.geometry.model import Model, unit_of
from lab.seeds import stream
from lab.study.campaign import Outcome

OUTLIER_SIGMAS = 6.0  # in robust standard deviations of a coordinate; a mark, not a test with a level
_MEDIAN_LENGTH = 1.5382  # of a vector of three standard normal coordinates


def summary(outcome: Outcome) -> dict[str, Any]:
    """What ``result.json`` holds and ``--json`` prints. Lengths in mm."""
    identification, errors = outcome.identification, outcome.judgement.errors
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
        "judged_by": outcome.judgement.judged_by,
        "before_mm": None if errors is None else statistics(errors.before),
        "after_mm": None if errors is None else statistics(errors.after),
        "noise_mm": number(1e3 * identification.sigma_m),
        "noise_known": identification.sigma_known,
        "outliers": outliers(outcome),
        "warnings": list(outcome.warnings),
    }
    if (comparison := outcome.comparison) is not None:
        result["truth"] = {
            "max_abs_z": number(np.abs(comparison.z).max()),
            "nees_per_parameter": number(comparison.nees_per_parameter),
            "coverage_95": number(comparison.coverage_95),
            "max_abs_error": number(np.abs(comparison.error).max()),
        }
    return result


def parameters(outcome: Outcome) -> list[dict[str, Any]]:
    """What ``parameters.json`` holds: every parameter, in m and rad."""
    identification = outcome.identification
    model, free = identification.model, list(identification.fit.free)
    std = dict(zip(free, identification.std, strict=True))
    scale = column_scale(model, identification.before)
    hidden = {alias.name: dict(alias.into) for alias in aliases(model, identification.base_set, scale)}
    rows = []
    for i, name in enumerate(model.names):
        estimate, half = float(identification.values[i]), identification.half_width_95 * std.get(i, np.nan)
        interval = [number(estimate - half), number(estimate + half)]
        rows.append(
            {
                "name": name,
                "unit": unit_of(name),
                "nominal": float(identification.before[i]),
                "estimate": estimate,
                "std": number(std.get(i, np.nan)),
                "interval_95": None if None in interval else interval,
                "status": "identified" if i in std else "not seen" if i in identification.unseen else "fixed",
                "aliases": hidden.get(name, {}),
            }
        )
    return rows


def column_scale(model: Model, values: Array) -> Array:
    """Norms ``(p,)`` of the Jacobian's columns at nominal links: how far a unit of each moves the targets."""
    joints = model.structure_joints(50, stream(0, "structure"))
    _, jacobian = model.observe(joints, model.structural(values))
    scale: Array = np.linalg.norm(jacobian.reshape(-1, len(model.names)), axis=0)
    return scale


def outliers(outcome: Outcome) -> list[dict[str, Any]]:
    """Fitted poses whose residual stands far out of the others'; they were fitted all the same."""
    lengths = np.linalg.norm(outcome.identification.residuals, axis=2)  # (n, k)
    scale = np.nanmedian(lengths) / _MEDIAN_LENGTH
    worst = np.nanmax(np.where(np.isnan(lengths), 0.0, lengths), axis=1)
    far = [int(i) for i in np.argsort(-worst) if worst[i] > OUTLIER_SIGMAS * max(scale, 1e-9)]
    lines = outcome.fitted.lines
    where = [{"line": lines[i]} if lines else {} for i in far]
    sizes = [round(1e3 * float(worst[i]), 6) for i in far]
    return [{"id": outcome.fitted.ids[i], **at, "size_mm": mm} for i, at, mm in zip(far, where, sizes, strict=True)]


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
