"""The workspaces of robots: typed, and as plain values."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from lab.commands.result import Result
from lab.extensions.robotics.workspace.measured import RobotWorkspace
from lab.extensions.robotics.workspace.options import WorkspaceOptions
from lab.formats.csv_table import write_columns

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from lab.render.document import Document

__all__ = ["WorkspaceResult"]


@dataclass(frozen=True, repr=False, eq=False)
class WorkspaceResult(Result):
    """What robots reach.

    Attributes:
        options: what was asked.
        robots: one after the other as they were named.
    """

    options: WorkspaceOptions
    robots: tuple[RobotWorkspace, ...]

    @property
    def warnings(self) -> tuple[str, ...]:
        """What a reader should be told of the robots."""
        return tuple(dict.fromkeys(text for each in self.robots for text in each.robot.warnings))

    @property
    def exit_code(self) -> int:
        """0: a workspace is neither good nor bad."""
        return 0

    @property
    def sha256(self) -> str:
        """Of the robots' files, one after the other."""
        return ", ".join(each.robot.sha256 for each in self.robots)

    def to_dict(self) -> dict[str, Any]:
        """What ``--json`` prints: m³ or m², and mm."""
        return {"workspaces": [each.to_dict() for each in self.robots], "warnings": list(self.warnings)}

    def document(self) -> "Document":
        """What a person reads: sizes, reach, voids and orientations, with the sections."""
        from lab.extensions.robotics.workspace.document import workspace_document

        return workspace_document(self)

    def columns(self) -> Mapping[str, Sequence[Any]]:
        """A row for each place that was looked at: whether it is reached."""
        places = [each.space.domain.places(each.space.measured.coordinates) for each in self.robots]
        table: dict[str, Sequence[Any]] = {
            "robot": [each.robot.name for each, rows in zip(self.robots, places, strict=True) for _ in rows]
        }
        for i, axis in enumerate("xyz"):
            table[f"{axis}_mm"] = (1e3 * np.concatenate(places)[:, i]).tolist()
        table["reached"] = np.concatenate([each.space.measured.reached for each in self.robots]).astype(int).tolist()
        return table

    def plot(self) -> "Figure":
        """Draw the first robot's first section; of several robots their sizes."""
        from lab.extensions.robotics.workspace.document import section_pictures, size_picture

        return (section_pictures(self.robots[0])[0] if len(self.robots) == 1 else size_picture(self)).draw()

    def write(self, folder: Path) -> None:
        """Write the run's files.

        ``config.json``, ``result.json``, ``workspace.csv``, ``report.html``, ``recording.rrd``, and for each volume its
        boundary as ``<robot>.stl`` (m, in the base).
        """
        from lab.commands.run_folder import write_config, write_json
        from lab.extensions.robotics.workspace.recording import record_workspaces
        from lab.render.surfaces import mesh_of, write_stl

        write_config(folder, "workspace", self.options, self.sha256)
        write_json(folder / "result.json", self.to_dict())
        write_columns(folder / "workspace.csv", self.columns())
        self.report(folder / "report.html")
        meshes = [mesh_of(*each.space.surface) for each in self.robots]
        for each, mesh in zip(self.robots, meshes, strict=True):
            if len(mesh.faces):
                write_stl(folder / f"{each.robot.name}.stl", mesh)
        if not self.options.no_recording:
            record_workspaces(folder / "recording.rrd", self, meshes)
