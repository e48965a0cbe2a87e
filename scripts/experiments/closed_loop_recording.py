"""Corrected targets run on a virtual arm, as a rerun recording: circle, line and test cube, before and after.

What moves is on the timeline ``step``: the circle, the line, then the cube's poses, at each of which the arm stays.
"""

import hashlib
from dataclasses import dataclass
from itertools import product
from pathlib import Path

import numpy as np
import rerun as rr
import rerun.blueprint as rrb
from closed_loop import ClosedLoop, Cube, VisitedPath, compensator_of
from numpy.typing import NDArray

import lab
from lab.commands.calibrate.figures import world_of
from lab.compensation.iso9283 import accuracy, cube_positions, repeatability
from lab.core.errors import LabError
from lab.core.se3 import Array
from lab.render.document import format_magnification
from lab.render.recording import (
    SUMMARY,
    Times,
    backdrop,
    draw_instrument,
    draw_shells,
    layout,
    main_view,
    markdown,
    recording_to,
)
from lab.render.scene import LARGEST_FACTOR, magnification, moved, skeleton
from lab.render.style import RGB_AFTER, RGB_ARROW, RGB_BEFORE, RGB_PATH
from lab.simulation.meshes import Shell, body_poses, shells

DEVIATION = 0.15  # of the cube's side: how long the mean deviation is to be drawn
HOLD = 10  # steps that the arm stays at a pose of the cube
_CORNERS = np.array(list(product((-0.5, 0.5), repeat=3)))  # of a cube of side one
_EDGES = np.array([(a, b) for a in range(8) for b in range(a) if (a ^ b).bit_count() == 1])


@dataclass(frozen=True)
class ShownCourse:
    """A course in the world, in the order in which it is run.

    Attributes:
        steps: ``(n,)`` when the arm is at each target.
        wanted: ``(n, 3)`` m.
        before, after: ``(n, 3)`` m, attained in the mean over the cycles.
        error_before, error_after: ``(n,)`` m, mean lengths over the cycles.
    """

    steps: NDArray[np.int_]
    wanted: Array
    before: Array
    after: Array
    error_before: Array
    error_after: Array

    def drawn(self, when: str, factor: float) -> Array:
        """Places ``(n, 3)`` attained ``before`` or ``after``, their deviations magnified."""
        attained = self.before if when == "before" else self.after
        return self.wanted + factor * (attained - self.wanted)


@dataclass(frozen=True)
class LoopScene:
    """Circle, line and cube poses that a virtual arm ran, one after the other.

    Attributes:
        courses: ``circle``, ``line`` and ``poses``; without those of which nothing was reached.
        names: of the cube's poses that were reached.
        edges: ``(12, 2, 3)`` of the cube.
        normal: ``(3,)`` unit, of the plane that circle, line and poses are in; away from the arm.
        factor: magnification of all deviations; ``factor_close`` that of those after, seen by themselves.
        shells: of the bodies in ``bodies``.
        bodies: world poses ``(n, 4, 4)`` by name, as identified, at the corrected readings.
        origins: ``(n, f, 3)`` of the arm's frames.
    """

    courses: dict[str, ShownCourse]
    names: tuple[str, ...]
    edges: Array
    normal: Array
    factor: float
    factor_close: float
    T_world_tracker: Array
    shells: tuple[Shell, ...]
    bodies: dict[str, Array]
    origins: Array

    @property
    def side_m(self) -> float:
        """The cube's: sizes of marks follow it."""
        return float(np.linalg.norm(self.edges[0, 1] - self.edges[0, 0]))

    @property
    def whole(self) -> ShownCourse:
        """All courses as one."""
        parts = [vars(course).values() for course in self.courses.values()]
        return ShownCourse(*(np.concatenate(column) for column in zip(*parts, strict=True)))


