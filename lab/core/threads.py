"""Run a call on one thread of the linear algebra libraries."""

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from functools import lru_cache

from threadpoolctl import ThreadpoolController

__all__ = ["one_thread"]

_LIBRARIES = ("numpy", "scipy.linalg", "sklearn", "torch")  # modules that load a thread pool of their own


@contextmanager
def one_thread() -> Iterator[None]:
    """Limit linear algebra to one thread: small matrices gain nothing from more, and results stay the same to the bit.

    Looking for the loaded libraries takes a millisecond, so they are kept until another module that has one is loaded.
    """
    with _controller(tuple(name in sys.modules for name in _LIBRARIES)).limit(limits=1):
        yield


@lru_cache(maxsize=4)
def _controller(loaded: tuple[bool, ...]) -> ThreadpoolController:
    return ThreadpoolController()
