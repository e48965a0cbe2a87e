"""What long work is at: a line or bars on a terminal, nothing in a pipe."""

import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any, Protocol

__all__ = ["Stage", "bars", "no_stage", "starting", "status", "time_left"]

_SURE = 0.5  # s: before, nothing is said of the time left
_NAMED = 12  # letters of a stage's words that say which it is
_ERASE = "\r\x1b[K"


class Stage(Protocol):
    """Takes what work is at: in words, and where parts of it are counted, how many are done of how many."""

    def __call__(self, words: str, done: int = 0, of: int = 0) -> None:
        """Show it."""


def no_stage(words: str, done: int = 0, of: int = 0) -> None:
    """Show nothing."""


@contextmanager
def starting(what: str) -> Iterator[None]:
    """Say at once that a command has begun, in a line that goes when its libraries are loaded."""
    if not sys.stderr.isatty():
        yield
        return
    print(f"{what}: starting", end="", file=sys.stderr, flush=True)
    try:
        yield
    finally:
        print(_ERASE, end="", file=sys.stderr, flush=True)


@contextmanager
def status(work: str) -> Iterator[Stage]:
    """Takes the stage that the work is at, and shows it with the time in a line that goes when the work is done."""
    if not sys.stderr.isatty():
        yield no_stage
        return
    from rich.console import Console
    from rich.progress import Progress, SpinnerColumn, TextColumn, TimeElapsedColumn

    columns = (SpinnerColumn(), TextColumn("{task.description}", markup=False), TimeElapsedColumn())
    begun: dict[str, float] = {}
    with Progress(*columns, console=Console(stderr=True), transient=True) as shown:
        task = shown.add_task(work, total=None)

        def stage(words: str, done: int = 0, of: int = 0) -> None:
            name = words[:_NAMED]
            if not done:  # it begins, or begins anew
                begun[name] = time.monotonic()
            since = time.monotonic() - begun.setdefault(name, time.monotonic())
            count = f" ({done:,} of {of:,}{time_left(since, done, of)})" if of else ""
            shown.update(task, description=f"{work}: {words}{count}")

        yield stage


def time_left(seconds: float, done: int, of: int) -> str:
    """How long the rest will take if it goes on as it went until now, for a person; empty where it is too early to say.

    Args:
        seconds: that the parts that are done took.
    """
    if not done or seconds < _SURE or done >= of:
        return ""
    left = seconds / done * (of - done)
    return f", about {left / 60:.0f} min left" if left >= 100 else f", about {max(left, 1):.0f} s left"


@contextmanager
def bars() -> Iterator[Callable[[str, int, int], None]]:
    """Takes what is being made, how many there are, and how many there are to be; a bar for each kind."""
    if not sys.stderr.isatty():
        yield lambda what, there, all_of_them: None
        return
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

    shown_bars: dict[str, tuple[Any, int, float]] = {}
    words = TextColumn("{task.description}", markup=False), TextColumn("{task.fields[left]}", markup=False)
    columns = (words[0], BarColumn(), MofNCompleteColumn(), TimeElapsedColumn(), words[1])
    with Progress(*columns, console=Console(stderr=True)) as shown:

        def progress(what: str, there: int, all_of_them: int) -> None:
            if what not in shown_bars:
                task = shown.add_task(what, total=all_of_them, completed=there, left="")
                shown_bars[what] = task, there, time.monotonic()
            task, first, begun = shown_bars[what]
            left = time_left(time.monotonic() - begun, there - first, all_of_them - first)
            shown.update(task, completed=there, left=left.removeprefix(", "))

        yield progress
