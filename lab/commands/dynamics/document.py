"""What a person reads of an arm's dynamics: its base parameters, and what is grouped into each."""

from typing import TYPE_CHECKING

import numpy as np

from lab.commands.dynamics.result import DynamicsResult
from lab.commands.provenance import provenance_section
from lab.render.document import Document, Figure, Paragraph, Picture, Section, Table, Warnings
from lab.render.style import PREDICTED
from lab.render.svg import axes_picture, log_ticks

if TYPE_CHECKING:
    from matplotlib.axes import Axes

__all__ = ["dynamics_document", "singular_values_picture"]


def dynamics_document(result: DynamicsResult) -> Document:
    """The base parameters with their formulas, what affects no torque, and the conditioning."""
    base = result.base
    return Document(
        f"{result.robot.name}: {base.size} base parameters of {len(base.names)} standard ones",
        (
            Warnings(result.warnings),
            Section("Base parameters", (Paragraph(_counts(result)), _formulas(result), Paragraph(_without(result)))),
            Section("Conditioning", (_conditioning(result),)),
            provenance_section("dynamics", result.options, result.robot.sha256),
        ),
    )


def singular_values_picture(result: DynamicsResult) -> Picture:
    """Singular values relative to the largest, from the best determined direction to the worst."""
    relative = np.array(result.singular_values) / result.singular_values[0]

    def draw(axes: "Axes") -> None:
        axes.plot(np.arange(1, len(relative) + 1), relative, "o", color=PREDICTED, markersize=4.5)
        log_ticks(axes, "y", relative.min() / 1.6, 1.7)
        axes.set(xlabel="direction, from the best determined to the worst", ylabel="relative singular value")

    words = "Singular values of the base regressor with unit columns"
    return axes_picture("singular-values", words, (5.6, 2.8), draw, (0.8, 0.5, 0.2, 0.15))


def _counts(result: DynamicsResult) -> str:
    base, others = result.base, result.base.size - result.base.inertial
    left = f" ({', '.join(result.options.without)} left out)" if result.options.without else ""
    return (
        f"The torques determine {base.inertial} parameters of links and motors, and {others} of friction and offsets"
        f"{left}. The rest is grouped into them, with these coefficients of the table's lengths:"
    )


def _formulas(result: DynamicsResult) -> Table:
    names = [formula.name for formula in result.formulas]
    units = result.arm.units(names)
    rows = tuple((formula.label, formula.words(), unit) for formula, unit in zip(result.formulas, units, strict=True))
    caption = (
        "XX to ZZ: inertia about and along the frame on the joint's axis; MX MY MZ: first moments; M: mass; Ia: motor "
        "inertia; Fc, Fv: Coulomb and viscous friction; off: offset. R: others are grouped into it."
    )
    return Table(("base parameter", "is", "unit"), rows, caption)


def _without(result: DynamicsResult) -> str:
    names = [result.base.names[i] for i in result.base.without_effect]
    return f"No torque depends on {', '.join(names)}." if names else ""


def _conditioning(result: DynamicsResult) -> Figure:
    condition = result.singular_values[0] / result.singular_values[-1]
    caption = f"Over random states, columns of unit length; the condition number is {condition:.0f}."
    return Figure("singular-values-figure", (singular_values_picture(result),), caption)
