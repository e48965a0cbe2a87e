"""Document of reproduced values of a source."""

import re
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import groupby

from lab.core.errors import LabError, counted
from lab.extensions.reproduction.answer import ComparedValue, State
from lab.extensions.reproduction.item import Computed, Exercise, Item
from lab.extensions.reproduction.reproduction_result import KINDS, STATES, ReproductionResult, by_matrix, solution_of
from lab.extensions.reproduction.source_models import arm_sketch
from lab.report.document import (
    EVERYWHERE,
    PAGE,
    TERMINAL,
    Badge,
    Block,
    Bullets,
    Card,
    Code,
    CommandText,
    Document,
    Figure,
    Matrices,
    Matrix,
    Paragraph,
    Picture,
    Row,
    Section,
    Strong,
    Table,
    Text,
    Warnings,
    guarded,
)
from lab.report.view import View

__all__ = ["VIEW", "main_picture", "reproduction_document"]

VIEW = View(f"{__name__}:reproduction_document", f"{__name__}:main_picture")


def main_picture(result: ReproductionResult) -> Picture:
    """Return the first figure of the source.

    Raises:
        LabError: it has none.
    """
    for each in result.computed:
        for picture in each.item.pictures():
            return picture
    raise LabError(f"{result.source.name}: none of its figures can be drawn; report writes the page")


_BADGES: Mapping[State, Badge] = {
    "agrees": Badge("agrees", "good"),
    "erratum": Badge("erratum", "doubtful"),
    "unreadable": Badge("unreadable", "doubtful"),
    "differs": Badge("differs", "bad"),
    "given": Badge("given", "open"),
    "open": Badge("exercise", "open"),
}
_COMPARED: tuple[State, ...] = ("agrees", "erratum", "differs")
_CARD_KINDS: Mapping[State, str] = {"agrees": "after", "differs": "before"}  # of the large numbers
_WORST: tuple[State, ...] = ("differs", "erratum", "unreadable", "agrees", "given", "open")


def reproduction_document(result: ReproductionResult) -> Document:
    """Build the document of the result."""
    return Document(
        _title(result),
        (
            Paragraph(result.source.title, "lead"),
            _card(result),
            Warnings(result.warnings),
            Section("Items", _overview(result)),
            Section("Errata", _reasons(result, "erratum"), shown_in=TERMINAL),
            Section("Unreadable in the converted text", _reasons(result, "unreadable"), shown_in=TERMINAL),
            *_chapters(result),
            Section("Items that cannot be computed", () if result.options.item else (_missing(result),)),
        ),
    )


def _title(result: ReproductionResult) -> str:
    name = result.source.name
    printed = sum(result.count(state) for state in _COMPARED)
    others: tuple[State, ...] = ("erratum", "unreadable", "differs")
    more = [f"{result.count(state)} {STATES[state]}" for state in others if result.count(state)]
    if printed:
        return ", ".join([f"{name}: {result.count('agrees')} of {printed} numbers, formulas and words agree", *more])
    checks, whole = result.counts["check"], len(result.answers)
    if held := checks["agrees"]:
        count = sum(checks.values())
        words = "the lab's own check holds" if count == 1 else f"{held} of {count} own checks of the lab hold"
        return ", ".join([f"{name}: {words}", *more])
    return ", ".join([f"{name}: {counted(whole, 'value')}, none of them to compare", *more])


@guarded
def _card(result: ReproductionResult) -> Card:
    """Summarise on the page's first screen: how many agree, how many do not, and what to do next."""
    counts = {state: result.count(state) for state in _COMPARED}
    numbers = tuple(
        (STATES[state], str(count), _CARD_KINDS.get(state, "") if count else "") for state, count in counts.items()
    )
    next_step = "choose an item below: its command shows it in the lab, and an exercise is folded with its solution."
    badge = Badge("as printed" if not counts["erratum"] else "as printed but for errata", "good")
    if not sum(counts.values()):
        badge = Badge("nothing printed to compare")
    if result.wrong:
        badge, next_step = Badge("differs", "bad"), f"look at {result.wrong[0]}, which differs without a listed reason."
    about = f"Of {sum(counts.values())} printed numbers, formulas and words. An erratum is printed wrongly."
    return Card(badge, numbers, about, next_step)


