"""What a person reads of a payload: mass and centre, how sure, what is not identifiable, and goodness of fit."""

import numpy as np

from lab.commands.provenance import provenance_section
from lab.core.se3 import Array
from lab.core.serials import called
from lab.extensions.dynamics.payload.estimate import LoadEstimate
from lab.extensions.dynamics.payload.result import PayloadResult, channels_of
from lab.kinematics.dynamics.rigid_body import inertia_about_centre
from lab.render.charts.axes import Axes
from lab.render.document import (
    RECORDING,
    Badge,
    Block,
    Bullets,
    Document,
    Figure,
    Paragraph,
    Picture,
    Section,
    Strong,
    Table,
    Warnings,
)
from lab.render.format import capital, sentence, short
from lab.render.style import MEASURED, PREDICTED
from lab.render.svg import axes_picture

__all__ = ["channel_pictures", "parameter_rows", "payload_document", "true_values"]

MOST_DRAWN = 600  # rows
_UNITS = {"s": (1e3, "ms"), "rad": (180 / np.pi, "°")}  # by which a person reads a number of a unit
_FIT = {True: Badge("no lack of fit", "good"), False: Badge("lack of fit", "bad"), None: Badge("not judged")}


def payload_document(result: PayloadResult) -> Document:
    """The payload with its intervals, the goodness of fit, the cost of its uncertainty, and what was not identified."""
    found = result.estimate
    known = np.isfinite(found.mass_kg)
    mass = f"{found.mass_kg:.4g} kg at the flange" if known else "a payload whose mass is not identifiable"
    return Document(
        f"{called(result.robot.name, result.options.serial)}: {mass}",
        (
            Paragraph(f"{capital(found.method)}: {found.rank} of {found.columns} parameters identified.", "lead"),
            Paragraph((_FIT[found.adequate], f" {sentence(found.verdict.words)}")),
            Warnings(result.warnings),
            Section("The payload", _payload(result)),
            Section("What its uncertainty costs", (Paragraph(_cost(result)),)),
            Section("Not identifiable", (Bullets(tuple(map(sentence, found.unidentified))),)),
            Section("Fitted along with it", (_nuisance(found),)),
            Section("Measured and explained", (_explained(result),)),
            Section("What is shown", (Bullets(_LEGEND),), shown_in=RECORDING),
            provenance_section("payload", result.options, result.robot.sha256, result.options.serial),
        ),
    )


_LEGEND = (
    (Strong("green"), ": the payload, as the solid ellipsoid with its mass and inertia (a ball of steel where that is "
     "not known)"),
    (Strong("red"), ": its weight"),
    ("curves: ", Strong("green"), " with the payload, ", Strong("grey"), " without"),
)  # fmt: skip


def parameter_rows(found: LoadEstimate) -> list[tuple[str, float, float, str]]:
    """Name, value, half-width of the 95 % interval and unit (mm for lengths) of every parameter that is identified."""
    rows = [("mass", found.mass_kg, found.mass_half_width_kg, 1.0, "kg")]
    for i, axis in enumerate("xyz"):
        rows.append((f"centre of mass, {axis}", found.com_m[i], found.com_half_width[i], 1e3, "mm"))
    for i, j in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2)):
        value, width = found.inertia_com_kgm2[i, j], found.inertia_com_half_width[i, j]
        rows.append((f"I{'xyz'[i]}{'xyz'[j]} about the centre of mass", value, width, 1e4, "kg cm²"))
    identified = [row for row in rows if np.isfinite(row[1])]
    return [(name, float(scale * value), float(scale * width), unit) for name, value, width, scale, unit in identified]


def true_values(phi: Array) -> dict[str, float]:
    """What a virtual payload has, by the names of ``parameter_rows`` and in their units."""
    inertia = inertia_about_centre(phi)
    values = {"mass": float(phi[0])}
    values |= {f"centre of mass, {axis}": float(1e3 * phi[1 + i] / phi[0]) for i, axis in enumerate("xyz")}
    pairs = ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))
    names = {(i, j): f"I{'xyz'[i]}{'xyz'[j]} about the centre of mass" for i, j in pairs}
    return values | {name: float(1e4 * inertia[cell]) for cell, name in names.items()}


def channel_pictures(result: PayloadResult) -> tuple[Picture, ...]:
    """Each channel: what was measured, and what the payload with what was fitted along makes of it."""
    found = result.estimate
    every = max(1, len(found.measured) // MOST_DRAWN)
    measured, left = found.measured[::every], found.residual[::every]
    pictures = []
    for i, (name, unit) in enumerate(channels_of(result)):

        def draw(axes: Axes, i: int = i, name: str = name, unit: str = unit) -> None:
            at = np.arange(len(measured)) * every
            axes.plot(at, measured[:, i], ".", color=MEASURED, markersize=3, label="measured")
            axes.plot(at, measured[:, i] - left[:, i], "-", color=PREDICTED, linewidth=1, label="explained")
            axes.set(title=name, xlabel="row, as thinned", ylabel=unit)
            if i == 0:
                axes.legend(loc="best")

        label = f"{name}, measured and explained"
        pictures.append(axes_picture(f"channel{i}", label, (4.4, 2.3), draw, (0.7, 0.45, 0.1, 0.3)))
    return tuple(pictures)


def _payload(result: PayloadResult) -> tuple[Block, ...]:
    found = parameter_rows(result.estimate)
    rows: tuple[tuple[str, ...], ...] = tuple(
        (name, *_rounded(value, width), unit) for name, value, width, unit in found
    )
    columns: tuple[str, ...] = ("", "value", "±", "unit")
    if result.truth is not None:
        columns = (*columns, "true")
        truth = true_values(result.truth)
        rows = tuple((*row, short(truth[row[0]])) for row in rows)
    caption = f"About and along the frame of the {result.estimate.frame}, with half-widths of 95 % intervals."
    physical = "No body has what least squares found: these are the nearest parameters that one has."
    note = Paragraph(physical if result.estimate.moved else "", "note")
    return Table(columns, rows, caption), note


def _rounded(value: float, half_width: float) -> tuple[str, str]:
    """A value to the second digit of its half-width."""
    digits = max(0, 1 - int(np.floor(np.log10(half_width)))) if half_width > 0 else 6
    return f"{value:.{min(digits, 9)}f}".replace("-", "−"), f"{half_width:.{min(digits, 9)}f}"


def _cost(result: PayloadResult) -> str:
    """What the payload's uncertainty costs; nothing where its weight was not identified."""
    if not np.isfinite(result.cost.rms_m):
        return ""
    soft = result.cost.compliance[result.cost.compliance > 0]
    alike = len(soft) and np.ptp(soft) < 1e-9 * soft[0]
    stiffness = f"joints of {1 / soft[0]:,.6g} Nm/rad" if alike else "joints of the identified stiffness"
    return (
        f"Its uncertainty moves a point that is corrected for it by {1e6 * result.cost.rms_m:.2g} µm (1σ, root mean "
        f"square over the workspace, {stiffness})."
    )


def _nuisance(found: LoadEstimate) -> Table:
    rows = []
    for each in found.nuisance:
        scale, unit = _UNITS.get(each.unit, (1.0, each.unit))
        rows.append((each.name, short(scale * each.value), short(scale * each.half_width), unit))
    return Table(("", "value", "±", "unit"), tuple(rows))


def _explained(result: PayloadResult) -> Figure:
    caption = "What the payload adds, as measured, and as the payload and what was fitted along explain it."
    return Figure("explained", channel_pictures(result), caption)
