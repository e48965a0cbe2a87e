"""The calibrated arm in the formats of other tools, read by those tools."""

from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest
from helpers.robots import IRB120, RX130, SCARA, VERSATRAN, perturbed, somewhere

from lab.core import se3
from lab.core.se3 import Array
from lab.formats.link_tree import link_tree
from lab.formats.robot_toml import RobotTable, read_table
from lab.kinematics.serial.chain import Chain
from lab.kinematics.serial.serial_arm import SerialArm
from lab.robots.load_robot import load_robot
from lab.robots.robot import Robot, SerialRobot
from lab.simulation.build_serial import table_model

TARGETS = ("p1", "p2", "p3")
TOLERANCE_M = 1e-12
ODD = replace(RX130, name='6 <axes> & "more" -- é', joint_names=('q"1"', "q 2", "base", "q<4>", "q&5", "base_fixed"))
CHAINS = {
    "irb120 as a table": IRB120.chain,  # distal: its last row stands behind the last joint
    "rx130": RX130,
    "scara": SCARA,
    "versatran": replace(VERSATRAN, sign=np.array([1.0, -1, 1, -1, 1, 1])),  # a slide and a joint that count backwards
    "odd names": ODD,
}
ROBOTS = ["irb120", *CHAINS, "panda"]


def as_table(chain: Chain) -> Robot:
    """A robot of which only the table is known."""
    model = table_model(Path("arm.toml"), RobotTable(chain, None, {}, None, *np.full((2, chain.size), np.nan), ()))
    return SerialRobot(model)


def write_arm(folder: Path, robot: Robot, arm: SerialArm, values: Array) -> None:
    for name in robot.description_files:
        (folder / name).write_text(robot.description(name, arm.targets, values), encoding="utf-8")


@pytest.fixture(scope="module", params=ROBOTS)
def exported(request, tmp_path_factory) -> tuple[Path, Robot, SerialArm, Array]:
    """A folder with the files of an arm off by 0.5 mm and 1.5 mrad in every parameter, its base anywhere."""
    name = request.param
    robot = as_table(CHAINS[name]) if name in CHAINS else load_robot(name)
    targets = ("base", "flange", "tracker", 'p & "1" <') if name == "odd names" else TARGETS
    arm, rng = robot.arm(targets), np.random.default_rng(7)
    values = perturbed(arm, somewhere(arm, rng), rng, 0.5e-3, 1.5e-3)
    folder = tmp_path_factory.mktemp("arm")
    write_arm(folder, robot, arm, values)
    return folder, robot, arm, values


def poses_of(chain: Chain) -> Array:
    return chain.random_joints(200, np.random.default_rng(3))


def mujoco_poses(path: Path, chain: Chain, joints: Array, kind: str, names: list[str], root: str) -> Array:
    """Poses ``(n, k, 4, 4)`` of bodies or sites in the frame of the one called ``root``."""
    model = mujoco.MjModel.from_xml_path(str(path))
    data = mujoco.MjData(model)
    ids = [mujoco.mj_name2id(model, getattr(mujoco.mjtObj, f"mjOBJ_{kind.upper()}"), name) for name in (root, *names)]
    assert min(ids) >= 0 and model.nq == chain.size
    places, turns = (data.xpos, data.xmat) if kind == "body" else (data.site_xpos, data.site_xmat)
    seen = []
    for reading in joints:
        for name, value in zip(chain.joint_names, reading, strict=True):
            data.joint(name).qpos[0] = value
        mujoco.mj_kinematics(model, data)
        poses = se3.pose(turns[ids].reshape(-1, 3, 3), places[ids])
        seen.append(se3.inverse(poses[0]) @ poses[1:])
    return np.array(seen)


def assert_the_arm(poses: Array, arm: SerialArm, joints: Array, values: Array) -> None:
    """Poses ``(n, 1 + k, 4, 4)`` of the last frame and the targets are those of the equations."""
    np.testing.assert_allclose(poses[:, 1:, :3, 3], arm.points(joints, values), rtol=0, atol=TOLERANCE_M)
    last = arm.flange(joints, values)
    np.testing.assert_allclose(poses[:, 0], last, rtol=0, atol=TOLERANCE_M)  # metres, and the rotation's cosines
    turned = np.broadcast_to(last[:, None, :3, :3], poses[:, 1:, :3, :3].shape)
    np.testing.assert_allclose(poses[:, 1:, :3, :3], turned, rtol=0, atol=TOLERANCE_M)


def test_the_links_move_as_the_chain_does(exported) -> None:
    """Walked by hand: the reading turns each link about its own z, or slides it along."""
    _, _, arm, values = exported
    joints = poses_of(arm.chain)
    tree = link_tree(arm, values)
    assert [link.joint for link in tree.moving] == list(range(arm.chain.size))
    assert len({link.name for link in tree.links}) == len(tree.links)
    at = {tree.instrument.name: np.broadcast_to(np.eye(4), (len(joints), 4, 4))}
    for link in tree.links[1:]:
        at[link.name] = at[link.parent] @ link.T_parent_link
        if link.joint is not None:
            along_z = np.outer(joints[:, link.joint] * link.sign, [0, 0, 1])
            slides = arm.chain.prismatic[link.joint]
            at[link.name] = at[link.name] @ se3.pose(se3.exp(along_z * (not slides)), along_z * slides)
    poses = np.stack([at[link.name] for link in (tree.flange, *tree.targets)], axis=1)
    assert_the_arm(poses, arm, joints, values)


