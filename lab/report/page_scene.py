"""Scene of an arm at its poses for a page, which draws it in 3D without a network.

Arrays are in the world of the model (m). The page's script, ``page_scene.js``, reads them as base64 of 32-bit floats.
"""

import base64
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from markupsafe import Markup
from numpy.typing import NDArray

from lab.core.errors import counted
from lab.core.number_text import format_magnification, short
from lab.core.se3 import Array, inverse, transform
from lab.core.units import MM
from lab.kinematics.model import RigidArm
from lab.report.charts.chart import shades
from lab.report.scene import Legs, MagnifiedEllipsoids, moved, world_legs
from lab.report.style import COLOUR_SCALE, INDEX, MUTED, PREDICTED, rgb
from lab.simulation.meshes import Shell, arm_shells, body_poses
from lab.simulation.robot_model import RobotModel

__all__ = ["ArmScene", "Arrows", "Line", "Surface", "coarse", "moments", "moving_arm", "posed_arm", "scene_json"]

_MOST_FACES = 20_000  # of all shells of an arm, and of all surfaces, as drawn on a page
_MOST_MOMENTS = 400  # of a motion
_SEE_THROUGH = 0.14  # opacity of the arm at the other poses


@dataclass(frozen=True)
class Arrows:
    """Errors at each pose, drawn as arrows from the point.

    Attributes:
        name: in one word.
        vectors: ``(n, 3)`` m; NaN where there is none.
        factor: magnification.
        rgb: colour, 0 to 255.
        at_first: whether they are shown before a reader switches them on.
    """

    name: str
    vectors: Array
    factor: float
    rgb: tuple[int, int, int]
    at_first: bool = True

    @property
    def label(self) -> str:
        """Name with the magnification, by which their switch is known."""
        return f"{self.name} {format_magnification(self.factor)}"


@dataclass(frozen=True)
class Line:
    """A line, such as the path of the tool.

    Attributes:
        name: in a few words, by which its switch is known.
        points: ``(p, 3)`` m; NaN parts the line.
        rgb: ``(p, 3)`` colours of the points, or ``(3,)`` of all, 0 to 255.
        at_first: whether it is shown before a reader switches it on.
    """

    name: str
    points: Array
    rgb: Array | tuple[int, int, int]
    at_first: bool = True


@dataclass(frozen=True)
class Surface:
    """A see-through surface around the arm, such as the boundary of its workspace.

    Attributes:
        name: in a few words, by which its switch is known.
        vertices: ``(v, 3)`` m.
        faces: ``(f, 3)`` indices into them.
        rgb: colour, 0 to 255.
    """

    name: str
    vertices: Array
    faces: NDArray[np.integer]
    rgb: tuple[int, int, int]


@dataclass(frozen=True)
class ArmScene:
    """An arm at ``n`` poses, with a point and its errors at each, or in motion through them.

    Attributes:
        names: of the poses.
        shells: surfaces of the bodies.
        bodies: poses ``(n, 4, 4)`` of the bodies by name; of a motion ``(m, 4, 4)``, one for each moment.
        points: ``(n, 3)``, where arrows and ellipsoids begin; NaN where there is none.
        arrows: errors.
        columns: lengths ``(n,)`` in m for the table of the poses, by their headings; the last one colours the points.
        ellipsoids: drawn around the points, with the half-axes' lengths; None for none.
        legs: lines of a mechanism, as many as of the bodies.
        ellipsoid_text: what the ellipsoids are.
        times: ``(m,)`` s of the moments of a motion; None where the arm stands at one pose after the other.
        stops: ``(n,)`` moments at which a moving arm is at the poses.
        lines: in the world.
        surfaces: in the world.
        kind: what a pose is, in one word: pose, target, solution.
        all_text: label of the switch that shows the points of all poses; empty for no such switch.
        ghosts_text: label of the switch that shows the arm at all poses at a time, see-through; empty for none.
    """

    names: Sequence[str]
    shells: Sequence[Shell]
    bodies: Mapping[str, Array]
    points: Array
    legs: Legs
    arrows: Sequence[Arrows] = ()
    columns: Mapping[str, Array] = field(default_factory=dict)
    ellipsoids: MagnifiedEllipsoids | None = None
    ellipsoid_text: str = ""
    times: Array | None = None
    stops: NDArray[np.int_] | None = None
    lines: Sequence[Line] = ()
    surfaces: Sequence[Surface] = ()
    kind: str = "pose"
    all_text: str = "all poses"
    ghosts_text: str = ""

    @property
    def switches(self) -> list[tuple[str, str, bool, str]]:
        """Name, label, whether it is shown at first, and colour or "" of each part that a reader can hide."""
        found = [("arm", "arm", True, ""), ("others", self.all_text, True, "")]
        found += [("ghosts", self.ghosts_text, True, "")]
        found += [(each.label, each.label, each.at_first, _css(each.rgb)) for each in self.arrows]
        found += [(each.name, each.name, each.at_first, _css(each.rgb)) for each in self.lines]
        found += [(each.name, each.name, True, _css(each.rgb)) for each in self.surfaces]
        if self.ellipsoids is not None:
            label = f"{self.ellipsoid_text} {format_magnification(self.ellipsoids.factor)}"
            found.append(("axes", label, True, _css(rgb(INDEX))))
        return [each for each in found if each[1]]

    @property
    def slider(self) -> tuple[str, int]:
        """Label and last value of the slider: over the moments of a motion, or over the poses."""
        return (self.kind, len(self.names) - 1) if self.times is None else ("time", len(self.times) - 1)

    @property
    def rows(self) -> list[tuple[str, ...]]:
        """Name and lengths (mm) of each pose, as text."""
        cells = [
            [short(MM.of(value)) if np.isfinite(value) else "" for value in each] for each in self.columns.values()
        ]
        return list(zip(self.names, *cells, strict=True))

    @property
    def headings(self) -> list[str]:
        """Headings of the columns of ``rows``."""
        return [self.kind, *(f"{name}, mm" for name in self.columns)]

    @property
    def title(self) -> str:
        """Title of the table of the poses."""
        return f"{counted(len(self.names), self.kind)}: {' and '.join(self.columns)}"


