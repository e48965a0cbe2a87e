"""The commands as a user calls them: what they print, what they write, what they promise."""

import json
import shutil
import subprocess
import sys
from pathlib import Path

import mujoco
import numpy as np
import pytest
from helpers.robots import IRB120, ROOT, data_file

from lab.cli import main
from lab.core import se3
from lab.formats.measurement_csv import read_measurements
from lab.formats.robot_toml import read_table
from lab.kinematics.serial.arm import SerialArm

FILES = {
    "SHA256SUMS",
    "config.json",
    "measurements.csv",
    "parameters.json",
    "covariance.csv",
    "fitted_poses.csv",
    "result.json",
    "calibrated.xml",
    "calibrated.py",
    "recording.rrd",
    "report.html",
}


def run(capsys, *arguments) -> tuple[int, dict]:
    code = main([str(argument) for argument in arguments] + ["--json"])
    return code, json.loads(capsys.readouterr().out)


@pytest.fixture(scope="module")
def seven(tmp_path_factory) -> Path:
    """The run of ``lab calibrate --seed 7 --poses 50``."""
    out = tmp_path_factory.mktemp("runs") / "seven"
    assert main(["calibrate", "--seed", "7", "--poses", "50", "--out", str(out), "--json"]) == 0
    return out


def test_a_virtual_campaign_reaches_the_floor(seven: Path) -> None:
    result = json.loads((seven / "result.json").read_text())
    assert {path.name for path in seven.iterdir()} == FILES
    assert (result["rank"], result["parameters"], result["identifiable"]) == (27, 34, 27)
    assert result["status"] == "converged" and result["iterations"] <= 8
    assert result["verdict"] == "good" and result["judged_by"] == "fresh"
    assert 0.3 < result["before_mm"]["mean"] < 7
    assert result["after_mm"]["mean"] <= 0.006 and result["after_mm"]["max"] <= 0.02
    assert result["before_mm"]["count"] == result["after_mm"]["count"] == 1000
    assert result["noise_mm"] == pytest.approx(8e-3 / np.sqrt(3))
    assert 0.3 < result["truth"]["nees_per_parameter"] < 2 and result["truth"]["max_abs_z"] < 5
    assert not result["outliers"] and not result["warnings"]


def test_the_same_seed_gives_the_same_bytes(seven: Path, tmp_path, capsys) -> None:
    out = tmp_path / "again"
    code, printed = run(capsys, "calibrate", "--seed", 7, "--out", out)
    assert code == 0
    for name in FILES - {"SHA256SUMS", "result.json", "recording.rrd"}:  # those differ in the seconds
        assert (out / name).read_bytes() == (seven / name).read_bytes(), name
    first, second = (json.loads((folder / "result.json").read_text()) for folder in (seven, out))
    assert second == printed
    for result in (first, second):
        assert result.pop("seconds") > 0
    assert first == second


def test_more_poses_leave_arm_and_fresh_poses_as_they_were(seven: Path, tmp_path, capsys) -> None:
    """The first 50 measured rows are the same to the last digit: same arm, tracker, poses and noise."""
    out = tmp_path / "sixty"
    code, result = run(capsys, "calibrate", "--seed", 7, "--poses", 60, "--out", out)
    assert code == 0 and result["poses"] == 60
    fifty, sixty = ((folder / "measurements.csv").read_text().splitlines() for folder in (seven, out))
    assert sixty[:51] == fifty


def test_the_calibrated_arm_predicts_what_was_identified(seven: Path) -> None:
    parameters = [row for row in json.loads((seven / "parameters.json").read_text()) if row["status"] != "converted"]
    arm = SerialArm(IRB120.chain)
    assert [row["name"] for row in parameters] == list(arm.names)
    values = np.array([row["estimate"] for row in parameters])
    model = mujoco.MjModel.from_xml_path(str(seven / "calibrated.xml"))
    data, tracker, site = mujoco.MjData(model), model.site("tracker").id, model.site("p1").id
    for joints in IRB120.chain.random_joints(200, np.random.default_rng(0)):
        data.qpos[:] = joints
        mujoco.mj_kinematics(model, data)
        T = se3.pose(data.site_xmat[tracker].reshape(3, 3), data.site_xpos[tracker])
        seen = se3.transform(se3.inverse(T), data.site_xpos[site][None])[0]
        np.testing.assert_allclose(seen, arm.points(joints[None], values)[0, 0], atol=1e-12)


