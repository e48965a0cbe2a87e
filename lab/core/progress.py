"""Progress callbacks."""

from collections.abc import Callable

__all__ = ["Progress", "no_progress"]

Progress = Callable[[int, int], None]  # parts done, and their number


def no_progress(done: int, of: int) -> None:
    """Show nothing."""
