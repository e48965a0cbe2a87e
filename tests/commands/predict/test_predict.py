"""``lab predict``: the points of a calibrated arm with all its effects, in both frames, and how sure they are."""

import json
from pathlib import Path

import jsonschema
import numpy as np
import pytest
from helpers.campaigns import TWO, calibration, run_of
from helpers.robots import ROOT

import lab
from lab.cli.main import main
from lab.core import se3
from lab.core.errors import LabError
from lab.formats.calibrated_module import loaded
from lab.formats.csv_table import CsvTable
from lab.formats.measurement_csv import write_measurements
from lab.library.load_run import load_run

SOFT = {"stiffness_nm_per_rad": 1e5, "payload_kg": (0.0, 3.0), "backlash_mrad": 0.2, "model": "compliance+backlash"}


@pytest.fixture(scope="module")
def soft() -> tuple[Path, lab.CalibrationResult]:
    """A run of an arm that deflects, with play."""
    return run_of(poses=24, seed=3, targets=TWO, **SOFT), calibration(poses=24, seed=3, targets=TWO, **SOFT)


@pytest.mark.thorough
def test_the_points_are_the_arm_s_in_both_frames(soft: tuple[Path, lab.CalibrationResult]) -> None:
    folder, result = soft
    run, rows = load_run(folder), result.measurements[:12]
    found = lab.predict(rows, run=folder, force=True)
    inputs = rows.inputs(run.estimate.arm.conditions)
    np.testing.assert_array_equal(found.points, run.estimate.arm.points(inputs, run.estimate.values))
    off = np.linalg.norm(found.points - rows.points, axis=2)
    assert off.max() < 1e-4 < found.without_effects_m  # near what was measured there, which geometry alone is not
    _, values = run.estimate.geometry
    there = values.copy()
    there[:6] = 0.0
    arm = run.estimate.arm.points(inputs, np.concatenate([there, run.estimate.values[len(values) :]]))
    np.testing.assert_allclose(found.points_in_base, arm, rtol=0, atol=1e-12)
    np.testing.assert_allclose(
        found.rotations, run.estimate.arm.tool(inputs, run.estimate.values)[0][:, :3, :3], atol=1e-15
    )


def test_a_file_joints_and_measurements_say_the_same(soft: tuple[Path, lab.CalibrationResult], tmp_path: Path) -> None:
    folder, result = soft
    rows = result.measurements[:5]
    write_measurements(tmp_path / "rows.csv", rows, (False,) * 6)
    by_file = lab.predict(tmp_path / "rows.csv", run=folder, force=True)
    by_joints = lab.predict(rows.joints, run=result, conditions=rows.conditions, force=True)
    for each in (by_file, by_joints):
        np.testing.assert_allclose(each.points, lab.predict(rows, run=folder, force=True).points, rtol=0, atol=1e-15)
        np.testing.assert_allclose(each.predicted.covariance, by_file.predicted.covariance, rtol=1e-9)
    heavier = lab.predict(rows.joints, run=result, conditions={**rows.conditions, "payload_kg": 3.0}, force=True)
    empty = lab.predict(rows.joints, run=result, conditions={**rows.conditions, "payload_kg": 0.0}, force=True)
    assert np.abs(heavier.points - empty.points).max() > 1e-5


def test_the_module_of_the_run_says_the_same(soft: tuple[Path, lab.CalibrationResult]) -> None:
    folder, result = soft
    module, rows = loaded((folder / "calibrated.py").read_text(encoding="utf-8")), result.measurements[:6]
    found = lab.predict(rows, run=folder, force=True)
    for i, row in enumerate(rows.joints.tolist()):
        given = {name: float(column[i]) for name, column in rows.conditions.items()}
        T, points = module.forward(row, **given)
        np.testing.assert_allclose(list(points.values()), found.points[i], rtol=0, atol=1e-12)
        in_base = np.array(module.to_base(T))[:3, :3]
        np.testing.assert_allclose(in_base, found.T_instrument_base[:3, :3].T @ found.rotations[i], atol=1e-12)
    said = json.loads((folder / "result.json").read_text())["exports"]
    assert (
        said["calibrated.py"]["has"] == ["geometric", "compliance", "backlash"] and not said["calibrated.py"]["lacks"]
    )
    assert said["calibrated.xml"]["lacks"] == ["compliance", "backlash"] and said["calibrated.xml"]["off_mm"] > 0.1


def test_the_uncertainty_is_that_of_corrected_targets(soft: tuple[Path, lab.CalibrationResult]) -> None:
    """The error that ``lab compensate`` expects is the root of the trace of what is predicted where it leads."""
    folder, result = soft
    rows = result.measurements[:4]
    free, ids = np.full((4, 3, 3), np.nan), tuple("abcd")
    targets = lab.Targets("p1", ids, rows.points[:, 0], free, rows.joints, rows.conditions)
    done = lab.compensate(targets, run=result, force=True, no_check=True)
    there = done.run.estimate.predict(done.arm_inputs).covariance[:, done.target]
    assert len(done.reached) == 4
    np.testing.assert_allclose(np.sqrt(np.trace(there, axis1=1, axis2=2)), done.predicted_m, rtol=1e-9)
    predicted = lab.predict(rows, run=folder, force=True)
    parts = predicted.predicted
    np.testing.assert_allclose(parts.covariance, parts.parameters + parts.unmodelled + parts.visit)
    assert (np.linalg.eigvalsh(parts.covariance) > 0).all()
    radii = predicted.radii_95
    assert (radii["together"] >= radii["parameters"]).all() and (radii["parameters"] > 0).all()


