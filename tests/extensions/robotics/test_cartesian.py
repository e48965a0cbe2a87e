"""Lines and circles of the tool: where it is meant to be at every time, within all limits, no slower than needed."""

from dataclasses import replace

import numpy as np
import pytest

from lab.core import se3
from lab.core.errors import LabError
from lab.extensions.robotics.trajectory.cartesian import Feed, arc, line, path_move
from lab.extensions.robotics.trajectory.motion import Motion
from lab.kinematics.trajectory.trajectory import common_phases, independent
from lab.pose_selection.tour import rated
from lab.robots.load_robot import load_robot

STARTS = {"irb120": np.radians([0, 20, -30, 10, 60, 0]), "scara": np.array([0.3, 1, -0.05, 0]), "delta": np.zeros(3)}


def set_up(name: str):
    robot = load_robot(name)
    arm = robot.arm(("p1",))
    values = arm.nominal({"p1": np.array([0.01, 0.0, 0.02])})
    start = STARTS[name]
    Ts = arm.tool(np.stack([start, start + 0.2 * np.where(robot.chain.prismatic, 0.1, 1.0)]), values)[0]
    return arm, values, rated(robot.chain)[0], start, Ts


@pytest.mark.parametrize("name", STARTS)
@pytest.mark.parametrize("circle", [False, True])
def test_the_tool_keeps_to_its_path_and_the_joints_to_their_limits(name: str, circle: bool) -> None:
    arm, values, chain, start, (T0, T1) = set_up(name)
    middle = (T0[:3, 3] + T1[:3, 3]) / 2
    via = middle + (np.array([0, 0.01, 0.0]) if name == "scara" else np.array([0, 0.01, 0.02]))
    path = arc(T0, via, T1) if circle else line(T0, T1)
    move = path_move(arm, values, chain, path, start, Feed(0.25, 2.0, 1.0, 5.0))
    times = np.linspace(0, move.seconds, 400)
    joints, speeds, accelerations = move.at(times)
    s, pace, _ = move.along(times)
    np.testing.assert_allclose(arm.tool(joints, values)[0], path.poses(s), atol=1e-9)
    np.testing.assert_allclose(path.poses(np.array([0.0, 1.0])), [T0, T1], atol=1e-12)
    assert (np.abs(speeds) <= chain.speed).all() and (np.abs(accelerations) <= chain.acceleration * (1 + 1e-6)).all()
    assert (pace * path.length_m <= 0.25 * (1 + 1e-12)).all()
    assert not np.any(speeds[[0, -1]]) and np.abs(joints[0] - start).max() < 1e-9
    np.testing.assert_allclose(np.gradient(joints, times, axis=0)[2:-2], speeds[2:-2], atol=6e-3)
    if circle:
        off = np.linalg.norm(path.poses(np.linspace(0, 1, 20_001))[:, :3, 3] - via, axis=1)
        assert off.min() < 1e-4 * path.length_m  # it passes the point


def test_without_a_feed_the_joints_are_the_limit_and_one_reaches_it() -> None:
    arm, values, chain, start, (T0, T1) = set_up("irb120")
    move = path_move(arm, values, chain, line(T0, T1), start, Feed())
    used = [peak / most for peak, most in zip(move.peaks, (chain.speed, chain.acceleration), strict=True)]
    assert 0.97 < max(part.max() for part in used) <= 1 + 1e-9
    slower = replace(chain, acceleration=chain.acceleration / 4)
    again = path_move(arm, values, slower, line(T0, T1), start, Feed())
    assert 1.8 < again.seconds / move.seconds <= 2.0 + 1e-9  # of a path that never reaches a speed limit


def test_paths_that_cannot_be_are_refused() -> None:
    arm, values, chain, start, (T0, T1) = set_up("irb120")
    far = T1.copy()
    far[:3, 3] += 2.0
    with pytest.raises(LabError, match="cannot follow the path beyond"):
        path_move(arm, values, chain, line(T0, far), start, Feed())
    with pytest.raises(LabError, match="the same"):
        path_move(arm, values, chain, line(T0, T0), start, Feed())
    with pytest.raises(LabError, match="on a line"):
        arc(T0, (T0[:3, 3] + T1[:3, 3]) / 2, T1)
    narrow = replace(chain, upper=np.where(np.arange(6) == 1, start[1] + 0.05, chain.upper))
    with pytest.raises(LabError, match=r"of the path joint q2 is at .* beyond its limits"):
        path_move(arm, values, narrow, line(T0, T1), start, Feed())


def test_a_motion_is_its_moves_one_after_the_other() -> None:
    arm, values, chain, start, (T0, T1) = set_up("irb120")
    first = path_move(arm, values, chain, line(T0, T1), start, Feed())
    second = common_phases(chain, first.end, start)
    motion = Motion([first, second])
    assert motion.seconds == pytest.approx(first.seconds + second.seconds)
    times = motion.times(0.01)
    assert times[-1] == motion.seconds and np.diff(times).max() < 0.01 + 1e-12
    joints, speeds, _ = motion.at(times)
    assert np.abs(np.diff(joints, axis=0)).max() < 0.01 * chain.speed.max()
    np.testing.assert_allclose(joints[[0, -1]], [start, start], atol=1e-9)
    assert (np.abs(speeds) <= motion.peaks[0] + 1e-9).all()


def test_joints_that_are_not_synchronised_stop_as_soon_as_they_can() -> None:
    chain = rated(load_robot("irb120").chain)[0]
    start, end = np.zeros(6), np.array([1.0, 0.5, -0.2, 0.0, 0.1, 2.0])
    found = independent(chain, start, end)
    np.testing.assert_allclose([found.end, found.end_speed], [end, np.zeros(6)], atol=1e-12)
    alone = []
    for j in range(6):
        only = np.where(np.arange(6) == j, end, 0.0)
        alone.append(common_phases(chain, start, only).seconds if end[j] else 0.0)
    assert found.seconds == pytest.approx(max(alone))
    for j, seconds in enumerate(alone):
        assert abs(found.at(np.array([seconds]))[0][0, j] - end[j]) < 1e-12
        assert end[j] == 0 or abs(found.at(np.array([0.98 * seconds]))[0][0, j] - end[j]) > 1e-6
    with pytest.raises(LabError, match="from rest to rest"):
        independent(chain, start, end, np.full(6, 0.1))


def test_a_line_through_a_singularity_is_refused_with_its_place_and_one_beside_it_is_not() -> None:
    """Axis 5 of a spherical wrist passes zero, where axes 4 and 6 would have to turn at once."""
    arm, values, chain, *_ = set_up("irb120")
    start = np.radians([0, 20, -30, 0, 25, 0])
    T0 = arm.tool(start[None], values)[0][0]
    for turn, refused in ((np.array([0.02, 0.9, 0.0]), True), (np.array([0.9, 0.1, 0.0]), False)):
        T1 = se3.pose(se3.exp(-turn) @ T0[:3, :3], T0[:3, 3] + [0.0, 0.0, 0.02])
        if not refused:
            assert path_move(arm, values, chain, line(T0, T1), start, Feed()).seconds > 0
            continue
        with pytest.raises(
            LabError, match=r"beyond \d+% of it, at x, y, z = .* mm: it passes a singularity there; move"
        ):
            path_move(arm, values, chain, line(T0, T1), start, Feed())
