"""An engineer's day with a UR5e, from the cell to the verification, through files."""

import pytest
from engineers_day import Options, answer
from helpers.drawing import nothing_drawn


def figures(options: Options) -> dict:
    with nothing_drawn():
        return dict(answer(options).values)


def assert_good(found: dict, most_over_floor: float) -> None:
    assert found["error_over_floor"] <= most_over_floor and found["before_mm"] > 1 > 100 * found["after_mm"] / 3
    assert found["worst_hit_mm"] <= 0.05 < 1 < found["uncorrected_mm"]
    assert found["touched"] == 0


@pytest.mark.thorough
def test_a_short_day() -> None:
    found = figures(Options(candidates=40, poses=20, targets=4))
    assert_good(found, 1.5)
    assert found["verified"] == 1 and found["not_corrected"] == found["ways_not_free"] == 0


@pytest.mark.slow
def test_twenty_days() -> None:
    found = figures(Options(days=20, candidates=300))
    assert_good(found, 1.3)
    assert found["verified"] >= 19 and found["not_corrected"] <= 4 and found["ways_not_free"] <= 1
