"""``lab verify``: daily touches of a socket by a virtual arm that MuJoCo moves."""

import json
from dataclasses import replace
from pathlib import Path

import jsonschema
import numpy as np
import pytest
from helpers.bad_input import run
from helpers.campaigns import calibration, run_of
from helpers.daily_checks import daily
from helpers.robots import ROOT

import lab
from lab.core.errors import LabError
from lab.formats.measurement_csv import read_measurements
from lab.library.verify import verification_of
from lab.options.command_options import VerifyOptions
from lab.sensors.sensor_registry import sensor_named

SLIP = np.array([0.0, 0.0, 0.6e-3, 0.0, 0.0, 0.0])


@pytest.fixture(scope="module")
def calibrated() -> lab.CalibrationResult:
    return calibration(poses=40, seed=1)


@pytest.fixture(scope="module")
def saved() -> Path:
    """The folder of that calibration, read only."""
    return run_of(poses=40, seed=1)


def test_an_unchanged_arm_is_good(calibrated: lab.CalibrationResult) -> None:
    result = lab.verify_touches(calibrated, daily(16))
    values = result.to_dict()
    assert values["verdict"] == "good" and result.exit_code == 0 and values["change"] is None
    assert values["checks"] == 16 and values["tested"] == 6 and values["configurations"] == 4
    assert values["repeatability_mm"] == pytest.approx(0.02, rel=0.35)
    assert {each["name"]: each["same_as"] for each in values["causes"]}["q6"] == ["the tool"]
    assert len(result.columns()["date"]) == 64


def test_the_joint_that_slipped_is_named_with_its_size_and_day(calibrated: lab.CalibrationResult) -> None:
    for seed in range(2):
        result = lab.verify_touches(calibrated, daily(16, slip_rad=SLIP, since=13, seed=seed))
        change = result.to_dict()["change"]
        assert result.verdict == "bad" and result.exit_code == 1
        assert change["first"] == "2026-03-15" and [each["name"] for each in change["causes"]] == ["q3"]
        assert abs(change["causes"][0]["size"] - 0.6) < 2 * change["causes"][0]["half_width_95"] < 0.2


def test_a_joint_that_looks_like_the_tool_is_doubtful(calibrated: lab.CalibrationResult) -> None:
    result = lab.verify_touches(calibrated, daily(14, slip_rad=np.array([0, 0, 0, 0, 0, 6e-3]), since=12))
    assert result.verdict == "doubtful" and result.exit_code == 0
    kinds = {(each["kind"], each["name"]) for each in result.to_dict()["change"]["causes"]}
    assert kinds == {("joint", "q6"), ("tool", "")}


WRONG = {  # how joint positions may be misread, and what says so
    "joint_sign": ("q2", lambda joints: joints * [1, -1, 1, 1, 1, 1]),
    "joints_exchanged": ("q2", lambda joints: joints[:, [0, 2, 1, 3, 4, 5]]),
}


@pytest.mark.parametrize("name", WRONG)
def test_misread_joints_are_named_though_every_check_repeats(calibrated: lab.CalibrationResult, name: str) -> None:
    """Wrong in the same way each day, touches repeat as well as ever: only the arm tells. Undone, all is as it was."""
    of, wrong = WRONG[name]
    right = daily(12)
    result = lab.verify_touches(calibrated, replace(right, joints=wrong(right.joints)))
    assert result.verdict == "bad" and result.exit_code == 1 and result.scan.change is None
    assert result.to_dict()["situation"]["kind"] == name.replace("_", " ")
    assert f"--accept {name}:{of}" in result.words()
    accepted = lab.verify_touches(calibrated, replace(right, joints=wrong(right.joints)), accept=(name,))
    assert accepted.verdict == "good" and accepted.to_dict()["situation"] is None
    np.testing.assert_allclose(accepted.errors, lab.verify_touches(calibrated, right).errors, atol=1e-12)


def test_few_checks_are_not_judged_and_since_begins_anew(
    calibrated: lab.CalibrationResult, saved: Path, tmp_path: Path
) -> None:
    few = lab.verify_touches(calibrated, daily(4), require="good")
    assert few.verdict == "not judged" and few.exit_code == 3
    rows = daily(26, slip_rad=SLIP, since=13)
    again = lab.verify_touches(calibrated, rows, since="2026-03-15")
    assert again.verdict == "good" and again.to_dict()["checks"] == 13
    lab.write_measurements(tmp_path / "daily.csv", rows)
    assert run(f"verify {saved} {tmp_path}/daily.csv --out {tmp_path}/out") == 1
    assert json.loads((tmp_path / "out" / "result.json").read_text())["verdict"] == "bad"


def changed(days: int = 12, **columns) -> lab.Measurements:
    data = daily(days)
    sessions = columns.get("sessions", data.sessions)
    return lab.measurements(columns.get("joints", data.joints), robot="irb120", sessions=sessions)


