"""Cast rays in a robot's cell: which points are hidden from a camera by the arm or its surroundings."""

import mujoco
import numpy as np
from numpy.typing import NDArray

from lab.core.se3 import Array
from lab.simulation.collisions import kinematics_at
from lab.simulation.robot_model import TRACKER, RobotModel

__all__ = ["unhidden"]

_BEFORE_M = 0.005  # of a point's distance: what is met nearer to it belongs to what carries it


def unhidden(robot: RobotModel, joints: Array, origins: Array, points: Array) -> NDArray[np.bool_]:
    """Return ``(n, c)``: whether nothing of the arm or its cell is between a camera and each point.

    The stand of a tracker stops no ray.

    Args:
        joints: ``(n, joints)`` rad or m.
        origins: ``(n, 3)`` m, of the cameras, in the world of the MuJoCo model.
        points: ``(n, c, 3)`` m, there; NaN is hidden.
    """
    model, data = robot.model, mujoco.MjData(robot.model)
    stand = int(model.site(TRACKER).bodyid[0]) or -1
    free: NDArray[np.bool_] = np.asarray(np.isfinite(points).all(axis=2))
    lines = np.where(free[..., None], points - origins[:, None], 0.0)
    far = np.linalg.norm(lines, axis=2)
    for row, there in enumerate(kinematics_at(robot, joints, data)):
        which = np.flatnonzero(free[row])
        if not len(which):
            continue
        count, longest = len(which), float(far[row].max())
        directions = (lines[row, which] / far[row, which, None]).ravel()
        met, distance = np.empty(count, dtype=np.int32), np.empty(count)
        mujoco.mj_multiRay(
            model, there, origins[row], directions, None, True, stand, met, distance, None, count, longest
        )
        free[row, which] = (distance < 0) | (distance > far[row, which] - _BEFORE_M)
    return free
