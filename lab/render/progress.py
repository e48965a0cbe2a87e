"""What long work is at: a line or bars on a terminal, nothing in a pipe."""

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

__all__ = ["bars", "status"]


@contextmanager
def status(work: str) -> Iterator[Callable[[str], None]]:
    """Takes the stage that the work is at, and shows it in a line that goes when the work is done."""
    if not sys.stderr.isatty():
        yield lambda stage: None
        return
    from rich.console import Console

    with Console(stderr=True).status(work) as shown:
        yield lambda stage: shown.update(f"{work}: {stage}")


@contextmanager
def bars() -> Iterator[Callable[[str, int, int], None]]:
    """Takes what is being made, how many there are, and how many there are to be; a bar for each kind."""
    if not sys.stderr.isatty():
        yield lambda what, there, all_of_them: None
        return
    from rich.console import Console
    from rich.progress import MofNCompleteColumn, Progress, TimeRemainingColumn

    shown_bars: dict[str, Any] = {}
    columns = (*Progress.get_default_columns()[:2], MofNCompleteColumn(), TimeRemainingColumn())
    with Progress(*columns, console=Console(stderr=True)) as shown:

        def progress(what: str, there: int, all_of_them: int) -> None:
            if what not in shown_bars:
                shown_bars[what] = shown.add_task(what, total=all_of_them, completed=there)
            shown.update(shown_bars[what], completed=there)

        yield progress
