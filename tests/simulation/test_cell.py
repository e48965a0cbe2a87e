"""A robot in its cell: obstacles and their clearance, what is carried, the robot's and the instrument's place."""

from itertools import pairwise
from pathlib import Path

import mujoco
import numpy as np
import pytest
from helpers.robots import IRB120

import lab
from lab.core import se3
from lab.core.errors import LabError
from lab.core.se3 import Array
from lab.formats.cell_toml import read_cell
from lab.formats.target_csv import Targets
from lab.robots.load_robot import load_robot
from lab.robots.robot import Robot
from lab.simulation.cell import in_cell
from lab.simulation.collisions import collides, colliding_pairs, describe_collisions
from lab.simulation.robot_model import last_frame

TABLE = """
clearance_mm = 20
[[obstacle]]
name = "table"
shape = "box"
size_mm = [300, 900, 250]
position_mm = [480, 0, 125]
"""
CELL = (
    TABLE
    + """
[[obstacle]]
name = "post"
shape = "cylinder"
radius_mm = 40
height_mm = 900
position_mm = [-250, 250, 450]
[[tool]]
name = "p1"
position_mm = [0, 40, 60]
axis = [0, 1, 1]
[[plate]]
name = "plate"
shape = "box"
size_mm = [80, 80, 10]
position_mm = [0, 0, 5]
[instrument]
position_mm = [2000, -1000, 1200]
[joints.q1]
cable_deg = 150
[joints.q6]
cable_deg = 180
"""
)


def placed(tmp_path: Path, text: str, robot: Robot = IRB120) -> Robot:
    path = tmp_path / "cell.toml"
    path.write_text(text)
    found = load_robot(robot, path)
    np.testing.assert_array_equal(found.chain.lower, in_cell(robot.model, read_cell(path)).chain.lower)
    return found


def nearest(robot: Robot, obstacle: str, joints: Array) -> Array:
    """``(n,)`` m from what moves to an obstacle, by MuJoCo's distances between all their shapes."""
    model, data = robot.model.model, mujoco.MjData(robot.model.model)
    solid = np.flatnonzero((model.geom_contype | model.geom_conaffinity) != 0)
    moving = [g for g in solid if model.body_weldid[model.geom_bodyid[g]] > 0]
    target = model.geom(obstacle).id
    found = []
    for q in joints:
        data.qpos[:] = q
        mujoco.mj_kinematics(model, data)
        found.append(min(mujoco.mj_geomDistance(model, data, g, target, 0.5, None) for g in moving))
    return np.array(found)


def test_an_arm_keeps_the_clearance_from_obstacles_and_from_nothing_else(tmp_path) -> None:
    robot = placed(tmp_path, TABLE)
    joints = IRB120.chain.random_joints(400, np.random.default_rng(0))
    alone, here, distance = (
        collides(IRB120.model, joints),
        collides(robot.model, joints),
        nearest(robot, "table", joints),
    )
    clear = np.abs(distance - 0.02) > 1e-4
    np.testing.assert_array_equal(here[clear], (alone | (distance < 0.02))[clear])
    assert (here & ~alone & (distance > 0.001)).any()  # only too near
    words = describe_collisions(robot.model, joints)
    assert any("mm from table, nearer than the clearance" in each for each in words)
    pairs = colliding_pairs(robot.model, joints)
    assert sum(count for (_, second), count in pairs.items() if second == "table") >= (distance < 0.0199).sum()


def test_where_the_robot_stands_moves_the_cell_about_it_and_turns_gravity(tmp_path) -> None:
    """A table that is moved with the robot is where it was; under a robot that lies on its side gravity is sideways."""
    here = placed(tmp_path, TABLE)
    T = se3.pose(se3.rotation_from_roll_pitch_yaw(np.deg2rad([0.0, 0.0, 90.0])), np.array([1.0, 2.0, 0.5]))
    centre = 1e3 * se3.transform(T, np.array([[0.48, 0.0, 0.125]]))[0]
    text = TABLE.replace("[480, 0, 125]", f"{centre.tolist()}\nrotation_deg = [0, 0, 90]")
    there = placed(tmp_path, f"{text}[robot]\nposition_mm = [1000, 2000, 500]\nrotation_deg = [0, 0, 90]\n")
    joints = IRB120.chain.random_joints(50, np.random.default_rng(1))
    np.testing.assert_allclose(nearest(there, "table", joints), nearest(here, "table", joints), atol=1e-9)
    hung = placed(tmp_path, "[robot]\nrotation_deg = [90, 0, 0]\n")
    np.testing.assert_allclose(hung.model.model.opt.gravity, [0, -9.81, 0], atol=1e-9)
    assert hung.loads is not None and IRB120.loads is not None
    np.testing.assert_allclose(np.linalg.norm(hung.loads.gravity), np.linalg.norm(IRB120.loads.gravity))
    assert np.abs(hung.loads.gravity - IRB120.loads.gravity).max() > 9


