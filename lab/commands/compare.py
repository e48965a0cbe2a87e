"""Compare calibrations of one robot: have its links moved?"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from lab.calibration.estimate import IdentifiedSubset
from lab.commands.calibrate.load_run import CalibrationRun, calibrated_by, load_run, refuse_other_parameters
from lab.commands.command_line import options_of, takes
from lab.commands.options import CompareOptions
from lab.commands.result import Result
from lab.core.errors import LabError
from lab.core.limits import called, one_serial
from lab.core.measurements import copied_rows
from lab.core.significance import VERIFICATION
from lab.render import document as doc
from lab.render.charts.chart import axes_picture
from lab.render.charts.marks import Axes
from lab.render.document import digits_of, fixed, plus_minus
from lab.render.style import AFTER, INK, MUTED
from lab.verification.change_points import Difference, difference_of

if TYPE_CHECKING:
    from lab.commands.calibrate.run import CalibrationResult

__all__ = ["ComparisonResult", "compare"]


@dataclass(frozen=True, repr=False, eq=False)
class ComparisonResult(Result):
    """Differences between later calibrations of a robot and the first."""

    command = "compare"
    shown_by = "lab.commands.compare:_comparison_document"
    drawn_by = "lab.commands.compare:_differences_picture"

    options: CompareOptions
    runs: tuple[CalibrationRun, ...]  # the calibrations, the first one the reference
    differences: tuple[Difference, ...]  # of each later run from the first
    serial: str | None = None  # the serial number of the arm; None where no run states it

    @property
    def model_sha256(self) -> str:
        """Digest of the robot's description."""
        return self.runs[0].robot.sha256

    @property
    def warnings(self) -> tuple[str, ...]:
        """Warnings of the runs, each once."""
        return tuple(dict.fromkeys(messages for run in self.runs for messages in run.named_warnings))

    @property
    def exit_code(self) -> int:
        """1 where the links of a later run have changed, else 0."""
        return 1 if any(each.changed for each in self.differences) else 0

    def to_dict(self) -> dict[str, Any]:
        """Return the values that ``--json`` prints: differences in SI units."""
        first, *later = self.runs
        return {
            "robot": first.robot.name,
            "serial": self.serial,
            "run": str(first.folder),
            "level": VERIFICATION,
            "compared": [
                {
                    "run": str(run.folder),
                    "changed": each.changed,
                    "p": each.p,
                    "moved": list(each.moved),
                    "differences": {
                        name: {"change": change, "interval_95": [change - half, change + half]}
                        for name, change, half in zip(
                            each.names, each.changes.tolist(), each.half_widths.tolist(), strict=True
                        )
                    },
                }
                for run, each in zip(later, self.differences, strict=True)
            ],
            "warnings": list(self.warnings),
        }

    def columns(self) -> Mapping[str, Sequence[Any]]:
        """A row for each later run and parameter: change and half of its 95 % interval, in SI units."""
        pairs = list(zip(self.runs[1:], self.differences, strict=True))
        return {
            "run": [str(run.folder) for run, each in pairs for _ in each.names],
            "parameter": [name for _, each in pairs for name in each.names],
            "change": [value for _, each in pairs for value in each.changes.tolist()],
            "half_width_95": [value for _, each in pairs for value in each.half_widths.tolist()],
        }


_FEWEST_DIGITS = 6


def _comparison_document(result: ComparisonResult) -> doc.Document:
    """Build the comparison document: the answer, all differences with intervals, and a picture of the last."""
    changed = any(each.changed for each in result.differences)
    word = "the links have moved" if changed else "no change of the links detected"
    rate = f"(an unchanged arm fails this test in {100 * VERIFICATION:g} % of all cases)"
    sections = tuple(
        doc.Section(str(run.folder), (doc.Paragraph(_sentence(result, each)), _table(result, each)))
        for run, each in zip(result.runs[1:], result.differences, strict=True)
    )
    caption = (
        "Differences of the last run from the first, each in halves of its 95 % interval. Blue: moved; grey: not "
        "distinguishable from none."
    )
    return doc.Document(
        f"{called(result.runs[0].robot.name, result.serial)}: {word}",
        (
            doc.Paragraph((doc.Badge("changed", "bad") if changed else doc.Badge("unchanged", "good"), f" {rate}")),
            doc.Paragraph(f"Compared with {result.runs[0].folder} ({result.runs[0].result.description}).", "lead"),
            doc.Warnings(result.warnings),
            *sections,
            doc.Section(
                "The last run against the first", (doc.Figure("moved", (_differences_picture(result),), caption),)
            ),
        ),
    )


