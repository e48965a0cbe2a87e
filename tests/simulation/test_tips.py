"""Tips and bases by name: which chain comes out, what is held, and files of identified robots with several tips."""

from pathlib import Path

import mujoco
import numpy as np
import pytest
from helpers.robots import ROOT

from lab.core import se3
from lab.core.errors import LabError
from lab.robots.load_robot import load_robot
from lab.simulation.load_model import load_model
from lab.simulation.robot_model import SerialModel, TreeModel

TORSO = ROOT / "models" / "torso" / "robot.xml"
HEAD = '<robot name="pair"><link name="world"/>'
AXES = ("0 0 1", "0 1 0", "0 1 0", "1 0 0", "0 1 0", "1 0 0")
STEPS = ("0 0 0.3", "0.05 0 0.1", "0 0 0.4", "0.1 0 0.05", "0.3 0 0", "0.08 0.01 0")


def urdf_arm(side: str, on: str, at: str) -> str:
    text, below = "", on
    for i, (axis, step) in enumerate(zip(AXES, STEPS, strict=True), start=1):
        name = f"{side}_link{i}"
        text += f'<link name="{name}"/><joint name="{side}{i}" type="revolute"><parent link="{below}"/>'
        text += f'<child link="{name}"/><origin xyz="{at if i == 1 else step}" rpy="0.02 -0.01 0.03"/>'
        text += f'<axis xyz="{axis}"/><limit lower="-2" upper="2" effort="1" velocity="1"/></joint>'
        below = name
    return text + (
        f'<link name="{side}_tool"/><joint name="{side}_fixed" type="fixed"><parent link="{below}"/>'
        f'<child link="{side}_tool"/><origin xyz="0.1 0 0" rpy="0 1.5708 0"/></joint>'
    )


WAIST = (
    '<link name="torso"/><joint name="waist" type="revolute"><parent link="world"/><child link="torso"/>'
    '<origin xyz="0 0 0.8"/><axis xyz="0 0 1"/><limit lower="-1" upper="1" effort="1" velocity="1"/></joint>'
)


def written(folder: Path, name: str, *parts: str) -> Path:
    path = folder / name
    path.write_text(HEAD + "".join(parts) + "</robot>", encoding="utf-8")
    return path


def test_a_tip_of_a_tree_is_the_arm_alone(tmp_path: Path) -> None:
    """An arm chosen from a URDF with two is, to the bit, that of a URDF that has no other."""
    left, right = urdf_arm("left", "torso", "0 0.2 0.3"), urdf_arm("right", "torso", "0 -0.2 0.3")
    both, alone = written(tmp_path, "arm.urdf", WAIST, left, right), tmp_path / "alone"
    alone.mkdir()
    tool0 = left.replace("left_tool", "tool0")
    one = load_model(written(alone, "arm.urdf", WAIST, tool0))
    chosen = load_model(both, ("left_tool",))
    assert isinstance(one, SerialModel) and isinstance(chosen, SerialModel)
    for name in ("joint_names", "prismatic", "parallel", "name"):
        assert getattr(one.chain, name) == getattr(chosen.chain, name)
    for name in ("table", "lower", "upper", "speed", "sign"):
        np.testing.assert_array_equal(getattr(one.chain, name), getattr(chosen.chain, name))
    np.testing.assert_array_equal(one.T_world_frame0, chosen.T_world_frame0)
    assert one.tool.keys() == chosen.tool.keys() == {"p1", "p2", "p3"}
    assert chosen.fixed_joints == tuple(f"right{i}" for i in range(1, 7))


def test_a_base_holds_the_joints_below_it(tmp_path: Path) -> None:
    both = written(
        tmp_path, "arm.urdf", WAIST, urdf_arm("left", "torso", "0 0.2 0.3"), urdf_arm("right", "torso", "0 -0.2 0.3")
    )
    held = load_model(both, ("left_tool", "right_tool"), "torso")
    assert isinstance(held, TreeModel) and held.fixed_joints == ("waist",)
    assert held.chain.roots == (0, 1)  # two robots, each with a base of its own
    free = load_model(both, ("left_tool", "right_tool"))
    assert isinstance(free, TreeModel) and free.chain.roots == (0, 0) and free.chain.size == 13
    assert list(free.tool) == [f"{side}_tool.{p}" for side in ("left", "right") for p in ("p1", "p2", "p3")]


@pytest.mark.parametrize(
    ("tips", "base", "says"),
    [
        (("nose",), "", "tip 'nose' is no body"),
        (("base",), "", "no joint moves tip 'base'"),
        (("left",), "hips", "base 'hips' is no body"),
        (("left",), "right_link1", "does not carry tip 'left'"),
    ],
)
def test_names_that_are_not_there(tips: tuple[str, ...], base: str, says: str) -> None:
    with pytest.raises(LabError, match=says):
        load_model(TORSO, tips, base)


def test_candidate_chains_are_named_as_tips(tmp_path: Path) -> None:
    both = written(
        tmp_path, "arm.urdf", urdf_arm("left", "world", "0 0.2 0.3"), urdf_arm("right", "world", "0 -0.2 0.3")
    )
    with pytest.raises(LabError, match=r"2 candidate chains .*tip left_link6.*tip right_link6"):
        load_model(both)


@pytest.mark.parametrize("name", ["torso", "rail"])
def test_an_identified_robot_is_written_whole(name: str, tmp_path: Path) -> None:
    """Its sites in the tracker's frame are the identified ones, and its file is a robot with the same tips."""
    robot = load_robot(name)
    targets = tuple(robot.tool)
    arm = robot.arm(targets)
    rng = np.random.default_rng(3)
    values = robot.model.values_before(arm, robot.model.T_world_tracker)
    values += 1e-3 * rng.standard_normal(len(values))
    path = tmp_path / "calibrated.xml"
    path.write_text(robot.description("calibrated.xml", targets, values), encoding="utf-8")
    again = load_robot(path)
    assert again.chain.joint_names == robot.chain.joint_names and again.tool.keys() == robot.tool.keys()
    joints = robot.chain.random_joints(5, rng)
    data = mujoco.MjData(again.model.model)
    T = se3.inverse(again.model.T_world_tracker)
    for row, expected in zip(again.model.qpos(joints), arm.points(joints, values), strict=True):
        data.qpos[:] = row
        mujoco.mj_kinematics(again.model.model, data)
        sites = np.array([data.site(target).xpos for target in targets])
        np.testing.assert_allclose(sites @ T[:3, :3].T + T[:3, 3], expected, atol=1e-12)


def test_the_bodies_of_a_true_robot_are_off_and_its_truth_is_found() -> None:
    from lab.library.virtual_arm import perturbed_arm, truth_of
    from lab.options.virtual_campaign import VirtualCampaign

    options = VirtualCampaign("torso", targets=("left.p1", "right.p1"), seed=4)
    robot = load_robot("torso")
    real, arm = perturbed_arm(robot, options), robot.arm(options.targets)
    truth = truth_of(real, arm)
    assert truth is not None
    joints = robot.chain.random_joints(50, np.random.default_rng(8))
    exact = real.points(joints, options.targets)
    np.testing.assert_allclose(arm.points(joints, truth.values), exact, atol=1e-9)
    nominal = robot.model.values_before(arm, real.T_world_tracker)
    assert 1e-3 < np.abs(arm.points(joints, nominal) - exact).max() < 0.1
