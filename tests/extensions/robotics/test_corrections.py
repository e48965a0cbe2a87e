"""Corrections through q2 = 0, with the hand down, in a tilted plane, at singularities and at limits, by other means."""

import csv
import json
from pathlib import Path
from shutil import rmtree
from typing import Any

import numpy as np
import pytest
from beam_chain import BeamChain
from helpers.robots import chain_of
from scipy.optimize import brentq
from scipy.spatial.transform import Rotation

import lab
from lab.cli.main import main
from lab.core.se3 import Array
from lab.extensions.robotics.trajectory.path_errors import compensated
from lab.extensions.robotics.trajectory.trajectory_result import TrajectoryResult
from lab.kinematics.dynamics.gravity import LinkLoads, Loads, link_loads
from lab.kinematics.serial.serial_arm import SerialArm
from lab.simulation.elastic_links import JointMotion

COURSE = """id,x_mm,y_mm,z_mm,vx_mm_per_s,vy_mm_per_s,vz_mm_per_s
P0,866.0254037844386,0,0,,,
P1,0,1000,500,0,0,200
P2,866.0254037844386,0,1000,,,
"""  # Mallem 2011, section 10.3
SIX = "q1_deg,q2_deg,q3_deg,q4_deg,q5_deg,q6_deg\n"


def soft(folder: Path, robot: str, links: dict[int, float]) -> str:
    sections = "".join(f"[[link]]\nnumber = {n}\nei_nm2 = {ei:g}\ngj_nm2 = {ei:g}\n" for n, ei in links.items())
    (folder / "soft.toml").write_text(f"robot = '{robot}'\n{sections}")
    return str(folder / "soft.toml")


def moved(folder: Path, text: str, robot: str, payload_kg: float = 1.0, step_ms: float = 50.0) -> TrajectoryResult:
    (folder / "points.csv").write_text(text)
    options = {"robot": robot, "payload_kg": payload_kg, "step_ms": step_ms, "no_check": True}
    return lab.trajectory(folder / "points.csv", **options)


def written(folder: Path, text: str, robot: str) -> tuple[int, dict[str, Any], dict[str, list[str]]]:
    """Exit code, output and corrected.csv of the command."""
    (folder / "points.csv").write_text(text)
    arguments = ["--robot", robot, "--payload-kg", "1", "--step-ms", "10", "--no-check", "--no-recording"]
    code = main(["trajectory", str(folder / "points.csv"), *arguments, "--out", str(folder / "run")])
    with (folder / "run" / "corrected.csv").open() as file:
        header, *rows = csv.reader(file)
    return (
        code,
        json.loads((folder / "run" / "result.json").read_text()),
        dict(zip(header, map(list, zip(*rows, strict=True)), strict=True)),
    )


def written_over(folder: Path, text: str, robot: str) -> tuple[int, dict[str, Any], dict[str, list[str]]]:
    rmtree(folder / "run")
    return written(folder, text, robot)


def missed(found: TrajectoryResult, joints: Array, times: Array, payload_kg: float) -> tuple[Array, Array]:
    """Errors of the last frame of a chain of rigid pieces in motion, m and rad ``(k, 3)``, by three targets."""
    robot, at, names = found.robot, found.sampled, ("p1", "p2", "p3")
    assert robot.link_compliances is not None
    pieces = BeamChain(robot.serial_model.model, robot.serial_model, robot.link_compliances, 16)
    motion = JointMotion(at.speeds[times], at.accelerations[times])
    real = pieces.positions(joints[times], names, np.full(len(times), payload_kg), motion)
    arm = robot.serial_arm(names)
    T = robot.T_world_frame0
    wanted = arm.points(at.joints[times], arm.nominal(robot.tool)) @ T[:3, :3].T + T[:3, 3]
    turns = [
        Rotation.align_vectors(there - there.mean(axis=0), here - here.mean(axis=0))[0]
        for there, here in zip(real, wanted, strict=True)
    ]
    origins = at.Ts_base_tool[times, :3, 3] @ T[:3, :3].T + T[:3, 3]
    levers = np.array([turn.apply(lever) for turn, lever in zip(turns, origins - wanted.mean(axis=1), strict=True)])
    return real.mean(axis=1) + levers - origins, np.array([turn.as_rotvec() for turn in turns])


