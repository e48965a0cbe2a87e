"""Charts: places and limits as matplotlib finds them, nothing of a user's taken for markup, discs where points are."""

import re

import numpy as np
import pytest
from matplotlib import rc_context
from matplotlib.axes import Axes as PaperAxes
from matplotlib.figure import Figure

from lab.render.charts.chart import Chart, Sheet, axes_picture, inline_svg, log_ticks, name_points, shades
from lab.render.charts.marks import ROUND, Axes, Legend, cells, colour, line, marks, text_width
from lab.render.style import FIGURE_STYLE, rgb

SIZE, MARGINS = (4.0, 3.0), (0.5, 0.5, 0.5, 0.5)
VALUES = np.random.default_rng(3).normal(size=20)


def charted(draw) -> Chart:
    made = Chart("c", SIZE, MARGINS, "sans")
    draw(made)
    return made


def on_paper(draw) -> PaperAxes:
    with rc_context(FIGURE_STYLE):
        made = Figure(figsize=SIZE).add_axes((0.125, 1 / 6, 0.75, 2 / 3))
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


def _wider(axes: Axes) -> None:
    axes.scatter([0, 10], [0, 1])
    axes.set_aspect("equal", adjustable="datalim")


def _matrix(axes: Axes) -> None:
    axes.imshow(shades(np.eye(4), ("#000000", "#ffffff")))


