"""``lab trend`` on a folder of dated runs of one virtual arm, a zero of which moves."""

import json
import shutil
from dataclasses import replace
from datetime import date
from pathlib import Path

import numpy as np
import pytest
from helpers.drawing import nothing_drawn

import lab
from lab.cli import main
from lab.commands.options import TrendOptions
from lab.commands.trend import change_rows, trend
from lab.core.errors import LabError
from lab.core.whole_folder import CHECKSUMS, checksum_lines

MOVED_RAD = 0.1e-3
DAYS = ("2026-01-10", "2026-02-11", "2026-03-09", "2026-04-14")


@pytest.fixture(scope="module")
def history(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Four calibrations in 20 poses each; before the last one the zero of the third joint moved."""
    day = lab.simulate("irb120", poses=80, seed=7, targets=("p1", "p2", "p3")).measurements
    folder = tmp_path_factory.mktemp("history")
    with nothing_drawn():
        for i, at in enumerate(DAYS):
            part = day.take(range(20 * i, 20 * i + 20))
            if i == 3:
                joints = part.joints.copy()
                joints[:, 2] -= MOVED_RAD  # what the controller says, when the joint stands farther than it knows
                part = replace(part, joints=joints)
            lab.identify(part, robot="irb120", noise_mm=0.0046, date=at).save(folder / f"run{3 - i}")
    return folder


@pytest.mark.thorough
def test_the_joint_that_moved_is_named_and_dated(history: Path) -> None:
    found = trend(TrendOptions(history))
    assert [each.date for each in found.runs] == [date.fromisoformat(each) for each in DAYS]  # not as folders sort
    told = found.to_dict()
    (change,) = told["changes"]
    assert change["between"] == list(DAYS[2:]) and found.exit_code == 1
    assert [each["name"] for each in change["named"]] == ["link3.theta"]
    low, high = change["named"][0]["interval_95"]
    assert low < MOVED_RAD < high and high - low < 0.02e-3
    said = " ".join(found.summary().split())
    assert "changed between 2026-03-09 and 2026-04-14" in said and "changed between 2026-01-10" not in said
    (row,) = change_rows(found, found.changes[0])
    assert row[:3] == ("2026-03-09 (run1)", "2026-04-14 (run0)", "zero of joint 3 (link3.theta)")
    assert row[3].startswith("+0.") and row[4].startswith("± 0.0") and row[5:7] == ("mrad", DAYS[3])
    assert "Next: Use the calibration of 2026-04-14" in said and said.index("Next:") < said.index("Errors at positions")


def test_the_end_joints_show_only_where_base_and_tool_were_kept(history: Path) -> None:
    anew = trend(TrendOptions(history)).to_dict()["minimum_detectable_change"]
    hidden = {name for name, sizes in anew.items() if sizes["set_up_anew"] is None}
    assert hidden == {"joint1_mrad", "joint6_mrad"}
    assert all(0 < sizes["base_and_tool_kept"] < 0.2 for sizes in anew.values())
    assert all(sizes["set_up_anew"] < MOVED_RAD * 1e3 for name, sizes in anew.items() if name not in hidden)
    kept = trend(TrendOptions(history, kept=("base", "tool")))
    assert [each.named for each in kept.changes] == [("link3.theta",)]
    assert "zeros of joints 1 and 6 cannot be separated" in " ".join(trend(TrendOptions(history)).summary().split())
    assert "cannot be separated" not in kept.summary()


def test_what_is_no_dated_run_is_left_out_and_told(history: Path, tmp_path: Path) -> None:
    shutil.copytree(history, tmp_path / "runs")
    shutil.rmtree(tmp_path / "runs" / "run0")
    shutil.copytree(tmp_path / "runs" / "run1", tmp_path / "runs" / "run9")
    config = tmp_path / "runs" / "run2" / "config.json"
    undated = json.loads(config.read_text())
    undated["options"]["date"] = None
    config.write_text(json.dumps(undated))
    (tmp_path / "runs" / "notes").mkdir()
    found = trend(TrendOptions(tmp_path / "runs"))
    assert [each.run.folder.name for each in found.runs] == ["run3", "run1"] and not found.changes
    twin, no_date = sorted(found.left_out, reverse=True)
    assert "run9: has the same measurements as run1" in twin and "run2: has no date" in no_date


def test_the_first_calibration_is_no_trend_yet(history: Path, tmp_path: Path) -> None:
    shutil.copytree(history / "run3", tmp_path / "runs" / "run3")
    found = trend(TrendOptions(tmp_path / "runs"))
    assert found.exit_code == 0 and not found.changes and len(found.runs) == 1
    assert found.summary().startswith("irb120: one run, no trend yet") and "one run: no trend yet" in found.summary()
    assert "over time" not in found.summary()  # nor a picture of a single point
    sizes = found.to_dict()["minimum_detectable_change"]["joint3_mrad"]
    assert 0 < sizes["set_up_anew"] < MOVED_RAD * 1e3  # the next calibration would find it


@pytest.mark.parametrize(
    ("file", "content", "says"),
    [
        ("parameters.json", None, "parameters.json was changed since the run was written"),
        ("result.json", "{", "result.json"),
        ("config.json", "[]", "config.json"),
        ("covariance.csv", "", "covariance.csv"),
    ],
)
def test_one_edited_run_is_left_out_by_name(
    history: Path, tmp_path: Path, file: str, content: str | None, says: str
) -> None:
    shutil.copytree(history, tmp_path / "runs")
    edited = tmp_path / "runs" / "run2" / file
    edited.write_text(f"{edited.read_text()} " if content is None else content)
    found = trend(TrendOptions(tmp_path / "runs"))
    assert [each.run.folder.name for each in found.runs] == ["run3", "run1", "run0"]
    (told,) = found.left_out
    assert says in told and "run2" in told and told.endswith("the run is left out") and "\n" not in told
    assert [each.named for each in found.changes] == [("link3.theta",)]


def test_runs_of_two_arms_are_no_trend_unless_one_is_chosen(history: Path, tmp_path: Path) -> None:
    for name, serial in (("run3", "A-1"), ("run2", None), ("run1", "A-1"), ("run0", "A-2")):
        run = tmp_path / "runs" / name
        shutil.copytree(history / name, run)
        config = json.loads((run / "config.json").read_text())
        config["options"]["serial"] = serial
        (run / "config.json").write_text(json.dumps(config))
        (run / CHECKSUMS).write_text(checksum_lines(run))
    with pytest.raises(LabError, match=r"run0: names the arm A-2, but .*run3 names A-1; give --serial"):
        trend(TrendOptions(tmp_path / "runs"))
    one = trend(TrendOptions(tmp_path / "runs", serial="A-1"))
    assert [each.run.folder.name for each in one.runs] == ["run3", "run1"] and one.serial == "A-1"
    assert ["has no serial number" in each or "is of the arm A-2" in each for each in one.left_out] == [True, True]
    shutil.rmtree(tmp_path / "runs" / "run0")
    assert len(trend(TrendOptions(tmp_path / "runs")).runs) == 3  # a run without a name is taken for the arm's


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["nowhere"], "nowhere: is no folder"),
        (["."], "holds 0 dated runs"),
        ([".", "--kept", "arm"], "--kept arm: unknown"),
    ],
)
def test_bad_input_is_one_line(arguments: list[str], says: str, tmp_path: Path, monkeypatch, capsys) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(["trend", *arguments]) == 2
    told = capsys.readouterr().err.strip()
    assert says in told and "\n" not in told and not list(tmp_path.iterdir())


def test_a_date_that_is_none_is_refused(capsys) -> None:
    assert main(["calibrate", "--date", "2026-13-01"]) == 2
    assert "--date 2026-13-01: is no day; write it as" in capsys.readouterr().err


@pytest.mark.figures
def test_the_page_shows_errors_and_parameters_over_time(history: Path, tmp_path: Path, capsys) -> None:
    assert main(["trend", str(history), "--out", str(tmp_path / "t")]) == 1
    page = (tmp_path / "t" / "report.html").read_text()
    assert page.count("<svg") == 3 and "link3.theta" in page and len(page) < 1_000_000
    rows = np.array(trend(TrendOptions(history)).columns()["change"]).reshape(4, -1)
    assert (rows[0] == 0).all()
