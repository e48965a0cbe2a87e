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
from lab.core.random import rng_for
from lab.core.significance import VERIFICATION
from lab.core.units import MM
from lab.kinematics.gauge import STRUCTURE_POSES
from lab.render import document as doc
from lab.render.comparison_plots import Intervals, interval_chart
from lab.render.document import digits_of, fixed, plus_minus, short
from lab.render.phrases.verify import chance_text, parameter_text
from lab.verification.change_points import Difference, difference_of

if TYPE_CHECKING:
    from lab.commands.calibrate.run import CalibrationResult

__all__ = ["ComparisonResult", "compare"]


@dataclass(frozen=True, repr=False, eq=False)
class ComparisonResult(Result):
    """Differences between later calibrations of a robot and the first.

    Attributes:
        runs: the calibrations, the first one the reference.
        differences: of each later run from the first.
        serial: the serial number of the arm; None where no run states it.
    """

    command = "compare"
    shown_by = "lab.commands.compare:_comparison_document"
    drawn_by = "lab.commands.compare:_differences_picture"

    options: CompareOptions
    runs: tuple[CalibrationRun, ...]
    differences: tuple[Difference, ...]
    serial: str | None = None

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


_MOST_DIGITS = 6
_SHOWN = 8  # parameters on the card
_MOST_RUNS = 3  # side by side in a table or a chart
_RATE = f"An unchanged arm fails this test in {100 * VERIFICATION:g} % of all cases."


def _comparison_document(result: ComparisonResult) -> doc.Document:
    """Build the comparison document: the answer, what moved in each run, and all differences with intervals."""
    changed = any(each.changed for each in result.differences)
    word = "the links have moved" if changed else "no change of the links detected"
    names = _run_names(result)
    found = tuple(
        (doc.Strong(f"{name}: "), _sentence(result, each))
        for name, each in zip(names[1:], result.differences, strict=True)
    )
    return doc.Document(
        f"{called(result.runs[0].robot.name, result.serial)}: {word}",
        (
            *_card(result).everywhere,
            doc.Warnings(result.warnings),
            doc.Section(
                f"Against {names[0]}",
                (
                    doc.Paragraph(_groups_text(result) if len(found) > 1 else "", "lead"),
                    doc.Bullets(found),
                    *_charts(result),
                    *_tables(result),
                ),
            ),
        ),
    )


def _run_names(result: ComparisonResult) -> list[str]:
    """Return the runs' folders by their last names, where these differ."""
    short_names = [run.folder.name for run in result.runs]
    return short_names if len(set(short_names)) == len(short_names) else [str(run.folder) for run in result.runs]


def _card(result: ComparisonResult) -> doc.Card:
    changed = [each for each in result.differences if each.changed]
    names, last = _run_names(result), result.differences[-1]
    shown = last if last.changed or not changed else changed[-1]
    numbers = [("parameters moved", f"{len(shown.moved)} of {len(shown.names)}", "")]
    if shown.moved:
        unit, size, _ = _figures(result, shown)[shown.moved[0]]
        numbers.append((parameter_text(shown.moved[0]), f"{size} {unit}", ""))
    if shown.changed:
        numbers.append(("at the tool", short(MM.of(_at_tool(result, shown)), "mm"), ""))
    elif (errors := result.runs[-1].result.after_mm) is not None:
        numbers.append(("mean error of the last run", short(errors["mean"], "mm"), ""))
    if not changed:
        step = f"Keep the last calibration, {names[-1]}. Check the arm each month with lab verify."
    elif last.changed:
        step = (
            f"Use the last calibration, {names[-1]}, which includes the change. Find its cause: a collision, a new "
            "motor, gear or zero, or another mounting?"
        )
    else:
        step = "The last run agrees with the first again: look at the runs between, whose arm or set-up was another."
    badge = doc.Badge("changed", "bad") if changed else doc.Badge("unchanged", "good")
    figure = doc.Figure(
        "moved-figure",
        (_differences_picture(result),),
        f"The differences that stand out most in {names[-1]}. Bold: moved. Within the dotted lines nothing is shown.",
    )
    reference = f"{names[0]} ({result.runs[0].result.description})"
    return doc.Card(
        (badge, f" since {names[0]}"), tuple(numbers), f"Links compared with those of {reference}. {_RATE}", step,
        (figure,),
    )  # fmt: skip


def _at_tool(result: ComparisonResult, difference: Difference) -> float:
    """Return how far the moved parameters take the first target (m, RMS over random poses), base and tool the same."""
    estimate = result.runs[0].estimate
    arm, values = estimate.arm, estimate.values.copy()
    for name in difference.moved or difference.names:
        values[arm.names.index(name)] += difference.changes[difference.names.index(name)]
    inputs = arm.structure_joints(STRUCTURE_POSES, rng_for(0, "structure"))
    apart = (arm.points(inputs, values) - arm.points(inputs, estimate.values))[:, 0]
    return float(np.sqrt((apart**2).sum(axis=1).mean()))


