"""A plan as the values and files that a person takes to the measuring day. NaN becomes null."""

from pathlib import Path
from typing import Any

import numpy as np

from lab.commands.design.run import DesignStep, Plan
from lab.commands.run_folder import config, write_json
from lab.commands.values import error_statistics, number
from lab.core.measurements import Measurements, measured
from lab.core.se3 import Array
from lab.formats.measurement_csv import write_measurements
from lab.formats.programs.protocol import MeasuringTour
from lab.formats.programs.registry import plan_files, plan_or_refusal

_NUMBERED = ("o1", "o2", "o3", "o4", "o5", "condition", "a")
_VARIANCE = "mm², of the position on test poses, whatever the units of the parameters"


def plan_summary(plan: Plan) -> dict[str, Any]:
    """What ``result.json`` holds and ``--json`` prints. Lengths in mm."""
    options, candidates, tour = plan.options, plan.problem.candidates, plan.tour
    return {
        "robot": plan.problem.robot.name,
        "poses": len(plan.joints),
        "measured_already": len(plan.problem.already),
        "targets": list(options.targets),
        "instrument": options.instrument,
        "parameters": len(plan.problem.structure.kept),
        "criterion": options.criterion,
        "indices": _indices(plan),
        "d_efficiency": plan.d_efficiency,
        "bound_gap": plan.certificate.gap,
        "pool": {"poses": plan.pool, "what": pool_in_words(plan)},
        "predicted_mm": error_statistics(plan.prediction.rms).to_dict(),
        "promise_mm": 1e3 * plan.prediction.coverage_radius,
        "candidates": {
            "drawn": candidates.drawn,
            "feasible": len(candidates.joints),
            "rejected": {reason: int(count) for reason, count in candidates.rejected.items()},
        },
        "tour_seconds": float(tour.seconds),
        "moves": len(tour.stops) - 1,
        "via": int((tour.measured[1:-1] < 0).sum()),
        "curve": [_point(step) for step in plan.curve],
        **plan_or_refusal(plan.problem.robot.chain),
        "seconds": round(plan.seconds, 4),
        "warnings": list(plan.warnings),
    }


def pool_in_words(plan: Plan) -> str:
    """What the certificate is for."""
    candidates = len(plan.problem.candidates.joints)
    moved = plan.pool - candidates
    words = f"any {len(plan.joints)} of {candidates} feasible candidates"
    if len(plan.problem.already):
        words += f" added to the {len(plan.problem.already)} measured already"
    return words + (f" and the {moved} poses that the ascent moved off them" if moved else "")


def pose_ids(plan: Plan) -> tuple[str, ...]:
    """Numbers from 1 in the order of the tour; poses measured already were before."""
    first = len(plan.problem.already) + 1
    return tuple(str(first + i) for i in range(len(plan.joints)))


def plan_table(plan: Plan) -> Measurements:
    """The poses in the order of the tour, with nothing measured yet."""
    names, n = plan.problem.robot.chain.joint_names, len(plan.joints)
    points = np.full((n, len(plan.options.targets), 3), np.nan)
    data = measured(names, plan.joints, plan.options.targets, points)
    return Measurements(
        names, data.joints, data.targets, data.points, pose_ids(plan), data.use, data.sessions, data.sigma_m
    )


def write_plan(folder: Path, plan: Plan) -> None:
    """Everything of a plan but its pictures and its recording.

    ``plan.csv`` is what ``lab calibrate --plan`` measures, and, once its empty points are filled
    in, what ``lab identify`` reads.
    """
    robot = plan.problem.robot
    write_json(folder / "config.json", config("design", plan.options, robot.sha256))
    write_measurements(folder / "plan.csv", plan_table(plan), robot.chain.prismatic)
    tour = MeasuringTour(robot.name, plan.tour.stops, plan.tour.measured, pose_ids(plan))
    for name, content in plan_files(robot.chain, tour).items():
        (folder / name).write_bytes(content)
    write_json(folder / "result.json", plan_summary(plan))


def _indices(plan: Plan) -> dict[str, dict[str, Any]]:
    """Each index with its scaling; G and I are the worst and the mean predicted variance."""
    scaling, variance = plan.problem.scaling.describe(), (1e3 * plan.prediction.rms) ** 2
    found = {name: (getattr(plan.indices, name), scaling) for name in _NUMBERED}
    found |= {"g": (variance.max(), _VARIANCE), "i": (variance.mean(), _VARIANCE)}
    return {name: {"value": number(float(value)), "scaling": what} for name, (value, what) in found.items()}


def _point(step: DesignStep) -> dict[str, float | int]:
    rms: Array = 1e3 * step.prediction.rms
    return {
        "poses": step.poses,
        "rms_mm": float(np.sqrt(np.mean(rms**2))),
        "worst_mm": float(rms.max()),
        "promise_mm": 1e3 * step.prediction.coverage_radius,
        "o1": step.o1,
    }
