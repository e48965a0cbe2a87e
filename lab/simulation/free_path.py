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
_CLEAR_M = 0.025  # where nothing is nearer, the places until a point has moved that far are free too
_SLACK_M = 1e-4  # of a computed distance
_GOLDEN = (np.sqrt(5) - 1) / 2


def path_check(robot: RobotModel) -> Callable[[Array, Array], bool]:
    """A callable: whether the arm touches nothing while all joints move in proportion from ``(n,)`` to ``(n,)``.

    It touches nothing at places so dense that no point of it moves more than ``path_step`` in between. By one thread.
    """
    clear, step = _Clear(robot), path_step(robot)
    reach = robot.travel_per_joint()

    def is_free(start: Array, end: Array) -> bool:
        travel = float(np.abs(end - start) @ reach)
        steps = max(1, int(np.ceil(travel / step)))
        qpos = robot.qpos(start + np.linspace(0.0, 1.0, steps + 1)[:, None] * (end - start))
        return not np.isnan(qpos).any() and clear(qpos, travel / steps)

    return is_free


def path_step(robot: RobotModel) -> float:
    """How far (m) a point of the arm moves at most between two places of a path that are checked."""
    return _STEP_M if robot.travel_is_bounded else _ESTIMATED_STEP_M


class _Clear:
    """Whether a robot touches nothing at any of the places along a way.

    A look for anything within a margin, at the middle of a stretch, tells of all its places where no point moves
    further than the margin until its ends. A stretch where something is as near is looked at by halves.
    """

    def __init__(self, robot: RobotModel) -> None:
        self.model, self.data = robot.model, mujoco.MjData(robot.model)
        self.widened = copy.deepcopy(robot.model)  # its shapes meet as soon as they are within a margin
        self.clear_m = _CLEAR_M if robot.travel_is_bounded else 0.0

    def __call__(self, qpos: Array, step_m: float) -> bool:
        """Whether it is so at coordinates ``(n, nq)``; from one to the next no point moves further than a step."""
        width = 1 + 2 * int(self.clear_m / max(step_m, 1e-9))
        begins = np.arange(0, len(qpos), width)
        # evenly spread from the first look on, so that an obstacle is met early
        begins = begins[np.argsort(np.arange(len(begins)) * _GOLDEN % 1.0)]
        stretches = deque((begin, min(begin + width, len(qpos))) for begin in begins.tolist())
        while stretches:
            begin, end = stretches.popleft()
            middle = (begin + end - 1) // 2
            if end - begin > 1 and not self._near(qpos[middle], (end - 1 - middle) * step_m):
                continue
            if next(at_contacts(self.model, qpos[middle : middle + 1], self.data)).ncon:
                return False
            stretches.extend(part for part in ((begin, middle), (middle + 1, end)) if part[0] < part[1])
        return True

    def _near(self, qpos: Array, distance_m: float) -> bool:
        """Whether two shapes that may meet are within their clearance and this distance at coordinates ``(nq,)``."""
        wide, exact, more = self.widened, self.model, distance_m + _SLACK_M
        wide.pair_margin[:] = exact.pair_margin + more
        wide.geom_margin[:] = exact.geom_margin + more / 2  # of two shapes, MuJoCo adds the margins
        wide.body_margin[:] = exact.body_margin + more / 2
        return bool(next(at_contacts(self.widened, qpos[None], self.data)).ncon)
