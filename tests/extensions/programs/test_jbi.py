"""Jobs for Yaskawa's controllers, read back by a parser of the test's own and held against MuJoCo's arm."""

import re
from dataclasses import replace

import mujoco
import numpy as np
import pytest
from helpers.robots import IRB120
from scipy.spatial.transform import Rotation

from lab.core import se3
from lab.core.se3 import Array
from lab.extensions.programs.jbi import Jbi
from lab.formats.programs.program_text import ArmShape, postures_of
from lab.formats.programs.protocol import PAUSE_S, MeasuringTour, TargetMoves
from lab.kinematics.inverse.branches import NominalInverse
from lab.kinematics.inverse.newton_inverse import PoseTarget

ARM = IRB120.arm(("p1",))
VALUES = ARM.nominal(IRB120.tool)
WAYPOINTS = np.concatenate([np.zeros((1, 6)), np.random.default_rng(3).uniform(-1.5, 1.5, (6, 6)), np.zeros((1, 6))])


def poses_in(job: str) -> tuple[Array, list[str]]:
    """Poses ``(n, 4, 4)`` (m) in the order of the moves, by SciPy's rotations, and the configuration of each."""
    stored, configurations, current = {}, {}, ""
    for line in job.splitlines():
        if line.startswith("///RCONF "):
            current = line.removeprefix("///RCONF ")
        if found := re.fullmatch(r"(C\d{5})=(-?\d+\.\d{3},){3}(-?\d+\.\d{4},){2}-?\d+\.\d{4}", line):
            stored[found[1]] = [float(each) for each in line.split("=")[1].split(",")]
            configurations[found[1]] = current
    order = re.findall(r"^MOVJ (C\d{5}) VJ=20.00$", job, re.MULTILINE)
    assert re.search(r"^///NPOS (\d+),0,0,0,0,0$", job, re.MULTILINE)[1] == str(len(stored))
    rows = np.array([stored[each] for each in order])
    turns = Rotation.from_euler("xyz", rows[:, 3:], degrees=True).as_matrix()
    return se3.pose(turns, rows[:, :3] / 1e3), [configurations[each] for each in order]


def text(content: bytes) -> str:
    assert content.count(b"\n") == content.count(b"\r\n")
    return content.decode("ascii").replace("\r\n", "\n")


def flange_in_mujoco(joints: Array) -> Array:
    """Poses of the flange in the table's frame 0, by the model in MuJoCo alone."""
    model = IRB120.model.model
    data, T_world_frame0 = mujoco.MjData(model), IRB120.model.T_world_frame0
    found = []
    for row in joints:
        data.qpos[:] = row
        mujoco.mj_kinematics(model, data)
        site = data.site("flange")
        T = se3.pose(site.xmat.reshape(3, 3), site.xpos)
        found.append(se3.inverse(T_world_frame0) @ T)
    return np.array(found)


def test_a_tour_goes_to_the_flanges_places_and_waits() -> None:
    tour = MeasuringTour("arm", WAYPOINTS, np.array([-1, 0, 1, -1, 2, 3, 4, -1]), tuple("56789"),
                         postures=postures_of(ARM, VALUES, WAYPOINTS))  # fmt: skip
    job = text(Jbi().measuring_tour(tour))
    found, _ = poses_in(job)
    expected = flange_in_mujoco(WAYPOINTS)
    offset = se3.inverse(expected[0]) @ found[0]  # MuJoCo's flange is fixed in the table's last frame
    np.testing.assert_allclose(found, expected @ offset, atol=3e-6)
    assert [float(each) for each in re.findall(r"^TIMER T=(.*)$", job, re.MULTILINE)] == [PAUSE_S] * 5
    assert "///TOOL 0\n///POSTYPE ROBOT\n///RECTAN\n" in job and job.startswith("/JOB\n//NAME PLAN\n")
    assert "NOT CHECKED" not in job
    unchecked = replace(tour, checked=False)
    assert "NOT CHECKED FOR COLLISIONS" in text(Jbi().measuring_tour(unchecked)).replace("\n'", " ")