def test_mujoco_reads_the_urdf(exported) -> None:
    folder, _, arm, values = exported
    joints, tree = poses_of(arm.chain), link_tree(arm, values)
    names = [link.name for link in (tree.flange, *tree.targets)]
    poses = mujoco_poses(folder / "calibrated.urdf", arm.chain, joints, "body", names, tree.instrument.name)
    assert_the_arm(poses, arm, joints, values)


@pytest.mark.thorough
def test_another_reader_reads_the_urdf(exported) -> None:
    yourdfpy = pytest.importorskip("yourdfpy")
    folder, _, arm, values = exported
    joints, tree = poses_of(arm.chain), link_tree(arm, values)
    urdf = yourdfpy.URDF.load(str(folder / "calibrated.urdf"))
    assert urdf.validate() and urdf.base_link == tree.instrument.name and urdf.robot.name == arm.chain.name
    assert tuple(urdf.actuated_joint_names) == arm.chain.joint_names
    limits = [urdf.joint_map[name].limit for name in arm.chain.joint_names]
    assert [(limit.lower, limit.upper) for limit in limits] == list(zip(arm.chain.lower, arm.chain.upper, strict=True))
    assert [limit.velocity for limit in limits] == list(np.nan_to_num(arm.chain.speed))
    poses = []
    for reading in joints:
        urdf.update_cfg(reading)
        poses.append([urdf.get_transform(link.name) for link in (tree.flange, *tree.targets)])
    assert_the_arm(np.array(poses), arm, joints, values)


def test_mujoco_reads_the_mjcf(exported) -> None:
    folder, robot, arm, values = exported
    joints, tree = poses_of(arm.chain), link_tree(arm, values)
    tracker = "tracker_" if "tracker" in arm.targets else "tracker"
    names = list(arm.targets) if robot.model else [tree.flange.name, *arm.targets]
    poses = mujoco_poses(folder / "calibrated.xml", arm.chain, joints, "site", names, tracker)
    if robot.model:  # its sites stand on its own bodies
        np.testing.assert_allclose(poses[..., :3, 3], arm.points(joints, values), rtol=0, atol=TOLERANCE_M)
    else:
        assert_the_arm(poses, arm, joints, values)


def test_the_table_reads_back_to_the_bit(exported) -> None:
    folder, _, arm, values = exported
    back = read_table(folder / "calibrated.toml")
    assert not back.warnings and tuple(back.tool) == arm.targets and back.base is not None
    tool = np.array(list(back.tool.values()))
    np.testing.assert_array_equal(arm.assemble(back.base, back.chain.table, tool), values)
    for name in ("name", "convention", "joint_names", "prismatic", "parallel"):
        assert getattr(back.chain, name) == getattr(arm.chain, name), name
    for name in ("sign", "lower", "upper"):
        np.testing.assert_array_equal(getattr(back.chain, name), getattr(arm.chain, name))


def test_the_lab_reads_the_mjcf_of_a_table_as_a_robot(exported) -> None:
    """Now with bodies: a virtual arm can be made of it, and its drawing is the identified one."""
    folder, robot, arm, values = exported
    if robot.model or arm.targets != TARGETS:
        pytest.skip("a robot with a model, or with names that mean something else in one")
    loaded = load_robot(str(folder / "calibrated.xml"))
    model, joints = loaded.model, poses_of(arm.chain)
    again = loaded.arm(TARGETS)
    points = again.points(joints, model.values_before(again, np.eye(4)))
    np.testing.assert_allclose(points, arm.points(joints, values), rtol=0, atol=TOLERANCE_M)


def test_the_lab_reads_the_urdf_as_a_robot(exported) -> None:
    """The same axes; the last frame stands on the last one, at the foot of the link ``flange``."""
    folder, _, arm, values = exported
    loaded = load_robot(str(folder / "calibrated.urdf"))
    model, joints = loaded.model, poses_of(arm.chain)
    assert loaded.chain.joint_names == arm.chain.joint_names and loaded.chain.prismatic == arm.chain.prismatic
    again = loaded.arm(("p1",))
    seen = again.flange(joints, model.values_before(again, np.eye(4)))
    expected = arm.flange(joints, values) @ se3.inverse(link_tree(arm, values).flange.T_parent_link)
    np.testing.assert_allclose(seen[:, :3, 2], expected[:, :3, 2], rtol=0, atol=TOLERANCE_M)
    z, apart = seen[:, :3, 2], seen[:, :3, 3] - expected[:, :3, 3]
    across = apart - np.sum(apart * z, axis=1, keepdims=True) * z
    np.testing.assert_allclose(across, 0.0, rtol=0, atol=TOLERANCE_M)
    if "flange" not in arm.targets:  # else the measured point of that name says where along the axis
        along = np.sum((seen - arm.flange(joints, values))[:, :3, 3] * z, axis=1)
        np.testing.assert_allclose(along, 0.0, rtol=0, atol=TOLERANCE_M)


def test_the_masses_of_the_urdf_weigh_what_the_drawing_says(tmp_path: Path) -> None:
    """Gravity's torques in MuJoCo and in closed form, with the drawing's links."""
    loads, arm = IRB120.loads, IRB120.arm(TARGETS)
    assert loads is not None
    write_arm(tmp_path, IRB120, arm, arm.nominal())
    model = mujoco.MjModel.from_xml_path(str(tmp_path / "calibrated.urdf"))
    data, joints = mujoco.MjData(model), poses_of(arm.chain)[:20]
    forces, _ = loads.forces(joints, np.zeros(20))
    for reading, expected in zip(joints, forces, strict=True):
        data.qpos[:] = reading
        mujoco.mj_forward(model, data)
        np.testing.assert_allclose(-data.qfrc_bias, expected, atol=1e-10)  # Nm