def posed_arm(model: RobotModel, arm: RigidArm, values: Array, joints: Array, names: Sequence[str]) -> ArmScene:
    """Return the scene of an arm with parameters ``values`` at joint positions ``(n, joints)``, without errors."""
    visible = arm_shells(model)
    bodies = body_poses(model, arm, values, joints)
    points = moved(model.T_world_frame0 @ inverse(arm.T_tracker_frame0(values)), arm.points(joints, values))
    return ArmScene(names, visible, bodies, points[:, 0], world_legs(model.T_world_frame0, arm, values, joints))


def moving_arm(
    model: RobotModel,
    arm: RigidArm,
    values: Array,
    joints: Array,
    times: Array,
    stops: Sequence[int] | NDArray[np.int_],
    names: Sequence[str],
) -> ArmScene:
    """Return the scene of an arm in motion, with the path of its point.

    Args:
        model: of the robot.
        arm: with parameters ``values``.
        values: ``(p,)``.
        joints: ``(m, joints)`` at the moments; of more than 400 some are left out.
        times: ``(m,)`` s.
        stops: ``(n,)`` moments at which the arm is at the poses, which stay.
        names: of the poses.
    """
    shown = moments(len(times), stops)
    moving = posed_arm(model, arm, values, joints[shown], names)
    path = Line("path", moving.points, rgb(PREDICTED))
    at = np.searchsorted(shown, stops)
    return replace(moving, points=moving.points[at], times=times[shown], stops=at, lines=(path,), all_text="points")


def moments(count: int, stops: Sequence[int] | NDArray[np.int_]) -> NDArray[np.int_]:
    """Return the moments of a motion that a page shows: all, or 400 of them evenly spaced, and the stops."""
    every = np.round(np.linspace(0, count - 1, min(count, _MOST_MOMENTS))).astype(int)
    return np.asarray(np.union1d(every, np.asarray(stops, int)))


def scene_json(scene: ArmScene) -> Markup:
    """Write a scene as JSON that can stand in a page."""
    places = np.stack([scene.bodies[each.body] for each in scene.shells], axis=1)  # (n, bodies, 4, 4)
    middle, radius = _surroundings(scene, places)
    shown = np.asarray(np.isfinite(scene.points).all(axis=1))
    lengths = list(scene.columns.values())
    data: dict[str, Any] = {
        "names": list(scene.names),
        "first": _typical(scene),
        "texts": [_text(scene, row) for row in scene.rows],
        "middle": [round(float(part), 5) for part in middle],
        "radius": round(radius, 5),
        "times": None if scene.times is None else [round(float(time), 4) for time in scene.times],
        "stops": None if scene.stops is None else scene.stops.tolist(),
        "shells": _shells(scene.shells),
        "places": _floats(np.swapaxes(places, 2, 3)),
        "points": _floats(np.where(shown[:, None], scene.points, middle)),
        "legs": _floats(scene.legs.ends),
        "lines": [_line(each) for each in scene.lines],
        "surfaces": [_surface(each) for each in scene.surfaces],
        "opacity": _SEE_THROUGH,
        "colours": _colours(lengths[-1]) if lengths else [rgb(MUTED)] * len(scene.names),
        "arrows": [_arrows(each) for each in scene.arrows],
        "axes": None if scene.ellipsoids is None else _half_axes(scene.ellipsoids),
    }
    return Markup(json.dumps(data, separators=(",", ":"), allow_nan=False).replace("<", "\\u003c"))


def _surroundings(scene: ArmScene, places: Array) -> tuple[Array, float]:
    """Return the middle ``(3,)`` of all that is drawn, and its distance from the farthest of it (m).

    Args:
        places: ``(n, bodies, 4, 4)`` of the shells.
    """
    corners = [np.stack([each.vertices.min(axis=0), each.vertices.max(axis=0)]) for each in scene.shells]
    ends = [transform(places[:, i], pair).reshape(-1, 3) for i, pair in enumerate(corners)]
    lines, surfaces = [each.points for each in scene.lines], [each.vertices for each in scene.surfaces]
    around = np.concatenate([*ends, scene.points, *lines, *surfaces])
    around = around[np.isfinite(around).all(axis=1)]
    middle = (around.min(axis=0) + around.max(axis=0)) / 2
    return middle, float(np.linalg.norm(around - middle, axis=1).max())


