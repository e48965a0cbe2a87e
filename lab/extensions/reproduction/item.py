"""Numbered items of a source, the registered sources, and exercises with their marks."""

import csv
import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from lab.core.errors import LabError
from lab.extension_points import choice_of, load, registered
from lab.extensions.reproduction.answer import Answer
from lab.formats.csv_table import CsvTable, text_cell

_COLUMNS = ("item", "value", "unit")  # of an exercise
_GROUP = "lab.sources"  # of entry points

if TYPE_CHECKING:
    from lab.render.document import Picture

    SourceName = str
else:
    SourceName = choice_of(_GROUP)

__all__ = [
    "Computed",
    "Item",
    "Mark",
    "Missing",
    "Source",
    "SourceName",
    "in_chapter",
    "labels",
    "marked",
    "source_named",
    "sources",
    "write_exercise",
]


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
        question: of an exercise; "" where the title says it.
        hint: to the question.
    """

    number: str
    title: str
    answers: Callable[[], tuple[Answer, ...]] = tuple
    command: str = ""
    note: str = ""
    pictures: "Callable[[], tuple[Picture, ...]]" = tuple
    chapter: str = ""
    question: str = ""
    hint: str = ""


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
    answers: tuple[Answer, ...]


@dataclass(frozen=True)
class Mark:
    """A reader's answer with its mark.

    Attributes:
        label: of the answer in the file.
        given: the text there; "" where it is left blank.
        state: result of the marking.
        note: reason why it cannot be read; "" where it can.
        answer: the answer of the item.
    """

    label: str
    given: str
    state: Literal["right", "wrong", "blank"]
    note: str
    answer: Answer


def write_exercise(path: Path, computed: Sequence[Computed]) -> None:
    """Write the answers of an exercise, each with a blank."""
    with path.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(_COLUMNS)
        writer.writerows((text_cell(label), "", answer.unit) for label, answer in _in_exercise(computed))


def marked(path: Path, computed: Sequence[Computed]) -> tuple[Mark, ...]:
    """Mark a filled-in exercise, answer by answer; answers that are not in the file are blank.

    Raises:
        LabError: the file is no exercise of this source.
    """
    table = CsvTable(path)
    labels, values = table.texts("item"), table.texts("value")
    if labels is None or values is None:
        raise LabError(f"{path}: has no columns item and value; fill in the CSV that --exercise writes")
    requested = dict(_in_exercise(computed))
    given: dict[str, str] = {}
    for row, (cell, value) in enumerate(zip(labels, values, strict=True)):
        label = " ".join(cell.split())
        if label not in requested:
            raise table.fail(row, "item", f"'{label}' is no answer of this source; keep the labels of --exercise")
        if label in given:
            raise table.fail(row, "item", f"'{label}' appears twice; keep one")
        given[label] = value.strip()
    return tuple(_mark(label, given.get(label, ""), answer) for label, answer in requested.items())


def _mark(label: str, text: str, answer: Answer) -> Mark:
    if not text:
        return Mark(label, text, "blank", "", answer)
    try:
        return Mark(label, text, "right" if answer.check(text) else "wrong", "", answer)
    except LabError as error:
        return Mark(label, text, "wrong", str(error), answer)


def _in_exercise(computed: Sequence[Computed]) -> Iterator[tuple[str, Answer]]:
    for each in computed:
        for answer in each.answers:
            if answer.in_exercise:
                yield f"{each.item.number}: {answer.name}", answer