def loop_scene(outcome: lab.CalibrationResult, loop: ClosedLoop) -> LoopScene:
    """The scene of a closed loop, arm and tracker as they were identified.

    Raises:
        LabError: nothing of circle, line and cube was reached.
    """
    model, (arm, values) = outcome.robot.model, outcome.rigid(outcome.identification.values)
    run = {"circle": (loop.circle, 1), "line": (loop.line, 1), "poses": (loop.poses, HOLD)}
    if not sum(len(course.wanted) for course, _ in run.values()):
        raise LabError(f"robot {outcome.robot.name}: nothing of circle, line and test cube was reached")
    T_world_tracker, courses, start = world_of(outcome), {}, 0
    for name, (course, hold) in run.items():
        if len(course.wanted):
            courses[name] = _shown(course, T_world_tracker, start, hold)
            start += hold * len(course.wanted)
    joints = np.concatenate([course.corrected for course, _ in run.values()])
    places, corners = (
        _in_world(outcome, loop.cube, offsets)
        for offsets in (cube_positions(loop.cube.side_m), loop.cube.side_m * _CORNERS)
    )
    reached = moved(T_world_tracker, loop.poses.wanted)
    normal = np.cross(places[1] - places[0], places[3] - places[0])
    normal *= np.copysign(1.0, normal @ (places[0] - model.T_world_frame0[:3, 3])) / np.linalg.norm(normal)
    errors = [np.concatenate([course.errors[k].ravel() for course, _ in run.values()]) for k in (0, 1)]
    factor, close = (magnification(float(each.mean()), DEVIATION * loop.cube.side_m) for each in errors)
    return LoopScene(
        courses,
        tuple(f"P{k + 1}" for k in np.linalg.norm(reached[:, None] - places, axis=2).argmin(axis=1)),
        corners[_EDGES],
        normal,
        factor,
        min(close, LARGEST_FACTOR),
        T_world_tracker,
        tuple(shells(model)),
        body_poses(model, arm, values, joints),
        moved(model.T_world_frame0, skeleton(arm, values, joints).origins),
    )


def _shown(course: VisitedPath, T_world_tracker: Array, start: int, hold: int) -> ShownCourse:
    """A course, its first target at step ``start``, each for ``hold`` steps."""
    return ShownCourse(
        start + hold * np.arange(len(course.wanted)),
        *(moved(T_world_tracker, at) for at in (course.wanted, course.before.mean(axis=0), course.after.mean(axis=0))),
        *(error.mean(axis=0) for error in course.errors),
    )


def _in_world(outcome: lab.CalibrationResult, cube: Cube, offsets: Array) -> Array:
    """Places ``(n, 3)`` m from the cube's centre, in the world."""
    return moved(world_of(outcome), cube.poses(offsets, compensator_of(outcome).nominal).positions)


TIMELINE = "step"
WORLD, CLOSE = "world", "close"  # what is left after correction is also shown by itself, at a scale of its own
_EDGE, _WANTED = RGB_PATH, RGB_ARROW
_COLOURS = {"before": RGB_BEFORE, "after": RGB_AFTER}
_BEADS = 2  # every how many points of a path one is drawn


def record_loop(path: Path, outcome: lab.CalibrationResult, loop: ClosedLoop) -> None:
    """Write a closed loop's recording, with the blueprint that shows it, to ``path``.

    Raises:
        LabError: nothing of circle, line and cube was reached.
    """
    shown = loop_scene(outcome, loop)
    with recording_to(path, outcome.robot.name, _identity(outcome, loop)) as recording:
        recording.send_blueprint(_blueprint(shown))
        draw_shells(recording, _at(shown.whole), shown.shells, shown.bodies)
        draw_instrument(recording, "tracker", shown.T_world_tracker)
        edges = rr.LineStrips3D(list(shown.edges), colors=_EDGE, radii=0.002 * shown.side_m)
        recording.log(f"{WORLD}/cube", edges, static=True)
        for world in (WORLD, CLOSE):
            _commanded(recording, world, shown)
        for when in _COLOURS:
            _attained(recording, when, shown)
        _left(recording, shown)
        _here(recording, shown)
        _errors(recording, shown)
        recording.log(SUMMARY, markdown(_summary(outcome, loop, shown)), static=True)


def _identity(outcome: lab.CalibrationResult, loop: ClosedLoop) -> str:
    """The same for the same content, so that the same loop gives the same recording."""
    digest = hashlib.sha256(outcome.robot.sha256.encode())
    for course in (loop.poses, loop.targets, loop.circle, loop.line):
        for array in (course.wanted, course.corrected, course.before, course.after):
            digest.update(np.ascontiguousarray(array).tobytes())
    digest.update(np.ascontiguousarray(outcome.identification.values).tobytes())
    return digest.hexdigest()[:32]


def _at(course: ShownCourse) -> Times:
    return [rr.TimeColumn(TIMELINE, sequence=course.steps)]


def _commanded(recording: rr.RecordingStream, world: str, shown: LoopScene) -> None:
    """The cube's poses with their names, circle and line as beads."""
    for name, course in shown.courses.items():
        labels, every, radius = (list(shown.names), 1, 0.018) if name == "poses" else (None, _BEADS, 0.007)
        places = course.wanted[::every]
        points = rr.Points3D(places, colors=_WANTED, radii=radius * shown.side_m, labels=labels, show_labels=True)
        recording.log(f"{world}/commanded/{name}", points, static=True)


