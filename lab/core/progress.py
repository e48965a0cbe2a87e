"""Report the progress of a call to whoever listens: events of its stages, and of the parts that are done."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass
from typing import Protocol

__all__ = ["Event", "Listener", "Progress", "Stage", "keep_line", "listening", "no_progress", "no_stage", "stages"]

Progress = Callable[[int, int], None]  # parts done, and their number


def no_progress(done: int, of: int) -> None:
    """Report nothing."""


@dataclass(frozen=True)
class Event:
    """Progress of a call.

    Attributes:
        work: what the call does, e.g. "identifying".
        stage: what is being done now, e.g. "fit"; "" when the work begins, and when it has ended.
        done, of: parts of the stage that are done, of how many; zeros where none are counted.
        line: a line for the user to keep, which is no stage; "" else.
    """

    work: str
    stage: str = ""
    done: int = 0
    of: int = 0
    line: str = ""

    @property
    def fraction(self) -> float:
        """Share of the stage that is done, 0 to 1, and 1 when the work has ended; NaN where it is unknown."""
        return self.done / self.of if self.of else float("nan")

    @property
    def ended(self) -> bool:
        """Check whether the work has ended."""
        return not self.stage and self.of > 0


Listener = Callable[[Event], None]
_LISTENER: ContextVar[Listener | None] = ContextVar("listener", default=None)


class Stage(Protocol):
    """Receives the stage of the work: its name, and where parts are counted, how many are done of how many."""

    def __call__(self, name: str, done: int = 0, of: int = 0) -> None:
        """Report it."""


def no_stage(name: str, done: int = 0, of: int = 0) -> None:
    """Report nothing."""


@contextmanager
def listening(listener: Listener | None) -> Iterator[None]:
    """Send the events of all calls within the block to a listener; None leaves the present one in its place."""
    if listener is None:
        yield
        return
    token = _LISTENER.set(listener)
    try:
        yield
    finally:
        _LISTENER.reset(token)


@contextmanager
def stages(work: str) -> Iterator[Stage]:
    """Report that a piece of work begins and ends, and yield the function that reports its stages.

    Args:
        work: what is done, e.g. "identifying".
    """
    listener = _LISTENER.get()
    if listener is None:
        yield no_stage
        return
    listener(Event(work))
    yield lambda name, done=0, of=0: listener(Event(work, name, done, of))
    listener(Event(work, done=1, of=1))


def keep_line(work: str, line: str) -> None:
    """Report a line for the user to keep, e.g. a proposal among those of a session."""
    if (listener := _LISTENER.get()) is not None:
        listener(Event(work, line=line))
