"""Poses of a recording in time: two a second, with the arm moving from each to the next as its joints do."""

import numpy as np
import rerun as rr
from numpy.typing import NDArray

from lab.core.se3 import Array
from lab.kinematics.model import RigidArm
from lab.render.rerun_primitives import Times, draw_moving, draw_moving_legs
from lab.render.scene import world_legs
from lab.simulation.meshes import body_poses, shells
from lab.simulation.model import RobotModel

__all__ = ["TIME", "draw_moves", "moves_between", "pose_times"]

TIME = "time"
_POSES_PER_SECOND = 2.0
_MOVING = 0.6  # of the time from pose to pose; the arm stands at each for the rest
_STEPS = 9  # drawn on the way to the next pose


def pose_times(numbers: NDArray[np.int_], poses: str = "pose") -> Times:
    """When poses ``numbers`` ``(m,)`` are shown: by their number on a timeline, and in seconds on ``time``."""
    return [
        rr.TimeColumn(poses, sequence=numbers),
        rr.TimeColumn(TIME, duration=np.asarray(numbers) / _POSES_PER_SECOND),
    ]


def moves_between(arm: RigidArm, numbers: NDArray[np.int_], joints: Array) -> tuple[Array, Array]:
    """Where the arm is on its way: all joints start and stop together, by a law of degree five without jerks.

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
) -> None:
    """Bodies and legs on their way between poses ``joints`` ``(m, joints)``; at the poses they are drawn already."""
    seconds, between = moves_between(arm, numbers, joints)
    if not len(seconds):
        return
    at: Times = [rr.TimeColumn(TIME, duration=seconds)]
    seen = {shell.body for shell in shells(model)}
    bodies = body_poses(model, arm, values, between)
    still = body_poses(model, arm, values, joints)  # what stands at all poses was drawn once
    moving = {name: Ts for name, Ts in bodies.items() if name in seen and np.ptp(still[name], axis=0).max() > 0}
    draw_moving(recording, at, moving)
    draw_moving_legs(recording, at, world_legs(model.T_world_frame0, arm, values, between))
