"""Inspect a robot: its description, its cell, and its identifiable parameters."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from lab.calibration.identifiability import (
    WEAK_CONDITION,
    aliases,
    column_scale,
    poses_needed,
    scaled_condition,
    weak_directions,
)
from lab.core.errors import LabError
from lab.core.limits import OPTION_SIZE
from lab.core.random import rng_for
from lab.core.se3 import Array
from lab.core.units import MM
from lab.formats.cell_toml import Cell
from lab.kinematics.closed.mechanism import Mechanism
from lab.kinematics.effects.arm_with_effects import Arm
from lab.kinematics.gauge import BaseSet, base_set, named
from lab.kinematics.joints import JointSpec
from lab.kinematics.parameter import Parameter
from lab.kinematics.serial.chain import Chain
from lab.kinematics.tree import TreeChain
from lab.library.calibration_values import direction_to_dict
from lab.library.inspected_model import (
    closed_nominal,
    closed_shape,
    serial_frames,
    serial_nominal,
    serial_shape,
    tree_nominal,
)
from lab.library.joint_resolution import encoders_of, resolution
from lab.library.result import Result, joint_values, number
from lab.noise.instruments import INSTRUMENTS
from lab.options.call_options import options_of, takes
from lab.options.command_options import InspectOptions
from lab.options.virtual_campaign import DesignOptions
from lab.robots.load_robot import load_robot
from lab.robots.robot import Robot
from lab.sensors.sensor_registry import sensor_named
from lab.simulation.cell import extents_mm
from lab.simulation.collisions import collides, colliding_pairs, describe_collisions
from lab.simulation.free_path import CLEARANCE_MM, Clearances, planning_model
from lab.verdict.fit_checks import changes

__all__ = ["Inspection", "inspect", "nominal_values"]


_CELL_POSES = 500  # random ones within the limits, at which is looked what touches what


def _cell_values(robot: Robot, cell: Cell, targets: Sequence[str]) -> dict[str, Any]:
    """The cell in millimetres and degrees, and what touches what in it at home and in random poses.

    Clearances and reflectors are the defaults of a plan.
    """
    chain = robot.chain
    model = planning_model(robot.model, targets, INSTRUMENTS[DesignOptions.instrument], Clearances())
    joints = chain.random_joints(_CELL_POSES, rng_for(0, "poses"))
    pairs = colliding_pairs(model, joints)
    return {
        "name": cell.name,
        "file": str(cell.path),
        "obstacles": [
            {
                "name": each.name,
                "shape": each.shape,
                "position_mm": list(each.position_mm),
                "extents_mm": extents_mm(robot.model, each, name).round(6).tolist(),
                "clearance_mm": CLEARANCE_MM if (stated_m := cell.clearance_m(each)) is None else MM.of(stated_m),
            }
            for each, name in zip(cell.obstacle, robot.model.obstacles, strict=True)
        ],
        "plates": [
            {
                "name": each.name,
                "shape": each.shape,
                "extents_mm": extents_mm(robot.model, each, name).round(6).tolist(),
            }
            for each, name in zip(cell.plate, robot.model.plates, strict=True)
        ],
        "tool": {each.name: {"position_mm": list(each.position_mm), "axis": list(each.axis)} for each in cell.tool},
        "instrument_mm": MM.of(model.T_world_tracker[:3, 3]).round(9).tolist(),
        "stations": [
            {"name": name, "position_mm": MM.of(T[:3, 3]).round(9).tolist()}
            for name, T in zip(model.stations, model.Ts_world_station, strict=False)
        ],
        "acceptance_deg": None if cell.reflector is None else cell.reflector.degrees,
        "home": joint_values(chain.prismatic, chain.home).round(9).tolist(),
        "at_home": describe_collisions(model, chain.home[None])[0],
        "poses": _CELL_POSES,
        "colliding": int(collides(model, joints).sum()),
        "pairs": [{"first": first, "second": second, "poses": count} for (first, second), count in pairs.items()],
    }


@dataclass(frozen=True, repr=False, eq=False)
class Inspection(Result):
    """A robot's nominal model, its limits, its shape, and what of it can be identified.

    Attributes:
        values: what ``to_dict`` gives: millimetres and degrees; aliases in SI units.
        parameters: all of the arm, in the order of its values.
        singular_values: ``(r,)`` of the Jacobian with unit columns over random poses, largest first.
    """

    command = "inspect"
    robot_at = "robot"

    options: InspectOptions
    robot: Robot
    values: Mapping[str, Any]
    parameters: tuple[Parameter, ...]
    singular_values: Array

    @property
    def warnings(self) -> tuple[str, ...]:
        """Warnings on the robot."""
        return self.robot.warnings

    def to_dict(self) -> dict[str, Any]:
        """Return the values for ``--json``: millimetres and degrees; aliases in SI units; None where not finite."""
        return dict(self.values)

    def columns(self) -> Mapping[str, Sequence[Any]]:
        """A row for each parameter that is identifiable or aliased: its name, and with what it is aliased."""
        identifiable, aliases = self.values["identifiable"], self.values["aliases"]
        return {
            "parameter": [*identifiable, *aliases],
            "identifiable": [True] * len(identifiable) + [False] * len(aliases),
            "aliased_with": [""] * len(identifiable) + [", ".join(into) for into in aliases.values()],
        }


_POSES = 200


@takes(InspectOptions)
def inspect(robot: str | Path | Robot | InspectOptions = "irb120", **options: Any) -> Inspection:
    """Inspect a robot: its description, and its identifiable parameters.

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
    loaded = load_robot(robot)
    requested = options_of("lab.inspect", InspectOptions, {"robot": loaded.source, **options})
    return _inspected(requested, loaded.placed_in(requested.cell))


