"""A chart puts values, ticks and arrows where matplotlib does, which draws the same picture for ``plot()``."""

import numpy as np
import pytest

from lab.report.charts.chart import Chart, log_ticks, shades
from lab.report.charts.marks import Axes
from lab.report.style import FIGURE_STYLE

figure = pytest.importorskip("matplotlib.figure")
rc_context = pytest.importorskip("matplotlib").rc_context
pytestmark = pytest.mark.thorough  # matplotlib is of the extra plots

SIZE, MARGINS = (4.0, 3.0), (0.5, 0.5, 0.5, 0.5)
VALUES = np.random.default_rng(3).normal(size=20)


def charted(draw) -> Chart:
    made = Chart("c", SIZE, MARGINS, "sans")
    draw(made)
    return made


def on_paper(draw):
    with rc_context(FIGURE_STYLE):
        made = figure.Figure(figsize=SIZE).add_axes((0.125, 1 / 6, 0.75, 2 / 3))
        draw(made)
    return made


def _bars(axes: Axes) -> None:
    axes.barh([0, 1, 2], [3.0, -1.0, 5.0], height=0.6)
    axes.axvline(1.3)


def _steps(axes: Axes) -> None:
    axes.stairs([1, 4, 2], [0.5, 1, 2, 3], fill=True)
    axes.axhline(6.0)


def _lines(axes: Axes) -> None:
    axes.hlines([0, 1], [-2, 0.5], [1, 3])
    axes.vlines([4], -1, 2)
    axes.margins(x=0.1)


def _area(axes: Axes) -> None:
    axes.fill_between([0, 1, 2], [0, -1, 0], [1, 2, 4])
    axes.axhspan(-3, 2)


def _logarithm(axes: Axes) -> None:
    log_ticks(axes, "x", 0.02, 30.0)
    axes.plot([0.1, 1, 10], [1, np.nan, 3], "o-")


def _equal(axes: Axes) -> None:
    axes.scatter([0, 10], [0, 1])
    axes.set(xlim=(-1, 11), ylim=(-1, 2))
    axes.set_aspect("equal")


def _matrix(axes: Axes) -> None:
    edges = np.arange(5) - 0.5
    axes.pcolormesh(edges, edges, shades(np.eye(4), ("#000000", "#ffffff")))
    axes.set(xlim=(-0.5, 3.5), ylim=(3.5, -0.5))
    axes.set_aspect("equal")


CASES = [
    lambda axes: axes.plot(VALUES, VALUES**2, "s--"), _bars, _steps, _lines, _area, _logarithm, _equal,
    _matrix,
]  # fmt: skip


@pytest.mark.parametrize("draw", CASES)
def test_values_are_where_matplotlib_puts_them(draw) -> None:
    chart, paper = charted(draw), on_paper(draw)
    paper.figure.draw_without_rendering()
    across, up = chart.scales()
    for x, y in [*zip(paper.get_xlim(), paper.get_ylim(), strict=True), (1.0, 1.5)]:
        there = np.array([float(across(x)), chart.height - float(up(y))])
        np.testing.assert_allclose(there, paper.transData.transform((x, y)) * 72 / paper.figure.dpi, atol=0.02)


@pytest.mark.parametrize("ends", [(0, 1), (-3.7, 12.2), (0.0021, 0.0064), (-980, 45), (1.2e7, 9e7), (-1e-6, 2e-6)])
def test_ticks_are_those_of_matplotlib(ends) -> None:
    chart, paper = (made(lambda axes: axes.set(xlim=ends, ylim=ends)) for made in (charted, on_paper))
    with rc_context(FIGURE_STYLE):
        on_axes = paper.get_xticks(), paper.get_yticks()
    for axis, scale, space, theirs in zip((chart.x, chart.y), chart.scales(), (27, 18), on_axes, strict=True):
        inside = (theirs >= ends[0] - 1e-12) & (theirs <= ends[1] + 1e-12)
        found, said = axis.found_ticks(scale, space)
        np.testing.assert_allclose(found, theirs[inside], atol=1e-12 * max(map(abs, ends)))
        assert len(set(said)) == len(said)
        np.testing.assert_allclose([float(word.replace("−", "-")) for word in said], found, rtol=1e-5, atol=1e-15)