@guarded
def _overview(result: ReproductionResult) -> tuple[Block, ...]:
    used = [state for state in STATES if any(result.counts[kind][state] for kind in KINDS)]
    kinds = tuple(
        (words, *_cells(result.counts[kind], used))
        for kind, words in KINDS.items()
        if any(result.counts[kind].values())
    )
    items: list[Row] = []
    for computed in result.computed:
        counts = Counter(answer.state for answer in computed.answers)
        items.append((computed.item.number, computed.item.title, *_cells(counts, used)))
    heads = tuple(STATES[state] for state in used)
    return (
        Table(("", *heads), kinds),
        Paragraph(
            "Every value under here is computed by the lab's models: of a formula, at the first of the random "
            "positions; the difference is the largest at all of them. The command of an item shows it in the lab: a "
            "formula by its numbers for an example, or with letters for the lengths.",
            "note",
        ),
        Table(("item", "", *heads), tuple(items)),
    )


def _cells(counts: Mapping[State, int], states: Sequence[State]) -> list[str]:
    """Return the counts of some states, empty for none."""
    return [str(counts[state] or "") for state in states]


@guarded
def _reasons(result: ReproductionResult, state: State) -> tuple[Block, ...]:
    """List the reasons of answers in a state, each once; not of chosen items, which show their own."""
    if result.options.item:
        return ()
    reasons: dict[str, None] = {}
    for each in result.computed:
        for answer in each.answers:
            if answer.state == state:
                reasons.setdefault(f"{each.item.number}: {answer.erratum or answer.conversion}")
    return (Bullets(tuple(reasons)),)


def _chapters(result: ReproductionResult) -> Iterator[Section]:
    """Show the items of each chapter in a section; chosen ones everywhere, else on the page alone."""
    shown_in = EVERYWHERE if result.options.item else PAGE
    for title, items in groupby(result.computed, key=lambda each: each.item.chapter):
        sections = tuple(replace(_section(each), shown_in=shown_in) for each in items)
        if title:
            yield Section(title, sections, shown_in=shown_in)
        else:
            yield from sections


@guarded
def _section(each: Computed) -> Section:
    item = each.item
    return Section(
        f"{item.number}: {item.title}",
        (
            Paragraph(item.note),
            *_values_of(each.answers),
            *_figure(item, item.pictures()),
            CommandText(item.command),
            *([_exercise(item.exercise, each)] if item.exercise else ()),
        ),
    )


@guarded
def _exercise(exercise: Exercise, each: Computed) -> Section:
    """Return the folded question of an item, with what is given, the way to the solution, and what the lab computes."""
    return Section(
        "Exercise with its solution",
        (
            Paragraph((Strong(exercise.question),)),
            Bullets(exercise.given),
            *([Table(exercise.table[0], exercise.table[1:])] if exercise.table else ()),
            *_sketch(exercise, each.item),
            Table(("", "way to the solution"), tuple((f"{i}.", step) for i, step in enumerate(exercise.steps, 1))),
            *solution_of(each.answers),
        ),
        folded=True,
        shown_in=PAGE,
    )


def _values_of(answers: tuple[ComparedValue, ...]) -> Iterator[Block]:
    """Show matrices as such, rows of a table in a table of as many columns, and all other values one by one."""
    placed = by_matrix(answers)
    yield Matrices(tuple(_matrix(name, rows) for name, rows in placed.items() if len(rows) > 1))
    yield from _row_tables([rows[0] for rows in placed.values() if len(rows) == 1])
    wrong = [answer for answer in answers if answer.place is not None and answer.state in _WORST[:3]]
    yield Bullets(tuple(_marked_entries(wrong)))
    yield _list([answer for answer in answers if answer.place is None])


def _row_tables(rows: Sequence[Sequence[ComparedValue]]) -> Iterator[Table]:
    """Show rows of each length in a table."""
    for width in dict.fromkeys(map(len, rows)):
        yield _row_table([row for row in rows if len(row) == width], width)


