"""The equations of a robot that are read without the simulator are those of the robot that is loaded whole."""

from pathlib import Path

import numpy as np
import pytest

from lab.core.errors import LabError
from lab.extensions.robotics.kinematics.nominal_models import nominal_robot
from lab.robots.load_robot import load_robot


@pytest.mark.parametrize("name", ["scorbot", "irb120", "rrr3"])
def test_it_is_the_robot_that_is_loaded(name: str) -> None:
    nominal, whole = nominal_robot(name), load_robot(name)
    arm, other = nominal.arm(("p1",)), whole.arm(("p1",))
    joints = whole.chain.home[None]
    assert (nominal.name, nominal.sha256, nominal.source) == (whole.name, whole.sha256, whole.source)
    assert nominal.chain.joint_names == whole.chain.joint_names
    np.testing.assert_array_equal(arm.tool(joints, arm.nominal())[0], other.tool(joints, other.nominal())[0])
    assert nominal.whole.model.chain.joint_names == whole.chain.joint_names


def test_a_robot_with_links_of_another_is_loaded_whole(tmp_path: Path) -> None:
    path = tmp_path / "elastic.toml"
    path.write_text('robot = "irb120"\n' + '[[link]]\nlength_mm = 300\nmaterial = "steel"\n' * 6)
    with pytest.raises(LabError, match="link"):
        nominal_robot(path)
    whole = load_robot("scorbot")
    assert nominal_robot(whole).whole is whole


def test_there_is_no_such_robot() -> None:
    with pytest.raises(LabError, match="no such model or file; there are"):
        nominal_robot("nobody")
