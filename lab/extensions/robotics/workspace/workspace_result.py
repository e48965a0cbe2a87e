"""Results of ``lab workspace``: typed, as plain values, and as a document."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from lab.core.random import rng_for
from lab.core.se3 import Array
from lab.core.units import MM
from lab.extensions.robotics.workspace.measure import PlaneSection, Workspace
from lab.extensions.robotics.workspace.workspace_options import WorkspaceOptions
from lab.formats.csv_table import write_columns
from lab.library.result import Result, number, tidy
from lab.report.surfaces import mesh_of, write_stl
from lab.robots.robot import Robot

if TYPE_CHECKING:
    import trimesh


__all__ = ["RobotWorkspace", "WorkspaceResult"]


@dataclass(frozen=True)
class RobotWorkspace:
    """The workspace of one robot.

    Attributes:
        reach_m: least and largest distance from axis 1 (frame 0 where joint 1 slides); None of mechanisms with loops.
        shared: ``(k, 3)`` m places at which orientations were tried, and ``shares`` ``(k,)`` of them.
        checked: ``(c, 3)`` m places checked for an IK solution without a collision, and ``free`` ``(c,)`` whether
            there is one; none without a cell.
    """

    robot: Robot
    options: WorkspaceOptions
    space: Workspace
    reach_m: tuple[float, float] | None
    shared: Array
    shares: Array
    checked: Array
    free: NDArray[np.bool_]

    @property
    def plane(self) -> bool:
        """True if the workspace is an area."""
        return self.space.domain.kind == "plane"

    @property
    def size(self) -> float:
        """Size, m³ or of a plane m²: by sections where available, else by Monte Carlo."""
        return self.space.measured.size if self.space.by_sections is None else self.space.by_sections

    @cached_property
    def sections(self) -> tuple[PlaneSection, ...]:
        """The x-z section through the base's axis and a horizontal one; of a plane the plane."""
        domain = self.space.domain
        tried = self.options.orientations if self.space.by_pose.exact else 0
        if self.plane:
            first, second = domain.axes
            return (self.space.section((first, second), domain.level_m, tried),)
        coordinates = self.space.measured.drawn(2000, rng_for(0, "structure"))
        level = float(np.round(domain.places(coordinates)[:, 2].mean(), 3))
        if self.options.level_mm is not None:
            level = MM.to_si(self.options.level_mm)
        low, high = domain.extents[1]
        across = 0.0 if low < 0 < high else float((low + high) / 2)
        return self.space.section((0, 2), across, tried), self.space.section((0, 1), level, tried)

    def to_dict(self) -> dict[str, Any]:
        """Return plain values: m³ or m², mm."""
        space, measured, reach = self.space, self.space.measured, self.reach_m
        by_sections = space.by_sections is not None
        return {
            "robot": self.robot.name,
            "volume_m3": None if self.plane else number(self.size),
            "area_m2": number(self.size) if self.plane else None,
            "method": "sections" if by_sections else "Monte Carlo",
            "by": "closed form" if space.by_place.exact else "search",
            "monte_carlo": {
                "places": len(measured.reached),
                "size": number(measured.size),
                "standard_error": number(measured.standard_error),
                "cell_mm": tidy(MM.of(measured.cell_m)),
            },
            "extents_mm": {
                axis: [tidy(MM.of(end)) for end in ends] for axis, ends in zip("xyz", space.domain.extents, strict=True)
            },
            "least_reach_mm": None if reach is None else tidy(MM.of(reach[0])),
            "reach_mm": None if reach is None else tidy(MM.of(reach[1])),
            "voids": [number(size) for size in measured.voids],
            "orientations": self._orientation_values(),
            "cell": self._cell_values(),
        }

    def _orientation_values(self) -> dict[str, Any] | None:
        kinds = self.space.orientations
        if kinds is None:
            return None
        dexterous = self.shares == 1.0
        return {
            "about": None if kinds.axis is None else [tidy(part) for part in np.abs(kinds.axis)],
            "tried": self.options.orientations,
            "places": len(self.shares),
            "mean_share": number(float(self.shares.mean())),
            "all_reached_share": number(float(dexterous.mean())),
            "all_reached_size": number(float(dexterous.mean()) * self.size),
        }

    def _cell_values(self) -> dict[str, Any] | None:
        if self.robot.cell is None:
            return None
        share = float(self.free.mean())
        return {
            "name": self.robot.cell.name,
            "places": len(self.free),
            "free_share": number(share),
            "free_share_standard_error": number(float(np.sqrt(share * (1 - share) / max(len(self.free), 1)))),
            "free_size": number(share * self.size),
        }


@dataclass(frozen=True, repr=False, eq=False)
class WorkspaceResult(Result):
    """Workspaces of one or several robots.

    Attributes:
        options: of the command.
        robots: one after the other as they were named.
    """

    command = "workspace"

    options: WorkspaceOptions
    robots: tuple[RobotWorkspace, ...]

    @property
    def warnings(self) -> tuple[str, ...]:
        """Warnings about the robots."""
        return tuple(dict.fromkeys(text for each in self.robots for text in each.robot.warnings))

    @property
    def sha256(self) -> str:
        """Checksums of the robots' files, in order."""
        return ", ".join(each.robot.sha256 for each in self.robots)

    def to_dict(self) -> dict[str, Any]:
        """Return the output of ``--json``: m³ or m², and mm."""
        return {"workspaces": [each.to_dict() for each in self.robots], "warnings": list(self.warnings)}

    @property
    def model_sha256(self) -> str:
        """Digest of the robots' descriptions."""
        return self.sha256

    @cached_property
    def meshes(self) -> "tuple[trimesh.Trimesh, ...]":
        """Boundaries of the volumes, one for each robot, without faces where it has none."""
        return tuple(mesh_of(*each.space.surface) for each in self.robots)

    def write_files(self, folder: Path) -> None:
        """Write ``workspace.csv``, and of each volume its boundary as ``<robot>.stl`` (m, in the base)."""
        write_columns(folder / "workspace.csv", self.columns())
        for each, mesh in zip(self.robots, self.meshes, strict=True):
            if len(mesh.faces):
                write_stl(folder / f"{each.robot.name}.stl", mesh)

    def columns(self) -> Mapping[str, Sequence[Any]]:
        """Return a row for each sampled place: whether it is reached."""
        places = [each.space.domain.places(each.space.measured.coordinates) for each in self.robots]
        table: dict[str, Sequence[Any]] = {
            "robot": [each.robot.name for each, rows in zip(self.robots, places, strict=True) for _ in rows]
        }
        for i, axis in enumerate("xyz"):
            table[f"{axis}_mm"] = MM.of(np.concatenate(places)[:, i]).tolist()
        table["reached"] = np.concatenate([each.space.measured.reached for each in self.robots]).astype(int).tolist()
        return table
