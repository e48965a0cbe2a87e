"""Run ``lab reproduce``: compute a source's items again, and show them beside the printed ones."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from lab.commands.command_line import options_of, takes
from lab.commands.result import Result
from lab.core.errors import LabError
from lab.extensions.reproduction.answer import Answer
from lab.extensions.reproduction.item import Computed, Item, Mark, Source, marked, source_named, write_exercise
from lab.extensions.reproduction.options import ReproduceOptions
from lab.formats.csv_table import write_columns
from lab.render.document import (
    PAGE,
    TERMINAL,
    Badge,
    Block,
    Bullets,
    Code,
    Command,
    Document,
    Figure,
    Paragraph,
    Picture,
    Row,
    Section,
    Table,
    Warnings,
)

__all__ = ["ReproductionResult", "reproduce"]


@dataclass(frozen=True, repr=False, eq=False)
class ReproductionResult(Result):
    """Items of a source, as printed and as computed here.

    Attributes:
        options: of the command.
        source: the text.
        computed: its items, in order.
        marks: of a filled-in exercise; None where none is marked.
    """

    command = "reproduce"
    shown_by = "lab.extensions.reproduction.result:_reproduction_document"
    drawn_by = "lab.extensions.reproduction.result:_main_picture"

    options: ReproduceOptions
    source: Source
    computed: tuple[Computed, ...]
    marks: tuple[Mark, ...] | None

    @property
    def answers(self) -> tuple[Answer, ...]:
        """Answers of all items."""
        return tuple(answer for each in self.computed for answer in each.answers)

    @property
    def wrong(self) -> tuple[str, ...]:
        """Printed values that differ without a known erratum, or errata that agree."""
        return tuple(
            f"{each.item.number}: {answer.name}"
            for each in self.computed
            for answer in each.answers
            if (answer.agrees is False) != bool(answer.erratum)
        )

    @property
    def warnings(self) -> tuple[str, ...]:
        """Values that differ without a known reason."""
        return tuple(f"{name} differs from what is printed, and is no known erratum" for name in self.wrong)

    @property
    def exit_code(self) -> int:
        """1 where a value differs without a known reason, or an answer of an exercise is wrong or blank; else 0."""
        if self.marks is not None:
            return 0 if all(mark.state == "right" for mark in self.marks) else 1
        return 1 if self.wrong else 0

    def to_dict(self) -> dict[str, Any]:
        """Return the output of ``--json``: each item with its answers, those of an exercise without ours."""
        counts = {"answers": len(self.answers), "agree": sum(answer.agrees is True for answer in self.answers),
                  "errata": sum(bool(answer.erratum) for answer in self.answers)}  # fmt: skip
        found: dict[str, Any] = {
            "source": self.source.name,
            "title": self.source.title,
            **counts,
            "items": [
                {
                    "item": each.item.number, "title": each.item.title, "command": each.item.command,
                    "note": each.item.note, "answers": [self._values(answer) for answer in each.answers],
                }
                for each in self.computed
            ],
            "missing": [
                {"item": each.number, "title": each.title, "reason": each.reason} for each in self.source.missing
            ],
            "warnings": list(self.warnings),
        }  # fmt: skip
        if self.marks is not None:
            found["marks"] = [
                {"item": mark.label, "given": mark.given, "state": mark.state, "note": mark.note} for mark in self.marks
            ]
        return found

    def _values(self, answer: Answer) -> dict[str, Any]:
        requested = {"name": answer.name, "unit": answer.unit}
        if self.options.exercise:
            return requested
        return requested | {
            "printed": answer.printed, "ours": answer.ours, "difference": answer.difference, "agrees": answer.agrees,
            "erratum": answer.erratum,
        }  # fmt: skip

    def write_files(self, folder: Path) -> None:
        """Write ``values.csv``, or of an exercise its CSV."""
        if self.options.exercise:
            write_exercise(folder / "exercise.csv", self.computed)
        else:
            write_columns(folder / "values.csv", self.columns())

    def columns(self) -> Mapping[str, Sequence[Any]]:
        """Return a row for each answer."""
        pairs = [(each.item, answer) for each in self.computed for answer in each.answers]
        blank = self.options.exercise
        return {
            "item": [f"{item.number}: {answer.name}" for item, answer in pairs],
            "printed": ["" if blank else answer.printed for _, answer in pairs],
            "ours": ["" if blank else answer.ours for _, answer in pairs],
            "unit": [answer.unit for _, answer in pairs],
            "erratum": ["" if blank else answer.erratum for _, answer in pairs],
        }


def _main_picture(result: ReproductionResult) -> Picture:
    """Return the first figure of the source.

    Raises:
        LabError: it has none.
    """
    for each in result.computed:
        for picture in each.item.pictures():
            return picture
    raise LabError(f"{result.source.name}: none of its figures can be drawn; report writes the page")


def _reproduction_document(result: ReproductionResult) -> Document:
    source = result.source
    return Document(
        _title(result),
        (
            Paragraph(source.title, "lead"),
            Warnings(() if result.options.exercise else result.warnings),
            Section("Marks", _marks(result.marks or ())),
            Section("Items", (_overview(result),) if result.marks is None else ()),
            Section("Errata", _errata(result), shown_in=TERMINAL),
            *(_section(result, each) for each in result.computed if result.marks is None),
            Section("Items that cannot be computed", (_missing(result),) if result.marks is None else ()),
        ),
    )


def _title(result: ReproductionResult) -> str:
    name = result.source.name
    if result.marks is not None:
        right = sum(mark.state == "right" for mark in result.marks)
        blank = sum(mark.state == "blank" for mark in result.marks)
        return f"{name}: {right} of {len(result.marks)} answers right, {blank} blank"
    if result.options.exercise:
        count = sum(answer.in_exercise for answer in result.answers)
        return f"{name}: an exercise of {count} answers"
    printed = [answer for answer in result.answers if answer.agrees is not None]
    agree, errata = sum(answer.agrees is True for answer in printed), sum(bool(answer.erratum) for answer in printed)
    return f"{name}: {agree} of {len(printed)} printed values agree, {errata} are errata"


def _overview(result: ReproductionResult) -> Table:
    rows: list[Row] = []
    for each in result.computed:
        printed = [answer.agrees for answer in each.answers if answer.agrees is not None]
        errata = sum(bool(answer.erratum) for answer in each.answers)
        counts = (len(each.answers), len(printed), sum(printed), errata)
        shown = counts[:1] if result.options.exercise else counts
        rows.append((each.item.number, each.item.title, *map(str, shown)))
    heads = ("values",) if result.options.exercise else ("values", "printed", "agree", "errata")
    return Table(("item", "", *heads), tuple(rows))


def _errata(result: ReproductionResult) -> tuple[Block, ...]:
    if result.options.exercise or result.marks is not None:
        return ()
    errata: dict[str, None] = {}
    for each in result.computed:
        for answer in each.answers:
            if answer.erratum:
                errata.setdefault(f"{each.item.number}: {answer.erratum}")
    return (Bullets(tuple(errata)),)


def _section(result: ReproductionResult, each: Computed) -> Section:
    item, exercise = each.item, result.options.exercise
    return Section(
        f"{item.number}: {item.title}",
        (
            Paragraph(item.note),
            _questions(each.answers) if exercise else _values(each.answers),
            *(() if exercise else _figure(item)),
            Command(item.command),
        ),
        shown_in=PAGE,
    )


def _values(answers: tuple[Answer, ...]) -> Table:
    rows: list[Row] = []
    for answer in answers:
        badge = Badge("erratum", "doubtful") if answer.erratum else Badge("agrees", "good")
        state: Badge | str = badge if answer.agrees is not None else ""
        if answer.agrees is False and not answer.erratum:
            state = Badge("differs", "bad")
        printed = answer.printed.replace("-", "−")
        rows.append((answer.name, printed, answer.ours, answer.unit, answer.difference, state, answer.erratum))
    heads = ("", "printed", "here", "unit", "difference", "", "")
    return Table(heads, tuple(rows))


def _questions(answers: tuple[Answer, ...]) -> Table:
    return Table(("asked", "answer", "unit"), tuple((a.name, "", a.unit) for a in answers if a.in_exercise))


def _figure(item: Item) -> tuple[Block, ...]:
    """Draw an item's pictures, with unique names that begin with the item's."""
    slug = re.sub(r"[^a-z0-9]+", "-", item.number.lower()).strip("-")
    pictures = tuple(replace(picture, name=f"{slug}-{picture.name}") for picture in item.pictures())
    return (Figure(slug, pictures, item.title),)


def _marks(marks: tuple[Mark, ...]) -> tuple[Block, ...]:
    """List every answer given, and the correct one."""
    if not marks:
        return ()
    badges = {"right": Badge("right", "good"), "wrong": Badge("wrong", "bad"), "blank": Badge("blank", "open")}
    rows = tuple(
        (mark.label, mark.given, badges[mark.state], mark.answer.ours if mark.state == "wrong" else "",
         mark.answer.unit, mark.note)
        for mark in marks
    )  # fmt: skip
    return (Table(("answer", "given", "", "right is", "unit", ""), rows),)


def _missing(result: ReproductionResult) -> Table:
    rows = tuple((Code(each.number), each.title, each.reason) for each in result.source.missing)
    return Table(("item", "", "reason"), rows)


@takes(ReproduceOptions)
def reproduce(source: str | ReproduceOptions, **options: Any) -> ReproductionResult:
    """Compute the tables, figures and worked examples of a source, and compare them with the printed ones.

    Args:
        source: ``thesis``, ``elastic``, ``course`` or ``staubli``; or all options in one object.
        options: those of ``lab reproduce``, by name: ``exercise``, ``mark``.

    Returns:
        Every item with its printed and its computed values, and whether they agree.

    Raises:
        LabError: there is no such source, or the file to be marked is no exercise of it.

    Example:
        >>> import lab
        >>> lab.reproduce("elastic").exit_code
        0
    """
    requested = source
    if not isinstance(requested, ReproduceOptions):
        requested = options_of("lab.reproduce", ReproduceOptions, {"source": source, **options})
    requested.check()
    chosen = source_named(requested.source)
    computed = tuple(Computed(item, item.answers()) for item in chosen.items)
    marks = None if requested.mark is None else marked(requested.mark, computed)
    return ReproductionResult(requested, chosen, computed, marks)
