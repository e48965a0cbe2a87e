"""The commands as a user calls them: what they print, what they write, and the campaigns that show their models."""

import json
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest
from helpers.campaigns import calibration, run_of, session
from helpers.robots import IRB120, ROOT, data_file

import lab
from lab.cli.main import main
from lab.core import se3
from lab.core.measurements import Measurements
from lab.formats.measurement_csv import read_measurements
from lab.formats.robot_toml import read_table
from lab.kinematics.serial.serial_arm import SerialArm

FILES = {
    "SHA256SUMS", "config.json", "measurements.csv", "parameters.json", "covariance.csv", "fitted_poses.csv",
    "result.json", "calibrated.xml", "calibrated.py", "recording.rrd", "report.html",
}  # fmt: skip


def run(capsys, *arguments) -> tuple[int, dict]:
    code = main([str(argument) for argument in arguments] + ["--json"])
    return code, json.loads(capsys.readouterr().out)


@pytest.fixture(scope="module")
def seven() -> Path:
    """The run of ``lab calibrate --seed 7``."""
    return run_of(seed=7)


def stored(run: Path, name: str = "result") -> dict:
    return json.loads((run / f"{name}.json").read_text())


def test_a_virtual_campaign_reaches_the_floor(seven: Path) -> None:
    result = stored(seven)
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


def test_the_command_gives_the_bytes_of_the_call(seven: Path, tmp_path, capsys) -> None:
    out = tmp_path / "again"
    code, printed = run(capsys, "calibrate", "--seed", 7, "--out", out)
    assert code == 0
    for name in FILES - {"SHA256SUMS", "result.json"}:  # those differ in the seconds
        assert (out / name).read_bytes() == (seven / name).read_bytes(), name
    first, second = stored(seven), stored(out)
    assert second == printed
    for result in (first, second):
        assert result.pop("seconds") > 0
    assert first == second


def test_more_poses_leave_arm_and_fresh_poses_as_they_were() -> None:
    """The first 50 measured rows are the same to the last digit: same arm, tracker, poses and noise."""
    fifty, sixty = (session(seed=7, poses=poses) for poses in (50, 60))
    np.testing.assert_array_equal(sixty.measurements.points[:50], fifty.measurements.points)
    np.testing.assert_array_equal(sixty.validation.points, fifty.validation.points)


def test_the_calibrated_arm_predicts_what_was_identified(seven: Path) -> None:
    parameters = [row for row in stored(seven, "parameters") if row["status"] != "converted"]
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
    rows = {row["name"]: row for row in stored(seven, "parameters")}
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
    first, second = (stored(folder, "parameters") for folder in (seven, out))
    assert [row["estimate"] for row in first] == [row["estimate"] for row in second]
    assert result["after_mm"]["mean"] < 0.02


def test_the_exact_tracker_gives_the_truth() -> None:
    result = calibration(seed=8, instrument="exact").to_dict()
    assert result["after_mm"]["max"] <= 1e-9 and result["truth"]["max_abs_error"] <= 1e-9


@pytest.mark.thorough
def test_every_option_of_a_campaign_does_something(seven: Path) -> None:
    base = calibration(seed=7).to_dict()
    changed = {
        "instrument": "leica-at960", "readings": 4, "noise_mm": 0.01, "position_sigma_mm": 1.5,
        "rotation_sigma_mrad": 0.1, "dh_only": True, "plan": seven / "measurements.csv", "seed": 8,
    }  # fmt: skip
    for name, value in changed.items():
        result = lab.calibrate("irb120", **{"seed": 7, name: value}).to_dict()
        same = result["after_mm"] == base["after_mm"] and result["noise_mm"] == base["noise_mm"]
        assert same == (name == "plan"), name  # the plan holds the very poses that were drawn
    gated = lab.calibrate("irb120", seed=7, gate_mm=0.001)
    assert gated.exit_code == 1 and gated.verdict.word == "bad"


def day() -> Measurements:
    return session(seed=7).measurements


def test_too_few_poses_to_hold_out_are_not_judged() -> None:
    result = lab.identify(day()[:12]).to_dict()
    assert result["verdict"] == "not judged"
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


def test_a_target_of_any_name_is_identified(tmp_path) -> None:
    """A reflector that the model does not know: the calibrated model gets a site for it."""
    found = lab.identify(replace(day(), targets=("ball",)))
    found.save(tmp_path / "run")
    values = {row.name: row.estimate for row in found.parameters}
    assert np.linalg.norm([values[f"tool.ball.{axis}"] for axis in "xyz"]) > 0.05
    assert mujoco.MjModel.from_xml_path(str(tmp_path / "run" / "calibrated.xml")).site("ball").id >= 0


def test_a_wild_row_is_named() -> None:
    points = day().points.copy()
    points[20, 0, 0] += 3e-3
    (outlier,) = lab.identify(replace(day(), points=points)).to_dict()["outliers"]
    assert outlier["id"] == day().ids[20] and 1 < outlier["size_mm"] < 3