def test_the_course_s_arm_is_corrected_through_the_level(tmp_path: Path) -> None:
    """At rest q2 solves q2c - atan(droop / L) = q2; in motion a thousandth of the droop remains at most."""
    ei, L = 20_000.0, 1.0
    found = moved(tmp_path, COURSE, soft(tmp_path, "course2r", {2: ei}), step_ms=10)
    assert found.robot.loads is not None and found.tracking is not None and found.at_points is not None
    weight = 9.81 * float(found.robot.loads.mass_kg[1])
    beside = L / 2 + float(found.robot.loads.centre_m[1, 0])  # of the link's centre of mass from its middle
    droop = 9.81 * L**3 / (3 * ei) + weight * L**2 * (L / 8 + beside / 3) / ei  # of the level link
    expected = [
        brentq(lambda c, q=q: c - np.arctan2(droop * np.cos(c), L) - q, q - 0.1, q + 0.1)
        for q in np.deg2rad([-30.0, 0.0, 30.0])
    ]
    np.testing.assert_allclose(found.at_points.joints[:, 1], expected, atol=1e-8)
    np.testing.assert_allclose(found.at_points.joints[:, 0], np.deg2rad([0, 90, 0]), atol=1e-9)
    told = found.to_dict()["tracking"]
    assert told["error_mm"]["mean"] > 0.5 and told["left_mm"]["max"] < 1e-3 and found.exit_code == 0
    assert told["directions"] == {"position": 2, "rotation": 0} and not told["not_made_up_for"]
    assert "position in 2 of 3 directions" in " ".join(found.summary().split())
    assert told["left_deg"]["max"] > 0.01  # the slope of the link's end remains


def test_the_hand_down_is_corrected_in_its_vertical_plane(tmp_path: Path) -> None:
    """A chain of pieces in motion, q1 through 0: all but the rotation across the plane vanishes, by small moves."""
    joints = "q1_deg,q2_deg,q3_deg,q4_deg,q5_deg\n0,40,-60,-70,0\n0,60,-80,-70,20\n-90,60,-80,-70,0\n"
    found = moved(tmp_path, joints, soft(tmp_path, "scorbot", {2: 2000.0, 3: 2000.0}))
    assert found.tracking is not None and found.exit_code == 0
    corrected, at = found.tracking.corrected, found.sampled
    assert corrected.directions == (3, 2) and np.abs(corrected.joints - at.joints).max() < np.deg2rad(0.06)
    some = np.arange(0, len(at.times), 6)
    before, after = (missed(found, joints, some, 1.0) for joints in (at.joints, corrected.joints))
    assert np.linalg.norm(before[0], axis=1).mean() > 2e-4 > 2e-6 > np.linalg.norm(after[0], axis=1).max()
    # no joint turns the hand about the horizontal in the arm's plane: that part stays, and is as large as told
    q1 = at.joints[some, 0]
    across = np.stack([np.cos(q1), np.sin(q1), 0 * q1], axis=1)
    kept = (after[1] * across).sum(axis=1)
    np.testing.assert_allclose(kept, (corrected.left[some, 3:] * across).sum(axis=1), atol=2e-6)
    assert np.linalg.norm(after[1] - kept[:, None] * across, axis=1).max() < 2e-5 < np.abs(before[1]).max()


def plane(tilt: Array) -> tuple[SerialArm, Array, LinkLoads]:
    """Three links of 0.4 m in a plane, which is tilted with its base; gravity of the world in the axes of the base."""
    chain = chain_of("planar", "distal", "RRR", [0] * 3, [0.4] * 3, [0] * 3, [0] * 3)
    loads = Loads(chain, np.full(3, 2.0), np.tile([-0.2, 0.0, 0.0], (3, 1)), np.array([1.0, -9.7, 0.5]))
    arm = SerialArm(chain)
    values = arm.nominal({"p1": np.zeros(3)})
    values[3:6] = tilt
    return arm, values, link_loads(loads)