def _attained(recording: rr.RecordingStream, when: str, shown: LoopScene) -> None:
    """Circle and line as attained, arrows to where the cube's poses were attained, and by how much it is magnified."""
    entity, colour = f"{WORLD}/attained/{when}", _COLOURS[when]
    for name, course in shown.courses.items():
        places = course.drawn(when, shown.factor)
        if name == "poses":
            vectors, radius = places - course.wanted, 0.013 * shown.side_m
            arrows = rr.Arrows3D(origins=course.wanted, vectors=vectors, colors=colour, radii=radius)
            recording.log(f"{entity}/{name}", arrows, static=True)
        else:
            strip = np.concatenate([places, places[:1]]) if name == "circle" else places
            lines = rr.LineStrips3D([strip], colors=colour, radii=0.004 * shown.side_m)
            recording.log(f"{entity}/{name}", lines, static=True)
    below = np.array([0.0, 0.0, (0.62 if when == "before" else 0.71) * shown.side_m])
    place = shown.edges.mean(axis=(0, 1)) - below
    tag = rr.Points3D(
        place, labels=f"{when} {format_magnification(shown.factor)}", colors=colour, radii=0.0005, show_labels=True
    )
    recording.log(f"{entity}/factor", tag, static=True)


def _left(recording: rr.RecordingStream, shown: LoopScene) -> None:
    """What is left after, at its own scale: each place attained as a point, joined to the commanded one."""
    for name, course in shown.courses.items():
        places, entity = course.drawn("after", shown.factor_close), f"{CLOSE}/attained/after/{name}"
        points = rr.Points3D(places, colors=RGB_AFTER, radii=0.008 * shown.side_m)
        recording.log(entity, points, static=True)
        spokes = rr.LineStrips3D(
            np.stack([course.wanted, places], axis=1), colors=RGB_AFTER, radii=0.0015 * shown.side_m
        )
        recording.log(f"{entity}/from_commanded", spokes, static=True)


def _here(recording: rr.RecordingStream, shown: LoopScene) -> None:
    """The target where the arm is, and what it misses it by: magnified arrows, and mm."""
    whole, at = shown.whole, _at(shown.whole)
    recording.send_columns(f"{WORLD}/here/wanted", at, rr.Points3D.columns(positions=whole.wanted))
    style = rr.Points3D.from_fields(colors=_WANTED, radii=0.016 * shown.side_m)
    recording.log(f"{WORLD}/here/wanted", style, static=True)
    down = whole.before[:, 2:] < whole.wanted[:, 2:]
    aside = np.where(down, -1.0, 1.0) * np.array([0.0, 0.0, 0.12 * shown.side_m])  # (n, 3)
    for when, errors, colour, beside in (
        ("before", whole.error_before, RGB_BEFORE, aside),
        ("after", whole.error_after, RGB_AFTER, -aside),
    ):
        entity, places = f"{WORLD}/here/{when}", whole.drawn(when, shown.factor)
        arrows = rr.Arrows3D.columns(origins=whole.wanted, vectors=places - whole.wanted)
        recording.send_columns(entity, at, arrows)
        recording.log(entity, rr.Arrows3D.from_fields(colors=colour, radii=0.012 * shown.side_m), static=True)
        labels = [f"{when} {_mm(error)} mm" for error in errors]
        recording.send_columns(f"{entity}/mm", at, rr.Points3D.columns(positions=places + beside, labels=labels))
        tag = rr.Points3D.from_fields(colors=colour, radii=0.0005, show_labels=True)
        recording.log(f"{entity}/mm", tag, static=True)


def _errors(recording: rr.RecordingStream, shown: LoopScene) -> None:
    """Errors step by step: a line each for circle and line, marks for the poses."""
    for name, course in shown.courses.items():
        for when, errors, colour in (
            ("before", course.error_before, RGB_BEFORE),
            ("after", course.error_after, RGB_AFTER),
        ):
            entity, label = f"error_mm/{when}/{name}", f"{name} {when}, mm"
            recording.send_columns(entity, _at(course), rr.Scalars.columns(scalars=1e3 * errors))
            if name == "poses":
                marks = rr.SeriesPoints(colors=colour, names=label, markers="circle", marker_sizes=4)
                recording.log(entity, marks, static=True)
            else:
                recording.log(entity, rr.SeriesLines(colors=colour, names=label, widths=2), static=True)


def _mm(metres: float) -> str:
    """To ten micrometres, what is small to a tenth of one."""
    return f"{1e3 * metres:.2f}" if metres >= 1e-4 else f"{1e3 * metres:.4f}"


