"""``lab trajectory``: the course's example by a command, every kind of move, and what is refused."""

import csv
import json
import re
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import lab
from lab.cli.main import main
from lab.core import se3
from lab.core.errors import LabError
from lab.extensions.robotics.trajectory.trajectory_document import page_scene, tool_speeds
from lab.extensions.robotics.trajectory.trajectory_result import path_moves
from lab.formats.programs.languages import languages, path_program
from lab.simulation.elastic_links import FlexibleArm, JointMotion

EXAMPLE = """id,x_mm,y_mm,z_mm,vx_mm_per_s,vy_mm_per_s,vz_mm_per_s
P0,866.0254037844386,0,0,,,
P1,0,1000,500,0,0,200
P2,866.0254037844386,0,1000,,,
"""  # Mallem 2011, section 10.3
SWING = "q1_deg,q2_deg,q3_deg,q4_deg,q5_deg,q6_deg\n0,20,0,0,40,0\n40,40,-20,30,60,0\n"
SQUARE = """id,move,x_mm,y_mm,z_mm,qw,qx,qy,qz
start,joint,300,-100,400,0,0,1,0
a,line,400,-100,400,0,0,1,0
c,via,450,0,400,,,,
d,circle,400,100,400,0,0.0871557,0.9961947,0
e,joint,300,-100,400,0,0,1,0
"""


def run(capsys, folder: Path, text: str, *arguments: str) -> tuple[int, dict, str]:
    file = folder / "points.csv"
    file.write_text(text)
    code = main(["trajectory", str(file), *arguments, "--json", "--out", str(folder / "run")])
    said = capsys.readouterr()
    return code, json.loads(said.out) if said.out else {}, said.err


def table(folder: Path) -> dict[str, np.ndarray]:
    with (folder / "run" / "trajectory.csv").open() as file:
        header, *rows = csv.reader(file)
    return dict(zip(header, np.array(rows, dtype=float).T, strict=True))


def test_the_course_s_example(tmp_path, capsys) -> None:
    code, seen, error = run(capsys, tmp_path, EXAMPLE, "--robot", "course2r")
    assert code == 0 and not error and seen["seconds"] == pytest.approx(5.36656, abs=5e-6)
    assert [leg["seconds"] for leg in seen["legs"]] == pytest.approx([2 * 1.34164] * 2, abs=1e-5)
    assert seen["peak_speeds"][0] == pytest.approx(67.08, abs=5e-3)
    assert seen["peak_accelerations"] == pytest.approx([50, 12.3961], abs=5e-5)
    np.testing.assert_allclose(seen["legs"][0]["stops"], [[0, -30], [90, 0]], atol=1e-6)
    found = table(tmp_path)
    at = int(np.argmin(np.abs(found["time_s"] - seen["seconds"] / 2)))
    assert found["q1_deg"][at] == pytest.approx(90, abs=0.01) and found["tool_y_mm"].max() == pytest.approx(
        1000, abs=0.1
    )
    assert found["speed_q2_deg_per_s"][at] == pytest.approx(11.459, abs=0.06)  # half a row before or after


def test_the_joint_that_constrains_a_move_is_named(tmp_path, capsys) -> None:
    """Own triangles and trapezoids by hand: 10.3's example, then axes of which each constrains another phase."""
    _, seen, _ = run(capsys, tmp_path, EXAMPLE, "--robot", "course2r")
    passed = np.rad2deg(0.2)  # q2 rises at P1 by 0.2 m/s on 1 m
    peak = np.sqrt(50 * 30 + passed**2 / 2)
    for leg, phases in zip(seen["legs"], ([peak, peak - passed], [peak - passed, peak]), strict=True):
        assert leg["constrained_by"] == "q1" and leg["phases_constrained_by"] == ["q1", None, "q1"]
        np.testing.assert_allclose(leg["own_phases"][0], [np.sqrt(90 / 50), 0, np.sqrt(90 / 50)], atol=1e-6)
        np.testing.assert_allclose(leg["own_phases"][1], [phases[0] / 50, 0, phases[1] / 50], atol=1e-5)
    limits = ["--speeds", "20,100", "--accelerations", "100,50", "--overwrite"]
    _, seen, _ = run(capsys, tmp_path, "q1_deg,q2_deg\n0,0\n60,40\n60,0\n0,0\n0,0\n", "--robot", "course2r", *limits)
    first, second, _, still = seen["legs"]
    assert first["constrained_by"] == "q1" and first["phases_constrained_by"] == ["q2", "q1", "q2"]
    np.testing.assert_allclose(first["own_phases"], [[0.2, 2.8, 0.2], [np.sqrt(0.8), 0, np.sqrt(0.8)]], atol=1e-9)
    assert second["constrained_by"] == "q2" and second["own_phases"][0] == [0, 0, 0] and still["constrained_by"] is None
    shown = lab.trajectory(tmp_path / "points.csv", robot="course2r", law="independent")
    assert "constrained by" in str(shown) and "q1 (q1, –, q1)" in str(shown)
    _, seen, _ = run(capsys, tmp_path, SQUARE, "--overwrite")
    assert [leg["constrained_by"] is None for leg in seen["legs"]] == [True, True, False]


