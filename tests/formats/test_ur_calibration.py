"""Universal Robots' calibration: the controller's corrections as a table, and the kinematics that ROS reads."""

import re
from pathlib import Path

import numpy as np
import pytest
import yaml
from helpers.ur5e import UR5E_TABLE, distal_pose, ur5e_toml
from scipy.spatial.transform import Rotation

from lab.core.errors import LabError
from lab.core.se3 import Array
from lab.formats.description import IdentifiedRobot
from lab.formats.robot_toml import read_table
from lab.formats.ur_calibration import UR_KINEMATICS
from lab.kinematics.serial.serial_arm import SerialArm

# A real robot's table, as the controller reports it: ur_calibration, doc/algorithm.rst (a UR10e)
REAL = np.array([
    [-2.4147806894359e-07, 0.180539811714259, 2.12234865571206e-05, 1.57014608044242],
    [1.60233952386695, 439.140974079901, 0.0193171326277006, 0.0013941666682559],
    [-1.68607190752171, -446.027059806332, -0.569251663611088, 0.00693818880325995],
    [0.0837331147700119, 7.0603368964236, -4.61409023720934e-05, 1.56998468543761],
    [-1.01260355871158e-07, 0.119811341150314, -6.39280053471802e-05, -1.57038520649543],
    [3.91986209186124e-08, 0.115670917257426, 0, 0],
])  # fmt: skip
# config/ur5e/default_kinematics.yaml of ur_description: x y z roll pitch yaw
PUBLIC = np.array([
    [0, 0, 0.1625, 0, 0, 0], [0, 0, 0, 1.570796327, 0, 0], [-0.425, 0, 0, 0, 0, 0], [-0.3922, 0, 0.1333, 0, 0, 0],
    [0, -0.0997, 0, 1.570796327, 0, 0], [0, 0.0996, 0, 1.570796326589793, 3.141592653589793, 3.141592653589793],
])  # fmt: skip


def conf(path: Path, delta: Array) -> Path:
    """A controller's file; the lists in another order than the table's columns, with comments as it has."""
    keys = {"delta_theta": 0, "delta_a": 2, "delta_d": 1, "delta_alpha": 3}
    lists = [f"{key} = [{', '.join(repr(float(v)) for v in delta[:, column])}]" for key, column in keys.items()]
    path.write_text("\n".join(["[mounting]", "calibration_status = 2 # 2: linearised", *lists, ""]))
    return path


def origins(text: str) -> list[Array]:
    """Joint origins ``(4, 4)`` of the YAML, with the angles of a URDF: fixed axes x, y, z."""
    found = []
    for link in ("shoulder", "upper_arm", "forearm", "wrist_1", "wrist_2", "wrist_3"):
        each, T = yaml.safe_load(text)["kinematics"][link], np.eye(4)
        T[:3, :3] = Rotation.from_euler("xyz", [each[k] for k in ("roll", "pitch", "yaw")]).as_matrix()
        T[:3, 3] = [each[k] for k in "xyz"]
        found.append(T)
    return found


def along(found: list[Array], joints: Array) -> Array:
    T = np.eye(4)
    for origin, q in zip(found, joints, strict=True):
        turn = np.eye(4)
        turn[:3, :3] = Rotation.from_rotvec([0, 0, q]).as_matrix()
        T = T @ origin @ turn
    return T


def kinematics(arm: SerialArm, values: Array | None = None) -> str:
    return UR_KINEMATICS.text(IdentifiedRobot("ur5e", arm, arm.nominal() if values is None else values, None, None))


def test_corrections_are_the_controller_s_kinematics(tmp_path: Path) -> None:
    conf(tmp_path / "calibration.conf", REAL - UR5E_TABLE)
    chain = read_table(ur5e_toml(tmp_path / "ur.toml", "calibration.conf")).chain
    assert np.abs(chain.table[:, 1]).max() < 0.5 and chain.parallel[1:3] == (True, True)  # no link of 439 m
    arm = SerialArm(chain)
    joints = np.random.default_rng(0).uniform(-3, 3, (40, 6))
    expected = np.array([distal_pose(REAL, q) for q in joints])
    np.testing.assert_allclose(arm.flange(joints, arm.nominal()), expected, atol=1e-10)


