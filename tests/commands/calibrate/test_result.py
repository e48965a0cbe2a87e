"""What one holds after a calibration: the numbers in one order, and the truth of a virtual arm alone."""

import json
import pickle

import numpy as np
import pytest

import lab
from lab.library.calibration_result import CalibrationResult


@pytest.fixture(scope="module")
def day() -> lab.MeasurementSession:
    return lab.simulate("irb120", poses=40, seed=7, targets=("p1", "p2"))


@pytest.fixture(scope="module")
def measured(day: lab.MeasurementSession) -> CalibrationResult:
    return lab.identify(day.measurements, instrument="uniform-8um")


def test_values_are_in_the_order_of_the_estimates_parameters(measured: CalibrationResult) -> None:
    rows = measured.estimate.params.values()
    assert measured.values.shape == (len(rows),)
    np.testing.assert_array_equal(measured.values, [row.estimate for row in rows])
    written = measured.to_dict()
    assert written["parameters"] == len(rows) and written["rank"] == len(measured.estimate.identified)
    assert {each.name for each in measured.checks} == {each.name for each in measured.state.checks}
    measured.values[:] = 0.0  # a copy: the result stays
    assert np.abs(measured.values).max() > 0


def test_without_poses_to_validate_on_the_errors_are_of_none(day: lab.MeasurementSession) -> None:
    few = lab.identify(day.measurements[:8], instrument="uniform-8um")
    assert not few.validated and few.verdict.word == "not judged" and few.to_dict()["after_mm"] is None
    assert few.after.count == 0 and np.isnan(few.after.mean) and few.summary()


def test_the_truth_is_of_a_virtual_arm_and_of_no_measured_one(
    day: lab.MeasurementSession, measured: CalibrationResult
) -> None:
    simulated = lab.calibrate("irb120", poses=40, seed=7, targets=("p1", "p2"))
    assert measured.validated and measured.after.count and measured.truth is None and "truth" not in measured.to_dict()
    np.testing.assert_allclose(simulated.values, measured.values, rtol=0, atol=1e-12)  # the same session, fitted alike
    assert simulated.truth is not None and simulated.truth.comparison is not None
    comparison = simulated.truth.comparison
    assert comparison.error.shape == (len(simulated.estimate.identified),) and np.abs(comparison.error).max() < 1e-4
    np.testing.assert_array_equal(day.true_robot.T_world_tracker, simulated.truth.robot.T_world_tracker)


def test_a_result_is_written_as_json_and_pickled_whole(measured: CalibrationResult) -> None:
    written = measured.to_dict()
    assert json.loads(json.dumps(written, allow_nan=False)) == written
    assert pickle.loads(pickle.dumps(measured)).to_dict() == written
