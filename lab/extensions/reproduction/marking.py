"""Write the questions of an exercise into a file, and mark the answers that a reader filled in."""

import csv
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

from lab.core.errors import LabError, counted
from lab.extensions.reproduction.answer import Answer
from lab.extensions.reproduction.formulas import FormulaError
from lab.extensions.reproduction.item import Computed, Item, Source
from lab.formats.csv_table import CsvTable, text_cell

__all__ = ["Mark", "Question", "items_of", "marked", "questions", "write_exercise"]

_COLUMNS = ("item", "value", "unit")  # of the file


@dataclass(frozen=True)
class Question:
    """One answer that an exercise asks for: a value, a row of a table, or a whole matrix.

    Attributes:
        item: of the source.
        name: of the value, the row or the matrix; unique in its item.
        rows: the entries; a single one of a value.
    """

    item: Item
    name: str
    rows: tuple[tuple[Answer, ...], ...]

    @property
    def label(self) -> str:
        """Name in the file of an exercise."""
        return f"{self.item.number}: {self.name}"

    @property
    def entries(self) -> tuple[Answer, ...]:
        """The answers, row by row."""
        return tuple(answer for row in self.rows for answer in row)

    @property
    def unit(self) -> str:
        """Unit of the answer; of a row with several units, those of its entries."""
        units = [answer.unit for answer in self.entries]
        if len(set(units)) == 1:
            return units[0]
        return ", ".join(unit or "–" for unit in units) if len(self.rows) == 1 else ""

    @property
    def solution(self) -> str:
        """The answer as a reader writes it."""
        return "; ".join(", ".join(answer.solution for answer in row) for row in self.rows)

    def split(self, text: str) -> list[str]:
        """Return the entries of an answer; "" where one is left blank.

        Raises:
            LabError: the number of rows or entries is another one.
        """
        if len(self.entries) == 1:
            return [text]
        text = _without_latex(text)
        rows = [_parts(row) for row in _lines(text, len(self.rows))]
        wide = len(self.rows[0])
        homogeneous = len(self.rows) == 4 and [answer.solution for answer in self.rows[-1]] == ["0", "0", "0", "1"]
        if homogeneous and len(rows) == 3:
            rows.append(["0", "0", "0", "1"])
        if len(rows) == wide != len(self.rows) and all(len(row) == len(self.rows) for row in rows):
            raise LabError(f"{self.name} is transposed: it has {len(self.rows)} rows of {wide} entries")
        if len(rows) != len(self.rows) or any(len(row) != wide for row in rows):
            shape = "" if len(self.rows) == 1 else f"{len(self.rows)} rows of "
            found = " and ".join(sorted({str(len(row)) for row in rows}))
            between = "bars |" if "|" in text else "commas"
            more = "" if len(self.rows) == 1 else f" in {counted(len(rows), 'row')}"
            raise LabError(
                f"{self.name} has {shape}{wide} entries, and {found}{more} are given; put {between} between entries"
                + ("" if len(self.rows) == 1 else ", and semicolons between rows")
            )
        return [entry for row in rows for entry in row]


_MATRIX = re.compile(r"\\(?:begin|end)\s*\{[a-zA-Z]*(?:matrix|array)\}(?:\{[lcr|]*\})?|\\(?:left|right)\s*[(\[\])]")


def _without_latex(text: str) -> str:
    """Return a matrix of LaTeX, with ampersands, as one with bars and semicolons; any other text as it is."""
    if "\\begin" not in text:
        return text
    plain = re.sub(r"\\\\(?:\[[^\]]*\])?", ";", _MATRIX.sub(" ", text.replace("$", " ")))
    return plain.strip().rstrip(";").replace("&", "|")


def _lines(text: str, rows: int) -> list[str]:
    """Return the rows of a matrix: divided by semicolons, line breaks, or brackets as of a list of lists."""
    plain = text.strip()
    if plain.startswith("[[") and plain.endswith("]]"):
        return re.split(r"\]\s*,?\s*\[", plain[2:-2])
    if plain.startswith("[") and plain.endswith("]"):
        plain = plain[1:-1]
    if rows == 1:
        return [plain]
    return [line for line in re.split(r"[;\n]", plain) if line.strip()]


