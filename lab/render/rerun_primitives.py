"""Things that every recording draws: bodies that move, a frame, beams, ellipsoids, tags, texts.

What moves is given ``at`` the values of a timeline, one for each of its rows.
"""

import os
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import rerun as rr

from lab.core import se3
from lab.core.se3 import Array
from lab.render.format import format_magnification
from lab.render.scene import MagnifiedEllipsoids
from lab.render.skeleton import Legs
from lab.render.style import RGB_ARROW, RGB_AXES, RGB_BEAM, RGB_LEG, RGB_ROD, RGB_TRACKER
from lab.simulation.meshes import Shell

__all__ = [
    "LEGS",
    "Colour",
    "Times",
    "draw_beams",
    "draw_ellipsoid",
    "draw_instrument",
    "draw_legs",
    "draw_moving",
    "draw_moving_legs",
    "draw_shells",
    "draw_tag",
    "draw_tracker",
    "markdown",
    "recording_to",
]

Colour = tuple[int, int, int]
Times = list[rr.TimeColumn]
LEGS = "world/arm/rods_and_legs"
_ROD: tuple[Colour, float] = RGB_ROD, 0.004  # and its radius, of the reach
_LEG: tuple[Colour, float] = RGB_LEG, 0.01
_LEGS_M, _STAND_M = 0.3, 1.2  # height of a tracker's tripod and how far its feet reach; of a usual stand
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
    yield recording
    path.write_bytes(memory.drain_as_bytes() or b"")
    recording.disconnect()


@contextmanager
def _enabled() -> Iterator[None]:
    """Without the variable RERUN: one that turns off what a program logs would leave a file without content."""
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
    T = T_world_instrument
    axes = rr.Arrows3D(
        origins=np.tile(T[:3, 3], (3, 1)), vectors=0.25 * T[:3, :3].T, colors=_AXES, radii=0.006, labels=[name, "", ""]
    )
    recording.log(
        rr.new_entity_path(["world", "instrument", "frame", *([station] if station else [])]), axes, static=True
    )


def draw_tracker(recording: rr.RecordingStream, head: Array) -> None:
    """A tracker on its stand: head, column and three legs on the floor, or as high as is usual where that is below.

    Args:
        head: ``(3,)`` m in the world.
    """
    floor = head[2] if head[2] > _LEGS_M else _STAND_M
    waist, foot = head - (0.0, 0.0, floor - _LEGS_M), head - (0.0, 0.0, floor)
    angles = 2 * np.pi / 3 * np.arange(3)
    feet = foot + _LEGS_M * np.stack([np.cos(angles), np.sin(angles), np.zeros(3)], axis=1)
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
    """One ellipsoid a row, with its half-axes and its magnification."""
    shape = rr.Ellipsoids3D.columns(half_sizes=drawn.half_sizes, centers=drawn.centers, quaternions=_xyzw(drawn.axes))
    recording.send_columns(f"world/ellipsoid/{name}/shape", at, shape)
    style = rr.Ellipsoids3D.from_fields(colors=colour, fill_mode="TransparentFillMajorWireframe", line_radii=0.0008)
    recording.log(f"world/ellipsoid/{name}/shape", style, static=True)
    vectors = np.swapaxes(drawn.axes * drawn.half_sizes[:, None, :], 1, 2).reshape(-1, 3)  # rows: the half-axes
    origins = np.repeat(drawn.centers, 3, axis=0)
    axes = rr.Arrows3D.columns(origins=origins, vectors=vectors).partition([3] * len(drawn.centers))
    recording.send_columns(f"world/ellipsoid/{name}/axes", at, axes)
    recording.log(f"world/ellipsoid/{name}/axes", rr.Arrows3D.from_fields(colors=RGB_ARROW, radii=0.002), static=True)
    above = drawn.centers + np.array([0.0, 0.0, 1.1]) * drawn.half_sizes[:, :1]
    draw_tag(recording, f"world/ellipsoid/{name}/factor", at, above, format_magnification(drawn.factor), colour)


def draw_tag(
    recording: rr.RecordingStream, entity: str, at: Times, positions: Array, text: str, colour: Colour
) -> None:
    """A text that goes along with ``positions`` ``(m, 3)``."""
    recording.send_columns(entity, at, rr.Points3D.columns(positions=positions))
    style = rr.Points3D.from_fields(colors=colour, radii=0.0005, labels=text, show_labels=True)
    recording.log(entity, style, static=True)


def markdown(text: str) -> rr.TextDocument:
    """A text with tables and emphasis."""
    return rr.TextDocument(text, media_type=rr.MediaType.MARKDOWN)
