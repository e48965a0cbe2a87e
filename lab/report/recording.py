"""Draw rerun recordings: bodies in motion, frames, beams, ellipsoids, tags, texts, and the layout of their views.

Things in motion are given ``at`` the values of a timeline, one for each of their rows.
"""

import os
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from hashlib import sha256
from itertools import takewhile
from pathlib import Path
from typing import Any

import numpy as np
import rerun as rr
import rerun.blueprint as rrb
from numpy.typing import NDArray

from lab.core import se3
from lab.core.extras import optional
from lab.core.number_text import format_magnification
from lab.core.se3 import Array
from lab.core.units import MM
from lab.kinematics.model import RigidArm
from lab.report.document import Document, Section, Warnings, shown
from lab.report.markdown import to_markdown
from lab.report.scene import Legs, MagnifiedEllipsoids, moved, world_legs
from lab.report.style import (
    RGB_ARROW,
    RGB_AXES,
    RGB_BACKDROP,
    RGB_BEAM,
    RGB_FLOOR,
    RGB_LEG,
    RGB_PATH,
    RGB_ROD,
    RGB_TRACKER,
)
from lab.simulation.meshes import Shell, body_poses, shells
from lab.simulation.robot_model import RobotModel

__all__ = [
    "LEGS",
    "LOG_ERRORS",
    "PROGRAM",
    "SUMMARY",
    "TIME",
    "Colour",
    "Times",
    "backdrop",
    "bars",
    "close_view",
    "draw_arrows",
    "draw_beams",
    "draw_ellipsoid",
    "draw_error_curve",
    "draw_frames",
    "draw_instrument",
    "draw_legs",
    "draw_moves",
    "draw_moving",
    "draw_moving_legs",
    "draw_moving_tool",
    "draw_points",
    "draw_program",
    "draw_shells",
    "draw_tag",
    "draw_tracker",
    "error_plot",
    "eye",
    "eye_on_arm",
    "identity_of",
    "layout",
    "log_texts",
    "magnified_view",
    "main_view",
    "markdown",
    "moves_between",
    "notebook_viewer",
    "pose_times",
    "program_view",
    "recording_to",
    "text_tabs",
]  # fmt: skip

Colour = tuple[int, int, int]
Times = list[rr.TimeColumn]
LEGS = "world/arm/rods_and_legs"
_ROD: tuple[Colour, float] = RGB_ROD, 0.004  # and its radius, of the reach
_LEG: tuple[Colour, float] = RGB_LEG, 0.01
_LEGS_M, _TRACKER_HEIGHT_M = 0.3, 1.2  # height of a tracker's tripod and how far its feet reach; of a usual stand
_AXES = np.array(RGB_AXES, dtype=np.uint8)


