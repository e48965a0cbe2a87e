"""Base class of all results: export as values, document and table, and saving."""

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from importlib import import_module
from operator import attrgetter
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Self

import numpy as np

from lab.core.errors import LabError
from lab.core.se3 import Array
from lab.core.units import DEGREES, MM
from lab.core.values import Value, arrow_stream, data_frame

if TYPE_CHECKING:
    from matplotlib.figure import Figure


__all__ = [
    "ErrorStatistics", "Result", "error_statistics", "exit_code_of", "joint_values", "number", "plain_numbers",
    "printed", "sizes_mm", "tidy", "views",
]  # fmt: skip


class Result(Value, ABC):
    """Result of a call of the interface.

    A subclass is ``@dataclass(frozen=True, repr=False, eq=False)``: it holds arrays, which neither print shortly nor
    compare to one truth value. It holds data alone; ``lab.report.view`` finds what shows it by its type, and shows the
    table of one that has no view. A subclass gives the names declared for type checkers as fields, properties or
    attributes of the class.

    Attributes:
        robot_at: the attribute that holds the robot, e.g. ``run.robot``; empty where there is none.
    """

    robot_at: ClassVar[str] = ""

    if TYPE_CHECKING:  # at run time a property here would be the default value of a dataclass's field

        @property
        @abstractmethod
        def command(self) -> str:
            """Name of the command that this is the result of."""

        @property
        @abstractmethod
        def options(self) -> Any:
            """Options of the command."""

        @property
        @abstractmethod
        def warnings(self) -> tuple[str, ...]:
            """Warnings for the reader, a sentence each."""

    @property
    def exit_code(self) -> int:
        """Exit code of the command: 0 if the answer is good, 1 if it is bad, 3 where a good one is required."""
        return 0

    @property
    def model_sha256(self) -> str:
        """Digest of the robot's description; empty where there is none."""
        digest: str = attrgetter(self.robot_at)(self).sha256 if self.robot_at else ""
        return digest

    @property
    def serial(self) -> str | None:
        """Serial number of the arm; None where it is not given."""
        given: str | None = getattr(self.options, "serial", None)
        return given

    @abstractmethod
    def to_dict(self) -> dict[str, Any]:
        """Return the values of ``--json`` and ``result.json``: plain values, lengths in mm; None where not finite."""

    @abstractmethod
    def columns(self) -> Mapping[str, Sequence[Any] | Array]:
        """The result's main table by columns of one length, for ``to_frame``; names end in the unit."""

    def saved_dict(self) -> dict[str, Any]:
        """Return the values of ``result.json``, where a list may be an iterator."""
        return self.to_dict()

    def write_files(self, folder: Path) -> None:
        """Write the files of this result alone into a folder that is there."""

    def placed(self, folder: Path) -> Self:
        """Return the result with the folder that its files are written to; itself if it names none of them."""
        return self

    def plot(self) -> "Figure":
        """Draw the result's main figure by matplotlib.

        Raises:
            LabError: there is nothing to draw, or matplotlib is not installed (the extra ``plots``).
        """
        figure: Figure = views().figure_of(self)
        return figure

    def recording(self) -> Any:
        """Show the recording in a notebook: return its viewer, which a cell shows as its last line.

        Raises:
            LabError: there is nothing to record, or rerun-notebook is not installed (the extra ``notebook``).
        """
        return views().recording_viewer(self)

    def write(self, folder: Path) -> None:
        """Write all numbers of the run into a folder that is there and empty; ``save`` makes it.

        They are ``config.json``, ``result.json`` and the files of ``write_files``; ``draw`` adds what is drawn.
        """
        from lab.library.run_folder import write_config, write_json

        write_config(folder, self.command, self.options, self.model_sha256)
        write_json(folder / "result.json", self.saved_dict())
        self.write_files(folder)

    def draw(self, folder: Path) -> None:
        """Write ``recording.rrd``, unless the options leave it out, and ``report.html`` into the folder of the run.

        The numbers are there before, and stay: what cannot be drawn is left out, with a warning.
        """
        views().draw(self, folder)

    def summary(self) -> str:
        """Return the printed output of the command, as plain text."""
        text: str = views().text_of(self)
        return text

    def report(self, path: str | Path) -> Path:
        """Write the page to read and print, one HTML file that needs no network.

        Raises:
            LabError: the file cannot be written.
        """
        try:
            views().write_page(self, Path(path))
        except OSError as error:
            raise LabError(f"{path}: cannot be written ({error.strerror}); give another path") from error
        return Path(path)

    def to_frame(self) -> Any:
        """The result's main table as a ``pandas.DataFrame``.

        Raises:
            LabError: pandas is not installed.
        """
        return data_frame(self.columns())

    def __arrow_c_stream__(self, requested_schema: object = None) -> object:
        """Return the main table as a stream of the Arrow C interface, which polars, pyarrow and DuckDB read."""
        return arrow_stream(self.columns(), requested_schema)

    def save(self, folder: str | Path, *, overwrite: bool = False) -> Path:
        """Write all files of the run into a folder: the numbers completely or not at all, then page and recording.

        Args:
            overwrite: whether an earlier run that stands there is replaced.

        Raises:
            LabError: the folder holds an earlier run, something else or an input, or cannot be written.
        """
        from threadpoolctl import threadpool_limits

        from lab.library.run_folder import complete, input_files, run_folder

        placed = self.placed(Path(folder))
        with threadpool_limits(1), run_folder(Path(folder), input_files(self.options), overwrite=overwrite) as draft:
            placed.write(draft)
        complete(Path(folder), placed.draw)
        return Path(folder)

    def __str__(self) -> str:
        return self.summary()

    def __repr__(self) -> str:
        return f"<{type(self).__name__}: summary(), to_dict(), to_frame(), plot(), report(path) and save(folder)>"

    def _repr_html_(self) -> str:
        """Return a small table for a notebook's cell: title, verdict, main numbers, and how to get the page."""
        cell: str = views().html_cell(self)
        return cell


