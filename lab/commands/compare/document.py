"""What a person reads of a comparison of calibrations."""

import numpy as np

from lab.commands.compare.result import ComparisonResult
from lab.commands.provenance import provenance_section
from lab.core.serials import called
from lab.core.significance import VERIFICATION
from lab.render.charts.axes import Axes
from lab.render.document import Badge, Code, Document, Figure, Paragraph, Picture, Row, Section, Table, Warnings
from lab.render.format import digits_of, fixed, plus_minus
from lab.render.style import AFTER, INK, MUTED
from lab.render.svg import axes_picture
from lab.render.units import display_unit
from lab.verification.difference import Difference

__all__ = ["comparison_document", "differences_picture"]

_FEWEST_DIGITS = 6


def comparison_document(result: ComparisonResult) -> Document:
    """Whether anything has moved, what, every difference with its interval, and a picture of the last."""
    changed = any(each.changed for each in result.differences)
    word = "the links have moved" if changed else "no change of the links detected"
    rate = f"(an unchanged arm fails this test in {100 * VERIFICATION:g} % of all cases)"
    sections = tuple(
        Section(str(run.folder), (Paragraph(_words(result, each)), _table(result, each)))
        for run, each in zip(result.runs[1:], result.differences, strict=True)
    )
    caption = (
        "Differences of the last run from the first, each in halves of its 95 % interval. Blue: moved; grey: not "
        "distinguishable from none."
    )
    return Document(
        f"{called(result.runs[0].robot.name, result.serial)}: {word}",
        (
            Paragraph((Badge("changed", "bad") if changed else Badge("unchanged", "good"), f" {rate}")),
            Paragraph(f"Compared with {result.runs[0].folder} ({result.runs[0].result.words}).", "lead"),
            Warnings(result.warnings),
            *sections,
            Section("The last run against the first", (Figure("moved", (differences_picture(result),), caption),)),
            provenance_section("compare", result.options, result.runs[0].robot.sha256, result.serial),
        ),
    )


def differences_picture(result: ComparisonResult) -> Picture:
    """The differences of the last run from the first, in halves of their 95 % intervals."""
    last = result.differences[-1]
    sizes = last.changes / last.half_widths

    def draw(axes: Axes) -> None:
        at = np.arange(len(sizes))[::-1]
        colours = [AFTER if name in last.moved else MUTED for name in last.names]
        axes.hlines(at, sizes - 1, sizes + 1, colors=colours, linewidth=1.2)
        axes.scatter(sizes, at, c=colours, s=13)
        axes.axvline(0, color=INK, linewidth=1)
        axes.set_yticks(at, list(last.names))
        axes.set(ylim=(-0.7, len(sizes) - 0.3), xlabel="difference, in halves of its 95 % interval")
        axes.grid(visible=False, axis="y")

    label = f"Differences of the last run from the first: {', '.join(last.moved) or 'nothing'} moved"
    return axes_picture("moved", label, (5.6, 0.95 + 0.2 * len(sizes)), draw, (1.35, 0.5, 0.15, 0.15))


def _words(result: ComparisonResult, difference: Difference) -> str:
    """What has moved, in a sentence."""
    p = f"p = {difference.p:.2g}" if difference.p > 0 else "p < 1e-300"
    if not difference.changed:
        return f"The links are those of the first run, as far as the two can tell ({p})."
    if not difference.moved:
        return f"The links have changed, but no single parameter is surely the one that did ({p})."
    figures = _figures(result, difference)
    said = ", ".join("{0} by {2} {3} {1}".format(name, *figures[name]) for name in difference.moved)
    return f"Moved: {said} ({p})."


def _table(result: ComparisonResult, difference: Difference) -> Table:
    rows: list[Row] = [
        (Code(name), *figures, "moved" if name in difference.moved else "")
        for name, figures in _figures(result, difference).items()
    ]
    kinds = tuple("" if row[-1] else "quiet" for row in rows)
    return Table(("parameter", "unit", "difference", "95 % interval", ""), tuple(rows), row_kinds=kinds)


def _figures(result: ComparisonResult, difference: Difference) -> dict[str, tuple[str, str, str]]:
    """Unit, difference and half of its 95 % interval of each parameter, as a person reads them."""
    parameters, figures = {each.name: each for each in result.runs[0].estimate.arm.parameters}, {}
    for name, change, half in zip(difference.names, difference.changes, difference.half_widths, strict=True):
        factor, unit, _ = display_unit(parameters[name])
        if unit == "°":
            factor, unit = 1e3, "mrad"
        digits = digits_of(factor * half, _FEWEST_DIGITS)
        figures[name] = unit, fixed(factor * change, digits, signed=True), plus_minus(factor * half, digits)
    return figures