def test_the_parameter_file_says_what_is_fixed_and_where_it_hides(seven: Path) -> None:
    rows = {row["name"]: row for row in json.loads((seven / "parameters.json").read_text())}
    fixed = {name for name, row in rows.items() if row["status"] == "fixed"}
    assert fixed == {"link1.theta", "link1.d", "link2.d", *(f"link6.{c}" for c in ("theta", "d", "a", "alpha"))}
    assert list(rows["link2.d"]["aliases"]) == ["link3.d"] and rows["link2.d"]["std"] is None
    assert rows["link2.d"]["aliases"]["link3.d"] == pytest.approx(1)
    row = rows["link3.a"]
    assert row["unit"] == "m" and rows["link3.alpha"]["unit"] == "rad"
    low, high = row["interval_95"]
    assert low < row["estimate"] < high and high - low == pytest.approx(2 * 1.96 * row["std"], rel=1e-3)


def test_the_measurements_of_a_run_identify_the_same_arm(seven: Path, tmp_path, capsys) -> None:
    """The file that a campaign writes is what identify reads: the same estimates, judged by cross-validation."""
    out = tmp_path / "identified"
    code, result = run(
        capsys, "identify", seven / "measurements.csv", "--instrument", "uniform-8um", "--out", out
    )  # fmt: skip
    assert code == 0 and result["judged_by"] == "cross-validation"
    first, second = (json.loads((f / "parameters.json").read_text()) for f in (seven, out))
    assert [row["estimate"] for row in first] == [row["estimate"] for row in second]
    assert result["after_mm"]["mean"] < 0.02


@pytest.mark.thorough
def test_the_exact_tracker_gives_the_truth(tmp_path, capsys) -> None:
    for seed in (7, 8):
        code, result = run(capsys, "calibrate", "--seed", seed, "--instrument", "exact", "--out", tmp_path / str(seed))
        assert code == 0 and result["after_mm"]["max"] <= 1e-9
        assert result["truth"]["max_abs_error"] <= 1e-9


def test_three_targets_have_rank_33(tmp_path, capsys) -> None:
    code, result = run(capsys, "calibrate", "--targets", "p1,p2,p3", "--out", tmp_path / "run")
    assert code == 0 and result["rank"] == 33 and result["targets"] == ["p1", "p2", "p3"]


@pytest.mark.thorough
def test_every_option_of_a_campaign_does_something(seven: Path, tmp_path, capsys) -> None:
    base = json.loads((seven / "result.json").read_text())
    plan = tmp_path / "plan.csv"
    shutil.copy(seven / "measurements.csv", plan)
    changed = {
        "--instrument": "leica-at960",
        "--readings": "4",
        "--noise-mm": "0.01",
        "--position-sigma-mm": "1.5",
        "--rotation-sigma-mrad": "0.1",
        "--dh-only": None,
        "--plan": str(plan),
        "--seed": "8",
    }
    for flag, value in changed.items():
        given = [flag] if value is None else [flag, value]
        seed = [] if flag == "--seed" else ["--seed", 7]
        code, result = run(capsys, "calibrate", *seed, *given, "--out", tmp_path / flag.strip("-"))
        assert code == 0
        same = result["after_mm"] == base["after_mm"] and result["noise_mm"] == base["noise_mm"]
        assert same == (flag == "--plan"), flag  # the plan holds the very poses that were drawn
    code, result = run(capsys, "calibrate", "--seed", 7, "--gate-mm", "0.001", "--out", tmp_path / "gate")
    assert code == 1 and result["verdict"] == "bad" and "does not fit" in result["reason"]


@pytest.mark.thorough
def test_another_arms_measurements_exit_with_one(tmp_path, capsys) -> None:
    few = tmp_path / "few.csv"
    few.write_text("".join(data_file("ur10_ipa_D.csv").read_text().splitlines(keepends=True)[:81]))  # of 80 poses
    flags = ("--robot", "irb120", "--holdout", 0.3, "--out", tmp_path / "run")
    code, result = run(capsys, "identify", few, *flags)
    assert code == 1 and result["verdict"] == "bad"


