"""Predicted errors over regions: sharp where poses were measured, bounded by the tolerances where none were."""

from dataclasses import replace

import numpy as np
import pytest
from helpers.judged import SIGMA_M, campaign
from helpers.robots import IRB120

from lab.calibration.prior import Tolerance
from lab.phrases.phrase import in_one_line
from lab.prediction.extrapolation import MeasuredRange, PoseCover
from lab.prediction.regions import Region
from lab.prediction.residual_spread import ResidualSpread, residual_spread
from lab.prediction.workspace_prediction import (
    MEAN_OF_RMS,
    PredictedErrors,
    own_tolerance,
    predict_elsewhere,
    predict_over_region,
    predicted_errors_at,
)
from lab.verdict.verdict import verdict

CHAIN = IRB120.chain
TURNING = np.ones(CHAIN.size, dtype=np.bool_)
NOTHING = ResidualSpread(0.0, 0.0)


def measured_range_of(joints: np.ndarray) -> MeasuredRange:
    low, high = joints.min(axis=0), joints.max(axis=0)
    return MeasuredRange(low, high, TURNING, np.full(6, 0.1), np.zeros(6), cover=PoseCover.of(joints, TURNING))


def test_isotropic_errors_have_the_lengths_of_chi_squared_and_f() -> None:
    """95 % of normal vectors are shorter than 2.795 sigma; with a sigma of 6 degrees of freedom, than 3.776."""
    squares = np.broadcast_to(4e-6 * np.eye(3), (2, 1, 3, 3))
    np.testing.assert_allclose(PredictedErrors(squares, None).lengths_95, 2.7955 * 2e-3, rtol=1e-4)
    np.testing.assert_allclose(PredictedErrors(squares, 6).lengths_95, np.sqrt(3 * 4.7571) * 2e-3, rtol=1e-4)
    assert PredictedErrors(squares, None).among(np.ones((2, 1), dtype=bool)) == pytest.approx(2.7955 * 2e-3, rel=1e-4)


def test_what_the_fit_left_is_an_error_of_the_arm_too() -> None:
    case = campaign()
    alone = predict_over_region(case.found, Tolerance(), case.poses, NOTHING)
    more = predict_over_region(case.found, Tolerance(), case.poses, ResidualSpread(2e-4, 1e-4))
    assert alone.mean_m == pytest.approx(MEAN_OF_RMS * alone.rms_m) and more.rms_m == alone.rms_m
    assert more.mean_m == pytest.approx(MEAN_OF_RMS * np.sqrt(alone.rms_m**2 + 3e-8))
    assert more.p95_m == pytest.approx(2.7955e-4, rel=0.02)


def test_no_model_is_predicted_worse_than_one_that_was_never_calibrated() -> None:
    """A campaign of a tenth of each range says nothing of the rest: there the tolerances do, and no meters."""
    case = campaign(poses=12, range_share=0.1, known=True, sigma_m=1e-4)
    everywhere = Region("workspace", CHAIN.random_joints(200, np.random.default_rng(0)))
    huge = replace(case.found, covariance=1e6 * case.found.covariance)
    own = own_tolerance(case.found, Tolerance(), case.poses)
    for found in (case.found, huge):
        there = predict_over_region(found, own, everywhere, NOTHING)
        assert there.rms_m <= there.uncalibrated_rms_m * 1.2 < 10e-3
    at = predicted_errors_at(huge, NOTHING, everywhere.inputs, tolerance=own)
    assert np.sqrt(np.trace(at.covariances[:, 0], axis1=1, axis2=2).mean()) < 1.2 * there.uncalibrated_rms_m
    assert predicted_errors_at(huge, NOTHING, everywhere.inputs).lengths_95.max() > 1.0


def test_an_arm_that_was_far_from_nominal_has_wider_tolerances_of_its_own() -> None:
    usual, far = campaign(), campaign(change={"link3.a": 8e-3})
    of_usual, of_far = (own_tolerance(each.found, Tolerance(), each.poses) for each in (usual, far))
    assert 1 <= of_usual.length_m / Tolerance().length_m < 1.5 < of_far.length_m / Tolerance().length_m < 8
    assert of_far.angle_rad / of_far.length_m == pytest.approx(Tolerance().angle_rad / Tolerance().length_m)


@pytest.mark.parametrize("share", [0.2, 1.0])
def test_a_small_corner_is_judged_by_itself_and_the_rest_has_a_figure(share: float) -> None:
    """Good in both; of the corner nearly all of the workspace is extrapolated, and predicted far worse."""
    case = campaign(range_share=share, validated_share=share)
    rng = np.random.default_rng(0)
    joints = (CHAIN.lower + CHAIN.upper) / 2 + share * (CHAIN.random_joints(40, rng) - (CHAIN.lower + CHAIN.upper) / 2)
    range_ = measured_range_of(joints)
    judged = verdict(case.found, case.validation, goodness=case.goodness, measured=range_, poses=case.poses)
    elsewhere = predict_elsewhere(case.found, Tolerance(), NOTHING, range_)
    assert judged.word == "good" and judged.region.p95_m < 5 * SIGMA_M and elsewhere is not None
    words = in_one_line(judged.determination.checks)
    assert "where poses were measured" in words and "in the extrapolated" in words
    if share < 1:
        assert elsewhere.extrapolated_share > 0.95 and elsewhere.p95_m > 5 * judged.region.p95_m
    else:
        assert elsewhere.extrapolated_share < 0.5 and elsewhere.p95_m < 2 * judged.region.p95_m


def test_poses_that_the_arm_does_not_take_are_left_out_of_a_region() -> None:
    case = campaign()
    region = replace(case.poses, inputs=np.full_like(case.poses.inputs, np.nan))
    found = predict_over_region(case.found, Tolerance(), region, residual_spread(case.found))
    assert found.poses == 0 and np.isnan(found.p95_m)
    assert predict_over_region(case.found, Tolerance(), case.poses, NOTHING).poses == len(case.poses.inputs)
