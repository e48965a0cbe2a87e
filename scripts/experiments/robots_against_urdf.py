"""The lab's tables against the makers' URDFs: how far the last frame is from the URDF's, at random joint positions.

The folder holds one URDF for each robot, ``<robot>.urdf``, as xacro makes it of the file that is named in ``URDFS``. It
is read here anew, without the lab's reader: joints' origins as the URDF specification has them, multiplied along the
chain. Some makers write right angles as 1.5708; the last column is the difference with right angles exact.
"""

import json
import xml.etree.ElementTree as ET
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from shared import Answer, Document, Flag, Table, run_script

from lab.core.errors import LabError
from lab.core.se3 import Array
from lab.robots.load_robot import load_robot

_NEARLY_RIGHT_RAD = 1e-5  # an angle so near a multiple of 90 degrees is one
_SAME_M = 1e-6
_STORED = 4  # configurations of each robot
_UR = "UniversalRobots/Universal_Robots_ROS2_Description", "2221ec0f720fb1af99339eb891639b499b62f1da"
_FRANKA = "frankaemika/franka_description", "b299b39d9692bfae795184df32a98ce7778d56af"
_LBR = "lbr-stack/lbr_fri_ros2_stack", "218d723f817c61314988833611effddc5333ca6c"
_KUKA = "ros-industrial/kuka_experimental", "e78bbd15edb2b39c9053ff3b963ef2947e10a531"
_ABB = "ros-industrial/abb_experimental", "20b9cf86ad274e4f98540b9c9efe59f94245d2d1"
_OLDER_ABB = "ros-industrial/abb", "77db19bdb098f50d9569d1cab03ee657627e934e"
_FANUC = "ros-industrial/fanuc", "8fee5e30e535378758ace26dfdffb8ab0403e23c"
_YASKAWA = "Yaskawa-Global/motoman_ros2_support_packages", "34b884797d617173bbff9aba7e67d8564739430a"
_XARM = "xArm-Developer/xarm_ros2", "3654ba7bb2a0e502088251728d07263ea399d4a4"
_KINOVA = "Kinovarobotics/ros2_kortex", "1fdbef345954b326627dc3792981e18e2221450b"
_SO_ARM = "TheRobotStudio/SO-ARM100", "fda892cba81032c46c40976a48c9ceadbf40a9ca"


class Urdf(NamedTuple):
    """A maker's description: repository and commit, file with arguments of xacro, first and last link.

    ``offset_mm`` is where the URDF's last link is in the table's last frame, which stands on the last joint's axis.
    """

    source: tuple[str, str]
    file: str
    base: str = "base_link"
    tip: str = "tool0"
    offset_mm: tuple[float, float, float] = (0.0, 0.0, 0.0)


