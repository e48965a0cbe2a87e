"""Maps of errors and trends: what a picture says is what its numbers are."""

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from lab.report.charts.chart import Chart
from lab.report.plots import ArrowMap, Trend, arrow_maps, smooth, trend_pictures
from lab.report.style import AFTER, BEFORE


def test_a_smooth_mean_is_a_line_or_follows_a_wave() -> None:
    rng = np.random.default_rng(1)
    x = rng.uniform(-2, 3, 200)
    noise = 0.1 * rng.normal(size=200)
    wave, line = smooth(x, np.sin(2 * x) + noise), smooth(x, 0.4 * x - 1 + noise)
    assert wave is not None and line is not None and max(wave.p, line.p) < 1e-10
    inside = (wave.at > -1.8) & (wave.at < 2.8)
    assert np.abs(wave.mean - np.sin(2 * wave.at))[inside].max() < 0.12
    np.testing.assert_allclose(np.diff(line.mean, 2), 0, atol=1e-9)  # straight: the curve's criterion charges for more
    assert np.mean(np.abs(line.mean - (0.4 * line.at - 1)) < line.half) > 0.9
    np.testing.assert_allclose(np.polyval(np.polyfit(x, 0.4 * x - 1 + noise, 1), line.at), line.mean, atol=1e-9)


def test_a_spline_is_the_interpolating_one_where_points_are_as_many_as_knots() -> None:
    """Five places, each measured often: the curve goes through their means as scipy's natural spline does."""
    places, heights = np.arange(5.0), np.array([0, 5, -3, 4, 9.0])
    x = np.repeat(places, 8)
    y = np.repeat(heights, 8) + np.tile([-0.1, 0.1], 20)
    found = smooth(x, y)
    assert found is not None
    np.testing.assert_allclose(found.mean, CubicSpline(places, heights, bc_type="natural")(found.at), atol=1e-6)


def test_noise_alone_is_rarely_a_trend() -> None:
    rng = np.random.default_rng(2)
    p = [smooth(rng.normal(size=60), rng.normal(size=60)).p for _ in range(400)]  # type: ignore[union-attr]
    assert np.mean(np.array(p) < 0.05) < 0.08 and np.mean(np.array(p) < 0.01) < 0.03


def test_one_outlier_makes_no_trend_and_too_little_none() -> None:
    rng = np.random.default_rng(3)
    x, y = np.linspace(0, 1, 60), rng.normal(size=60)
    y[-1] = 500
    found = smooth(x, y)
    assert found is not None and found.p > 0.01 and np.abs(found.mean).max() < 2
    assert smooth(x[:5], y[:5]) is None and smooth(np.ones(60), y) is None and smooth(x, np.full(60, np.nan)) is None


def test_a_trend_is_named_in_its_title_and_has_its_points() -> None:
    rng = np.random.default_rng(4)
    x = rng.uniform(-180, 180, 150)
    names = [f"p{i}" for i in range(150)]
    noise = 0.01 * rng.normal(size=150)
    shown = [
        Trend("q1", "q1, °", x, noise, names),
        Trend("q2", "q2, °", x, 0.03 * np.sin(np.deg2rad(2 * x)) + noise, names),
    ]
    plain, wave = trend_pictures("t", shown, 0.02)
    assert plain.label == "q1: no trend" and wave.label.startswith("q2: trend ± ")
    assert float(wave.label.split()[3]) == pytest.approx(0.03, rel=0.1)
    chart = wave.chart()
    assert isinstance(chart, Chart) and "q2: trend" in chart.svg()
    assert [name for *_, name, _ in chart.named_points()] == names
    far = trend_pictures("t", [Trend("q", "q", x, np.where(x > 179, 9.0, noise), names)], np.nan)[0].chart()
    assert len(far.named_points()) == 150  # what lies beyond the axis is at its edge


def _arrow_map(**changes) -> ArrowMap:
    rng = np.random.default_rng(5)
    points = rng.uniform(-0.5, 0.5, (20, 3))
    before, after = 1e-3 * rng.normal(size=(2, 20, 3))
    kinds = ("before", BEFORE, before), ("after", AFTER, 0.1 * after)
    return ArrowMap(**({"name": "m", "points": points, "means": "error", "layers": kinds, "factor": 50.0,
                        "names": [str(i) for i in range(20)]} | changes))  # fmt: skip


def test_arrows_begin_at_their_points_and_are_magnified() -> None:
    shown = _arrow_map()
    above, side = arrow_maps([shown])
    assert (above.name, side.name) == ("m-above", "m-side") and "before" in above.label and "after" in above.label
    chart = side.chart()
    across, up = chart.scales()
    named = chart.named_points()
    np.testing.assert_allclose([each[0] for each in named], across(1e3 * shown.points[:, 0]))
    np.testing.assert_allclose([each[1] for each in named], up(1e3 * shown.points[:, 2]))
    size = np.linalg.norm(shown.layers[0][2][3])
    assert named[3][2:4] == ("pose", "3") and named[3][4].startswith(f"before {1e3 * size:#.3g}".rstrip("."))
    tips = 1e3 * (shown.points + 50 * shown.layers[0][2])
    low, high = chart.x.found_limits()
    assert low < tips[:, 0].min() and tips[:, 0].max() < high  # no arrow is cut
    svg = chart.svg()
    assert "from the side, × 50" in svg and svg.count(f'stroke="{BEFORE}"') == svg.count(f'stroke="{AFTER}"') == 1
    flat = shown.points * [1, 1, 0]
    assert [each.name for each in arrow_maps([_arrow_map(points=flat)])] == ["m-above"]  # no view as a line
