"""Charts: nothing of a user's taken for markup, discs where points are, colours that a dark page turns."""

import re

import numpy as np
import pytest

from lab.report.charts.chart import Chart, Sheet, axes_picture, inline_svg, name_points, shades
from lab.report.charts.marks import ROUND, Axes, cells, colour, line, marks

SIZE, MARGINS = (4.0, 3.0), (0.5, 0.5, 0.5, 0.5)


def charted(draw) -> Chart:
    made = Chart("c", SIZE, MARGINS, "sans")
    draw(made)
    return made


def test_marks_lie_at_their_values() -> None:
    """Each disc is the end of a thick line: its place, and its width of the size and the edge of matplotlib's."""
    x, y = np.array([0.0, 2.0, 4.0]), np.array([1.0, np.nan, 3.0])
    svg = charted(lambda axes: (axes.plot(x, y, "o", markersize=5), axes.set(xlim=(0, 4), ylim=(0, 4)))).svg()
    said = re.search(r'd="(M[^"]*h0)"[^>]*stroke-width="([\d.]+)"', svg)
    assert said is not None and float(said[2]) == 6.0 and ROUND in svg
    places = np.array(re.findall(r"M([\d.]+) ([\d.]+)h0", said[1]), float)
    np.testing.assert_allclose(places, [[36.0, 36 + 144 * 3 / 4], [252.0, 36 + 144 / 4]], atol=0.06)


def test_lines_are_parted_at_gaps_and_stay_near() -> None:
    assert line(np.array([0, 1, np.nan, 3, 4.0]), np.array([0, 1, 2, np.inf, 1e9])) == "M0.0 0.0L1.0 1.0M4.0 20000.0"
    assert marks(np.array([np.nan]), np.array([1.0]), "o", 3, ["#000000"]) == ""
    with pytest.raises(ValueError, match="no mark 'q'"):
        marks(np.zeros(1), np.zeros(1), "q", 3, ["#000000"])


def test_cells_have_their_colours_and_gaps_none() -> None:
    shown = shades(np.array([[0.0, 0.5], [np.nan, 1.0]]), ("#000000", "#ff0000", "#ffffff"))
    drawn = cells(np.arange(3.0), np.arange(3.0), shown)
    assert re.findall(r'd="(M\S+) [^>]*fill="(#\w+)"', drawn) == [
        ("M0.00", "#000000"), ("M1.00", "#ff0000"), ("M1.00", "#ffffff"),
    ]  # fmt: skip
    assert colour("0.5") == "#808080" and colour("red") == "red"


def test_words_are_words_and_ids_the_picture_s_own() -> None:
    hostile = "<b>&'\"</b>"

    def draw(axes: Axes) -> None:
        axes.set(title=hostile, xlabel=hostile, ylabel=hostile)
        axes.set_xticks([0], [hostile], rotation=90)
        axes.annotate(f"{hostile}\n{hostile}", (0, 0.5), xycoords=("data", "axes fraction"))
        axes.stairs([1], [0, 1], fill=True, hatch="////")
        axes.plot([0], [0], label=hostile)
        axes.legend()

    svg = charted(draw).svg()
    assert "<b>" not in svg and svg.count("&lt;b&gt;") == 7
    ids = re.findall(r'\bid="([^"]*)"', svg)
    assert ids == ["c-area", "c-hatch0"] and set(re.findall(r"url\(#([^)]*)\)", svg)) == set(ids)
    assert issubclass(Chart, Sheet)


def test_what_a_chart_does_not_have_is_an_error_and_no_silence() -> None:
    chart = Chart("c", SIZE, MARGINS, "sans")
    with pytest.raises(TypeError):
        chart.plot([0], [1], fillstyle="left")  # type: ignore[call-arg]
    with pytest.raises(ValueError, match="axes have no 'xmargin'"):
        chart.set(xmargin=3)
    with pytest.raises(ValueError, match="no marks and lines 'q-'"):
        chart.plot([0], [1], "q-")


def test_named_points_say_what_they_are_within_the_axes() -> None:
    def draw(axes: Axes) -> None:
        axes.set(xlim=(0, 1), ylim=(0, 1))
        name_points(axes, "pose", [0.5, 2.0, np.nan], [0.25, 0.5, 0.5], ["a\tb\n<i>", "far", "none"], ["1 mm"] * 3)

    chart = charted(draw)
    assert [each[2:] for each in chart.named_points()] == [("pose", "a\tb\n<i>", "1 mm")]
    shown = inline_svg(axes_picture("n", "l", SIZE, draw))
    assert re.search(r'data-points="(\d+)\t(\d+)\tpose\ta b &lt;i&gt;\t1 mm"', shown)
