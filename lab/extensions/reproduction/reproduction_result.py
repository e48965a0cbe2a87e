"""Run ``lab reproduce``: compute a source's items again, and show them beside the printed ones."""

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from lab.extensions.reproduction.answer import ComparedValue, Kind, State
from lab.extensions.reproduction.item import Computed, Source, source_named
from lab.extensions.reproduction.reproduction_options import ReproduceOptions
from lab.formats.csv_table import write_columns
from lab.library.result import Result
from lab.options.call_options import options_of, takes
from lab.report.document import (
    Block,
    Matrices,
    Matrix,
    Table,
)

__all__ = ["KINDS", "STATES", "ReproductionResult", "by_matrix", "reproduce", "solution_of"]


@dataclass(frozen=True, repr=False, eq=False)
class ReproductionResult(Result):
    """Items of a source, as printed and as computed here.

    Attributes:
        options: of the command.
        source: the text.
        computed: its items, in order.
    """

    command = "reproduce"

    options: ReproduceOptions
    source: Source
    computed: tuple[Computed, ...]

    @property
    def answers(self) -> tuple[ComparedValue, ...]:
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
        return {kind: {state: found[kind, state] for state in STATES} for kind in KINDS}

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


def _values(answer: ComparedValue) -> dict[str, Any]:
    return {
        "name": answer.name, "unit": answer.unit, "printed": answer.printed, "ours": answer.ours,
        "difference": answer.difference, "agrees": answer.agrees, "erratum": answer.erratum,
        "unreadable": answer.conversion, "kind": answer.kind, "state": answer.state, "solution": answer.right,
    }  # fmt: skip


_COUNTED: tuple[Kind, ...] = ("number", "formula", "word")
KINDS: Mapping[Kind, str] = {
    "number": "numbers",
    "formula": "formulas",
    "word": "words",
    "trivial": "entries 0 and ±1",
    "check": "own checks of the lab",
}
STATES: Mapping[State, str] = {
    "agrees": "agree",
    "erratum": "errata",
    "unreadable": "unreadable",
    "differs": "differ",
    "given": "taken as given",
    "open": "exercises",
}


def solution_of(answers: Sequence[ComparedValue]) -> Iterator[Block]:
    """Show the correct answers: the formulas that the lab confirms at random positions, and the values it computes."""
    asked = [answer for answer in answers if answer.kind != "check"]
    placed = by_matrix(asked)
    matrices = {name: tuple(tuple(a.solution for a in row) for row in rows) for name, rows in placed.items()}
    yield Matrices(tuple(Matrix(name, (("", rows),)) for name, rows in matrices.items() if len(rows) > 1))
    rows = [(name, ", ".join(rows[0]), _units(placed[name][0])) for name, rows in matrices.items() if len(rows) == 1]
    yield Table(("", "solution", "unit"), (*rows, *_single(asked)))


def _single(answers: Sequence[ComparedValue]) -> list[tuple[str, str, str]]:
    """Return name, solution and unit of what is in no matrix."""
    return [(answer.name, answer.solution, answer.unit) for answer in answers if answer.place is None]


def _units(row: Sequence[ComparedValue]) -> str:
    """Return the unit of a row, or those of its entries where they differ."""
    units = [answer.unit or "–" for answer in row]
    return ", ".join(units) if len(set(units)) > 1 else row[0].unit


def by_matrix(answers: Iterable[ComparedValue]) -> dict[str, list[list[ComparedValue]]]:
    """Return the rows of each matrix, by its name."""
    matrices: dict[str, dict[int, list[ComparedValue]]] = {}
    for answer in answers:
        if answer.place is not None:
            matrices.setdefault(answer.place[0], {}).setdefault(answer.place[1], []).append(answer)
    return {name: list(rows.values()) for name, rows in matrices.items()}


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