@pytest.mark.thorough
def test_a_robot_given_as_a_table_comes_back_as_a_table(tmp_path, capsys) -> None:
    """calibrated.toml reads back to the bit, and predicts what was identified."""
    table, out = ROOT / "models" / "ur10" / "robot.toml", tmp_path / "run"
    code, result = run(capsys, "identify", data_file("ur10_ipa_D.csv"), "--robot", table, "--out", out)
    assert code == 0 and result["rank"] == 27 and result["judged_by"] == "cross-validation"
    rows = [row for row in stored(out, "parameters") if row["status"] != "converted"]
    values = {row["name"]: row["exported"] for row in rows}
    back = read_table(out / "calibrated.toml")
    arm = SerialArm(back.chain)
    assert back.base is not None
    again = arm.assemble(back.base, back.chain.table, back.tool["p1"])
    assert dict(zip(arm.names, again, strict=True)) == values
    joints = back.chain.random_joints(100, np.random.default_rng(0))
    estimate = np.array([row["estimate"] for row in rows])
    np.testing.assert_allclose(arm.points(joints, again), arm.points(joints, estimate), rtol=0, atol=1e-12)


@pytest.mark.thorough
def test_joints_that_lag_are_found() -> None:
    for lag in (0.002, 0.0):
        findings = lab.calibrate("irb120", poses=60, lag=lag).diagnosis
        assert [each.name for each in findings] == ["joint_lag"] * (lag > 0)


def test_sessions_fitted_together_are_found() -> None:
    found = lab.identify(replace(day(), sessions=("monday",) * 25 + ("tuesday",) * 25))
    assert "sessions.one_setup" in {each.name for each in found.state.checks}


def test_inspect_as_json(capsys) -> None:
    code, seen = run(capsys, "inspect", "--targets", "p1,p2,p3")
    assert code == 0 and seen["rank"] == 33 and seen["poses_needed"] == 5
    rows = [[round(joint[key], 9) for key in ("theta_deg", "d_mm", "a_mm", "alpha_deg")] for joint in seen["joints"]]
    assert rows == [
        [0, 290, 0, -90], [-90, 0, 270, 0], [0, 0, 70, -90], [0, 302, 0, 90], [0, 0, 0, -90], [180, 72, 0, 0],
    ]  # fmt: skip


