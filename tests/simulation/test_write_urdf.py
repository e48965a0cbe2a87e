"""A calibrated URDF is the user's own file with other origins: exact, and nothing else of it changes."""

import re
from pathlib import Path

import numpy as np
import pytest
from day_files import JOINTS, ur5e_urdf

from lab.core import se3
from lab.robots.load_robot import load_robot
from lab.simulation.load_model import URDF, XACRO


@pytest.fixture(scope="module")
def identified(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, str, str, str]:
    """The user's file, and the calibrated one, the xacro and the kinematics of an arm whose every parameter is off."""
    path = ur5e_urdf(tmp_path_factory.mktemp("ur") / "ur5e.urdf")
    robot = load_robot(str(path))
    arm = robot.serial_arm(("p1",))
    values = arm.nominal(robot.tool)
    rng = np.random.default_rng(2)
    links = [i for i, name in enumerate(arm.names) if name.startswith("link") and not name.startswith("link6")]
    values[links] += rng.normal(0, 2e-3, len(links))
    files = (URDF.file, XACRO.file, "ur_kinematics.yaml")
    return path, *(robot.description(file, ("p1",), values) for file in files)


@pytest.mark.thorough
def test_it_moves_as_the_identified_arm(identified: tuple[Path, str, str, str], tmp_path: Path) -> None:
    yourdfpy = pytest.importorskip("yourdfpy")
    path, text, *_ = identified
    (tmp_path / "calibrated.urdf").write_text(text)
    robot = load_robot(str(path))
    arm = robot.serial_arm(("p1",))
    values = arm.nominal(robot.tool)
    links = [i for i, name in enumerate(arm.names) if name.startswith("link") and not name.startswith("link6")]
    values[links] += np.random.default_rng(2).normal(0, 2e-3, len(links))
    urdf = yourdfpy.URDF.load(str(tmp_path / "calibrated.urdf"), load_meshes=False, build_scene_graph=True)
    joints = np.random.default_rng(3).uniform(-2, 2, (20, 6))
    base = robot.T_world_frame0 @ se3.inverse(arm.T_tracker_frame0(values))
    poses = []
    for q in joints:
        urdf.update_cfg(dict(zip(JOINTS, q, strict=True)))
        poses.append(urdf.get_transform("tool0", urdf.base_link))
    own = base @ arm.flange(joints, values)
    still = np.linalg.inv(own[0]) @ poses[0]  # the last frame of the table is fixed to the link
    np.testing.assert_allclose(own @ still, poses, atol=1e-12)
    assert not np.allclose(own @ still, robot.T_world_frame0 @ arm.flange(joints, arm.nominal()) @ still, atol=1e-3)


def test_nothing_but_origins_of_moving_joints_changes(identified: tuple[Path, str, str, str]) -> None:
    path, text, *_ = identified
    before, after = path.read_text().splitlines(), text.splitlines()
    changed = [i for i, (a, b) in enumerate(zip(before, after, strict=True)) if a != b]
    assert len(changed) == 6 and all(before[i].strip().startswith("<origin") for i in changed)
    assert all(re.search(r"<parent", before[i - 2]) for i in changed)  # of joints, not of shapes


def test_the_xacro_and_ros_s_kinematics_say_the_same(identified: tuple[Path, str, str, str]) -> None:
    _, text, xacro, kinematics = identified
    lengths = re.findall(r'elbow_joint_xyz" value="(\S+) ', xacro)
    assert f'<origin xyz="{lengths[0]} ' in text
    assert kinematics.count("roll:") == 6 and "hash: calib_" in kinematics
