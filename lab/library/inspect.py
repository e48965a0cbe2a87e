"""Inspect a robot: its description, its cell, and its identifiable parameters."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial import ConvexHull, QhullError

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
from lab.kinematics.gauge import base_set, named
from lab.kinematics.joints import JointSpec
from lab.kinematics.parameter import Parameter
from lab.kinematics.serial.chain import Chain
from lab.kinematics.tree import TreeChain
from lab.library.calibration_result import direction_to_dict
from lab.library.inspected_model import (
    closed_blocks,
    closed_nominal,
    closed_shape,
    serial_blocks,
    serial_frames,
    serial_nominal,
    serial_shape,
    tree_blocks,
    tree_nominal,
)
from lab.library.joint_resolution import encoders_of, resolution, resolution_blocks
from lab.library.result import Result, joint_values, number
from lab.noise.instruments import INSTRUMENTS
from lab.options.call_options import options_of, takes
from lab.options.command_options import InspectOptions
from lab.options.virtual_campaign import DesignOptions
from lab.report.charts.chart import axes_picture, cube, log_ticks, view
from lab.report.charts.marks import Axes
from lab.report.document import (
    Badge,
    Block,
    Bullets,
    Card,
    Document,
    Figure,
    Paragraph,
    Picture,
    Scene,
    Section,
    Table,
    Warnings,
    guarded,
    short,
)
from lab.report.page_scene import ArmScene, posed_arm
from lab.report.plots import SQUARE, VIEWS
from lab.report.style import ARM, GATE, INK, INSTRUMENT, PREDICTED, TICK
from lab.report.views.layout_graph import layout_blocks
from lab.robots.load_robot import load_robot
from lab.robots.robot import Robot
from lab.sensors.sensor_registry import sensor_named
from lab.simulation.cell import edges_text, extents_mm
from lab.simulation.collisions import collides, colliding_pairs, describe_collisions
from lab.simulation.free_path import CLEARANCE_MM, Clearances, planning_model
from lab.simulation.meshes import instrument_body, solid_points
from lab.verdict.fit_checks import changes

__all__ = ["Inspection", "inspect"]

_ROOM = 0.1  # around all that is shown, of its width
_MARGINS = (0.75, 0.5, 0.15, 0.3)


def _cell_pictures(robot: Robot) -> tuple[Picture, ...]:
    """The outlines of the robot's solid shapes and of what its cell has, seen along two axes of the world."""
    model = robot.model
    shapes = [(name, MM.of(points)) for name, points in solid_points(model) if name != instrument_body(model)]
    heads = MM.of(model.Ts_world_station[:, :3, 3])
    obstacles = [(name, points) for name, points in shapes if name in model.obstacles]
    arm = [points for name, points in shapes if name not in model.obstacles]

    def draw(axes: Axes, plane: tuple[int, int]) -> None:
        middle, half = cube([heads, *(points for _, points in shapes)], _ROOM)
        view(axes, plane, middle, half, "world", "cell")
        for k, points in enumerate(arm):
            line = _outline(points[:, plane])
            axes.plot(line[:, 0], line[:, 1], color=ARM, linewidth=1.2, label="" if k else "robot at home")
        for k, (name, points) in enumerate(obstacles):
            line = _outline(points[:, plane])
            axes.plot(line[:, 0], line[:, 1], color=GATE, linewidth=1.5, label="" if k else "obstacle")
            place = (line.min(axis=0) + line.max(axis=0)) / 2
            axes.annotate(name, place, ha="center", va="center", fontsize=7, color=INK)
        axes.plot(heads[:, plane[0]], heads[:, plane[1]], "P", color=INSTRUMENT, markersize=10, label="instrument")
        if plane[1] == 2:
            axes.axhline(0.0, color=TICK, linewidth=1)
        axes.legend(loc="best", frameon=True)

    return tuple(
        axes_picture(f"cell-{name}", f"The cell from {'the side' if name == 'side' else name}", SQUARE,
                     lambda axes, plane=plane: draw(axes, plane), _MARGINS)  # type: ignore[misc]
        for name, plane in VIEWS.items()
    )  # fmt: skip


def _outline(points: Array) -> Array:
    """The closed convex outline ``(k + 1, 2)`` of points ``(n, 2)``; the points themselves where they have no area."""
    try:
        corners = ConvexHull(points).vertices
    except QhullError:
        return points
    return np.asarray(points[np.append(corners, corners[0])])


_PICTURE = "Outlines of the robot at home, of the obstacles, and the instrument; a mesh is taken for its convex hull."
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