def test_too_few_poses_to_hold_out_are_not_judged(seven: Path, tmp_path, capsys) -> None:
    lines = (seven / "measurements.csv").read_text().splitlines()
    few = tmp_path / "few.csv"
    few.write_text("\n".join(lines[:13]) + "\n")
    code, result = run(capsys, "identify", few, "--out", tmp_path / "run")
    assert code == 0 and result["verdict"] == "not judged"
    assert result["before_mm"] is result["after_mm"] is result["judged_by"] is None


def test_rows_marked_for_a_test_are_judged_and_never_fitted(seven: Path, tmp_path, capsys) -> None:
    lines = (seven / "measurements.csv").read_text().splitlines()
    uses = ["use"] + ["calibrate"] * 35 + ["test"] * 10 + ["skip"] * 5
    marked = tmp_path / "marked.csv"
    marked.write_text("\n".join(f"{use},{line}" for use, line in zip(uses, lines, strict=True)) + "\n")
    code, result = run(capsys, "identify", marked, "--out", tmp_path / "run")
    assert code == 0 and result["judged_by"] == "holdout"
    assert result["poses"] == 35 and result["after_mm"]["count"] == 10
    back = read_measurements(tmp_path / "run" / "measurements.csv", IRB120.chain.joint_names, IRB120.chain.prismatic)
    assert len(back) == 50 and back.use.count("skip") == 5


def test_a_target_of_any_name_is_identified(seven: Path, tmp_path, capsys) -> None:
    """A reflector that the model does not know: the calibrated model gets a site for it."""
    renamed = tmp_path / "ball.csv"
    renamed.write_text((seven / "measurements.csv").read_text().replace("p1_", "ball_"))
    code, result = run(capsys, "identify", renamed, "--out", tmp_path / "run")
    assert code == 0 and result["targets"] == ["ball"]
    model = mujoco.MjModel.from_xml_path(str(tmp_path / "run" / "calibrated.xml"))
    values = {row["name"]: row["estimate"] for row in json.loads((tmp_path / "run" / "parameters.json").read_text())}
    assert np.linalg.norm([values[f"tool.ball.{axis}"] for axis in "xyz"]) > 0.05
    assert model.site("ball").id >= 0


@pytest.mark.thorough
def test_metres_in_a_column_of_millimetres_are_a_bad_result(seven: Path, tmp_path, capsys) -> None:
    """They fit well, an arm a thousand times smaller: the verdict says so."""
    lines = (seven / "measurements.csv").read_text().splitlines()
    rows = [line.split(",") for line in lines[1:]]
    shrunk = [",".join([*row[:6], *(repr(float(cell) / 1e3) for cell in row[6:])]) for row in rows]
    path = tmp_path / "metres.csv"
    path.write_text("\n".join([lines[0], *shrunk]) + "\n")
    code, result = run(capsys, "identify", path, "--out", tmp_path / "run")
    assert code == 1 and result["verdict"] == "bad" and "wrong unit" in result["reason"]


def test_sessions_fitted_together_are_a_warning(seven: Path, tmp_path, capsys) -> None:
    lines = (seven / "measurements.csv").read_text().splitlines()
    both = tmp_path / "both.csv"
    names = ["session"] + ["monday"] * 25 + ["tuesday"] * 25
    both.write_text("\n".join(f"{name},{line}" for name, line in zip(names, lines, strict=True)) + "\n")
    _, result = run(capsys, "identify", both, "--out", tmp_path / "run")
    assert any("monday, tuesday" in warning for warning in result["warnings"])


def test_a_wild_row_is_named(seven: Path, tmp_path, capsys) -> None:
    lines = (seven / "measurements.csv").read_text().splitlines()
    cells = lines[21].split(",")
    cells[6] = str(float(cells[6]) + 3.0)
    lines[21] = ",".join(cells)
    wild = tmp_path / "wild.csv"
    wild.write_text("\n".join(lines) + "\n")
    _, result = run(capsys, "identify", wild, "--out", tmp_path / "run")
    assert [(outlier["id"], outlier["line"]) for outlier in result["outliers"]] == [("20", 22)]
    assert 1 < result["outliers"][0]["size_mm"] < 3


