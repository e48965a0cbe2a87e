"""A numbered item of a source, and a source: what is computed again, by which command, and what cannot be."""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from lab.extensions.reproduction.answer import Answer

if TYPE_CHECKING:
    from lab.render.document import Picture

__all__ = ["Item", "Missing", "Source"]


def _none() -> tuple[Answer, ...]:
    return ()


def _no_pictures() -> "tuple[Picture, ...]":
    return ()


@dataclass(frozen=True)
class Item:
    """A table, a figure, an equation or an example.

    Attributes:
        number: as the source numbers it, e.g. "Table III.3"; unique in the source.
        title: what it shows.
        answers: computes its values; none of a figure without numbers.
        command: the command that shows them, or "" with a note that says why there is none.
        note: what is to be known of it, a sentence or two.
        pictures: of a figure, drawn again.
    """

    number: str
    title: str
    answers: Callable[[], tuple[Answer, ...]] = _none
    command: str = ""
    note: str = ""
    pictures: "Callable[[], tuple[Picture, ...]]" = field(default=_no_pictures)


@dataclass(frozen=True)
class Missing:
    """Numbered items that cannot be computed, and why."""

    number: str
    title: str
    reason: str


@dataclass(frozen=True)
class Source:
    """A text whose items are computed again.

    Attributes:
        name: what is typed.
        title: author, year and title.
        items: in the order of the text.
        missing: what cannot be computed, in the order of the text.
    """

    name: str
    title: str
    items: tuple[Item, ...]
    missing: tuple[Missing, ...]