def test_a_tilted_planar_arm_is_corrected_as_one_that_is_not(tmp_path: Path) -> None:
    """The plane may lie in any axes: the joints are the same, and the position in the plane and the turn are right."""
    section, joints = 1e2 * np.array([2.067e-5, 2.067e-5, 2.79e-5, 0.0]), np.deg2rad([[20.0, 60, -30], [-80, 40, 70]])
    found = []
    for tilt in ([0.0, 0.0, 0.0], [0.7, -0.4, 0.2], [0.0, np.pi / 2, 0.0]):
        arm, values, links = plane(np.array(tilt))

        def at(q: Array, arm: SerialArm = arm, values: Array = values, links: LinkLoads = links) -> tuple[Array, Array]:
            loads = links.at_rest(q, np.ones(len(q)))
            return arm.tool(q, values, 0, {j: links.beams[j].torsor(loads[:, j], section) for j in range(3)})

        done = compensated(lambda q, arm=arm, values=values: arm.tool(q, values), joints, at, arm.chain)
        R = arm.tool(joints, values)[0][0, :3, :3] @ arm.tool(joints, arm.nominal())[0][0, :3, :3].T  # of the base
        reached = at(done.joints)[0]
        flat = reached[:, :3, 3] @ R, R.T @ reached[:, :3, :3]
        angles = np.cumsum(joints, axis=1)
        wanted = 0.4 * np.stack([np.cos(angles).sum(axis=1), np.sin(angles).sum(axis=1)], axis=1)
        np.testing.assert_allclose(flat[0][:, :2], wanted, atol=1e-11)
        normal = Rotation.from_matrix(flat[1] @ Rotation.from_euler("z", -angles[:, 2:]).as_matrix()).as_rotvec()
        assert np.abs(normal[:, 2]).max() < 1e-11 and done.complete.all() and done.directions == (2, 1)
        found.append(done.joints)
    assert np.abs(found[0] - joints).max() > 1e-3
    np.testing.assert_allclose(found[1:], [found[0]] * 2, atol=1e-10)


def test_a_singular_time_is_reported_with_what_remains(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Joint 5 passes 0: the position is right, a rotation remains, and no joint swings there; exit code 1."""
    robot = soft(tmp_path, "irb120", {2: 5e4, 4: 5e4})
    code, told, cells = written(tmp_path, SIX + "0,20,0,10,-9,0\n40,40,-20,30,9,0\n", robot)
    capsys.readouterr()
    reasons = cells["incomplete"]
    assert code == 1 and set(reasons) == {"", "singular"} and told["program"] == "program.mod"
    assert told["tracking"]["incomplete"] == {"singular": reasons.count("singular")}
    assert any("the correction is incomplete: singular; up to 0.0" in each for each in told["warnings"])
    at = np.array([reason == "singular" for reason in reasons])
    left = {name: np.array(cells[name], dtype=float) for name in cells if name.startswith("left_")}
    assert max(np.abs(left[f"left_{axis}_mm"]).max() for axis in "xyz") < 1e-7
    turns = np.linalg.norm([left[f"left_r{axis}_deg"] for axis in "xyz"], axis=0)
    assert turns[at].min() > 1e-4 > 1e-7 > turns[~at].max() and told["tracking"]["left_deg"]["max"] == turns.max()
    q4 = np.array(cells["q4_deg"], dtype=float)
    with (tmp_path / "run" / "trajectory.csv").open() as file:
        commanded = np.array([row["q4_deg"] for row in csv.DictReader(file)], dtype=float)
    assert np.abs(q4 - commanded).max() < 0.1
    exact = written_over(tmp_path, SIX + "0,20,0,0,0,0\n40,40,-20,30,20,0\n", robot)
    assert exact[0] == 1 and exact[1]["tracking"]["incomplete_points"] == ["0"] and exact[1]["program"] is None
    assert "no program is written: the correction is incomplete at 0" in exact[1]["no_program"]
    assert not (tmp_path / "run" / "program.mod").exists()
    capsys.readouterr()


def test_no_joint_passes_its_limit(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Beyond joint 3's limit lies the sag's correction: it stays, others correct the position, a rotation remains."""
    robot = soft(tmp_path, "irb120", {2: 5e4, 4: 5e4})
    code, told, cells = written(tmp_path, SIX + "0,60,-110,0,40,0\n10,60,-110,0,40,0\n10,60,-100,0,40,0\n", robot)
    capsys.readouterr()
    q3, reasons = np.array(cells["q3_deg"], dtype=float), cells["incomplete"]
    assert code == 1 and q3.min() == -110 and reasons[0] == "limit of q3" and reasons[-1] == ""
    at_limit = np.array([reason == "limit of q3" for reason in reasons])
    assert at_limit.sum() > 10 and (q3[at_limit] == -110).all()
    left = {
        unit: np.linalg.norm([np.array(cells[f"left_{part}{axis}_{unit}"], dtype=float) for axis in "xyz"], axis=0)
        for unit, part in (("mm", ""), ("deg", "r"))
    }
    assert left["mm"].max() < 1e-7 and left["deg"][at_limit].min() > 1e-4 > 1e-7 > left["deg"][~at_limit].max()
    assert told["tracking"]["left_deg"]["max"] == pytest.approx(left["deg"].max()) and told["program"] is None