CASES = [
    lambda axes: axes.plot(VALUES, VALUES**2, "s--"), _bars, _steps, _lines, _area, _logarithm, _equal,
    _wider, _matrix,
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


def test_marks_that_one_sees_through_darken_each_other() -> None:
    """One path is painted once, however often it crosses itself: each mark is a path of its own, at most 300 are."""
    for count, paths in ((7, 7), (900, 300)):
        drawn = marks(np.zeros(count), np.zeros(count), "o", 3, ["#000000"], alpha=0.5)
        assert drawn.count("<path") == paths and drawn.count("h0") == count and 'stroke-opacity="0.5"' in drawn


def test_cells_have_their_colours_and_gaps_none() -> None:
    shown = shades(np.array([[0.0, 0.5], [np.nan, 1.0]]), ("#000000", "#ff0000", "#ffffff"))
    drawn = cells(np.arange(3.0), np.arange(3.0), shown)
    assert re.findall(r'd="(M\S+) [^>]*fill="(#\w+)"', drawn) == [
        ("M0.00", "#000000"), ("M1.00", "#ff0000"), ("M1.00", "#ffffff"),
    ]  # fmt: skip
    assert colour("0.5") == "#808080" and colour("red") == "red"


def test_a_legend_hides_no_points_where_it_can() -> None:
    def draw(axes: Axes) -> None:
        axes.set(xlim=(0, 1), ylim=(0, 1))
        axes.plot([0.6, 0.9], [0.9, 0.9], "o", label="upper right")
        axes.plot([0.05, 0.3], [0.9, 0.9], label="upper left")
        axes.legend(loc="best")

    words = re.findall(r'<text x="([\d.]+)" y="([\d.]+)"[^>]*>(upper [^<]*)', charted(draw).svg())
    assert [said for *_, said in words] == ["upper right", "upper left"]
    assert all(float(x) < 100 and float(y) > 120 for x, y, _ in words)  # lower left
    assert Legend().loc == "best" and text_width("mm", 9) > text_width("il", 9)


def test_words_are_words_and_ids_the_picture_s_own() -> None:
    hostile = "<b>&'\"</b>"

    def draw(axes: Axes) -> None:
        axes.set(title=hostile, xlabel=hostile, ylabel=hostile)
        axes.set_xticks([0], [hostile], rotation=90)
        axes.annotate(f"{hostile}\n{hostile}", (0, 0.5), xycoords=("data", "axes fraction"))
        axes.barh([0], [1], hatch="////")
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


def test_hidden_axes_have_neither_lines_nor_ticks() -> None:
    shown, hidden = (charted(lambda axes, off=off: (axes.plot([0, 1], [0, 1]), off and axes.axis("off"))).svg()
                     for off in (False, True))  # fmt: skip
    assert "<text" in shown and "<text" not in hidden and len(hidden) < len(shown)


def test_arrows_have_the_ends_that_matplotlib_gives_them() -> None:
    x, y, u, v = np.array([[1.0, 4.0], [2.0, 3.0], [2.0, -1.0], [0.5, np.nan]])
    options = {"angles": "xy", "scale_units": "xy", "scale": 0.5}

    def draw(axes: Axes) -> None:
        axes.quiver(x, y, u, v, **options)
        axes.set(xlim=(0, 10), ylim=(0, 5))

    chart, paper = charted(draw), on_paper(draw)
    paper.figure.draw_without_rendering()
    across, up = chart.scales()
    found = re.findall(r"M([\d.]+) ([\d.]+)l(-?[\d.]+) (-?[\d.]+)m", chart.svg())
    assert len(found) == 1  # the other has no direction
    start, along = np.array(found[0][:2], float), np.array(found[0][2:], float)
    np.testing.assert_allclose(start, [float(across(1.0)), float(up(2.0))], atol=0.6)
    tip = paper.transData.transform((1 + 2 / 0.5, 2 + 0.5 / 0.5)) * 72 / paper.figure.dpi
    np.testing.assert_allclose((start + along) * [1, -1] + [0, chart.height], tip, atol=0.6)


def test_axes_within_axes_are_where_matplotlib_puts_them() -> None:
    made: list = []

    def draw(axes: Axes) -> None:
        axes.set(xlim=(0, 2), ylim=(0, 1))
        axes.set_aspect("equal")
        inset = axes.inset_axes((0.1, -0.3, 0.8, 0.05))
        inset.set(xlim=(1, 3), ylim=(0, 1), xlabel="scale")
        made.append(inset)

    chart, paper = charted(draw), on_paper(draw)
    paper.figure.draw_without_rendering()
    svg = chart.svg()
    across, up = made[0].scales()
    for x, y in ((1, 0), (3, 1), (2.5, 0.5)):
        there = np.array([float(across(x)), chart.height - float(up(y))])
        np.testing.assert_allclose(there, made[1].transData.transform((x, y)) * 72 / paper.figure.dpi, atol=0.3)
    assert ">scale<" in svg and len(set(re.findall(r'\bid="([^"]*)"', svg))) == 2


def test_a_title_that_is_too_wide_is_broken_and_makes_room() -> None:
    long = "the distance from the socket before calibration, from the side and from above"
    short, wide = (charted(lambda axes, title=title: axes.set(title=title)) for title in ("short", long))
    assert wide.height > short.height and wide.svg().count("<tspan") >= 1
    middle = (wide.left + wide.width - wide.right) / 2
    for part in wide.title.split("\n"):
        assert text_width(part, 10) <= 2 * min(middle, wide.width - middle)
    assert wide.title.replace("\n", " ") == long
    area = [chart.scales()[1].start - chart.scales()[1].end for chart in (short, wide)]
    assert area[0] == pytest.approx(area[1])


def test_named_points_say_what_they_are_within_the_axes() -> None:
    def draw(axes: Axes) -> None:
        axes.set(xlim=(0, 1), ylim=(0, 1))
        name_points(axes, "pose", [0.5, 2.0, np.nan], [0.25, 0.5, 0.5], ["a\tb\n<i>", "far", "none"], ["1 mm"] * 3)

    chart = charted(draw)
    assert [each[2:] for each in chart.named_points()] == [("pose", "a\tb\n<i>", "1 mm")]
    shown = inline_svg(axes_picture("n", "l", SIZE, draw))
    assert re.search(r'data-points="(\d+)\t(\d+)\tpose\ta b &lt;i&gt;\t1 mm"', shown)
    on_paper(draw)  # which has no names


def test_colours_of_a_page_are_variables_but_on_areas_of_their_own() -> None:
    own = {"boxstyle": "round,pad=0.1", "facecolor": "#440154", "edgecolor": "none"}

    def draw(axes: Axes) -> None:
        axes.plot([0, 1], [0, 1], color="#0b2a6b")
        axes.scatter([0], [0], c=[[0.5, 0.25, 0.123]])
        axes.scatter([0], [0], c=["#123456"], edgecolors="white", linewidths=1)
        axes.annotate("word", (0, 0), color="white", bbox=own)
        axes.annotate("#abcdef", (0, 0), color="black")

    shown = inline_svg(axes_picture("n", "l", SIZE, draw))
    assert {"--c-0b2a6b", "--c-000000", "rgb(18,52,86)", "rgb(68,1,84)", "rgb(255,255,255)"} <= set(
        re.findall(r"--c-\w+|rgb\([\d,]+\)", shown)
    )
    assert not re.search(r'="#\w{6}"', shown) and ">#abcdef<" in shown and 'fill="var(--c-ffffff)"' not in shown
    parts = np.array(rgb(re.search(r"--c-(8\w{5})", shown)[1]))  # type: ignore[index]
    assert np.abs(parts - 255 * np.array([0.5, 0.25, 0.123])).max() <= 255 / 62 + 1


@pytest.mark.parametrize("size", [6.5, 8, 9, 14])
def test_a_picture_is_not_shown_narrower_than_its_letters_allow(size: float) -> None:
    shown = inline_svg(axes_picture("n", "l", SIZE, lambda axes: axes.annotate("word", (0, 0), fontsize=size)))
    width, least = map(int, re.search(r"width: (\d+)px; min-width: (\d+)px", shown).groups())  # type: ignore[union-attr]
    smallest = min(size, 9)  # that of the ticks
    assert width >= least and smallest * least / (72 * SIZE[0]) == pytest.approx(10, rel=0.01)
    assert width == max(96 * SIZE[0], least)
