"""``lab design`` as a user calls it: what it prints, what it writes, and that the other commands read it."""

import csv
import json
import re
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from helpers.bad_input import ARM_XML, contents, run, swapped, the_line
from helpers.drawing import nothing_drawn
from helpers.recordings import column, needs_vulkan, rrd, statics, views_of
from helpers.robots import IRB120, SCARA

from lab.campaign.options import DesignOptions
from lab.cli import main
from lab.commands.design.document import plan_scene
from lab.commands.design.recording import record_plan
from lab.commands.design.run import design
from lab.core.random import rng_for
from lab.extensions.programs.rapid import Rapid
from lab.formats.measurement_csv import read_measurements
from lab.formats.programs.protocol import MeasuringTour
from lab.noise.instruments import instrument
from lab.simulation.tracking import track
from lab.simulation.true_robot import random_perturbation, random_tracker, true_robot

POSES = 12
ASKED = f"design --candidates 100 --starts 1 --poses {POSES} --seed 3"
FILES = {"SHA256SUMS", "config.json", "plan.csv", "plan.mod", "result.json", "recording.rrd", "report.html"}
INDICES = {"o1", "o2", "o3", "o4", "o5", "condition", "a", "g", "i"}


@pytest.fixture(scope="module")
def plan():
    return design(DesignOptions(candidates=100, starts=1, poses=POSES, seed=3))