def test_the_laws_of_joint_moves_differ_as_they_should(tmp_path) -> None:
    file = tmp_path / "points.csv"
    file.write_text("q1_deg,q2_deg\n0,-30\n90,0\n-20,10\n")
    laws = {law: lab.trajectory(file, robot="course2r", law=law) for law in ("common", "own", "independent")}
    times = {law: [leg.move.seconds for leg in found.legs] for law, found in laws.items()}
    assert times["common"] == pytest.approx(times["own"]) and times["own"] == pytest.approx(times["independent"])
    _, early = (laws[law].motion.at(np.array([0.7 * times[law][0]]))[0][0] for law in ("common", "independent"))
    assert early[1] > 0 - 1e-9  # the second joint has arrived long before the first one
    passed = lab.trajectory(file, robot="course2r", blend_deg=2.0)
    joints = passed.motion.at(passed.motion.times(0.005))[0]
    missed = np.abs(joints - np.radians([90, 0])).max(axis=1).min()
    assert 0 < np.rad2deg(missed) <= 2 + 1e-4
    half = lab.trajectory(file, robot="course2r", accelerations=(200.0,))
    assert half.motion.seconds == pytest.approx(laws["common"].motion.seconds / 2)


def test_lines_and_circles(tmp_path, capsys) -> None:
    code, seen, error = run(
        capsys, tmp_path, SQUARE, "--feed-mm-s", "100", "--feed-mm-s2", "1000", "--turn-deg-s", "20"
    )
    assert code == 0 and not error
    assert [leg["move"] for leg in seen["legs"]] == ["line", "circle", "joint"]
    assert [leg["length_mm"] for leg in seen["legs"][:2]] == pytest.approx([100, 1e3 * 0.125 * 2 * np.arcsin(0.8)])
    assert seen["legs"][0]["seconds"] == pytest.approx(100 / 100 + 0.1)
    assert seen["legs"][1]["turn_deg"] == pytest.approx(10, abs=1e-4)
    found = table(tmp_path)
    xy = np.stack([found["tool_x_mm"], found["tool_y_mm"]], axis=1)
    start, end = seen["legs"][0]["seconds"], seen["legs"][0]["seconds"] + seen["legs"][1]["seconds"]
    on = (found["time_s"] > start) & (found["time_s"] < end)
    np.testing.assert_allclose(np.linalg.norm(xy[on] - [325, 0], axis=1), 125, atol=1e-6)
    np.testing.assert_allclose(xy[~on & (found["time_s"] <= start)][:, 1], -100, atol=1e-6)
    pace = np.linalg.norm(np.diff(xy, axis=0), axis=1) / np.diff(found["time_s"])
    assert pace[: int(np.argmax(found["time_s"] > end))].max() <= 100 + 1e-4  # joints: to 1e-10 m


def numbers_in(text: str, pattern: str) -> list[np.ndarray]:
    return [np.array([float(each) for each in re.findall(r"-?\d+\.\d+", found)]) for found in re.findall(pattern, text)]


