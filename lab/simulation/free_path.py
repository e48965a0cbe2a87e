"""Whether a straight way in joint space touches nothing."""

import copy
from collections import deque
from collections.abc import Callable

import mujoco
import numpy as np

from lab.core.se3 import Array
from lab.simulation.collisions import at_contacts
from lab.simulation.model import RobotModel

__all__ = ["path_check", "path_step"]

_STEP_M = 0.001  # along a path no point of the arm moves further than this between two places
_ESTIMATED_STEP_M = 0.010  # of a mechanism, whose points' travel is estimated, and each place is looked at
_CLEAR_M = 0.040  # shapes that are farther apart than that and their clearance are not measured
_SLACK_M = 1e-4  # of a computed distance
_STILL_M = 1e-12  # two shapes that move less against each other stay as they are
_GOLDEN = (np.sqrt(5) - 1) / 2


def path_check(robot: RobotModel) -> Callable[[Array, Array], bool]:
    """A callable: whether the arm touches nothing while all joints move in proportion from ``(n,)`` to ``(n,)``.

    It touches nothing at places so dense that no point of it moves more than ``path_step`` in between. By one thread.
    """
    return _Serial(robot) if robot.travel_is_bounded else _PlaceByPlace(robot)


def path_step(robot: RobotModel) -> float:
    """How far (m) a point of the arm moves at most between two places of a path that are checked."""
    return _STEP_M if robot.travel_is_bounded else _ESTIMATED_STEP_M


class _PlaceByPlace:
    """Checks of paths at evenly spaced places, for robots whose points' travel is only estimated."""

    def __init__(self, robot: RobotModel) -> None:
        self.robot, self.data, self.reach = robot, mujoco.MjData(robot.model), robot.travel_per_joint()

    def __call__(self, start: Array, end: Array) -> bool:
        """Whether nothing is touched from one to the other of two joint positions ``(joints,)``."""
        steps = max(1, int(np.ceil(np.abs(end - start) @ self.reach / path_step(self.robot))))
        qpos = self.robot.qpos(start + np.linspace(0.0, 1.0, steps + 1)[:, None] * (end - start))
        if np.isnan(qpos).any():
            return False
        spread = np.argsort(np.arange(len(qpos)) * _GOLDEN % 1.0)  # so that an obstacle is met early
        return not any(data.ncon for data in at_contacts(self.robot.model, qpos[spread], self.data))


class _Serial:
    """Checks of the paths of a serial arm, with few looks where there is room.

    A look at one place measures how much further apart than needed shapes are there. Until a pair has moved that far
    against each other, it stays clear: only joints between its two bodies move them, none by more than their reach
    says. Where there is hardly room, the next look is as far away as lets the pair move a step.
    """

    def __init__(self, robot: RobotModel) -> None:
        self.robot, self.model, self.data = robot, robot.model, mujoco.MjData(robot.model)
        self.widened = copy.deepcopy(robot.model)  # its shapes meet ``_CLEAR_M`` before those of the model do
        self.widened.pair_margin[:] += _CLEAR_M + _SLACK_M
        self.widened.geom_margin[:] += (_CLEAR_M + _SLACK_M) / 2  # of two shapes, MuJoCo adds the margins
        self.widened.body_margin[:] += (_CLEAR_M + _SLACK_M) / 2
        self.reach, self.step = robot.travel_per_joint(), path_step(robot)
        moved = [int(self.model.joint(name).bodyid[0]) for name in robot.chain.joint_names]
        carried = np.zeros((self.model.nbody, len(moved)), dtype=bool)  # whether a joint moves a body
        for body in range(1, self.model.nbody):  # MuJoCo numbers parents before children
            carried[body] = carried[self.model.body_parentid[body]] | (np.array(moved) == body)
        self.relative = (carried[:, None] ^ carried).astype(float)  # 1 where a joint moves two bodies apart

    def __call__(self, start: Array, end: Array) -> bool:
        """Whether nothing is touched from one to the other of two joint positions ``(joints,)``."""
        travel = np.abs(end - start) * self.reach
        total, ends = float(travel.sum()), self.robot.qpos(np.stack([start, end]))
        if any(data.ncon for data in at_contacts(self.model, ends, self.data)):
            return False
        count = int(np.ceil(total / (2 * _CLEAR_M)))
        edges = np.linspace(0.0, 1.0, count + 1)
        # evenly spread from the first look on, so that an obstacle is met early
        order = np.argsort(np.arange(count) * _GOLDEN % 1.0).tolist()
        stretches = deque((float(edges[i]), float(edges[i + 1])) for i in order)
        while stretches:
            begin, end_share = stretches.popleft()
            middle, half = (begin + end_share) / 2, (end_share - begin) / 2
            clear = self._clear_share(ends[0] + middle * (ends[1] - ends[0]), travel, total)
            if clear < 0:
                return False
            if clear < half:
                stretches.extend([(begin, middle - clear), (middle + clear, end_share)])
        return True

    def _clear_share(self, qpos: Array, travel: Array, total: float) -> float:
        """What share of the path on either side of coordinates ``(nq,)`` is clear; below zero if these are not.

        Args:
            travel: ``(joints,)`` how far (m) a point moves at most by each joint on all of the path; ``total`` by all.
        """
        data = self.data
        data.qpos[:] = qpos
        mujoco.mj_kinematics(self.widened, data)
        mujoco.mj_collision(self.widened, data)
        if not data.ncon:
            return _CLEAR_M / total
        contact = data.contact
        room = contact.dist - contact.includemargin + (_CLEAR_M + _SLACK_M)
        if room.min() < 0:
            return -1.0
        pairs = self.model.geom_bodyid[contact.geom]
        moving = self.relative[pairs[:, 0], pairs[:, 1]] @ travel + _STILL_M
        return min(float((np.maximum(room - _SLACK_M, self.step / 2) / moving).min()), _CLEAR_M / total)
