"""Corrected targets as files for controllers and other tools, as plain values, and in print."""

import csv
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rich.console import Console
from rich.table import Table

from lab.commands.calibrate.result import number
from lab.commands.compensate.options import CompensateOptions
from lab.commands.compensate.run import CompensationResult
from lab.commands.run_folder import config, write_json
from lab.compensation.ik_results import NEAR_RAD
from lab.core import se3
from lab.core.se3 import Array
from lab.formats.programs.protocol import TargetMoves
from lab.formats.programs.registry import refusals, target_files

MOST_FAILED = 10  # that are printed
JOINTS, CARTESIAN, NOMINAL = "joints.csv", "cartesian.csv", "nominal.toml"


def correction_summary(done: CompensationResult) -> dict[str, Any]:
    """What ``result.json`` holds and ``--json`` prints. Lengths in mm."""
    found, converged = done.found, done.found.converged
    near = np.flatnonzero(converged & (found.singular_rad < NEAR_RAD))
    names = done.run.robot.chain.joint_names
    return {
        "run": str(done.run.folder),
        "robot": done.run.robot.name,
        "tool": done.targets.tool,
        "model": "+".join(("geometric", *done.run.groups)),
        "targets": len(done.targets),
        "converged": int(converged.sum()),
        "failed": [
            {"id": name, "reason": reason}
            for name, reason in zip(done.targets.ids, found.reasons, strict=True)
            if reason
        ],
        "correction_mm": _mean_and_max(1e3 * done.correction_m[converged]),
        "predicted_mm": _mean_and_max(1e3 * done.predicted_m[converged]),
        "judged_mm": None if (judged := done.run.result.get("after_mm")) is None else judged["mean"],
        "schemes_apart_mm": number(1e3 * found.scheme_disagreement_m[converged].max()) if converged.any() else None,
        "near_singular": [
            {"id": done.targets.ids[i], "joint": names[found.singular_joint[i]], **_distance(done, int(i))}
            for i in near
        ],
        "without_effects_mm": None if done.without_effects_m is None else 1e3 * done.without_effects_m,
        "warnings": warnings_of(done),
    }


def _distance(done: CompensationResult, target: int) -> dict[str, float]:
    """To the nearest singularity, as the joint that leads there counts it."""
    distance = float(done.found.singular_rad[target])
    slides = done.run.robot.chain.prismatic[done.found.singular_joint[target]]
    return {"distance_mm": 1e3 * distance} if slides else {"distance_deg": float(np.rad2deg(distance))}


def warnings_of(done: CompensationResult) -> list[str]:
    """What a reader should be told."""
    said, gate = list(done.warnings), done.run.options.get("gate_mm")
    expected = 1e3 * done.predicted_m[done.found.converged]
    if gate is not None and len(expected) and expected.mean() > gate:
        said.append(
            f"the expected error is {expected.mean():.3g} mm: these targets are far from where the arm was measured"
        )
    return [*said, *refusals(done.run.robot.chain)]


def _mean_and_max(values: Array) -> dict[str, float | None]:
    seen = values[np.isfinite(values)]
    return {"mean": float(seen.mean()) if len(seen) else None, "max": float(seen.max()) if len(seen) else None}


def write_correction(folder: Path, done: CompensationResult, options: CompensateOptions) -> None:
    """The corrected targets and the arm, in every format."""
    run, rows = done.run, np.flatnonzero(done.found.converged)
    write_json(folder / "config.json", config("compensate", options, run.robot.sha256))
    _write_csv(folder / JOINTS, done, rows, _joint_columns(done, rows))
    _write_csv(folder / CARTESIAN, done, rows, _cartesian_columns(done, rows) | _joint_columns(done, rows))
    drawing = run.nominal_inverse(done.target)  # what the corrected targets are for
    nominal = run.robot.description(run.robot.exact_file, drawing.arm.targets, drawing.values)
    (folder / NOMINAL).write_text(nominal, encoding="utf-8")
    arm, values = run.geometry
    for name in run.robot.description_files:
        (folder / name).write_text(run.robot.description(name, arm.targets, values), encoding="utf-8")
    if len(rows):
        for name, content in target_files(run.robot.chain, _moves(done, rows)).items():
            (folder / name).write_bytes(content)
    write_json(folder / "result.json", correction_summary(done))


