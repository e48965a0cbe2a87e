"""Errors at poses that were not fitted against what the calibration predicts of them."""

from dataclasses import replace

import numpy as np
import pytest
from helpers.mistakes import ARM, session_with_noise

from lab.calibration.identification import Identification, identify
from lab.calibration.weights import Noise
from lab.core.checks import Check
from lab.core.measurements import Measurements
from lab.prediction.extrapolation import MeasuredRange
from lab.prediction.validation import Errors, Validation, validate_folds, validate_rows
from lab.prediction.workspace_prediction import check_prediction

SIGMA_M = 20e-6


def halves(seed: int, poses: int = 80) -> tuple[Measurements, Measurements]:
    data, _ = session_with_noise(seed, poses, SIGMA_M)
    return data[np.arange(poses // 2)], data[np.arange(poses // 2, poses)]


def checked(found: Identification, held: Measurements, noise: Noise) -> Check:
    check = check_prediction(found, validate_rows(found, held), noise)
    assert check is not None
    return check


def test_errors_of_noise_alone_are_as_predicted() -> None:
    exceeded = 0
    for seed in range(4):
        fitted, held = halves(seed)
        for noise in (Noise(), Noise(sigma_m=SIGMA_M)):
            check = checked(identify(ARM, fitted, ARM.nominal(), noise), held, noise)
            assert check.data["predicted_p95_m"] < check.data["allowed_p95_m"]
            assert check.data["observed_p95_m"] == pytest.approx(check.data["predicted_p95_m"], rel=0.4)
            exceeded += check.outcome == "failed"
    assert exceeded <= 1  # one in a hundred each: two or more of 8 in 1 of 370


def test_the_prediction_of_exact_parameters_is_that_of_the_noise() -> None:
    """With no uncertainty of parameters 95 % of Maxwell's lengths are below 2.795 sigma."""
    fitted, held = halves(0, 600)
    found = identify(ARM, fitted, ARM.nominal(), Noise(sigma_m=SIGMA_M))
    check = checked(replace(found, covariance=0 * found.covariance), held, Noise(sigma_m=SIGMA_M))
    assert check.data["predicted_p95_m"] == pytest.approx(2.795 * SIGMA_M, rel=0.02)


def test_errors_that_the_model_does_not_explain_exceed_it() -> None:
    fitted, held = halves(1)
    found = identify(ARM, fitted, ARM.nominal())
    rng = np.random.default_rng(0)
    off = replace(held, points=held.points + 2 * SIGMA_M * rng.normal(size=held.points.shape))
    assert checked(found, off, Noise()).outcome == "failed" and checked(found, held, Noise()).outcome == "passed"


def test_fresh_points_have_no_noise() -> None:
    fitted, held = halves(2)
    found, size = identify(ARM, fitted, ARM.nominal()), SIGMA_M * np.ones((len(held), 1))
    fresh = Validation("fresh", Errors(size, size), rows=held)
    check = check_prediction(found, fresh, Noise())
    assert check is not None and check.data["predicted_p95_m"] < 1.5 * SIGMA_M
    measured = check_prediction(found, replace(fresh, judged_by="holdout"), Noise())
    assert measured is not None and measured.data["predicted_p95_m"] > 2.5 * SIGMA_M


def test_folds_are_compared_and_nothing_else_is_where_rows_are_not_known() -> None:
    fitted, _ = halves(3)
    found = identify(ARM, fitted, ARM.nominal())
    folds = validate_folds(lambda rows: identify(ARM, rows, ARM.nominal()), found, fitted, 0)
    check = check_prediction(found, folds, Noise())
    assert check is not None and check.outcome != "failed"
    for nothing in (replace(folds, rows=None), replace(folds, errors=None), replace(folds, fitted_share=0.5)):
        assert check_prediction(found, nothing, Noise()) is None


def test_what_is_unknown_beyond_the_measured_region_hides_no_errors_within_it() -> None:
    fitted, held = halves(4)
    found = identify(ARM, fitted, ARM.nominal())
    lower, upper = fitted.joints.min(axis=0), fitted.joints.max(axis=0)
    size = np.ones(len(lower))
    measured = MeasuredRange(lower, upper, size > 0, 0.1 * size, slope=1.0 * size)
    far = replace(held, joints=held.joints + np.where(np.arange(len(held)) % 2, 0.0, 10.0)[:, None])
    beyond = int((measured.beyond(far.joints) > 0).any(axis=1).sum())
    assert 10 <= len(far) - beyond < len(far)
    rng = np.random.default_rng(0)
    off = replace(held, points=held.points + 3 * SIGMA_M * rng.normal(size=held.points.shape))
    for rows, outcome in ((held, "passed"), (off, "failed")):
        validation = replace(validate_rows(found, rows), rows=replace(rows, joints=far.joints))
        check = check_prediction(found, validation, Noise(), measured)
        assert check is not None and check.outcome == outcome and check.data["extrapolated"] == beyond
