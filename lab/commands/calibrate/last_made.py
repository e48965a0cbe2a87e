"""The last result of something expensive, for what asks for it again with the same things."""

from collections.abc import Callable
from typing import Any, TypeVar

__all__ = ["LastMade"]

_T = TypeVar("_T")


class LastMade:
    """Keeps one result, and what it was made of."""

    def __init__(self) -> None:
        self._of: tuple[object, ...] = ()
        self._made: Any = None

    def __call__(self, make: Callable[[], _T], *of: object) -> _T:
        """What was made of these very objects the last time, else made now."""
        if len(of) != len(self._of) or any(a is not b for a, b in zip(of, self._of, strict=True)):
            self._made, self._of = make(), of
        made: _T = self._made
        return made
