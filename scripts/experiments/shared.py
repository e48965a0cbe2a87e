"""Run a script: read its options, compute its answer on one thread, and print that as the lab's commands do.

Each script is a module with a frozen dataclass ``Options``, a function ``answer`` from them to an ``Answer``, and
``NEEDS``, the optional packages that it imports where it uses them. The
processes of a study call functions of importable modules only, so that a script is imported by its name.
"""

import csv
import json
import math
import os
import platform
import sys
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any

import tyro
from threadpoolctl import threadpool_limits

from lab.core.errors import LabError
from lab.core.number_text import short
from lab.options.option_types import Flag
from lab.report.charts.chart import save_figure
from lab.report.document import Block, Document, Paragraph, Row, Section, Table
from lab.report.markdown import to_markdown
from lab.report.style import FIGURE_STYLE, SERIES
from lab.report.terminal import print_document, showing_progress

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

__all__ = [
    "FIGURE_STYLE",
    "SERIES",
    "Answer",
    "Block",
    "Document",
    "Flag",
    "Paragraph",
    "Row",
    "Section",
    "Table",
    "drawing",
    "example",
    "mark_ratios",
    "named_values",
    "paragraphs",
    "processor",
    "run_script",
    "save_figure",
    "short",
    "write_rows",
]

_RATIOS = (0.2, 0.3, 0.5, 0.7, 0.8, 1, 1.25, 1.5, 2, 3, 5, 7, 10, 20, 30, 50, 100, 200, 500)
_LEFT_OUT = (0.3, 0.7, 0.8, 1.25, 1.5, 3, 7, 30)  # of many


@dataclass(frozen=True)
class Answer:
    """Result of a script.

    Attributes:
        values: what ``--json`` prints.
        document: what a person reads.
    """

    values: Mapping[str, Any]
    document: Document


def run_script(name: str, arguments: Sequence[str] | None = None) -> None:
    """Run a script's ``answer`` with the options of the command line, and print the result.

    Bad input is one line on standard error, and exit code 2.

    Args:
        name: the script's, without ``.py``.
        arguments: those of the program by default.
    """
    script = import_module(name)
    options = tyro.cli(script.Options, args=arguments, description=script.__doc__)
    try:
        for package in getattr(script, "NEEDS", ()):
            if find_spec(package) is None:
                raise LabError(f"{package} is missing: pip install {package}")
        with threadpool_limits(1), showing_progress(lambda line: print(line, file=sys.stderr)):
            answer: Answer = script.answer(options)
    except LabError as error:
        print(f"lab: {error}", file=sys.stderr)
        raise SystemExit(2) from error
    if options.json:
        print(json.dumps(_finite(answer.values), allow_nan=False))  # JSON has no numbers that are not finite
    elif getattr(options, "markdown", False):
        print(to_markdown(answer.document))
    else:
        print_document(answer.document)


def _finite(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {name: _finite(each) for name, each in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(each) for each in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


def paragraphs(lines: Sequence[str]) -> tuple[Paragraph, ...]:
    """Return lines of text as blocks of a document."""
    return tuple(Paragraph(line) for line in lines)


@contextmanager
def drawing(size: tuple[float, float]) -> Iterator["Figure"]:
    """Give a figure of this size in inches, in the lab's style."""
    import matplotlib
    from matplotlib.figure import Figure

    with matplotlib.rc_context(FIGURE_STYLE):
        yield Figure(figsize=size, layout="constrained")


def example(name: str) -> Any:
    """Return the module of an example of the documentation."""
    folder = str(Path(__file__).parents[1] / "examples")
    if folder not in sys.path:
        sys.path.append(folder)
    return import_module(name)


def processor() -> str:
    """Return the name of this machine's processor, and how many of them."""
    info = Path("/proc/cpuinfo")
    lines = info.read_text(encoding="utf-8").splitlines() if info.is_file() else []
    models = [line.split(":", 1)[1].strip() for line in lines if line.startswith("model name")]
    return f"{os.cpu_count()} x {models[0] if models else platform.processor() or platform.machine()}"


def named_values(result: Mapping[str, float]) -> list[str]:
    """Return a line for each value of a result."""
    return [f"  {key.replace('_', ' '):28} {value:.4f}" for key, value in result.items()]


def write_rows(path: Path, rows: Sequence[Mapping[str, Any]]) -> None:
    """Write a CSV file with a line for each row, under the names of the first."""
    with path.open("w", newline="", encoding="utf-8") as file:
        writer: csv.DictWriter[str] = csv.DictWriter(file, list(rows[0]), lineterminator="\n")
        writer.writeheader()
        writer.writerows(rows)


def mark_ratios(axes: "Axes") -> None:
    """Label a logarithmic x axis of ratios with plain numbers."""
    low, high = axes.get_xlim()
    ticks = [ratio for ratio in _RATIOS if low <= ratio <= high]
    if len(ticks) > 7:
        ticks = [ratio for ratio in ticks if ratio not in _LEFT_OUT]
    axes.set_xticks(ticks, [f"{tick:g}" for tick in ticks])
    axes.set_xticks([], minor=True)