def _inspected(options: InspectOptions, robot: Robot) -> Inspection:
    options = replace(options, targets=robot.on_tips(options.targets))
    nominal = nominal_values(options, robot)
    arm = robot.arm_with(options.targets, options.groups)
    # The structure's rank, and the identifiable columns of the Jacobian at poses that no parameter is blind to.
    structure = base_set(arm, nominal, fix=options.fix, free=options.free)
    inputs = arm.structure_joints(_POSES, rng_for(0, "structure"))
    everything = arm.observe(inputs, arm.rank_point(nominal))[1].reshape(-1, len(arm.names))
    jacobian = everything[:, list(structure.identifiable)]
    nominal_model, shape = _described(robot.chain)
    if isinstance(robot.chain, Mechanism):
        shape["not_fixed"] = len(arm.names) - len(named(arm.names, "--fix", options.fix))
    values = {
        "robot": robot.name,
        **nominal_model,
        **_identifiability(options, arm, nominal, structure),
        **_conditioning(options, robot, arm, nominal, structure, jacobian, inputs),
        **shape,
        **_tool_and_resolution(options, robot, arm, nominal),
    }
    if robot.cell is not None:
        values["cell"] = _cell_values(robot, robot.cell, options.targets)
    unit = jacobian / np.linalg.norm(jacobian, axis=0)
    return Inspection(options, robot, values, arm.parameters, np.linalg.svd(unit, compute_uv=False))


def _identifiability(options: InspectOptions, arm: Arm, nominal: Array, structure: BaseSet) -> dict[str, Any]:
    """Return which parameters the structure identifies, and where errors of the others go."""
    held = named(arm.names, "--fix", options.fix)
    fixed = {i: arm.names[i] for i in structure.fixed_observable}
    hidden = aliases(arm, structure, column_scale(arm, nominal))
    return {
        "targets": list(options.targets),
        "parameters": len(arm.names),
        "rank": len(structure.identifiable),
        "identifiable": [arm.names[i] for i in structure.identifiable],
        "held": [name for i, name in fixed.items() if i in held],
        "told_apart": [name for i, name in fixed.items() if i not in held],
        "aliases": {alias.name: dict(alias.into) for alias in hidden if alias.name not in fixed.values()},
    }


def _conditioning(
    options: InspectOptions,
    robot: Robot,
    arm: Arm,
    nominal: Array,
    structure: BaseSet,
    jacobian: Array,
    inputs: Array,
) -> dict[str, Any]:
    """Return the condition of the identifiable columns, its weak directions, and what would improve it."""
    condition, names = scaled_condition(jacobian), [arm.names[i] for i in structure.identifiable]
    better = dict[str, float | None]()
    if condition > WEAK_CONDITION and not (options.fix or options.free):
        tried = changes(robot, sensor_named("points")(), options.targets, options.groups, nominal, inputs)
        better = {change.change: number(change.condition) for change in tried if change.condition < condition}
    return {
        "condition": number(condition),
        "weak_directions": [direction_to_dict(each) for each in weak_directions(names, jacobian)],
        "changes": better,
        "poses_needed": poses_needed(arm, nominal, structure),
    }


def _tool_and_resolution(options: InspectOptions, robot: Robot, arm: Arm, nominal: Array) -> dict[str, Any]:
    """Return the frames of a serial arm with its tool, and the resolution that its encoders give."""
    values = dict[str, Any]()
    if isinstance(robot.chain, Chain):
        tool = {target: nominal[[arm.names.index(f"tool.{target}.{axis}") for axis in "xyz"]] for target in arm.targets}
        values |= serial_frames(robot.T_world_frame0, tool)
    encoders, rigid = encoders_of(robot.chain, options.joint_steps), robot.arm(options.targets)
    values["resolution"] = None if encoders is None else resolution(rigid, nominal[: len(rigid.names)], encoders)
    return values


def nominal_values(options: InspectOptions, robot: Robot) -> Array:
    """Return the nominal values of the parameters, with the targets of the options at the tool."""
    robot.refuse_unknown(options.targets)
    tool = dict(robot.tool)
    if options.tool_mm:
        if len(options.tool_mm) != 3:
            raise LabError("--tool-mm: give x, y and z of the first target in the last frame, e.g. 0,0,0")
        if far := [number for number in options.tool_mm if abs(number) not in OPTION_SIZE]:
            raise LabError(f"--tool-mm {far[0]:g}: give finite numbers in mm, at most {OPTION_SIZE.most:g}")
        tool[options.targets[0]] = MM.to_si(np.array(options.tool_mm))
    return robot.arm_with(options.targets, options.groups).nominal(tool)


def _described(chain: JointSpec) -> tuple[dict[str, Any], dict[str, Any]]:
    """Return the nominal model and the shape of a robot as plain values; several tips have no shape of their own."""
    if isinstance(chain, Mechanism):
        return closed_nominal(chain), closed_shape(chain)
    if isinstance(chain, TreeChain):
        return tree_nominal(chain), {"reach_mm": None, "singularities": []}
    assert isinstance(chain, Chain)
    return serial_nominal(chain), serial_shape(chain)
