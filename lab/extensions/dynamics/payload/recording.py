"""A payload at the flange as a rerun recording: the arm with its payload, and its torques or wrench.

What moves is on the timeline ``time`` (of static poses on ``pose``).
"""

import hashlib
from pathlib import Path

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from lab.core import se3
from lab.core.se3 import Array
from lab.extensions.dynamics.payload.result import PayloadResult, channels_of
from lab.render.markdown import to_markdown
from lab.render.recording import SUMMARY, Times, draw_shells, eye_on_arm, layout, main_view, markdown, recording_to
from lab.render.scene import moved, skeleton
from lab.render.style import RGB_MUTED, RGB_PAYLOAD, RGB_WEIGHT
from lab.simulation.meshes import arm_shells, body_poses

__all__ = ["equivalent_ellipsoid", "record_payload"]

MOST_DRAWN = 300  # rows of a run
_BALL_KG_M3 = 7850.0  # steel, where the inertia is not known
_WEIGHT_M_PER_N = 0.01


def record_payload(path: Path, result: PayloadResult) -> None:
    """Write the recording of ``lab payload``, with the blueprint that shows it."""
    assert result.samples is not None
    loaded = result.samples.run(True)
    shown = loaded.take(np.unique(np.linspace(0, len(loaded) - 1, MOST_DRAWN).round().astype(int)))
    timeline = "pose" if shown.time_s is None else "time"
    at = _times(shown.time_s, len(shown))
    model, arm = result.robot.model, result.robot.serial_arm(("p1",))
    values = arm.nominal(result.robot.tool)
    Ts = model.T_world_frame0 @ arm.flange(shown.joints, values)
    with recording_to(path, result.robot.name, _identity(result)) as recording:
        origins = moved(model.T_world_frame0, skeleton(arm, values, shown.joints).origins)
        reach = float(np.linalg.norm(origins - origins[:, :1], axis=2).max())
        recording.send_blueprint(_blueprint(result, origins, reach, timeline))
        draw_shells(recording, at, arm_shells(model), body_poses(model, arm, values, shown.joints))
        if np.isfinite(result.estimate.com_m).all():
            _load(recording, at, result, Ts)
        _channels(recording, result)
        recording.log(SUMMARY, markdown(to_markdown(result.document())), static=True)


def _times(time_s: Array | None, count: int) -> Times:
    if time_s is None:
        return [rr.TimeColumn("pose", sequence=np.arange(count))]
    return [rr.TimeColumn("time", duration=time_s)]


def _identity(result: PayloadResult) -> str:
    """An identifier made of the content, so that one file always gives one recording."""
    assert result.samples is not None
    digest = hashlib.sha256(result.robot.sha256.encode())
    for array in (result.samples.joints, result.samples.loaded, result.estimate.phi):
        digest.update(np.ascontiguousarray(array).tobytes())
    return digest.hexdigest()[:32]


def _load(recording: rr.RecordingStream, at: Times, result: PayloadResult, Ts: Array) -> None:
    """The load as the solid ellipsoid that has its mass and inertia, and its weight as an arrow."""
    found = result.estimate
    half, axes = equivalent_ellipsoid(found.mass_kg, found.inertia_com_kgm2)
    centres = se3.transform(Ts, found.com_m[None])[:, 0]
    rotations = se3.quaternion_from_rotation(Ts[:, :3, :3] @ axes)[:, [1, 2, 3, 0]]
    ellipsoids = rr.Ellipsoids3D.columns(half_sizes=np.tile(half, (len(Ts), 1)), centers=centres, quaternions=rotations)
    recording.send_columns("world/load", at, ellipsoids)
    recording.log("world/load", rr.Ellipsoids3D.from_fields(colors=RGB_PAYLOAD, fill_mode="Solid"), static=True)
    down = result.robot.model.T_world_frame0[:3, :3] @ result.mounting.gravity
    weight = np.tile(_WEIGHT_M_PER_N * found.mass_kg * down, (len(Ts), 1))
    recording.send_columns("world/weight", at, rr.Arrows3D.columns(origins=centres, vectors=weight))
    recording.log("world/weight", rr.Arrows3D.from_fields(colors=RGB_WEIGHT, radii=0.004), static=True)


def equivalent_ellipsoid(mass_kg: float, inertia_kgm2: Array) -> tuple[Array, Array]:
    """Half-axes ``(3,)`` m and directions ``(3, 3)`` of the solid ellipsoid with this mass and inertia.

    I_x = m (b^2 + c^2) / 5, and so on; a ball of steel where the inertia is not known or no body has it.
    """
    if np.isfinite(inertia_kgm2).all():
        moments, axes = np.linalg.eigh(inertia_kgm2)
        squares = 2.5 * (moments.sum() - 2 * moments) / mass_kg
        if (squares > 0).all():
            axes[:, 0] *= np.linalg.det(axes)
            return np.sqrt(squares), axes
    radius = (0.75 * abs(mass_kg) / np.pi / _BALL_KG_M3) ** (1 / 3)
    return np.full(3, radius), np.eye(3)


def _channels(recording: rr.RecordingStream, result: PayloadResult) -> None:
    """Torques, or the wrench, with the load and without it."""
    assert result.samples is not None
    for kind, loaded, colour in (("loaded", True, RGB_PAYLOAD), ("unloaded", False, RGB_MUTED)):
        part = result.samples.run(loaded)
        if not len(part):
            continue
        part = part.take(np.unique(np.linspace(0, len(part) - 1, 4 * MOST_DRAWN).round().astype(int)))
        time_s = None if part.time_s is None else part.time_s - part.time_s[0]
        for name, values in _named(result, part.torques, part.wrench):
            entity = f"channels/{name}/{kind}"
            recording.send_columns(entity, _times(time_s, len(part)), rr.Scalars.columns(scalars=values))
            recording.log(entity, rr.SeriesLines(colors=colour, names=kind, widths=1.5), static=True)


def _named(result: PayloadResult, torques: Array | None, wrench: Array | None) -> list[tuple[str, Array]]:
    """Return the names and measured values of the channels from which the load was identified."""
    measured = wrench if result.estimate.method.startswith("wrench") else torques
    assert measured is not None
    return [(name, values) for (name, _), values in zip(channels_of(result), measured.T, strict=True)]


def _blueprint(result: PayloadResult, origins: Array, reach: float, timeline: str) -> rrb.Blueprint:
    """The arm large, what was measured beside it, text at hand."""
    views = [
        rrb.TimeSeriesView(origin=f"channels/{name}", name=f"{name}, {unit}", plot_legend=rrb.PlotLegend(visible=False))
        for name, unit in channels_of(result)
    ]
    controls = eye_on_arm(origins, origins[:, -1], reach)
    text = rrb.TextDocumentView(origin=SUMMARY, name="Summary")
    right = rrb.Vertical(text, rrb.Grid(*views, grid_columns=2), row_shares=[1, 1.6])
    return layout(rrb.Vertical(main_view("Arm and load", controls)), right, timeline)