def _matrix(name: str, rows: Sequence[Sequence[ComparedValue]]) -> Matrix:
    """Return a matrix as printed, or as the reader should find it, beside the lab's values, with its worst state."""
    state = min((answer.state for row in rows for answer in row), key=_WORST.index)
    printed, ours = (tuple(tuple(map(part, row)) for row in rows) for part in (_entry, _ours))
    return Matrix(name, (("solution" if state == "open" else "printed", printed), ("here", ours)), _BADGES[state])


def _ours(answer: ComparedValue) -> Text:
    """Return the lab's value of an entry."""
    return answer.ours


def _row_table(rows: Sequence[Sequence[ComparedValue]], width: int) -> Table:
    """Show rows of a table that are compared entry by entry, beside the lab's values."""
    lines: list[Row] = []
    for row in rows:
        state = min((answer.state for answer in row), key=_WORST.index)
        name = row[0].place[0] if row[0].place else ""
        lines.append((name, *map(_entry, row), "", *(answer.ours for answer in row), _BADGES[state]))
    blank = ("",) * (width - 1)
    return Table(("", "printed", *blank, "", "here", *blank, ""), tuple(lines))


def _entry(answer: ComparedValue) -> Text:
    """Return an entry of a printed matrix, in bold where it is not right or cannot be read."""
    if answer.state == "open":
        return answer.right
    shown = (answer.printed or answer.right).replace("-", "−")
    return Strong(shown) if answer.state in _WORST[:3] else shown


def _marked_entries(entries: Sequence[ComparedValue]) -> Iterator[str]:
    """Describe the entries that are not right, or cannot be read, those with one reason together."""
    for answer in entries:
        if answer.state == "differs":
            other = answer.printed or answer.right
            yield f"{answer.name} is {answer.ours} here and {other} in the source, a difference of {answer.difference}"
    rest = [answer for answer in entries if answer.state != "differs"]
    by_reason: dict[str, list[ComparedValue]] = {}
    for answer in rest:
        by_reason.setdefault(answer.erratum or answer.conversion, []).append(answer)
    for reason, alike in by_reason.items():
        yield _reason_text(alike, reason)


def _reason_text(alike: Sequence[ComparedValue], reason: str) -> str:
    """Name the entries that have one reason not to be right."""
    first, last = alike[0], alike[-1]
    if first.conversion:
        return f"{reason}: {first.name} to {last.name} are as they follow from the model"
    if len(alike) > 1 and len({answer.right for answer in alike}) == 1:
        return f"{first.name} to {last.name}, right is {first.right}: {reason}"
    return "; ".join(f"{answer.name}, right is {answer.right}" for answer in alike) + f": {reason}"


def _list(answers: Sequence[ComparedValue]) -> Table:
    """Show values one by one, without the columns that none of them needs."""
    heads = ("", "printed", "solution", "here", "unit", "difference", "", "")
    rows: list[Row] = [
        (answer.name, answer.printed.replace("-", "−"), answer.right.replace("-", "−"), answer.ours, answer.unit,
         answer.difference, _BADGES[answer.state], answer.erratum or answer.conversion)
        for answer in answers
    ]  # fmt: skip
    used = [i for i in range(len(heads)) if any(row[i] for row in rows)]
    return Table(tuple(heads[i] for i in used), tuple(tuple(row[i] for i in used) for row in rows))


@guarded
def _figure(item: Item, pictures: Iterable[Picture]) -> tuple[Block, ...]:
    """Draw an item's pictures, with unique names that begin with the item's."""
    slug = _slug(item)
    named = tuple(replace(picture, name=f"{slug}-{picture.name}") for picture in pictures)
    return (Figure(slug, named, item.title),)


@guarded
def _sketch(exercise: Exercise, item: Item) -> tuple[Block, ...]:
    """Draw the arm of an exercise."""
    if not exercise.sketch[0]:
        return ()
    slug = f"{_slug(item)}-sketch"
    named = tuple(replace(picture, name=f"{slug}-{picture.name}") for picture in arm_sketch(*exercise.sketch))
    return (Figure(slug, named, "The arm with its frames: x red, y green, z blue"),)


def _slug(item: Item) -> str:
    return re.sub(r"[^a-z0-9]+", "-", item.number.lower()).strip("-")


def _missing(result: ReproductionResult) -> Table:
    rows = tuple((Code(each.number), each.title, each.reason) for each in result.source.missing)
    return Table(("item", "", "reason"), rows)
