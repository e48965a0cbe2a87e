"""One identified arm in every file: each is read by another program, and they put the measured points in one place.

URDF by yourdfpy, MJCF by MuJoCo, ``ur_kinematics.yaml`` and ``calibration.conf`` by the products of their makers,
written here anew, and ``calibrated.py`` by a bare Python without site packages.
"""

import re
from pathlib import Path

import mujoco
import numpy as np
import pytest
import yaml
from day_files import ur5e_urdf
from helpers.bare_python import bare_python
from helpers.robots import perturbed, somewhere
from helpers.ur5e import UR5E_TABLE, distal_pose, ur5e_toml
from scipy.spatial.transform import Rotation

from lab.core import se3
from lab.core.se3 import Array
from lab.formats.calibrated_module import module_text, plain_model
from lab.formats.ur_calibration import read_corrections
from lab.kinematics.serial.serial_arm import SerialArm
from lab.robots.load_robot import load_robot
from lab.robots.robot import Robot

SAME_M = 1e-9  # asked for is 1e-6; what rounding leaves is 1e-12, and 1e-10 of links of 1e4 m in calibration.conf
UR_NAMES = {"ur5": "UR5", "ur10": "UR10", "ur5e table": "UR5e", "ur5e urdf": "UR5e"}
LENGTHS = {  # d1, a2, a3, d4, d5, d6: Universal Robots, "DH parameters for calculations of kinematics and dynamics"
    "UR5": (0.089159, -0.425, -0.39225, 0.10915, 0.09465, 0.0823),
    "UR10": (0.1273, -0.612, -0.5723, 0.163941, 0.1157, 0.0922),
    "UR5e": (0.1625, -0.425, -0.3922, 0.1333, 0.0997, 0.0996),
}
TARGETS = ("p1", "p2", "p3")
ROBOTS = ["irb120", "ur5", "ur10", "panda", "tx40", "rx130", "scara", "ur5e table", "ur5e urdf"]
pytestmark = pytest.mark.thorough  # yourdfpy is of the extra dev


def robot_called(name: str, folder: Path) -> Robot:
    if name == "ur5e table":
        return load_robot(str(ur5e_toml(folder / "ur5e.toml")))
    return load_robot(str(ur5e_urdf(folder / "ur5e.urdf"))) if name == "ur5e urdf" else load_robot(name)


def by_urdf(path: Path, joints: Array, links: tuple[str, ...], root: str | None = None) -> Array:
    urdf = pytest.importorskip("yourdfpy").URDF.load(str(path), load_meshes=False, build_scene_graph=True)
    poses = []
    for q in joints:
        urdf.update_cfg(q)
        poses.append([urdf.get_transform(link, root or urdf.base_link) for link in links])
    return np.array(poses)


def by_mjcf(path: Path, chain: SerialArm, joints: Array, sites: tuple[str, ...]) -> Array:
    model = mujoco.MjModel.from_xml_path(str(path))
    data, found = mujoco.MjData(model), []
    for q in joints:
        for name, value in zip(chain.chain.joint_names, q, strict=True):
            data.joint(name).qpos[0] = value
        mujoco.mj_kinematics(model, data)
        T = se3.pose(data.site("tracker").xmat.reshape(3, 3), data.site("tracker").xpos)
        found.append(se3.transform(se3.inverse(T), np.array([data.site(name).xpos for name in sites])))
    return np.array(found)


def of_six(six: list[float]) -> Array:
    """A pose by x, y, z and the angles of a URDF, about fixed x, y and z."""
    return se3.pose(Rotation.from_euler("xyz", six[3:]).as_matrix(), np.array(six[:3]))


def commented(text: str) -> tuple[Array, Array]:
    """The base in the frame of the measurements, and the measured points in tool0, as a file's comments say them."""
    base = re.search(r"# .*base.* in the frame of the measurements.*: (.*)", text)
    points = re.findall(r"# measured point .* in tool0.*: (.*)", text)
    return of_six([float(each) for each in base[1].split()]), np.array([p.split() for p in points], dtype=float)