def views() -> Any:
    """Import ``lab.report.view``, which shows results: the one place where the library reaches up to it, on use."""
    return import_module("lab.report.view")


@dataclass(frozen=True)
class ErrorStatistics:
    """Statistics of lengths, mm, and of how many."""

    mean: float
    rms: float
    p95: float
    max: float
    count: int

    def to_dict(self) -> dict[str, float | int]:
        """The statistics by name."""
        return asdict(self)


def error_statistics(errors: Array) -> ErrorStatistics:
    """Return the statistics of errors in m; NaN is left out. Those of no errors are NaN."""
    lengths = MM.of(errors[np.isfinite(errors)])
    if not lengths.size:
        return ErrorStatistics(float("nan"), float("nan"), float("nan"), float("nan"), 0)
    return ErrorStatistics(
        float(lengths.mean()),
        float(np.sqrt(np.mean(lengths**2))),
        float(np.percentile(lengths, 95)),
        float(lengths.max()),
        int(lengths.size),
    )


def exit_code_of(verdict: str, require: str | None) -> int:
    """Return the exit code of a verdict: 1 where it is bad, 3 where it is not the required one, else 0."""
    if verdict == "bad":
        return 1
    return 0 if require in (None, verdict) else 3


def joint_values(prismatic: Sequence[bool], joints: Array) -> Array:
    """Joint positions or rates ``(..., n)`` (rad, m of a slide) as a person reads them: degrees, mm of a slide."""
    return np.asarray(joints * np.where(prismatic, MM.factor, DEGREES.factor))


def number(value: float) -> float | None:
    """The value, or None where it is not finite."""
    return float(value) if np.isfinite(value) else None


def sizes_mm(found: Any, *names: str) -> dict[str, float | None]:
    """Return lengths of an object in mm, by their names: ``rms_mm`` of ``rms_m``; None where not finite."""
    return {f"{name}_mm": number(MM.of(getattr(found, f"{name}_m"))) for name in names}


def plain_numbers(values: Array | float) -> Any:
    """An array as nested lists, a number as it is; None where not finite."""
    array = np.asarray(values, dtype=np.float64)
    return number(float(array)) if array.ndim == 0 else [plain_numbers(part) for part in array]


def tidy(value: float) -> float:
    """Round away the last digits of a unit's conversion, and minus zero."""
    return round(float(value), 9) + 0.0


def printed(value: float) -> str:
    """Format a number of a nominal model: whole numbers without a point, a true minus sign."""
    return f"{value:.6g}".replace("-", "−")
