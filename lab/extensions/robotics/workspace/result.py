"""The workspaces of robots: typed, and as plain values."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import trimesh

from lab.commands.result import Result, printed
from lab.core.errors import counted
from lab.core.units import MM
from lab.extensions.robotics.workspace.measured import RobotWorkspace
from lab.extensions.robotics.workspace.options import WorkspaceOptions
from lab.extensions.robotics.workspace.space import Section as Cut
from lab.formats.csv_table import write_columns
from lab.render.charts.chart import axes_picture, figure_picture
from lab.render.charts.marks import Axes
from lab.render.document import Bullets, Document, Figure, Picture, Section, Table, Warnings, short
from lab.render.style import AFTER, COLOUR_SCALE, INK
from lab.render.surfaces import mesh_of, write_stl

if TYPE_CHECKING:
    import matplotlib.axes

    from lab.render.document import Document

__all__ = ["WorkspaceResult"]


@dataclass(frozen=True, repr=False, eq=False)
class WorkspaceResult(Result):
    """The workspaces of some robots.

    Attributes:
        options: of the command.
        robots: one after the other as they were named.
    """

    command = "workspace"
    shown_by = "lab.extensions.robotics.workspace.result:_workspace_document"
    drawn_by = "lab.extensions.robotics.workspace.result:_main_picture"
    recorded_by = "lab.extensions.robotics.workspace.recording:record_workspaces"

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
        """A row for each place that was looked at: whether it is reached."""
        places = [each.space.domain.places(each.space.measured.coordinates) for each in self.robots]
        table: dict[str, Sequence[Any]] = {
            "robot": [each.robot.name for each, rows in zip(self.robots, places, strict=True) for _ in rows]
        }
        for i, axis in enumerate("xyz"):
            table[f"{axis}_mm"] = MM.of(np.concatenate(places)[:, i]).tolist()
        table["reached"] = np.concatenate([each.space.measured.reached for each in self.robots]).astype(int).tolist()
        return table


def _main_picture(result: WorkspaceResult) -> Picture:
    """Return the first robot's first section; of several robots their sizes."""
    return _section_pictures(result.robots[0])[0] if len(result.robots) == 1 else _size_picture(result)


def _workspace_document(result: WorkspaceResult) -> Document:
    """Summarize each robot's workspace with its sections; several robots are compared first."""
    several = len(result.robots) > 1
    return Document(
        f"Workspaces of {len(result.robots)} robots" if several else _title(result.robots[0]),
        (
            Warnings(result.warnings),
            *((_comparison(result),) if several else ()),
            *(
                Section(
                    each.robot.name if several else "Workspace",
                    (Bullets(_lines(each)), Figure(f"sections-{i + 1}", _section_pictures(each, i), _caption(each))),
                )
                for i, each in enumerate(result.robots)
            ),
        ),
    )


def _title(each: RobotWorkspace) -> str:
    kind = "an area" if each.plane else "a volume"
    return f"{each.robot.name} reaches {kind} of {_size(each, each.size)}"


def _size(each: RobotWorkspace, value: float) -> str:
    return f"{value:.4g} {'m²' if each.plane else 'm³'}"


def _comparison(result: WorkspaceResult) -> Section:
    """A table and a figure of all sizes."""
    rows = []
    for each in result.robots:
        values, found = each.to_dict(), each.space.measured
        share = values["orientations"]
        ends = each.reach_m
        rows.append((
            each.robot.name, _size(each, each.size), f"{_size(each, found.size)} ± {found.standard_error:.2g}",
            "–" if ends is None else f"{printed(round(MM.of(ends[0])))} … {printed(round(MM.of(ends[1])))}",
            str(len(found.voids)), "–" if share is None else f"{100 * share['mean_share']:.0f} %",
        ))  # fmt: skip
    columns = ("robot", "size", "by Monte Carlo", "from axis 1, mm", "voids", "orientations")
    figure = Figure("sizes", (_size_picture(result),), "What each robot reaches.")
    return Section("Comparison", (Table(columns, tuple(rows)), figure))


def _size_picture(result: WorkspaceResult) -> Picture:
    """The sizes of several robots' workspaces as bars."""
    robots = result.robots
    sizes, largest = [each.size for each in robots], max(each.size for each in robots)

    def draw(axes: Axes) -> None:
        at = np.arange(len(robots))[::-1]
        axes.barh(at, sizes, color=AFTER, height=0.6)
        for place, each in zip(at, robots, strict=True):
            axes.annotate(_size(each, each.size), (each.size + 0.01 * largest, place), va="center", fontsize=8)
        axes.set_yticks(at, [each.robot.name for each in robots])
        kinds = dict.fromkeys("area, m²" if each.plane else "volume, m³" for each in robots)
        axes.set(xlabel=", or ".join(kinds))
        axes.set(xlim=(0, 1.2 * largest))

    height = 0.8 + 0.32 * len(robots)
    return axes_picture("sizes", "Sizes of the workspaces", (5.6, height), draw, (1.9, 0.5, 0.15, 0.1))


