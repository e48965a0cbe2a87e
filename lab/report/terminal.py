"""A document on a terminal, or as plain text."""

import io
import os
import sys
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from rich.cells import cell_len
from rich.console import Console
from rich.measure import Measurement
from rich.table import Table as RichTable
from rich.text import Text as RichText

from lab.core.progress import Event, listening
from lab.report import document as doc
from lab.report.document import inlines, plain, shown

__all__ = ["linked", "print_document", "showing_progress", "starting", "time_left", "to_text"]

_UNWRAPPED = 100_000  # columns
_BLUE, _AMBER, _RED, _GREEN, _GREY = "#5f5fff", "#b06000", "#eb0000", "#008800", "#767676"  # on black and on white
_ROW_STYLES = {"before": _AMBER, "after": f"bold {_BLUE}", "quiet": _GREY}
_BADGE_STYLES = {"good": f"bold {_GREEN}", "doubtful": f"bold {_AMBER}", "bad": f"bold {_RED}", "open": "bold"}
_PATH_COLUMNS = 24  # of a path, which may be broken at a line's end; other words may not
_WITHOUT_LINKS = ("dumb", "linux")  # terminals that print what they do not know


def print_document(document: doc.Document, console: Console | None = None, *, warnings: bool = True) -> None:
    """Print a document.

    Args:
        console: standard output by default; where that is no terminal, lines are as long as they are.
        warnings: whether warnings are shown; not where they were reported elsewhere.
    """
    console = console or Console(highlight=False, markup=False, width=None if sys.stdout.isatty() else _UNWRAPPED)
    console.print(RichText(document.title, style="bold"), soft_wrap=True)
    _print(console, shown(document.blocks, "terminal"), warnings)


def to_text(document: doc.Document, width: int = 100) -> str:
    """A document as plain text, lines no longer than ``width`` where words allow."""
    file = io.StringIO()
    console = Console(file=file, width=width, highlight=False, markup=False, color_system=None, force_jupyter=False)
    print_document(document, console)
    return file.getvalue()


def _print(console: Console, blocks: Iterable[doc.Block], warnings: bool) -> None:
    for block in blocks:
        match block:
            case doc.Section():
                console.print()
                console.print(RichText(block.title, style="bold"))
                _print(console, block.blocks, warnings)
            case doc.Paragraph():
                console.print(_styled(block.text))
            case doc.Matrices():
                _print_matrices(console, block)
            case doc.CommandText():
                console.print(RichText(block.text), soft_wrap=True)
            case doc.Bullets():
                _print_bullets(console, block)
            case doc.Warnings() if warnings:
                _print_warnings(console, block)
            case doc.Table():
                _print_table(console, block)


def _print_warnings(console: Console, block: doc.Warnings) -> None:
    for text in block.texts:
        console.print(RichText("warning: ", style=f"bold {_AMBER}") + RichText(text))


def _print_bullets(console: Console, block: doc.Bullets) -> None:
    for item in block.items:
        hanging = RichTable.grid()
        hanging.add_column(width=2)
        hanging.add_column()
        hanging.add_row("-", _styled(item))
        console.print(hanging)


def _print_table(console: Console, block: doc.Table) -> None:
    if block.caption:
        console.print(RichText(block.caption))
    table = RichTable(show_header=any(block.headings))
    for heading, number in zip(block.headings, block.numeric, strict=True):
        table.add_column(RichText(heading), justify="right" if number else "left", no_wrap=number, overflow="fold")
    for kind, cells in block.lines:
        table.add_row(*map(_styled, cells), style=_ROW_STYLES.get(kind))
    _share_width(console, table, block)
    usual = console.width
    console.width = max(usual, Measurement.get(console, console.options.update(width=_UNWRAPPED), table).minimum)
    console.print(table, crop=False)  # every number whole, though it be on two lines of the terminal
    console.width = usual


_BETWEEN, _WIDEST = 4, 120  # columns between matrices, and of all on a line where a line has no end


def _print_matrices(console: Console, block: doc.Matrices) -> None:
    """Print matrices in brackets, side by side as far as a line goes."""
    drawn, width, room = list[list[RichText]](), 0, min(console.width, _WIDEST)
    for matrix in block.matrices:
        lines = _matrix_lines(matrix)
        if drawn and width + _BETWEEN + lines[0].cell_len > room:
            _print_beside(console, drawn)
            drawn, width = [], 0
        width += (_BETWEEN if drawn else 0) + lines[0].cell_len
        drawn.append(lines)
    _print_beside(console, drawn)


def _matrix_lines(matrix: doc.Matrix) -> list[RichText]:
    """Return the lines of a matrix, all equally long: its name with its badge, then its versions side by side."""
    versions = [_bracketed(caption, rows) for caption, rows in matrix.versions]
    lines = [RichText(matrix.name, style="bold") + RichText(" ") + _styled(matrix.badge)]
    lines += [RichText("  ").join(parts) for parts in zip(*versions, strict=True)]
    most = max(line.cell_len for line in lines)
    return [line + RichText(" " * (most - line.cell_len)) for line in lines]


def _bracketed(caption: str, rows: tuple[doc.Row, ...]) -> list[RichText]:
    """Return the lines of one version, all equally long: its caption where it has one, and the rows in brackets."""
    cells = [[_styled(cell) for cell in row] for row in rows]
    widths = [max(cell.cell_len for cell in column) for column in zip(*cells, strict=True)]
    lines, last = [RichText(caption)] if caption else [], len(cells) - 1
    for i, row in enumerate(cells):
        left, right = _brackets(i, last)
        line = RichText(left)
        for cell, wide in zip(row, widths, strict=True):
            line += RichText(" ") + cell + RichText(" " * (wide - cell.cell_len + 1))
        lines.append(line + RichText(right))
    most = max(line.cell_len for line in lines)
    return [line + RichText(" " * (most - line.cell_len)) for line in lines]