@pytest.fixture(scope="module")
def folder(plan, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of the plan, without pictures."""
    with nothing_drawn():
        return plan.save(tmp_path_factory.mktemp("plans") / "plan")


@pytest.fixture(scope="module")
def drawn(plan, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The whole folder of the plan, for tests marked ``figures``."""
    return plan.save(tmp_path_factory.mktemp("plans") / "drawn")


@pytest.mark.thorough
def test_the_result_holds_what_was_asked_for(folder: Path) -> None:
    result = json.loads((folder / "result.json").read_text())
    assert (result["poses"], result["parameters"], result["criterion"]) == (POSES, 27, "O1")
    assert set(result["indices"]) == INDICES
    for index in result["indices"].values():
        assert index["value"] > 0 and index["scaling"]
    assert 0.8 < result["d_efficiency"] <= 1 and 0 < result["bound_gap"] <= 1e-3
    assert 100 <= result["pool"]["poses"] <= 100 + POSES and "100 feasible candidates" in result["pool"]["what"]
    predicted = result["predicted_mm"]
    assert 0 < predicted["mean"] <= predicted["rms"] <= predicted["p95"] <= predicted["max"] < result["promise_mm"]
    assert result["indices"]["i"]["value"] == pytest.approx(predicted["rms"] ** 2)
    found = result["candidates"]
    assert found["feasible"] == 100 and set(found["rejected"]) == {"limits", "singularity", "collision", "visibility"}
    assert found["feasible"] + sum(found["rejected"].values()) == found["drawn"]
    assert result["moves"] == POSES + 1 + result["via"] and result["tour_seconds"] > 1
    assert result["measured_already"] == 0 and result["rapid"] == "plan.mod"
    curve = result["curve"]
    assert [step["poses"] for step in curve] == sorted({step["poses"] for step in curve})
    assert all(step["rms_mm"] < step["worst_mm"] < step["promise_mm"] for step in curve)


@pytest.mark.thorough
@pytest.mark.figures
def test_the_command_writes_the_same_bytes_and_a_person_reads_the_plan(
    drawn: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    home,
) -> None:
    """As the call with the same seed; and a person, who wants no JSON, reads the plan."""
    again = tmp_path / "again"
    assert run(f"{ASKED} --out {again}") == 0
    printed = " ".join(capsys.readouterr().out.split())
    for words in (
        "27 parameters",
        "certified D-efficiency",
        "95 %/95 % tolerance bound is",
        "feasible candidates",
        "The tour has",
    ):
        assert words in printed
    assert {path.name for path in again.iterdir()} == FILES
    for name in FILES - {"result.json", "recording.rrd", "SHA256SUMS"}:
        assert (again / name).read_bytes() == (drawn / name).read_bytes(), name
    first, second = (json.loads((place / "result.json").read_text()) for place in (drawn, again))
    assert first.pop("seconds") > 0 and second.pop("seconds") > 0 and first == second
    done = rrd(home, "compare", "--unordered", drawn / "recording.rrd", again / "recording.rrd")
    assert done.returncode == 0, done.stderr


def test_plan_csv_is_exact_and_calibrate_measures_it(folder: Path, plan, tmp_path: Path, capsys) -> None:
    chain = IRB120.chain
    every = read_measurements(folder / "plan.csv", chain.joint_names, chain.prismatic, points=False)
    assert (every.joints == plan.tour.waypoints).all() and not every.warnings  # whoever moves along it touches nothing
    measured = plan.tour.measured >= 0
    assert every.other["stop"] == tuple(np.where(measured, "measure", "via").tolist())
    stops = json.loads((folder / "result.json").read_text())["stops"]
    assert [stop["id"] for stop in stops] == list(every.ids) and every.ids[0] == "home"
    assert [stop["stop"] for stop in stops] == list(every.other["stop"])
    read = every.only("calibrate")
    assert (read.joints == plan.design.joints[list(plan.tour.order)]).all()
    assert read.ids == tuple(str(i) for i in range(1, POSES + 1)) and np.isnan(read.points).all()
    assert main(["calibrate", "--plan", str(folder / "plan.csv"), "--out", str(tmp_path / "run"), "--json"]) == 0
    result = json.loads(capsys.readouterr().out)
    assert (result["poses"], result["verdict"], result["warnings"]) == (POSES, "good", [])


def test_identify_takes_the_filled_template_and_refuses_the_empty_one(folder: Path, tmp_path: Path, capfd) -> None:
    """Measured by a virtual arm, the cells typed in as a person would, to a tenth of a micrometre."""
    chain, device = IRB120.chain, instrument("uniform-8um")
    read = read_measurements(folder / "plan.csv", chain.joint_names, chain.prismatic, points=False)
    model = IRB120.model
    off = random_perturbation(model, 0.5e-3, 1.5e-3, rng_for(0, "arm"))
    real = true_robot(model, off, random_tracker(model, rng_for(0, "tracker")))
    points = track(real, read.joints, ("p1",), device, rng_for(0, "noise")).points
    rows = list(csv.reader((folder / "plan.csv").read_text().splitlines()))
    assert len(rows) == 1 + len(read)
    places = [rows[0].index(f"p1_{axis}_mm") for axis in "xyz"]
    for row, point in zip(rows[1:], points[:, 0], strict=True):
        assert [row[place] for place in places] == ["", "", ""]
        for place, value in zip(places, point, strict=True):
            row[place] = f"{1e3 * value:.4f}"
    filled = tmp_path / "filled.csv"
    filled.write_text("\n".join(",".join(row) for row in rows) + "\n")
    assert run(f"identify {filled} --instrument uniform-8um --out {tmp_path / 'run'} --json") == 0
    result = json.loads(capfd.readouterr().out)
    assert (result["rank"], result["poses"], result["status"]) == (27, POSES, "converged")
    assert run(f"identify {folder / 'plan.csv'} --out {tmp_path / 'none'}") == 2
    line = the_line(capfd.readouterr().err)
    assert "plan.csv" in line and "every point is empty" in line


TARGET = re.compile(r"  LOCAL CONST jointtarget (\w+):=\[\[([^\]]*)\],\[(?:9E\+09,){5}9E\+09\]\];")
MOVE = re.compile(r"    MoveAbsJ (\w+),v200,(\w+),tool0;")


def check_module(text: str, stops: np.ndarray, measured: np.ndarray) -> None:
    """Valid names and shape, every target declared once, and the moves are the tour."""
    lines = text.splitlines()
    head = re.fullmatch(r"MODULE ([A-Za-z]\w{0,31})", lines[0])
    assert head and lines[-1] == "ENDMODULE" and text.isascii()
    assert lines.count("  PROC measure_poses_from_1()") == lines.count("  ENDPROC") == 1
    targets = {m[1]: np.array(m[2].split(","), dtype=float) for m in map(TARGET.fullmatch, lines) if m}
    moves = [m.groups() for m in map(MOVE.fullmatch, lines) if m]
    assert len(targets) == len(stops) - 1 and all(len(name) <= 32 for name in targets)
    assert moves[0] == moves[-1] == ("home", "fine")
    went = np.array([targets[name] for name, _ in moves])
    np.testing.assert_allclose(went, np.rad2deg(stops), rtol=0, atol=6e-7)  # degrees
    assert [zone for _, zone in moves[1:-1]] == ["fine"] * len(measured[1:-1])
    waits = [lines[i - 2] for i, line in enumerate(lines) if line == "    WaitTime 3;"]
    assert waits == [f"    MoveAbsJ {name},{'v200'},fine,tool0;" for name, _ in moves if name.startswith("pose")]
    known = r"\s*(!.*|MODULE.*|ENDMODULE|PROC.*|ENDPROC|LOCAL CONST jointtarget.*;|TPErase;|)"
    known += r"|\s*(MoveAbsJ|TPWrite|WaitTime) .*;"
    assert all(re.fullmatch(known, line) for line in lines)


def test_the_rapid_module_is_the_tour(folder: Path, plan) -> None:
    text = (folder / "plan.mod").read_bytes().decode("ascii")
    assert "\r\n" in text
    check_module(text.replace("\r\n", "\n"), plan.tour.waypoints, plan.tour.measured)


def test_poses_on_the_way_are_passed_without_a_wait() -> None:
    stops = np.vstack([np.zeros(6), np.random.default_rng(0).uniform(-2, 2, (4, 6)), np.zeros(6)])
    measured = np.array([-1, 1, -1, 0, 2, -1])
    tour = MeasuringTour("a robot, with a name – longer than thirty-two", stops, measured, ("1", "2", "3"))
    text = Rapid().measuring_tour(tour).decode("ascii").replace("\r\n", "\n")
    check_module(text, stops, measured)
    assert text.count("via001,v200,fine") == 1 and text.count('TPWrite "Pose ') == 3


@pytest.mark.thorough
def test_only_six_revolute_joints_make_a_rapid_module(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys) -> None:
    assert Rapid().refusal(IRB120.chain) is None
    assert "RRPR" in str(Rapid().refusal(SCARA))
    slide = replace(IRB120.chain, prismatic=(False,) * 5 + (True,))
    assert "RRRRRP" in str(Rapid().refusal(slide))
    monkeypatch.chdir(tmp_path)
    Path("arm.xml").write_text(ARM_XML.replace("mass=", 'contype="0" conaffinity="0" mass='))
    assert run("design --robot arm.xml --controller rapid --candidates 60 --poses 8 --starts 1 --json") == 0
    result = json.loads(capsys.readouterr().out)
    assert "six revolute" in result["rapid"] and result["warnings"]  # the arm gives no joint speeds
    assert not (tmp_path / "runs" / "design-arm-seed0" / "plan.mod").exists()


@pytest.mark.thorough
def test_a_set_measured_already_is_added_to(folder: Path, tmp_path: Path, capsys) -> None:
    out = tmp_path / "more"
    given = f"--poses 5 --candidates 100 --starts 1 --seed 4 --extend {folder / 'plan.csv'}"
    assert run(f"design {given} --out {out} --json") == 0
    more, first = json.loads(capsys.readouterr().out), json.loads((folder / "result.json").read_text())
    assert more == json.loads((out / "result.json").read_text())
    assert (more["poses"], more["measured_already"]) == (5, POSES)
    assert more["promise_mm"] < first["promise_mm"]
    rows = csv.DictReader((out / "plan.csv").read_text().splitlines())
    ids = [row["id"] for row in rows if row["stop"] == "measure"]
    assert ids == [str(POSES + i) for i in range(1, 6)]  # one file can hold both


@pytest.mark.thorough
@pytest.mark.figures
def test_the_recording_is_the_tour(drawn: Path, plan, home) -> None:
    path, shown = drawn / "recording.rrd", plan_scene(plan)
    assert rrd(home, "verify", path).returncode == 0
    here = np.array(column(path, "/world/targets/here", "Points3D:positions", "stop")[1])
    np.testing.assert_allclose(here, shown.points, rtol=0, atol=1e-6)  # m, float32
    assert statics(path, "/world/targets/number", "Points3D:labels") == list(shown.ids)
    halves = np.array(column(path, "/world/ellipsoid/uncertainty/shape", "Ellipsoids3D:half_sizes", "stop")[1])[:, 0]
    assert len(halves) == len(plan.tour.waypoints)
    text, whole = (statics(path, entity, "TextDocument:text")[0] for entity in ("/summary", "/details"))
    assert f"{POSES} poses" in text and "D-efficiency" in whole and "O1" in text
    stops, lines = column(path, "/program", "TextLog:text", "stop")
    assert stops == list(range(len(plan.tour.waypoints))) and (lines[0][0][:4], lines[-1][0][:4]) == ("home", "home")
    for (line,), waypoint, measured in zip(lines, plan.tour.waypoints, plan.tour.measured >= 0, strict=True):
        values = [float(each.removesuffix("°")) for each in line.partition(" at ")[2].split(", ")]
        np.testing.assert_allclose(values, np.rad2deg(waypoint), atol=0.051)
        assert ("measure pose" in line) is bool(measured)
    tool = np.array(column(path, "/world/frames/tool", "Transform3D:translation", "stop")[1])[:, 0]
    np.testing.assert_allclose(tool, shown.points[:, 0], atol=1e-6)  # it stands at the first target


@pytest.mark.thorough
def test_poses_on_the_way_are_drawn_and_numbered_as_none(plan, tmp_path: Path, home) -> None:
    """Two stops that are only passed, one after the other, between the second and the third pose."""
    tour = plan.tour
    stops, measured = (
        np.insert(tour.waypoints, 3, tour.waypoints[[5, 7]], axis=0),
        np.insert(tour.measured, 3, [-1, -1]),
    )
    detour = replace(plan, tour=replace(tour, waypoints=stops, measured=measured))
    assert detour.to_dict()["via"] == 2
    record_plan(tmp_path / "detour.rrd", detour)
    assert rrd(home, "verify", tmp_path / "detour.rrd").returncode == 0
    index, rows = column(tmp_path / "detour.rrd", "/world/targets/passed", "Points3D:positions", "stop")
    assert (index, [len(row or []) for row in rows]) == ([3, 4, 5], [1, 1, 0])
    assert len(column(tmp_path / "detour.rrd", "/world/targets/here", "Points3D:positions", "stop")[0]) == POSES + 4


@pytest.mark.thorough
@needs_vulkan
@pytest.mark.figures
def test_no_view_of_the_plan_complains(drawn: Path, home) -> None:
    views = views_of(drawn / "recording.rrd", home, "stop")
    assert {view.name.partition(" ×")[0] for view in views} >= {"Tour", "Sensitivity", "Summary", "Program"}
    assert [(view.name, view.reports) for view in views if view.reports] == []


FEW = "design --robot arm.xml --candidates 100 --starts 1"
SMALL = f"{FEW} --poses 8"
INSIDE = swapped(ARM_XML, "<worldbody>", '<worldbody><site name="tracker" pos="0 0 0"/>')
WALLED = swapped(
    ARM_XML, "<worldbody>",
    '<worldbody><body name="t" pos="3 0 0.5"><site name="tracker"/></body>'
    '<geom type="box" size=".01 9 9" pos="2 0 0" contype="0" conaffinity="0"/>',
)  # fmt: skip
BAD = {
    "unknown criterion": (f"{SMALL} --criterion O9", ("O9", "O1, O2")),
    "too few poses": (f"{SMALL} --poses 3", ("--poses 3", "5 poses or more")),
    "no poses": (f"{SMALL} --poses 0", ("--poses 0", "1 or more")),
    "negative seed": (f"{SMALL} --seed -1", ("--seed -1", "0 or more")),
    "no starts": (f"{SMALL} --starts 0", ("--starts 0", "1 or more")),
    "poses not whole": (f"{SMALL} --poses many", ("--poses", "not a whole number")),
    "more poses than candidates": (f"{SMALL} --poses 101", ("101 poses", "100 candidates")),
    "no candidates": (f"{SMALL} --candidates 0", ("--candidates 0", "1 or more")),
    "points of too many candidates": (
        f"{SMALL} --candidates 60000 --targets p1,p2,p3",
        ("180,000 points of all candidates", "at most 170,000"),
    ),
    "tracker inside": (f"{SMALL} --robot inside.xml", ("inside.xml", "inside the arm")),
    "nothing visible": (f"{SMALL} --robot walled.xml", ("walled.xml", "does not see p1")),
    "exact instrument": (f"{SMALL} --instrument exact", ("exact", "no noise")),
    "unknown instrument": (f"{SMALL} --instrument laser", ("laser", "uniform-8um")),
    "accuracy out of reach": (f"{FEW} --accuracy-mm 1e-6", ("1e-06 mm", "out of reach")),
    "a number and an accuracy": (f"{SMALL} --accuracy-mm 0.1", ("--poses", "--accuracy-mm", "give one")),
    "accuracy of nothing": (f"{FEW} --accuracy-mm 0", ("--accuracy-mm 0", "above zero")),
    "nothing to extend": (f"{SMALL} --extend none.csv", ("none.csv", "cannot be read")),
    "another robot's file": (f"{SMALL} --extend far.csv", ("far.csv", "line 2", "beyond its limits", "--robot")),
    "unknown scaling": (f"{SMALL} --scaling metric", ("--scaling", "whitened")),
    "unknown target": (f"{SMALL} --targets p9", ("p9", "p1, p2, p3")),
    "unknown robot": (f"{SMALL} --robot kuka", ("kuka", "irb120")),
}


@pytest.mark.thorough
@pytest.mark.parametrize(("argv", "words"), BAD.values(), ids=BAD)
def test_bad_input_is_told_in_one_line(
    argv: str, words: tuple[str, ...], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd
) -> None:
    monkeypatch.chdir(tmp_path)
    for name, text in (("arm", ARM_XML), ("inside", INSIDE), ("walled", WALLED)):
        (tmp_path / f"{name}.xml").write_text(text)
    (tmp_path / "far.csv").write_text("q1_rad,q2_rad,q3_rad\n0,9,0\n")
    before = contents(tmp_path)
    assert run(f"{argv} --out run") == 2
    out, err = capfd.readouterr()
    line = the_line(err)
    assert out == "" and all(word in line for word in words), line
    assert contents(tmp_path) == before


LOADED = f"{FEW} --poses 10 --model geometric+compliance --payload-kg 0,2 --criterion I"


@pytest.mark.thorough
def test_a_plan_states_its_payloads_and_calibrate_measures_with_them(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("arm.xml").write_text(ARM_XML)
    assert run(f"{LOADED} --controller krl --no-recording --out plan --json") == 0
    result = json.loads(capsys.readouterr().out)
    assert result["model"] == ["geometric+compliance"]
    assert 0.5 < result["certificate"]["efficiency"] <= 1 and 0 <= result["certificate"]["bound_gap"] < 0.02
    rows = list(csv.DictReader(Path("plan/plan.csv").read_text().splitlines()))
    measured = [row for row in rows if row["stop"] == "measure"]
    loads = [float(row["payload_kg"]) for row in measured]
    counts = {each["payload_kg"]: each["poses"] for each in result["payloads"]}
    assert {mass: loads.count(mass) for mass in (0.0, 2.0)} == counts and sum(counts.values()) == 10
    changes = sum(a != b for a, b in pairwise(loads))
    assert changes == result["payload_changes"] == sum(count > 0 for count in counts.values()) - 1  # blocks
    between = [row["id"] for row in rows if row["id"].startswith("home_between")]
    assert len(between) == changes
    measure = "calibrate --robot arm.xml --plan plan/plan.csv --model geometric+compliance --stiffness-nm-per-rad 1e4"
    assert run(f"{measure} --no-recording --out run --json") in (0, 1)
    found = json.loads(capsys.readouterr().out)
    assert found["status"] == "converged" and found["poses"] == 10
    data = read_measurements(Path("run/measurements.csv"), ("q1", "q2", "q3"), (False,) * 3)
    np.testing.assert_array_equal(data.conditions["payload_kg"], loads)
