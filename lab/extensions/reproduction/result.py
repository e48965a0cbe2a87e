"""Run ``lab reproduce``: compute a source's items again, and show them beside the printed ones."""

import re
import shlex
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import groupby
from pathlib import Path
from typing import Any, Self

from lab.commands.command_line import options_of, takes
from lab.commands.result import Result
from lab.core.errors import LabError, counted
from lab.extensions.reproduction.answer import Answer, Kind, State
from lab.extensions.reproduction.item import Computed, Exercise, Item, Source, source_named
from lab.extensions.reproduction.marking import Mark, Question, items_of, marked, questions, write_exercise
from lab.extensions.reproduction.options import ReproduceOptions
from lab.formats.csv_table import write_columns
from lab.render.document import (
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
    inlines,
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
        folder: of the files of the run; None where none are written.
    """

    command = "reproduce"
    shown_by = "lab.extensions.reproduction.result:_reproduction_document"
    drawn_by = "lab.extensions.reproduction.result:_main_picture"

    options: ReproduceOptions
    source: Source
    computed: tuple[Computed, ...]
    marks: tuple[Mark, ...] | None
    folder: Path | None = None

    def placed(self, folder: Path) -> Self:
        """Return the result with the folder that its files are written to, which the next step names."""
        return replace(self, folder=folder)

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
        """1 where a value differs without a listed reason, or an answer of an exercise is wrong or blank; else 0."""
        if self.marks is not None:
            return 0 if all(mark.state == "right" for mark in self.marks) else 1
        return 1 if self.wrong else 0

    def to_dict(self) -> dict[str, Any]:
        """Return the output of ``--json``: each item with its answers, those of an exercise without ours."""
        states = {"agree": "agrees", "errata": "erratum", "unreadable": "unreadable", "differ": "differs"}
        found: dict[str, Any] = {
            "source": self.source.name,
            "title": self.source.title,
            "answers": len(self.answers),
            **{name: sum(answer.state == state for answer in self.answers) for name, state in states.items()},
            "agree": self.count("agrees"),
            "counts": self.counts,
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
                {"item": mark.label, "given": mark.given, "state": mark.state, "note": mark.note}
                | ({"solution": mark.question.solution} if self.options.solution else {})
                for mark in self.marks
            ]
            found["items"] = [{**item, "answers": []} for item in found["items"]]  # they hold the solutions
        return found

    def _values(self, answer: Answer) -> dict[str, Any]:
        requested = {"name": answer.name, "unit": answer.unit}
        if self.options.exercise:
            return requested | ({"solution": answer.solution} if self.options.solution else {})
        return requested | {
            "printed": answer.printed, "ours": answer.ours, "difference": answer.difference, "agrees": answer.agrees,
            "erratum": answer.erratum, "unreadable": answer.conversion, "kind": answer.kind, "state": answer.state,
            "solution": answer.right,
        }  # fmt: skip

    def write_files(self, folder: Path) -> None:
        """Write ``values.csv``, or of the chosen items of an exercise its CSV."""
        if self.options.exercise:
            if self.options.item is not None:
                write_exercise(folder / "exercise.csv", self.computed)
        elif self.marks is None:
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
            "unreadable": ["" if blank else answer.conversion for _, answer in pairs],
            "kind": ["" if blank else answer.kind for _, answer in pairs],
            "state": ["" if blank else answer.state for _, answer in pairs],
            "solution": ["" if blank else answer.right for _, answer in pairs],
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
_BLANK = "…"  # an entry that is asked
_WORST: tuple[State, ...] = ("differs", "erratum", "unreadable", "agrees", "given", "open")


def _reproduction_document(result: ReproductionResult) -> Document:
    source, marked = result.source, result.marks is not None
    return Document(
        _title(result),
        (
            Paragraph(source.title, "lead"),
            *_first(result),
            Warnings(() if result.options.exercise else result.warnings),
            *_marks(result),
            Section("Items", () if marked else _overview(result)),
            Section("Errata", _reasons(result, "erratum"), shown_in=TERMINAL),
            Section("Unreadable in the converted text", _reasons(result, "unreadable"), shown_in=TERMINAL),
            *(_chapters(result) if _shows_items(result) else ()),
            Section("Items that cannot be computed", (_missing(result),) if _is_whole(result) else ()),
        ),
    )


def _first(result: ReproductionResult) -> tuple[Block, ...]:
    """Return the card; of an exercise and of marks the terminal shows its next step, too."""
    card = _card(result)
    if result.marks is None and not result.options.exercise:
        return (card,)
    return card, Paragraph((Strong("Next: "), *inlines(card.next_step)), shown_in=TERMINAL)


def _shows_items(result: ReproductionResult) -> bool:
    """True if the items follow: not of a list of exercises, and of marks only with their solutions."""
    options = result.options
    return options.solution if result.marks is not None else not options.exercise or options.item is not None


def _is_whole(result: ReproductionResult) -> bool:
    """True of all items, compared with the printed values."""
    return result.marks is None and not result.options.item and not result.options.exercise


def _title(result: ReproductionResult) -> str:
    name = result.source.name
    if result.marks is not None:
        right = sum(mark.state == "right" for mark in result.marks)
        wrong, blank = (sum(mark.state == state for mark in result.marks) for state in ("wrong", "blank"))
        return f"{name}: {right} of {len(result.marks)} answers right, {wrong} wrong, {blank} blank"
    if result.options.exercise:
        asked = questions(result.computed)
        if result.options.item is None:
            return f"{name}: {counted(len(asked), 'question')} in {counted(len(result.computed), 'item')}; choose one"
        return f"{name}: an exercise of {counted(len(asked), 'question')}"
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


_Numbers = tuple[tuple[str, str, str], ...]


def _card(result: ReproductionResult) -> Card:
    """Summarise on the page's first screen: how many agree, how many do not, and what to do next."""
    command = f"lab reproduce {result.source.name}"
    if result.marks is not None:
        return _card_of_marks(result, command)
    if result.options.exercise:
        return _card_of_exercise(result, command)
    counts = {state: result.count(state) for state in _COMPARED}
    numbers: _Numbers = tuple(
        (_STATES[state], str(count), _CARD_KINDS.get(state, "") if count else "") for state, count in counts.items()
    )
    asked = next((each.item.number for each in result.computed if questions([each])), None)
    next_step: Text = "choose an item that asks, to work it out yourself."
    if asked is not None:
        own = Code(f'lab reproduce {result.source.name} --exercise --item "{asked}"')
        next_step = ("work it out yourself: ", own, ".")
    badge = Badge("as printed" if not counts["erratum"] else "as printed but for errata", "good")
    if not sum(counts.values()):
        badge = Badge("nothing printed to compare")
    if result.wrong:
        badge, next_step = Badge("differs", "bad"), f"look at {result.wrong[0]}, which differs without a listed reason."
    about = f"Of {sum(counts.values())} printed numbers, formulas and words. An erratum is printed wrongly."
    return Card(badge, numbers, about, next_step)


def _card_of_exercise(result: ReproductionResult, command: str) -> Card:
    """Summarise an exercise: how much it asks, and how it is marked; or the list of all of them."""
    options, asked = result.options, questions(result.computed)
    items = len({each.item.number for each in asked})
    numbers: _Numbers = (("questions", str(len(asked)), ""), ("items", str(items), ""))
    if options.item is None:
        begin = Code(f"{command} --exercise --item {result.source.begin or _first_label(result)}")
        return Card(Badge("exercises"), numbers, "A few at a time: choose an item below.", ("begin with ", begin, "."))
    file = "exercise.csv" if result.folder is None else shlex.quote(str(result.folder / "exercise.csv"))
    mark = (Code(f"{command} --mark {file}"), " marks them")
    item = f"{command} --exercise --item {_quoted(options.item)}"
    more = () if options.solution else (", and ", Code(f"{item} --solution"), " shows the way to the solutions")
    badge = Badge("exercise with its solutions" if options.solution else "exercise")
    about = "Formulas may be spelled freely: c1, cos q1 and cos(θ1) are the same. A matrix is one answer: 1 | 0; 0 | 1."
    return Card(
        badge, numbers, about, ("write your answers into exercise.csv of the run's folder; ", *mark, *more, ".")
    )


def _quoted(item: str) -> str:
    return f'"{item}"' if " " in item else item


def _first_label(result: ReproductionResult) -> str:
    return _quoted(result.computed[0].item.number)


def _card_of_marks(result: ReproductionResult, command: str) -> Card:
    """Summarise a marked exercise."""
    marks = result.marks or ()
    found = Counter(mark.state for mark in marks)
    right = found["right"]
    numbers: _Numbers = (
        ("right", str(right), "after"), ("wrong", str(found["wrong"]), ""), ("blank", str(found["blank"]), ""),
    )  # fmt: skip
    if right == len(marks):
        return Card(Badge("all right", "good"), numbers, "", "take the next item.")
    first = next((mark for mark in marks if mark.state == "wrong"), None) or next(
        mark for mark in marks if mark.state == "blank"
    )
    again = f"try {first.label} again" if first.given else f"answer {first.label}"
    next_step: Text = f"{again}."
    if not result.options.solution:
        solution = Code(f"{command} --exercise --solution --item {_quoted(first.question.item.number)}")
        next_step = (again, "; ", solution, " shows the way to the solution.")
    return Card(Badge(f"{right} of {len(marks)} right", "doubtful"), numbers, "", next_step)


def _overview(result: ReproductionResult) -> tuple[Block, ...]:
    if result.options.exercise:
        return _list_of_exercises(result)
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


def _list_of_exercises(result: ReproductionResult) -> tuple[Block, ...]:
    """List the items that ask, by chapter, with the number of their questions; nothing of a single chosen one."""
    rows: list[Row] = []
    for title, items in groupby(result.computed, key=lambda each: each.item.chapter):
        for i, each in enumerate(items):
            rows.append((title if i == 0 else "", each.item.number, each.item.title, str(len(questions([each])))))
    if len(rows) == 1 and result.options.item is not None:
        return ()
    return (Table(("chapter", "item", "", "questions"), tuple(rows)),)


def _reasons(result: ReproductionResult, state: State) -> tuple[Block, ...]:
    """List the reasons of answers in a state, each once; not of chosen items, which show their own."""
    if result.options.exercise or result.options.item or result.marks is not None:
        return ()
    found: dict[str, None] = {}
    for each in result.computed:
        for answer in each.answers:
            if answer.state == state:
                found.setdefault(f"{each.item.number}: {answer.erratum or answer.conversion}")
    return (Bullets(tuple(found)),)


def _chapters(result: ReproductionResult) -> Iterator[Section]:
    """Show the items of each chapter in a section; chosen ones everywhere, else on the page alone."""
    shown_in = EVERYWHERE if result.options.item or result.marks is not None else PAGE
    for title, items in groupby(result.computed, key=lambda each: each.item.chapter):
        sections = tuple(replace(_section(result, each), shown_in=shown_in) for each in items)
        if title:
            yield Section(title, sections, shown_in=shown_in)
        else:
            yield from sections


def _section(result: ReproductionResult, each: Computed) -> Section:
    item, options = each.item, result.options
    if (options.exercise or result.marks is not None) and item.exercise is not None:
        return Section(
            f"{item.number}: {item.title}",
            (
                *_asked(item.exercise, item, [other.item.number for other in result.computed]),
                *(_steps(item.exercise) if options.solution else ()),
                *_questions(questions([each]), solved=options.solution),
                *(_remarks(each) if options.solution else ()),
            ),
        )
    return Section(
        f"{item.number}: {item.title}",
        (Paragraph(item.note), *_values(each.answers), *_figure(item, item.pictures()), Command(item.command)),
    )


def _asked(exercise: Exercise, item: Item, along: Sequence[str]) -> Iterator[Block]:
    """Show the question of an exercise, what is given, and the hint.

    Args:
        along: numbers of the items that are asked along: what these ask for is not given.
    """
    yield Paragraph((Strong(exercise.question),))
    asked = [number for number, _ in exercise.earlier if number in along]
    asked += [exercise.table_of] if exercise.table_of in along else []
    alone = f"Use your answer to {' and '.join(asked)}. Asked alone, with --item {_quoted(item.number)}, it is given."
    shown = tuple(text for number, text in exercise.earlier if number not in along)
    yield Bullets((*exercise.given, *shown, *((alone,) if asked else ())))
    if exercise.table and exercise.table_of not in along:
        yield Table(exercise.table[0], exercise.table[1:])
    yield from _figure(item, exercise.sketch(), "with its frames: x red, y green, z blue")
    yield Paragraph(exercise.hint, "hint")


def _steps(exercise: Exercise) -> Iterator[Block]:
    """Show the way to the solution."""
    yield Table(("", "the way to the solution"), tuple((f"{i + 1}.", step) for i, step in enumerate(exercise.steps)))


def _remarks(each: Computed) -> Iterator[Block]:
    """Show the errors of the printed text, and the command that computes the solution."""
    wrong = [answer for answer in each.answers if answer.erratum and answer.kind != "check"]
    reasons = dict.fromkeys(f"{answer.name} is printed as {answer.printed}: {answer.erratum}" for answer in wrong)
    yield Bullets(tuple(reasons))
    yield Paragraph(each.item.note, "note")
    yield Command(each.item.command)


def _values(answers: tuple[Answer, ...]) -> Iterator[Block]:
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


def _questions(asked: Sequence[Question], *, solved: bool) -> Iterator[Block]:
    """Ask for matrices as such, and for all other values and rows one by one."""

    def shown(answer: Answer) -> str:
        return answer.solution if solved else _BLANK

    matrices = [each for each in asked if len(each.rows) > 1]
    yield Matrices(
        tuple(Matrix(each.name, (("", tuple(tuple(map(shown, row)) for row in each.rows)),)) for each in matrices)
    )
    others = [each for each in asked if len(each.rows) == 1]
    rows = tuple((each.name, each.solution if solved else _BLANK, each.unit, _precision(each)) for each in others)
    used = (True, True, any(row[2] for row in rows), any(row[3] for row in rows) and not solved)
    heads = ("asked", "solution" if solved else "answer", "unit", "decimals")
    yield Table(
        tuple(head for head, use in zip(heads, used, strict=True) if use),
        tuple(tuple(cell for cell, use in zip(row, used, strict=True) if use) for row in rows),
    )


def _precision(question: Question) -> str:
    """Return the number of decimals that are asked for; "" of whole numbers and formulas."""
    found = max((answer.decimals or 0 for answer in question.entries), default=0)
    return str(found) if found else ""


def _figure(item: Item, pictures: Iterable[Picture], caption: str = "") -> tuple[Block, ...]:
    """Draw an item's pictures, with unique names that begin with the item's."""
    slug = re.sub(r"[^a-z0-9]+", "-", item.number.lower()).strip("-")
    named = tuple(replace(picture, name=f"{slug}-{picture.name}") for picture in pictures)
    return (Figure(slug, named, f"{item.title}, {caption}" if caption else item.title),)


def _marks(result: ReproductionResult) -> Iterator[Section]:
    """Show the marks of each item: how many answers are right, its hint where one is wrong, and every answer."""
    badges = {"right": Badge("right", "good"), "wrong": Badge("wrong", "bad"), "blank": Badge("blank", "open")}
    solved = result.options.solution
    for number, marks in groupby(result.marks or (), key=lambda mark: mark.question.item.number):
        group = list(marks)
        states = Counter(mark.state for mark in group)
        exercise = group[0].question.item.exercise
        rows = tuple(
            (badges[mark.state], mark.question.name, _shortened(mark.given), mark.note)
            + ((mark.question.solution,) if solved else ())
            for mark in group
        )
        yield Section(
            f"{number}: {states['right']} of {len(group)} right",
            (
                Table(("", "answer", "given", "", *(("right is",) if solved else ())), rows),
                Paragraph(exercise.hint if exercise is not None and states["wrong"] else "", "hint"),
            ),
        )


_SHOWN = 60  # letters of an answer


def _shortened(text: str) -> str:
    plain = " ".join(text.split())
    return plain if len(plain) <= _SHOWN else f"{plain[:_SHOWN]} …"


def _missing(result: ReproductionResult) -> Table:
    rows = tuple((Code(each.number), each.title, each.reason) for each in result.source.missing)
    return Table(("item", "", "reason"), rows)


@takes(ReproduceOptions)
def reproduce(source: str | ReproduceOptions, **options: Any) -> ReproductionResult:
    """Compute the tables, figures and worked examples of a source, and compare them with the printed ones.

    Args:
        source: ``thesis``, ``elastic``, ``course`` or ``staubli``; or all options in one object.
        options: those of ``lab reproduce``, by name: ``item``, ``exercise``, ``solution``, ``mark``.

    Returns:
        Every item with its printed and its computed values, and whether they agree.

    Raises:
        LabError: there is no such source or item, or the file to be marked is no exercise of it.

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
    if requested.item is not None:
        items = chosen.chosen(requested.item)
    else:
        items = chosen.items if requested.mark is None else items_of(requested.mark, chosen)
    if requested.exercise or requested.mark is not None:
        items = tuple(item for item in items if item.exercise is not None)
        if not items:
            raise LabError(f"--item: {requested.item} asks nothing; --exercise without --item lists the items that do")
    computed = tuple(Computed(item, item.answers()) for item in items)
    marks = None if requested.mark is None else marked(requested.mark, computed)
    return ReproductionResult(requested, chosen, computed, marks)
