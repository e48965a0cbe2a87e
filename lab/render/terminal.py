"""A document on a terminal, or as plain text."""

import io
import json
import math
import sys
from collections.abc import Iterable, Mapping
from typing import Any

from rich.console import Console
from rich.measure import Measurement
from rich.table import Table as RichTable
from rich.text import Text as RichText

from lab.render.document import (
    Badge,
    Block,
    Bullets,
    Command,
    Document,
    Paragraph,
    Section,
    Strong,
    Table,
    Text,
    Warnings,
    inlines,
    plain,
    shown,
)

__all__ = ["print_document", "print_json", "to_text"]

_UNWRAPPED = 100_000  # columns
_ROW_STYLES = {"before": "dark_orange3", "after": "blue", "quiet": "dim"}
_BADGE_STYLES = {"good": "bold green", "doubtful": "bold yellow", "bad": "bold red", "open": "bold"}


def print_document(document: Document, console: Console | None = None, *, warnings: bool = True) -> None:
    """Print a document.

    Args:
        console: standard output by default; where that is no terminal, lines are as long as they are.
        warnings: whether warnings are shown; not where they were told elsewhere already.
    """
    console = console or Console(highlight=False, markup=False, width=None if sys.stdout.isatty() else _UNWRAPPED)
    console.print(RichText(document.title, style="bold"), soft_wrap=True)
    _print(console, shown(document.blocks, "terminal"), warnings)


def print_json(values: Mapping[str, Any]) -> None:
    """Print one JSON object on standard output; a number that is not finite is null, for JSON has none."""
    print(json.dumps(_finite(values), allow_nan=False))


def _finite(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {name: _finite(each) for name, each in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(each) for each in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


def to_text(document: Document, width: int = 100) -> str:
    """A document as plain text, lines no longer than ``width`` where words allow."""
    file = io.StringIO()
    console = Console(file=file, width=width, highlight=False, markup=False, color_system=None, force_jupyter=False)
    print_document(document, console)
    return file.getvalue()


def _print(console: Console, blocks: Iterable[Block], warnings: bool) -> None:
    for block in blocks:
        match block:
            case Section():
                console.print()
                console.print(RichText(block.title, style="bold"))
                _print(console, block.blocks, warnings)
            case Paragraph():
                console.print(_styled(block.text))
            case Command():
                console.print(RichText(block.text), soft_wrap=True)
            case Bullets():
                for item in block.items:
                    hanging = RichTable.grid()
                    hanging.add_column(width=2)
                    hanging.add_column()
                    hanging.add_row("-", _styled(item))
                    console.print(hanging)
            case Warnings():
                for text in block.texts if warnings else ():
                    console.print(RichText("warning: ", style="bold yellow") + RichText(text))
            case Table():
                _print_table(console, block)


def _print_table(console: Console, block: Table) -> None:
    if block.caption:
        console.print(RichText(block.caption))
    table = RichTable(show_header=any(block.headings))
    for heading, number in zip(block.headings, block.numeric, strict=True):
        table.add_column(RichText(heading), justify="right" if number else "left", no_wrap=number, overflow="fold")
    for kind, cells in block.lines:
        table.add_row(*map(_styled, cells), style=_ROW_STYLES.get(kind))
    usual = console.width
    console.width = max(usual, Measurement.get(console, console.options.update(width=_UNWRAPPED), table).minimum)
    console.print(table, crop=False)  # every number whole, though it be on two lines of the terminal
    console.width = usual


def _styled(text: Text) -> RichText:
    styled = RichText()
    for part in inlines(text):
        style = _BADGE_STYLES[part.kind] if isinstance(part, Badge) else "bold" if isinstance(part, Strong) else ""
        styled.append(plain(part), style=style)
    return styled
