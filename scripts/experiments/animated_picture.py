"""The animated picture of the README, made again: a real UR5 whose errors shrink as it is calibrated.

The command in ``COMMAND`` identifies it. The arrows are the errors at poses that the fit has not seen. They change
evenly from those of the nominal model to those of the calibrated one, and the mean with them. The file keeps the
command and its headline, which a test compares with what the command prints.
"""

import io
import shlex
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from shared import Answer, Document, paragraphs, run_script

import lab
from lab.core.errors import LabError
from lab.core.number_text import format_magnification
from lab.core.se3 import Array, transform
from lab.core.units import MM
from lab.report.scene import magnification, moved
from lab.report.style import ARM, ARROW_AFTER, BEFORE, GRID, INK, MUTED, rgb
from lab.report.view import document_of
from lab.simulation.meshes import arm_shells, body_poses

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from PIL import Image

NEEDS: Final = ("matplotlib", "PIL")
ROOT: Final = Path(__file__).parents[2]
DATA: Final = "models/ur5/measured/ur5_jacobi_1000.csv"
COMMAND: Final = f"lab identify {DATA} --robot ur5 --holdout 0.3 --model auto"
DESCRIPTION: Final = 0x010E  # the tag ImageDescription of EXIF
SIZE: Final = (1200, 630)  # pixels; a page shows it 800 wide
FRAMES, FRAME_MS = 72, 83  # six seconds
_SHOWN: Final = 800  # pixels, how wide a page shows it
_LARGE, _TITLE, _SMALL = 44, 19, 15  # pixels of text, as shown
_SCENE: Final = 0.65  # of the width: the arm's part
_ARROWS, _STOPS = 90, 7  # poses whose errors are drawn, and to which the arm goes
_SHELL_M, _EDGE_M = 0.09, 0.03  # how far shells stand out from frames; the longest edge of a face as it is sorted
_LENGTH_M = 0.12  # of the mean arrow before calibration
_EYE: Final = np.array([0.62, -0.70, 0.34])  # from where it is seen
_LINKS: Final = (ARM, "#cbd5e1")  # greys: the colours are those of the errors
_LIGHT: Final = np.array([0.35, -0.75, 0.9])
_CALM, _DONE = 0.36, 0.62  # of the time: the arrows begin to shrink, and have shrunk


@dataclass(frozen=True)
class Scene:
    """What is drawn, in the world (m).

    Attributes:
        points: ``(n, 3)`` at poses that were not fitted.
        before, after: ``(n, 3)`` errors there, measured less predicted.
        joints: ``(FRAMES, joints)`` of the arm.
        headline: that the command prints.
    """

    robot: lab.Robot
    arm: Any
    values: Array
    points: Array
    before: Array
    after: Array
    joints: Array
    headline: str

    @property
    def factor(self) -> float:
        """Magnification of the arrows."""
        return magnification(float(np.linalg.norm(self.before, axis=1).mean()), _LENGTH_M)

    def mean(self, share: float) -> float:
        """Return the mean error (m) at a share of the way from before to after."""
        return float(np.linalg.norm((1 - share) * self.before + share * self.after, axis=1).mean())


@dataclass(frozen=True)
class Options:
    """Where to write the picture."""

    out: Path = Path("docs/pictures/real_arm.webp")
    """The file to write."""
    json: bool = False
    """Print one JSON object."""


def answer(options: Options) -> Answer:
    """Identify the arm, draw it frame by frame, write one file.

    Raises:
        LabError: the file cannot be written.
    """
    from PIL import Image

    scene = measured_scene()
    frames = [drawn(scene, number) for number in range(FRAMES)]
    about = Image.Exif()
    about[DESCRIPTION] = f"{COMMAND}\n{scene.headline.replace('→', 'to')}"  # EXIF is ASCII
    try:
        frames[0].save(
            options.out, format="WEBP", save_all=True, append_images=frames[1:], duration=FRAME_MS, loop=0,
            quality=72, method=6, minimize_size=False, exif=about,
        )  # fmt: skip
    except OSError as error:
        raise LabError(f"{options.out}: cannot be written ({error.strerror or error}); give another --out") from error
    size = options.out.stat().st_size
    lines = [scene.headline, f"{options.out}: {len(frames)} frames, {size / 1e6:.2f} MB"]
    values = {"command": COMMAND, "headline": scene.headline, "bytes": size, "magnification": scene.factor}
    return Answer(values, Document("Animated picture", paragraphs(lines)))


