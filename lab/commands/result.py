"""What every result of the interface can do: tell itself as values, as a document, as a table, and save itself."""

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, Any

from lab.core.errors import LabError
from lab.core.se3 import Array

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from lab.render.document import Document

__all__ = ["Result"]


class Result(ABC):
    """What a call of the interface gives back.

    A subclass is ``@dataclass(frozen=True, repr=False, eq=False)``: it holds arrays, which neither print shortly nor
    compare to one truth value. It says what is abstract here, overrides nothing else, and imports what is slow
    (rendering, drawing, writing) inside its methods. ``warnings`` and ``options`` may be
    fields or properties.
    """

    if TYPE_CHECKING:  # at run time a property here would be the default value of a dataclass's field

        @property
        @abstractmethod
        def warnings(self) -> tuple[str, ...]:
            """What a reader should be told, a sentence each."""

        @property
        @abstractmethod
        def options(self) -> Any:
            """What was asked: the options of the command."""

    @property
    @abstractmethod
    def exit_code(self) -> int:
        """What the command returns: 0 where the answer is good, 1 where it is bad, 3 where a good one is required."""

    @abstractmethod
    def to_dict(self) -> dict[str, Any]:
        """What ``--json`` prints and ``result.json`` holds: plain values, lengths in mm; None where not finite."""

    @abstractmethod
    def document(self) -> "Document":
        """What a person reads: the one document that terminal, page and recording show."""

    @abstractmethod
    def columns(self) -> Mapping[str, Sequence[Any] | Array]:
        """The result's main table by columns of one length, for ``to_frame``; names end in the unit."""

    @abstractmethod
    def plot(self) -> "Figure":
        """Draw the result's main figure (matplotlib)."""

    @abstractmethod
    def write(self, folder: Path) -> None:
        """Write every file of the run into a folder that is there and empty; ``save`` makes it."""

    def summary(self) -> str:
        """What the command prints, as plain text."""
        from lab.render.terminal import to_text

        return "\n".join(line.rstrip() for line in to_text(self.document()).splitlines()).strip()

    def report(self, path: str | Path) -> Path:
        """Write the page to read and print, one HTML file that needs no network.

        Raises:
            LabError: the file cannot be written.
        """
        try:
            Path(path).write_text(self._page(), encoding="utf-8")
        except OSError as error:
            raise LabError(f"{path}: cannot be written ({error.strerror}); give another path") from error
        return Path(path)

    def to_frame(self) -> Any:
        """The result's main table as a ``pandas.DataFrame``.

        Raises:
            LabError: pandas is not installed.
        """
        try:
            import pandas  # type: ignore[import-not-found,import-untyped,unused-ignore]
        except ImportError as error:
            raise LabError(
                "to_frame needs pandas, which is not installed; pip install pandas, or use to_dict"
            ) from error
        return pandas.DataFrame(dict(self.columns()))

    def save(self, folder: str | Path, *, overwrite: bool = False) -> Path:
        """Write all files of the run into a folder, completely or not at all.

        Args:
            overwrite: whether an earlier run that stands there is replaced.

        Raises:
            LabError: the folder holds an earlier run, something else or an input, or cannot be written.
        """
        from threadpoolctl import threadpool_limits

        from lab.commands.run_folder import input_files, run_folder
        from lab.render.progress import status

        inputs, written = input_files(self.options), "writing the page and the other files"
        with threadpool_limits(1), run_folder(Path(folder), inputs, overwrite=overwrite) as draft, status(written):
            self.write(draft)
        return Path(folder)

    def __str__(self) -> str:
        return self.summary()

    def __repr__(self) -> str:
        return f"<{type(self).__name__}: summary(), to_dict(), to_frame(), plot(), report(path) and save(folder)>"

    def _repr_html_(self) -> str:
        """The page in a frame of its own, so that a notebook's styles and the page's do not meet."""
        return f'<iframe srcdoc="{escape(self._page())}" style="border:0;width:100%;height:40em"></iframe>'

    def _page(self) -> str:
        from lab.render.page import to_html

        page: str = to_html(self.document())
        return page
