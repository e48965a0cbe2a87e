"""Round numbers and scales, by closed forms."""

import numpy as np
import pytest

from lab.report.charts.marks import Scale, round_numbers, tick_labels


def test_scales_are_straight_lines_in_the_value_or_in_its_logarithm() -> None:
    straight, by_power = Scale(2.0, 4.0, 100.0, 0.0), Scale(0.1, 1000.0, 0.0, 40.0, logarithmic=True)
    np.testing.assert_allclose(straight([2, 3, 5]), [100, 50, -50])
    np.testing.assert_allclose(by_power([0.1, 1, 10, 1000]), [0, 10, 20, 40])
    assert np.isnan(by_power(0.0)) and np.isnan(by_power(-1.0))


@pytest.mark.parametrize("seed", range(5))
def test_round_numbers_are_round_even_and_few(seed: int) -> None:
    rng = np.random.default_rng(seed)
    for _ in range(40):
        low, width = 10 ** rng.uniform(-3, 4) * rng.normal(), 10 ** rng.uniform(-3, 4)
        most = int(rng.integers(1, 10))
        found = round_numbers(low, low + width, most)
        step = np.diff(found)
        assert len(found) >= 2 and len(found) <= max(most, 4) + 1
        assert found.min() >= low - 1e-6 * width and found.max() <= low + width * (1 + 1e-6)
        np.testing.assert_allclose(step, step[0], rtol=1e-6)
        lead = step[0] / 10 ** np.floor(np.log10(step[0]) + 1e-9)
        assert min(abs(lead - each) for each in (1, 2, 2.5, 5, 10)) < 1e-6


def test_numbers_are_written_alike() -> None:
    assert tick_labels([-0.5, 0.0, 0.25]) == ["−0.50", "0.00", "0.25"]
    assert tick_labels([0, 500, 1000]) == ["0", "500", "1000"]
    assert tick_labels([2e-6, 1e-5]) == ["2e−06", "1e−05"] and tick_labels([3e7]) == ["3e+07"]
    assert tick_labels([]) == []
