"""A limit of time for what a test calls."""

import signal
from collections.abc import Iterator
from contextlib import contextmanager

__all__ = ["within"]

_WAITING = 10  # times as long by the clock: for what waits, and for a machine with other work


@contextmanager
def within(seconds: int) -> Iterator[None]:
    """An error for what takes more processor time, or waits ten times as long."""

    def late(*_: object) -> None:
        raise TimeoutError(f"not done in {seconds} s")

    usual = {number: signal.signal(number, late) for number in (signal.SIGALRM, signal.SIGPROF)}
    signal.alarm(_WAITING * seconds)
    signal.setitimer(signal.ITIMER_PROF, seconds)
    try:
        yield
    finally:
        signal.alarm(0)
        signal.setitimer(signal.ITIMER_PROF, 0)
        for number, handler in usual.items():
            signal.signal(number, handler)
