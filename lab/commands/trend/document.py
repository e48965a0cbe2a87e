"""What a person reads of a trend."""

from lab.calibration.estimate import SETUP
from lab.commands.provenance import provenance_section
from lab.commands.trend.figures import errors_picture, moved_pictures, parameters_picture
from lab.commands.trend.result import TrendResult
from lab.core.serials import called
from lab.core.significance import TREND_YEAR
from lab.core.wording import counted
from lab.render.document import Badge, Bullets, Code, Document, Figure, Paragraph, Row, Section, Table, Warnings
from lab.render.format import digits_of, fixed, plus_minus, short
from lab.render.units import display_unit
from lab.verification.change_points import ChangePoint

__all__ = ["change_words", "trend_document"]

_MOST_DIGITS = 6
_LEVEL = f"(an unchanged robot raises an alarm in at most {100 * TREND_YEAR:g} % of the years)"


def trend_document(result: TrendResult) -> Document:
    """Whether and when anything changed, what, errors and parameters over time, and what would be found."""
    first, last = result.runs[0], result.runs[-1]
    count = len(result.changes)
    word = counted(count, "change") if count else "no change"
    robot = first.run.robot
    name = called(robot.name, result.serial)
    if len(result.runs) == 1:
        return _first_document(result, name)
    badge = Badge("changed", "bad") if count else Badge("unchanged", "good")
    return Document(
        f"{name}: {word} in {len(result.runs)} calibrations",
        (
            Paragraph((badge, f" {_when(result)} {_LEVEL}")),
            Paragraph(f"The calibrations are of {first.date} to {last.date}.", "note"),
            Bullets(tuple(change_words(result, each) for each in result.changes)),
            Warnings(result.warnings),
            Section("Errors over time", (_runs(result), _errors(result))),
            Section("Parameters over time", _parameters(result)),
            Section("Minimum detectable change", (_detectable(result), Paragraph(_explained(result), "note"))),
            provenance_section("trend", result.options, robot.sha256, result.serial),
        ),
    )


def _when(result: TrendResult) -> str:
    """Between which days it changed; of an unchanged robot, between the first and the last."""
    spans = [(change.after, change.after + 1) for change in result.changes] or [(0, -1)]
    return " and ".join(f"between {result.runs[i].date} and {result.runs[j].date}" for i, j in spans)


def _first_document(result: TrendResult, name: str) -> Document:
    """One calibration: nothing can have changed, but the next one can be judged."""
    only = result.runs[0]
    return Document(
        f"{name}: one run, no trend yet",
        (
            Paragraph((Badge("one run: no trend yet"), f" the calibration of {only.date} is the first")),
            Warnings(result.warnings),
            Section("Errors", (_runs(result),)),
            Section("Minimum detectable change", (_detectable(result), Paragraph(_explained(result), "note"))),
            provenance_section("trend", result.options, only.run.robot.sha256, result.serial),
        ),
    )


def change_words(result: TrendResult, change: ChangePoint) -> str:
    """What changed, between which days, and by how much."""
    before, after, found = (result.runs[i] for i in (change.after, change.after + 1, change.found_at))
    when = f"Between {before.date} ({before.run.folder.name}) and {after.date} ({after.run.folder.name})"
    p = f"p = {change.p:.2g}" if change.p > 0 else "p < 1e-300"
    by = f" (found by {found.run.folder.name}, {p} at a level of {change.level:.2g})"
    moved = [
        f"{_called(name)} changed by {_size(result, name, size, half)}"
        for name, size, half in zip(change.named, change.changes, change.half_widths, strict=True)
    ]
    if not moved:
        return f"{when} the links changed, but no single parameter is surely the one that did{by}."
    if change.several:
        return f"{when} more than one parameter changed: {'; '.join(moved)}{by}."
    if len(moved) == 1:
        return f"{when} {moved[0]}{by}."
    return f"{when} one of these changed, and the calibrations cannot tell which: {'; '.join(moved)}{by}."


def _called(name: str) -> str:
    """A parameter, with the joint whose zero it is."""
    joint = name.removeprefix("link").removesuffix(".theta")
    return f"{name} (the zero of joint {joint})" if joint.isdigit() else name


def _size(result: TrendResult, name: str, size: float, half: float) -> str:
    factor, unit = _unit(result, name)
    digits = digits_of(factor * half, _MOST_DIGITS)
    return f"{fixed(factor * size, digits, signed=True)} {plus_minus(factor * half, digits)} {unit}"


def _unit(result: TrendResult, name: str) -> tuple[float, str]:
    """The factor from SI and the unit, of a parameter or of a joint's zero."""
    for parameter in result.parameters:
        if parameter.name == name:
            factor, unit, _ = display_unit(parameter)
            return (1e3, "mrad") if unit == "°" else (factor, unit)
    units = {f"zero of joint {each.joint}": each.unit for each in result.detectable}
    return 1e3, units[name]


def _runs(result: TrendResult) -> Table:
    rows: list[Row] = []
    for each in result.runs:
        errors = each.run.result.after_mm
        numbers = ("–", "–") if errors is None else (short(errors["mean"]), short(errors["p95"]))
        found = each.run.result
        gate = "none" if found.gate_mm is None else f"{found.gate_mm:g}"
        rows.append((each.date.isoformat(), Code(each.run.folder.name), found.verdict, gate, *numbers))
    caption = "Errors at positions that were not fitted, and the gate of their mean, mm"
    return Table(("date", "run", "verdict", "gate", "mean", "95 %"), tuple(rows), caption)


def _errors(result: TrendResult) -> Figure:
    caption = (
        "The validation error of each calibration. It says how well the arm was described on that day; whether the arm "
        "moved, the parameters say. Logarithmic axis; a dotted line is a change."
    )
    return Figure("errors-over-time", errors_picture(result), caption)


def _parameters(result: TrendResult) -> tuple[Figure, ...]:
    every = (
        "Differences from the first calibration, each in halves of its own 95 % interval: up to 1 is what an "
        "unchanged arm shows in 19 of 20. Blue is more, vermilion less; a line is a change."
    )
    moved = "What changed, as the difference from the first calibration with 95 % intervals; a dotted line is a change."
    return (
        Figure("moved-over-time", moved_pictures(result), moved),
        Figure("parameters-over-time", (parameters_picture(result),), every),
    )


def _detectable(result: TrendResult) -> Table:
    anew = " and ".join(group for group in SETUP if group not in result.options.kept)
    columns = (f"{anew} set up anew" * bool(anew), "base and tool kept")
    rows: list[Row] = []
    for each in result.detectable:
        sizes = [_or_none(each.links_alone)] * bool(anew) + [_or_none(each.all_kept)]
        rows.append((f"joint {each.joint}", *sizes, each.unit))
    caption = "The next calibration finds in 95 of 100 that the zero of a joint has moved by"
    return Table(("", *filter(None, columns), "unit"), tuple(rows), caption)


def _or_none(size: float) -> str:
    return "–" if size == float("inf") else short(1e3 * size)


def _explained(result: TrendResult) -> str:
    hidden = [str(each.joint) for each in result.detectable if each.links_alone == float("inf")]
    if not hidden:
        return ""
    which = f"the zero of joint {hidden[0]}" if len(hidden) == 1 else f"the zeros of joints {' and '.join(hidden)}"
    return (
        f"A dash: {which} cannot be told from how base and tool were set up. Where the instrument, the base and the "
        "tool stay as they are between the calibrations, --kept base,tool compares them as well."
    )