def test_tool_points_reflectors_and_the_instrument_are_where_the_cell_says(tmp_path) -> None:
    robot = placed(tmp_path, CELL)
    model, data = robot.model.model, mujoco.MjData(robot.model.model)
    mujoco.mj_kinematics(model, data)
    T_last = last_frame(robot.serial_model.chain, robot.T_world_frame0)
    np.testing.assert_allclose(data.site("p1").xpos, se3.transform(T_last, np.array([[0, 0.04, 0.06]]))[0], atol=1e-12)
    looks = data.site("p1").xmat.reshape(3, 3)[:, 2]
    np.testing.assert_allclose(looks, T_last[:3, :3] @ np.array([0, 1, 1]) / np.sqrt(2), atol=1e-12)
    assert set(robot.tool) == {"p1"} and "p2" not in {model.site(i).name for i in range(model.nsite)}
    np.testing.assert_allclose(robot.model.T_world_tracker[:3, 3], [2, -1, 1.2], atol=1e-12)
    arm = robot.arm(("p1",))
    np.testing.assert_allclose(arm.nominal(robot.tool)[-3:], [0, 0.04, 0.06])


def test_a_mesh_is_read_beside_the_file(tmp_path) -> None:
    corners = np.array([[x, y, z] for x in (0, 100) for y in (0, 100) for z in (0, 100)])
    faces = (
        "f 1 2 4\nf 1 4 3\nf 5 7 8\nf 5 8 6\nf 1 5 6\nf 1 6 2\nf 3 4 8\nf 3 8 7\nf 1 3 7\nf 1 7 5\nf 2 6 8\nf 2 8 4\n"
    )
    (tmp_path / "block.obj").write_text("".join(f"v {x} {y} {z}\n" for x, y, z in corners) + faces)
    mesh = '[[obstacle]]\nname = "block"\nshape = "mesh"\nfile = "block.obj"\nposition_mm = [400, 0, 0]\n'
    box = '[[obstacle]]\nname = "block"\nshape = "box"\nsize_mm = [100, 100, 100]\nposition_mm = [450, 50, 50]\n'
    joints = IRB120.chain.random_joints(60, np.random.default_rng(2))
    by_mesh, by_box = (nearest(placed(tmp_path, text), "block", joints) for text in (mesh, box))
    apart = by_box > 1e-3
    assert apart.any()
    np.testing.assert_allclose(by_mesh[apart], by_box[apart], atol=1e-4)
    with pytest.raises(LabError, match=r"no file of .stl or .obj"):
        placed(tmp_path, mesh.replace("block.obj", "block.step"))


def test_a_home_that_touches_something_is_refused_with_what(tmp_path) -> None:
    home = "".join(f"q{i}_deg = {v}\n" for i, v in enumerate((0, 60, 0, 0, 20, 0), start=1))
    with pytest.raises(LabError, match=r"\[home\]: \w+ is \d+ mm deep in table there; start elsewhere"):
        placed(tmp_path, f"{TABLE}[home]\n{home}")
    with pytest.raises(LabError, match=r"\[home\]: joint q6 is at 500"):
        placed(tmp_path, f"[home]\n{home.replace('q6_deg = 0', 'q6_deg = 500')}")


def looks(stops: Array, count: int) -> Array:
    """Joint positions on the straight ways between stops."""
    share = np.linspace(0, 1, count)[:, None]
    return np.concatenate([a + share * (b - a) for a, b in pairwise(stops)])


@pytest.mark.thorough
def test_a_plan_and_corrected_targets_keep_to_the_cell(tmp_path) -> None:
    """From the plan to the corrected targets: by distances at many points of each way, not by the lab's contacts."""
    robot = placed(tmp_path, CELL)
    path = tmp_path / "cell.toml"
    plan = lab.design("irb120", poses=12, candidates=150, starts=1, instrument="leica-at960", cell=path)
    stops = plan.tour.waypoints
    assert not robot.chain.beyond_limits(stops, 1e-9).any() and np.abs(stops[:, 0]).max() <= np.deg2rad(150)
    reflector = plan.to_dict()["reflector"]
    assert reflector["acceptance_deg"] == pytest.approx(30) and reflector["largest_deg"] <= 30
    arm = robot.arm(("p1",))
    between = looks(stops, 25)
    assert min(nearest(robot, name, between).min() for name in ("table", "post")) > 0.018

    run = lab.calibrate("irb120", seed=3, cell=path)
    Ts = arm.tool(plan.joints, np.array([each.exported for each in run.parameters]))[0]
    ids, anywhere = tuple(str(i) for i in range(12)), np.full((12, 6), np.nan)
    targets = Targets("p1", ids, Ts[:, :3, 3], Ts[:, :3, :3], anywhere)
    done = lab.compensate(targets, run=run)
    assert done.to_dict()["checked"] and len(done.reached) >= 10
    between = looks(done.waypoints.joints, 25)
    assert min(nearest(robot, name, between).min() for name in ("table", "post")) > 0.018
    unchecked = lab.compensate(targets, run=run, no_check=True)
    assert not unchecked.to_dict()["checked"] and any("--no-check" in words for words in unchecked.warnings)
    assert len(unchecked.waypoints.joints) == len(unchecked.reached)