def test_help_needs_nothing_heavy() -> None:
    """``lab --help`` imports neither numpy nor MuJoCo nor rerun."""
    code = """
import sys
from lab.cli.main import main
try:
    main(["--help"])
except SystemExit as stop:
    assert stop.code == 0
assert not {"numpy", "mujoco", "rerun", "scipy"} & set(sys.modules)
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, cwd=ROOT, check=False)
    assert done.returncode == 0, done.stderr


@pytest.mark.thorough
def test_effects_are_found_and_told() -> None:
    soft = {"stiffness_nm_per_rad": 1e5, "harmonic_mrad": 0.2, "payload_kg": (0.0, 3.0), "poses": 80}
    found = lab.calibrate("irb120", model="auto", **soft)
    result = found.to_dict()
    table = {group["name"]: group for group in result["groups"]}
    assert {name for name, group in table.items() if group["chosen"]} == {"geometric", "harmonics", "compliance"}
    assert result["adequate"] is True and table["compliance"]["parameters"] == 2 and table["compliance"]["f_p"] < 1e-20
    chosen = min(table[name]["holdout_mm"] for name in ("compliance", "harmonics"))
    assert table["geometric"]["holdout_mm"] > 0.05 > 0.02 > chosen
    assert table["gear"]["why_not"] and table["sessions"]["why_not"]
    assert result["after_mm"]["mean"] < 0.006 and 0.5 < result["truth"]["nees_per_parameter"] < 1.7
    assert {joint: round(k, -5) for joint, k in result["stiffness_nm_per_rad"].items()} == {"q2": 1e5, "q3": 1e5}

    rigid = lab.identify(found.measurements, instrument="uniform-8um").to_dict()
    assert rigid["adequate"] is False and rigid["after_mm"]["mean"] > 0.05


@pytest.mark.thorough
def test_bad_readings_are_named_and_left_out(tmp_path) -> None:
    bad = {"bad_share": 0.06, "bad_mm": (0.1, 20.0), "poses": 60}
    plain = lab.calibrate("irb120", **bad).to_dict()
    assert plain["outliers"] and not plain["outliers_left_out"] and plain["after_mm"]["mean"] > 0.05
    found = lab.calibrate("irb120", robust=True, **bad)
    robust = found.to_dict()
    assert robust["after_mm"]["mean"] < 0.006 and robust["outliers_left_out"] and robust["adequate"] is True
    assert robust["poses"] == 60 - len(robust["outliers"])
    assert {each["id"] for each in robust["outliers"]} == {each["id"] for each in plain["outliers"]}
    assert robust["truth"]["bad_readings"] == robust["truth"]["bad_named"] == len(robust["outliers"])
    sizes = [each["size_mm"] for each in robust["outliers"]]
    assert sizes == sorted(sizes, reverse=True) and all(each["p"] < 0.02 for each in robust["outliers"])
    folder = found.save(tmp_path / "run")
    assert len((folder / "measurements.csv").read_text().splitlines()) == 61  # nothing is dropped


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


def test_inspect_names_weak_directions_and_what_would_show_them(capsys) -> None:
    code, near = run(capsys, "inspect", "irb120", "--tool-mm", "1,0,100")
    assert code == 0 and near["condition"] > 600 and len(near["weak_directions"]) == 2
    assert {"link5.d", "link5.alpha"} <= set(near["weak_directions"][0]["parts"])
    assert all(condition < 20 for condition in near["changes"].values()) and len(near["changes"]) == 3
    code, far = run(capsys, "inspect", "irb120", "--model", "compliance", "--fix", "link4.d")
    assert code == 0 and far["rank"] == 28 and far["held"] == ["link4.d"] and not far["weak_directions"]


@pytest.mark.thorough
def test_a_bumped_tracker_is_found_by_its_sessions(tmp_path) -> None:
    bumped = {"bump_mm": 0.3, "bump_mrad": 0.1, "poses": 60}
    found = lab.calibrate("irb120", model="auto", **bumped)
    result = found.to_dict()
    assert result["model"] == "geometric+sessions" and result["after_mm"]["mean"] < 0.006
    assert 0.5 < result["truth"]["nees_per_parameter"] < 1.7
    assert set(found.measurements.sessions) == {"1", "2"}
    table = (found.save(tmp_path / "run") / "measurements.csv").read_text().splitlines()
    assert table[0].startswith("session,") and {line.split(",")[0] for line in table[1:]} == {"1", "2"}
    # another file's session that happens to have the same name was not bumped
    other = replace(session(poses=20).measurements, sessions=("2",) * 20)
    far = lab.identify(found.measurements, model="sessions", validate=other).to_dict()
    assert far["after_mm"]["mean"] < 0.02


@pytest.mark.thorough
def test_what_a_model_asks_for_is_measured_on_any_arm() -> None:
    """A null experiment: groups that the arm does not have can be fitted, and are zero."""
    found = lab.calibrate("irb120", poses=60, model="backlash+drift")
    assert 0.4 < found.to_dict()["truth"]["nees_per_parameter"] < 1.8
    assert {"approach_q1", "time_s"} <= set(
        found.measurements.conditions
    ) and "payload_kg" not in found.measurements.conditions
    loaded = lab.simulate("irb120", poses=30, payload_kg=(0.0, 2.0), hours=2.0).measurements
    assert {"payload_kg", "time_s"} <= set(loaded.conditions)


@pytest.mark.thorough
def test_rows_that_are_not_fitted_decide_nothing() -> None:
    """A skipped first row without a time, or of a session of its own, is neither the clock's start nor a session."""
    rows = lab.simulate("irb120", poses=60, drift_mm_per_h=1.0).measurements
    times = rows.conditions["time_s"].copy()
    times[0] = np.nan
    sessions = ("0", *("1" if i < 30 else "2" for i in range(1, 60)))
    rows = replace(
        rows, conditions={**rows.conditions, "time_s": times}, sessions=sessions, use=("skip",) + ("calibrate",) * 59,
        marked=True,
    )  # fmt: skip
    for model in ("drift", "sessions"):
        assert lab.identify(rows, model=model, instrument="uniform-8um").identification.status == "converged", model


@pytest.mark.thorough
def test_what_cannot_be_judged_by_is_not_chosen() -> None:
    """auto leaves out a group whose condition the rows to judge by lack, and says so."""
    rows = lab.simulate("irb120", poses=60, backlash_mrad=0.3).measurements
    found = lab.identify(rows, model="auto", validate=session(poses=20).measurements, refit=("base", "tool"))
    assert "backlash" not in found.to_dict()["model"] and any("backlash not tested" in each for each in found.warnings)


@pytest.mark.thorough
def test_a_plan_starts_the_virtual_arms_clock(tmp_path) -> None:
    rows = lab.simulate("irb120", poses=60, hours=1.0).measurements
    late = replace(rows, conditions={**rows.conditions, "time_s": rows.conditions["time_s"] + 1.7e9})
    lab.write_measurements(tmp_path / "plan.csv", late)
    drifting = {"drift_mm_per_h": 0.5, "drift_mrad_per_h": 0.5, "model": "drift"}
    result = lab.calibrate("irb120", plan=tmp_path / "plan.csv", **drifting).to_dict()
    assert 0.4 < result["truth"]["nees_per_parameter"] < 1.8 and result["after_mm"]["mean"] < 0.01
