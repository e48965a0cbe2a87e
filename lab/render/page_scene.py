"""Scene of an arm at its poses for a page, which draws it in 3D without a network.

Arrays are in the world of the model (m). The page's script, ``page_scene.js``, reads them as base64 of 32-bit floats.
"""

import base64
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from markupsafe import Markup

from lab.core.errors import counted
from lab.core.se3 import Array, inverse, transform
from lab.core.units import MM
from lab.kinematics.model import RigidArm
from lab.render.charts.chart import shades
from lab.render.document import format_magnification, short
from lab.render.scene import Legs, MagnifiedEllipsoids, moved, world_legs
from lab.render.style import COLOUR_SCALE, INDEX, MUTED, rgb
from lab.render.surfaces import coarse
from lab.simulation.meshes import Shell, arm_shells, body_poses
from lab.simulation.model import RobotModel

__all__ = ["ArmScene", "Arrows", "posed_arm", "scene_json"]

_MOST_FACES = 20_000  # of all shells of an arm, as drawn on a page


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
class ArmScene:
    """An arm at ``n`` poses, with a point and its errors at each.

    Attributes:
        names: of the poses.
        shells: surfaces of the bodies.
        bodies: poses ``(n, 4, 4)`` of the bodies by name.
        points: ``(n, 3)``, where arrows and ellipsoids begin; NaN where there is none.
        arrows: errors.
        columns: lengths ``(n,)`` in m for the table of the poses, by their headings; the last one colours the points.
        ellipsoids: drawn around the points, with the half-axes' lengths; None for none.
        legs: lines of a mechanism.
        ellipsoid_text: what the ellipsoids are.
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

    @property
    def switches(self) -> list[tuple[str, str, bool]]:
        """Name and label of each part that a reader can hide, and whether it is shown at first."""
        found = [("arm", "arm", True), ("others", "all poses", True)]
        found += [(each.label, each.label, each.at_first) for each in self.arrows]
        if self.ellipsoids is not None:
            found.append(("axes", f"{self.ellipsoid_text} {format_magnification(self.ellipsoids.factor)}", True))
        return found

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
        return ["pose", *(f"{name}, mm" for name in self.columns)]

    @property
    def title(self) -> str:
        """Title of the table of the poses."""
        return f"Errors of {counted(len(self.names), 'pose')}"


def posed_arm(model: RobotModel, arm: RigidArm, values: Array, joints: Array, names: Sequence[str]) -> ArmScene:
    """Return the scene of an arm with parameters ``values`` at joint positions ``(n, joints)``, without errors."""
    visible = arm_shells(model)
    bodies = body_poses(model, arm, values, joints)
    points = moved(model.T_world_frame0 @ inverse(arm.T_tracker_frame0(values)), arm.points(joints, values))
    return ArmScene(names, visible, bodies, points[:, 0], world_legs(model.T_world_frame0, arm, values, joints))


def scene_json(scene: ArmScene) -> Markup:
    """Write a scene as JSON that can stand in a page."""
    shares = np.array([len(each.faces) for each in scene.shells], float)
    budgets = np.maximum(12, _MOST_FACES * shares / max(shares.sum(), _MOST_FACES)).astype(int)
    reduced = [coarse(each.vertices, each.faces, int(most)) for each, most in zip(scene.shells, budgets, strict=True)]
    places = np.stack([scene.bodies[each.body] for each in scene.shells], axis=1)  # (n, bodies, 4, 4)
    shown = np.asarray(np.isfinite(scene.points).all(axis=1))
    corners = [np.stack([each.vertices.min(axis=0), each.vertices.max(axis=0)]) for each in scene.shells]
    ends = [transform(places[:, i], pair).reshape(-1, 3) for i, pair in enumerate(corners)]
    around = np.concatenate([*ends, scene.points[shown]])
    middle = (around.min(axis=0) + around.max(axis=0)) / 2
    lengths = list(scene.columns.values())
    data: dict[str, Any] = {
        "names": list(scene.names),
        "first": _typical(scene),
        "texts": [_text(scene, row) for row in scene.rows],
        "middle": [round(float(part), 5) for part in middle],
        "radius": round(float(np.linalg.norm(around - middle, axis=1).max()), 5),
        "shells": [
            {
                "vertices": _floats(vertices),
                "faces": base64.b64encode(faces.astype("<u2").tobytes()).decode(),
                "rgb": [int(part) for part in np.median(each.rgba[:, :3], axis=0)],
            }
            for each, (vertices, faces) in zip(scene.shells, reduced, strict=True)
        ],
        "places": _floats(np.swapaxes(places, 2, 3)),
        "points": _floats(np.where(shown[:, None], scene.points, middle)),
        "lines": _floats(scene.legs.ends),
        "colours": _colours(lengths[-1]) if lengths else [rgb(MUTED)] * len(scene.names),
        "arrows": [
            {
                "name": each.label,
                "vectors": _floats(np.nan_to_num(each.vectors)),
                "factor": each.factor,
                "rgb": each.rgb,
            }
            for each in scene.arrows
        ],
        "axes": None,
    }
    if (drawn := scene.ellipsoids) is not None:
        halves = np.swapaxes(drawn.axes * drawn.half_sizes[:, None, :], 1, 2)  # (n, axis, 3)
        data["axes"] = {
            "halves": _floats(np.nan_to_num(halves)),
            "lengths": [[f"{short(MM.of(size))} mm" for size in row] for row in drawn.half_sizes / drawn.factor],
            "rgb": rgb(INDEX),
        }
    return Markup(json.dumps(data, separators=(",", ":"), allow_nan=False).replace("<", "\\u003c"))


def _typical(scene: ArmScene) -> int:
    """Return the pose that is shown at first: that of the median ellipsoid."""
    if scene.ellipsoids is None:
        return 0
    return int(np.argsort(scene.ellipsoids.half_sizes[:, 0])[len(scene.names) // 2])


def _text(scene: ArmScene, row: Sequence[str]) -> str:
    errors = (f"{name} {value} mm" for name, value in zip(scene.columns, row[1:], strict=True) if value)
    return ", ".join((f"pose {row[0]}", *errors))


def _floats(values: Array) -> str:
    return base64.b64encode(np.ascontiguousarray(values, dtype="<f4").tobytes()).decode()


def _colours(lengths: Array) -> list[list[int]]:
    """Colour lengths on a logarithmic scale, from the smallest to the largest."""
    logs = np.log(np.maximum(np.nan_to_num(lengths), 1e-12))
    colours: list[list[int]] = (
        np.round(255 * shades((logs - logs.min()) / (float(np.ptp(logs)) or 1.0), COLOUR_SCALE)).astype(int).tolist()
    )
    return colours
