"""Plans keep their clearances: distances by the tests' own code, a millimetre of the arm's path at a time.

The dense check lists the pairs of shapes itself, draws the balls and nests of the targets itself, and measures with
``mj_geomDistance``. What a pair is to keep follows from the request: 20 mm, an obstacle's own clearance, or what the
arm itself has where it stands at home and at zero.
"""

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import mujoco
import numpy as np
import pytest
from helpers.cells import CELL, PLACES
from helpers.dense_check import DenseCheck

from lab.core.errors import LabError
from lab.core.se3 import Array
from lab.library.design import design
from lab.noise.instruments import INSTRUMENTS
from lab.options.virtual_campaign import DesignOptions
from lab.robots.load_robot import load_virtual
from lab.robots.robot import Robot
from lab.simulation.collisions import collides, describe_collisions
from lab.simulation.free_path import Clearances, path_check, planning_model
from lab.simulation.robot_model import RobotModel

POST_KEEPS_M = 0.035  # its own clearance
KEPT_M = 0.020
ROUNDING_M = 2e-5  # of a distance between convex shapes


def with_balls(robot: Robot, target: str, radius: float) -> Robot:
    """The robot with a ball and a nest at a target, and nothing else that the lab's planning adds."""
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


def planned(name: str, folder: Path, poses: int) -> tuple[Robot, Array]:
    """A robot, in a cell where there is one for it, and the stops of a plan."""
    path = None
    if name in PLACES:
        path = folder / "cell.toml"
        text = (
            CELL.format(20, *PLACES[name]).replace("clearance_mm = 20\n", "") + f"clearance_mm = {1e3 * POST_KEEPS_M}\n"
        )
        path.write_text(text)
    robot = load_virtual(name, path)
    plan = design(DesignOptions(name, path, poses=poses, candidates=60, starts=1))
    return robot, plan.tour.waypoints


def words_at(model: RobotModel, degrees: Sequence[float]) -> str:
    return describe_collisions(model, np.deg2rad([degrees]))[0]


INTO_FLOOR = [0, 45, 53, -120, 11, 105]  # the ball at p1 is 4 mm deep in the floor, and no link touches it
IDEAL = INSTRUMENTS["uniform-8um"]


def test_a_reflector_is_not_planned_into_the_floor() -> None:
    robot = load_virtual("irb120").model
    site = robot.model.site("p1").id
    data = mujoco.MjData(robot.model)
    data.qpos[:] = robot.qpos(np.deg2rad([INTO_FLOOR]))[0]
    mujoco.mj_kinematics(robot.model, data)
    assert 0 < data.site_xpos[site][2] < 0.00635
    assert not collides(robot, np.deg2rad([INTO_FLOOR]))[0]
    solid = planning_model(robot, ("p1",), IDEAL, Clearances(0.0, 0.0))
    assert words_at(solid, INTO_FLOOR).startswith("reflector at p1 is ")
    assert "deep in floor" in words_at(solid, INTO_FLOOR)


def test_an_obstacle_comes_before_the_cell_and_the_cell_before_the_flag(tmp_path: Path) -> None:
    """A box is some 50 mm above the elbow, the arm at home."""
    box = '[[obstacle]]\nname = "box"\nshape = "box"\nsize_mm = [100, 100, 100]\nposition_mm = [0, 0, 790]\n'
    path = tmp_path / "cell.toml"

    def near(cell: str, obstacle: str, flag_mm: float) -> bool:
        path.write_text(cell + box + obstacle)
        robot = load_virtual("irb120", path)
        model = planning_model(robot.model, ("p1",), IDEAL, Clearances(flag_mm / 1e3, 0.0))
        words = words_at(model, [0] * 6)
        assert not words or "from box, nearer than the clearance" in words
        return bool(words)

    assert near("", "", 80.0) and not near("", "", 20.0)
    assert not near("clearance_mm = 20\n", "", 80.0)
    assert near("clearance_mm = 20\n", "clearance_mm = 80\n", 20.0)


def test_links_keep_no_more_than_they_have_at_home() -> None:
    """Of the Panda links 5 and 7 are 10.9 mm apart at zero: that pair keeps less than the others."""
    robot = load_virtual("panda").model
    model = planning_model(robot, ("p1",), IDEAL, Clearances()).model
    kept = np.unique(model.pair_margin.round(6))
    assert kept[-1] == pytest.approx(0.0205) and 0.010 < kept[0] < 0.012
    assert not collides(planning_model(robot, ("p1",), IDEAL, Clearances()), robot.chain.home[None])[0]


def test_a_clearance_below_zero_is_refused() -> None:
    with pytest.raises(LabError, match=r"--clearance-mm -1: give a distance"):
        DesignOptions(clearance_mm=-1).refuse_nonsense()


def test_path_checks_keep_the_clearance_between_looks() -> None:
    """Moves that a check of each end alone would allow: the first joint turns a link past the tracker's stand."""
    robot = load_virtual("irb120").model
    near, wide = (planning_model(robot, ("p1",), IDEAL, Clearances(c, 0.02)) for c in (0.0, 0.3))
    start, end = np.deg2rad([[-70, 60, -30, 0, 30, 0], [0, 60, -30, 0, 30, 0]])
    assert path_check(near)(start, end)
    assert path_check(wide)(start, end) == (not collides(wide, np.linspace(start, end, 400)).any())


@pytest.mark.thorough
@pytest.mark.parametrize(("name", "poses"), [("tx40", 11), ("scara", 8)])
def test_a_plan_keeps_its_clearances(name: str, poses: int, tmp_path: Path) -> None:
    robot, stops = planned(name, tmp_path, poses)
    dense = PlanCheck(robot, "p1", 0.00635)
    for start, end in pairwise(stops):
        found = dense.closest(start, end)
        assert found.kept_m > -ROUNDING_M, found
