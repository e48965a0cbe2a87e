"""Sections that extensions add to the documents of results."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any, Generic, TypeVar

from lab.extension_points import load_all
from lab.render.document import Block, Section, guarded

__all__ = ["AddedSection", "added_sections"]

R = TypeVar("R")
_GROUP = "lab.sections"  # of entry points


@dataclass(frozen=True)
class AddedSection(Generic[R]):
    """A section that an extension adds to the document of a type of result, after the sections of its own.

    Attributes:
        of: the type, e.g. ``lab.CalibrationResult``.
        section: makes it of a result; one without blocks is left out.
    """

    of: type[R]
    section: Callable[[R], Section]


def added_sections(result: Any) -> Iterator[Block]:
    """Make the sections that installed packages add to the document of a result, in the order of their names."""
    for name, each in load_all(_GROUP).items():
        if isinstance(result, each.of):
            yield from guarded(f"the section of the extension '{name}'", lambda each=each: each.section(result))
