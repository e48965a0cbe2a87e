"""What a robot is, and what of it can be identified: as plain values, and in words."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from rich.console import Console
from rich.table import Table

from lab.calibration.identifiability import WEAK_CONDITION, aliases, poses_needed, scaled_condition, weak_directions
from lab.errors import LabError
from lab.frames import Array
from lab.geometry.chain import COLUMNS
from lab.geometry.gauge import base_set, named
from lab.output.result import column_scale, direction_as_values, human_unit, number
from lab.seeds import stream
from lab.study.advice import changes
from lab.study.option_groups import LARGEST
from lab.study.robots import Robot
from lab.study.shape import LEAST, shape_of

POSES = 200


@dataclass(frozen=True)
class Question:
    """What is asked of a robot: targets, and where the first is; groups of effects; parameters to fix or free."""

    robot: Robot
    targets: tuple[str, ...]
    groups: tuple[str, ...] = ()
    fix: tuple[str, ...] = ()
    free: tuple[str, ...] = ()
    place_mm: tuple[float, ...] = ()


def inspection(question: Question) -> dict[str, Any]:
    """A robot's table, limits, identifiable and aliased parameters. Millimetres and degrees; aliases in SI."""
    robot = question.robot
    arm, nominal = robot.arm_with(question.targets, question.groups), _nominal(question)
    structure = base_set(arm, nominal, fix=question.fix, free=question.free)
    hidden = aliases(arm, structure, column_scale(arm, nominal))
    settings = arm.structure_joints(POSES, stream(0, "structure"))
    jacobian = arm.observe(settings, arm.structural(nominal))[1].reshape(-1, len(arm.names))[:, list(structure.kept)]
    names = [arm.names[i] for i in structure.kept]
    condition, usual = scaled_condition(jacobian), not (question.fix or question.free)
    asked = named(arm.names, "--fix", question.fix)
    held = [arm.names[i] for i in structure.held]
    return {
        "robot": robot.name,
        "convention": robot.chain.convention,
        "joints": _joints(robot),
        "targets": list(question.targets),
        "parameters": len(arm.names),
        "rank": len(structure.kept),
        "identifiable": names,
        "held": [arm.names[i] for i in structure.held if i in asked],
        "told_apart": [arm.names[i] for i in structure.held if i not in asked],
        "aliases": {alias.name: dict(alias.into) for alias in hidden if alias.name not in held},
        "condition": number(condition),
        "weak_directions": [direction_as_values(each) for each in weak_directions(names, jacobian)],
        "changes": {
            change.words: number(change.condition)
            for change in (
                changes(robot, question.targets, question.groups, nominal, settings)
                if usual and condition > WEAK_CONDITION
                else ()
            )
        },
        "poses_needed": poses_needed(arm, nominal, structure),
        **_of_shape(robot),
    }


def _of_shape(robot: Robot) -> dict[str, Any]:
    """Reach, ways to a pose, the Jacobian's determinant, and an example of each singularity."""
    shape, names = shape_of(robot.chain), robot.chain.joint_names
    scale = np.where(robot.chain.prismatic, 1e3, 180 / np.pi)
    return {
        "reach_mm": _tidy(1e3 * shape.reach_m),
        "ways": shape.ways,
        "determinant": shape.determinant or None,
        "singularities": [
            {
                "name": each.factor.name,
                "where": each.factor.text,
                "example": None if each.joints is None else [_tidy(value) for value in each.joints * scale],
                "free": [
                    {name: _tidy(part) for name, part in zip(names, parts, strict=True) if abs(part) > LEAST}
                    for parts in each.free
                ],
            }
            for each in shape.singularities
        ],
    }


def _nominal(question: Question) -> Array:
    robot = question.robot
    robot.refuse_unknown(question.targets)
    tool = dict(robot.tool)
    if question.place_mm:
        if len(question.place_mm) != 3:
            raise LabError("--tool-mm: give x, y and z of the first target in the last frame, e.g. 0,0,0")
        if far := [number for number in question.place_mm if not abs(number) <= LARGEST]:
            raise LabError(f"--tool-mm {far[0]:g}: give finite numbers in mm, at most {LARGEST:g}")
        tool[question.targets[0]] = np.array(question.place_mm) / 1e3
    return robot.arm_with(question.targets, question.groups).nominal(tool)


def _joints(robot: Robot) -> list[dict[str, Any]]:
    """Each joint's row of the table, with its limits."""
    chain, joints = robot.chain, []
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
    return joints


