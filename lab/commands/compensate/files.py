"""The files of corrected targets: tables for people, programs for controllers, and the calibrated arm."""

import csv
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from lab.commands.compensate.result import CompensationResult
from lab.commands.run_folder import config, write_json
from lab.core import se3
from lab.core.se3 import Array
from lab.formats.programs.protocol import TargetMoves
from lab.formats.programs.registry import target_files

__all__ = ["write_files"]

JOINTS, CARTESIAN, NOMINAL = "joints.csv", "cartesian.csv", "nominal.toml"


def write_files(folder: Path, result: CompensationResult) -> None:
    """Write the corrected targets and the calibrated arm in every format, and ``result.json``."""
    run, rows = result.run, np.flatnonzero(result.found.converged)
    write_json(folder / "config.json", config("compensate", result.options, run.robot.sha256))
    _write_csv(folder / JOINTS, result, rows, _joint_columns(result, rows))
    _write_csv(folder / CARTESIAN, result, rows, _cartesian_columns(result, rows) | _joint_columns(result, rows))
    nominal_inverse = run.nominal_inverse(result.target)  # what the corrected targets are for
    nominal = run.robot.description(run.robot.exact_file, nominal_inverse.arm.targets, nominal_inverse.values)
    (folder / NOMINAL).write_text(nominal, encoding="utf-8")
    arm, values = run.geometry
    for name in run.robot.description_files:
        (folder / name).write_text(run.robot.description(name, arm.targets, values), encoding="utf-8")
    if len(rows):
        for name, content in target_files(run.robot.chain, _moves(result, rows)).items():
            (folder / name).write_bytes(content)
    write_json(folder / "result.json", result.to_dict())


def _moves(result: CompensationResult, rows: NDArray[np.int_]) -> TargetMoves:
    """What a controller's program is made from, with the base and tool that suit the controller's links."""
    run, nominal_inverse = result.run, result.run.nominal_inverse(result.target)
    T_instrument_frame0 = nominal_inverse.arm.T_tracker_frame0(nominal_inverse.values)
    ids = [result.targets.ids[i] for i in rows]
    T_last_tool = se3.pose(run.R_last_tool, nominal_inverse.tools[result.target])
    return TargetMoves(run.robot.name, ids, result.found.joints[rows], T_last_tool, se3.inverse(T_instrument_frame0))


def _joint_columns(result: CompensationResult, rows: NDArray[np.int_]) -> dict[str, Array]:
    chain, joints = result.run.robot.chain, result.found.joints[rows]
    columns = {}
    for name, slides, values in zip(chain.joint_names, chain.prismatic, joints.T, strict=True):
        columns[f"{name}_{'mm' if slides else 'deg'}"] = 1e3 * values if slides else np.rad2deg(values)
    return columns


def _cartesian_columns(result: CompensationResult, rows: NDArray[np.int_]) -> dict[str, Array]:
    """Positions in mm and quaternions wxyz, in the frame of the targets' file."""
    positions, tool = 1e3 * result.found.positions[rows], result.targets.tool
    quaternions = se3.quaternion_from_rotation(result.R_targets[rows])
    columns = {f"{tool}_{axis}_mm": values for axis, values in zip("xyz", positions.T, strict=True)}
    return columns | {f"{tool}_q{part}": values for part, values in zip("wxyz", quaternions.T, strict=True)}


def _write_csv(path: Path, result: CompensationResult, rows: NDArray[np.int_], columns: dict[str, Array]) -> None:
    """One row a target that is reached, with what was set there."""
    every = columns | {name: column[rows] for name, column in result.targets.conditions.items()}
    with path.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(["id", *every])
        for i, *values in zip(rows.tolist(), *every.values(), strict=True):
            writer.writerow([result.targets.ids[i], *(repr(float(value)) for value in values)])
