"""Results of ``lab workspace``: typed, as plain values, and as a document."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from lab.core.errors import counted
from lab.core.random import rng_for
from lab.core.se3 import Array
from lab.core.units import MM
from lab.extensions.robotics.workspace.measure import PlaneSection, Workspace
from lab.extensions.robotics.workspace.workspace_options import WorkspaceOptions
from lab.formats.csv_table import write_columns
from lab.library.result import Result, number, printed, tidy
from lab.report.charts.chart import axes_picture, shades
from lab.report.charts.marks import Axes
from lab.report.document import (
    Badge,
    Bullets,
    Card,
    Document,
    Figure,
    Picture,
    Scene,
    Section,
    Table,
    Warnings,
    guarded,
    short,
)
from lab.report.scene import moved
from lab.report.style import AFTER, COLOUR_SCALE, INK, MUTED, RGB_MAPPING, rgb
from lab.report.surfaces import halved, mesh_of, write_stl
from lab.robots.robot import Robot

if TYPE_CHECKING:
    import trimesh

    from lab.report.page_scene import ArmScene

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
    shown_by = "lab.extensions.robotics.workspace.workspace_result:_workspace_document"
    drawn_by = "lab.extensions.robotics.workspace.workspace_result:_main_picture"

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


def _main_picture(result: WorkspaceResult) -> Picture:
    return _section_pictures(result.robots[0])[0] if len(result.robots) == 1 else _size_picture(result)


def _workspace_document(result: WorkspaceResult) -> Document:
    several = len(result.robots) > 1
    return Document(
        f"Workspaces of {len(result.robots)} robots" if several else _title(result.robots[0]),
        (
            _comparison_card(result) if several else _card(result.robots[0]),
            Warnings(result.warnings),
            *((_comparison(result),) if several else ()),
            *(
                Section(
                    each.robot.name if several else "Workspace",
                    (
                        Scene(f"workspace-scene-{i + 1}", partial(_page_scene, each, mesh), _SCENE[each.plane]),
                        Bullets(_lines(each)),
                        Figure(f"sections-{i + 1}", _section_pictures(each, i), _caption(each)),
                    ),
                )
                for i, (each, mesh) in enumerate(zip(result.robots, result.meshes, strict=True))
            ),
        ),
    )


_SCENE = {  # of volumes and of areas
    False: "The robot at home within the boundary of what its tool reaches, cut open at y = 0, with the edges of the "
    "sections.",
    True: "The robot at home, with the edge of what its tool reaches.",
}


@guarded
def _card(each: RobotWorkspace) -> Card:
    """Summarise one robot's workspace: its size, how far it reaches, in how many orientations, and what to do."""
    values, found = each.to_dict(), each.space.measured
    numbers = [("reaches", _size(each, each.size), "after")]
    if each.reach_m is not None:
        low, high = (printed(round(MM.of(end))) for end in each.reach_m)
        numbers.append(("from axis 1", f"{low} … {high} mm", ""))
    if (turned := values["orientations"]) is not None:
        numbers.append(("orientations there, in the mean", f"{100 * turned['mean_share']:.0f} %", ""))
    badge = Badge("no enclosed void", "good")
    if found.voids:
        badge = Badge(counted(len(found.voids), "enclosed void"), "doubtful")
    cell, step = values["cell"], "Give your cell with --cell to see what is left of it among its obstacles."
    if cell is not None:
        numbers.append((f"free in {cell['name']}", f"{100 * cell['free_share']:.0f} %", ""))
        step = "Plan poses in it with lab design, or a motion with lab trajectory."
    by = "the closed form of the inverse" if each.space.by_place.exact else "a search for an inverse"
    about = f"What the tool's point reaches, by {by} at each place."
    return Card(("Workspace: ", badge), tuple(numbers), about, step)


