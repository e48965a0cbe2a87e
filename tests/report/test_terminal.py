"""What a terminal shows, and what a pipe gets."""

import io
import re

import pytest
from rich.console import Console

from lab.core.progress import keep_line, stages
from lab.report.document import Badge, Bullets, Document, Paragraph, Table
from lab.report.terminal import print_document, showing_progress, time_left, to_text


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


def _work() -> None:
    with stages("fitting") as stage:
        stage("groups")
        stage("folds", 3, 10)
        keep_line("fitting", "a proposal")


def test_in_a_pipe_progress_is_not_shown_and_lines_to_keep_are(capfd: pytest.CaptureFixture[str]) -> None:
    kept = list[str]()
    with showing_progress(kept.append):
        _work()
    assert capfd.readouterr() == ("", "") and kept == ["a proposal"]


def test_on_a_terminal_the_line_of_progress_goes_when_the_work_ends(monkeypatch: pytest.MonkeyPatch) -> None:
    out = io.StringIO()
    monkeypatch.setattr(out, "isatty", lambda: True)
    monkeypatch.setenv("TERM", "xterm")
    monkeypatch.setattr("sys.stderr", out)
    with showing_progress(lambda line: None):
        _work()
    shown = out.getvalue()
    assert "fitting" in shown and shown.endswith("\x1b[2K"), "the line is erased"


@pytest.mark.parametrize("width", [40, 80, 100])
def test_no_word_is_broken_in_a_table(width: int) -> None:
    words = "uncertainty of the identified parameters including autocorrelated thermal_zeros"
    rows = ((words, "0.123", words, words), ("short", "1,234.5", "", "calibrated.py"))
    text = to_text(Document("title", (Table(("group", "hold-out error, mm", "", "identifiability"), rows),)), width)
    parts = set(re.split(r"[\s┃│]+", text))
    assert {*words.split(), "0.123", "1,234.5", "calibrated.py", "hold-out", "identifiability"} <= parts