def test_the_program_of_each_controller_has_the_same_stops_moves_and_times(tmp_path) -> None:
    """Read back from the text by patterns of the test's own."""
    file = tmp_path / "points.csv"
    file.write_text(SQUARE)
    found = lab.trajectory(file, robot="irb120", tool_mm=(10, -20, 50))
    moves, legs = path_moves(found), found.legs
    text = {each.name: path_program(found.chain, each.name.lower(), moves).decode() for each in languages()}
    degrees, seconds = np.rad2deg(moves.waypoints), [leg.move.seconds for leg in legs]
    assert list(moves.kinds) == ["joint", "line", "via", "circle", "joint"] and moves.checked and not moves.corrected
    stops = {
        "RAPID": numbers_in(text["RAPID"], r"jointtarget [^:]*:=\[\[(.*?)\]"),
        "VAL3": numbers_in(text["VAL3"], r"jTo=\{(.*?)\}"),
        "FANUC": numbers_in(re.sub(r"J\d=", "", text["FANUC"]), r"(?s)UT : 1,(.*?)\};"),
        "URScript": [np.rad2deg(each) for each in numbers_in(text["URScript"], r"(?<!p)\[(.*?)\][,)]")],
    }
    for name, found_stops in stops.items():
        np.testing.assert_allclose(found_stops, degrees, atol=6e-4 if name == "FANUC" else 2e-6)
    order = {
        "RAPID": r"Move(AbsJ|L|C)", "URScript": r"move(j|l|c)\(", "KRL": r"(PTP|LIN|CIRC) ", "FANUC": r"\d:(J|L|C) P",
        "VAL3": r" move(j|l|c)", "JBI": r"MOV(J|L|C)",
    }  # fmt: skip
    for name, pattern in order.items():
        kinds = [{"A": "J", "P": "J"}.get(each[0].upper(), each[0].upper()) for each in re.findall(pattern, text[name])]
        assert kinds == ["J", "L", *"C" * (3 if name == "JBI" else 1), "J"], name
    for name, pattern, unit in (("RAPID", r"T:=([\d.]+)", 1), ("FANUC", r"(\d+)msec", 1e-3)):
        told = [unit * float(each) for each in re.findall(pattern, text[name])]
        np.testing.assert_allclose(told, seconds, atol=1.1e-3 if name == "FANUC" else 1e-4)
    assert re.findall(r"t=([\d.]+)", text["URScript"]) == [f"{seconds[0]:.4f}", f"{seconds[2]:.4f}"]
    x, y, z, a, b, c = numbers_in(text["KRL"], r"LIN \{(.*?)\}")[0]
    turned = Rotation.from_euler("ZYX", [a, b, c], degrees=True).as_matrix()
    np.testing.assert_allclose(moves.Ts_base_tool[1], se3.pose(turned, np.array([x, y, z]) / 1e3), atol=2e-8)
    np.testing.assert_allclose([x, y, z], [400, -100, 400], atol=1e-5)
    via, end = (numbers_in(text["KRL"], rf"CIRC {pattern}")[0] for pattern in (r"\{(.*?)\}", r"\{.*?\}, \{(.*?)\}"))
    np.testing.assert_allclose([via[:3], end[:3]], [[450, 0, 400], [400, 100, 400]], atol=1e-5)
    np.testing.assert_allclose(numbers_in(text["KRL"], r"TOOL = \{(.*?)\}")[0], [10, -20, 50, 0, 0, 0], atol=1e-6)
    assert "C00002=450.000,0.000,400.000," in text["JBI"]
    assert float(re.findall(r"VEL.CP = ([\d.]+)", text["KRL"])[0]) == pytest.approx(legs[0].speed_m_s, abs=1e-4)


def test_what_the_arm_touches_on_its_way_is_refused_and_where(tmp_path) -> None:
    cell, line = tmp_path / "cell.toml", tmp_path / "line.csv"
    post = "[[obstacle]]\nname = 'post'\nshape = 'box'\nsize_mm = [40, 40, 400]\nposition_mm = [400, 0, {}]\n"
    line.write_text("\n".join(SQUARE.splitlines()[:3]) + "\nb,line,400,100,400,0,0,1,0\n")
    cell.write_text(post.format(400))
    words = r"line.csv: on the line from point a to b, at \d.\d+ s, .* post; move .* or give --no-check"
    with pytest.raises(LabError, match=words):
        lab.trajectory(line, cell=str(cell))
    assert not lab.trajectory(line, cell=str(cell), no_check=True).checked
    cell.write_text(post.format(1400))
    assert lab.trajectory(line, cell=str(cell)).checked
    cell.write_text("[joints.q1]\nlower_deg = -5\nupper_deg = 5\n")
    with pytest.raises(LabError, match=r"joint q1 is at .* beyond its limits of −5"):
        lab.trajectory(line, cell=str(cell))