@pytest.mark.thorough
def test_a_robot_given_as_a_table_comes_back_as_a_table(tmp_path, capsys) -> None:
    """calibrated.toml reads back to the bit, and predicts what was identified."""
    table, out = ROOT / "models" / "ur10" / "robot.toml", tmp_path / "run"
    code, result = run(capsys, "identify", data_file("ur10_ipa_D.csv"), "--robot", table, "--out", out)
    assert code == 0 and result["rank"] == 27 and result["judged_by"] == "cross-validation"
    assert any("rx_deg" in warning for warning in result["warnings"])
    rows = [row for row in json.loads((out / "parameters.json").read_text()) if row["status"] != "converted"]
    values = {row["name"]: row["exported"] for row in rows}
    back = read_table(out / "calibrated.toml")
    arm = SerialArm(back.chain)
    assert back.base is not None
    again = arm.assemble(back.base, back.chain.table, back.tool["p1"])
    assert dict(zip(arm.names, again, strict=True)) == values
    joints = back.chain.random_joints(100, np.random.default_rng(0))
    estimate = np.array([row["estimate"] for row in rows])
    np.testing.assert_allclose(arm.points(joints, again), arm.points(joints, estimate), rtol=0, atol=1e-12)


def test_inspect_prints_the_table_of_the_drawing(capsys) -> None:
    assert main(["inspect", "irb120"]) == 0
    printed = capsys.readouterr().out
    rows = [line.replace("│", " ").split() for line in printed.splitlines() if line.startswith("│")]
    assert [" ".join(row) for row in rows[:6]] == [
        "1 q1 290 0 −90 −165 … 165 250",
        "2 q2 − 90 0 270 0 −110 … 110 250",
        "3 q3 0 70 −90 −110 … 70 250",
        "4 q4 302 0 90 −160 … 160 320",
        "5 q5 0 0 −90 −120 … 120 320",
        "6 q6 + 180 72 0 0 −400 … 400 420",
    ]
    assert "27 of 34" in printed and "link2.d is aliased with link3.d" in printed


def test_inspect_as_json(capsys) -> None:
    code, seen = run(capsys, "inspect", "--targets", "p1,p2,p3")
    assert code == 0 and seen["rank"] == 33 and seen["poses_needed"] == 5
    assert seen["joints"][1]["theta_deg"] == -90 and seen["joints"][1]["a_mm"] == 270