def measured_scene() -> Scene:
    """Run the command, and take the errors at the poses that it held out."""
    words = shlex.split(COMMAND)
    result = lab.identify(
        ROOT / DATA, robot=words[words.index("--robot") + 1], holdout=0.3, model="auto", no_recording=True
    )
    rows, found = result.validation.rows, result.identification
    assert rows is not None  # it holds poses out
    model, inputs = found.model, rows.inputs(found.model.conditions)
    arm, values = result.rigid(found.values)
    T_world_tracker = result.robot.model.T_world_frame0 @ np.linalg.inv(arm.T_tracker_frame0(values))
    measured, turn = rows.points[:, 0], T_world_tracker[:3, :3]
    both = (model.points(inputs, each)[:, 0] for each in (found.nominal_aligned, found.values))
    before, after = ((measured - predicted) @ turn.T for predicted in both)
    stops = _round_trip(rows.joints[np.linspace(0, len(rows) - 1, _STOPS).astype(int)])
    points, headline = moved(T_world_tracker, measured), document_of(result).title
    return Scene(result.robot, arm, values, points, before, after, _on_the_way(stops), headline)


def _round_trip(joints: Array) -> Array:
    """Order stops so that each is the nearest of those left, and the first is the last again."""
    left, order = list(range(1, len(joints))), [0]
    while left:
        steps = np.abs(joints[left] - joints[order[-1]]).max(axis=1)
        order.append(left.pop(int(np.argmin(steps))))
    return joints[[*order, 0]]


def _on_the_way(stops: Array) -> Array:
    """Return joint positions of all frames: a move to each stop, smooth at both ends, as long as it is far."""
    lengths = np.abs(np.diff(stops, axis=0)).max(axis=1)
    ends = np.concatenate([[0.0], np.cumsum(np.sqrt(lengths))])
    at = np.arange(FRAMES) / FRAMES * ends[-1]
    move = np.clip(np.searchsorted(ends, at, side="right") - 1, 0, len(lengths) - 1)
    share = (at - ends[move]) / np.diff(ends)[move]
    smooth = (share**3 * (10 - 15 * share + 6 * share**2))[:, None]
    return np.asarray(stops[move] + smooth * (stops[move + 1] - stops[move]))


def shrunk(number: int) -> float:
    """Return the share of the way from before to after in a frame."""
    share = float(np.clip((number / FRAMES - _CALM) / (_DONE - _CALM), 0, 1))
    return share * share * (3 - 2 * share)


def drawn(scene: Scene, number: int) -> "Image.Image":
    """Draw a frame."""
    from PIL import Image

    figure = frame_figure(scene, number)
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=figure.dpi)
    return Image.open(buffer).convert("RGB")


def frame_figure(scene: Scene, number: int) -> "Figure":
    """Draw a frame with matplotlib."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(SIZE[0] / 100, SIZE[1] / 100), dpi=100, facecolor="white")
    axes = figure.add_axes((0.0, 0.0, _SCENE, 1.0))
    _draw_arm(axes, scene, scene.joints[number])
    share = shrunk(number)
    _draw_errors(axes, scene, share)
    corners = _seen(_around(scene))
    middle, half = (corners.min(axis=0) + corners.max(axis=0)) / 2, np.ptp(corners, axis=0) / 2
    size = max(half[0] / (_SCENE * SIZE[0]), half[1] / SIZE[1])
    axes.set_xlim(middle[0] - size * _SCENE * SIZE[0], middle[0] + size * _SCENE * SIZE[0])
    axes.set_ylim(middle[1] - size * SIZE[1], middle[1] + size * SIZE[1])
    axes.set_axis_off()
    _write(figure, scene, share)
    return figure


def _around(scene: Scene) -> Array:
    """Return what is in view all the time: the arm's frames with their shells, and the points with their errors."""
    geometry = np.concatenate([np.zeros(6), scene.values[6:]])
    origins = moved(scene.robot.T_world_frame0, scene.arm.skeleton(scene.joints, geometry).origins).reshape(-1, 3)
    shells = [origins + side for side in (_SHELL_M * np.eye(3)).tolist()] + [origins - _SHELL_M]
    return np.concatenate([*shells, scene.points, scene.points + scene.factor * scene.before])


def _seen(points: Array) -> Array:
    """Project points ``(..., 3)`` on the picture's plane ``(..., 2)``, without perspective."""
    forward = -_EYE / np.linalg.norm(_EYE)
    right = np.cross(forward, (0.0, 0.0, 1.0))
    right /= np.linalg.norm(right)
    return np.stack([points @ right, points @ np.cross(right, forward)], axis=-1)


