"""What a robot is, and what of it can be identified: as plain values, and in words."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console

from lab.calibration.identifiability import (
    WEAK_CONDITION,
    aliases,
    column_scale,
    poses_needed,
    scaled_condition,
    weak_directions,
)
from lab.campaign.robot import Robot, load_robot
from lab.commands.calibrate.advice import changes
from lab.commands.calibrate.findings import direction_to_dict
from lab.commands.inspect.closed import drawn_closed, print_closed, shape_closed
from lab.commands.inspect.format import coefficient, per_person
from lab.commands.inspect.options import InspectOptions
from lab.commands.inspect.serial import drawn_serial, print_serial, shape_serial
from lab.commands.keywords import options_of, takes
from lab.commands.values import number
from lab.core.errors import LabError
from lab.core.numbers import LARGEST
from lab.core.random import rng_for
from lab.core.se3 import Array
from lab.kinematics.closed.mechanism import Mechanism
from lab.kinematics.gauge import base_set, named

POSES = 200


@dataclass(frozen=True)
class Inspection:
    """What a robot is, and what of it can be identified.

    Attributes:
        values: what ``--json`` prints: mm and degrees, aliases in SI.
    """

    options: InspectOptions
    robot: Robot
    values: dict[str, Any]

    @property
    def warnings(self) -> tuple[str, ...]:
        """What a reader should be told."""
        return self.robot.warnings


@takes(InspectOptions)
def inspect(robot: str | Path | Robot | InspectOptions = "irb120", **options: Any) -> Inspection:
    """Say what a robot is, and what of it can be identified.

    Args:
        robot: a model's name, a path, or a loaded robot; or all options in one object.
        options: those of ``lab inspect``, by name: ``targets``, ``tool_mm``, ``model``, ``fix``, ``free``.

    Returns:
        Its nominal dimensions and limits (mm and degrees), and its identifiable parameters.

    Raises:
        LabError: there is no such robot, target or parameter; the message lists those there are.

    Example:
        >>> import lab
        >>> lab.inspect("irb120", targets=("p1", "p2", "p3")).to_dict()["rank"]
        33
    """
    if isinstance(robot, InspectOptions):
        return _inspected(robot, load_robot(robot.robot))
    known = load_robot(robot)
    return _inspected(options_of("lab.inspect", InspectOptions, {"robot": known.source, **options}), known)


def _inspected(options: InspectOptions, robot: Robot) -> Inspection:
    """Nominal dimensions, limits, shape, identifiable and aliased parameters."""
    groups = options.groups
    nominal = _nominal(options, robot)
    arm = robot.arm_with(options.targets, groups)
    structure = base_set(arm, nominal, fix=options.fix, free=options.free)
    hidden = aliases(arm, structure, column_scale(arm, nominal))
    inputs = arm.structure_joints(POSES, rng_for(0, "structure"))
    jacobian = arm.observe(inputs, arm.rank_point(nominal))[1].reshape(-1, len(arm.names))[:, list(structure.kept)]
    names = [arm.names[i] for i in structure.kept]
    condition, usual = scaled_condition(jacobian), not (options.fix or options.free)
    asked = named(arm.names, "--fix", options.fix)
    held = [arm.names[i] for i in structure.held]
    if isinstance(robot.chain, Mechanism):
        drawn, shape = (
            drawn_closed(robot.chain),
            {**shape_closed(robot.chain), "not_fixed": len(arm.names) - len(asked)},
        )
    else:
        drawn, shape = drawn_serial(robot.serial_model.chain), shape_serial(robot.serial_model.chain)
    values = {
        "robot": robot.name,
        **drawn,
        "targets": list(options.targets),
        "parameters": len(arm.names),
        "rank": len(structure.kept),
        "identifiable": names,
        "held": [arm.names[i] for i in structure.held if i in asked],
        "told_apart": [arm.names[i] for i in structure.held if i not in asked],
        "aliases": {alias.name: dict(alias.into) for alias in hidden if alias.name not in held},
        "condition": number(condition),
        "weak_directions": [direction_to_dict(each) for each in weak_directions(names, jacobian)],
        "changes": {
            change.words: number(change.condition)
            for change in (
                changes(robot, options.targets, groups, nominal, inputs) if usual and condition > WEAK_CONDITION else ()
            )
            if change.condition < condition
        },
        "poses_needed": poses_needed(arm, nominal, structure),
        **shape,
    }
    return Inspection(options, robot, values)


def _nominal(options: InspectOptions, robot: Robot) -> Array:
    robot.refuse_unknown(options.targets)
    tool = dict(robot.tool)
    if options.tool_mm:
        if len(options.tool_mm) != 3:
            raise LabError("--tool-mm: give x, y and z of the first target in the last frame, e.g. 0,0,0")
        if far := [number for number in options.tool_mm if not abs(number) <= LARGEST]:
            raise LabError(f"--tool-mm {far[0]:g}: give finite numbers in mm, at most {LARGEST:g}")
        tool[options.targets[0]] = np.array(options.tool_mm) / 1e3
    return robot.arm_with(options.targets, options.groups).nominal(tool)


def print_inspection(found: Inspection) -> None:
    """The same for a person."""
    console, seen = Console(markup=False), found.values
    closed = isinstance(found.robot.chain, Mechanism)
    arm = found.robot.arm_with(found.options.targets, found.options.groups)
    named_parameters = {parameter.name: parameter for parameter in arm.parameters}
    (print_closed if closed else print_serial)(console, seen)
    left = f" ({seen['rank']} of the {seen['not_fixed']} that --fix leaves)" if closed and found.options.fix else ""
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
        parts = [coefficient(named_parameters[name], named_parameters[other], value) for other, value in into.items()]
        console.print(f"  {name} is hidden in {', '.join(parts) or 'nothing: it moves no target'}", soft_wrap=True)
    console.print(f"condition over random poses, with unit columns: {seen['condition']:.1f}")
    for direction in seen["weak_directions"]:
        parts = [f"{name} {per_person(named_parameters[name], value)}" for name, value in direction["parts"].items()]
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
