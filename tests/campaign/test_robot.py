"""Robots by name and by file, and what each kind can be described in."""

import numpy as np
import pytest

from lab.campaign.model_files import models_folder
from lab.campaign.robot import CLOSED_FORMATS, SERIAL_FORMATS, ClosedRobot, SerialRobot, load_robot, load_virtual
from lab.core.errors import LabError


@pytest.mark.parametrize(("name", "kind"), [("irb120", SerialRobot), ("scara", SerialRobot), ("rpr2", ClosedRobot)])
def test_a_robot_by_name_is_of_its_kind(name: str, kind: type) -> None:
    robot = load_robot(name)
    assert type(robot) is kind and robot.name and load_robot(robot) is robot
    formats = SERIAL_FORMATS if kind is SerialRobot else CLOSED_FORMATS
    assert 0 < len(robot.description_files) <= len(formats)
    arm = robot.arm(("p1",))
    joints = robot.chain.random_joints(3, np.random.default_rng(0))
    assert arm.points(joints, arm.nominal(robot.tool)).shape == (3, 1, 3)


def test_what_serial_arms_alone_have() -> None:
    robot = load_robot("irb120")
    assert robot.serial_arm(("p1",)).chain is robot.serial_model.chain
    with pytest.raises(LabError, match=r"loops|2-RPR"):
        load_robot("rpr2").serial_arm(("p1",))


def test_every_model_of_the_folder_is_found() -> None:
    folders = {path.name for path in models_folder().iterdir() if (path / "README.md").is_file()}
    with pytest.raises(LabError) as error:
        load_virtual("no such robot")
    assert all(name in str(error.value) for name in folders)


def test_a_target_that_the_robot_lacks() -> None:
    with pytest.raises(LabError, match="p9"):
        load_robot("irb120").refuse_unknown(("p1", "p9"))


@pytest.mark.parametrize(
    ("name", "says"),
    [
        (
            "arm.urdf.xacro",
            r"is a xacro; expand it first \(xacro \S*arm.urdf.xacro > \S*arm.urdf\), and give \S*arm.urdf$",
        ),
        ("arm.xacro", r"is a xacro; expand it first \(xacro \S*arm.xacro > \S*arm.urdf\), and give \S*arm.urdf$"),
        ("plan.csv", "neither MJCF, URDF nor TOML; there are"),
    ],
)
def test_a_file_that_is_there_is_not_denied(tmp_path, name: str, says: str) -> None:
    with pytest.raises(LabError, match="no such model or file"):
        load_robot(tmp_path / name)
    (tmp_path / name).touch()
    with pytest.raises(LabError, match=says):
        load_robot(tmp_path / name)
