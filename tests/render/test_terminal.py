"""What a terminal shows, and what a pipe gets."""

import io
import re
from pathlib import Path
from types import SimpleNamespace

import pytest
from rich.color import Color
from rich.console import Console
from rich.style import Style

from lab.render import terminal as progress
from lab.render.document import Badge, Bullets, Document, Paragraph, Table
from lab.render.terminal import linked, print_document, time_left, to_text


def test_where_there_is_no_terminal_nothing_is_wrapped_or_cut(capsys: pytest.CaptureFixture[str]) -> None:
    words = ("a sentence that is longer than any line of a terminal " * 6).strip()
    names = tuple(f"a_column_with_a_long_name_{i}" for i in range(9))
    rows = (tuple(f"link{i}.theta_of_a_long_name" for i in range(9)),)
    print_document(Document("title", (Paragraph(words), Bullets((words,)), Table(names, rows))))
    lines = [line.strip() for line in capsys.readouterr().out.splitlines()]
    assert words in lines and f"- {words}" in lines
    assert all(name in "".join(lines) for name in (*names, *rows[0])) and "…" not in "".join(lines)


@pytest.mark.parametrize("width", [40, 80, 140])
def test_on_a_terminal_no_number_is_cut_and_the_verdict_is_coloured(width: int) -> None:
    numbers, out = tuple(f"{1000.125 * 10**i:.3f}" for i in range(9)), io.StringIO()
    console = Console(
        file=out, width=width, highlight=False, markup=False, force_terminal=True, color_system="standard"
    )
    verdict = Paragraph(("Verdict: ", Badge("doubtful", "doubtful"), " 1 of 2"))
    print_document(Document("title", (verdict, Table(("",) * 9, (numbers,)))), console)
    shown = out.getvalue()
    assert all(number in shown for number in numbers) and "…" not in shown
    assert "\x1b[1;33mdoubtful\x1b[0m 1 of 2" in shown  # and numbers are not


def test_the_time_left_is_said_when_it_is_known() -> None:
    assert time_left(0.4, 5, 10) == "" and time_left(9.0, 0, 10) == "" and time_left(9.0, 10, 10) == ""
    assert time_left(0.8, 1, 10) == ", about 7 s left", "within a second of start"
    assert time_left(9.0, 99, 100) == ", about 1 s left", "never none"
    assert time_left(6.0, 2, 10) == ", about 24 s left" and time_left(60.0, 1, 11) == ", about 10 min left"


def test_a_stage_that_begins_anew_is_reckoned_anew(monkeypatch: pytest.MonkeyPatch) -> None:
    """What earlier robots or designs took says nothing of the time that this one has left."""
    said, clock = list[str](), iter(range(0, 1000, 10))
    monkeypatch.setattr("sys.stderr.isatty", lambda: True, raising=False)
    monkeypatch.setattr(progress, "time", SimpleNamespace(monotonic=lambda: next(clock)))
    monkeypatch.setattr("rich.progress.Progress.update", lambda _, task, description: said.append(description))
    with progress.status("planning") as stage:
        for count in (9, 8):
            for done in range(2):
                stage(f"2 of 5, design of {count} poses", done, 4)
    left = [words.partition(", about ")[2] for words in said]
    assert left[0] == left[2] == "" and left[1] == left[3] != ""


def contrast(style: str, ground: float) -> float:
    """The contrast of a style's colour with a grey background (WCAG 2)."""
    colour = Style.parse(style).color or Color.parse("black")
    channels = [value / 255 for value in colour.get_truecolor()]
    linear = [x / 12.92 if x <= 0.04045 else ((x + 0.055) / 1.055) ** 2.4 for x in channels]
    lightness = sum(weight * x for weight, x in zip((0.2126, 0.7152, 0.0722), linear, strict=True))
    bright, dark = sorted((lightness, ground), reverse=True)
    return (bright + 0.05) / (dark + 0.05)


def test_colours_are_read_on_black_and_on_white() -> None:
    styles = [*progress._ROW_STYLES.values(), *progress._BADGE_STYLES.values()]
    for style in styles:
        if Style.parse(style).color is not None:
            assert min(contrast(style, ground) for ground in (0.0, 1.0)) >= 4.5, style
    assert contrast("blue", 0.0) < 4.5 < contrast("white", 0.0)  # the measure tells them apart


@pytest.mark.parametrize("width", [40, 80, 100])
def test_no_word_is_broken_in_a_table(width: int) -> None:
    words = "uncertainty of the identified parameters including autocorrelated thermal_zeros"
    rows = ((words, "0.123", words, words), ("short", "1,234.5", "", "calibrated.py"))
    text = to_text(Document("title", (Table(("group", "hold-out error, mm", "", "identifiability"), rows),)), width)
    parts = set(re.split(r"[\s┃│]+", text))
    assert {*words.split(), "0.123", "1,234.5", "calibrated.py", "hold-out", "identifiability"} <= parts


def test_a_long_path_may_be_broken_and_the_table_fits() -> None:
    path = "/".join(["a_folder_of_runs"] * 9)
    text = to_text(Document("title", (Table(("run", "state"), ((path, "the calibration is good"),)),)), 60)
    assert max(map(len, text.splitlines())) <= 60 and path not in text
    assert path in re.sub(r"[\s│]|the|calibration|is|good", "", text)


def test_a_path_is_a_link_where_the_terminal_knows_links(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    page = tmp_path / "a page.html"
    assert linked(page) == str(page)
    monkeypatch.setattr("sys.stdout.isatty", lambda: True, raising=False)
    monkeypatch.setenv("TERM", "xterm-256color")
    assert linked(page) == f"\x1b]8;;{page.as_uri()}\x1b\\{page}\x1b]8;;\x1b\\" and "%20" in linked(page)
    monkeypatch.setenv("TERM", "dumb")
    assert linked(page) == str(page)