def test_a_robot_of_an_unknown_maker_has_a_program_where_its_controller_is_said(tmp_path, capsys) -> None:
    code, seen, _ = run(capsys, tmp_path, SWING)
    assert code == 0 and seen["program"] == "program.mod" and (tmp_path / "run" / "program.mod").exists()
    code, seen, _ = run(capsys, tmp_path, "q1_deg,q2_deg\n0,0\n9,9\n", "--robot", "course2r", "--overwrite")
    assert code == 0 and seen["program"] is None and "choose --controller" in seen["no_program"]
    code, seen, _ = run(capsys, tmp_path, SWING, "--controller", "krl", "--overwrite")
    assert seen["program"] == "program.src" and "PTP" in (tmp_path / "run" / "program.src").read_text()


def test_elastic_links_are_tracked_and_corrected(tmp_path, capsys) -> None:
    """The corrected joints bring the virtual arm, in motion, to where the rigid one would be."""
    soft = tmp_path / "soft.toml"
    links = "".join(f"[[link]]\nnumber={n}\nei_nm2=5e4\ngj_nm2=4e4\n" for n in (2, 4))
    soft.write_text(f"robot = 'irb120'\n{links}")
    code, seen, _ = run(capsys, tmp_path, SWING, "--robot", str(soft), "--payload-kg", "2", "--step-ms", "100")
    told = seen["tracking"]
    assert code == 0 and told["payload_kg"] == 2 and set(told["parts_mm"]) == {"link 2", "link 4"}
    assert 0.02 < told["error_mm"]["mean"] < 0.2 and told["left_mm"]["max"] < 1e-7 and not told["not_made_up_for"]
    with (tmp_path / "run" / "corrected.csv").open() as file:
        header, *rows = csv.reader(file)
    corrected = np.deg2rad(np.array([row[1:7] for row in rows], dtype=float))
    assert header[1] == "q1_deg" and header[7:12] == ["error_x_mm", "error_y_mm", "error_z_mm", "link2_mm", "link4_mm"]
    left = [f"left_{axis}_mm" for axis in "xyz"] + [f"left_r{axis}_deg" for axis in "xyz"]
    parts = ("dx_mm", "dy_mm", "dz_mm", "rx_deg", "ry_deg", "rz_deg")
    torsors = [f"link{n}_{part}" for n in (1, 2, 3, 4, 6) for part in parts]  # link 5 has no length
    assert header[12:] == [*left, "incomplete", *torsors]
    found = lab.trajectory(tmp_path / "points.csv", robot=str(soft), payload_kg=2, step_ms=100)
    model, at = found.robot.serial_model, found.sampled
    arm = FlexibleArm(model.model, model, sections=found.robot.link_compliances)
    load, motion, site = (
        np.full(len(rows), 2.0),
        JointMotion(at.speeds, at.accelerations),
        model.model.site("flange").id,
    )
    stands = [arm.settled(each, np.zeros(6), load, motion) for each in (at.joints, corrected)]
    wanted, *reached = (arm.positions(stand, [site])[:, 0] for stand in (arm.straight(at.joints), *stands))
    before, after = (1e3 * np.linalg.norm(each - wanted, axis=1).mean() for each in reached)
    assert before == pytest.approx(told["error_mm"]["mean"], rel=0.01) and after < 0.02 * before