def _lines(each: RobotWorkspace) -> tuple[str, ...]:
    """The workspace in sentences."""
    values, found, space = each.to_dict(), each.space.measured, each.space
    name = "area" if each.plane else "volume"
    by = "the closed form" if space.by_place.exact else "a search"
    carlo = (
        f"{_size(each, found.size)} ± {found.standard_error:.2g} (1σ) by Monte Carlo: {len(found.reached):,} places "
        f"in cells of {short(MM.of(found.cell_m))} mm, reached or not by {by}"
    )
    first = f"{name} {carlo}"
    if space.by_sections is not None:
        first = f"{name} {_size(each, each.size)} by sections; {carlo}"
    ends = ", ".join(
        f"{axis} {printed(round(low))} … {printed(round(high))}" for axis, (low, high) in values["extents_mm"].items()
    )
    lines = [first, f"it lies within {ends} mm of the base"]
    if each.reach_m is not None:
        low, high = (printed(round(MM.of(end), 1)) for end in each.reach_m)
        lines.append(f"reach from axis 1: {low} … {high} mm")
    voids = ", ".join(_size(each, size) for size in found.voids)
    count = len(found.voids)
    least = f"{short(3e3 * found.cell_m)} mm"
    lines.append(f"{counted(count, 'enclosed void')} of about {voids}" if count
                 else f"no enclosed void wider than {least}")  # fmt: skip
    lines.append(_orientations(each, values["orientations"]))
    if values["cell"] is not None:
        cell = values["cell"]
        lines.append(
            f"in the cell {cell['name']} a way that touches nothing was found to {100 * cell['free_share']:.0f} % "
            f"(± {100 * cell['free_share_standard_error']:.0f} %) of it, {_size(each, cell['free_size'])}"
        )
    return tuple(lines)


def _orientations(each: RobotWorkspace, values: dict[str, Any] | None) -> str:
    if values is None:
        return "no orientation can be chosen: it follows from the place, at least in part"
    about = "orientations" if values["about"] is None else "turns about its one axis"
    return (
        f"of {values['tried']} {about}, {100 * values['mean_share']:.0f} % are reached in the mean of "
        f"{values['places']} places; all of them in {100 * values['all_reached_share']:.0f} % of the "
        f"{'area' if each.plane else 'volume'}, {_size(each, values['all_reached_size'])}"
    )


def _caption(each: RobotWorkspace) -> str:
    shaded = "shaded by the share of orientations" if each.sections[0].shares is not None else "shaded"
    return f"What is reached, {shaded}, with its boundary, in the base's frame; the base's axis is at x = y = 0."


def _section_pictures(each: RobotWorkspace, which: int = 0) -> tuple[Picture, ...]:
    """The sections of one robot's workspace."""
    return tuple(
        _section(cut, f"section-{which + 1}-{'xyz'[cut.axes[0]]}{'xyz'[cut.axes[1]]}") for cut in each.sections
    )


def _section(cut: Cut, name: str) -> Picture:
    first, second = ("xyz"[axis] for axis in cut.axes)
    third = "xyz"[3 - sum(cut.axes)]
    level = f"{third} = {printed(round(MM.of(cut.level_m)))} mm"

    def draw(axes: "matplotlib.axes.Axes") -> None:
        from matplotlib.collections import LineCollection
        from matplotlib.colors import LinearSegmentedColormap, ListedColormap

        right, up = MM.of(cut.right), MM.of(cut.up)
        if cut.shares is None:
            shown, colours = np.where(cut.reached, 1.0, np.nan), ListedColormap([COLOUR_SCALE[0]])
            axes.pcolormesh(right, up, shown.T, cmap=colours, shading="nearest", rasterized=True)
        else:
            scale = LinearSegmentedColormap.from_list("share", COLOUR_SCALE)
            drawn = axes.pcolormesh(right, up, 100 * cut.shares.T, cmap=scale, vmin=0, vmax=100, shading="nearest",
                                    rasterized=True)  # fmt: skip
            bar = axes.figure.colorbar(drawn, ax=axes, shrink=0.8)
            bar.set_label("orientations, %")
        axes.add_collection(LineCollection(list(MM.of(cut.vertices[cut.segments])), colors=INK, linewidths=1.0))
        axes.set_aspect("equal")
        axes.set(xlabel=f"{first}, mm", ylabel=f"{second}, mm", title=level)
        axes.locator_params(nbins=6)

    return figure_picture(name, f"Section {first}-{second} at {level}", (4.6, 3.9), draw, (0.8, 0.5, 0.3, 0.3))
