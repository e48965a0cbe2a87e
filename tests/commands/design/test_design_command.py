"""``lab design`` as a user calls it: what it prints, what it writes, and that the other commands read it."""

import csv
import json
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from helpers.bad_input import ARM_XML, contents, run, swapped, the_line
from helpers.drawing import nothing_drawn
from helpers.recordings import column, rrd, statics
from helpers.robots import IRB120, SCARA

from lab.cli.main import main
from lab.core.random import rng_for
from lab.extensions.programs.rapid import Rapid
from lab.formats.measurement_csv import read_measurements
from lab.library.design import design
from lab.noise.instruments import instrument
from lab.options.virtual_campaign import DesignOptions
from lab.report.views.design_document import plan_scene
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
    assert 100 <= result["pool"]["poses"] <= 100 + POSES
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
def test_the_command_writes_the_same_bytes(drawn: Path, tmp_path: Path) -> None:
    """As the call with the same seed."""
    again = tmp_path / "again"
    assert run(f"{ASKED} --out {again}") == 0
    assert {path.name for path in again.iterdir()} == FILES
    for name in FILES - {"result.json", "recording.rrd", "SHA256SUMS"}:
        assert (again / name).read_bytes() == (drawn / name).read_bytes(), name
    first, second = (json.loads((place / "result.json").read_text()) for place in (drawn, again))
    assert first.pop("seconds") > 0 and second.pop("seconds") > 0 and first == second


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
    tool = np.array(column(path, "/world/frames/tool", "Transform3D:translation", "stop")[1])[:, 0]
    np.testing.assert_allclose(tool, shown.points[:, 0], atol=1e-6)  # it stands at the first target


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