def test_a_payload_that_bends_nothing_is_refused(tmp_path, capsys) -> None:
    code, seen, _ = run(capsys, tmp_path, SWING)
    assert code == 0 and seen["tracking"] is None and not (tmp_path / "run" / "corrected.csv").exists()
    for arguments, words in (
        (("--payload-kg", "2"), "nothing bends robot irb120 here; give --run, or a robot with [[link]] sections"),
        (("--payload-kg", "-2"), "--payload-kg: -2; give 0 to 1,000 kg"),
        (("--run", "nowhere", "--tool-mm", "0,0,1"), "--tool-mm and --run: the run has the tool that it measured"),
        (("--run", "nowhere"), "nowhere"),
    ):
        code, _, error = run(capsys, tmp_path, SWING, "--overwrite", *arguments)
        assert code == 2 and words in error and len(error.splitlines()) == 1


@pytest.mark.thorough
def test_a_trajectory_is_corrected_by_a_run(tmp_path) -> None:
    """Geometry, joints and links as identified: all of them are parts of what is missed, and made up for."""
    soft = {"link_ei": (0.0, 5e4, 0.0, 5e4, 0.0, 0.0), "stiffness_nm_per_rad": 1e5, "payload_kg": (0.0, 3.0)}
    known = lab.calibrate("irb120", poses=40, seed=3, targets=("p1", "p2", "p3"), model="compliance+bending", **soft)
    (tmp_path / "points.csv").write_text(SWING)
    moved = lab.trajectory(tmp_path / "points.csv", run=known, payload_kg=2.0, step_ms=200)
    told = moved.to_dict()["tracking"]
    assert {"geometry", "joints", "link 2", "link 4"} <= set(told["parts_mm"])
    assert told["error_mm"]["mean"] > 0.5 and told["left_mm"]["max"] < 1e-6
    with pytest.raises(LabError, match="--robot tx40: the run run-in-memory is of irb120; leave out --robot"):
        lab.trajectory(tmp_path / "points.csv", run=known, robot="tx40")


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("q1_deg,q2_deg\n0,0\n", "1 point; give two or more"),
        ("q1_deg,q2_deg\n0,0\n0,95\n", "point 1: joint q2 is at 95°, beyond its limits"),
        ("move,q1_deg,q2_deg\n,0,0\njump,0,9\n", "line 3, column move: 'jump' is unknown; write one of joint, line"),
        ("move,q1_deg,q2_deg\n,0,0\ncircle,0,9\n", "line 3, column move: a circle is two rows"),
        ("x_mm,y_mm,z_mm\n900,0,500\n5000,0,0\n", "is out of reach"),
    ],
)
def test_what_cannot_be_is_refused_in_a_line(tmp_path, capsys, text: str, words: str) -> None:
    code, seen, error = run(capsys, tmp_path, text, "--robot", "course2r")
    assert code == 2 and words in error and len(error.splitlines()) == 1 and "points.csv" in seen["error"]["message"]
    assert not (tmp_path / "run").exists()


def test_the_scene_passes_the_points_at_their_times(tmp_path) -> None:
    """The tool is at each point of the file when the scene says so; its speed is the slope of its path."""
    (tmp_path / "points.csv").write_text(SQUARE)
    moved = lab.trajectory(tmp_path / "points.csv", step_ms=5)
    scene, robot = page_scene(moved), lab.load_robot("irb120")
    given = np.array([[float(part) for part in line.split(",")[2:5]] for line in SQUARE.splitlines()[1:]])
    assert list(scene.names) == [line.split(",")[0] for line in SQUARE.splitlines()[1:]]
    world = se3.transform(robot.T_world_frame0, 1e-3 * given)
    slow = 5e-3 * float(tool_speeds(moved).max())  # how far the tool moves from one sample to the next, at most
    assert np.linalg.norm(scene.points - world, axis=1).max() < slow
    starts = [0.0, *np.cumsum([leg["seconds"] for leg in moved.to_dict()["legs"]])]
    np.testing.assert_allclose(np.delete(scene.times[scene.stops], 2), starts, atol=0.006)  # c is passed on the circle
    sampled = moved.sampled
    steps = np.linalg.norm(np.diff(sampled.Ts_base_tool[:, :3, 3], axis=0), axis=1) / np.diff(sampled.times)
    middle = (tool_speeds(moved)[1:] + tool_speeds(moved)[:-1]) / 2
    np.testing.assert_allclose(steps, middle, atol=0.01 * middle.max())
