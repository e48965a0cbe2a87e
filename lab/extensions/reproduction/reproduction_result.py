"""Run ``lab reproduce``: compute a source's items again, and show them beside the printed ones."""

import re
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import groupby
from pathlib import Path
from typing import Any

from lab.core.errors import LabError, counted
from lab.extensions.reproduction.answer import Answer, Kind, State
from lab.extensions.reproduction.item import Computed, Exercise, Item, Source, source_named
from lab.extensions.reproduction.reproduction_options import ReproduceOptions
from lab.extensions.reproduction.source_models import arm_sketch
from lab.formats.csv_table import write_columns
from lab.library.result import Result
from lab.options.call_options import options_of, takes
from lab.report.document import (
    EVERYWHERE,
    PAGE,
    TERMINAL,
    Badge,
    Block,
    Bullets,
    Card,
    Code,
    Command,
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

__all__ = ["ReproductionResult", "reproduce", "solution_of"]


@dataclass(frozen=True, repr=False, eq=False)
class ReproductionResult(Result):
    """Items of a source, as printed and as computed here.

    Attributes:
        options: of the command.
        source: the text.
        computed: its items, in order.
    """

    command = "reproduce"
    shown_by = "lab.extensions.reproduction.reproduction_result:_reproduction_document"
    drawn_by = "lab.extensions.reproduction.reproduction_result:_main_picture"

    options: ReproduceOptions
    source: Source
    computed: tuple[Computed, ...]

    @property
    def answers(self) -> tuple[Answer, ...]:
        """Answers of all items."""
        return tuple(answer for each in self.computed for answer in each.answers)

    @property
    def wrong(self) -> tuple[str, ...]:
        """Values that differ without a listed erratum, and listed errata that agree."""
        return tuple(
            f"{each.item.number}: {answer.name}"
            for each in self.computed
            for answer in each.answers
            if answer.state == "differs"
        )

    @property
    def counts(self) -> dict[Kind, dict[State, int]]:
        """Number of answers of each kind in each state: numbers, formulas, words, bare 0 and ±1, own checks."""
        found = Counter((answer.kind, answer.state) for answer in self.answers)
        return {kind: {state: found[kind, state] for state in _STATES} for kind in _KINDS}

    def count(self, state: State) -> int:
        """Return the number of numbers, formulas and words in a state; bare 0 and ±1 and own checks do not count."""
        return sum(self.counts[kind][state] for kind in _COUNTED)

    @property
    def warnings(self) -> tuple[str, ...]:
        """Values that differ without a listed reason."""
        return tuple(f"{name} differs from the lab's model, and is no listed erratum" for name in self.wrong)

    @property
    def exit_code(self) -> int:
        """1 where a value differs without a listed reason; else 0."""
        return 1 if self.wrong else 0

    def to_dict(self) -> dict[str, Any]:
        """Return the output of ``--json``: each item with its answers."""
        states = {"agree": "agrees", "errata": "erratum", "unreadable": "unreadable", "differ": "differs"}
        return {
            "source": self.source.name,
            "title": self.source.title,
            "answers": len(self.answers),
            **{name: sum(answer.state == state for answer in self.answers) for name, state in states.items()},
            "agree": self.count("agrees"),
            "counts": self.counts,
            "items": [
                {
                    "item": each.item.number, "title": each.item.title, "command": each.item.command,
                    "note": each.item.note, "answers": [_values(answer) for answer in each.answers],
                }
                for each in self.computed
            ],
            "missing": [
                {"item": each.number, "title": each.title, "reason": each.reason} for each in self.source.missing
            ],
            "warnings": list(self.warnings),
        }  # fmt: skip

    def write_files(self, folder: Path) -> None:
        """Write ``values.csv``."""
        write_columns(folder / "values.csv", self.columns())

    def columns(self) -> Mapping[str, Sequence[Any]]:
        """Return a row for each answer."""
        pairs = [(each.item, answer) for each in self.computed for answer in each.answers]
        values = [_values(answer) for _, answer in pairs]
        names = ("printed", "ours", "unit", "erratum", "unreadable", "kind", "state", "solution")
        return {
            "item": [f"{item.number}: {answer.name}" for item, answer in pairs],
            **{name: [row[name] for row in values] for name in names},
        }


def _values(answer: Answer) -> dict[str, Any]:
    return {
        "name": answer.name, "unit": answer.unit, "printed": answer.printed, "ours": answer.ours,
        "difference": answer.difference, "agrees": answer.agrees, "erratum": answer.erratum,
        "unreadable": answer.conversion, "kind": answer.kind, "state": answer.state, "solution": answer.right,
    }  # fmt: skip


def _main_picture(result: ReproductionResult) -> Picture:
    """Return the first figure of the source.

    Raises:
        LabError: it has none.
    """
    for each in result.computed:
        for picture in each.item.pictures():
            return picture
    raise LabError(f"{result.source.name}: none of its figures can be drawn; report writes the page")


_COUNTED: tuple[Kind, ...] = ("number", "formula", "word")
_KINDS: Mapping[Kind, str] = {
    "number": "numbers",
    "formula": "formulas",
    "word": "words",
    "trivial": "entries 0 and ±1",
    "check": "own checks of the lab",
}
_STATES: Mapping[State, str] = {
    "agrees": "agree",
    "erratum": "errata",
    "unreadable": "unreadable",
    "differs": "differ",
    "given": "taken as given",
    "open": "exercises",
}
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


def _reproduction_document(result: ReproductionResult) -> Document:
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
    more = [f"{result.count(state)} {_STATES[state]}" for state in others if result.count(state)]
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
        (_STATES[state], str(count), _CARD_KINDS.get(state, "") if count else "") for state, count in counts.items()
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
    used = [state for state in _STATES if any(result.counts[kind][state] for kind in _KINDS)]
    kinds = tuple(
        (words, *(str(result.counts[kind][state] or "") for state in used))
        for kind, words in _KINDS.items()
        if any(result.counts[kind].values())
    )
    items: list[Row] = []
    for each in result.computed:
        found = Counter(answer.state for answer in each.answers)
        items.append((each.item.number, each.item.title, *(str(found[state] or "") for state in used)))
    heads = tuple(_STATES[state] for state in used)
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


@guarded
def _reasons(result: ReproductionResult, state: State) -> tuple[Block, ...]:
    """List the reasons of answers in a state, each once; not of chosen items, which show their own."""
    if result.options.item:
        return ()
    found: dict[str, None] = {}
    for each in result.computed:
        for answer in each.answers:
            if answer.state == state:
                found.setdefault(f"{each.item.number}: {answer.erratum or answer.conversion}")
    return (Bullets(tuple(found)),)


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
            Command(item.command),
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


def solution_of(answers: Sequence[Answer]) -> Iterator[Block]:
    """Show the correct answers: the formulas that the lab confirms at random positions, and the values it computes."""
    asked = [answer for answer in answers if answer.kind != "check"]
    placed = _by_matrix(asked)
    matrices = {name: tuple(tuple(a.solution for a in row) for row in rows) for name, rows in placed.items()}
    yield Matrices(tuple(Matrix(name, (("", rows),)) for name, rows in matrices.items() if len(rows) > 1))
    rows = [(name, ", ".join(rows[0]), _units(placed[name][0])) for name, rows in matrices.items() if len(rows) == 1]
    rows += [(answer.name, answer.solution, answer.unit) for answer in asked if answer.place is None]
    yield Table(("", "solution", "unit"), tuple(rows))


def _units(row: Sequence[Answer]) -> str:
    """Return the unit of a row, or those of its entries where they differ."""
    units = [answer.unit or "–" for answer in row]
    return ", ".join(units) if len(set(units)) > 1 else row[0].unit


def _values_of(answers: tuple[Answer, ...]) -> Iterator[Block]:
    """Show matrices as such, rows of a table in a table of as many columns, and all other values one by one."""
    placed = _by_matrix(answers)
    yield Matrices(tuple(_matrix(name, rows) for name, rows in placed.items() if len(rows) > 1))
    single = [rows[0] for rows in placed.values() if len(rows) == 1]
    for width in dict.fromkeys(map(len, single)):
        yield _row_table([row for row in single if len(row) == width], width)
    wrong = [answer for answer in answers if answer.place is not None and answer.state in _WORST[:3]]
    yield Bullets(tuple(_marked_entries(wrong)))
    yield _list([answer for answer in answers if answer.place is None])


def _by_matrix(answers: Iterable[Answer]) -> dict[str, list[list[Answer]]]:
    """Return the rows of each matrix, by its name."""
    found: dict[str, dict[int, list[Answer]]] = {}
    for answer in answers:
        if answer.place is not None:
            found.setdefault(answer.place[0], {}).setdefault(answer.place[1], []).append(answer)
    return {name: list(rows.values()) for name, rows in found.items()}


def _matrix(name: str, rows: Sequence[Sequence[Answer]]) -> Matrix:
    """Return a matrix as printed, or as the reader should find it, beside the lab's values, with its worst state."""
    state = min((answer.state for row in rows for answer in row), key=_WORST.index)
    printed, ours = (tuple(tuple(map(part, row)) for row in rows) for part in (_entry, _ours))
    return Matrix(name, (("solution" if state == "open" else "printed", printed), ("here", ours)), _BADGES[state])


def _ours(answer: Answer) -> Text:
    """Return the lab's value of an entry."""
    return answer.ours


def _row_table(rows: Sequence[Sequence[Answer]], width: int) -> Table:
    """Show rows of a table that are compared entry by entry, beside the lab's values."""
    lines: list[Row] = []
    for row in rows:
        state = min((answer.state for answer in row), key=_WORST.index)
        name = row[0].place[0] if row[0].place else ""
        lines.append((name, *map(_entry, row), "", *(answer.ours for answer in row), _BADGES[state]))
    blank = ("",) * (width - 1)
    return Table(("", "printed", *blank, "", "here", *blank, ""), tuple(lines))


def _entry(answer: Answer) -> Text:
    """Return an entry of a printed matrix, in bold where it is not right or cannot be read."""
    if answer.state == "open":
        return answer.right
    shown = (answer.printed or answer.right).replace("-", "−")
    return Strong(shown) if answer.state in _WORST[:3] else shown


def _marked_entries(entries: Sequence[Answer]) -> Iterator[str]:
    """Describe the entries that are not right, or cannot be read, those with one reason together."""
    for answer in entries:
        if answer.state == "differs":
            other = answer.printed or answer.right
            yield f"{answer.name} is {answer.ours} here and {other} in the source, a difference of {answer.difference}"
    rest = [answer for answer in entries if answer.state != "differs"]
    for reason in dict.fromkeys(answer.erratum or answer.conversion for answer in rest):
        alike = [answer for answer in rest if (answer.erratum or answer.conversion) == reason]
        if alike[0].conversion:
            yield f"{reason}: {alike[0].name} to {alike[-1].name} are as they follow from the model"
        elif len(alike) > 1 and len({answer.right for answer in alike}) == 1:
            yield f"{alike[0].name} to {alike[-1].name}, right is {alike[0].right}: {reason}"
        else:
            yield "; ".join(f"{answer.name}, right is {answer.right}" for answer in alike) + f": {reason}"


def _list(answers: Sequence[Answer]) -> Table:
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


@takes(ReproduceOptions)
def reproduce(source: str | ReproduceOptions, **options: Any) -> ReproductionResult:
    """Compute the tables, figures and worked examples of a source, and compare them with the printed ones.

    Args:
        source: ``thesis``, ``elastic``, ``course`` or ``staubli``; or all options in one object.
        options: those of ``lab reproduce``, by name: ``item``.

    Returns:
        Every item with its printed and its computed values, and whether they agree.

    Raises:
        LabError: there is no such source or item.

    Example:
        >>> import lab
        >>> lab.reproduce("elastic").exit_code
        0
    """
    requested = source
    if not isinstance(requested, ReproduceOptions):
        requested = options_of("lab.reproduce", ReproduceOptions, {"source": source, **options})
    chosen = source_named(requested.source)
    items = chosen.items if requested.item is None else chosen.chosen(requested.item)
    return ReproductionResult(requested, chosen, tuple(Computed(item, item.answers()) for item in items))
