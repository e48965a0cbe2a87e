"""Heat maps with their scale, intervals in rows, and axes of dates."""

import re
from datetime import date, timedelta

import numpy as np
import pytest

from lab.render.comparison_plots import (
    ColourScale,
    Intervals,
    date_axis,
    heat_map,
    interval_chart,
    signed_place,
    signed_ticks,
)

GREYS = ColourScale(("#000000", "#ffffff"), [(0.0, "low"), (0.5, "middle"), (1.0, "high")], "what it is")


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


@pytest.mark.thorough
def test_a_heat_map_has_its_colours_its_scale_and_readable_words() -> None:
    pytest.importorskip("matplotlib")
    shares = np.array([[0.0, 1.0, np.nan], [0.2, 0.8, 0.5]])
    texts = [["dark", "light", ""], ["", "", "grey"]]
    svg = heat_map("map", "a map", ["top", "bottom"], ["a", "b", "c"], shares, GREYS, texts).chart().svg()
    words = {text: fill for fill, text in re.findall(r'fill="(#\w+)"[^>]*>([^<]+)</text>', svg)}
    assert words["dark"] == "#ffffff" and words["light"] == "#000000"
    assert {"top", "bottom", "a", "b", "c", "low", "middle", "high", "what it is"} <= set(words)
    places = {text: float(y) for y, text in re.findall(r'y="([\d.]+)"[^>]*>([^<]+)</text>', svg)}
    assert places["high"] < places["middle"] < places["low"] and places["top"] < places["bottom"]
    high = (places["low"] - places["high"]) / 2  # the scale is as high as the map
    assert places["bottom"] - places["top"] == pytest.approx(high, rel=0.02)
    figure = heat_map("map", "a map", ["top", "bottom"], ["a", "b", "c"], shares, GREYS, texts).draw()
    assert {each.get_text() for each in figure.axes[0].texts} >= {"dark", "light", "high", "what it is"}


@pytest.mark.thorough
def test_an_interval_chart_marks_what_differs_from_zero() -> None:
    pytest.importorskip("matplotlib")
    values, halves = np.array([0.1, 5.0, -3.0]), np.array([1.0, 0.5, 0.2])
    distinct = np.abs(values) > halves
    sets = [Intervals("one", values, halves, distinct), Intervals("two", 0 * values, halves, np.zeros(3, bool))]
    figure = interval_chart("moved", "what moved", ["a", "b", "c"], sets, "difference, mm").draw()
    axes = figure.axes[0]
    assert [each.get_text() for each in axes.get_yticklabels()] == ["a", "b", "c"]
    widths = sorted((float(line.get_linewidth()[0]), len(line.get_segments())) for line in axes.collections
                    if hasattr(line, "get_segments"))  # fmt: skip
    assert widths == [(1.2, 1), (1.2, 3), (2.0, 2)]
    rows = {tuple(np.round(segment[:, 0], 6)) for line in axes.collections if hasattr(line, "get_segments")
            for segment in line.get_segments()}  # fmt: skip
    assert {(-0.9, 1.1), (4.5, 5.5), (-3.2, -2.8)} <= rows


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