def _draw_arm(axes: Any, scene: Scene, joints: Array) -> None:
    """Draw the arm's surfaces, the farthest first, and its shadow on the floor."""
    import trimesh
    from matplotlib.collections import PolyCollection

    model = scene.robot.model
    bodies = body_poses(model, scene.arm, scene.values, joints[None])
    corners, colours = [], []
    for i, shell in enumerate(arm_shells(model)):
        vertices, triangles = trimesh.remesh.subdivide_to_size(  # type: ignore[no-untyped-call]
            shell.vertices.astype(float), shell.faces, _EDGE_M
        )
        corners.append(transform(bodies[shell.body][0], vertices)[triangles])
        colours.append(np.tile(np.array(rgb(_LINKS[i % 2])) / 255, (len(triangles), 1)))
    faces, tints = np.concatenate(corners), np.concatenate(colours)
    normals = np.cross(faces[:, 1] - faces[:, 0], faces[:, 2] - faces[:, 0])
    sizes = np.linalg.norm(normals, axis=1)
    towards = normals @ _EYE
    kept = (towards > 0) & (sizes > 0)
    faces, tints, normals = faces[kept], tints[kept], normals[kept] / sizes[kept, None]
    light = np.clip(normals @ (_LIGHT / np.linalg.norm(_LIGHT)), 0, 1)
    shaded = np.clip(tints * (0.6 + 0.45 * light[:, None]), 0, 1)
    order = np.argsort(faces.mean(axis=1) @ _EYE)
    floor = faces * (1.0, 1.0, 0.0)
    axes.add_collection(PolyCollection(list(_seen(floor)), facecolors=GRID, edgecolors=GRID, linewidths=0.6, zorder=0))
    axes.add_collection(
        PolyCollection(
            list(_seen(faces[order])), facecolors=shaded[order], edgecolors=shaded[order], linewidths=0.5, zorder=2
        )
    )


def _draw_errors(axes: Any, scene: Scene, share: float) -> None:
    """Draw the errors at an evenly spaced part of the poses, all with one magnification."""
    rows = np.linspace(0, len(scene.points) - 1, _ARROWS).astype(int)
    vectors = scene.factor * ((1 - share) * scene.before[rows] + share * scene.after[rows])
    start, end = _seen(scene.points[rows]), _seen(scene.points[rows] + vectors)
    colour = _blend(share)
    for a, b in zip(start, end, strict=True):
        style = {"arrowstyle": "-|>,head_length=0.42,head_width=0.2", "color": colour, "linewidth": 2.0,
                 "shrinkA": 0, "shrinkB": 0}  # fmt: skip
        axes.annotate("", xy=b, xytext=a, arrowprops=style, zorder=3)
    axes.scatter(*start.T, s=9, color=INK, zorder=4, linewidths=0)


def _blend(share: float) -> tuple[float, ...]:
    """Return the colour at a share of the way from before to after."""
    first, last = (np.array(rgb(each)) / 255 for each in (BEFORE, ARROW_AFTER))
    return tuple(float(part) for part in (1 - share) * first + share * last)


def _write(figure: "Figure", scene: Scene, share: float) -> None:
    """Write what is seen beside the arm."""
    x, poses = _SCENE + 0.01, len(scene.points)
    calibrated = share > 0.5
    lines = (
        (0.84, scene.robot.name + ", a real arm", _TITLE, INK, "bold"),
        (0.775, "measured by a laser tracker", _SMALL, MUTED, "normal"),
        (0.60, "calibrated" if calibrated else "nominal model", _TITLE, _blend(share), "bold"),
        (0.465, f"{MM.of(scene.mean(share)):#.2g} mm", _LARGE, _blend(share), "bold"),
        (0.39, f"mean error of {poses} positions", _SMALL, INK, "normal"),
        (0.335, "that the fit has not seen", _SMALL, INK, "normal"),
        (0.16, f"arrows: errors {format_magnification(scene.factor)}", _SMALL, _blend(share), "bold"),
        (0.105, "dots: measured positions", _SMALL, MUTED, "normal"),
    )
    for y, text, pixels, colour, weight in lines:
        points = pixels * SIZE[0] / _SHOWN * 72 / figure.dpi
        figure.text(x, y, text, fontsize=points, color=colour, fontweight=weight, ha="left", va="baseline")


if __name__ == "__main__":
    run_script("animated_picture")