def test_the_command_writes_a_table_and_json_of_its_schema(
    soft: tuple[Path, lab.CalibrationResult], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder, result = soft
    write_measurements(tmp_path / "rows.csv", result.measurements[:7], (False,) * 6)
    code = main(
        ["predict", str(folder), str(tmp_path / "rows.csv"), "--out", str(tmp_path / "out"), "--json", "--force"]
    )
    printed = json.loads(capsys.readouterr().out)
    schema = json.loads((ROOT / "docs" / "reference" / "schemas" / "predict.schema.json").read_text())
    jsonschema.validate(printed, schema)
    with pytest.raises(jsonschema.ValidationError):
        jsonschema.validate({**printed, "poses": "seven"}, schema)
    assert code == 0 and printed == json.loads((tmp_path / "out" / "result.json").read_text())
    table = CsvTable(tmp_path / "out" / "predicted.csv")
    point = printed["predictions"][2]["points"]["p2"]
    for axis, here, there in zip("xyz", point["instrument_mm"], point["base_mm"], strict=True):
        assert float(table.texts(f"p2_{axis}_mm")[2]) == here and float(table.texts(f"p2_{axis}_base_mm")[2]) == there
    assert float(table.texts("p2_cov_xy_mm2")[2]) == point["covariance_mm2"][0][1]
    assert float(table.texts("p2_radius_95_mm")[2]) == point["radius_95_mm"]["together"]
    estimate, rows = lab.load_estimate(folder), result.measurements[:7]
    there = estimate.predict(rows.inputs(estimate.arm.conditions))
    columns = [f"p2_cov_{pair}_mm2" for pair in ("xx", "xy", "xz", "yy", "yz", "zz")]
    written = np.array([table.texts(name) for name in columns], dtype=float).T
    np.testing.assert_allclose(written, 1e6 * there.covariance[:, 1][:, *np.triu_indices(3)], rtol=1e-9)
    base = printed["frames"]["base_in_instrument"]
    T = se3.pose(se3.rotation_from_quaternion(np.array(base["quaternion_wxyz"])), np.array(base["position_mm"]))
    np.testing.assert_allclose(se3.transform(T, np.array([point["base_mm"]]))[0], point["instrument_mm"], atol=1e-9)


def test_what_is_missing_or_strange_is_told(soft: tuple[Path, lab.CalibrationResult], tmp_path: Path) -> None:
    folder, result = soft
    rows = result.measurements[:2]
    with pytest.raises(LabError, match=r"column approach_.* is missing"):
        lab.predict(rows.joints, run=folder, force=True)
    with pytest.raises(LabError, match=r"give \(n, 6\) finite positions"):
        lab.predict(rows.joints[:, :5], run=folder, force=True)
    with pytest.raises(LabError, match=r"give \(n, 6\)"):
        lab.predict([["a"] * 6], run=folder, force=True)
    with pytest.raises(LabError, match="one number, or one for each pose"):
        lab.predict(rows.joints, run=folder, conditions={"payload_kg": [1.0, 2.0, 3.0]}, force=True)
    with pytest.raises(LabError, match="'run' is missing"):
        lab.predict(rows.joints)
    (tmp_path / "few.csv").write_text("q1_deg,q2_deg\n1,2\n")
    with pytest.raises(LabError, match=r"few\.csv: line 1: joint .* is missing"):
        lab.predict(tmp_path / "few.csv", run=folder, force=True)
    more = {**rows.conditions, "temp_C": np.full(2, 25.0)}
    said = " ".join(lab.predict(rows.joints, run=result, conditions=more, force=True).warnings)
    assert "temp_C makes no difference" in said
    bare = {name: column for name, column in rows.conditions.items() if name != "payload_kg"}
    said = " ".join(lab.predict(rows.joints, run=result, conditions=bare, force=True).warnings)
    assert "no column payload_kg" in said


def test_a_run_that_is_not_good_is_refused() -> None:
    unjudged = lab.identify(lab.simulate("irb120", poses=12, seed=1).measurements, noise_mm=0.005, gate_mm=0.0001)
    joints = np.zeros((1, 6))
    with pytest.raises(LabError, match="prediction is refused"):
        lab.predict(joints, run=unjudged)
    assert lab.predict(joints, run=unjudged, force=True).exit_code == 0


@pytest.mark.thorough
def test_the_true_points_are_within_the_radius() -> None:
    """95 % of the true errors, over robots; without the parameters' part far fewer are."""
    inside = []
    for seed in range(6):
        result = lab.calibrate("irb120", poses=25, seed=seed)
        fresh = result.validation.rows
        assert fresh is not None
        found = lab.predict(fresh[::20], run=result, force=True)
        off = np.linalg.norm(found.points - fresh[::20].points, axis=2)
        inside.append((off <= found.radii_95["parameters"]).mean())
        assert (off > 0.2 * found.radii_95["parameters"]).any()  # the radius is no huge one
    assert 0.85 <= np.mean(inside) <= 1.0  # six robots, whose poses share their robot's errors
