"""Inspection of a robot: its description, and its identifiable parameters."""

from functools import singledispatch
from pathlib import Path
from typing import Any

import numpy as np

from lab.calibration.checks.fit import changes
from lab.calibration.identifiability import (
    WEAK_CONDITION,
    aliases,
    column_scale,
    poses_needed,
    scaled_condition,
    weak_directions,
)
from lab.campaign.robot import Robot, load_robot
from lab.commands.calibrate.result import direction_to_dict
from lab.commands.command_line import options_of, takes
from lab.commands.inspect.cell import cell_values
from lab.commands.inspect.closed import closed_nominal, closed_shape
from lab.commands.inspect.options import InspectOptions
from lab.commands.inspect.result import Inspection
from lab.commands.inspect.serial import serial_frames, serial_nominal, serial_shape
from lab.commands.result import number
from lab.core.errors import LabError
from lab.core.limits import OPTION_SIZE
from lab.core.random import rng_for
from lab.core.se3 import Array
from lab.kinematics.closed.mechanism import Mechanism
from lab.kinematics.gauge import base_set, named
from lab.kinematics.joints import JointSpec
from lab.kinematics.serial.chain import Chain
from lab.sensors.registry import sensor_named

__all__ = ["inspect"]

POSES = 200


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
        return _inspected(robot, load_robot(robot.robot, robot.cell))
    known = load_robot(robot)
    asked = options_of("lab.inspect", InspectOptions, {"robot": known.source, **options})
    return _inspected(asked, known.placed_in(asked.cell))


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
    nominal_model, shape = _described(robot.chain)
    if robot.chain.has_loops:  # how many parameters --fix leaves is said of a mechanism
        shape["not_fixed"] = len(arm.names) - len(asked)
    values = {
        "robot": robot.name,
        **nominal_model,
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
            change.change: number(change.condition)
            for change in (
                changes(robot, sensor_named("points")(), options.targets, groups, nominal, inputs)
                if usual and condition > WEAK_CONDITION
                else ()
            )
            if change.condition < condition
        },
        "poses_needed": poses_needed(arm, nominal, structure),
        **shape,
    }
    if not robot.chain.has_loops:
        tool = {target: nominal[[arm.names.index(f"tool.{target}.{axis}") for axis in "xyz"]] for target in arm.targets}
        values |= serial_frames(robot.T_world_frame0, tool)
    if robot.cell is not None:
        values["cell"] = cell_values(robot, robot.cell, options.targets)
    unit = jacobian / np.linalg.norm(jacobian, axis=0)
    return Inspection(options, robot, values, arm.parameters, np.linalg.svd(unit, compute_uv=False))


def _nominal(options: InspectOptions, robot: Robot) -> Array:
    robot.refuse_unknown(options.targets)
    tool = dict(robot.tool)
    if options.tool_mm:
        if len(options.tool_mm) != 3:
            raise LabError("--tool-mm: give x, y and z of the first target in the last frame, e.g. 0,0,0")
        if far := [number for number in options.tool_mm if abs(number) not in OPTION_SIZE]:
            raise LabError(f"--tool-mm {far[0]:g}: give finite numbers in mm, at most {OPTION_SIZE.most:g}")
        tool[options.targets[0]] = np.array(options.tool_mm) / 1e3
    return robot.arm_with(options.targets, options.groups).nominal(tool)


@singledispatch
def _described(joints: JointSpec) -> tuple[dict[str, Any], dict[str, Any]]:
    """The nominal model and the shape of a kind of robot, as plain values: each kind registers its own."""
    raise NotImplementedError(type(joints))


@_described.register
def _(chain: Chain) -> tuple[dict[str, Any], dict[str, Any]]:
    return serial_nominal(chain), serial_shape(chain)


@_described.register
def _(mechanism: Mechanism) -> tuple[dict[str, Any], dict[str, Any]]:
    return closed_nominal(mechanism), closed_shape(mechanism)
