"""The files of corrected targets: tables for people, programs for controllers, and the calibrated arm."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lab.commands.calibrate.exports import comment_of_lacking
from lab.commands.compensate.result import CompensationResult
from lab.commands.stops import joint_columns
from lab.core import se3
from lab.core.se3 import Array
from lab.formats.calibrated_module import MODULE_FILE
from lab.formats.csv_table import write_columns
from lab.formats.programs.postures import postures_of
from lab.formats.programs.protocol import TargetMoves
from lab.formats.programs.registry import refusal, target_files

__all__ = ["write_files"]

JOINTS, CARTESIAN, NOMINAL = "joints.csv", "cartesian.csv", "nominal.toml"


def write_files(folder: Path, result: CompensationResult) -> None:
    """Write the corrected targets and the calibrated arm in every format."""
    run, rows = result.run, np.flatnonzero(result.found.converged)
    chain, ids = run.robot.chain, {"id": [result.targets.ids[i] for i in rows]}
    lone = result.extrapolated
    marked = {"extrapolated": _yes(lone[rows])} if lone.any() else {}
    _write_csv(folder / JOINTS, result, {**result.stops.columns(chain), **_stop_conditions(result)})
    at_targets = {**_cartesian_columns(result, rows), **joint_columns(chain, result.found.joints[rows])}
    _write_csv(folder / CARTESIAN, result, {**ids, **at_targets, **_conditions(result, rows), **marked})
    nominal_inverse = run.estimate.nominal_inverse(result.target)  # what the corrected targets are for
    exact = run.robot.description_files[-1]
    nominal = run.robot.description(exact, nominal_inverse.arm.targets, nominal_inverse.values)
    (folder / NOMINAL).write_text(nominal, encoding="utf-8")
    arm, values = run.estimate.geometry
    module, refused = run.export(result.arm_inputs[rows]).module()
    off = result.without_effects_m
    lacking = comment_of_lacking(run.estimate.groups, off, "at the corrected targets", module=refused is None)
    for name in run.robot.description_files:
        if text := run.robot.description(name, arm.targets, values, lacking):
            (folder / name).write_text(text, encoding="utf-8")
    (folder / MODULE_FILE).write_text(module, encoding="utf-8")
    if result.program is not None:
        (folder / result.program.name).write_bytes(result.program.content)
    elif len(rows) and refusal(chain, result.options.controller, len(result.targets)) is None:
        for name, content in target_files(run.robot.chain, result.options.controller, _moves(result)).items():
            (folder / name).write_bytes(content)


def _moves(result: CompensationResult) -> TargetMoves:
    """What a controller's program is made from, with the base and tool that suit the controller's links."""
    run, nominal_inverse = result.run, result.run.estimate.nominal_inverse(result.target)
    T_instrument_frame0 = nominal_inverse.arm.T_tracker_frame0(nominal_inverse.values)
    T_last_tool, stops = se3.pose(run.estimate.R_last_tool, nominal_inverse.tools[result.target]), result.stops
    T_frame0_instrument = se3.inverse(T_instrument_frame0)
    postures = postures_of(nominal_inverse.arm, nominal_inverse.values, stops.joints)
    return TargetMoves(
        run.robot.name, stops.ids, stops.joints, stops.which, T_last_tool, T_frame0_instrument, result.checked, postures
    )


def _cartesian_columns(result: CompensationResult, rows: NDArray[np.int_]) -> dict[str, Any]:
    """Positions in mm and quaternions wxyz, in the frame of the targets' file."""
    positions, tool = 1e3 * result.found.positions[rows], result.targets.tool
    quaternions = se3.quaternion_from_rotation(result.found.rotations[rows] @ result.run.estimate.R_last_tool)
    columns = {f"{tool}_{axis}_mm": values for axis, values in zip("xyz", positions.T, strict=True)}
    return columns | {f"{tool}_q{part}": values for part, values in zip("wxyz", quaternions.T, strict=True)}


def _conditions(result: CompensationResult, rows: NDArray[np.int_]) -> dict[str, Any]:
    """What was set at targets."""
    return {name: column[rows] for name, column in result.targets.conditions.items()}


def _stop_conditions(result: CompensationResult) -> dict[str, list[Any]]:
    """What was set at the targets among the stops; empty where a stop is none."""
    rows, which = np.flatnonzero(result.found.converged), result.stops.which
    return {
        name: [column[rows[pose]] if pose >= 0 else "" for pose in which.tolist()]
        for name, column in result.targets.conditions.items()
    }


def _yes(flags: NDArray[np.bool_]) -> list[str]:
    """Flags in words."""
    return ["yes" if flag else "no" for flag in flags]


def _write_csv(path: Path, result: CompensationResult, columns: Mapping[str, Sequence[Any] | Array]) -> None:
    """A column says so where nothing was checked."""
    if not result.checked:
        columns = {**columns, "checked": ["no"] * len(columns["id"])}
    write_columns(path, columns)