@guarded
def _comparison_card(result: WorkspaceResult) -> Card:
    """Summarise several workspaces: which robot reaches most."""
    order = sorted(result.robots, key=lambda each: -each.size)
    numbers = tuple((each.robot.name, _size(each, each.size), "after" * (not i)) for i, each in enumerate(order[:4]))
    alike = len({each.plane for each in order}) == 1
    verdict = ("Largest: ", Badge(order[0].robot.name)) if alike else ("Areas and volumes",)
    step = "Choose by size, voids and orientations below; then lab workspace of one robot with --cell."
    figure = Figure("sizes", (_size_picture(result),), "What each robot reaches.")
    return Card(verdict, numbers, "Sizes of what the tools' points reach.", step, (figure,))


def _page_scene(each: RobotWorkspace, mesh: "trimesh.Trimesh") -> "ArmScene":
    """The robot at home, the boundary of its workspace cut open, and the edges of its sections."""
    from lab.report.page_scene import Line, Surface, posed_arm

    model, arm = each.robot.model, each.space.arm
    T = model.T_world_frame0
    posed = posed_arm(model, arm, each.space.values, arm.chain.home[None], ["home"])
    half, lines, surfaces = halved(mesh), list[Line](), list[Surface]()
    if len(half.faces):
        surfaces.append(Surface("boundary", moved(T, np.asarray(half.vertices)), np.asarray(half.faces), RGB_MAPPING))
    for section in each.sections:
        places = np.full((len(section.vertices), 3), section.level_m)
        places[:, section.axes] = section.vertices
        ends = moved(T, places)[section.segments]  # (k, 2, 3), parted by a point that is not drawn
        points = np.concatenate([ends, np.full((len(ends), 1, 3), np.nan)], axis=1).reshape(-1, 3)
        name = "section " + "".join("xyz"[axis] for axis in section.axes)
        lines.append(Line(name, points, rgb(MUTED)))
    return replace(posed, lines=lines, surfaces=surfaces, all_text="")


def _title(each: RobotWorkspace) -> str:
    kind = "an area" if each.plane else "a volume"
    return f"{each.robot.name} reaches {kind} of {_size(each, each.size)}"


def _size(each: RobotWorkspace, value: float) -> str:
    return f"{value:.4g} {'m²' if each.plane else 'm³'}"


@guarded
def _comparison(result: WorkspaceResult) -> Section:
    rows = []
    for each in result.robots:
        found, ends, share = each.space.measured, each.reach_m, each.to_dict()["orientations"]
        rows.append((
            each.robot.name, _size(each, each.size), f"{_size(each, found.size)} ± {found.standard_error:.2g}",
            "–" if ends is None else f"{printed(round(MM.of(ends[0])))} … {printed(round(MM.of(ends[1])))}",
            str(len(found.voids)), "–" if share is None else f"{100 * share['mean_share']:.0f} %",
        ))  # fmt: skip
    columns = ("robot", "size", "by Monte Carlo", "from axis 1, mm", "voids", "orientations")
    return Section("Comparison", (Table(columns, tuple(rows)),))


def _size_picture(result: WorkspaceResult) -> Picture:
    robots = result.robots
    sizes, largest = [each.size for each in robots], max(each.size for each in robots)

    def draw(axes: Axes) -> None:
        at = np.arange(len(robots))[::-1]
        axes.barh(at, sizes, color=AFTER, height=0.6)
        for place, each in zip(at, robots, strict=True):
            axes.annotate(_size(each, each.size), (each.size + 0.01 * largest, place), va="center", fontsize=8)
        axes.set_yticks(at, [each.robot.name for each in robots])
        kinds = dict.fromkeys("area, m²" if each.plane else "volume, m³" for each in robots)
        axes.set(xlabel=", or ".join(kinds), xlim=(0, 1.2 * largest))

    height = 0.8 + 0.32 * len(robots)
    return axes_picture("sizes", "Sizes of the workspaces", (5.6, height), draw, (1.9, 0.5, 0.15, 0.1))