@pytest.mark.parametrize("turn", [[0.3, -1.2, 0.7], [0, 0, np.pi], [0, np.pi / 2, 0], [np.pi, 0, 0]])
def test_targets_are_of_tool_1_in_user_frame_1(turn: list[float]) -> None:
    """Tool times place times frame, as the controller multiplies them; half turns and gimbal lock too."""
    T_tool = se3.pose(Rotation.from_rotvec(turn).as_matrix(), np.array([0.03, -0.02, 0.1]))
    T_frame = se3.pose(Rotation.from_rotvec([0.2, 0.1, np.pi / 2]).as_matrix(), np.array([-1.6, 1.3, -1.1]))
    postures = postures_of(ARM, VALUES, WAYPOINTS)
    assert postures is not None
    which = np.array([-1, 0, 1, 2, 3, 4, 5, -1])
    job = text(Jbi().target_moves(TargetMoves("ß", tuple("abcdef"), WAYPOINTS, which, T_tool, T_frame, True, postures)))
    found, _ = poses_in(job)
    frames = []
    for kind in ("TOOL", "USER"):
        values = [float(re.search(rf"^'{kind} 1 {key} (\S+)$", job, re.MULTILINE)[1])
                  for key in ("X", "Y", "Z", "RX", "RY", "RZ")]  # fmt: skip
        R = Rotation.from_euler("xyz", values[3:], degrees=True).as_matrix()
        frames.append(se3.pose(R, np.array(values[:3]) / 1e3))
    np.testing.assert_allclose(frames[1] @ found @ se3.inverse(frames[0]), postures.Ts_frame0_last, atol=8e-6)
    assert "///USER 1\n///TOOL 1\n///POSTYPE USER\n" in job and all(len(each) <= 33 for each in re.findall("'.*", job))


def test_a_configuration_names_one_of_the_inverses_solutions() -> None:
    """All solutions of a pose differ in flip, elbow or side; home is upper, in front, not flipped."""
    shape, inverse = ArmShape.of(ARM.dh_chain(VALUES)), NominalInverse(ARM, VALUES)
    for joints in np.random.default_rng(5).uniform(-1.2, 1.2, (20, 6)):
        T = inverse.tool(joints[None])[0]
        ways = inverse.solutions(PoseTarget(T[:, :3, 3], T[:, :3, :3]), joints[None])
        some = ways.joints[0][ways.gap_m[0] == 0]
        flipped = np.abs(some[:, 3]) > np.pi / 2
        seen = set(zip(shape.in_front(some), shape.elbow_up(some), flipped, strict=True))
        assert len(seen) == len(some) >= 4
    assert shape.in_front(np.zeros((1, 6))).all() and shape.elbow_up(np.zeros((1, 6))).all()
    backward = np.array([[0, -1.5, 0, 0, 0, 0.0]])
    assert not shape.in_front(backward).any() and shape.elbow_up(backward).all()


def test_the_configuration_is_said_where_it_changes() -> None:
    stops = np.array(
        [[0, 0, 0, 0, 0.5, 0], [0, -1.5, 0, 0, 0.5, 0], [0, 0, 0, 3.3, 0.5, -3.2], [-3.2, 0, 0, 1, 0.5, 0]]
    )
    moves = TargetMoves("arm", tuple("abcd"), stops, np.arange(4), np.eye(4), np.eye(4),
                        postures=postures_of(ARM, VALUES, stops))  # fmt: skip
    _, configurations = poses_in(text(Jbi().target_moves(moves)))
    assert configurations == ["0,0,0,0,0,0,0,0", "0,0,1,0,0,0,0,0", "1,0,0,1,1,0,0,0", "0,0,0,0,0,1,0,0"]
