"""Document of a robot's table, its cell and its identifiable parameters."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from scipy.spatial import ConvexHull, QhullError

from lab.calibration.identifiability import (
    WEAK_CONDITION,
)
from lab.core.number_text import short
from lab.core.se3 import Array
from lab.core.units import MM
from lab.kinematics.closed.mechanism import Mechanism
from lab.kinematics.parameter import Parameter
from lab.library.inspect import Inspection, nominal_values
from lab.report.charts.chart import axes_picture, cube, view
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
)
from lab.report.page_scene import ArmScene, posed_arm
from lab.report.plots import SQUARE, VIEWS, singular_value_picture
from lab.report.style import ARM, GATE, INK, INSTRUMENT, TICK
from lab.report.views.layout_graph import layout_blocks
from lab.report.views.robot_blocks import (
    closed_blocks,
    resolution_blocks,
    serial_blocks,
    tree_blocks,
)
from lab.robots.robot import Robot
from lab.simulation.cell import edges_text
from lab.simulation.meshes import instrument_body, solid_points

__all__ = ["inspection_document", "main_picture"]

_ROOM = 0.1  # around all that is shown, of its width
_MARGINS = (0.75, 0.5, 0.15, 0.3)


def _cell_pictures(robot: Robot) -> tuple[Picture, ...]:
    """The outlines of the robot's solid shapes and of what its cell has, seen along two axes of the world."""
    model = robot.model
    shapes = [(name, MM.of(points)) for name, points in solid_points(model) if name != instrument_body(model)]
    heads = MM.of(model.Ts_world_station[:, :3, 3])
    views = {"above": "above", "side": "the side"}

    def picture(name: str, plane: tuple[int, int]) -> Picture:
        def draw(axes: Axes) -> None:
            middle, half = cube([heads, *(points for _, points in shapes)], _ROOM)
            view(axes, plane, middle, half, "world", "cell")
            arm = [points for body, points in shapes if body not in model.obstacles]
            _draw_outlines(axes, arm, plane, ARM, "robot at home")
            named = {body: points for body, points in shapes if body in model.obstacles}
            lines = _draw_outlines(axes, list(named.values()), plane, GATE, "obstacle")
            for body, line in zip(named, lines, strict=True):
                place = (line.min(axis=0) + line.max(axis=0)) / 2
                axes.annotate(body, place, ha="center", va="center", fontsize=7, color=INK)
            axes.plot(heads[:, plane[0]], heads[:, plane[1]], "P", color=INSTRUMENT, markersize=10, label="instrument")
            if plane[1] == 2:
                axes.axhline(0.0, color=TICK, linewidth=1)
            axes.legend(loc="best", frameon=True)

        return axes_picture(f"cell-{name}", f"The cell from {views[name]}", SQUARE, draw, _MARGINS)

    return tuple(picture(name, plane) for name, plane in VIEWS.items())


def _draw_outlines(axes: Axes, bodies: Sequence[Array], plane: tuple[int, int], colour: str, label: str) -> list[Array]:
    """Draw the outlines of bodies ``(n, 3)`` on a plane, with one entry in the legend; return them."""
    lines = [_outline(points[:, plane]) for points in bodies]
    for k, line in enumerate(lines):
        axes.plot(line[:, 0], line[:, 1], color=colour, linewidth=1.3, label="" if k else label)
    return lines


def _outline(points: Array) -> Array:
    """The closed convex outline ``(k + 1, 2)`` of points ``(n, 2)``; the points themselves where they have no area."""
    try:
        corners = ConvexHull(points).vertices
    except QhullError:
        return points
    return np.asarray(points[np.append(corners, corners[0])])


_PICTURE = "Outlines of the robot at home, of the obstacles, and the instrument; a mesh is taken for its convex hull."


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


def inspection_document(result: Inspection) -> Document:
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
    values = nominal_values(result.options, robot)[: len(arm.names)]
    return replace(posed_arm(robot.model, arm, values, robot.chain.home[None], ["home"]), all_text="")


def main_picture(result: Inspection) -> Picture:
    """Return the singular values relative to the largest, from the best observable direction to the worst."""
    return singular_value_picture(result.singular_values)[0]


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
        Figure("singular-values-figure", singular_value_picture(result.singular_values), caption),
    ]
