"""What a robot is, and what of it can be identified: as plain values, and in words."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from rich.console import Console

from lab.calibration.identifiability import WEAK_CONDITION, aliases, poses_needed, scaled_condition, weak_directions
from lab.campaign.robot import Robot
from lab.commands.calibrate.advice import changes
from lab.commands.calibrate.result import column_scale, direction_as_values, number
from lab.commands.inspect.closed import drawn_closed, print_closed, shape_closed
from lab.commands.inspect.format import coefficient, per_person
from lab.commands.inspect.serial import drawn_serial, print_serial, shape_serial
from lab.core.errors import LabError
from lab.core.numbers import LARGEST
from lab.core.random import rng_for
from lab.core.se3 import Array
from lab.kinematics.closed.mechanism import Mechanism
from lab.kinematics.gauge import base_set, named

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
    """A robot's drawing, limits, shape, identifiable and aliased parameters. Millimetres and degrees; aliases in SI."""
    robot = question.robot
    arm, nominal = robot.arm_with(question.targets, question.groups), _nominal(question)
    structure = base_set(arm, nominal, fix=question.fix, free=question.free)
    hidden = aliases(arm, structure, column_scale(arm, nominal))
    inputs = arm.structure_joints(POSES, rng_for(0, "structure"))
    jacobian = arm.observe(inputs, arm.rank_point(nominal))[1].reshape(-1, len(arm.names))[:, list(structure.kept)]
    names = [arm.names[i] for i in structure.kept]
    condition, usual = scaled_condition(jacobian), not (question.fix or question.free)
    asked = named(arm.names, "--fix", question.fix)
    held = [arm.names[i] for i in structure.held]
    if isinstance(robot.chain, Mechanism):
        drawn, shape = (
            drawn_closed(robot.chain),
            {**shape_closed(robot.chain), "not_fixed": len(arm.names) - len(asked)},
        )
    else:
        drawn, shape = drawn_serial(robot.serial_model.chain), shape_serial(robot.serial_model.chain)
    return {
        "robot": robot.name,
        **drawn,
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
                changes(robot, question.targets, question.groups, nominal, inputs)
                if usual and condition > WEAK_CONDITION
                else ()
            )
            if change.condition < condition
        },
        "poses_needed": poses_needed(arm, nominal, structure),
        **shape,
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


def print_inspection(question: Question) -> None:
    """The same for a person."""
    console, seen = Console(markup=False), inspection(question)
    closed = isinstance(question.robot.chain, Mechanism)
    (print_closed if closed else print_serial)(console, seen)
    left = f" ({seen['rank']} of the {seen['not_fixed']} that --fix leaves)" if closed and question.fix else ""
    console.print(
        f"{seen['rank']} of {seen['parameters']} parameters{left} can be identified from positions of "
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
        parts = [coefficient(name, other, value) for other, value in into.items()]
        console.print(f"  {name} is hidden in {', '.join(parts) or 'nothing: it moves no target'}", soft_wrap=True)
    console.print(f"condition over random poses, with unit columns: {seen['condition']:.1f}")
    for direction in seen["weak_directions"]:
        parts = [f"{name} {per_person(name, value)}" for name, value in direction["parts"].items()]
        console.print(
            f"nearly unidentifiable, 1/{1 / direction['singular_value']:.0f} of the largest singular value: "
            f"{', '.join(parts)} move the targets by {1e3 * direction['moved_mm']:.2g} µm",
            soft_wrap=True,
        )
    for words, condition in seen["changes"].items():
        console.print(f"  with {words} the condition would be {condition:.1f}")


def _group_order(group: str) -> tuple[bool, str]:
    """As they come, but joints in their order."""
    return (True, group) if group.startswith("joint") else (False, "")
