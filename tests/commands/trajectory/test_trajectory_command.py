"""``lab trajectory``: the course's example by a command, every kind of move, and what is refused."""

import csv
import json
from pathlib import Path

import numpy as np
import pytest
from rerun.chunk import RrdReader

import lab
from lab.cli import main
from lab.core.errors import LabError
from lab.simulation.elastic import FlexibleArm, JointMotion

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
    corrected = np.deg2rad(np.array(rows, dtype=float)[:, 1:7])
    assert header[1] == "q1_deg" and header[7:] == ["error_x_mm", "error_y_mm", "error_z_mm", "link2_mm", "link4_mm"]
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


@pytest.mark.thorough
@pytest.mark.figures
def test_a_recording_shows_each_link_as_it_bends(tmp_path, capsys) -> None:
    soft = tmp_path / "soft.toml"
    soft.write_text("robot = 'irb120'\n[[link]]\nnumber = 2\nei_nm2 = 5e4\n")
    assert run(capsys, tmp_path, SWING, "--robot", str(soft), "--step-ms", "200")[0] == 0
    reader = RrdReader(tmp_path / "run" / "recording.rrd")
    entities = {chunk.entity_path for chunk in reader.stream(store=reader.recordings()[0])}
    assert {f"/world/magnified/{how}/link{n}" for how in ("rigid", "bent") for n in (1, 2, 3, 4, 6)} <= entities
    assert {"/errors/in_all", "/errors/link_2"} <= entities and "link 2" in (tmp_path / "run/report.html").read_text()


def test_a_payload_that_bends_nothing_is_refused(tmp_path, capsys) -> None:
    code, seen, _ = run(capsys, tmp_path, SWING)
    assert code == 0 and seen["tracking"] is None and not (tmp_path / "run" / "corrected.csv").exists()
    for arguments, words in (
        (("--payload-kg", "2"), "nothing bends robot irb120 here; give --run, or a robot with [[link]] sections"),
        (("--payload-kg", "-2"), "--payload-kg: -2; give zero or more"),
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
