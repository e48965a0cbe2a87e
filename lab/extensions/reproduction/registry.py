"""Find the sources that are registered as ``lab.sources``; nothing of one is imported before it is used."""

from typing import TYPE_CHECKING

from lab.extension_points import choice_of, load, registered
from lab.extensions.reproduction.item import Source

__all__ = ["SourceName", "source_named", "sources"]

_GROUP = "lab.sources"  # of entry points

if TYPE_CHECKING:
    SourceName = str
else:
    SourceName = choice_of(_GROUP)


def sources() -> tuple[str, ...]:
    """Return the names of the sources."""
    return registered(_GROUP)


def source_named(name: str) -> Source:
    """Return a source with its items; nothing of them is computed yet.

    Raises:
        LabError: none is called so, or its package cannot be imported.
    """
    source: Source = load(_GROUP, name)
    return source
