"""Document of a rotation in all notations."""

from collections.abc import Callable

import numpy as np

from lab.core.number_text import fixed
from lab.extensions.robotics.kinematics.rotation import Rotation, determined
from lab.report.document import Bullets, Document, Paragraph, Row, Section, Table, Warnings
from lab.report.view import View

__all__ = ["VIEW", "rotation_document"]

VIEW = View(f"{__name__}:rotation_document")

_NAMES = {"zyx": "yaw, pitch, roll", "xyz": "Bryant", "zxz": "Euler"}  # the order's other name


def rotation_document(result: Rotation) -> Document:
    """Build the document of the result."""
    unit = "rad" if result.options.radians else "°"
    digits = 6 if result.options.radians else 4

    def shown(angle: float) -> str:
        return fixed(result.in_unit(angle), digits)

    matrix = Table(("", "", ""), tuple(tuple(fixed(each, 6) for each in row + 0.0) for row in result.matrix))
    w, x, y, z = (fixed(each, 6) for each in result.quaternion)
    other = ", ".join(fixed(-each + 0.0, 6) for each in result.quaternion)
    lines = [f"quaternion wxyz ({w}, {x}, {y}, {z}), and its negative ({other})", *_axis_lines(result, shown, unit)]
    note = (
        "zyx is R = Rz(a) Ry(b) Rx(c), about moving axes. About fixed axes the same turns come in reverse order: x by "
        "c, then y by b, then z by a. Each order has two solutions."
    )
    return Document(
        f"A rotation by {shown(result.axis.angle)} {unit}",
        (
            Warnings(result.warnings),
            Section("Matrix of direction cosines", (matrix,)),
            Section("Quaternion, axis and angle", (Bullets(tuple(lines)),)),
            Section("Angles in twelve orders", (Paragraph(note), _angles(result, shown, unit))),
        ),
    )


def _angles(result: Rotation, shown: Callable[[float], str], unit: str) -> Table:
    """Tabulate both solutions of each order of turns; the column of remarks is left out where there are none."""
    rows = list[Row]()
    for each in result.angles:
        name = f" ({_NAMES[each.order]})" if each.order in _NAMES else ""
        note = f"singular: {determined(each)} alone is determined" if each.free else ""
        for i, row in enumerate(each.solutions):
            rows.append(("" if i else f"{each.order}{name}", *map(shown, row), note))
    heads = ("order", *(f"{name}, {unit}" for name in "abc"), "remark")
    count = len(heads) if any(row[-1] for row in rows) else len(heads) - 1
    return Table(heads[:count], tuple(row[:count] for row in rows))


def _axis_lines(result: Rotation, shown: Callable[[float], str], unit: str) -> list[str]:
    """Describe axis and angle with the other solution, and the axis by the two angles that turn z to it."""
    axis, angle = result.axis.axis, shown(result.axis.angle)
    if np.isnan(axis).any():
        return [f"angle {angle} {unit}: nothing is turned, and any axis will do (singular)"]
    plus, minus = (", ".join(fixed(each, 6) for each in sign * axis + 0.0) for sign in (1, -1))
    lines = [f"axis ({plus}), angle {angle} {unit}, or axis ({minus}), angle {shown(-result.axis.angle)} {unit}"]
    if result.axis.both_axes:
        lines.append("half a turn: both axes do with either angle, so that the axis' sign is free (singular)")
    pairs = " or ".join(f"α {shown(alpha)}, β {shown(beta)} {unit}" for alpha, beta in result.axis_directions())
    return [*lines, f"the axis is Rz(α) Rx(β) z with {pairs}"]
