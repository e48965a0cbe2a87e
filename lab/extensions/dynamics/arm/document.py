"""What a person reads of an arm's dynamics: its base parameters, and what is grouped into each."""

import numpy as np

from lab.commands.provenance import provenance_section
from lab.core.serials import called
from lab.core.significance import PAYLOAD_RESIDUALS
from lab.extensions.dynamics.arm.estimate import DynamicsEstimate
from lab.extensions.dynamics.arm.result import DynamicsResult
from lab.extensions.dynamics.payload.document import parameter_rows, true_values
from lab.render.charts.axes import Axes
from lab.render.document import (
    EVERYWHERE,
    PAGE,
    Badge,
    Block,
    Document,
    Figure,
    Paragraph,
    Picture,
    Section,
    Table,
    Warnings,
)
from lab.render.format import digits_of, fixed, sentence, short
from lab.render.style import MEASURED, PREDICTED
from lab.render.svg import axes_picture, log_ticks

__all__ = ["dynamics_document", "singular_values_picture", "torque_pictures"]

MOST_DRAWN = 600  # rows
ROUNDING = 1e-12  # of what is true, SI


def dynamics_document(result: DynamicsResult) -> Document:
    """The base parameters with their formulas, what affects no torque, and the conditioning."""
    base, found = result.base, result.estimate
    grouping = (Paragraph(_counts(result)), _formulas(result), Paragraph(_without(result)))
    name = called(result.robot.name, result.options.serial)
    return Document(
        f"{name}: {base.size} base parameters of {len(base.names)} standard ones",
        (
            *(
                ()
                if found is None
                else (Paragraph((_FIT[found.verdict.adequate], f" {sentence(found.verdict.words)}")),)
            ),
            Warnings(result.warnings),
            *(() if found is None else _identified(result, found)),
            Section("Base parameters", grouping, shown_in=EVERYWHERE if found is None else PAGE),
            Section("Conditioning", (_conditioning(result),), shown_in=EVERYWHERE if found is None else PAGE),
            provenance_section("dynamics", result.options, result.robot.sha256, result.options.serial),
        ),
    )


_FIT = {True: Badge("no lack of fit", "good"), False: Badge("lack of fit", "bad"), None: Badge("not judged")}


def _identified(result: DynamicsResult, found: DynamicsEstimate) -> tuple[Section, ...]:
    """What was identified, how it predicts, the load beside it, and the torques."""
    caption = "Measured torques, and what the parameters make of them."
    return (
        Section("Identified parameters", (_values(result, found), Paragraph(_noise(result, found)))),
        Section("Physical consistency", (Paragraph(_physical(result)),)),
        Section("Predicted torques", (_predictions(result, found),)),
        Section("The load", _loads(result, found)),
        Section("Measured and explained", (Figure("torques", torque_pictures(result), caption),), shown_in=PAGE),
    )


def _values(result: DynamicsResult, found: DynamicsEstimate) -> Table:
    """Values to the second digit of their half-widths, with relative standard deviations."""
    units = result.arm.units([formula.name for formula in result.formulas])
    rows: list[tuple[str, ...]] = []
    for name, unit, value, half, relative in zip(
        found.names, units, result.values, found.half_width, found.relative_sigma, strict=True
    ):
        if not np.isfinite(value):
            rows.append((name, "–", "–", "–", unit))
            continue
        digits = digits_of(half, 9)
        rows.append((name, fixed(value, digits), fixed(half, digits), f"{short(100 * relative)} %", unit))
    caption = "With half-widths of 95 % intervals and relative standard deviations."
    columns: tuple[str, ...] = ("base parameter", "value", "±", "relative σ", "unit")
    if result.day is not None:
        columns = (*columns, "true")
        rows = [
            (*row, short(true if abs(true) > ROUNDING else 0.0))
            for row, true in zip(rows, result.day.truth.tolist(), strict=True)
        ]
    return Table(columns, tuple(rows), caption)


def _noise(result: DynamicsResult, found: DynamicsEstimate) -> str:
    noise = ", ".join(short(sigma) for sigma in found.noise)
    units = "Nm" if not any(result.robot.chain.prismatic) else "Nm (N of a slide)"
    late = ""
    if found.delay is not None:
        value, half = (short(1e3 * each) for each in (found.delay.value, found.delay.half_width))
        late = f" The torques are {value} ± {half} ms later than the positions."
    return (
        f"What is left of the torques is {short(100 * found.relative_error)} % of them. The noise of one reading is "
        f"{noise} {units} (1σ, estimated).{late}"
    )


