"""Result of inspecting a robot: its description and its identifiable parameters, as plain values."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from lab.campaign.robot import Robot
from lab.commands.inspect.cell import cell_section
from lab.commands.inspect.closed import closed_blocks
from lab.commands.inspect.options import InspectOptions
from lab.commands.inspect.serial import serial_blocks
from lab.commands.result import Result, coefficient, per_person
from lab.core.se3 import Array
from lab.kinematics.parameter import Parameter
from lab.render.charts.chart import axes_picture, log_ticks
from lab.render.charts.marks import Axes
from lab.render.document import Block, Bullets, Document, Figure, Paragraph, Picture, Section, Table, Warnings
from lab.render.style import PREDICTED

if TYPE_CHECKING:
    from lab.render.document import Document

__all__ = ["Inspection", "singular_values_picture"]


@dataclass(frozen=True, repr=False, eq=False)
class Inspection(Result):
    """A robot's nominal model, its limits, its shape, and what of it can be identified.

    Attributes:
        options: what was asked.
        values: what ``to_dict`` gives: millimetres and degrees; aliases in SI units.
        parameters: all of the arm, in the order of its values.
        singular_values: ``(r,)`` of the Jacobian with unit columns over random poses, largest first.
    """

    command = "inspect"
    shown_by = "lab.commands.inspect.result:_inspection_document"
    drawn_by = "lab.commands.inspect.result:singular_values_picture"

    options: InspectOptions
    robot: Robot
    values: Mapping[str, Any]
    parameters: tuple[Parameter, ...]
    singular_values: Array

    @property
    def model_sha256(self) -> str:
        """Digest of the robot's description."""
        return self.robot.sha256

    @property
    def warnings(self) -> tuple[str, ...]:
        """Warnings on the robot."""
        return self.robot.warnings

    def to_dict(self) -> dict[str, Any]:
        """Return the values for ``--json``: millimetres and degrees; aliases in SI units; None where not finite."""
        return dict(self.values)

    def columns(self) -> Mapping[str, Sequence[Any]]:
        """A row for each parameter that is identifiable or aliased: its name, and with what it is aliased."""
        kept, aliases = self.values["identifiable"], self.values["aliases"]
        return {
            "parameter": [*kept, *aliases],
            "identifiable": [True] * len(kept) + [False] * len(aliases),
            "aliased_with": [""] * len(kept) + [", ".join(into) for into in aliases.values()],
        }


def _inspection_document(result: Inspection) -> Document:
    """The nominal model and the shape, then what can be identified, what is fixed, and what is weakly observable."""
    values = result.values
    shape = closed_blocks(values) if "mobility" in values else serial_blocks(values)
    return Document(
        f"{values['robot']}: {values['rank']} of {values['parameters']} parameters are identifiable",
        (
            Warnings(result.warnings),
            Section("Nominal model and shape", tuple(shape)),
            *((cell_section(values, result.robot),) if "cell" in values else ()),
            Section("Identifiability", (*_identifiable(result), *_fixed(result))),
            Section("Conditioning", tuple(_conditioning(result))),
        ),
    )


def singular_values_picture(result: Inspection) -> Picture:
    """Singular values relative to the largest, from the best observable direction to the worst."""
    relative = result.singular_values / result.singular_values[0]

    def draw(axes: Axes) -> None:
        axes.plot(np.arange(1, len(relative) + 1), relative, "o", color=PREDICTED, markersize=4.5)
        log_ticks(axes, "y", relative.min() / 1.6, 1.7)
        axes.set(xlabel="direction, from the best observable to the worst", ylabel="relative singular value")

    return axes_picture(
        "singular-values", "Singular values of the scaled Jacobian", (5.6, 2.8), draw, (0.8, 0.5, 0.2, 0.15)
    )


def _identifiable(result: Inspection) -> tuple[Block, ...]:
    """The identifiable parameters, by group."""
    values = result.values
    names = [name.rsplit(".", 1) for name in values["identifiable"]]
    groups = dict.fromkeys(sorted((group for group, _ in names), key=_group_order))
    rows = tuple((group, " ".join(last for other, last in names if other == group)) for group in groups)
    left = ""
    if "not_fixed" in values and result.options.fix:
        left = f" ({values['rank']} of the {values['not_fixed']} that --fix leaves)"
    text = (
        f"{values['rank']} of {values['parameters']} parameters{left} can be identified from positions of "
        f"{', '.join(values['targets'])}, from {values['poses_needed']} poses or more:"
    )
    return Paragraph(text), Table(("", ""), rows)


def _group_order(group: str) -> tuple[bool, str]:
    """Groups as they come, but joints in their order."""
    return (True, group) if group.startswith("joint") else (False, "")


def _fixed(result: Inspection) -> tuple[Block, ...]:
    """The parameters that are fixed at nominal, and why."""
    values = result.values
    fixed = f"fixed at nominal by --fix, though identifiable: {', '.join(values['held'])}" if values["held"] else ""
    others = ", ".join(values["told_apart"])
    freed = f"identifiable only because others are fixed; --free would identify any one of them: {others}"
    named = {parameter.name: parameter for parameter in result.parameters}
    aliases = []
    for name, into in values["aliases"].items():
        parts = (coefficient(named[name], named[other], value) for other, value in into.items())
        aliases.append(f"{name} is aliased with {', '.join(parts) or 'nothing: it moves no target'}")
    return (
        Bullets((fixed, freed if others else "")),
        Paragraph("Fixed at nominal, because an error of it looks like errors of others:" if aliases else ""),
        Bullets(tuple(aliases)),
    )


def _conditioning(result: Inspection) -> list[Block]:
    """The condition number, weakly observable directions, and what would help."""
    values = result.values
    named = {parameter.name: parameter for parameter in result.parameters}
    weak = []
    for direction in values["weak_directions"]:
        parts = ", ".join(f"{name} {per_person(named[name], value)}" for name, value in direction["parts"].items())
        weak.append(
            f"weakly observable, relative singular value 1/{1 / direction['singular_value']:.0f}: {parts} move the "
            f"targets by {1e3 * direction['moved_mm']:.2g} µm"
        )
    better = (f"with {words} the condition number would be {number:.1f}" for words, number in values["changes"].items())
    caption = "Singular values over random poses, columns of unit length; a logarithmic axis."
    return [
        Paragraph(f"condition number over random poses, with unit columns: {values['condition']:.1f}"),
        Bullets((*weak, *better)),
        Figure("singular-values-figure", (singular_values_picture(result),), caption),
    ]