def _lines(each: RobotWorkspace) -> tuple[str, ...]:
    values, found, space = each.to_dict(), each.space.measured, each.space
    name = "area" if each.plane else "volume"
    by = "the closed form" if space.by_place.exact else "a search"
    carlo = (
        f"{_size(each, found.size)} ± {found.standard_error:.2g} (1σ) by Monte Carlo: {len(found.reached):,} places "
        f"in cells of {short(MM.of(found.cell_m))} mm, reached or not by {by}"
    )
    first = f"{name} {carlo}" if space.by_sections is None else f"{name} {_size(each, each.size)} by sections; {carlo}"
    ends = ", ".join(
        f"{axis} {printed(round(low))} … {printed(round(high))}" for axis, (low, high) in values["extents_mm"].items()
    )
    lines = [first, f"it lies within {ends} mm of the base"]
    if each.reach_m is not None:
        low, high = (printed(round(MM.of(end), 1)) for end in each.reach_m)
        lines.append(f"reach from axis 1: {low} … {high} mm")
    voids = ", ".join(_size(each, size) for size in found.voids)
    if voids:
        lines.append(f"{counted(len(found.voids), 'enclosed void')} of about {voids}")
    else:
        lines.append(f"no enclosed void wider than {short(3e3 * found.cell_m)} mm")
    lines.append(_orientations(each, values["orientations"]))
    if (cell := values["cell"]) is not None:
        lines.append(
            f"in the cell {cell['name']} {100 * cell['free_share']:.0f} % "
            f"(± {100 * cell['free_share_standard_error']:.0f} %) of it is reached without a collision, "
            f"{_size(each, cell['free_size'])}"
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
    return tuple(
        _section(cut, f"section-{which + 1}-{'xyz'[cut.axes[0]]}{'xyz'[cut.axes[1]]}") for cut in each.sections
    )


def _section(cut: PlaneSection, name: str) -> Picture:
    first, second = ("xyz"[axis] for axis in cut.axes)
    third = "xyz"[3 - sum(cut.axes)]
    level = f"{third} = {printed(round(MM.of(cut.level_m)))} mm"

    def draw(axes: Axes) -> None:
        shares = np.where(cut.reached, 0.0, np.nan) if cut.shares is None else cut.shares
        colours = shades(shares.T, COLOUR_SCALE)
        axes.pcolormesh(_edges(MM.of(cut.right)), _edges(MM.of(cut.up)), colours, rasterized=True)
        ends = MM.of(cut.vertices[cut.segments])  # (s, 2, 2)
        lines = np.concatenate([ends, np.full((len(ends), 1, 2), np.nan)], axis=1).reshape(-1, 2)
        axes.plot(lines[:, 0], lines[:, 1], color=INK, linewidth=1.0)
        axes.set_aspect("equal")
        axes.set(xlabel=f"{first}, mm", ylabel=f"{second}, mm", title=level)
        axes.locator_params(nbins=6)
        if cut.shares is not None:
            bar = axes.inset_axes((1.04, 0.1, 0.04, 0.8))
            bar.pcolormesh([0, 1], np.linspace(0, 1, 65), shades(np.linspace(0, 1, 64), COLOUR_SCALE)[:, None])
            bar.set(xlim=(0, 1), ylim=(0, 1), title="orientations")
            bar.set_xticks([])
            bar.set_yticks([])
            for share in (0.0, 0.5, 1.0):
                bar.annotate(f"{100 * share:.0f} %", (1.3, share), xycoords="axes fraction", va="center")

    return axes_picture(name, f"Section {first}-{second} at {level}", (4.6, 3.9), draw, (0.8, 0.5, 0.9, 0.3))


def _edges(centres: Array) -> Array:
    """Edges ``(n+1,)`` of cells with evenly spaced centres ``(n,)``."""
    half = (centres[1] - centres[0]) / 2 if len(centres) > 1 else 0.5
    return np.append(centres - half, centres[-1] + half)
