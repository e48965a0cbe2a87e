"""Corrected targets as a rerun recording: the arm on its way through them, and what the correction spares it."""

import hashlib
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from lab.commands.compensate.result import CompensationResult
from lab.core.se3 import Array
from lab.render.error_recording import ErrorScene, PointErrors, record_errors
from lab.render.scene import drawn_rows
from lab.render.style import RGB_BEFORE

__all__ = ["record_compensation"]


def record_compensation(path: Path, result: CompensationResult) -> None:
    """Write the recording of ``lab compensate``: the stops in their order; of many an evenly spaced part.

    Only targets that are reached are among the stops; there has to be one.
    """
    run, rows = result.run, result.reached
    waypoints = drawn_rows(len(result.waypoints.joints))
    every = result.waypoints.names
    joints, names = result.waypoints.joints[waypoints], [every[i] for i in waypoints]
    which = result.waypoints.which[waypoints]
    at_target = np.flatnonzero(which >= 0)
    aimed = rows[which[at_target]]
    wanted, found = result.wanted.positions[aimed], result.found
    conditions = result.arm_inputs[:, joints.shape[1] :]
    uncorrected = np.concatenate([found.uncorrected, conditions], axis=1)[aimed]
    before = run.estimate.arm.points(uncorrected, run.estimate.values)
    before = before[np.arange(len(aimed)), result.target if result.points is None else result.points[aimed]]
    rigid, values = run.estimate.geometry
    scene = ErrorScene(
        run.robot.model,
        rigid,
        values,
        joints,
        names,
        _at_waypoints(wanted, at_target, len(waypoints))[:, None],
        "the targets, wanted",
        [
            PointErrors(
                "uncorrected",
                "from the target to the arm's position with the nominal joint positions",
                RGB_BEFORE,
                "vermilion",
                _at_waypoints(before - wanted, at_target, len(waypoints))[:, None],
            ),
        ],
        _at_waypoints(result.predicted_m[aimed], at_target, len(waypoints)),
    )
    digest = hashlib.sha256(run.robot.sha256.encode() + joints.tobytes() + wanted.tobytes() + values.tobytes())
    record_errors(path, run.robot.name, digest.hexdigest()[:32], scene, result.document())


def _at_waypoints(values: Array, at_target: NDArray[np.int_], count: int) -> Array:
    """Values ``(t, …)`` of targets at their stops ``(count, …)``; NaN at those that are only passed."""
    spread = np.full((count, *values.shape[1:]), np.nan)
    spread[at_target] = values
    return spread
