"""The group residual through the commands: an arm with waves that no other group was asked for."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from helpers.campaigns import calibration, session

import lab
from lab.core.errors import LabError
from lab.library.calibration_result import CalibrationResult

WAVING = {"poses": 60, "seed": 3, "harmonic2_mrad": 0.3, "instrument": "uniform-8um"}


@pytest.fixture
def result() -> CalibrationResult:
    return calibration(model="residual", **WAVING)


@pytest.mark.thorough
def test_it_lowers_the_error_at_poses_that_were_not_measured(result: CalibrationResult) -> None:
    geometry, found = calibration(**WAVING).to_dict(), result.to_dict()
    assert found["after_mm"]["mean"] < 0.15 * geometry["after_mm"]["mean"]
    assert found["before_mm"]["mean"] == pytest.approx(geometry["before_mm"]["mean"])  # nominal links have none of it
    assert found["model"] == "geometric+residual" and found["residual"]["p"] < 1e-9
    assert found["after_mm"]["p95"] < found["predicted_95_mm"]
    assert geometry["residual"] is None
    assert not any("lack of fit:" in warning for warning in found["warnings"])


@pytest.mark.thorough
def test_targets_are_corrected_by_it_and_a_folder_says_the_same(result: CalibrationResult, tmp_path: Path) -> None:
    result.save(tmp_path / "run")
    day = session(**WAVING)
    joints = day.robot.chain.random_joints(6, np.random.default_rng(1)) * 0.6
    wanted = day.true_robot.points(joints, ("p1",))[:, 0]
    file = tmp_path / "targets.csv"
    rows = [",".join(map(str, row)) for row in (1e3 * wanted).tolist()]
    file.write_text("\n".join(["p1_x_mm,p1_y_mm,p1_z_mm", *rows]) + "\n")
    done, again = (lab.compensate(file, run=run, no_check=True) for run in (tmp_path / "run", result))
    assert np.array_equal(done.found.joints, again.found.joints) and done.found.converged.all()
    hit = np.linalg.norm(day.true_robot.points(done.found.joints, ("p1",))[:, 0] - wanted, axis=1)
    assert hit.mean() < 2.5e-5 and (hit < 3 * done.predicted_m).all()
    assert np.allclose(done.predicted_m, again.predicted_m)


@pytest.mark.thorough
def test_an_unchanged_arm_is_verified_and_a_changed_one_is_not(result: CalibrationResult) -> None:
    day = session(**{**WAVING, "poses": 10})
    assert lab.verify(result, day.measurements).to_dict()["good"]
    moved = day.measurements.points + np.array([2e-3, 0.0, 0.0]) * (np.arange(10) % 2)[:, None, None]
    assert not lab.verify(result, replace(day.measurements, points=moved)).to_dict()["good"]


def test_wrong_requests_are_refused_in_one_line() -> None:
    for model, prior, word in (("residual", True, "--prior"), ("residual+residual", False, "--model")):
        with pytest.raises(LabError, match=word):
            lab.calibrate("irb120", model=model, prior=prior)
    with pytest.raises(LabError, match="too few"):
        lab.calibrate("irb120", model="residual", poses=12)


@pytest.mark.thorough
def test_a_run_beside_effects_of_a_session_is_written_and_read(tmp_path: Path) -> None:
    """Its offsets are predicted without the conditions that only drift or sessions ask for."""
    data = session(poses=40, seed=3, harmonic2_mrad=0.3, instrument="uniform-8um").measurements
    data = replace(data, sessions=("a",) * 20 + ("b",) * 20, points=data.points + 1e-5 * np.arange(40)[:, None, None])
    result = lab.identify(data, robot="irb120", model="drift+residual", noise_mm=0.008)
    folder = result.save(tmp_path / "run")
    joints = data.joints[:5] + 0.01
    read, held = lab.load_estimate(folder).predict(joints), result.estimate.predict(joints)
    np.testing.assert_allclose(read.points, held.points, atol=1e-12)
    np.testing.assert_allclose(read.covariance, held.covariance, rtol=1e-6)