def _differences_picture(result: ComparisonResult) -> doc.Picture:
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


def _sentence(result: ComparisonResult, difference: Difference) -> str:
    p = f"p = {difference.p:.2g}" if difference.p > 0 else "p < 1e-300"
    if not difference.changed:
        return f"No change of the links is detectable between the two runs ({p})."
    if not difference.moved:
        return f"The links have changed, but the change cannot be attributed to a single parameter ({p})."
    figures = _figures(result, difference)
    text = ", ".join("{0} by {2} {3} {1}".format(name, *figures[name]) for name in difference.moved)
    return f"Moved: {text} ({p})."


def _table(result: ComparisonResult, difference: Difference) -> doc.Table:
    rows: list[doc.Row] = [
        (doc.Code(name), *figures, "moved" if name in difference.moved else "")
        for name, figures in _figures(result, difference).items()
    ]
    kinds = tuple("" if row[-1] else "quiet" for row in rows)
    return doc.Table(("parameter", "unit", "difference", "95 % interval", ""), tuple(rows), row_kinds=kinds)


def _figures(result: ComparisonResult, difference: Difference) -> dict[str, tuple[str, str, str]]:
    """Unit, difference and half of its 95 % interval of each parameter, as a person reads them."""
    parameters, figures = {each.name: each for each in result.runs[0].estimate.arm.parameters}, {}
    for name, change, half in zip(difference.names, difference.changes, difference.half_widths, strict=True):
        unit = parameters[name].unit_of_change
        digits = digits_of(unit.of(half), _FEWEST_DIGITS)
        figures[name] = unit.name, fixed(unit.of(change), digits, signed=True), plus_minus(unit.of(half), digits)
    return figures


@takes(CompareOptions)
def compare(runs: "Sequence[str | Path | CalibrationResult] | CompareOptions", **options: Any) -> ComparisonResult:
    """Compare calibrations of one robot: which parameters of its links have moved, and by how much.

    Args:
        runs: results of ``calibrate`` or ``identify``, or folders of runs, the earliest first; or all options in one
            object.
        options: those of ``lab compare``, by name: ``force``, ``accept_edited``.

    Returns:
        The differences of each later run from the first, with their intervals and a test at a level of 1 %.

    Raises:
        LabError: a run is not good, is of another robot, identified other parameters, or is given twice.

    Example:
        >>> import lab
        >>> day = lab.simulate("irb120", poses=60, seed=7).measurements
        >>> halves = [day.take(range(30)), day.take(range(30, 60))]
        >>> first, second = (lab.identify(half, robot="irb120", instrument="uniform-8um") for half in halves)
        >>> lab.compare([first, second], force=True).exit_code
        0
    """
    if isinstance(runs, CompareOptions):
        runs.check()
        found = [load_run(run, accept_edited=runs.accept_edited) for run in runs.runs]
        return _compared(runs, found)
    names = [str(run) if isinstance(run, str | Path) else f"run-{i + 1}-in-memory" for i, run in enumerate(runs)]
    requested = options_of("lab.compare", CompareOptions, {"runs": names, **options})
    requested.check()
    accept = requested.accept_edited
    return _compared(
        requested, [calibrated_by(run, Path(n), accept_edited=accept) for run, n in zip(runs, names, strict=True)]
    )


def _compared(options: CompareOptions, runs: Sequence[CalibrationRun]) -> ComparisonResult:
    if not options.force:
        for run in runs:
            run.refuse_unfit("a comparison")
    serial = one_serial({str(run.folder): run.serial for run in runs}, "compare runs of one arm")
    estimates = [run.estimate.subset() for run in runs]
    refuse_other_parameters(runs, estimates)
    _refuse_same(runs, estimates)
    differences = tuple(difference_of(estimates[0], each) for each in estimates[1:])
    return ComparisonResult(options, tuple(runs), differences, serial)


def _refuse_same(runs: Sequence[CalibrationRun], estimates: Sequence[IdentifiedSubset]) -> None:
    """Refuse a run that is given twice, or a copy of one: between the same numbers nothing can have moved."""
    if copies := copied_rows(np.stack([each.values for each in estimates])):
        folder, same = (runs[i].folder for i in copies[0])
        raise LabError(
            f"{folder}: has the parameters of {same}, to the last digit; give a different calibration of the robot"
        )
