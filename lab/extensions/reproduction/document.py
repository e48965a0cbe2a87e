"""What a person reads of a source that was computed again."""

import re
from dataclasses import replace

from lab.commands.provenance import provenance_section
from lab.extensions.reproduction.answer import Answer
from lab.extensions.reproduction.item import Item
from lab.extensions.reproduction.marking import Computed, Mark
from lab.extensions.reproduction.result import ReproductionResult
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
    Row,
    Section,
    Table,
    Warnings,
)

__all__ = ["reproduction_document"]


def reproduction_document(result: ReproductionResult) -> Document:
    """An overview of the items, each item on the page, what cannot be computed, or an exercise or its marks."""
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
            Section("What cannot be computed", (_missing(result),) if result.marks is None else ()),
            provenance_section("reproduce", result.options, ""),
        ),
    )


def _title(result: ReproductionResult) -> str:
    name = result.source.name
    if result.marks is not None:
        right = sum(mark.state == "right" for mark in result.marks)
        blank = sum(mark.state == "blank" for mark in result.marks)
        return f"{name}: {right} of {len(result.marks)} answers right, {blank} blank"
    if result.options.exercise:
        count = sum(answer.asked for answer in result.answers)
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
        told = counts[:1] if result.options.exercise else counts
        rows.append((each.item.number, each.item.title, *map(str, told)))
    heads = ("values",) if result.options.exercise else ("values", "printed", "agree", "errata")
    return Table(("item", "", *heads), tuple(rows))


def _errata(result: ReproductionResult) -> tuple[Block, ...]:
    """The reasons, each once."""
    if result.options.exercise or result.marks is not None:
        return ()
    said: dict[str, None] = {}
    for each in result.computed:
        for answer in each.answers:
            if answer.erratum:
                said.setdefault(f"{each.item.number}: {answer.erratum}")
    return (Bullets(tuple(said)),)


def _section(result: ReproductionResult, each: Computed) -> Section:
    """An item on the page: its values, its pictures, its command."""
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
        rows.append(
            (
                answer.name,
                answer.printed.replace("-", "−"),
                answer.ours,
                answer.unit,
                answer.difference,
                state,
                answer.erratum,
            )
        )
    heads = ("", "printed", "here", "unit", "difference", "", "")
    return Table(heads, tuple(rows))


def _questions(answers: tuple[Answer, ...]) -> Table:
    return Table(("asked", "answer", "unit"), tuple((a.name, "", a.unit) for a in answers if a.asked))


def _figure(item: Item) -> tuple[Block, ...]:
    """Its pictures, whose names begin with the item's, so that they are unique."""
    slug = re.sub(r"[^a-z0-9]+", "-", item.number.lower()).strip("-")
    pictures = tuple(replace(picture, name=f"{slug}-{picture.name}") for picture in item.pictures())
    return (Figure(slug, pictures, item.title),)


def _marks(marks: tuple[Mark, ...]) -> tuple[Block, ...]:
    """Every answer that was given, and what it should have been."""
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
