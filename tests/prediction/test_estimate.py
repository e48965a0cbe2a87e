"""An estimate: its parameters by name, what it predicts, and its way through a pickle and through files."""

from pathlib import Path

import numpy as np
import pytest
from helpers.drawing import nothing_drawn

import lab
from lab.core.errors import LabError
from lab.core.se3 import Array
from lab.prediction.estimate import Estimate
from lab.prediction.estimate_files import read_estimate

SOFT = {"stiffness_nm_per_rad": 1e5, "payload_kg": (0.0, 3.0), "model": "compliance+drift", "hours": 1.0}


@pytest.fixture(scope="module")
def soft() -> lab.CalibrationResult:
    """Of an arm that deflects, before a base that drifts."""
    with nothing_drawn():
        return lab.calibrate("irb120", poses=30, seed=3, targets=("p1", "p2"), **SOFT)


def poses(estimate: Estimate, count: int) -> Array:
    joints = estimate.rigid.chain.random_joints(count, np.random.default_rng(5))
    return np.concatenate([joints, np.full((count, len(estimate.arm.conditions)), 2.0)], axis=1)


@pytest.mark.thorough
def test_parameters_are_found_by_name_and_an_unknown_name_lists_them(soft: lab.CalibrationResult) -> None:
    found, estimate = soft.identification, soft.estimate
    at = found.fit.free.index(found.model.names.index("link2.a"))
    parameter = estimate.params["link2.a"]
    assert parameter.value == found.values[found.model.names.index("link2.a")] and parameter.std == found.std[at]
    assert parameter.interval_95 is not None
    np.testing.assert_allclose(np.mean(parameter.interval_95), parameter.value, rtol=1e-12)
    with pytest.raises(LabError, match=r"no parameter 'link9\.a'; there are base\.x, .*link2\.a"):
        _ = estimate.params["link9.a"]


def test_what_was_of_the_session_stays_out_of_the_arm(soft: lab.CalibrationResult) -> None:
    estimate, found = soft.estimate, soft.identification
    assert estimate.groups == ("compliance",) and estimate.left_out == ("drift",)
    assert "drift.x" in estimate.params and "drift.x" in estimate.identified
    assert not any(name.startswith("drift") for name in estimate.free_names)
    rows = [estimate.identified.index(name) for name in estimate.free_names]
    assert (estimate.free_covariance == found.covariance[np.ix_(rows, rows)]).all()
    assert [estimate.arm.names[i] for i in estimate.free] == list(estimate.free_names)


def test_the_covariance_is_that_of_differences(soft: lab.CalibrationResult) -> None:
    estimate = soft.estimate
    inputs = poses(estimate, 4)
    steps = 1e-6 * np.eye(len(estimate.values))[list(estimate.free)]
    slopes = np.stack(
        [
            (estimate.arm.points(inputs, estimate.values + step) - estimate.arm.points(inputs, estimate.values - step))
            / 2e-6
            for step in steps
        ],
        axis=-1,
    )
    expected = estimate.discrepancy().inflation * slopes @ estimate.free_covariance @ np.swapaxes(slopes, 2, 3)
    np.testing.assert_allclose(estimate.predict(inputs).identified, expected, rtol=1e-4, atol=1e-16)


def test_one_target_of_each_pose_is_that_of_all(soft: lab.CalibrationResult) -> None:
    estimate, at = soft.estimate, np.array([0, 1, 1, 0])
    inputs = poses(estimate, 4)
    whole, some = estimate.predict(inputs), estimate.predict(inputs, at)
    for name in ("points", "identified", "load", "discrepancy", "extrapolation", "visit"):
        np.testing.assert_allclose(
            getattr(some, name)[:, 0], getattr(whole, name)[np.arange(4), at], rtol=1e-12, atol=1e-20
        )
    parts = whole.identified + whole.load + whole.discrepancy + whole.extrapolation + whole.visit
    np.testing.assert_allclose(whole.covariance, parts, rtol=1e-12)


def test_it_comes_back_from_its_files(soft: lab.CalibrationResult, tmp_path: Path) -> None:
    lab.save_estimate(soft.estimate, tmp_path / "alone")
    soft.save(tmp_path / "run")
    inputs = poses(soft.estimate, 3)
    expected = soft.estimate.predict(inputs)
    alone = read_estimate(tmp_path / "alone", soft.robot)
    for again in (alone, lab.load_estimate(tmp_path / "run")):
        assert again.params == soft.estimate.params and again.left_out == ("drift",)
        found = again.predict(inputs)
        np.testing.assert_array_equal(found.points, expected.points)
        np.testing.assert_allclose(found.covariance, expected.covariance, rtol=1e-6)  # poses are kept with 9 digits
    for name in ("parameters.json", "covariance.csv", "fitted_poses.csv"):
        whole, part = ((tmp_path / folder / name).read_text() for folder in ("run", "alone"))
        assert whole.startswith(part[:-4])  # a run adds rows that say the same in other parameters
