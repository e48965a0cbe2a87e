"""A robot's cell, as plain values and as a person reads it: what stands around it, and what the arm touches."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from scipy.spatial import ConvexHull, QhullError

from lab.campaign.options import DesignOptions
from lab.campaign.robot import Robot
from lab.core.random import rng_for
from lab.core.se3 import Array
from lab.core.units import MM
from lab.formats.cell_toml import Cell
from lab.noise.instruments import INSTRUMENTS
from lab.render.charts.chart import axes_picture, cube, view
from lab.render.charts.marks import Axes
from lab.render.document import Block, Figure, Paragraph, Picture, Section, Table, short
from lab.render.plots import SQUARE, VIEWS
from lab.render.style import ARM, GATE, INK, INSTRUMENT, TICK
from lab.simulation.cell import edges_text, extents_mm
from lab.simulation.collisions import collides, colliding_pairs, describe_collisions
from lab.simulation.free_path import CLEARANCE_MM, Clearances, planning_model
from lab.simulation.meshes import instrument_body, solid_points

__all__ = ["POSES", "cell_section", "cell_values"]

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
        view(axes, plane, middle, half, "world", "Cell")
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
POSES = 500  # random ones within the limits, at which is looked what touches what


def cell_values(robot: Robot, cell: Cell, targets: Sequence[str]) -> dict[str, Any]:
    """The cell in millimetres and degrees, and what touches what in it at home and in random poses.

    That is so with the clearances and the reflectors that a plan takes unless told otherwise.
    """
    chain = robot.chain
    model = planning_model(robot.model, targets, INSTRUMENTS[DesignOptions.instrument], Clearances())
    joints = chain.random_joints(POSES, rng_for(0, "poses"))
    pairs = colliding_pairs(model, joints)
    scale = np.where(chain.prismatic, 1e3, 180 / np.pi)
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
        "home": (scale * chain.home).round(9).tolist(),
        "at_home": describe_collisions(model, chain.home[None])[0],
        "poses": POSES,
        "colliding": int(collides(model, joints).sum()),
        "pairs": [{"first": first, "second": second, "poses": count} for (first, second), count in pairs.items()],
    }


def cell_section(values: Mapping[str, Any], robot: Robot) -> Section:
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
