"""Document of a workspace."""

from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from lab.core.errors import counted
from lab.core.number_text import short
from lab.core.se3 import Array
from lab.core.units import MM
from lab.extensions.robotics.workspace.measure import PlaneSection
from lab.library.result import printed
from lab.report.charts.chart import axes_picture, shades
from lab.report.charts.marks import Axes
from lab.report.comparison_plots import bars_picture
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
)
from lab.report.scene import moved
from lab.report.style import COLOUR_SCALE, INK, MUTED, RGB_MAPPING, rgb
from lab.report.surfaces import halved
from lab.report.view import View

if TYPE_CHECKING:
    import trimesh

    from lab.report.page_scene import ArmScene
from lab.extensions.robotics.workspace.workspace_result import RobotWorkspace, WorkspaceResult

__all__ = ["VIEW", "main_picture", "workspace_document"]

VIEW = View(f"{__name__}:workspace_document", f"{__name__}:main_picture")


def main_picture(result: WorkspaceResult) -> Picture:
    """Return the main figure."""
    return _section_pictures(result.robots[0])[0] if len(result.robots) == 1 else _size_picture(result)


def workspace_document(result: WorkspaceResult) -> Document:
    """Build the document of the result."""
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
    values, measured = each.to_dict(), each.space.measured
    numbers = [("reaches", _size(each, each.size), "after")]
    if each.reach_m is not None:
        low, high = (printed(round(MM.of(end))) for end in each.reach_m)
        numbers.append(("from axis 1", f"{low} … {high} mm", ""))
    if (turned := values["orientations"]) is not None:
        numbers.append(("orientations there, in the mean", f"{100 * turned['mean_share']:.0f} %", ""))
    badge = Badge("no enclosed void", "good")
    if measured.voids:
        badge = Badge(counted(len(measured.voids), "enclosed void"), "doubtful")
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
        measured, ends, share = each.space.measured, each.reach_m, each.to_dict()["orientations"]
        rows.append((
            each.robot.name, _size(each, each.size), f"{_size(each, measured.size)} ± {measured.standard_error:.2g}",
            "–" if ends is None else f"{printed(round(MM.of(ends[0])))} … {printed(round(MM.of(ends[1])))}",
            str(len(measured.voids)), "–" if share is None else f"{100 * share['mean_share']:.0f} %",
        ))  # fmt: skip
    columns = ("robot", "size", "by Monte Carlo", "from axis 1, mm", "voids", "orientations")
    return Section("Comparison", (Table(columns, tuple(rows)),))


def _size_picture(result: WorkspaceResult) -> Picture:
    robots = result.robots
    kinds = dict.fromkeys("area, m²" if each.plane else "volume, m³" for each in robots)
    texts = [_size(each, each.size) for each in robots]
    names, sizes = [each.robot.name for each in robots], [each.size for each in robots]
    return bars_picture("sizes", "Sizes of the workspaces", names, sizes, texts, ", or ".join(kinds))


def _lines(each: RobotWorkspace) -> tuple[str, ...]:
    values, measured, space = each.to_dict(), each.space.measured, each.space
    name = "area" if each.plane else "volume"
    by = "the closed form" if space.by_place.exact else "a search"
    carlo = (
        f"{_size(each, measured.size)} ± {measured.standard_error:.2g} (1σ) by Monte Carlo: "
        f"{len(measured.reached):,} places "
        f"in cells of {short(MM.of(measured.cell_m))} mm, reached or not by {by}"
    )
    first = f"{name} {carlo}" if space.by_sections is None else f"{name} {_size(each, each.size)} by sections; {carlo}"
    ends = ", ".join(
        f"{axis} {printed(round(low))} … {printed(round(high))}" for axis, (low, high) in values["extents_mm"].items()
    )
    lines = [first, f"it lies within {ends} mm of the base"]
    if each.reach_m is not None:
        low, high = (printed(round(MM.of(end), 1)) for end in each.reach_m)
        lines.append(f"reach from axis 1: {low} … {high} mm")
    voids = ", ".join(_size(each, size) for size in measured.voids)
    if voids:
        lines.append(f"{counted(len(measured.voids), 'enclosed void')} of about {voids}")
    else:
        lines.append(f"no enclosed void wider than {short(3e3 * measured.cell_m)} mm")
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
        axes.pcolormesh(_edges(MM.of(cut.right)), _edges(MM.of(cut.up)), colours)
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
