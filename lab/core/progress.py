"""Progress callbacks: a bar on a terminal, or none."""

from collections.abc import Callable

__all__ = ["Progress", "no_progress"]

Progress = Callable[[int, int], None]  # how many parts are done, of how many


def no_progress(done: int, of: int) -> None:
    """Tell nobody."""