URDFS = {
    **{name: Urdf(_UR, f"urdf/ur.urdf.xacro ur_type:={name} name:={name}", "base")
       for name in ("ur3e", "ur5", "ur5e", "ur10", "ur10e", "ur16e", "ur20")},
    "panda": Urdf(_FRANKA, "robots/fer/fer.urdf.xacro hand:=false", "fer_link0", "fer_link8"),
    "fr3": Urdf(_FRANKA, "robots/fr3/fr3.urdf.xacro hand:=false", "fr3_link0", "fr3_link8"),
    **{name: Urdf(_LBR, f"lbr_description/urdf/{name}/{name}.xacro", "lbr_link_0", "lbr_link_ee")
       for name in ("iiwa7", "iiwa14")},
    "kr6_r700": Urdf(_KUKA, "kuka_kr6_support/urdf/kr6r700sixx.xacro"),
    "kr6_r900": Urdf(_KUKA, "kuka_kr6_support/urdf/kr6r900sixx.xacro"),
    "kr10_r1100": Urdf(_KUKA, "kuka_kr10_support/urdf/kr10r1100sixx.xacro"),
    "kr10_r1420": Urdf(_KUKA, "kuka_kr10_support/urdf/kr10r1420.xacro"),
    "irb1200_5_90": Urdf(_ABB, "abb_irb1200_support/urdf/irb1200_5_90.xacro"),
    "irb1200_7_70": Urdf(_ABB, "abb_irb1200_support/urdf/irb1200_7_70.xacro"),
    "irb2400": Urdf(_OLDER_ABB, "abb_irb2400_support/urdf/irb2400.xacro"),
    "gofa": Urdf(_ABB, "abb_crb15000_support/urdf/crb15000_5_95.xacro"),
    "lrmate200id": Urdf(_FANUC, "fanuc_lrmate200id_support/urdf/lrmate200id.xacro"),
    "lrmate200id_7l": Urdf(_FANUC, "fanuc_lrmate200id_support/urdf/lrmate200id7l.xacro"),
    "hc10": Urdf(_YASKAWA, "motoman_hc10_support/urdf/hc10.xacro"),
    "hc10dt": Urdf(_YASKAWA, "motoman_hc10_support/urdf/hc10dt.xacro"),
    "xarm6": Urdf(_XARM, "xarm_description/urdf/xarm_device.urdf.xacro dof:=6", "link_base", "link_eef"),
    "xarm7": Urdf(_XARM, "xarm_description/urdf/xarm_device.urdf.xacro dof:=7", "link_base", "link_eef"),
    "gen3": Urdf(_KINOVA, "kortex_description/robots/gen3.xacro robot_ip:=x dof:=7", tip="end_effector_link"),
    "so101": Urdf(_SO_ARM, "Simulation/SO101/so101_new_calib.urdf", tip="gripper_frame_link",
                  offset_mm=(7.9, -0.218, 0.0)),
}  # fmt: skip


@dataclass(frozen=True)
class Options:
    """Which URDFs, and whether to store their poses."""

    folder: Path
    """That holds the URDFs, `<robot>.urdf`."""
    store: Path | None = None
    """A JSON file for joint positions and the URDFs' poses: what the tests compare with."""
    configurations: int = 200
    """Random joint positions of each robot."""
    seed: int = 0
    """Of these."""
    json: Flag = False
    """Print one JSON object."""


class _Joint(NamedTuple):
    origin: Array  # (4, 4) m, in the parent link
    axis: Array | None  # (3,); None of a fixed joint


def _numbers(element: ET.Element | None, key: str, default: str) -> Array:
    text = default if element is None else element.get(key, default)
    return np.array([float(each) for each in text.split()])


def turned(axis: Array, angle: float) -> Array:
    """Return the rotation ``(3, 3)`` about a unit axis by an angle (rad), by Rodrigues' formula."""
    x, y, z = axis
    K = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.asarray(np.eye(3) + np.sin(angle) * K + (1 - np.cos(angle)) * K @ K)


def _joint(element: ET.Element, *, exact: bool) -> _Joint:
    origin = element.find("origin")
    T, (roll, pitch, yaw) = np.eye(4), _numbers(origin, "rpy", "0 0 0")
    if exact:
        quarters = np.round(np.array([roll, pitch, yaw]) / (np.pi / 2)) * (np.pi / 2)
        near = np.abs(quarters - [roll, pitch, yaw]) < _NEARLY_RIGHT_RAD
        roll, pitch, yaw = np.where(near, quarters, [roll, pitch, yaw])
    x, y, z = np.eye(3)
    T[:3, :3], T[:3, 3] = turned(z, yaw) @ turned(y, pitch) @ turned(x, roll), _numbers(origin, "xyz", "0 0 0")
    return _Joint(T, None if element.get("type") == "fixed" else _numbers(element.find("axis"), "xyz", "1 0 0"))


def _path(root: ET.Element, link: str, *, exact: bool) -> list[_Joint]:
    """Return the joints from the root of the tree to a link."""
    above = {joint.find("child").get("link"): joint for joint in root.findall("joint")}  # type: ignore[union-attr]
    path = list[_Joint]()
    while link in above:
        path.insert(0, _joint(above[link], exact=exact))
        link = above[link].find("parent").get("link", "")  # type: ignore[union-attr]
    return path


