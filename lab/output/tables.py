"""What the commands print for a person: millimetres and degrees."""

from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console
from rich.table import Table

from lab.calibration.identifiability import Alias, aliases, poses_needed
from lab.frames import Array
from lab.geometry.chain import COLUMNS
from lab.geometry.gauge import BaseSet, base_set
from lab.geometry.serial import SerialArm
from lab.output.result import column_scale, summary
from lab.study.campaign import Outcome
from lab.study.robots import Robot


def print_outcome(outcome: Outcome, folder: Path) -> None:
    """The campaign in a few lines: before and after, what was identified, where the run is."""
    console, result = Console(), summary(outcome)
    console.print(
        f"{result['robot']}: {result['poses']} poses, targets {', '.join(result['targets'])}: "
        f"{result['rank']} of {result['parameters']} parameters identified in {result['iterations']} steps, "
        f"condition {result['condition']:.1f}"
    )
    if result["after_mm"] is not None:
        console.print(f"position error in mm, judged by {_JUDGED[result['judged_by']]}:")
        table = Table()
        for heading in ("", "mean", "rms", "95 %", "max", "points"):
            table.add_column(heading, justify="right")
        for name in ("before", "after"):
            errors = result[f"{name}_mm"]
            numbers = [f"{errors[key]:.4f}" for key in ("mean", "rms", "p95", "max")]
            table.add_row(name, *numbers, str(errors["count"]))
        console.print(table)
    if result["noise_mm"] is not None:
        console.print(
            f"noise {1e3 * result['noise_mm']:,.4g} µm per axis, {'given' if result['noise_known'] else 'estimated'}"
        )
    if (truth := result.get("truth")) and truth["max_abs_z"] is not None:
        console.print(
            f"against the truth: the largest error is {truth['max_abs_z']:.2f} σ, "
            f"NEES {truth['nees_per_parameter']:.2f} a parameter, "
            f"{100 * truth['coverage_95']:.0f} % of the 95 % intervals hold"
        )
    for outlier in result["outliers"][:5]:
        line = f" (line {outlier['line']})" if "line" in outlier else ""
        console.print(f"outlier: pose {outlier['id']}{line} is off by {outlier['size_mm']:.3f} mm")
    console.print(f"verdict: {result['verdict']}" + (f" ({result['reason']})" if result["reason"] else ""))
    console.print(f"run: {folder}", soft_wrap=True)


_JUDGED = {
    "fresh": "fresh poses, without noise",
    "holdout": "poses held out, with the instrument's noise",
    "file": "the validation file, with the instrument's noise",
    "cross-validation": "five-fold cross-validation, with the instrument's noise",
}


def inspection(robot: Robot, targets: tuple[str, ...]) -> dict[str, Any]:
    """A robot's table, limits, identifiable and aliased parameters. Millimetres and degrees."""
    arm, structure, hidden = _structure(robot, targets)
    chain = robot.chain
    joints = []
    for i, name in enumerate(chain.joint_names):
        cells = {f"{c}_{'mm' if c in 'da' else 'deg'}": _shown(c, chain.table[i, j]) for j, c in enumerate(COLUMNS)}
        unit, scale = ("mm", 1e3) if chain.prismatic[i] else ("deg", 180 / np.pi)
        limits = {
            f"lower_{unit}": _tidy(chain.lower[i] * scale),
            f"upper_{unit}": _tidy(chain.upper[i] * scale),
            f"speed_{unit}_per_s": _tidy(chain.speed[i] * scale) if np.isfinite(chain.speed[i]) else None,
        }
        kind = "prismatic" if chain.prismatic[i] else "revolute"
        joints.append({"name": name, "type": kind, "sign": int(chain.sign[i]), **cells, **limits})
    return {
        "robot": robot.name,
        "convention": chain.convention,
        "joints": joints,
        "targets": list(targets),
        "parameters": len(arm.names),
        "rank": len(structure.kept),
        "identifiable": [arm.names[i] for i in structure.kept],
        "aliases": {alias.name: dict(alias.into) for alias in hidden},
        "poses_needed": poses_needed(arm, arm.nominal(robot.tool), structure),
    }


def print_inspection(robot: Robot, targets: tuple[str, ...]) -> None:
    """The same for a person."""
    console, seen = Console(), inspection(robot, targets)
    order = "Rz(θ) Tz(d) Tx(a) Rx(α)" if seen["convention"] == "distal" else "Rx(α) Tx(a) Rz(θ) Tz(d)"
    console.print(f"{robot.name}: Denavit-Hartenberg, {seen['convention']}, {order}; mm and °")
    table = Table()
    for heading in ("i", "θ", "d", "a", "α", "limits", "speed per s"):
        table.add_column(heading, justify="right", no_wrap=True)
    for i, joint in enumerate(seen["joints"]):
        unit = "mm" if joint["type"] == "prismatic" else "deg"
        reading = ("" if joint["sign"] > 0 else "−") + joint["name"]
        theta, d = _number(joint["theta_deg"]), _number(joint["d_mm"])
        moved = _with_reading(reading, joint["d_mm" if unit == "mm" else "theta_deg"])
        theta, d = (theta, moved) if unit == "mm" else (moved, d)
        speed = joint[f"speed_{unit}_per_s"]
        limits = f"{_number(joint[f'lower_{unit}'])} … {_number(joint[f'upper_{unit}'])}"
        table.add_row(
            str(i + 1),
            theta,
            d,
            _number(joint["a_mm"]),
            _number(joint["alpha_deg"]),
            limits,
            "–" if speed is None else _number(speed),
        )
    console.print(table)
    console.print(
        f"{seen['rank']} of {seen['parameters']} parameters can be identified from positions of "
        f"{', '.join(targets)}, from {seen['poses_needed']} poses or more:"
    )
    for group in dict.fromkeys(name.rsplit(".", 1)[0] for name in seen["identifiable"]):
        members = [name.rsplit(".", 1)[1] for name in seen["identifiable"] if name.rsplit(".", 1)[0] == group]
        console.print(f"  {group}: {' '.join(members)}")
    console.print("fixed at nominal, because an error of it looks like errors of others:")
    for name, into in seen["aliases"].items():
        console.print(f"  {name} is hidden in {', '.join(into) or 'nothing: it moves no target'}", soft_wrap=True)


def _structure(robot: Robot, targets: tuple[str, ...]) -> tuple[SerialArm, BaseSet, tuple[Alias, ...]]:
    robot.refuse_unknown(targets)
    arm = robot.arm(targets)
    nominal = arm.nominal(robot.tool)
    structure = base_set(arm, nominal)
    return arm, structure, aliases(arm, structure, column_scale(arm, nominal))


def _shown(column: str, value: Array) -> float:
    return _tidy(float(value) * (1e3 if column in "da" else 180 / np.pi))


def _tidy(value: float) -> float:
    """Without the last digits of a unit's conversion, and without minus zero."""
    return round(float(value), 9) + 0.0


def _number(value: float) -> str:
    """As facts of a drawing are printed: whole numbers without a point, a true minus sign."""
    return f"{value:.6g}".replace("-", "−")


def _with_reading(reading: str, offset: float) -> str:
    if offset == 0:
        return reading
    return f"{reading} {'−' if offset < 0 else '+'} {_number(abs(offset))}"
