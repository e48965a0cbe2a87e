"""Results of something expensive, for what asks for them again with the same things."""

from collections.abc import Callable, Hashable
from typing import Any, Generic, TypeVar

__all__ = ["EachMade", "LastMade"]

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


class EachMade(Generic[_T]):
    """Keeps all results, by what they were made of; what could not be made is tried again."""

    def __init__(self) -> None:
        self._made: dict[Hashable, _T] = {}

    def __call__(self, make: Callable[[], _T], of: Hashable) -> _T:
        """What was made of something equal before, else made now."""
        if of not in self._made:
            self._made[of] = make()
        return self._made[of]
