"""Measured arms: the accuracies of facts.md, section 6, by the commands' own protocols."""

import numpy as np
import pytest
from arms import data_file

from lab.study.campaign import run_measured
from lab.study.options import MeasuredCampaign


def mean_mm(errors) -> float:
    return 1e3 * float(np.nanmean(errors))


def test_irb120_by_its_protocol() -> None:
    """36 poses with three points; links and base from there, the tool point of each session from one row."""
    outcome = run_measured(
        MeasuredCampaign(
            data_file("irb120_liaowu_calib36.csv"), validate=data_file("irb120_liaowu_test40.csv"), refit=("tool",)
        )
    )
    errors = outcome.judgement.errors
    assert errors is not None and errors.after.size == 40 and outcome.judgement.judged_by == "file"
    assert mean_mm(errors.before) == pytest.approx(4.83, abs=0.2)
    assert mean_mm(errors.after) <= 0.34 and 1e3 * errors.after.max() <= 0.70
    assert mean_mm(errors.after) > 0.2  # near zero would be a leak
    assert len(outcome.identification.fit.free) == 33


def test_ur10_random_poses() -> None:
    outcome = run_measured(MeasuredCampaign(data_file("ur10_ipa_C.csv"), str(data_file("ur10.toml")), holdout=0.3))
    errors = outcome.judgement.errors
    assert errors is not None and 0.3 < mean_mm(errors.after) <= 0.47 < mean_mm(errors.before)
    assert outcome.verdict.word == "good"


def test_ur10_cubes_over_ten_splits() -> None:
    """Repeats are never split between fit and test; with them split the error would look smaller."""
    after = []
    for seed in range(10):
        options = MeasuredCampaign(data_file("ur10_ipa_D.csv"), str(data_file("ur10.toml")), seed=seed, holdout=0.3)
        errors = run_measured(options).judgement.errors
        assert errors is not None
        after.append(mean_mm(errors.after))
    assert 0.3 < np.mean(after) <= 0.37
    assert 0.005 < np.std(after) < 0.03


@pytest.mark.parametrize("file", ["ur10_ipa_C.csv", "ur10_ipa_D.csv"])
def test_ur10_is_cross_validated_where_nothing_is_asked(file: str) -> None:
    outcome = run_measured(MeasuredCampaign(data_file(file), str(data_file("ur10.toml"))))
    errors = outcome.judgement.errors
    assert outcome.judgement.judged_by == "cross-validation" and errors is not None
    assert np.isfinite(errors.after).all() and mean_mm(errors.after) <= 0.47
    named = [warning for warning in outcome.warnings if "rx_deg, ry_deg, rz_deg" in warning]
    assert len(named) == 1 and "ignored" in named[0]
    unsure = [warning for warning in outcome.warnings if "barely tell" in warning]
    assert len(unsure) == 1 and "link5.theta" in unsure[0]  # the probe's centre lies near axis 6
