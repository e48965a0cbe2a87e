"""A guard against what never ends."""

import signal
from collections.abc import Iterator
from contextlib import contextmanager

__all__ = ["ends"]

_HANG_S = 600  # far beyond anything a slow machine needs: it tells a hang from work, and says nothing of speed


@contextmanager
def ends() -> Iterator[None]:
    """Raise TimeoutError in what hangs."""

    def late(*_: object) -> None:
        raise TimeoutError(f"still running after {_HANG_S} s")

    usual = signal.signal(signal.SIGALRM, late)
    signal.alarm(_HANG_S)
    try:
        yield
    finally:
        signal.alarm(0)
        signal.signal(signal.SIGALRM, usual)
