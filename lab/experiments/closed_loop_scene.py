"""What a recording shows of corrected targets that were run, as arrays in the world (m): the courses, step by step."""

from dataclasses import dataclass
from itertools import product

import numpy as np
from numpy.typing import NDArray

from lab.commands.calibrate.result import CalibrationResult
from lab.commands.calibrate.scene import world_of
from lab.compensation.iso9283 import cube_positions
from lab.core.errors import LabError
from lab.core.se3 import Array
from lab.experiments.closed_loop import ClosedLoop, Cube, VisitedPath, compensator_of
from lab.render.scene import LARGEST_FACTOR, magnification, moved
from lab.render.skeleton import skeleton
from lab.simulation.meshes import Shell, body_poses, shells

__all__ = ["HOLD", "LoopScene", "ShownCourse", "loop_scene"]

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


def loop_scene(outcome: CalibrationResult, loop: ClosedLoop) -> LoopScene:
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


def _in_world(outcome: CalibrationResult, cube: Cube, offsets: Array) -> Array:
    """Places ``(n, 3)`` m from the cube's centre, in the world."""
    return moved(world_of(outcome), cube.poses(offsets, compensator_of(outcome).nominal).positions)