def test_help_needs_nothing_heavy() -> None:
    """``lab --help`` imports neither numpy nor MuJoCo nor rerun."""
    code = """
import sys
from lab.cli import main
try:
    main(["--help"])
except SystemExit as stop:
    assert stop.code == 0
assert not {"numpy", "mujoco", "rerun", "scipy"} & set(sys.modules)
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, cwd=ROOT, check=False)
    assert done.returncode == 0, done.stderr
    for command in ("calibrate", "identify", "inspect"):
        assert command in done.stdout


def test_a_person_reads_the_outcome(tmp_path, capsys) -> None:
    assert main(["calibrate", "--seed", "7", "--out", str(tmp_path / "run")]) == 0
    printed = capsys.readouterr().out
    for words in ("27 of 34 parameters", "before", "after", "validation", "Verdict: good", "mm (1σ, given)"):
        assert words in printed


def test_the_default_folder_is_never_overwritten(tmp_path, monkeypatch, capsys) -> None:
    monkeypatch.chdir(tmp_path)
    for _ in range(2):
        assert main(["calibrate", "--json"]) == 0
    assert {path.name for path in (tmp_path / "runs").iterdir()} == {
        "calibrate-irb120-seed0",
        "calibrate-irb120-seed0-2",
    }


SOFT = ("--stiffness-nm-per-rad", "1e5", "--harmonic-mrad", "0.2", "--payload-kg", "0,3", "--poses", "80")


@pytest.mark.thorough
def test_effects_are_found_and_told(tmp_path, capsys) -> None:
    out = tmp_path / "run"
    code, result = run(capsys, "calibrate", *SOFT, "--model", "auto", "--out", out)
    assert code == 0 and result["adequate"] is True
    assert result["model"] in ("geometric+harmonics+compliance", "geometric+compliance+harmonics")
    table = {group["name"]: group for group in result["groups"]}
    assert {name for name, group in table.items() if group["chosen"]} == {"geometric", "harmonics", "compliance"}
    assert table["compliance"]["parameters"] == 2 and table["compliance"]["f_p"] < 1e-20
    assert (
        table["geometric"]["holdout_mm"]
        > 0.05
        > 0.02
        > min(table[name]["holdout_mm"] for name in ("compliance", "harmonics"))
    )
    assert "significant" in table["gear"]["why_not"] and "one session" in table["sessions"]["why_not"]
    assert result["after_mm"]["mean"] < 0.006 and 0.5 < result["truth"]["nees_per_parameter"] < 1.7
    assert {joint: round(k, -5) for joint, k in result["stiffness_nm_per_rad"].items()} == {"q2": 1e5, "q3": 1e5}
    rows = {row["name"]: row for row in json.loads((out / "parameters.json").read_text())}
    assert rows["joint2.compliance"]["unit"] == "rad/Nm" and rows["joint2.compliance"]["status"] == "identified"
    assert (out / "recording.rrd").is_file() and "payload_kg" in (out / "measurements.csv").read_text().splitlines()[0]

    code, again = run(capsys, "identify", out / "measurements.csv", "--instrument", "uniform-8um", "--model",
                      "compliance+harmonics", "--out", tmp_path / "again")  # fmt: skip
    assert code == 0 and [group["name"] for group in again["groups"]] == ["geometric", "compliance", "harmonics"]
    assert all(group["chosen"] and not group["why_not"] for group in again["groups"])
    assert again["groups"][2]["holdout_mm"] < 0.02 < again["groups"][1]["holdout_mm"] < again["groups"][0]["holdout_mm"]
    assert again["after_mm"]["mean"] < 0.012 and again["parameters"] == 48

    code, rigid = run(
        capsys, "identify", out / "measurements.csv", "--instrument", "uniform-8um", "--out", tmp_path / "rigid"
    )
    assert code == 0 and rigid["adequate"] is False and rigid["after_mm"]["mean"] > 0.05
    assert any("lack of fit" in warning for warning in rigid["warnings"])


@pytest.mark.thorough
def test_bad_readings_are_named_and_left_out(tmp_path, capsys) -> None:
    bad = ("--bad-share", "0.06", "--bad-mm", "0.1,20", "--poses", "60")
    code, plain = run(capsys, "calibrate", *bad, "--out", tmp_path / "plain")
    assert code in (0, 1) and plain["outliers"] and not plain["outliers_left_out"] and plain["after_mm"]["mean"] > 0.05
    assert any("--robust would exclude them" in warning for warning in plain["warnings"])
    code, robust = run(capsys, "calibrate", *bad, "--robust", "--out", tmp_path / "robust")
    assert code == 0 and robust["after_mm"]["mean"] < 0.006 and robust["outliers_left_out"]
    assert robust["poses"] == 60 - len(robust["outliers"]) and robust["adequate"] is True
    assert {each["id"] for each in robust["outliers"]} == {each["id"] for each in plain["outliers"]}
    assert robust["truth"]["bad_readings"] == robust["truth"]["bad_named"] == len(robust["outliers"])
    sizes = [each["size_mm"] for each in robust["outliers"]]
    assert sizes == sorted(sizes, reverse=True) and all(each["p"] < 0.02 for each in robust["outliers"])
    assert len((tmp_path / "robust" / "measurements.csv").read_text().splitlines()) == 61  # nothing is dropped


@pytest.mark.thorough
def test_joints_that_lag_are_told(tmp_path, capsys) -> None:
    for lag, told in ((0.002, True), (0.0, False)):
        _, result = run(capsys, "calibrate", "--lag", lag, "--poses", "60", "--out", tmp_path / str(lag))
        assert any("do not follow the arm" in warning for warning in result["warnings"]) is told


@pytest.mark.thorough
def test_spherical_noise_taken_for_isotropic_is_told(tmp_path, capsys) -> None:
    out = tmp_path / "run"
    run(capsys, "calibrate", "--instrument", "leica-at960", "--poses", "80", "--out", out)
    _, plain = run(capsys, "identify", out / "measurements.csv", "--out", tmp_path / "plain")
    uneven = [w for w in plain["warnings"] if "times those along it" in w]
    assert len(uneven) == 1 and "cluster-robust by pose" in uneven[0]
    assert "arm or instrument may cause" in uneven[0]  # one target a pose: the instrument cannot be told from the arm
    _, weighed = run(
        capsys, "identify", out / "measurements.csv", "--instrument", "leica-at960", "--out", tmp_path / "w"
    )
    assert weighed["adequate"] is True and not any("isotropic" in warning for warning in weighed["warnings"])


@pytest.mark.thorough
def test_a_config_runs_again(tmp_path, capsys) -> None:
    out = tmp_path / "run"
    asked = ("--seed", "4", "--poses", "30", "--harmonic-mrad", "0.1", "--model", "harmonics", "--payload-kg", "0,2")
    run(capsys, "calibrate", *asked, "--out", out)
    run(capsys, "calibrate", "--config", out / "config.json", "--out", tmp_path / "again")
    for name in ("config.json", "measurements.csv", "parameters.json"):
        assert (out / name).read_bytes() == (tmp_path / "again" / name).read_bytes()
    _, other = run(capsys, "calibrate", "--config", out / "config.json", "--poses", "31", "--out", tmp_path / "more")
    assert other["poses"] == 31 and other["model"] == "geometric+harmonics"
    run(capsys, "identify", out / "measurements.csv", "--holdout", "0.2", "--out", tmp_path / "id")
    _, once = run(capsys, "identify", "--config", tmp_path / "id" / "config.json", "--out", tmp_path / "id2")
    assert once["judged_by"] == "holdout"


@pytest.mark.thorough
def test_inspect_names_weak_directions_and_what_would_show_them(capsys) -> None:
    code, near = run(capsys, "inspect", "irb120", "--tool-mm", "1,0,100")
    assert code == 0 and near["condition"] > 600 and len(near["weak_directions"]) == 2
    assert {"link5.d", "link5.alpha"} <= set(near["weak_directions"][0]["parts"])
    assert all(condition < 20 for condition in near["changes"].values()) and len(near["changes"]) == 3
    code, far = run(capsys, "inspect", "irb120", "--model", "compliance", "--fix", "link4.d")
    assert code == 0 and far["rank"] == 28 and far["held"] == ["link4.d"] and not far["weak_directions"]
    assert main(["inspect", "irb120", "--tool-mm", "1,0,100"]) == 0
    printed = " ".join(capsys.readouterr().out.split())
    assert "weakly observable, relative singular value 1/668" in printed
    assert "with a second target the condition number would be" in printed


@pytest.mark.thorough
def test_a_bumped_tracker_is_found_by_its_sessions(tmp_path, capsys) -> None:
    bumped = ("calibrate", "--bump-mm", "0.3", "--bump-mrad", "0.1", "--poses", "60", "--out", tmp_path / "run")
    _, plain = run(capsys, *bumped)
    assert plain["adequate"] is False and any("--model sessions" in warning for warning in plain["warnings"])
    code, result = run(capsys, *bumped, "--overwrite", "--model", "auto")
    assert code == 0 and result["model"] == "geometric+sessions" and result["after_mm"]["mean"] < 0.006
    assert 0.5 < result["truth"]["nees_per_parameter"] < 1.7
    assert [w.split(";")[0] for w in result["warnings"]] == ["calibrated.xml cannot store sessions"]
    table = (tmp_path / "run" / "measurements.csv").read_text().splitlines()
    assert table[0].startswith("session,") and {line.split(",")[0] for line in table[1:]} == {"1", "2"}


@pytest.mark.thorough
def test_what_a_model_asks_for_is_written_down_on_any_arm(tmp_path, capsys) -> None:
    """A null experiment: groups that the arm does not have can be fitted, and are zero."""
    asked = ("calibrate", "--poses", "60", "--model", "backlash+drift", "--out", tmp_path / "run")
    code, result = run(capsys, *asked)
    assert code == 0 and 0.4 < result["truth"]["nees_per_parameter"] < 1.8
    header = (tmp_path / "run" / "measurements.csv").read_text().splitlines()[0]
    assert "approach_q1" in header and "time_s" in header and "payload_kg" not in header
    run(capsys, "calibrate", "--poses", "30", "--payload-kg", "0,2", "--hours", "2", "--out", tmp_path / "set")
    header = (tmp_path / "set" / "measurements.csv").read_text().splitlines()[0]
    assert "payload_kg" in header and "time_s" in header


@pytest.mark.thorough
def test_a_bump_is_of_its_campaign_alone(tmp_path, capsys) -> None:
    """Another file's session that happens to have the same name was not bumped."""
    run(capsys, "calibrate", "--bump-mm", "1", "--poses", "60", "--out", tmp_path / "run")
    run(capsys, "calibrate", "--poses", "20", "--out", tmp_path / "other")
    rows = (tmp_path / "other" / "measurements.csv").read_text().splitlines()
    other = tmp_path / "other.csv"
    other.write_text("\n".join([f"session,{rows[0]}", *(f"2,{row}" for row in rows[1:])]) + "\n")
    file = tmp_path / "run" / "measurements.csv"
    _, result = run(capsys, "identify", file, "--model", "sessions", "--validate", other, "--out", tmp_path / "id")
    assert result["after_mm"]["mean"] < 0.02