@guarded
def _cell_section(values: Mapping[str, Any], robot: Robot) -> Section:
    """The cell as a person reads it, with a picture of it."""
    cell = values["cell"]
    rows = [
        (
            each["name"],
            each["shape"],
            edges_text(each["extents_mm"]),
            ", ".join(short(x) for x in each["position_mm"]),
            short(each["clearance_mm"]),
        )
        for each in cell["obstacles"]
    ]
    rows += [
        (each["name"], each["shape"], edges_text(each["extents_mm"]), "on the flange", "") for each in cell["plates"]
    ]
    places = [(each["name"], ", ".join(short(x) for x in each["position_mm"])) for each in cell["stations"]]
    stations = (Table(("station of the instrument", "head, mm, in the robot's frame"), tuple(places)),)
    at_home = f"At home, {cell['at_home']}." if cell["at_home"] else "At home the arm touches nothing."
    blocks: tuple[Block, ...] = (
        Table(("obstacle", "shape", "extents", "position, mm", "clearance, mm"), tuple(rows)),
        Figure("cell-figure", _cell_pictures(robot), _PICTURE),
        *(stations if places else ()),
        Paragraph(
            f"{at_home} Of {cell['poses']} random poses within the limits, {cell['colliding']} touch something or come "
            "too near to it."
        ),
        Table(
            ("what moves", "touches", f"poses of {cell['poses']}"),
            tuple((each["first"], each["second"], str(each["poses"])) for each in cell["pairs"]),
        ),
    )
    return Section("Cell", blocks)


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
    shown_by = "lab.library.inspect:_inspection_document"
    drawn_by = "lab.library.inspect:_singular_values_picture"

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


def _inspection_document(result: Inspection) -> Document:
    """The nominal model and the shape, then what can be identified, what is fixed, and what is weakly observable."""
    values = result.values
    blocks = closed_blocks if "mobility" in values else tree_blocks if "tips" in values else serial_blocks
    shape = blocks(values)
    return Document(
        f"{values['robot']}: {values['rank']} of {values['parameters']} parameters are identifiable",
        (
            _card(result),
            Warnings(result.warnings),
            Section(
                "Nominal model and shape",
                (
                    Scene(
                        "arm-scene", lambda: _page_scene(result), "The robot at home. Its point is the first target."
                    ),
                    *shape,
                ),
            ),
            Section("Resolution at the tool", resolution_blocks(values["resolution"])),
            Section("Layout", layout_blocks(chain) if isinstance(chain := result.robot.chain, Mechanism) else ()),
            *((_cell_section(values, result.robot),) if "cell" in values else ()),
            Section("Identifiability", (*_identifiable(result), *_fixed(result))),
            Section("Conditioning", tuple(_conditioning(result))),
        ),
    )


@guarded
def _card(result: Inspection) -> Card:
    """Summarise what can be identified, from how many poses, how well, and what to do next."""
    values = result.values
    condition = values["condition"]
    well = condition is not None and condition <= WEAK_CONDITION
    badge = Badge("well conditioned", "good") if well else Badge("some directions are weakly observable", "doubtful")
    numbers = (
        ("identifiable parameters", f"{values['rank']} of {values['parameters']}", "after"),
        ("poses needed", f"{values['poses_needed']} or more", ""),
        ("condition number", short(condition), ""),
    )
    about = (
        f"From positions of {', '.join(values['targets'])}. The other parameters stay at nominal: an error of theirs "
        "looks like errors of others."
    )
    step = "Choose the poses to measure with lab design."
    if not well:
        step = "Measure more targets or poses, or change what is fixed: the conditioning below says what helps."
    return Card(("Calibration: ", badge), numbers, about, step)


def _page_scene(result: Inspection) -> ArmScene:
    """The robot at home."""
    robot = result.robot
    arm = robot.arm(result.options.targets)
    values = _nominal(result.options, robot)[: len(arm.names)]
    return replace(posed_arm(robot.model, arm, values, robot.chain.home[None], ["home"]), all_text="")


def _singular_values_picture(result: Inspection) -> Picture:
    """Singular values relative to the largest, from the best observable direction to the worst."""
    relative = result.singular_values / result.singular_values[0]

    def draw(axes: Axes) -> None:
        axes.plot(np.arange(1, len(relative) + 1), relative, "o", color=PREDICTED, markersize=4.5)
        log_ticks(axes, "y", relative.min() / 1.6, 1.7)
        axes.set(xlabel="direction, from the best observable to the worst", ylabel="relative singular value")

    return axes_picture(
        "singular-values", "Singular values of the scaled Jacobian", (5.6, 2.8), draw, (0.8, 0.5, 0.2, 0.15)
    )


@guarded
def _identifiable(result: Inspection) -> tuple[Block, ...]:
    values = result.values
    names = [name.rsplit(".", 1) for name in values["identifiable"]]
    groups = dict.fromkeys(sorted((group for group, _ in names), key=_group_order))
    rows = tuple((group, " ".join(last for other, last in names if other == group)) for group in groups)
    left = ""
    if "not_fixed" in values and result.options.fix:
        left = f" ({values['rank']} of the {values['not_fixed']} that --fix leaves)"
    text = (
        f"{values['rank']} of {values['parameters']} parameters{left} can be identified from positions of "
        f"{', '.join(values['targets'])}, from {values['poses_needed']} poses or more:"
    )
    return Paragraph(text), Table(("", ""), rows)


