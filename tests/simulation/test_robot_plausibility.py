"""Descriptions in wrong units are warned of; arms as people build them are not."""

from pathlib import Path

import numpy as np
import pytest

from lab.robots.load_robot import load_robot, load_virtual
from lab.simulation.robot_plausibility import implausible_robot

URDF = """<robot name="arm">
  <link name="base"/><link name="upper"/><link name="lower"/>
  <joint name="axis1" type="revolute"><parent link="base"/><child link="upper"/><origin xyz="0 0 {high}"/>
    <axis xyz="0 0 1"/><limit lower="-{far}" upper="{far}" velocity="2.5" effort="100"{more}/></joint>
  <joint name="axis2" type="revolute"><parent link="upper"/><child link="lower"/><origin xyz="{long} 0 0"/>
    <axis xyz="0 1 0"/><limit lower="-2" upper="2" velocity="2.5" effort="100"{more}/></joint>
</robot>
"""


def loaded(folder: Path, high: float, long: float, far: float, more: str = ""):
    path = folder / "arm.urdf"
    path.write_text(URDF.format(high=high, long=long, far=far, more=more))
    return load_robot(str(path))


@pytest.mark.parametrize(
    ("lengths", "far", "words"),
    [
        ((0.25, 0.45), 170, "limits that look like degrees, of axis1 (±9,740°)"),
        ((0.25, 0.45), 30, "limits that look like degrees, of axis1 (±1,719°)"),
        ((250, 450), 2.9, " m from its base; a URDF or an MJCF has lengths in m: divide"),
        ((0.00025, 0.00045), 2.9, "the arm reaches 0.5"),
        ((0.25, 0.45), 2.9, ""),
        ((0.25, 0.45), 12.6, ""),  # two turns either way
        ((2.0, 9.0), 2.9, ""),
        ((0.02, 0.05), 2.9, ""),
    ],
)
def test_a_description_in_another_unit_is_doubted(
    lengths: tuple[float, float], far: float, words: str, tmp_path: Path
) -> None:
    robot = loaded(tmp_path, *lengths, far)
    doubts = [each for each in robot.warnings if "degrees" in each or "from its base" in each]
    assert (words in doubts[0] if words else not doubts) and all("arm.urdf" in each for each in doubts)


def test_no_robot_of_the_lab_is_doubted() -> None:
    for name in ("irb120", "torso", "rail", "ur5", "panda"):
        assert not [each for each in load_virtual(name).warnings if "from its base" in each or "look like" in each]


def test_each_tip_is_looked_at_and_told_once(tmp_path: Path) -> None:
    chain = loaded(tmp_path, 250, 450, 2.9).chain
    (doubt,) = implausible_robot((chain, chain), "two.urdf")
    assert doubt.startswith("two.urdf: the arm reaches ") and not implausible_robot((), "none.urdf")


def test_a_urdf_gives_accelerations(tmp_path: Path) -> None:
    robot = loaded(tmp_path, 0.25, 0.45, 2.9, ' acceleration="10"')
    np.testing.assert_array_equal(robot.chain.acceleration, [10.0, 10.0])
    assert np.isnan(loaded(tmp_path, 0.25, 0.45, 2.9, ' acceleration="0"').chain.acceleration).all()