def by_yaml(text: str, joints: Array) -> Array:
    """Tool0 in the base as ur_description composes it: each joint's origin, then the turn about its z."""
    kinematics, poses = yaml.safe_load(text)["kinematics"], []
    for q in joints:
        T = np.eye(4)
        for link, angle in zip(("shoulder", "upper_arm", "forearm", "wrist_1", "wrist_2", "wrist_3"), q, strict=True):
            each = [kinematics[link][key] for key in ("x", "y", "z", "roll", "pitch", "yaw")]
            T = T @ of_six(each) @ se3.pose(Rotation.from_rotvec([0, 0, angle]).as_matrix(), np.zeros(3))
        poses.append(T)
    return np.array(poses)


@pytest.fixture(params=ROBOTS)
def exported(request, tmp_path: Path) -> tuple[str, Path, Robot, SerialArm, Array]:
    """Files of an arm off by 0.5 mm and 1.5 mrad in every parameter, last link too, its base anywhere."""
    robot = robot_called(request.param, tmp_path)
    arm, rng = robot.serial_arm(TARGETS), np.random.default_rng(11)
    values = perturbed(arm, somewhere(arm, rng), rng, 0.5e-3, 1.5e-3)
    for name in robot.description_files:
        if text := robot.description(name, TARGETS, values):
            (tmp_path / name).write_text(text, encoding="utf-8")
    model = plain_model(arm, values, None, np.eye(3), {})
    (tmp_path / "calibrated.py").write_text(module_text("t", "a", "f", model), encoding="utf-8")
    return request.param, tmp_path, robot, arm, values


def test_all_files_agree(exported: tuple[str, Path, Robot, SerialArm, Array]) -> None:
    name, folder, _, arm, values = exported
    joints = arm.chain.random_joints(15, np.random.default_rng(5))
    expected = arm.points(joints, values)

    def same(points: Array) -> None:
        np.testing.assert_allclose(points, expected, rtol=0, atol=SAME_M)

    same(np.array([[row[target] for target in TARGETS] for row in bare_python(folder, joints)]))
    same(by_mjcf(folder / "calibrated.xml", arm, joints, TARGETS))
    if name != "ur5e urdf":
        same(by_urdf(folder / "calibrated.urdf", joints, TARGETS)[..., :3, 3])
    assert (folder / "ur_kinematics.yaml").exists() == (folder / "calibration.conf").exists() == (name in UR_NAMES)
    if name not in UR_NAMES:
        return
    text = (folder / "ur_kinematics.yaml").read_text()
    T_instrument_base, in_tool0 = commented(text)
    tool0 = by_yaml(text, joints)
    same(se3.transform(T_instrument_base @ tool0, in_tool0))
    root = None if name == "ur5e urdf" else "instrument"
    T_root_tool0 = by_urdf(folder / "calibrated.urdf", joints, ("tool0",), root)[:, 0]
    T_root_base = np.eye(4) if name == "ur5e urdf" else T_instrument_base
    np.testing.assert_allclose(T_root_tool0, T_root_base @ tool0, rtol=0, atol=SAME_M)
    conf = (folder / "calibration.conf").read_text()
    table = UR5E_TABLE.copy()
    table[[0, 1, 2, 3, 4, 5], [1, 2, 2, 1, 1, 1]] = LENGTHS[UR_NAMES[name]]
    table += read_corrections(folder / "calibration.conf")
    by_controller = np.array([distal_pose(table, q) for q in joints])
    T_instrument_base, in_tool0 = commented(conf)
    same(se3.transform(T_instrument_base @ by_controller, in_tool0))
    np.testing.assert_allclose(by_controller, tool0, rtol=0, atol=SAME_M)  # the controller's flange is that tool0
