"""A script: its options are a dataclass, one function works out the answer, and this prints it as the commands do."""

import csv
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol, TypeVar

import tyro
from threadpoolctl import threadpool_limits

from lab.core.errors import LabError
from lab.render.document import Document, Paragraph
from lab.render.terminal import print_document, print_json

__all__ = ["Answer", "named_values", "paragraphs", "run_script", "write_rows"]


class ScriptOptions(Protocol):
    """What every script's options have."""

    @property
    def json(self) -> bool:
        """Print one JSON object."""


Options = TypeVar("Options", bound=ScriptOptions)


@dataclass(frozen=True)
class Answer:
    """What a script found.

    Attributes:
        values: what ``--json`` prints.
        document: what a person reads.
    """

    values: Mapping[str, Any]
    document: Document


def run_script(
    options: type[Options], answer: Callable[[Options], Answer], arguments: Sequence[str] | None = None
) -> None:
    """Read the command line, work out the answer on one thread, print it.

    Bad input is one line on standard error, and exit code 2. The arguments are those of the program by default.
    """
    given = tyro.cli(options, args=arguments, description=sys.modules[options.__module__].__doc__)
    try:
        with threadpool_limits(1):
            found = answer(given)
    except LabError as error:
        print(f"lab: {error}", file=sys.stderr)
        raise SystemExit(2) from error
    if given.json:
        print_json(found.values)
    else:
        print_document(found.document)


def paragraphs(lines: Sequence[str]) -> tuple[Paragraph, ...]:
    """Lines of text as blocks of a document."""
    return tuple(Paragraph(line) for line in lines)


def named_values(result: Mapping[str, float]) -> list[str]:
    """A line for each value of a result."""
    return [f"  {key.replace('_', ' '):28} {value:.4f}" for key, value in result.items()]


def write_rows(path: Path, rows: Sequence[Mapping[str, Any]]) -> None:
    """A CSV file with a line for each row, under the names of the first."""
    with path.open("w", newline="", encoding="utf-8") as file:
        writer: csv.DictWriter[str] = csv.DictWriter(file, list(rows[0]), lineterminator="\n")
        writer.writeheader()
        writer.writerows(rows)