def _parts(row: str) -> list[str]:
    """Return the entries of a row: divided by ``|`` or ``;``, else by commas outside of brackets."""
    for sign in "|;":
        if sign in row:
            return [part.strip() for part in row.split(sign)]
    parts, depth = [""], 0
    for letter in row:
        depth += (letter in "([") - (letter in ")]")
        if letter == "," and depth == 0:
            parts.append("")
        else:
            parts[-1] += letter
    return [part.strip() for part in parts]


def questions(computed: Sequence[Computed]) -> tuple[Question, ...]:
    """Return what the items ask for, in order."""
    found: list[Question] = []
    for each in computed:
        groups: dict[str, dict[int, list[Answer]]] = {}
        for answer in each.answers:
            if answer.in_exercise and each.item.exercise is not None:
                name, row = (answer.name, 1) if answer.place is None else answer.place[:2]
                groups.setdefault(name, {}).setdefault(row, []).append(answer)
        found += [Question(each.item, name, tuple(map(tuple, rows.values()))) for name, rows in groups.items()]
    return tuple(found)


@dataclass(frozen=True)
class Mark:
    """A reader's answer with its mark.

    Attributes:
        question: what was asked.
        given: the text in the file; "" where it is left blank.
        state: result of the marking.
        note: a hint in a sentence, without the solution: why it cannot be read, or in what it differs.
    """

    question: Question
    given: str
    state: Literal["right", "wrong", "blank"]
    note: str

    @property
    def label(self) -> str:
        """Name of the answer in the file."""
        return self.question.label


def write_exercise(path: Path, computed: Sequence[Computed]) -> None:
    """Write the answers of an exercise, each with a blank."""
    with path.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(_COLUMNS)
        writer.writerows((text_cell(each.label), "", each.unit) for each in questions(computed))


def items_of(path: Path, source: Source) -> tuple[Item, ...]:
    """Return the items that a filled-in exercise has answers of.

    Raises:
        LabError: the file is no exercise of this source.
    """
    labels = _cells(path)[1]
    found = tuple(item for item in source.items if any(label.startswith(f"{item.number}: ") for label in labels))
    return found or tuple(item for item in source.items if item.exercise is not None)[:1]


def _cells(path: Path) -> tuple[CsvTable, list[str], list[str]]:
    table = CsvTable(path)
    labels, values = table.texts("item"), table.texts("value")
    if labels is None or values is None:
        raise LabError(f"{path}: has no columns item and value; fill in the CSV that --exercise writes")
    return table, [" ".join(cell.split()) for cell in labels], list(values)


def marked(path: Path, computed: Sequence[Computed]) -> tuple[Mark, ...]:
    """Mark a filled-in exercise, answer by answer; answers that are not in the file are blank.

    A matrix is one answer, ``c1, −s1; s1, c1``, or has a row of the file for each entry.

    Raises:
        LabError: the file is no exercise of this source.
    """
    asked = questions(computed)
    whole = {each.label: each for each in asked}
    single = {
        f"{each.item.number}: {answer.name}": (each, at) for each in asked for at, answer in enumerate(each.entries)
    }
    given: dict[str, str] = {}
    entries: dict[str, dict[int, str]] = {}
    table, labels, values = _cells(path)
    for row, (label, value) in enumerate(zip(labels, values, strict=True)):
        if label not in whole and label not in single:
            raise table.fail(row, "item", f"'{label}' is no answer of this source; keep the labels of --exercise")
        if label in given:
            raise table.fail(row, "item", f"'{label}' appears twice; keep one")
        given[label] = value.strip()
        if label not in whole:
            question, at = single[label]
            entries.setdefault(question.label, {})[at] = value.strip()
    marks = []
    for each in _matched(asked, given):
        parts = entries.get(each.label, {})
        joined = [parts.get(at, "") for at in range(len(each.entries))] if parts else None
        marks.append(_mark(each, given.get(each.label, ""), joined))
    return tuple(replace(mark, question=each) for mark, each in zip(marks, asked, strict=True))


