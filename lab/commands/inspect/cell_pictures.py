"""Pictures of a cell: obstacles, the robot at home and the instrument, as outlines from above and from the side."""

import numpy as np
from scipy.spatial import ConvexHull, QhullError

from lab.campaign.robot import Robot
from lab.core.se3 import Array
from lab.render.charts.axes import Axes
from lab.render.document import Picture
from lab.render.plots import SQUARE, VIEWS
from lab.render.style import ARM, GATE, INK, INSTRUMENT, TICK
from lab.render.svg import axes_picture, cube, view
from lab.simulation.meshes import instrument_body, solid_points

__all__ = ["cell_pictures"]

_ROOM = 0.1  # around all that is shown, of its width
_MARGINS = (0.75, 0.5, 0.15, 0.3)


def cell_pictures(robot: Robot) -> tuple[Picture, ...]:
    """The outlines of the robot's solid shapes and of what its cell has, seen along two axes of the world."""
    model = robot.model
    shapes = [(name, 1e3 * points) for name, points in solid_points(model) if name != instrument_body(model)]
    heads = 1e3 * model.Ts_world_station[:, :3, 3]
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
