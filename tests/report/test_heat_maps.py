"""Heat maps with their scale, intervals in rows, and axes of dates."""

from datetime import date, timedelta

import numpy as np
import pytest

from lab.report.comparison_plots import (
    date_axis,
    signed_place,
    signed_ticks,
)


class Recorded:
    """Axes that keep what they are given."""

    def __init__(self) -> None:
        self.ticks, self.labels, self.limits = [], [], (0.0, 0.0)

    def set_xticks(self, ticks, labels) -> None:
        self.ticks, self.labels = list(ticks), list(labels)

    def set(self, xlim) -> None:
        self.limits = xlim


@pytest.mark.parametrize("most", [1.0, 4.0, 200.0, 3e5])
def test_a_signed_scale_reaches_the_largest_value_and_is_monotonic(most: float) -> None:
    sizes = np.concatenate([-np.geomspace(most, 1e-3, 400), [0.0], np.geomspace(1e-3, most, 400)])
    places = signed_place(sizes, most)
    assert places[0] == pytest.approx(0) and places[-1] == pytest.approx(1) and places[400] == 0.5
    assert (np.diff(places) > 0).all()
    assert signed_place(-sizes, most) == pytest.approx(1 - places, abs=1e-12)
    inside = np.abs(sizes) <= 1
    assert places[inside] == pytest.approx(0.5 + sizes[inside] / (2 * (1 + np.log(most))), abs=1e-12)
    for place, label in signed_ticks(most):
        assert 0 <= place <= 1 and signed_place(np.array(float(label.replace("−", "-"))), most) == pytest.approx(place)


@pytest.mark.parametrize("days", [0, 1, 9, 31, 74, 76, 400, 4000])
def test_an_axis_of_dates_holds_both_ends_and_few_ticks(days: int) -> None:
    first, axes = date(2026, 1, 12), Recorded()
    last = first + timedelta(days)
    date_axis(axes, first, last)
    assert axes.limits[0] < first.toordinal() and axes.limits[1] > last.toordinal()
    assert 1 <= len(axes.ticks) <= 8 and len(set(axes.labels)) == len(axes.labels)
    assert all(axes.limits[0] <= tick <= axes.limits[1] for tick in axes.ticks)
    for tick, label in zip(axes.ticks, axes.labels, strict=True):
        assert label in date.fromordinal(tick).isoformat()