def _matched(asked: Sequence[Question], given: Mapping[str, str]) -> list[Question]:
    """Return for each question the one whose entries judge it: of rows in any order, the one that fits best."""
    found = list(asked)
    for name in dict.fromkeys(each.entries[0].any_order for each in asked):
        places = [i for i, each in enumerate(asked) if name and each.entries[0].any_order == name]
        pairs = {(i, j): _hits(asked[j], given.get(asked[i].label, "")) for i in places for j in places}
        while pairs:
            place, best = max(pairs, key=lambda pair: (pairs[pair], pair[0] == pair[1]))
            found[place] = replace(asked[best], name=asked[place].name)
            pairs = {pair: hits for pair, hits in pairs.items() if pair[0] != place and pair[1] != best}
    return found


def _hits(question: Question, text: str) -> int:
    try:
        texts = question.split(text)
        return sum(_right(answer, part) for answer, part in zip(question.entries, texts, strict=True))
    except LabError:
        return 0


def _right(answer: Answer, text: str) -> bool:
    try:
        return bool(text) and answer.check(text)
    except LabError:
        return False


def _mark(question: Question, text: str, parts: Sequence[str] | None) -> Mark:
    """Mark an answer, or the entries of one that has a row of the file each."""
    if not text and not any(parts or ()):
        return Mark(question, "", "blank", "")
    shown = text or ", ".join(part or "…" for part in parts or ())
    try:
        texts = question.split(text) if parts is None or text else list(parts)
    except LabError as error:
        return Mark(question, shown, "wrong", str(error))
    entries = question.entries
    if len(entries) == 1:
        try:
            state: Literal["right", "wrong"] = "right" if entries[0].check(texts[0]) else "wrong"
            return Mark(question, shown, state, entries[0].advice(texts[0]))
        except LabError as error:
            return Mark(question, shown, "wrong", _reason(error, question.item))
    right = [_right(answer, part) for answer, part in zip(entries, texts, strict=True)]
    if all(right):
        return Mark(question, shown, "right", "")
    return Mark(question, shown, "wrong", _advice_on_entries(question, texts, right))


def _reason(error: LabError, item: Item) -> str:
    """Return why an answer cannot be read; the letters that it names are those of the exercise's text."""
    if not isinstance(error, FormulaError) or item.exercise is None:
        return str(error)
    head = str(error).removesuffix(error.known)
    for text in item.exercise.given:
        if found := re.search(r"Letters: (.*?)(?:\. |\.?$)", text):
            return head + found[1]
    words = {*re.findall(r"[^\W\d_]+\d*", " ".join((item.exercise.question, *item.exercise.given)))}
    shown = (each for each in error.known.split(", ") if each in words or _ALWAYS.match(each))
    return head + ", ".join(shown)


_ALWAYS = re.compile(r"q\d+$|[cs]1$|c12 …|none")  # joints with their sines and cosines


def _advice_on_entries(question: Question, texts: Sequence[str], right: Sequence[bool]) -> str:
    """Describe a wrong row or matrix: how many entries are right, and the first that is not."""
    entries, wide, tall = question.entries, len(question.rows[0]), len(question.rows)
    if wide == tall and all(
        _right(entries[j * wide + i], texts[i * wide + j]) for i in range(tall) for j in range(wide)
    ):
        return "it is transposed: rows and columns are exchanged"
    if (tall, wide) == (4, 4) and all(
        _right(question.rows[j][i], texts[4 * i + j]) for i in range(3) for j in range(3)
    ):
        return "its rotation is transposed: rows and columns are exchanged"
    missed = [i for i, ok in enumerate(right) if not ok]
    first = next((i for i in missed if texts[i]), missed[0])
    answer, text = entries[first], texts[first]
    try:
        why = answer.advice(text) if text else "it is blank"
    except LabError as error:
        why = _reason(error, question.item)
    place = f"({first // wide + 1},{first % wide + 1})" if tall > 1 else f"{first + 1}"
    return f"{sum(right)} of {len(right)} entries are right; look at entry {place}" + (f": {why}" if why else "")
