"""The study of trends on a few years; the whole study is slow."""

import numpy as np
import pytest
from trend_study import JOINTS, Months, Options, named_within_two, unchanged_years

from lab.core.significance import TREND_YEAR


def bounded(shares: float, meant: float, years: int) -> bool:
    """Whether a share of years is at most the one that is meant, by three standard errors."""
    return shares <= meant + 3 * np.sqrt(meant / years)


def test_a_zero_that_moved_is_named_and_an_unchanged_arm_is_left_alone() -> None:
    options = Options(years=40, calibrations=4, pose_sets=8)
    months = Months.of(options.pose_sets, options.poses, options.seed)
    assert bounded(np.mean(list(unchanged_years(months, options))), TREND_YEAR, options.years)
    for joint in (3, 5):
        within_two, at_once = np.mean(list(named_within_two(months, joint, options)), axis=0)
        assert within_two >= 0.95 - 3 * np.sqrt(0.05 / options.years) and at_once <= within_two
    small = Options(years=20, calibrations=4, pose_sets=8, moved_mrad=0.002)
    assert np.mean(list(named_within_two(months, 5, small))) < 0.2  # what is below the noise is not named


@pytest.mark.slow
def test_a_thousand_years() -> None:
    options = Options()
    months = Months.of(options.pose_sets, options.poses, options.seed)
    assert np.mean(list(unchanged_years(months, options))) <= 0.017
    for joint in JOINTS:
        assert np.mean([found for found, _ in named_within_two(months, joint, options)]) >= 0.95
