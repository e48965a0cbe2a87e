"""What a terminal shows, and what a pipe gets."""

import io
import re
from pathlib import Path
from types import SimpleNamespace

import pytest
from rich.console import Console

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


@pytest.mark.parametrize("width", [40, 80, 100])
def test_no_word_is_broken_in_a_table(width: int) -> None:
    words = "uncertainty of the identified parameters including autocorrelated thermal_zeros"
    rows = ((words, "0.123", words, words), ("short", "1,234.5", "", "calibrated.py"))
    text = to_text(Document("title", (Table(("group", "hold-out error, mm", "", "identifiability"), rows),)), width)
    parts = set(re.split(r"[\s┃│]+", text))
    assert {*words.split(), "0.123", "1,234.5", "calibrated.py", "hold-out", "identifiability"} <= parts


def test_a_path_is_a_link_where_the_terminal_knows_links(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    page = tmp_path / "a page.html"
    assert linked(page) == str(page)
    monkeypatch.setattr("sys.stdout.isatty", lambda: True, raising=False)
    monkeypatch.setenv("TERM", "xterm-256color")
    assert linked(page) == f"\x1b]8;;{page.as_uri()}\x1b\\{page}\x1b]8;;\x1b\\" and "%20" in linked(page)
    monkeypatch.setenv("TERM", "dumb")
    assert linked(page) == str(page)
