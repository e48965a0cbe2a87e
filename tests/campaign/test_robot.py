"""Kinds of robots: each says which arm it is, what it refuses, and which files describe it."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from lab.campaign.robot import ClosedRobot, SerialRobot, load_robot
from lab.core.errors import LabError
from lab.simulation.true_robot import GeometryErrors

SERIAL, CLOSED = load_robot("irb120"), load_robot("rpr2")


def test_a_robot_is_of_the_kind_that_its_file_describes() -> None:
    assert isinstance(SERIAL, SerialRobot) and isinstance(CLOSED, ClosedRobot)
    for robot in (SERIAL, CLOSED):
        arm = robot.arm(("p1",))
        assert arm.chain is robot.chain and arm.rigid is arm and arm.groups == ()


def test_what_is_for_serial_arms_alone_is_refused_in_one_line() -> None:
    assert SERIAL.serial_model is SERIAL.model
    with pytest.raises(LabError, match=r"robot .* has loops") as refused:
        CLOSED.serial_arm(("p1",))
    assert "\n" not in str(refused.value)
    with pytest.raises(LabError, match=r"--model compliance: .* has loops"):
        CLOSED.arm_with(("p1",), ["gear", "compliance"])
    rng = np.random.default_rng(0)
    with pytest.raises(LabError, match="--dh-only"):
        CLOSED.perturbed(GeometryErrors(1e-4, 1e-4, table_alone=True), np.eye(4), rng)


@pytest.mark.parametrize("robot", [SERIAL, CLOSED], ids=["serial", "closed"])
def test_every_file_describes_the_parameters_that_it_was_given(robot, tmp_path: Path) -> None:
    """What is written is read again as a robot of the same kind, whose nominal targets are the given ones."""
    arm = robot.arm(("p1",))
    values = arm.nominal(robot.tool) + 1e-4 * np.random.default_rng(1).standard_normal(len(arm.names))
    joints = robot.chain.random_joints(20, np.random.default_rng(2))
    assert robot.exact_file == "calibrated.toml"
    file = tmp_path / robot.exact_file
    file.write_text(robot.description(robot.exact_file, arm.targets, values), encoding="utf-8")
    again = load_robot(str(file))
    assert type(again) is type(robot)
    same = again.arm(("p1",)).nominal(again.tool)
    same[:6] = values[:6]
    np.testing.assert_allclose(again.arm(("p1",)).points(joints, same), arm.points(joints, values), atol=1e-14, rtol=0)


def test_a_run_keeps_the_format_that_the_robot_was_given_in() -> None:
    assert SERIAL.kept_file == "calibrated.xml" and CLOSED.kept_file == "calibrated.toml"
    as_table = replace(SERIAL, model=replace(SERIAL.model, path=Path("arm.toml")))
    assert as_table.kept_file == as_table.exact_file == "calibrated.toml"
    assert SERIAL.description_files == ("calibrated.xml", "calibrated.urdf", "calibrated.toml")


@pytest.mark.parametrize("robot", [SERIAL, CLOSED], ids=["serial", "closed"])
def test_a_perturbed_robot_stands_before_its_tracker(robot) -> None:
    """Points in the tracker's frame, moved by ``T_world_tracker``, are where the MuJoCo world has the sites."""
    T = robot.model.T_world_tracker.copy()
    T[:3, 3] += (0.1, -0.05, 0.02)
    none = GeometryErrors(0.0, 0.0)
    real = robot.perturbed(none, T, np.random.default_rng(0))
    arm, joints = robot.arm(("p1",)), robot.chain.random_joints(10, np.random.default_rng(3))
    points = arm.points(joints, arm.nominal(robot.tool))  # in frame 0
    in_world = points @ robot.T_world_frame0[:3, :3].T + robot.T_world_frame0[:3, 3]
    seen = real.points(joints, ("p1",)) @ real.T_world_tracker[:3, :3].T + real.T_world_tracker[:3, 3]
    np.testing.assert_allclose(seen, in_world, atol=1e-9, rtol=0)
