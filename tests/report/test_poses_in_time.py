"""Recordings in time: two poses a second, and the arm on its way between them."""

import numpy as np
import pytest
import rerun as rr
from helpers.recordings import FLOAT32, column

from lab.report.recording import TIME, draw_legs, draw_moves, draw_shells, moves_between, pose_times, recording_to
from lab.report.scene import world_legs
from lab.robots.load_robot import load_robot
from lab.simulation.meshes import body_poses, shells


@pytest.mark.parametrize("name", ["scara", "delta"])
def test_the_arm_moves_as_its_joints_do(name: str) -> None:
    """It starts and ends at the poses without a speed, in time, and only where it can be assembled."""
    arm = load_robot(name).arm(("p1",))
    numbers, joints = np.array([0, 1, 4]), arm.chain.random_joints(3, np.random.default_rng(1))
    seconds, between = moves_between(arm, numbers, joints)
    assert (np.diff(seconds) > 0).all() and arm.chain.is_assemblable(between).all()
    second = (seconds > 0.5) & (seconds < 2.0)
    assert seconds[second].min() > 2.0 - 0.5  # it stands where nothing is drawn in between
    share = (between[second] - joints[1]) / (joints[2] - joints[1])
    np.testing.assert_allclose(share, share[:, :1] * np.ones(arm.chain.size), atol=1e-9)
    assert (np.diff(share[:, 0]) > 0).all() and 0 < share[0, 0] < 0.03 and 0.97 < share[-1, 0] < 1
    np.testing.assert_allclose(share[:, 0] + share[::-1, 0], 1, atol=1e-12)


def test_bodies_and_rods_are_drawn_on_the_way(tmp_path) -> None:
    """Of a mechanism the loops stay closed: what is drawn is the mechanism at the joints' positions."""
    robot = load_robot("delta")
    arm, model = robot.arm(("p1",)), robot.model
    values = arm.nominal({"p1": np.array([0.0, 0.0, 0.05])})
    numbers, joints = np.arange(3), arm.chain.random_joints(3, np.random.default_rng(2))
    path = tmp_path / "moves.rrd"
    with recording_to(path, robot.name, "0" * 32) as recording:
        draw_shells(recording, pose_times(numbers), shells(model), body_poses(model, arm, values, joints))
        draw_legs(recording, pose_times(numbers), world_legs(model.T_world_frame0, arm, values, joints), 1.0)
        draw_moves(recording, model, arm, values, numbers, joints)
    seconds, between = moves_between(arm, numbers, joints)
    times, places = column(path, "/world/arm/platform", "Transform3D:translation", TIME)
    assert len(times) == len(seconds) + 3
    expected = body_poses(model, arm, values, between)["platform"][:, :3, 3]
    read = np.array([place[0] for time, place in zip(times, places, strict=True) if time % 500_000_000])
    np.testing.assert_allclose(read, expected, rtol=0, atol=4 * FLOAT32)
    assert len(column(path, "/world/arm/rods_and_legs", "LineStrips3D:strips", TIME)[0]) == len(times)
    assert column(path, "/world/arm/platform", "Transform3D:translation")[0] == [0, 1, 2]
    assert isinstance(pose_times(numbers)[1], rr.TimeColumn)
