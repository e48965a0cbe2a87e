"""Which sources there are; nothing of one is imported before it is asked for."""

from importlib import import_module
from typing import Literal, get_args

from lab.reproduction.item import Source

__all__ = ["SOURCES", "SourceName", "source_named"]

SourceName = Literal["thesis", "elastic", "course", "staubli"]
SOURCES: tuple[SourceName, ...] = get_args(SourceName)


def source_named(name: SourceName) -> Source:
    """A source with its items; nothing of them is computed yet."""
    source: Source = getattr(import_module(f"lab.reproduction.{name}.source"), name.upper())
    return source
