"""Whether moves are free, by code of the tests' own: distances of pairs of shapes, looked at ten times as densely.

The lab looks every 10 mm of the arm's way whether MuJoCo's collision pipeline reports contacts. Here the pairs of
shapes are listed from the model, their signed distances come from ``mj_geomDistance``, and the next look is at most
1 mm of the arm's way behind the last one, or as far as no pair could close in between.
"""

from dataclasses import dataclass

import mujoco
import numpy as np

from lab.core.se3 import Array
from lab.simulation.robot_model import RobotModel

LOOK_M = 0.001
FAR_M = 0.03  # between bounding spheres: shapes that are farther apart are not measured


@dataclass(frozen=True)
class Closest:
    """The smallest distance on a move (m), less the clearance that the pair is to keep, and without it.

    Of a move on which something touches, that of the first look at it.
    """

    kept_m: float
    apart_m: float
    pair: tuple[str, str]


class DenseCheck:
    """The moves of a robot's arm."""

    def __init__(self, robot: RobotModel) -> None:
        self.robot, self.model, self.data = robot, robot.model, mujoco.MjData(robot.model)
        self.pairs = self._listed()
        self.clearance = np.array([max(self.model.geom_margin[pair]) for pair in self.pairs])
        self.reach = self._reach()

    def _listed(self) -> Array:
        """Pairs of shapes that are not to touch, by MuJoCo's rules: of bodies that move against each other."""
        m = self.model
        weld, parent = m.body_weldid, m.body_parentid
        excluded = {(int(each) >> 16, int(each) & 0xFFFF) for each in m.exclude_signature}
        found = []
        for a in range(m.ngeom):
            for b in range(a + 1, m.ngeom):
                one, two = int(m.geom_bodyid[a]), int(m.geom_bodyid[b])
                welded = weld[one], weld[two]
                if not (m.geom_contype[a] & m.geom_conaffinity[b] or m.geom_contype[b] & m.geom_conaffinity[a]):
                    continue
                near = weld[parent[welded[0]]] == welded[1] or weld[parent[welded[1]]] == welded[0]
                if welded[0] == welded[1] or (near and 0 not in welded):
                    continue
                if excluded & {(one, two), (two, one)}:
                    continue
                found.append((a, b))
        return np.array(found).reshape(-1, 2)

    def _reach(self) -> Array:
        """``(pairs, joints)``: how far (m) a shape of a pair moves against the other one at most per rad or m."""
        m, joints = self.model, [self._body_of(i) for i in range(self.robot.chain.size)]
        found = np.zeros((len(self.pairs), len(joints)))
        for i, pair in enumerate(self.pairs.tolist()):
            bodies = [self._way_up(int(m.geom_bodyid[each])) for each in pair]
            for j, body in enumerate(joints):
                if (body in bodies[0]) == (body in bodies[1]):
                    continue  # it moves both, or neither
                geom, way = (pair[0], bodies[0]) if body in bodies[0] else (pair[1], bodies[1])
                between = way[: way.index(body)]
                length = np.linalg.norm(m.body_pos[between], axis=1).sum() + np.linalg.norm(m.geom_pos[geom])
                axis = np.linalg.norm(m.jnt_pos[m.body_jntadr[body]])
                far = length + axis + m.geom_rbound[geom]
                found[i, j] = 1.0 if self.robot.chain.prismatic[j] else far
        return found

    def _body_of(self, joint: int) -> int:
        """The body that a joint moves: the one whose place changes first with it."""
        m, d = self.model, self.data
        moved = []
        for value in (0.1, 0.2):
            row = np.zeros((1, self.robot.chain.size))
            row[0, joint] = value
            d.qpos[:] = self.robot.qpos(row)[0]
            mujoco.mj_kinematics(m, d)
            moved.append(np.concatenate([d.xpos, d.xmat], axis=1))
        return int(np.flatnonzero(np.abs(moved[1] - moved[0]).max(axis=1) > 1e-9)[0])

    def _way_up(self, body: int) -> list[int]:
        """A body and those that carry it, up to the world."""
        found = [body]
        while found[-1]:
            found.append(int(self.model.body_parentid[found[-1]]))
        return found

    def closest(self, start: Array, end: Array) -> Closest:
        """Of a straight line of all joints: the nearest that any pair comes to its clearance.

        Each pair is looked at again as soon as it could have closed, and after 1 mm of its way at the earliest.
        """
        m, d = self.model, self.data
        ways = np.maximum(self.reach @ np.abs(end - start), 1e-9)
        due, best = np.zeros(len(self.pairs)), Closest(np.inf, np.inf, ("", ""))
        while (share := float(due.min())) <= 1.0:
            d.qpos[:] = self.robot.qpos((start + share * (end - start))[None])[0]
            mujoco.mj_kinematics(m, d)
            rows = np.flatnonzero(due <= share + 1e-12)
            at = d.geom_xpos[self.pairs[rows]]
            spheres = m.geom_rbound[self.pairs[rows]]
            gaps = np.linalg.norm(at[:, 0] - at[:, 1], axis=1) - spheres.sum(axis=1) - self.clearance[rows]
            gaps[(spheres == 0).any(axis=1)] = -np.inf  # a plane has no bounding sphere
            for row, gap in zip(rows.tolist(), gaps.tolist(), strict=True):
                kept = gap
                if gap < FAR_M:
                    a, b = self.pairs[row].tolist()
                    apart = mujoco.mj_geomDistance(m, d, a, b, 1.0, None)
                    kept = apart - float(self.clearance[row])
                    if kept < best.kept_m:
                        first, second = (m.geom(each).name or m.body(m.geom_bodyid[each]).name for each in (a, b))
                        best = Closest(kept, apart, (first, second))
                due[row] = share + max(LOOK_M, kept) / ways[row]
            if best.apart_m < 0:
                break  # it touches: how deep does not matter
        return best