def marked(path, extra: str, rows: dict) -> None:
    """A measurement file with one more column."""
    lines = path.read_text().splitlines()
    cells = [rows.get(i, "calibrate") for i in range(len(lines) - 1)]
    path.write_text(
        "\n".join([f"{extra},{lines[0]}", *(f"{c},{line}" for c, line in zip(cells, lines[1:], strict=True))])
    )


@pytest.mark.thorough
def test_rows_that_are_not_fitted_decide_nothing(tmp_path, capsys) -> None:
    """A skipped first row without a time, or of a session of its own, is neither the clock's start nor a session."""
    run(capsys, "calibrate", "--poses", "60", "--drift-mm-per-h", "1", "--out", tmp_path / "run")
    file = tmp_path / "run" / "measurements.csv"
    lines = file.read_text().splitlines()
    column = lines[0].split(",").index("time_s")
    first = lines[1].split(",")
    first[column] = ""
    file.write_text("\n".join([lines[0], ",".join(first), *lines[2:]]) + "\n")
    marked(file, "use", {0: "skip"})
    marked(file, "session", {i: "0" if i == 0 else "1" if i < 30 else "2" for i in range(60)})
    for model in ("drift", "auto", "sessions"):
        code, result = run(capsys, "identify", file, "--model", model, "--instrument", "uniform-8um", "--out",
                           tmp_path / model)  # fmt: skip
        assert code == 0 and result["status"] == "converged", model


