"""The study of changes on a few years; the whole study is slow."""

import numpy as np
import pytest
from history_study import JOINTS, Months, Options, coverage, named_within_two, unchanged_years

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


@pytest.mark.parametrize("second", [0.0, 2.0])
def test_the_interval_of_a_change_covers_it_whatever_else_has_changed(second: float) -> None:
    """Of 600 pairs within three standard errors of 95 %; so does the narrower one only without a second change."""
    options = Options(years=600, pose_sets=8)
    found = coverage(Months.of(options.pose_sets, options.poses, options.seed), 2, second, options)
    room = 3 * np.sqrt(0.05 * 0.95 / options.years)
    assert found.found > 0.97 * options.years and abs(found.reported - 0.95) < room
    assert found.alone_mrad < 0.5 * found.reported_mrad
    assert abs(found.alone - 0.95) < room if second == 0 else found.alone < 0.2


@pytest.mark.slow
def test_a_thousand_years() -> None:
    options = Options()
    months = Months.of(options.pose_sets, options.poses, options.seed)
    assert np.mean(list(unchanged_years(months, options))) <= 0.017
    for joint in JOINTS:
        assert np.mean([found for found, _ in named_within_two(months, joint, options)]) >= 0.95
    for second in options.second:
        covered = coverage(months, 2, second, options)
        assert 0.935 < covered.reported < 0.965
