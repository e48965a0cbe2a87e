"""A numbered item of a source, and a source: what is computed again, by which command, and what cannot be."""

import csv
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from lab.core.errors import LabError
from lab.extensions.reproduction.answer import Answer
from lab.formats.csv_table import CsvTable, text_cell

if TYPE_CHECKING:
    from lab.render.document import Picture

__all__ = ["Computed", "Item", "Mark", "Missing", "Source", "marked", "write_exercise"]


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


COLUMNS = ("item", "value", "unit")


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
        note: why it cannot be read; "" where it can.
        answer: the answer of the item.
    """

    label: str
    given: str
    state: Literal["right", "wrong", "blank"]
    note: str
    answer: Answer


def write_exercise(path: Path, computed: Sequence[Computed]) -> None:
    """Write the answers that an exercise asks for, each with a blank."""
    with path.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(COLUMNS)
        writer.writerows((text_cell(label), "", answer.unit) for label, answer in _in_exercise(computed))


def marked(path: Path, computed: Sequence[Computed]) -> tuple[Mark, ...]:
    """A filled-in exercise, answer by answer; answers that are not in the file are blank.

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