@pytest.mark.thorough
def test_rows_that_make_no_checks_are_refused(calibrated: lab.CalibrationResult) -> None:
    good = daily(12)
    sessions, joints = list(good.sessions), good.joints.copy()
    far = joints.copy()
    far[9, 1] += 0.5
    twice = joints.copy()
    twice[9] = twice[8]
    cases = {
        "a day that is none": (changed(sessions=[*sessions[:-1], "monday"]), "monday"),
        "no day": (changed(sessions=[*sessions[:-1], ""]), "row 47, column session: empty"),
        "another configuration": (changed(joints=far), "no configuration of the first check .* within 10°"),
        "one twice": (changed(joints=twice), "touches the same configuration as row 8"),
        "one is lacking": (good[:47], "lacks configuration 4 of the first check"),
        "too few": (good[[i for i in range(48) if i % 4 < 3]], "has 3 configurations; touch .* at least 4"),
        "one day": (good[:4], "one check has nothing to be compared with"),
    }
    for name, (data, what) in cases.items():
        with pytest.raises(LabError, match=what):
            pytest.fail(f"{name}: {lab.verify_touches(calibrated, data).verdict}")
    refused = {"--reference 2": {"reference": 2}, "--since": {"since": "May"}, "no check": {"since": "2027-01-01"}}
    for what, options in refused.items():
        with pytest.raises(LabError, match=what):
            lab.verify_touches(calibrated, good, **options)


def test_configurations_are_proposed_where_one_touch_shows_the_socket(
    calibrated: lab.CalibrationResult, saved: Path, tmp_path: Path
) -> None:
    first = daily(1)[[0]]
    plan = lab.plan_touches(calibrated, first, 5)
    arm, values = calibrated.estimate.geometry
    joints = np.array([each["joints"] for each in plan.to_dict()["plan"]]) * np.pi / 180
    assert joints.shape == (5, 6) and not calibrated.robot.chain.beyond_limits(joints, 1e-9).any()
    there = arm.points(first.joints, values)[0, 0]
    np.testing.assert_allclose(arm.points(joints, values)[:, 0], np.tile(there, (5, 1)), atol=1e-8)
    apart = np.abs(joints[:, None] - joints).max(axis=2) + 10 * np.eye(5)
    assert apart.min() > np.deg2rad(20)
    assert plan.own_share > 0.1
    plan.save(tmp_path / "plan")
    chain = calibrated.robot.chain
    columns = sensor_named("socket").columns
    back = read_measurements(tmp_path / "plan" / "plan.csv", chain.joint_names, chain.prismatic, columns=columns)
    np.testing.assert_allclose(back.joints, plan.joints, atol=1e-6)
    schema = json.loads((ROOT / "docs" / "reference" / "schemas" / "verify.schema.json").read_text())
    jsonschema.validate(json.loads((tmp_path / "plan" / "result.json").read_text()), schema)


def test_touches_are_known_by_what_the_file_holds(
    calibrated: lab.CalibrationResult, saved: Path, tmp_path: Path
) -> None:
    for name, rows in (("daily", daily(12)), ("points", calibrated.measurements[:8])):
        lab.write_measurements(tmp_path / f"{name}.csv", rows)
    assert verification_of(VerifyOptions(saved, tmp_path / "daily.csv")).to_dict()["checks"] == 12
    assert "poses" in verification_of(VerifyOptions(saved, tmp_path / "points.csv", force=True)).to_dict()
    refused = {
        "refit is of points": ("daily", {"refit": ("base",)}),
        "since is of touches": ("points", {"since": "2026-03-02"}),
        "day of the check": ("points", {"observe": "socket"}),
    }
    for what, (name, options) in refused.items():
        with pytest.raises(LabError, match=what):
            verification_of(VerifyOptions(saved, tmp_path / f"{name}.csv", force=True, **options))


def test_each_call_takes_its_own_measurements(calibrated: lab.CalibrationResult, saved: Path, tmp_path: Path) -> None:
    rows = daily(12)
    lab.write_measurements(tmp_path / "daily.csv", rows)
    for given in (rows, tmp_path / "daily.csv"):
        with pytest.raises(LabError, match=r"holds touches of a socket; give it to lab\.verify_touches"):
            lab.verify(calibrated, given)
    with pytest.raises(LabError, match=r"lab\.verify: since changes nothing here"):
        lab.verify(calibrated, rows, since="2026-03-02")
    with pytest.raises(LabError, match=r"lab\.verify_touches: refit changes nothing here"):
        lab.verify_touches(calibrated, rows, refit=("base",))
    assert lab.verify_touches(saved, tmp_path / "daily.csv").to_dict()["checks"] == 12


def test_a_plan_that_cannot_be_is_refused(calibrated: lab.CalibrationResult) -> None:
    rows = daily(1)
    for count in (3, 51):
        with pytest.raises(LabError, match="--plan"):
            lab.plan_touches(calibrated, rows, count)
    other = rows.joints.copy()
    other[1, 1] += 0.2
    with pytest.raises(LabError, match="mm from where the other touches have socket"):
        lab.plan_touches(calibrated, lab.measurements(other[:3], robot="irb120"))