@pytest.mark.thorough
def test_what_cannot_be_judged_by_is_not_chosen(tmp_path, capsys) -> None:
    """auto leaves out a group whose condition the rows to judge by lack, and says so."""
    run(capsys, "calibrate", "--poses", "60", "--backlash-mrad", "0.3", "--out", tmp_path / "run")
    run(capsys, "calibrate", "--poses", "20", "--out", tmp_path / "other")
    file, other = (tmp_path / name / "measurements.csv" for name in ("run", "other"))
    code, result = run(capsys, "identify", file, "--model", "auto", "--validate", other, "--refit", "base,tool",
                       "--out", tmp_path / "id")  # fmt: skip
    assert "backlash" not in result["model"] and any("backlash not tested" in w for w in result["warnings"])
    code, result = run(capsys, "identify", file, "--model", "auto", "--out", tmp_path / "alone")
    assert code == 0 and result["model"] == "geometric+backlash"


@pytest.mark.thorough
def test_a_plan_starts_the_virtual_arms_clock(tmp_path, capsys) -> None:
    run(capsys, "calibrate", "--poses", "60", "--hours", "1", "--out", tmp_path / "run")
    lines = (tmp_path / "run" / "measurements.csv").read_text().splitlines()
    column = lines[0].split(",").index("time_s")
    late = [line.split(",") for line in lines[1:]]
    for cells in late:
        cells[column] = str(float(cells[column]) + 1.7e9)
    plan = tmp_path / "plan.csv"
    plan.write_text("\n".join([lines[0], *(",".join(cells) for cells in late)]) + "\n")
    code, result = run(capsys, "calibrate", "--plan", plan, "--drift-mm-per-h", "0.5", "--drift-mrad-per-h", "0.5",
                       "--model", "drift", "--out", tmp_path / "drifts")  # fmt: skip
    assert code == 0 and 0.4 < result["truth"]["nees_per_parameter"] < 1.8 and result["after_mm"]["mean"] < 0.01
