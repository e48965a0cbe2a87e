"""Plans keep their clearances: distances by the tests' own code, a millimetre of the arm's path at a time.

The dense check lists the pairs of shapes itself, draws the balls and nests of the targets itself, and measures with
``mj_geomDistance``. What a pair is to keep follows from the request: 20 mm, an obstacle's own clearance, or what the
arm itself has where it stands at home and at zero.
"""

from itertools import pairwise
from pathlib import Path

import mujoco
import numpy as np
import pytest
from helpers.cells import CELL, PLACES
from helpers.dense_check import DenseCheck

from lab.campaign.options import DesignOptions
from lab.campaign.robot import Robot, load_virtual
from lab.commands.design.run import planned_day
from lab.core.se3 import Array

ROBOTS = {"irb120": 27, "tx40": 27, "rx130": 27, "scara": 18, "scemi": 27, "ur5": 27, "ur10": 27, "panda": 32,
          "scorbot": 24, "versatran": 27}  # fmt: skip
PLANS = 100  # of each robot
POST_KEEPS_M = 0.035  # its own clearance
KEPT_M = 0.020
ROUNDING_M = 2e-5  # of a distance between convex shapes


def with_balls(robot: Robot, target: str, radius: float) -> Robot:
    """The robot with a ball and a nest at a target, and nothing else that the lab's planning adds."""
    from dataclasses import replace

    spec = robot.model.spec.copy()
    site = robot.model.model.site(target)
    held = spec.site(target).parent.add_body(name="ball", pos=site.pos, quat=site.quat)
    held.add_geom(name="ball", type=mujoco.mjtGeom.mjGEOM_SPHERE, size=[radius, 0, 0], mass=0)
    held.add_geom(
        name="nest", type=mujoco.mjtGeom.mjGEOM_CYLINDER, size=[radius, 2 / 3 * radius, 0],
        pos=[0, 0, -2 / 3 * radius], mass=0,
    )  # fmt: skip
    return replace(robot, model=replace(robot.model, spec=spec, model=spec.compile()))


class PlanCheck(DenseCheck):
    """The moves of an arm with balls at its targets, against what each pair of shapes is to keep."""

    def __init__(self, robot: Robot, target: str, radius: float) -> None:
        super().__init__(with_balls(robot, target, radius).model)
        m, d = self.model, self.data
        least = np.full(len(self.pairs), np.inf)
        for joints in (robot.chain.home, np.zeros(robot.chain.size)):
            d.qpos[:] = self.robot.qpos(joints[None])[0]
            mujoco.mj_kinematics(m, d)
            apart = [mujoco.mj_geomDistance(m, d, a, b, 0.1, None) for a, b in self.pairs.tolist()]
            least = np.minimum(least, apart)
        self.clearance = np.array([self.to_keep(*pair, own) for pair, own in zip(self.pairs, least, strict=True)])

    def to_keep(self, a: int, b: int, own: float) -> float:
        m = self.model
        welds = [int(m.body_weldid[m.geom_bodyid[each]]) for each in (a, b)]
        still = [each for each, weld in zip((a, b), welds, strict=True) if weld == 0]
        first = 0 in welds and int(m.body_weldid[m.body_parentid[max(welds)]]) == 0
        if still and m.body(m.geom_bodyid[still[0]]).name != self.robot.base_body:
            if m.geom(still[0]).name == "post":
                return POST_KEEPS_M
            return min(KEPT_M, max(own, 0.0)) if first else KEPT_M
        return 0.0 if first else min(KEPT_M, max(own, 0.0))


def planned(name: str, folder: Path, seed: int) -> tuple[Robot, Array]:
    """A robot, in a cell where there is one for it, and the stops of a plan."""
    path = None
    if name in PLACES:
        path = folder / "cell.toml"
        text = (
            CELL.format(20, *PLACES[name]).replace("clearance_mm = 20\n", "") + f"clearance_mm = {1e3 * POST_KEEPS_M}\n"
        )
        path.write_text(text)
    robot = load_virtual(name, path)
    poses = -(-ROBOTS[name] // 3) + 2
    plan = planned_day(
        DesignOptions(
            name, path, poses=poses, candidates=200 if name in ("ur10", "panda") else 60, starts=1, seed=seed
        ),
        robot,
    )
    return robot, plan.tour.stops


def check(name: str, folder: Path, plans: int) -> None:
    dense, nearest = None, np.inf
    for seed in range(plans):
        robot, stops = planned(name, folder, seed)
        dense = dense or PlanCheck(robot, "p1", 0.00635)
        for start, end in pairwise(stops):
            found = dense.closest(start, end)
            nearest = min(nearest, found.kept_m)
            assert found.kept_m > -ROUNDING_M, (name, seed, found)
    print(f"{name}: {plans} plans, nearest {1e3 * nearest:.3f} mm beyond the clearance")


@pytest.mark.thorough
@pytest.mark.parametrize("name", ["irb120", "scara"])
def test_a_plan_keeps_its_clearances(name: str, tmp_path: Path) -> None:
    check(name, tmp_path, 1)


@pytest.mark.slow
@pytest.mark.parametrize("name", ROBOTS)
def test_a_thousand_plans_keep_their_clearances(name: str, tmp_path: Path) -> None:
    check(name, tmp_path, PLANS)