def _group_order(group: str) -> tuple[bool, str]:
    """Groups as they come, but joints in their order."""
    return (True, group) if group.startswith("joint") else (False, "")


@guarded
def _fixed(result: Inspection) -> tuple[Block, ...]:
    values = result.values
    fixed = f"fixed at nominal by --fix, though identifiable: {', '.join(values['held'])}" if values["held"] else ""
    others = ", ".join(values["told_apart"])
    freed = f"identifiable only because others are fixed; --free would identify any one of them: {others}"
    named = {parameter.name: parameter for parameter in result.parameters}
    aliases = []
    for name, into in values["aliases"].items():
        parts = (_coefficient(named[name], named[other], value) for other, value in into.items())
        aliases.append(f"{name} is aliased with {', '.join(parts) or 'nothing: it moves no target'}")
    return (
        Bullets((fixed, freed if others else "")),
        Paragraph("Fixed at nominal, because an error of it looks like errors of others:" if aliases else ""),
        Bullets(tuple(aliases)),
    )


def _coefficient(parameter: Parameter, other: Parameter, value: float) -> str:
    per, into = parameter.unit, other.unit
    number = f"{value * into.factor / per.factor:+.4g}".replace("-", "−")
    return f"{other.name} ({number})" if per == into else f"{other.name} ({number} {into.name} per {per.name})"


def _per_person(parameter: Parameter, value: float) -> str:
    return f"{parameter.unit.of(value):+.3g} {parameter.unit.name}".replace("-", "−")


def _conditioning(result: Inspection) -> list[Block]:
    values = result.values
    named = {parameter.name: parameter for parameter in result.parameters}
    weak = []
    for direction in values["weak_directions"]:
        parts = ", ".join(f"{name} {_per_person(named[name], value)}" for name, value in direction["parts"].items())
        weak.append(
            f"weakly observable, relative singular value 1/{1 / direction['singular_value']:.0f}: {parts} move the "
            f"targets by {1e3 * direction['moved_mm']:.2g} µm"
        )
    better = (
        f"with {change} the condition number would be {number:.1f}" for change, number in values["changes"].items()
    )
    caption = "Singular values over random poses, columns of unit length; a logarithmic axis."
    return [
        Paragraph(f"condition number over random poses, with unit columns: {values['condition']:.1f}"),
        Bullets((*weak, *better)),
        Figure("singular-values-figure", (_singular_values_picture(result),), caption),
    ]


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
    groups, options = options.groups, replace(options, targets=robot.on_tips(options.targets))
    nominal = _nominal(options, robot)
    arm = robot.arm_with(options.targets, groups)
    structure = base_set(arm, nominal, fix=options.fix, free=options.free)
    hidden = aliases(arm, structure, column_scale(arm, nominal))
    inputs = arm.structure_joints(_POSES, rng_for(0, "structure"))
    jacobian = arm.observe(inputs, arm.rank_point(nominal))[1].reshape(-1, len(arm.names))[
        :, list(structure.identifiable)
    ]
    names = [arm.names[i] for i in structure.identifiable]
    condition, usual = scaled_condition(jacobian), not (options.fix or options.free)
    requested = named(arm.names, "--fix", options.fix)
    fixed_names = [arm.names[i] for i in structure.fixed_observable]
    nominal_model, shape = _described(robot.chain)
    if isinstance(robot.chain, Mechanism):
        shape["not_fixed"] = len(arm.names) - len(requested)
    values = {
        "robot": robot.name,
        **nominal_model,
        "targets": list(options.targets),
        "parameters": len(arm.names),
        "rank": len(structure.identifiable),
        "identifiable": names,
        "held": [arm.names[i] for i in structure.fixed_observable if i in requested],
        "told_apart": [arm.names[i] for i in structure.fixed_observable if i not in requested],
        "aliases": {alias.name: dict(alias.into) for alias in hidden if alias.name not in fixed_names},
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
    if isinstance(robot.chain, Chain):
        tool = {target: nominal[[arm.names.index(f"tool.{target}.{axis}") for axis in "xyz"]] for target in arm.targets}
        values |= serial_frames(robot.T_world_frame0, tool)
    encoders = encoders_of(robot.chain, options.joint_steps)
    rigid = robot.arm(options.targets)
    values["resolution"] = None if encoders is None else resolution(rigid, nominal[: len(rigid.names)], encoders)
    if robot.cell is not None:
        values["cell"] = _cell_values(robot, robot.cell, options.targets)
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
