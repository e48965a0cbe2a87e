"""A load at the hand as a rerun recording: the arm with its load along what was recorded, and its torques or wrench.

What moves is on the timeline ``time`` (of static poses on ``pose``).
"""

import hashlib
from pathlib import Path

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from lab.commands.payload.result import channels, cost_words, rows_of
from lab.commands.payload.run import PayloadResult
from lab.core import se3
from lab.core.se3 import Array
from lab.render.recording_layout import FAR, SUMMARY, eye, layout, main_view
from lab.render.rerun_primitives import Times, draw_shells, markdown, recording_to
from lab.render.scene import moved
from lab.render.skeleton import frame_origins
from lab.simulation.meshes import body_poses, shells

MOST_DRAWN = 300  # rows of a run
_LOAD, _WEIGHT = (60, 205, 130), (235, 60, 60)
_WITH, _WITHOUT = (60, 205, 130), (150, 155, 165)
_BALL_KG_M3 = 7850.0  # steel, where the inertia is not known
_WEIGHT_M_PER_N = 0.01


def record_payload(path: Path, run: PayloadResult) -> None:
    """Write the recording of ``lab payload``, with the blueprint that shows it."""
    assert run.records is not None
    loaded = run.records.run(True)
    shown = loaded.take(np.unique(np.linspace(0, len(loaded) - 1, MOST_DRAWN).round().astype(int)))
    timeline = "pose" if shown.time_s is None else "time"
    at = _times(shown.time_s, len(shown))
    model, arm = run.robot.model, run.robot.serial_arm(("p1",))
    values = arm.nominal(run.robot.tool)
    Ts = model.T_world_frame0 @ arm.flange(shown.joints, values)
    with recording_to(path, run.robot.name, _identity(run)) as recording:
        origins = moved(model.T_world_frame0, frame_origins(arm, values, shown.joints))
        reach = float(np.linalg.norm(origins - origins[:, :1], axis=2).max())
        recording.send_blueprint(_blueprint(run, origins, reach, timeline))
        draw_shells(recording, at, shells(model), body_poses(model, arm, values, shown.joints))
        if np.isfinite(run.estimate.com_m).all():
            _load(recording, at, run, Ts)
        _channels(recording, run)
        recording.log(SUMMARY, markdown(_summary(run)), static=True)


def _times(time_s: Array | None, count: int) -> Times:
    if time_s is None:
        return [rr.TimeColumn("pose", sequence=np.arange(count))]
    return [rr.TimeColumn("time", duration=time_s)]


def _identity(run: PayloadResult) -> str:
    """The same for the same content, so that the same file gives the same recording."""
    assert run.records is not None
    digest = hashlib.sha256(run.robot.sha256.encode())
    for array in (run.records.joints, run.records.loaded, run.estimate.phi):
        digest.update(np.ascontiguousarray(array).tobytes())
    return digest.hexdigest()[:32]


def _load(recording: rr.RecordingStream, at: Times, run: PayloadResult, Ts: Array) -> None:
    """The load as the solid ellipsoid that has its mass and inertia, and its weight as an arrow."""
    found = run.estimate
    half, axes = equivalent_ellipsoid(found.mass_kg, found.inertia_com_kgm2)
    centres = se3.transform(Ts, found.com_m[None])[:, 0]
    turns = se3.quaternion_from_rotation(Ts[:, :3, :3] @ axes)[:, [1, 2, 3, 0]]
    ellipsoids = rr.Ellipsoids3D.columns(half_sizes=np.tile(half, (len(Ts), 1)), centers=centres, quaternions=turns)
    recording.send_columns("world/load", at, ellipsoids)
    recording.log("world/load", rr.Ellipsoids3D.from_fields(colors=_LOAD, fill_mode="Solid"), static=True)
    down = run.robot.model.T_world_frame0[:3, :3] @ run.mounting.gravity
    weight = np.tile(_WEIGHT_M_PER_N * found.mass_kg * down, (len(Ts), 1))
    recording.send_columns("world/weight", at, rr.Arrows3D.columns(origins=centres, vectors=weight))
    recording.log("world/weight", rr.Arrows3D.from_fields(colors=_WEIGHT, radii=0.004), static=True)


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


def _channels(recording: rr.RecordingStream, run: PayloadResult) -> None:
    """Torques, or the wrench, with the load and without it."""
    assert run.records is not None
    for kind, loaded, colour in (("loaded", True, _WITH), ("unloaded", False, _WITHOUT)):
        part = run.records.run(loaded)
        if not len(part):
            continue
        part = part.take(np.unique(np.linspace(0, len(part) - 1, 4 * MOST_DRAWN).round().astype(int)))
        time_s = None if part.time_s is None else part.time_s - part.time_s[0]
        for name, values in _named(run, part.torques, part.wrench):
            entity = f"channels/{name}/{kind}"
            recording.send_columns(entity, _times(time_s, len(part)), rr.Scalars.columns(scalars=values))
            recording.log(entity, rr.SeriesLines(colors=colour, names=kind, widths=1.5), static=True)


def _named(run: PayloadResult, torques: Array | None, wrench: Array | None) -> list[tuple[str, Array]]:
    """What the load was identified from."""
    seen = wrench if run.estimate.method.startswith("wrench") else torques
    assert seen is not None
    return [(name, values) for (name, _), values in zip(channels(run), seen.T, strict=True)]


def _summary(run: PayloadResult) -> str:
    """What was found, in markdown."""
    found = run.estimate
    lines = [f"# {run.robot.name}: {found.mass_kg:.4g} kg at the hand", f"{found.method}.", f"{found.verdict.words}."]
    lines += ["| | value | ± | unit |", "|---|--:|--:|---|", *("| " + " | ".join(row) + " |" for row in rows_of(found))]
    lines += ["", *(f"- not told: {words}" for words in found.unidentified)]
    if np.isfinite(run.cost_m):
        lines.append(f"- {cost_words(run)}")
    lines += [
        "## What is shown",
        "- **green**: the load, as the solid ellipsoid that has its mass and inertia (a ball of steel where that is "
        "not known); **red**: its weight",
        "- curves: **green** with the load, **grey** without",
    ]
    return "\n".join(lines) + "\n"


def _blueprint(run: PayloadResult, origins: Array, reach: float, timeline: str) -> rrb.Blueprint:
    """The arm large, what was measured beside it, text at hand."""
    views = [
        rrb.TimeSeriesView(origin=f"channels/{name}", name=f"{name}, {unit}", plot_legend=rrb.PlotLegend(visible=False))
        for name, unit in channels(run)
    ]
    ahead = origins[0, 0] + FAR * reach * np.array([1.0, -1.0, 0.0])  # nothing to be in view, only where to look
    controls = eye(origins, origins[:, -1], reach, ahead)
    text = rrb.TextDocumentView(origin=SUMMARY, name="Summary")
    right = rrb.Vertical(text, rrb.Grid(*views, grid_columns=2), row_shares=[1, 1.6])
    return layout(rrb.Vertical(main_view("Arm and load", controls)), right, timeline)