def _brackets(row: int, last: int) -> tuple[str, str]:
    """Return the left and the right bracket of a row of a matrix."""
    if last == 0:
        return "[", "]"
    return ("⎡", "⎤") if row == 0 else ("⎣", "⎦") if row == last else ("⎢", "⎥")


def _print_beside(console: Console, drawn: list[list[RichText]]) -> None:
    """Print blocks of lines side by side; the shorter ones end above."""
    widths = [lines[0].cell_len for lines in drawn]
    for i in range(max(map(len, drawn))):
        line = RichText()
        for lines, wide in zip(drawn, widths, strict=True):
            line += lines[i] if i < len(lines) else RichText(" " * wide)
            line += RichText(" " * _BETWEEN)
        line.rstrip()
        console.print(line, soft_wrap=True)
    console.print()


def _share_width(console: Console, table: RichTable, block: doc.Table) -> None:
    """Give a table that is too wide columns in which no word and no number is broken; rich would break some."""
    columns = list(zip(block.headings, *(map(plain, row) for row in block.rows), strict=True))
    most = [max(map(cell_len, texts)) for texts in columns]
    room = console.width - 3 * len(columns) - 1
    if sum(most) <= room:
        return
    least = [
        max(map(cell_len, texts[1:]), default=0) if number else max(map(_unbroken, texts[1:]), default=0)
        for texts, number in zip(columns, block.numeric, strict=True)
    ]
    least = [max(width, _unbroken(texts[0])) for width, texts in zip(least, columns, strict=True)]
    spare = max(room - sum(least), 0)
    wanted = sum(most) - sum(least)
    for column, small, large in zip(table.columns, least, most, strict=True):
        column.width, column.no_wrap = small + spare * (large - small) // wanted if wanted else small, False


def _unbroken(text: str) -> int:
    """Return the columns that a text's longest word needs; of a path some."""
    return max(
        (min(cell_len(word), _PATH_COLUMNS) if "/" in word else cell_len(word) for word in text.split()), default=0
    )


def linked(path: Path) -> str:
    """Return a path for standard output: on a terminal that knows links (OSC 8), as one to the file."""
    if not sys.stdout.isatty() or os.environ.get("TERM", "dumb") in _WITHOUT_LINKS:
        return str(path)
    return f"\x1b]8;;{path.resolve().as_uri()}\x1b\\{path}\x1b]8;;\x1b\\"


def _styled(text: doc.Text) -> RichText:
    styled = RichText()
    for part in inlines(text):
        style = (
            _BADGE_STYLES[part.kind] if isinstance(part, doc.Badge) else "bold" if isinstance(part, doc.Strong) else ""
        )
        styled.append(plain(part), style=style)
    return styled


_SURE = 0.5  # s: before, no remaining time is estimated
_ERASE = "\r\x1b[K"


@contextmanager
def starting(what: str) -> Iterator[None]:
    """Show at once that a command has begun, in a line that goes when its libraries are loaded."""
    if not sys.stderr.isatty():
        yield
        return
    print(f"{what}: starting", end="", file=sys.stderr, flush=True)
    try:
        yield
    finally:
        print(_ERASE, end="", file=sys.stderr, flush=True)


@contextmanager
def showing_progress(keep: Callable[[str], None]) -> Iterator[None]:
    """Show the progress of calls with the time, in a line on standard error that goes when the work is done.

    Args:
        keep: prints a line that stays.
    """
    line = _ProgressLine() if sys.stderr.isatty() else None

    def show(event: Event) -> None:
        if event.line:
            keep(event.line)
        elif line is not None:
            line.show(event)

    try:
        with listening(show):
            yield
    finally:
        if line is not None:
            line.stop()


class _ProgressLine:
    """The line of the work that is being done: its stage, what of it is done, and the time."""

    def __init__(self) -> None:
        self._progress: Any = None
        self._stage, self._first, self._begun = "", 0, 0.0  # of the stage: parts done at first, and when (s)

    def show(self, event: Event) -> None:
        """Show an event; the line of work that has ended goes."""
        if event.ended:
            self.stop()
            return
        if self._progress is None:
            self._start()
        if event.stage != self._stage or not event.done:  # it begins, or begins anew
            self._stage, self._first, self._begun = event.stage, event.done, time.monotonic()
        left = time_left(time.monotonic() - self._begun, event.done - self._first, event.of - self._first)
        count = f" ({event.done:,} of {event.of:,}{left})" if event.of else ""
        text = f"{event.work}: {event.stage}{count}" if event.stage else event.work
        self._progress.update(self._progress.task_ids[0], description=text)

    def _start(self) -> None:
        from rich.progress import Progress, SpinnerColumn, TextColumn, TimeElapsedColumn

        columns = (SpinnerColumn(), TextColumn("{task.description}", markup=False), TimeElapsedColumn())
        self._progress = Progress(*columns, console=Console(stderr=True), transient=True)
        self._progress.add_task("", total=None)
        self._progress.start()

    def stop(self) -> None:
        """Erase the line."""
        if self._progress is not None:
            self._progress.stop()
            self._progress = None


def time_left(seconds: float, done: int, of: int) -> str:
    """Return the remaining time at the present rate, for the user; empty if it is too early to estimate.

    Args:
        seconds: that the parts that are done took.
    """
    if not done or seconds < _SURE or done >= of:
        return ""
    left = seconds / done * (of - done)
    return f", about {left / 60:.0f} min left" if left >= 100 else f", about {max(left, 1):.0f} s left"