def _summary(outcome: lab.CalibrationResult, loop: ClosedLoop, shown: LoopScene) -> str:
    """How far off everything was, before and after, and what the picture magnifies, in markdown."""
    before, after = (float(errors.mean()) for errors in (shown.whole.error_before, shown.whole.error_after))
    legend = [
        "## What is shown",
        "- **arm**: at the corrected joint values",
        "- **white**: what was commanded: circle, line from P2 to P3, the cube's poses P1 to P5",
        f"- **red**: attained before, with nominal joint values; deviations {format_magnification(shown.factor)}",
        f"- **green**: attained after, with corrected ones; deviations {format_magnification(shown.factor)} beside "
        f"the arm, "
        f"{format_magnification(shown.factor_close)} by itself",
    ]
    parts = [f"# {outcome.robot.name}: {_mm(before)} → {_mm(after)} mm on corrected targets", _course_table(loop)]
    if shown.names:
        meaning = (
            f"AP, accuracy: from the commanded place to the mean of {len(loop.poses.before)} cycles; "
            "RP, repeatability: mean and three σ of the distances from that mean."
        )
        parts += [_pose_table(loop, shown.names), meaning]
    return "\n\n".join([*parts, "\n".join(legend)]) + "\n"


def _course_table(loop: ClosedLoop) -> str:
    """Errors of all courses, and how many targets were not reached."""
    lines = ["| error, mm | before mean | before max | after mean | after max | not reached |", "|:--|" + "--:|" * 5]
    for name, course in (
        ("circle", loop.circle),
        ("line", loop.line),
        (f"P1 to P5, {len(loop.poses.before)} cycles", loop.poses),
        ("all over the workspace", loop.targets),
    ):
        cells = ["–"] * 4
        if len(course.wanted):
            cells = [_mm(part) for errors in course.errors for part in (errors.mean(), errors.max())]
        cells.append(f"{course.failed:,} of {course.failed + len(course.wanted):,}")
        lines.append(f"| **{name}** | {' | '.join(cells)} |")
    return "\n".join(lines)


def _pose_table(loop: ClosedLoop, names: tuple[str, ...]) -> str:
    """Accuracy (AP) and repeatability (RP) of the cube's poses."""
    course = loop.poses
    lines = [f"| ISO 9283, mm | {' | '.join(names)} |", "|:--|" + "--:|" * len(names)]
    for what, found in (
        ("AP before", accuracy(course.before, course.wanted)),
        ("AP after", accuracy(course.after, course.wanted)),
        ("RP after", repeatability(course.after)),
    ):
        lines.append(f"| **{what}** | {' | '.join(map(_mm, found))} |")
    return "\n".join(lines)


def _blueprint(shown: LoopScene) -> rrb.Blueprint:
    """Arm and courses large, what is left after beside it, text and errors at hand."""
    middle, side = shown.edges.mean(axis=(0, 1)), shown.side_m
    outward = (middle - shown.origins[0, 0]) * np.array([1.0, 1.0, 0.0])
    look = shown.normal - 0.4 * outward / np.linalg.norm(outward) + np.array([0.0, 0.0, 0.25])
    target = middle - 0.35 * outward - np.array([0.0, 0.0, 0.1 * side])
    main = rrb.EyeControls3D(
        kind=rrb.Eye3DKind.Orbital,
        position=target + 2.2 * side * look / np.linalg.norm(look),
        look_target=target,
        eye_up=(0.0, 0.0, 1.0),
    )
    close = rrb.Spatial3DView(
        origin=CLOSE,
        name=f"What is left after, {format_magnification(shown.factor_close)}",
        contents=f"/{CLOSE}/**",
        line_grid=False,
        eye_controls=rrb.EyeControls3D(
            kind=rrb.Eye3DKind.Orbital,
            position=middle + 1.3 * side * shown.normal,
            look_target=middle,
            eye_up=(0.0, 0.0, 1.0),
        ),
        background=backdrop(),
    )
    plots = rrb.Horizontal(*(_plot(when, shown) for when in _COLOURS))
    left = rrb.Vertical(main_view("Commanded and attained", main), plots, row_shares=[3, 1])
    text = rrb.TextDocumentView(origin=SUMMARY, name="Summary")
    return layout(left, rrb.Vertical(close, text, row_shares=[1, 1.35]), TIMELINE)


def _plot(when: str, shown: LoopScene) -> rrb.TimeSeriesView:
    largest = float((shown.whole.error_before if when == "before" else shown.whole.error_after).max())
    return rrb.TimeSeriesView(
        origin=f"error_mm/{when}",
        name=f"Error {when}, mm: circle, line, P1 to P5",
        axis_x=rrb.TimeAxis(
            view_range=rr.TimeRange(
                start=rr.TimeRangeBoundary.absolute(seq=0),
                end=rr.TimeRangeBoundary.absolute(seq=int(shown.whole.steps[-1]) + HOLD),
            )
        ),
        axis_y=rrb.ScalarAxis(range=(0.0, 1.08e3 * largest)),
        plot_legend=rrb.PlotLegend(visible=False),
    )