def test_the_nominal_table_gives_the_public_file(tmp_path: Path) -> None:
    found = origins(kinematics(SerialArm(read_table(ur5e_toml(tmp_path / "ur.toml")).chain)))
    for own, row in zip(found, PUBLIC, strict=True):
        np.testing.assert_allclose(own[:3, 3], row[:3], atol=1e-12)
        np.testing.assert_allclose(own[:3, :3], Rotation.from_euler("xyz", row[3:]).as_matrix(), atol=1e-9)


def test_a_real_robot_s_file_moves_as_its_controller_says(tmp_path: Path) -> None:
    conf(tmp_path / "c.conf", REAL - UR5E_TABLE)
    arm = SerialArm(read_table(ur5e_toml(tmp_path / "ur.toml", "c.conf")).chain)
    found = origins(kinematics(arm))
    assert max(abs(T[:3, 3]).max() for T in found) < 0.7  # no link is hundreds of metres away
    joints = np.random.default_rng(1).uniform(-3, 3, (40, 6))
    expected = np.array([distal_pose(REAL, q) for q in joints])
    still = np.linalg.inv(along(found, np.zeros(6))) @ distal_pose(REAL, np.zeros(6))
    np.testing.assert_allclose([along(found, q) @ still for q in joints], expected, atol=1e-10)
    assert np.linalg.norm(still[:3, 3]) < 1e-3  # of the last frame only its turn about z is free


def test_axes_that_no_arm_of_the_maker_has_are_refused_with_a_reason(tmp_path: Path) -> None:
    """As a fit of mirrored points, or of joints in another order, leaves them."""
    arm = SerialArm(read_table(ur5e_toml(tmp_path / "ur.toml")).chain)
    values = arm.nominal()
    values[arm.names.index("link1.a")] += 0.2
    with pytest.raises(LabError, match="axes of joints 1 and 2 are 200 mm apart"):
        kinematics(arm, values)


def test_other_arms_have_no_such_file(tmp_path: Path) -> None:
    text = ur5e_toml(tmp_path / "ur.toml").read_text().replace(str(np.pi / 2), "0.5", 1)
    (tmp_path / "other.toml").write_text(text)
    assert kinematics(SerialArm(read_table(tmp_path / "other.toml").chain)) == ""


GOOD = "[mounting]\n" + "\n".join(f"delta_{key} = [0, 0, 0, 0, 0, 0]" for key in ("theta", "a", "d", "alpha")) + "\n"
WRONG = {
    "no section": ("delta_a = [0]\n", "calibration.conf"),
    "another section": ("[hardware]\na = 1\n", "[mounting]"),
    "a list is missing": (re.sub("delta_d.*\n", "", GOOD), "no delta_d"),
    "five numbers": (GOOD.replace("0, 0]", "0]", 1), "six finite numbers"),
    "no numbers": (GOOD.replace("[0, 0", "[a, 0", 1), "not a list of numbers"),
    "a call": (GOOD.replace("[0, 0, 0, 0, 0, 0]", "__import__('os')", 1), "not a list of numbers"),
    "not finite": (GOOD.replace("0, 0]", "0, 1e999]", 1), "six finite numbers"),
    "400 digits": (GOOD.replace("0, 0]", "0, " + "9" * 400 + "]", 1), "not a list of numbers"),
    "a list over two lines": (GOOD.replace("0, 0]", "0, 0]\n  and = more", 1), "not a list of numbers"),
    "millimetres": (GOOD.replace("delta_a = [0,", "delta_a = [425,"), "delta_a reaches"),
    "degrees": (GOOD.replace("delta_theta = [0,", "delta_theta = [90,"), "delta_theta reaches"),
}


@pytest.mark.parametrize("name", WRONG)
def test_wrong_corrections_are_told_in_one_line(name: str, tmp_path: Path) -> None:
    (tmp_path / "calibration.conf").write_text(WRONG[name][0])
    with pytest.raises(LabError) as error:
        read_table(ur5e_toml(tmp_path / "ur.toml", "calibration.conf"))
    assert WRONG[name][1] in str(error.value) and "\n" not in str(error.value)


@pytest.mark.parametrize(("old", "new"), [('"calibration.conf"', "3"), ('"distal"', '"craig"'), (".conf", ".none")])
def test_a_table_that_cannot_have_corrections_is_refused(old: str, new: str, tmp_path: Path) -> None:
    (tmp_path / "calibration.conf").write_text(GOOD)
    path = ur5e_toml(tmp_path / "ur.toml", "calibration.conf")
    path.write_text(path.read_text().replace(old, new, 1))
    with pytest.raises(LabError) as error:
        read_table(path)
    assert "\n" not in str(error.value)
