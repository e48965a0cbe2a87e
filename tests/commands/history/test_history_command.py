"""``lab history`` on calibrations of one virtual arm, the zero of whose third joint moves before the last one."""

import json
import shutil
from dataclasses import replace
from datetime import date
from pathlib import Path

import numpy as np
import pytest

import lab
from lab.calibration.statistics.goodness_of_fit import lack_of_fit_not_tested
from lab.cli.main import main
from lab.core.errors import LabError
from lab.core.random import rng_for
from lab.kinematics.gauge import STRUCTURE_POSES

MOVED_RAD = 0.5e-3  # of the fixture
DAYS = ("2026-01-10", "2026-02-11", "2026-03-09", "2026-04-14")


def results(folder: Path) -> list[lab.Result]:
    return [lab.history([folder / a, folder / b]) for a, b in (("run3", "run2"), ("run1", "run0"))]


@pytest.mark.thorough
def test_what_moved_between_two_runs_has_its_size(dated_runs: Path) -> None:
    same, other = results(dated_runs)
    assert same.exit_code == 0 and same.arms[0].changes.found == ()
    assert other.exit_code == 1
    (arm,) = other.to_dict()["arms"]
    (change,) = arm["changes"]
    assert change["between"] == list(DAYS[2:]) and [each["name"] for each in change["named"]] == ["link3.theta"]
    low, high = change["named"][0]["interval_95"]
    assert low < MOVED_RAD < high < 1.2 * MOVED_RAD
    difference = arm["parameters"]["link3.theta"]  # one change has one size and one interval
    assert difference["change"][1] == pytest.approx((low + high) / 2)
    assert difference["half_width_95"][1] == pytest.approx((high - low) / 2)
    assert not any(name.startswith(("base", "tool")) for name in arm["parameters"])


def test_the_change_takes_the_tool_as_far_as_a_joint_reading_that_is_off(dated_runs: Path) -> None:
    (arm,) = results(dated_runs)[1].arms
    (change,) = arm.changes.found
    estimate = lab.load_estimate(dated_runs / "run1")
    joints = estimate.arm.structure_joints(STRUCTURE_POSES, rng_for(0, "structure"))
    turned = joints.copy()
    turned[:, 2] += change.changes[0]
    apart = (estimate.arm.points(turned, estimate.values) - estimate.arm.points(joints, estimate.values))[:, 0]
    assert arm.changes.at_tool_m(change) == pytest.approx(np.sqrt((apart**2).sum(axis=1).mean()), rel=0.02)


def test_a_series_says_since_when(dated_runs: Path) -> None:
    found = lab.history(dated_runs, on="2026-04-20")
    (arm,) = found.arms
    assert [each.on for each in arm.changes.dated] == [date.fromisoformat(each) for each in DAYS]  # not by folders
    (change,) = arm.changes.found
    assert (change.after, change.found_at, change.named) == (2, 3, ("link3.theta",))
    assert abs(change.changes[0] - MOVED_RAD) < change.half_widths[0]
    assert found.exit_code == 0 and arm.state == "good"  # the last calibration includes the change
    everything = lab.history([dated_runs / f"run{i}" for i in range(4)], on="2026-04-20")
    assert everything.exit_code == 1
    assert everything.to_dict()["arms"][0]["changes"] == found.to_dict()["arms"][0]["changes"]
    assert (arm.changes.shifts[0] == 0).all()


def test_the_end_joints_show_only_where_base_and_tool_were_kept(dated_runs: Path) -> None:
    anew, kept = (lab.history(dated_runs, kept=kept) for kept in ((), ("base", "tool")))
    sizes = anew.to_dict()["arms"][0]["minimum_detectable_change"]
    assert {name for name, size in sizes.items() if size is None} == {"joint1_mrad", "joint6_mrad"}
    assert all(0 < size < MOVED_RAD * 1e3 for size in sizes.values() if size is not None)
    assert all(0 < size < 0.2 for size in kept.to_dict()["arms"][0]["minimum_detectable_change"].values())
    assert [each.named for each in kept.arms[0].changes.found] == [("link3.theta",)]