def urdf_poses(path: Path, urdf: Urdf, joints: Array, *, exact: bool) -> Array:
    """Return poses ``(n, 4, 4)`` (m) of the last link in the first, at joint positions ``(n, j)`` (rad).

    Args:
        exact: take angles that are nearly right for right ones.
    """
    root = ET.parse(path).getroot()
    to_base, to_tip = (_path(root, link, exact=exact) for link in (urdf.base, urdf.tip))
    if not to_tip or sum(joint.axis is not None for joint in to_tip) != joints.shape[1]:
        raise LabError(f"{path}: from {urdf.base} to {urdf.tip} there are not {joints.shape[1]} joints")
    base = np.eye(4)
    for joint in to_base:
        base = base @ joint.origin
    poses = np.empty((len(joints), 4, 4))
    for i, row in enumerate(joints):
        T, angles = np.linalg.inv(base), iter(row)
        for joint in to_tip:
            T = T @ joint.origin
            if joint.axis is not None:
                T[:3, :3] = T[:3, :3] @ turned(joint.axis / np.linalg.norm(joint.axis), next(angles))
        poses[i] = T
    return poses


def lab_poses(name: str, urdf: Urdf, joints: Array) -> Array:
    """Return the lab's poses ``(n, 4, 4)`` (m) of the same frame: the table's last one, with the offset."""
    robot = load_robot(name)
    arm = robot.serial_arm(("p1",))
    offset = np.eye(4)
    offset[:3, 3] = 1e-3 * np.array(urdf.offset_mm)
    return np.asarray(robot.T_world_frame0 @ arm.flange(joints, arm.nominal()) @ offset)


def answer(options: Options) -> Answer:
    """Compare every robot whose URDF is in the folder."""
    found = {name: options.folder / f"{name}.urdf" for name in URDFS}
    found = {name: path for name, path in found.items() if path.is_file()}
    if not found:
        raise LabError(f"{options.folder}: holds none of {', '.join(f'{name}.urdf' for name in URDFS)}")
    rows, values, stored = list[tuple[str, ...]](), dict[str, Any](), dict[str, dict[str, Any]]()
    for name, path in found.items():
        urdf, chain = URDFS[name], load_robot(name).chain
        joints = chain.random_joints(options.configurations, np.random.default_rng(options.seed))
        ours, theirs = lab_poses(name, urdf, joints), urdf_poses(path, urdf, joints, exact=False)
        exact = urdf_poses(path, urdf, joints, exact=True)
        apart = [float(np.linalg.norm(each[:, :3, 3] - ours[:, :3, 3], axis=1).max()) for each in (theirs, exact)]
        turn = float(np.abs(theirs[:, :3, :3] - ours[:, :3, :3]).max())
        rows.append((name, *(f"{1e6 * each:.3g}" for each in (apart[0], turn, apart[1]))))
        values[name] = {"position_m": apart[0], "rotation": turn, "position_exact_angles_m": apart[1]}
        stored[name] = {
            "repository": urdf.source[0], "commit": urdf.source[1], "file": urdf.file, "base": urdf.base,
            "tip": urdf.tip, "offset_mm": urdf.offset_mm, "joints": joints[:_STORED].tolist(),
            "poses": theirs[:_STORED, :3].round(12).tolist(),
        }  # fmt: skip
        if apart[0] > _SAME_M:
            stored[name] |= {"exact_poses": exact[:_STORED, :3].round(12).tolist(), "largest_difference_m": apart[0]}
    if options.store is not None:
        lines = (f" {json.dumps(name)}: {json.dumps(each)}" for name, each in stored.items())
        options.store.write_text("{\n" + ",\n".join(lines) + "\n}\n")
    head = ("robot", "position, µm", "rotation, µrad", "position with exact right angles, µm")
    title = f"Largest difference from the URDF, {options.configurations} configurations"
    return Answer(values, Document(title, (Table(head, tuple(rows)),)))


if __name__ == "__main__":
    run_script("robots_against_urdf")