def _physical(result: DynamicsResult) -> str:
    """Whether links, motors and joints can have these parameters."""
    fit = result.physical
    if fit is None:
        return ""
    if fit.physical:
        return "Links, motors and joints can have these parameters."
    noise = "which the noise explains" if fit.p > PAYLOAD_RESIDUALS else "which the noise does not explain"
    taken = "the table has these" if result.options.physical else "--physical takes these"
    return (
        f"No arm has exactly what least squares found; the nearest that one has is {short(fit.distance)} standard "
        f"deviations away, {noise} (p = {fit.p:.2g}); {taken}."
    )


def _predictions(result: DynamicsResult, found: DynamicsEstimate) -> Table:
    """A row for each path that was predicted, and for each drive of it."""
    rows = []
    for each in found.predictions:
        rows.append((each.of, "all", short(100 * each.total_relative, "%"), short(each.total_noise_ratio)))
        for name, relative, ratio in zip(result.robot.chain.joint_names, each.relative, each.noise_ratio, strict=True):
            rows.append(("", name, short(100 * relative, "%"), short(ratio)))
    return Table(("torques of", "drive", "relative error", "error / noise"), tuple(rows))


def _loads(result: DynamicsResult, found: DynamicsEstimate) -> tuple[Block, ...]:
    """The load by both ways, side by side."""
    if found.load is None:
        return ()
    ways = [parameter_rows(load) for load in (found.load, found.by_difference) if load is not None]
    if not ways[0]:
        return (Paragraph("The motion does not show what the load is."),)
    rows = []
    true = None if result.day is None or result.day.load is None else true_values(result.day.load)
    for name, value, width, unit in ways[0]:
        others = [row for way in ways[1:] for row in way if row[0] == name]
        pairs = [(value, width), *((other[1], other[2]) for other in others)]
        cells = [_with_width(*pair) for pair in pairs]
        known = () if true is None else (short(true[name]),)
        rows.append((name, *cells, *("–" for _ in range(2 - len(cells))), unit, *known))
    caption = "About and along the frame of the flange, with half-widths of 95 % intervals."
    columns = ("", "with the arm at once", "by difference of the runs", "unit", *(() if true is None else ("true",)))
    return (Table(columns, tuple(rows), caption),)


def _with_width(value: float, half_width: float) -> str:
    if not np.isfinite(half_width):
        return f"{short(value)} ± –"
    digits = digits_of(half_width, 6)
    return f"{fixed(value, digits)} ± {fixed(half_width, digits)}"


def torque_pictures(result: DynamicsResult) -> tuple[Picture, ...]:
    """Each drive: its torque as measured, and as the parameters explain it."""
    found = result.estimate
    assert found is not None
    every = max(1, len(found.measured) // MOST_DRAWN)
    measured, left = found.measured[::every], found.residual[::every]
    pictures = []
    for j, (name, slides) in enumerate(zip(result.robot.chain.joint_names, result.robot.chain.prismatic, strict=True)):

        def draw(axes: Axes, j: int = j, name: str = name, slides: bool = slides) -> None:
            at = np.arange(len(measured)) * every
            axes.plot(at, measured[:, j], ".", color=MEASURED, markersize=3, label="measured")
            axes.plot(at, measured[:, j] - left[:, j], "-", color=PREDICTED, linewidth=1, label="explained")
            axes.set(title=name, xlabel="row, as thinned", ylabel="N" if slides else "Nm")
            if j == 0:
                axes.legend(loc="best")

        words = f"Torque of {name}, measured and explained"
        pictures.append(axes_picture(f"torque{j}", words, (4.4, 2.3), draw, (0.7, 0.45, 0.1, 0.3)))
    return tuple(pictures)


def singular_values_picture(result: DynamicsResult) -> Picture:
    """Singular values relative to the largest, from the best determined direction to the worst."""
    relative = result.singular_values / result.singular_values[0]

    def draw(axes: Axes) -> None:
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