def print_inspection(question: Question) -> None:
    """The same for a person."""
    console, seen, robot = Console(markup=False), inspection(question), question.robot
    order = "Rz(θ) Tz(d) Tx(a) Rx(α)" if seen["convention"] == "distal" else "Rx(α) Tx(a) Rz(θ) Tz(d)"
    console.print(f"{robot.name}: Denavit-Hartenberg, {seen['convention']}, {order}; mm and °")
    console.print(_drawn_table(seen["joints"]))
    _print_shape(console, seen)
    console.print(
        f"{seen['rank']} of {seen['parameters']} parameters can be identified from positions of "
        f"{', '.join(seen['targets'])}, from {seen['poses_needed']} poses or more:"
    )
    for group in dict.fromkeys(sorted((name.rsplit(".", 1)[0] for name in seen["identifiable"]), key=_group_order)):
        members = [name.rsplit(".", 1)[1] for name in seen["identifiable"] if name.rsplit(".", 1)[0] == group]
        console.print(f"  {group}: {' '.join(members)}")
    if seen["held"]:
        console.print(f"held at nominal by --fix, though they show: {', '.join(seen['held'])}", soft_wrap=True)
    if seen["told_apart"]:
        others = ", ".join(seen["told_apart"])
        console.print(
            f"told apart only because others are held; --free would identify any one of them: {others}", soft_wrap=True
        )
    console.print("fixed at nominal, because an error of it looks like errors of others:")
    for name, into in seen["aliases"].items():
        parts = [_coefficient(name, other, value) for other, value in into.items()]
        console.print(f"  {name} is hidden in {', '.join(parts) or 'nothing: it moves no target'}", soft_wrap=True)
    console.print(f"condition over random poses, with unit columns: {seen['condition']:.1f}")
    for direction in seen["weak_directions"]:
        parts = [f"{name} {_per_person(name, value)}" for name, value in direction["parts"].items()]
        console.print(
            f"nearly unidentifiable, 1/{1 / direction['singular_value']:.0f} of the largest singular value: "
            f"{', '.join(parts)} move the targets by {1e3 * direction['moved_mm']:.2g} µm",
            soft_wrap=True,
        )
    for words, condition in seen["changes"].items():
        console.print(f"  with {words} the condition would be {condition:.1f}")


def _print_shape(console: Console, seen: dict[str, Any]) -> None:
    """How far the arm reaches, and where it is singular."""
    ways = "" if seen["ways"] is None else f"; {seen['ways']} ways to a pose"
    console.print(f"reach {_number(seen['reach_mm'])} mm from axis 1 to the last frame{ways}")
    if seen["determinant"] is None:
        return
    text = seen["determinant"].replace("-", "−").replace("*", "·")
    console.print(f"det J = {text} (m), singular where a factor is zero:", soft_wrap=True)
    for each in seen["singularities"]:
        where = f"  {each['name']}, {each['where']} = 0".replace("-", "−")
        if each["example"] is None:
            console.print(f"{where}: not within the limits")
            continue
        parts = " or ".join(" ".join(f"{part:+.3g} {name}" for name, part in one.items()) for one in each["free"])
        at = ", ".join(f"{value:.1f}" for value in np.round(each["example"], 1) + 0.0)
        console.print(f"{where}: e.g. at ({at}), {parts} moves nothing".replace("-", "−"), soft_wrap=True)


def _drawn_table(joints: list[dict[str, Any]]) -> Table:
    """The Denavit-Hartenberg table with limits, as the literature prints it."""
    table = Table()
    for heading in ("i", "θ", "d", "a", "α", "limits", "speed per s"):
        table.add_column(heading, justify="right", no_wrap=True)
    for i, joint in enumerate(joints):
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
    return table


def _group_order(group: str) -> tuple[bool, str]:
    """As they come, but joints in their order."""
    return (True, group) if group.startswith("joint") else (False, "")


def _coefficient(name: str, other: str, value: float) -> str:
    """What an error of one parameter looks like in another, in the units that a person reads."""
    (per, unit, _), (factor, into, _) = human_unit(name), human_unit(other)
    number = f"{value * factor / per:+.4g}".replace("-", "−")
    return f"{other} ({number})" if unit == into else f"{other} ({number} {into} per {unit})"


def _per_person(name: str, value: float) -> str:
    factor, unit, _ = human_unit(name)
    return f"{factor * value:+.3g} {unit}".replace("-", "−")


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