def _moves(done: CompensationResult, rows: NDArray[np.int_]) -> TargetMoves:
    """What a controller's program is made from, with the base and tool that suit the controller's links."""
    run, drawing = done.run, done.run.nominal_inverse(done.target)
    T_instrument_frame0 = drawing.arm.T_tracker_frame0(drawing.values)
    ids = [done.targets.ids[i] for i in rows]
    T_last_tool = se3.pose(run.R_last_tool, drawing.tools[done.target])
    return TargetMoves(run.robot.name, ids, done.found.joints[rows], T_last_tool, se3.inverse(T_instrument_frame0))


def _joint_columns(done: CompensationResult, rows: NDArray[np.int_]) -> dict[str, Array]:
    chain, joints = done.run.robot.chain, done.found.joints[rows]
    columns = {}
    for name, slides, values in zip(chain.joint_names, chain.prismatic, joints.T, strict=True):
        columns[f"{name}_{'mm' if slides else 'deg'}"] = 1e3 * values if slides else np.rad2deg(values)
    return columns


def _cartesian_columns(done: CompensationResult, rows: NDArray[np.int_]) -> dict[str, Array]:
    """Positions in mm and quaternions wxyz, in the frame of the targets' file."""
    places, tool = 1e3 * done.found.positions[rows], done.targets.tool
    quaternions = se3.quaternion_from_rotation(done.R_targets[rows])
    columns = {f"{tool}_{axis}_mm": values for axis, values in zip("xyz", places.T, strict=True)}
    return columns | {f"{tool}_q{part}": values for part, values in zip("wxyz", quaternions.T, strict=True)}


def _write_csv(path: Path, done: CompensationResult, rows: NDArray[np.int_], columns: dict[str, Array]) -> None:
    """One row a target that is reached, with what was set there."""
    every = columns | {name: column[rows] for name, column in done.targets.conditions.items()}
    with path.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(["id", *every])
        for i, *values in zip(rows.tolist(), *every.values(), strict=True):
            writer.writerow([done.targets.ids[i], *(repr(float(value)) for value in values)])


def print_correction(done: CompensationResult, folder: Path) -> None:
    """What became of the targets, in a few lines: how far they were moved, which fail and why."""
    console, result = Console(markup=False), correction_summary(done)
    console.print(
        f"{result['robot']}, {result['model'].replace('+', ' + ')}: "
        f"{result['converged']} of {result['targets']} targets of {result['tool']} corrected"
    )
    if result["converged"]:
        moved, predicted, judged = result["correction_mm"], result["predicted_mm"], result["judged_mm"]
        console.print(f"moved by {moved['mean']:.4f} mm on average, {moved['max']:.4f} mm at most")
        if predicted["mean"] is not None:
            seen = "" if judged is None else f"; at poses that the run had not seen it was {judged:.4f} mm"
            console.print(f"expected error: {predicted['mean']:.4f} mm on average{seen}")
    if result["failed"]:
        table = Table("target", "why it is not reached")
        for each in result["failed"][:MOST_FAILED]:
            table.add_row(each["id"], each["reason"])
        console.print(table)
        if (more := len(result["failed"]) - MOST_FAILED) > 0:
            console.print(f"and {more} more, in result.json")
    if near := result["near_singular"]:
        listed = ", ".join(f"{each['id']} ({each['joint']})" for each in near[:MOST_FAILED])
        console.print(f"reached, but within 1° of a singularity: {listed}{', …' if len(near) > MOST_FAILED else ''}")
    console.print(f"files: {folder}", soft_wrap=True)