@contextmanager
def recording_to(path: Path, robot: str, identity: str) -> Iterator[rr.RecordingStream]:
    """A recording of a world whose z is up, written to ``path`` when the block ends well, whatever RERUN is set to.

    Args:
        robot: the name of what it shows.
        identity: the same for the same content, so that the same content gives the same recording.
    """
    application = f"{robot} {identity[:8]}"  # a viewer has one blueprint for each application
    with _enabled():
        recording = rr.RecordingStream(application, recording_id=identity, send_properties=False)
    memory = recording.memory_recording()  # written at the end, in one go: a full disk would hang rerun's own writer
    recording.log("world", rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
    try:
        yield recording
    finally:  # rerun reports what it holds when it is dropped
        content = memory.drain_as_bytes() or b""
        recording.disconnect()
    path.write_bytes(content)


def notebook_viewer(recording: bytes) -> Any:
    """Return a widget that shows a recording in a notebook, from files of this machine: no network is needed.

    Raises:
        LabError: rerun-notebook is not installed.
    """
    os.environ.setdefault("RERUN_NOTEBOOK_ASSET", "serve-local")  # else it loads the viewer from the network
    widget = optional("rerun_notebook", "a recording in a notebook").Viewer(width="auto", height="auto")
    widget.send_rrd(recording)
    return widget


@contextmanager
def _enabled() -> Iterator[None]:
    """Unset the variable RERUN: it may turn logging off, which would leave an empty file."""
    given = os.environ.pop("RERUN", None)
    try:
        yield
    finally:
        if given is not None:
            os.environ["RERUN"] = given


def draw_shells(
    recording: rr.RecordingStream,
    at: Times,
    shells: Sequence[Shell],
    bodies: Mapping[str, Array],
    under: str = "world/arm",
) -> None:
    """The robot's shells, which move through the poses ``(m, 4, 4)`` of their bodies, as entities under a path."""
    for shell in shells:
        entity = f"{under}/{rr.escape_entity_path_part(shell.body)}"
        mesh = rr.Mesh3D(
            vertex_positions=shell.vertices,
            triangle_indices=shell.faces,
            vertex_normals=shell.normals,
            vertex_colors=shell.rgba,
        )
        recording.log(entity, mesh, static=True)
        draw_moving(recording, at, {shell.body: bodies[shell.body]}, under)


def draw_moving(
    recording: rr.RecordingStream, at: Times, bodies: Mapping[str, Array], under: str = "world/arm"
) -> None:
    """Further poses ``(m, 4, 4)`` of bodies that are drawn already under a path."""
    for name, Ts in bodies.items():
        _move(recording, f"{under}/{rr.escape_entity_path_part(name)}", at, Ts)


def draw_legs(recording: rr.RecordingStream, at: Times, legs: Legs, reach_m: float) -> None:
    """Rods and legs as lines from end to end; a serial arm has none, and no entity for them."""
    if not legs.measured:
        return
    colours, shares = zip(*(_LEG if measured else _ROD for measured in legs.measured), strict=True)
    style = rr.LineStrips3D.from_fields(colors=colours, radii=[share * reach_m for share in shares])
    recording.log(LEGS, style, static=True)
    draw_moving_legs(recording, at, legs)


def draw_moving_legs(recording: rr.RecordingStream, at: Times, legs: Legs) -> None:
    """Further places of rods and legs that are drawn already."""
    if count := len(legs.measured):
        lines = rr.LineStrips3D.columns(strips=list(legs.ends.reshape(-1, 2, 3))).partition([count] * len(legs.ends))
        recording.send_columns(LEGS, at, lines)


def _move(recording: rr.RecordingStream, entity: str, at: Times, Ts: Array) -> None:
    """Log poses ``(m, 4, 4)``, once where nothing moves."""
    positions, quaternions = Ts[:, :3, 3], _xyzw(Ts[:, :3, :3])
    if np.ptp(Ts, axis=0).max() == 0:
        still = rr.Transform3D(translation=positions[0], quaternion=quaternions[0])
        recording.log(entity, still, static=True)
        return
    moving = rr.Transform3D.columns(translation=positions, quaternion=quaternions)
    recording.send_columns(entity, at, moving)


def _xyzw(rotations: Array) -> Array:
    return se3.quaternion_from_rotation(rotations)[..., [1, 2, 3, 0]]


def draw_instrument(recording: rr.RecordingStream, name: str, T_world_instrument: Array, station: str = "") -> None:
    """The instrument's frame, at one of its stations where it has several."""
    entity = rr.new_entity_path(["world", "instrument", "frame", *([station] if station else [])])
    recording.log(entity, _axes([name, "", ""], T_world_instrument, 0.25), static=True)


def _axes(labels: Sequence[str], T: Array, length: float) -> rr.Arrows3D:
    """Draw the axes x, y and z of a frame in red, green and blue, each with its label."""
    origins, vectors = np.tile(T[:3, 3], (3, 1)), length * T[:3, :3].T
    return rr.Arrows3D(origins=origins, vectors=vectors, colors=_AXES, radii=0.024 * length, labels=list(labels))


def draw_frames(
    recording: rr.RecordingStream,
    at: Times,
    model: RobotModel,
    arm: RigidArm,
    values: Array,
    joints: Array,
    reach_m: float,
) -> None:
    """Draw the frames of the base and of the tool, the latter at the first target and at poses ``(m, joints)``."""
    base = _axes(["base", "", ""], model.T_world_frame0, _BASE_AXES * reach_m)
    recording.log("world/frames/base", base, static=True)
    tool = _axes(["", "", "tool"], np.eye(4), _TOOL_AXES * reach_m)  # z leads away from the arm
    recording.log(f"{_TOOL}/axes", tool, static=True)
    draw_moving_tool(recording, at, model, arm, values, joints)


def draw_moving_tool(
    recording: rr.RecordingStream, at: Times, model: RobotModel, arm: RigidArm, values: Array, joints: Array
) -> None:
    """Further places of the tool's frame, which is drawn already."""
    Ts = arm.tool(joints, np.concatenate([np.zeros(6), values[6:]]))[0]
    stands = np.isfinite(Ts).all(axis=(1, 2))
    if stands.all():
        _move(recording, _TOOL, at, model.T_world_frame0 @ Ts)


def draw_tracker(recording: rr.RecordingStream, head: Array) -> None:
    """A tracker on its stand: head, column and three legs on the floor, or as high as is usual where that is below.

    Args:
        head: ``(3,)`` m in the world.
    """
    floor = head[2] if head[2] > _LEGS_M else _TRACKER_HEIGHT_M
    waist, base = head - (0.0, 0.0, floor - _LEGS_M), head - (0.0, 0.0, floor)
    angles = 2 * np.pi / 3 * np.arange(3)
    feet = base + _LEGS_M * np.stack([np.cos(angles), np.sin(angles), np.zeros(3)], axis=1)
    shoulder = head - (0.0, 0.0, 0.12)
    strips = [np.stack([shoulder, waist]), *(np.stack([waist, each]) for each in feet)]
    stand = rr.LineStrips3D(strips, colors=RGB_TRACKER, radii=[0.035, 0.012, 0.012, 0.012])
    recording.log("world/instrument/stand", stand, static=True)
    body = rr.Ellipsoids3D(
        half_sizes=[[0.06, 0.06, 0.12]], centers=[head], colors=RGB_TRACKER, fill_mode="Solid", line_radii=0.0
    )
    recording.log("world/instrument/head", body, static=True)


def draw_beams(recording: rr.RecordingStream, at: Times, head: Array, points: Array) -> None:
    """Beams from the head, ``(3,)`` or of each pose ``(m, 3)``, to the points ``(m, k, 3)`` that are not NaN."""
    visible = np.isfinite(points).all(axis=2)
    heads = np.broadcast_to(np.reshape(head, (-1, 1, 3)), points.shape)
    strips = [np.stack(ends) for ends in zip(heads[visible], points[visible], strict=True)]
    beams = rr.LineStrips3D.columns(strips=strips).partition(visible.sum(axis=1))
    recording.send_columns("world/instrument/beam", at, beams)
    recording.log("world/instrument/beam", rr.LineStrips3D.from_fields(colors=RGB_BEAM, radii=0.0015), static=True)


def draw_ellipsoid(
    recording: rr.RecordingStream, name: str, at: Times, drawn: MagnifiedEllipsoids, colour: Colour
) -> None:
    """Draw an ellipsoid per row, with its half-axes and its magnification."""
    shape = rr.Ellipsoids3D.columns(half_sizes=drawn.half_sizes, centers=drawn.centers, quaternions=_xyzw(drawn.axes))
    recording.send_columns(f"world/ellipsoid/{name}/shape", at, shape)
    style = rr.Ellipsoids3D.from_fields(colors=colour, fill_mode="TransparentFillMajorWireframe", line_radii=0.0008)
    recording.log(f"world/ellipsoid/{name}/shape", style, static=True)
    vectors = np.swapaxes(drawn.axes * drawn.half_sizes[:, None, :], 1, 2).reshape(-1, 3)  # rows: the half-axes
    origins = np.repeat(drawn.centers, 3, axis=0)
    axes = rr.Arrows3D.columns(origins=origins, vectors=vectors).partition([3] * len(drawn.centers))
    recording.send_columns(f"world/ellipsoid/{name}/axes", at, axes)
    recording.log(f"world/ellipsoid/{name}/axes", rr.Arrows3D.from_fields(colors=RGB_ARROW, radii=0.002), static=True)
    _draw_lengths(recording, f"world/ellipsoid/{name}/lengths", at, drawn)
    above = drawn.centers + np.array([0.0, 0.0, 1.35]) * drawn.half_sizes[:, :1]
    draw_tag(recording, f"world/ellipsoid/{name}/factor", at, above, format_magnification(drawn.factor), colour)


def _draw_lengths(recording: rr.RecordingStream, entity: str, at: Times, drawn: MagnifiedEllipsoids) -> None:
    """Write the true length of each half-axis in mm beyond its tip, those of short ones as far out."""
    reached = np.maximum(_OUTSIDE * drawn.half_sizes, drawn.half_sizes[:, :1])
    places = drawn.centers[:, None] + np.swapaxes(drawn.axes * reached[:, None, :], 1, 2)
    labels = [MM.text(float(half) / drawn.factor) for half in drawn.half_sizes.ravel()]
    columns = rr.Points3D.columns(positions=places.reshape(-1, 3), labels=labels).partition([3] * len(places))
    recording.send_columns(entity, at, columns)
    recording.log(entity, rr.Points3D.from_fields(colors=RGB_ARROW, radii=0.0005, show_labels=True), static=True)


def _beside(tips: Array, vectors: Array, reach_m: float) -> Array:
    """Return the places ``(m, 3)`` of tags that stand beyond the tips of arrows, so as not to cover them."""
    lengths = np.linalg.norm(vectors, axis=1, keepdims=True)
    up = np.array([0.0, 0.0, 1.0])
    directions = np.where(lengths > 0, vectors / np.where(lengths > 0, lengths, 1.0), up)
    return np.asarray(tips + _BEYOND * reach_m * directions)


def draw_points(
    recording: rr.RecordingStream, entity: str, at: Times, points: Array, colour: Colour, radii: Any
) -> None:
    """Points ``(m, k, 3)`` in the world; NaN is left out."""
    there = np.asarray(np.isfinite(points).all(axis=2))
    columns = rr.Points3D.columns(positions=points[there]).partition(there.sum(axis=1))
    recording.send_columns(entity, at, columns)
    recording.log(entity, rr.Points3D.from_fields(colors=colour, radii=radii), static=True)


def draw_arrows(
    recording: rr.RecordingStream, entity: str, at: NDArray[np.int_], ends: tuple[Array, Array], factor: float,
    name: str, colour: Colour, reach_m: float,
) -> None:  # fmt: skip
    """Draw errors as arrows; name and magnification stand beyond the tip of the first of each pose.

    Args:
        at: ``(m,)`` numbers of the poses.
        ends: where errors begin, and the errors ``(m, k, 3)`` m in the world; NaN where there is none.
    """
    points, vectors = ends[0], factor * ends[1]
    there = np.asarray(np.isfinite(points + vectors).all(axis=2))
    columns = rr.Arrows3D.columns(origins=points[there], vectors=vectors[there]).partition(there.sum(axis=1))
    recording.send_columns(entity, pose_times(at), columns)
    recording.log(entity, rr.Arrows3D.from_fields(colors=colour, radii=0.008 * reach_m), static=True)
    first = np.flatnonzero(there[:, 0])
    tips = _beside((points + vectors)[first, 0], vectors[first, 0], reach_m)
    text = f"{name} {format_magnification(factor)}"
    draw_tag(recording, f"{entity}/factor", pose_times(at[first]), tips, text, colour)


def draw_error_curve(
    recording: rr.RecordingStream, at: NDArray[np.int_], name: str, lengths: Array, colour: Colour
) -> None:
    """Draw lengths ``(m,)`` m of poses with numbers ``(m,)`` by a logarithmic scale; NaN is left out."""
    used, entity = np.isfinite(lengths), f"{LOG_ERRORS}/{name}"
    logarithms = np.log10(np.maximum(MM.of(lengths[used]), _LEAST_MM))
    recording.send_columns(entity, pose_times(at[used]), rr.Scalars.columns(scalars=logarithms))
    recording.log(entity, rr.SeriesLines(colors=colour, names=name, widths=2), static=True)


def identity_of(digest: str, *arrays: Array) -> str:
    """Return an identifier from the digest of a robot and the arrays that are drawn: the same for the same content."""
    content = sha256(digest.encode())
    for array in arrays:
        content.update(np.ascontiguousarray(array).tobytes())
    return content.hexdigest()[:32]


def draw_tag(
    recording: rr.RecordingStream, entity: str, at: Times, positions: Array, text: str, colour: Colour
) -> None:
    """A text that goes along with ``positions`` ``(m, 3)``."""
    recording.send_columns(entity, at, rr.Points3D.columns(positions=positions))
    style = rr.Points3D.from_fields(colors=colour, radii=0.0005, labels=text, show_labels=True)
    recording.log(entity, style, static=True)


def log_texts(recording: rr.RecordingStream, document: Document, legend: Section | None = None) -> None:
    """Log a result's document: what comes before its sections, or the first, with the legend; and the whole of it."""
    blocks = tuple(block for block in shown(document.blocks, "recording") if not isinstance(block, Warnings))
    beginning = tuple(takewhile(lambda block: not isinstance(block, Section), blocks)) or blocks[:1]
    short = replace(document, blocks=(*beginning, *([legend] if legend else ())))
    for entity, each in ((SUMMARY, short), (_DETAILS, document)):
        recording.log(entity, markdown(to_markdown(each)), static=True)


def text_tabs(*more: rrb.View) -> rrb.Tabs:
    """Return the summary in front, behind it the whole document and further views."""
    first = [rrb.TextDocumentView(origin=entity, name=entity.capitalize()) for entity in (SUMMARY, _DETAILS)]
    return rrb.Tabs(*first, *more, active_tab=0)


def markdown(text: str) -> rr.TextDocument:
    """A text with tables and emphasis."""
    return rr.TextDocument(text, media_type=rr.MediaType.MARKDOWN)


PROGRAM = "program"  # the entity of what the arm does, line by line


def draw_program(recording: rr.RecordingStream, at: Times, lines: Sequence[str]) -> None:
    """Log the lines of a program at the times when the arm comes to them."""
    recording.send_columns(PROGRAM, at, rr.TextLog.columns(text=list(lines), level=["INFO"] * len(lines)))


def program_view() -> rrb.TextLogView:
    """Return the view of the program's lines: those up to now."""
    return rrb.TextLogView(origin=PROGRAM, name="Program")


SUMMARY, _DETAILS = "summary", "details"  # the entities of a recording's texts
_TOOL = "world/frames/tool"
_BASE_AXES, _TOOL_AXES = 0.3, 0.12  # of the reach: how long they are; those of the base show beside its shell
_OUTSIDE = 1.2  # half-axes from the centre: the label of a length, and no nearer than the longest half-axis
_LEAST_MM = 1e-9  # what a logarithmic plot shows of an error of nothing
_BEYOND = 0.03  # of the reach: from an arrow's tip to its tag
LOG_ERRORS = "error_log10_mm"  # the entity of errors by a logarithmic scale
_POSES_PER_SECOND = 2.0  # when it is played
_CLOSE = 0.36  # of the reach: how far a close view's eye is from the target
_SHOULDER_RAD, _DOWN = 0.9, 0.35  # the main view looks past the arm: turned from the line to the instrument, and down
_SHELL = 0.12  # of the reach: how far bodies stand out from the frames, for an arm that fills the view
_FLAT, _DOWN_ON_FLAT = 0.15, 1.8  # an arm of which all is lower than this share of its width lies in a plane
_FAR = 4.0  # reaches: an instrument further away does not have to be in view
_HALF_FIELD, _ASPECT = 0.5, 1.4  # what is to fit in a view: less than the viewer's field of 55 degrees


def layout(left: rrb.Container, right: rrb.Container, timeline: str) -> rrb.Blueprint:
    """Lay out two columns and nothing else, paused at the start of a timeline."""
    return rrb.Blueprint(
        rrb.Horizontal(left, right, column_shares=[2.3, 1]),
        rrb.TimePanel(timeline=timeline, play_state="paused", state="collapsed", fps=_POSES_PER_SECOND),
        collapse_panels=True,
        auto_views=False,
        auto_layout=False,
    )


def main_view(name: str, controls: rrb.EyeControls3D) -> rrb.Spatial3DView:
    """The arm and what is around it; ellipsoids and what is magnified more have their own views."""
    contents = ["+ /world/**", "- /world/ellipsoid/**", "- /world/magnified/**", "- /world/focus/**"]
    return rrb.Spatial3DView(
        origin="world", name=name, contents=contents, line_grid=_floor(), eye_controls=controls, background=backdrop()
    )


def magnified_view(name: str, origins: Array, reach_m: float) -> rrb.Spatial3DView:
    """Return the side view of the magnified parts, without shells; frame ``origins`` ``(m, f, 3)``."""
    middle = origins.mean(axis=(0, 1))
    controls = _orbital(middle + reach_m * np.array([0.35, -1.1, 0.3]), middle)
    contents = ["+ /world/magnified/**", "+ /world/path"]
    return rrb.Spatial3DView(
        origin="world", name=name, contents=contents, line_grid=_floor(), eye_controls=controls, background=backdrop()
    )


def close_view(entities: str, name: str, reach_m: float) -> rrb.Spatial3DView:
    """The target with one ellipsoid or what is magnified (below ``world``); ``world/focus`` is where it looks."""
    return rrb.Spatial3DView(
        origin="world/focus",
        name=name,
        contents=["+ /world/arm/**", "+ /world/targets/measured", f"+ /world/{entities}/**"],
        line_grid=False,
        eye_controls=_orbital(_CLOSE * reach_m * np.array([0.45, -0.8, 0.4]), np.zeros(3)),
        background=backdrop(),
    )


def bars(origin: str, name: str) -> rrb.BarChartView:
    """A bar chart without a legend."""
    return rrb.BarChartView(origin=origin, name=name, plot_legend=rrb.PlotLegend(visible=False))


def error_plot() -> rrb.TimeSeriesView:
    """Return the plot of errors by a logarithmic scale."""
    name = "Error, log10 of mm (0 is 1 mm, −2 is 0.01 mm), two poses a second"
    return rrb.TimeSeriesView(origin=LOG_ERRORS, name=name)


def eye(origins: Array, points: Array, reach_m: float, head: Array) -> rrb.EyeControls3D:
    """Over the arm's shoulder towards the instrument: the arm near and large, the instrument behind it.

    One that lies in a plane is looked down upon, without the instrument.

    Args:
        origins: ``(m, f, 3)`` of the frames, base outward.
        points: ``(k, 3)`` further ones to show.
        head: ``(3,)`` the instrument's.
    """
    base = origins[0, 0] + 0.25 * reach_m * np.array([[1, 1, 0], [1, -1, 0], [-1, 1, 0], [-1, -1, 0]])
    arm = np.concatenate([base, origins.reshape(-1, 3), points])
    middle = (arm.min(axis=0) + arm.max(axis=0)) / 2
    towards = (head - middle) * np.array([1.0, 1.0, 0.0])
    distance = float(np.linalg.norm(towards))
    towards = towards / distance if distance > 1e-6 else np.array([1.0, 0.0, 0.0])
    extent = np.ptp(arm, axis=0)
    flat = bool(extent[2] < _FLAT * extent.max())
    down = _DOWN_ON_FLAT if flat else _DOWN
    forward = se3.exp(np.array([0.0, 0.0, _SHOULDER_RAD])) @ towards + np.array([0.0, 0.0, -down])
    forward /= np.linalg.norm(forward)
    near = distance < _FAR * reach_m and not flat
    more = head + np.array([[0.0, 0.0, 0.3], [0.0, 0.0, -head[2]]]) if near else arm[:0]
    if flat:  # room for what is drawn above and below its plane
        more = np.concatenate([arm + np.array([0.0, 0.0, sign * 0.25 * reach_m]) for sign in (1, -1)])
    span = np.concatenate([arm, more])
    target, back = _framed(span, forward)
    return _orbital(target - back * forward, target)


def eye_on_arm(origins: Array, points: Array, reach_m: float) -> rrb.EyeControls3D:
    """Return a view from the front and the side of an arm without an instrument; arguments as those of ``eye``."""
    shells = origins.reshape(-1, 3)[:, None] + _SHELL * reach_m * np.array([[0, 0, 1], [0, 0, -1], [1, -1, 0]])
    behind = origins[0, 0] + _FAR * reach_m * np.array([0.2, 1.0, 0.0])  # no instrument: a direction alone
    return eye(origins, np.concatenate([points, shells.reshape(-1, 3)]), reach_m, behind)


def _orbital(position: Array, target: Array) -> rrb.EyeControls3D:
    return rrb.EyeControls3D(kind=rrb.Eye3DKind.Orbital, position=position, look_target=target, eye_up=(0.0, 0.0, 1.0))


def _framed(points: Array, forward: Array) -> tuple[Array, float]:
    """Return the look-at point and the distance along ``forward`` at which all ``points`` ``(n, 3)`` are in view."""
    right = np.cross(forward, (0.0, 0.0, 1.0))
    right /= np.linalg.norm(right)
    up = np.cross(right, forward)
    target, back = points.mean(axis=0), 0.0
    for _ in range(5):  # centre the picture, which moves as the eye does
        local = points - target
        depth, across, above = local @ forward, local @ right, local @ up
        needed = np.maximum(np.abs(across) / (_ASPECT * _HALF_FIELD), np.abs(above) / _HALF_FIELD)
        back = float((needed - depth).max())
        u, v = across / (depth + back), above / (depth + back)
        target = target + 0.5 * back * ((u.min() + u.max()) * right + (v.min() + v.max()) * up)
    return target, back


def _floor() -> rrb.archetypes.LineGrid3D:
    """A grid of 100 mm."""
    return rrb.LineGrid3D(visible=True, spacing=0.1, plane=rr.components.Plane3D.XY, stroke_width=0.5, color=RGB_FLOOR)


def backdrop() -> Any:
    """Return the background of every 3D view."""
    return rrb.Background(kind=rrb.BackgroundKind.SolidColor, color=RGB_BACKDROP)


TIME = "time"
_MOVING = 0.6  # of the time from pose to pose; the arm stands at each for the rest
_STEPS = 9  # drawn on the way to the next pose


def pose_times(numbers: NDArray[np.int_]) -> Times:
    """Return the times of poses ``numbers`` ``(m,)``: their number on a timeline, and seconds on ``time``."""
    return [
        rr.TimeColumn("pose", sequence=numbers),
        rr.TimeColumn(TIME, duration=np.asarray(numbers) / _POSES_PER_SECOND),
    ]


def moves_between(arm: RigidArm, numbers: NDArray[np.int_], joints: Array) -> tuple[Array, Array]:
    """Interpolate the arm's moves: all joints start and stop together, by a jerk-free law of degree five.

    Args:
        numbers: ``(m,)`` of the poses, rising.
        joints: ``(m, joints)`` of the arm there.

    Returns:
        Seconds ``(w,)`` and joint positions ``(w, joints)``, where the arm can be assembled.
    """
    shares = np.arange(1, _STEPS + 1) / (_STEPS + 1)
    passed = shares**3 * (10 - 15 * shares + 6 * shares**2)
    arrive = np.asarray(numbers[1:], dtype=float) / _POSES_PER_SECOND
    seconds = (arrive[:, None] - (1 - shares) * _MOVING / _POSES_PER_SECOND).ravel()
    between = (joints[:-1, None] + passed[:, None] * np.diff(joints, axis=0)[:, None]).reshape(-1, joints.shape[1])
    stands = arm.chain.is_assemblable(between)
    return seconds[stands], between[stands]


def draw_moves(
    recording: rr.RecordingStream,
    model: RobotModel,
    arm: RigidArm,
    values: Array,
    numbers: NDArray[np.int_],
    joints: Array,
    *,
    path: bool = False,
) -> None:
    """Bodies and legs on their way between poses ``joints`` ``(m, joints)``; at the poses they are drawn already.

    Args:
        path: whether the line is drawn along which the first target moves.
    """
    seconds, between = moves_between(arm, numbers, joints)
    if not len(seconds):
        return
    at: Times = [rr.TimeColumn(TIME, duration=seconds)]
    seen = {shell.body for shell in shells(model)}
    bodies = body_poses(model, arm, values, between)
    still = body_poses(model, arm, values, joints)  # what stands at all poses was drawn once
    moving = {name: Ts for name, Ts in bodies.items() if name in seen and np.ptp(still[name], axis=0).max() > 0}
    draw_moving(recording, at, moving)
    draw_moving_tool(recording, at, model, arm, values, between)
    if path:
        places = moved(model.T_world_frame0, arm.points(between, np.concatenate([np.zeros(6), values[6:]]))[:, 0])
        recording.log(
            "world/path", rr.LineStrips3D([places], colors=RGB_PATH, radii=rr.Radius.ui_points(1.0)), static=True
        )
    draw_moving_legs(recording, at, world_legs(model.T_world_frame0, arm, values, between))