def _shells(drawn: Sequence[Shell]) -> list[dict[str, Any]]:
    """Return the shells with as many faces as a page can show, each with its share of them."""
    shares = np.array([len(each.faces) for each in drawn], float)
    budgets = np.maximum(12, _MOST_FACES * shares / max(shares.sum(), _MOST_FACES)).astype(int)
    reduced = [coarse(each.vertices, each.faces, int(most)) for each, most in zip(drawn, budgets, strict=True)]
    return [
        {
            "vertices": _floats(vertices),
            "faces": _integers(faces),
            "rgb": [int(part) for part in np.median(each.rgba[:, :3], axis=0)],
        }
        for each, (vertices, faces) in zip(drawn, reduced, strict=True)
    ]


def _half_axes(drawn: MagnifiedEllipsoids) -> dict[str, Any]:
    halves = np.swapaxes(drawn.axes * drawn.half_sizes[:, None, :], 1, 2)  # (n, axis, 3)
    return {
        "halves": _floats(np.nan_to_num(halves)),
        "lengths": [[f"{short(MM.of(size))} mm" for size in row] for row in drawn.half_sizes / drawn.factor],
        "rgb": rgb(INDEX),
    }


def _line(line: Line) -> dict[str, Any]:
    colours = np.broadcast_to(line.rgb, line.points.shape).tolist()
    return {"name": line.name, "points": _floats(line.points), "rgb": colours}


def _arrows(arrows: Arrows) -> dict[str, Any]:
    vectors = _floats(np.nan_to_num(arrows.vectors))
    return {"name": arrows.label, "vectors": vectors, "factor": arrows.factor, "rgb": arrows.rgb}


def _surface(surface: Surface) -> dict[str, Any]:
    vertices, faces = coarse(surface.vertices, surface.faces, _MOST_FACES)
    return {"name": surface.name, "vertices": _floats(vertices), "faces": _integers(faces), "rgb": surface.rgb}


def _css(colours: Array | tuple[int, int, int]) -> str:
    """Return a colour as CSS has it; of a line in several colours the middle one."""
    return "rgb({:.0f} {:.0f} {:.0f})".format(*np.median(np.reshape(colours, (-1, 3)), axis=0))


def _typical(scene: ArmScene) -> int:
    """Return the pose that is shown at first: that of the median ellipsoid."""
    if scene.ellipsoids is None:
        return 0
    return int(np.argsort(scene.ellipsoids.half_sizes[:, 0])[len(scene.names) // 2])


def _text(scene: ArmScene, row: Sequence[str]) -> str:
    errors = (f"{name} {value} mm" for name, value in zip(scene.columns, row[1:], strict=True) if value)
    return ", ".join((f"{scene.kind} {row[0]}", *errors))


def _floats(values: Array) -> str:
    return base64.b64encode(np.ascontiguousarray(values, dtype="<f4").tobytes()).decode()


def _integers(faces: NDArray[np.integer]) -> str:
    return base64.b64encode(faces.astype("<u2").tobytes()).decode()


def _colours(lengths: Array) -> list[list[int]]:
    """Colour lengths on a logarithmic scale, from the smallest to the largest."""
    logs = np.log(np.maximum(np.nan_to_num(lengths), 1e-12))
    colours: list[list[int]] = (
        np.round(255 * shades((logs - logs.min()) / (float(np.ptp(logs)) or 1.0), COLOUR_SCALE)).astype(int).tolist()
    )
    return colours


_FINEST_CELLS = 128  # along the longest edge of a mesh, in which corners are merged


def coarse(vertices: NDArray[np.floating], triangles: NDArray[np.integer], most: int) -> tuple[Array, NDArray[np.int_]]:
    """Merge the corners within each cell of a grid, as fine as leaves at most ``most`` triangles (at least 12).

    Returns:
        vertices ``(k, 3)`` m and triangles ``(f, 3)``; ``k`` is less than 65,536.
    """
    low, size = vertices.min(axis=0), float(np.ptp(vertices, axis=0).max()) or 1.0
    cells = _FINEST_CELLS
    while True:
        grid = np.round((vertices - low) * (cells / size)).astype(np.int_)
        _, merged, count = np.unique(grid, axis=0, return_inverse=True, return_counts=True)
        merged = merged.ravel()
        corners = np.zeros((len(count), 3))
        np.add.at(corners, merged, vertices)
        faces = merged[triangles]
        a, b, c = faces.T
        faces = faces[(a != b) & (b != c) & (c != a)]
        if (len(faces) <= most and len(count) < 2**16) or cells <= 2:
            return corners / count[:, None], faces
        cells = int(cells / 1.4)
