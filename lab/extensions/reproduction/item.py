"""Numbered items of a source with the texts of their exercises, and the registered sources."""

import re
import tomllib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from lab.core.errors import LabError
from lab.extension_points import choice_of, load, registered
from lab.extensions.reproduction.answer import ComparedValue

_GROUP = "lab.sources"  # of entry points

if TYPE_CHECKING:
    from lab.report.document import Picture

    SourceName = str
else:
    SourceName = choice_of(_GROUP)

__all__ = [
    "Computed",
    "Exercise",
    "Item",
    "Missing",
    "Source",
    "SourceName",
    "in_chapter",
    "labels",
    "source_named",
    "sources",
    "with_exercises",
]


@dataclass(frozen=True)
class Exercise:
    """Text that makes an item a question without the book.

    Attributes:
        question: what is sought, with what is given, in sentences.
        steps: way to the solution, in order.
        given: letters and values, an entry each.
        table: rows of a table that is given; the first has the headings.
        sketch: robot that is drawn, and its joint positions in ° and mm; "" where none is.
    """

    question: str
    steps: tuple[str, ...]
    given: tuple[str, ...] = ()
    table: tuple[tuple[str, ...], ...] = ()
    sketch: tuple[str, tuple[float, ...]] = ("", ())


@dataclass(frozen=True)
class Item:
    """A table, a figure, an equation or an example.

    Attributes:
        number: as the source numbers it, e.g. "Table III.3"; unique in the source.
        title: its subject.
        answers: computes its values; none of a figure without numbers.
        command: the command that shows them, or "" with a note on the reason.
        note: a sentence or two for the reader.
        pictures: draws a figure again.
        chapter: title of the chapter; consecutive items of one chapter are shown together.
        exercise: its text as an exercise; None if it asks nothing.
    """

    number: str
    title: str
    answers: Callable[[], tuple[ComparedValue, ...]] = tuple
    command: str = ""
    note: str = ""
    pictures: "Callable[[], tuple[Picture, ...]]" = tuple
    chapter: str = ""
    exercise: Exercise | None = None


def with_exercises(items: Sequence[Item], name: str) -> tuple[Item, ...]:
    """Return the items with the texts of their exercises, which are in ``exercises/NAME.toml``."""
    path = Path(__file__).parent / "exercises" / f"{name}.toml"
    rows = tomllib.loads(path.read_text(encoding="utf-8"))["exercise"]
    texts = {row.pop("item"): _exercise(row) for row in rows}
    if unknown := texts.keys() - {item.number for item in items}:
        raise LabError(f"{path}: '{sorted(unknown)[0]}' is no item of the source")
    return tuple(replace(item, exercise=texts.get(item.number)) for item in items)


def _exercise(row: Mapping[str, Any]) -> Exercise:
    """Return the exercise of a row; a line break within a text is a space."""

    def lines(name: str) -> tuple[str, ...]:
        return tuple(" ".join(text.split()) for text in row.get(name, ()))

    sketch = row.get("sketch", {"robot": "", "joints": ()})
    return Exercise(
        " ".join(row["question"].split()), lines("steps"), lines("given"),
        tuple(tuple(cells) for cells in row.get("table", ())), (sketch["robot"], tuple(sketch["joints"])),
    )  # fmt: skip


def in_chapter(title: str, items: Sequence[Item]) -> tuple[Item, ...]:
    """Return the items as those of a chapter."""
    return tuple(replace(item, chapter=title) for item in items)


@dataclass(frozen=True)
class Missing:
    """Numbered items that cannot be computed, with the reason."""

    number: str
    title: str
    reason: str


@dataclass(frozen=True)
class Source:
    """A text with items to compute again.

    Attributes:
        name: on the command line.
        title: author, year and title.
        items: in the order of the text.
        missing: items that cannot be computed, in the order of the text.
    """

    name: str
    title: str
    items: tuple[Item, ...]
    missing: tuple[Missing, ...]

    def chosen(self, text: str) -> tuple[Item, ...]:
        """Return the items of a number (``8.6``, ``III.24``, ``Table IV.2``) or a chapter (``8``, ``III``).

        Raises:
            LabError: there are none.
        """
        wanted = text.strip()
        found = tuple(
            item
            for item in self.items
            if wanted.casefold() == item.number.casefold()
            or any(label == wanted or label.startswith(f"{wanted}.") for label in labels(item.number))
        )
        if not found:
            first = labels(self.items[0].number)
            such = f"{first[0]} or {first[0].partition('.')[0]}" if first else self.items[0].number
            raise LabError(f"--item: {self.name} has no item '{text}'; give a number or a chapter, such as {such}")
        return found


_LABEL = re.compile(r"[A-Z]?\d+(?:\.\d+)*|[IVX]+(?:\.\d+)+|\bto\b")


def labels(number: str) -> tuple[str, ...]:
    """Return the single numbers that an item's number has, e.g. of "Equations III.6 to III.8, III.10".

    >>> labels("Equations III.6 to III.8, III.10")
    ('III.6', 'III.7', 'III.8', 'III.10')
    """
    found: list[str] = []
    through = False
    for each in _LABEL.findall(number):
        if each == "to":
            through = bool(found)
            continue
        stem, _, last = each.rpartition(".")
        if through and found[-1].rpartition(".")[0] == stem:
            low = int(re.sub(r"\D", "", found[-1].rpartition(".")[2]))
            found += [f"{stem}.{i}" if stem else str(i) for i in range(low + 1, int(re.sub(r"\D", "", last)) + 1)]
        else:
            found.append(each)
        through = False
    return tuple(found)


def sources() -> tuple[str, ...]:
    """Return the names of the sources."""
    return registered(_GROUP)


def source_named(name: str) -> Source:
    """Import a source; its items are computed later.

    Raises:
        LabError: none has this name, or its package cannot be imported.
    """
    source: Source = load(_GROUP, name)
    return source


@dataclass(frozen=True)
class Computed:
    """An item with its answers."""

    item: Item
    answers: tuple[ComparedValue, ...]