def _groups_text(result: ComparisonResult) -> str:
    """Name the runs that are like the first, and those that are not."""
    of = list(zip(_run_names(result)[1:], result.differences, strict=True))
    same, other = ([name for name, each in of if each.changed is changed] for changed in (False, True))
    parts = [f"Not different from the first: {', '.join(same)}." if same else ""]
    parts += [f"Changed: {', '.join(other)}." if other else ""]
    return " ".join(filter(None, parts))


def _differences_picture(result: ComparisonResult) -> doc.Picture:
    """The largest differences of the last run from the first, in halves of their 95 % intervals."""
    last = result.differences[-1]
    sizes = last.changes / last.half_widths
    rows = np.sort(np.argsort(-np.abs(sizes), kind="stable")[:_SHOWN])
    names = [last.names[i] for i in rows]
    moved = np.array([name in last.moved for name in names])
    shown = Intervals("", sizes[rows], np.ones(len(rows)), moved)
    label = f"Differences of the last run from the first: {', '.join(last.moved) or 'nothing'} moved"
    return interval_chart("moved", label, names, [shown], "in halves of the 95 % interval", band=1.0)


def _charts(result: ComparisonResult) -> tuple[doc.Figure, ...]:
    """Draw all differences of the last runs in their units: lengths and angles side by side."""
    parameters = {each.name: each for each in result.runs[0].estimate.arm.parameters}
    names, count = result.differences[0].names, min(len(result.differences), _MOST_RUNS)
    units = {name: parameters[name].unit_of_change for name in names}
    pictures: list[doc.Picture] = []
    for unit in dict.fromkeys(units.values()):
        rows = [i for i, name in enumerate(names) if units[name] == unit]
        sets = [
            Intervals(
                run,
                np.asarray(unit.of(each.changes[rows])),
                np.asarray(unit.of(each.half_widths[rows])),
                np.array([names[i] in each.moved for i in rows]),
            )
            for run, each in list(zip(_run_names(result)[1:], result.differences, strict=True))[-count:]
        ]
        label = f"Differences from the first run, {unit.name}, with 95 % intervals"
        pictures.append(
            interval_chart(
                f"differences-{len(pictures) + 1}", label, [names[i] for i in rows], sets, f"difference, {unit.name}"
            )
        )
    marks = ", ".join(f"{mark} {each.label}" for mark, each in zip("●■▲", sets, strict=False)) if count > 1 else ""
    which = f"Differences of the last {count} runs" if count < len(result.differences) else "Differences"
    caption = f"{which} from the first run with 95 % intervals; bold: moved.{f' {marks}.' if marks else ''}"
    return (doc.Figure("differences-figure", tuple(pictures), caption),)


def _sentence(result: ComparisonResult, difference: Difference) -> str:
    p = chance_text(difference.p)
    if not difference.changed:
        return f"No change of the links is detectable between the two runs ({p})."
    if not difference.moved:
        return f"The links have changed, but the change cannot be attributed to a single parameter ({p})."
    figures = _figures(result, difference)
    text = ", ".join("{0} by {2} {3} {1}".format(name, *figures[name]) for name in difference.moved)
    return f"Moved: {text} ({p})."


def _tables(result: ComparisonResult) -> tuple[doc.Table, ...]:
    """Tabulate all differences, what moved first: a pair of columns for each run, three runs in a table."""
    pairs = list(zip(_run_names(result)[1:], result.differences, strict=True))
    tables: list[doc.Table] = []
    for first in range(0, len(pairs), _MOST_RUNS):
        part = pairs[first : first + _MOST_RUNS]
        figures = [_figures(result, each) for _, each in part]
        moved = list(dict.fromkeys(name for _, each in part for name in each.moved))
        names = [*moved, *(name for name in result.differences[0].names if name not in moved)]
        rows: list[doc.Row] = []
        for name in names:
            cells = [cell for of in figures for cell in of[name][1:]]
            where = [run for run, each in part if name in each.moved]
            rows.append(
                (doc.Code(name), parameter_text(name).partition(" (")[0], figures[0][name][0], *cells, ", ".join(where))
            )
        heads = [head for run, _ in part for head in (run, "95 %")]
        columns: tuple[str | doc.Column, ...] = ("parameter", doc.Column("what", doc.PAGE), "unit", *heads, "moved in")
        kinds = tuple("" if name in moved else "quiet" for name in names)
        caption = "Differences from the first run"
        tables.append(doc.Table(columns, tuple(rows), caption, kinds, folded=True))
    return tuple(tables)


def _figures(result: ComparisonResult, difference: Difference) -> dict[str, tuple[str, str, str]]:
    """Unit, difference and half of its 95 % interval of each parameter, as a person reads them."""
    parameters, figures = {each.name: each for each in result.runs[0].estimate.arm.parameters}, {}
    for name, change, half in zip(difference.names, difference.changes, difference.half_widths, strict=True):
        unit = parameters[name].unit_of_change
        digits = digits_of(unit.of(half), _MOST_DIGITS)
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