def test_results_in_memory_are_compared_as_folders_are(dated_runs: Path, tmp_path: Path, capsys, monkeypatch) -> None:
    monkeypatch.chdir(tmp_path)
    folders = [str(dated_runs / name) for name in ("run1", "run0")]
    assert main(["history", *folders, "--json", "--out", "out"]) == 1
    told = json.loads(capsys.readouterr().out)
    files = [dated_runs / name / "measurements.csv" for name in ("run1", "run0")]
    memory = lab.history([lab.identify(file, robot="irb120", instrument="uniform-8um") for file in files])
    (ours,), (theirs,) = told["arms"], memory.to_dict()["arms"]
    assert ours["changes"][0]["named"][0]["change"] == pytest.approx(theirs["changes"][0]["named"][0]["change"])
    assert main(["history", *folders, "--out", folders[0]]) == 2  # which would replace what it reads
    assert "an input of this run" in capsys.readouterr().err


def test_a_single_run_has_no_change_yet(dated_runs: Path) -> None:
    found = lab.history(dated_runs / "run3", on="2026-01-20")
    assert found.exit_code == 0 and found.arms[0].state == "good" and found.arms[0].changes.found == ()
    sizes = found.to_dict()["arms"][0]["minimum_detectable_change"]
    assert 0 < sizes["joint3_mrad"] < MOVED_RAD * 1e3  # the next calibration would find it


def test_a_copy_and_an_undated_run_are_not_compared(dated_runs: Path, tmp_path: Path) -> None:
    shutil.copytree(dated_runs, tmp_path / "runs")
    shutil.rmtree(tmp_path / "runs" / "run0")
    shutil.copytree(tmp_path / "runs" / "run1", tmp_path / "runs" / "run9")
    config = tmp_path / "runs" / "run2" / "config.json"
    undated = json.loads(config.read_text())
    undated["options"]["date"] = None
    config.write_text(json.dumps(undated))
    found = lab.history(tmp_path / "runs", accept_edited=True)
    (arm,) = found.arms
    assert [each.folder.name for each in arm.changes.dated] == ["run3", "run1"] and not arm.changes.found
    with pytest.raises(LabError, match=r"run9: has the parameters of .*run1"):
        lab.history([tmp_path / "runs" / "run1", tmp_path / "runs" / "run9"])


@pytest.mark.parametrize("file", ["parameters.json", "result.json", "config.json", "covariance.csv"])
def test_one_edited_run_is_left_out_by_name(dated_runs: Path, tmp_path: Path, file: str) -> None:
    shutil.copytree(dated_runs, tmp_path / "runs")
    edited = tmp_path / "runs" / "run2" / file
    edited.write_text(f"{edited.read_text()} " if file == "parameters.json" else "{")
    found = lab.history(tmp_path / "runs")
    (left_out,) = found.left_out
    assert left_out.folder.name == "run2" and file in left_out.reason
    (arm,) = found.arms
    assert [each.folder.name for each in arm.changes.dated] == ["run3", "run1", "run0"]
    assert [each.named for each in arm.changes.found] == [("link3.theta",)]


@pytest.mark.thorough
def test_runs_that_cannot_be_compared_are_refused(dated_runs: Path) -> None:
    first = dated_runs / "run3"
    with pytest.raises(LabError, match="is of another robot"):
        lab.history([first, lab.calibrate("scara", poses=12)])
    file = dated_runs / "run2" / "measurements.csv"
    fixed = lab.identify(file, robot="irb120", instrument="uniform-8um", fix=("link3.a",))
    with pytest.raises(LabError, match=r"link3\.a"):
        lab.history([first, fixed])
    second = lab.identify(file, robot="irb120", instrument="uniform-8um")
    bad = replace(second.verdict, word="bad", reasons=(lack_of_fit_not_tested("too few"),))
    unfit = replace(second, state=replace(second.state, verdict=bad))
    with pytest.raises(LabError, match="the verdict of this run is 'bad'"):
        lab.history([first, unfit])
    assert len(lab.history([first, unfit], force=True).arms[0].changes.dated) == 2


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["nowhere"], "nowhere: is no folder"),
        (["."], "contains no run"),
        ([".", "--kept", "arm"], "--kept arm"),
    ],
)
def test_bad_input_is_one_line(arguments: list[str], says: str, tmp_path: Path, monkeypatch, capsys) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(["history", *arguments]) == 2
    message = capsys.readouterr().err.strip()
    assert says in message and "\n" not in message and not list(tmp_path.iterdir())
