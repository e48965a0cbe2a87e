"""A source computed again: typed, and as plain values."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from lab.commands.result import Result
from lab.core.errors import LabError
from lab.extensions.reproduction.answer import Answer
from lab.extensions.reproduction.item import Source
from lab.extensions.reproduction.marking import Computed, Mark, write_exercise
from lab.extensions.reproduction.options import ReproduceOptions

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from lab.render.document import Document

__all__ = ["ReproductionResult"]


@dataclass(frozen=True, repr=False, eq=False)
class ReproductionResult(Result):
    """Every item of a source, with what it prints and what comes out here.

    Attributes:
        options: what was asked.
        source: the text.
        computed: its items, in order.
        marks: of a filled-in exercise; None where none is marked.
    """

    options: ReproduceOptions
    source: Source
    computed: tuple[Computed, ...]
    marks: tuple[Mark, ...] | None

    @property
    def answers(self) -> tuple[Answer, ...]:
        """Of all items."""
        return tuple(answer for each in self.computed for answer in each.answers)

    @property
    def wrong(self) -> tuple[str, ...]:
        """Printed values that differ and are no known errata, or errata that do not differ."""
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
        """What ``--json`` prints: each item with its answers, those of an exercise without ours."""
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
        asked = {"name": answer.name, "unit": answer.unit}
        if self.options.exercise:
            return asked
        return asked | {
            "printed": answer.printed, "ours": answer.ours, "difference": answer.difference, "agrees": answer.agrees,
            "erratum": answer.erratum,
        }  # fmt: skip

    def document(self) -> "Document":
        """What a person reads: an overview, then every item; of an exercise its questions or its marks."""
        from lab.extensions.reproduction.document import reproduction_document

        return reproduction_document(self)

    def columns(self) -> Mapping[str, Sequence[Any]]:
        """A row for each answer."""
        pairs = [(each.item, answer) for each in self.computed for answer in each.answers]
        blank = self.options.exercise
        return {
            "item": [f"{item.number}: {answer.name}" for item, answer in pairs],
            "printed": ["" if blank else answer.printed for _, answer in pairs],
            "ours": ["" if blank else answer.ours for _, answer in pairs],
            "unit": [answer.unit for _, answer in pairs],
            "erratum": ["" if blank else answer.erratum for _, answer in pairs],
        }

    def plot(self) -> "Figure":
        """Draw the first figure of the source.

        Raises:
            LabError: it has none.
        """
        for each in self.computed:
            for picture in each.item.pictures():
                return picture.draw()
        raise LabError(f"{self.source.name}: none of its figures can be drawn; report writes the page")

    def write(self, folder: Path) -> None:
        """Write ``config.json``, ``result.json``, ``values.csv``, ``report.html``, and of an exercise its CSV."""
        from lab.commands.run_folder import write_config, write_json
        from lab.formats.csv_table import write_columns

        write_config(folder, "reproduce", self.options, "")
        write_json(folder / "result.json", self.to_dict())
        if self.options.exercise:
            write_exercise(folder / "exercise.csv", self.computed)
        else:
            write_columns(folder / "values.csv", self.columns())
        self.report(folder / "report.html")
