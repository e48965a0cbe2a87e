"""What a migration did."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from lab.commands.migrate.options import MigrateOptions
from lab.commands.result import Result
from lab.core.errors import LabError

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from lab.render.document import Document

__all__ = ["Migrated", "MigrationResult"]


@dataclass(frozen=True)
class Migrated:
    """A run, and what it was given; nothing where it had all of it."""

    folder: Path
    given: tuple[str, ...]


@dataclass(frozen=True, repr=False, eq=False)
class MigrationResult(Result):
    """The runs that were looked at."""

    options: MigrateOptions
    runs: tuple[Migrated, ...]

    @property
    def warnings(self) -> tuple[str, ...]:
        """What a migration cannot know."""
        if any(each.given and each.given[0].startswith("schema") for each in self.runs):
            return ("nothing tells whether an older run without checksums was edited; its numbers stay as they were",)
        return ()

    @property
    def exit_code(self) -> int:
        """0: the runs can be read."""
        return 0

    def to_dict(self) -> dict[str, Any]:
        """What ``--json`` prints."""
        return {
            "runs": [{"run": str(each.folder), "given": list(each.given)} for each in self.runs],
            "warnings": list(self.warnings),
        }

    def document(self) -> "Document":
        """What a person reads: each run, and what it was given."""
        from lab.render.document import Document, Table

        rows = tuple((str(each.folder), ", ".join(each.given) or "nothing: it is as today's runs are")
                     for each in self.runs)  # fmt: skip
        count = sum(bool(each.given) for each in self.runs)
        return Document(f"{count} of {len(self.runs)} runs migrated", (Table(("run", "given"), rows, most_rows=None),))

    def columns(self) -> Mapping[str, Sequence[Any]]:
        """A row for each run."""
        return {
            "run": [str(each.folder) for each in self.runs],
            "given": [", ".join(each.given) for each in self.runs],
        }

    def plot(self) -> "Figure":
        """Refuse, with a LabError: a migration has no figure."""
        raise LabError("a migration has no figure; lab trend draws the runs")

    def write(self, folder: Path) -> None:
        """Write ``config.json``, ``result.json`` and ``report.html``."""
        from lab.commands.run_folder import write_config, write_json

        write_config(folder, "migrate", self.options, "")
        write_json(folder / "result.json", self.to_dict())
        self.report(folder / "report.html")
