"""Follow one robot over its dated calibrations: what has changed, and when."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from datetime import date
from hashlib import sha256
from pathlib import Path
from typing import Any

import numpy as np

from lab.calibration.estimate import SETUP, Estimate, IdentifiedSubset
from lab.campaign.config_file import read_config
from lab.commands.calibrate.load_run import (
    CALIBRATIONS,
    MEASUREMENTS_FILE,
    CalibrationRun,
    load_run,
    refuse_other_parameters,
)
from lab.commands.command_line import options_of, takes
from lab.commands.options import TrendOptions
from lab.commands.result import Result, number
from lab.core.errors import LabError, counted
from lab.core.limits import called, day, one_serial
from lab.core.linear_model import half_width_95
from lab.core.random import rng_for
from lab.core.se3 import Array
from lab.core.significance import TREND_YEAR
from lab.core.units import MM, MRAD, Unit
from lab.kinematics.gauge import STRUCTURE_POSES
from lab.kinematics.parameter import Parameter
from lab.render import document as doc
from lab.render.charts.chart import axes_picture, log_ticks
from lab.render.charts.marks import Axes
from lab.render.comparison_plots import ColourScale, date_axis, heat_map, signed_place, signed_ticks
from lab.render.document import digits_of, fixed, plus_minus, short
from lab.render.phrases.verify import chance_text, parameter_text
from lab.render.style import AFTER, ARROW_AFTER, GATE, INK, MUTED, OUTLIER, WORST
from lab.verification.change_points import POWER, ChangePoint, Directions, Series

__all__ = ["DatedRun", "TrendResult", "change_rows", "content_of", "followed", "trend"]


@dataclass(frozen=True)
class DatedRun:
    """A calibration and its day."""

    date: date
    run: CalibrationRun


@dataclass(frozen=True)
class _DetectableChange:
    """Smallest shift of a joint's zero that one more calibration detects in 95 of 100 (rad; m if prismatic)."""

    joint: int  # counted from one
    unit: Unit  # in which the change is displayed
    links_alone: float  # where only the links are compared (and what else is retained); infinite if unobservable
    all_kept: float  # where neither base nor tool was set up anew


@dataclass(frozen=True, repr=False, eq=False)
class TrendResult(Result):
    """The calibrations of a robot in order, and the changes between them.

    Attributes:
        runs: the calibrations, in the order of their dates.
        estimates: the compared parameters of each.
        changes: between them, in order.
        detectable: the smallest change of each joint that would be found.
        left_out: why runs of the folder were not used, a sentence each.
        serial: the serial number of the arm; None where no run states it.
    """

    command = "trend"
    shown_by = "lab.commands.trend:_trend_document"
    drawn_by = "lab.commands.trend:_parameters_picture"

    options: TrendOptions
    runs: tuple[DatedRun, ...]
    estimates: tuple[IdentifiedSubset, ...]
    changes: tuple[ChangePoint, ...]
    detectable: tuple[_DetectableChange, ...]
    left_out: tuple[str, ...]
    serial: str | None = None

    @property
    def model_sha256(self) -> str:
        """Digest of the robot's description."""
        return self.runs[0].run.robot.sha256

    @property
    def warnings(self) -> tuple[str, ...]:
        """Warnings on runs that were left out, and those of the runs."""
        messages = [text for each in self.runs for text in each.run.named_warnings]
        return tuple(dict.fromkeys([*self.left_out, *messages]))

    @property
    def exit_code(self) -> int:
        """1 where the robot has changed, else 0."""
        return 1 if self.changes else 0

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """Parameters that are compared."""
        of = {each.name: each for each in self.runs[0].run.estimate.arm.parameters}
        return tuple(of[name] for name in self.estimates[0].names)

    @property
    def shifts(self) -> Array:
        """Differences ``(n, f)`` of the parameters from the first calibration (SI), angles by less than half a turn."""
        values = np.array([each.values - self.estimates[0].values for each in self.estimates])
        turned = np.remainder(values + np.pi, 2 * np.pi) - np.pi
        return np.where(np.array(self.estimates[0].is_angle), turned, values)

    @property
    def half_widths(self) -> Array:
        """Half-widths of the parameters' 95 % intervals ``(n, f)``."""
        halves = [half_width_95(each.dof or np.inf) * np.sqrt(np.diag(each.covariance)) for each in self.estimates]
        return np.array(halves)

    def to_dict(self) -> dict[str, Any]:
        """Return the values that ``--json`` prints: parameters in SI units, errors in mm."""
        shifts, halves = self.shifts, self.half_widths
        return {
            "robot": self.runs[0].run.robot.name,
            "serial": self.serial,
            "folder": str(self.options.folder),
            "level_per_year": TREND_YEAR,
            "power": POWER,
            "runs": [
                {
                    "run": str(each.run.folder),
                    "date": each.date.isoformat(),
                    "verdict": each.run.result.verdict,
                    "gate_mm": each.run.result.gate_mm,
                    "after_mm": None if each.run.result.after_mm is None else dict(each.run.result.after_mm),
                }
                for each in self.runs
            ],
            "changes": [self._change_to_dict(each) for each in self.changes],
            "parameters": {
                name: {"change": shifts[:, i].tolist(), "half_width_95": halves[:, i].tolist()}
                for i, name in enumerate(self.estimates[0].names)
            },
            "minimum_detectable_change": {
                f"joint{each.joint}_{each.unit.key}": {
                    "set_up_anew": number(MM.of(each.links_alone)),
                    "base_and_tool_kept": number(MM.of(each.all_kept)),
                }
                for each in self.detectable
            },
            "warnings": list(self.warnings),
        }

    def _change_to_dict(self, change: ChangePoint) -> dict[str, Any]:
        before, after, found = (self.runs[i] for i in (change.after, change.after + 1, change.found_at))
        return {
            "between": [before.date.isoformat(), after.date.isoformat()],
            "runs": [str(before.run.folder), str(after.run.folder)],
            "found_by": str(found.run.folder),
            "named": [
                {"name": name, "change": size, "interval_95": [size - half, size + half]}
                for name, size, half in zip(change.named, change.changes, change.half_widths, strict=True)
            ],
            "several": change.several,
            "p": change.p,
            "level": change.level,
        }

    def columns(self) -> Mapping[str, Sequence[Any]]:
        """A row for each run and parameter: change since the first run and half of its 95 % interval, in SI units."""
        names, count = self.estimates[0].names, len(self.runs)
        return {
            "run": [str(each.run.folder) for each in self.runs for _ in names],
            "date": [each.date.isoformat() for each in self.runs for _ in names],
            "parameter": list(names) * count,
            "change": self.shifts.ravel().tolist(),
            "half_width_95": self.half_widths.ravel().tolist(),
        }


_ROW = 0.2  # inches of a parameter
_MOST = 6  # parameters with a picture of their own
_COLUMNS = 24  # of a heat map: of more calibrations, an evenly spaced part
_SHIFT_SCALE = (WORST, "#f5c7ad", "#f7f7f7", "#b9c9ea", ARROW_AFTER)  # from smaller to larger, equal in the middle


def _errors_picture(result: TrendResult) -> tuple[doc.Picture, ...]:
    """Mean and 95 % of the errors at validation over time, against the gate; nothing of fewer than two runs."""
    of = [(each.date, each.run.result.after_mm, each.run.result.gate_mm) for each in result.runs]
    found = [(day, errors["mean"], errors["p95"]) for day, errors, _ in of if errors is not None and errors["mean"] > 0]
    if len(found) < 2:
        return ()
    days, means, ends = zip(*found, strict=True)
    at = [day.toordinal() for day in days]
    gates = [(day.toordinal(), gate) for day, _, gate in of if gate is not None]
    low, high = min(means) / 1.6, max(*ends, *(gate for _, gate in gates)) * 1.8

    def draw(axes: Axes) -> None:
        log_ticks(axes, "y", low, high)
        _changes(axes, result, low, high)
        axes.plot(at, ends, "s--", color=MUTED, markersize=4, linewidth=1)
        axes.plot(at, means, "o-", color=AFTER, markersize=5, linewidth=1.5)
        beside: Any = {"xytext": (7, 0), "textcoords": "offset points", "va": "center"}
        axes.annotate("95 %", (at[-1], ends[-1]), color=INK, **beside)
        axes.annotate("mean", (at[-1], means[-1]), color=AFTER, fontweight="bold", **beside)
        if gates:
            axes.plot(*zip(*gates, strict=True), "--", color=GATE, linewidth=1.4, drawstyle="steps-post")
            axes.annotate("gate", gates[-1], color=GATE, **beside)
        axes.set(ylabel="error, mm (logarithmic)")
        date_axis(axes, result.runs[0].date, result.runs[-1].date, right=0.17)

    gate = f", gate {gates[-1][1]:g} mm" if gates else ""
    label = f"Validation error of each calibration: mean from {min(means):.3g} to {max(means):.3g} mm{gate}"
    return (axes_picture("errors", label, (3.8, 2.4), draw, (0.7, 0.35, 0.1, 0.25)),)


def _parameters_picture(result: TrendResult) -> doc.Picture:
    """Draw the shift of each parameter from the first calibration, in half-widths of the difference's interval."""
    names, halves = result.estimates[0].names, result.half_widths
    sizes = result.shifts / np.sqrt(halves**2 + halves[0] ** 2)
    columns = np.unique(np.round(np.linspace(0, len(sizes) - 1, min(len(sizes), _COLUMNS))).astype(int))
    most = max(float(np.abs(sizes).max()), 2.0)
    step = -(-len(columns) // 8)
    dates = [result.runs[i].date.isoformat() if k % step == 0 else "" for k, i in enumerate(columns)]
    lines = [int(np.searchsorted(columns, change.after + 1)) for change in result.changes]
    return heat_map(
        "parameters",
        f"Parameters over time, {_count_text(result)}",
        names,
        dates,
        signed_place(sizes[columns].T, most),
        ColourScale(_SHIFT_SCALE, signed_ticks(most), "difference in half-widths of its 95 % interval"),
        lines=lines,
        height=_ROW,
    )


def _moved_pictures(result: TrendResult) -> tuple[doc.Picture, ...]:
    """Draw each parameter that changed, over time with its intervals; at most six."""
    names = dict.fromkeys(name for change in result.changes for name in change.named)
    own = [name for name in names if name in result.estimates[0].names][:_MOST]
    return tuple(_over_time(result, name, f"moved-{i + 1}") for i, name in enumerate(own))


def _over_time(result: TrendResult, name: str, called: str) -> doc.Picture:
    at = result.estimates[0].names.index(name)
    unit = result.parameters[at].unit_of_change
    shifts, halves = unit.of(result.shifts[:, at]), unit.of(result.half_widths[:, at])
    days = [each.date.toordinal() for each in result.runs]
    low, high = float((shifts - halves).min()), float((shifts + halves).max())
    room = 0.1 * (high - low)

    def draw(axes: Axes) -> None:
        _changes(axes, result, low - room, high + room)
        axes.axhline(0, color=INK, linewidth=0.8)
        axes.vlines(days, shifts - halves, shifts + halves, colors=INK, linewidth=1.6)
        axes.plot(days, shifts, "o", color=INK, markersize=5)
        axes.set(ylabel=f"{name}, {unit.name}", ylim=(low - room, high + room))
        date_axis(axes, result.runs[0].date, result.runs[-1].date)

    label = f"{name} over time: {shifts[-1]:.3g} {unit.name} from the first calibration"
    return axes_picture(called, label, (3.8, 2.2), draw, (0.75, 0.35, 0.1, 0.25))


def _changes(axes: Axes, result: TrendResult, low: float, high: float) -> None:
    """Mark the time between the calibrations around each change."""
    for change in result.changes:
        between = [result.runs[i].date.toordinal() for i in (change.after, change.after + 1)]
        axes.fill_between(between, [low, low], [high, high], color=OUTLIER, alpha=0.16)
        if len(result.changes) <= _LISTED:
            middle = (sum(between) / 2, 1.02)
            axes.annotate("change", middle, xycoords=("data", "axes fraction"), color=OUTLIER, ha="center")


def _count_text(result: TrendResult) -> str:
    count = len(result.changes)
    return counted(count, "change") if count else "no change"


_MOST_DIGITS = 6
_LISTED = 2  # changes that a sentence names
_LEVEL = f"An unchanged robot raises an alarm in at most {100 * TREND_YEAR:g} % of the years."
_CHANGES = (
    "between", "and", "what changed", "by", "95 %", "unit", doc.Column("found on", doc.PAGE),
    doc.Column("chance if unchanged", doc.PAGE),
)  # fmt: skip
_CAUSES = "a collision, a new motor, gear or zero, or another mounting"


def _trend_document(result: TrendResult) -> doc.Document:
    """Build the trend document: changes and their dates, errors and parameters over time, detectable changes."""
    first = result.runs[0]
    name = called(first.run.robot.name, result.serial)
    if len(result.runs) == 1:
        return _first_document(result, name)
    rows = tuple(row for change in result.changes for row in change_rows(result, change))
    changed = doc.Table(_CHANGES, rows, "Changes between calibrations" if rows else "")
    return doc.Document(
        f"{name}: {_count_text(result)} in {len(result.runs)} calibrations",
        (
            *_card(result).everywhere,
            doc.Warnings(result.warnings),
            doc.Section("What changed", (changed, *_moved(result))),
            doc.Section("Errors at each calibration", (_runs(result),)),
            doc.Section("Minimum detectable change", (_detectable(result), doc.Paragraph(_explained(result), "note"))),
        ),
    )


def _card(result: TrendResult) -> doc.Card:
    last = result.runs[-1]
    badge = doc.Badge("changed", "bad") if result.changes else doc.Badge("unchanged", "good")
    errors, gate = last.run.result.after_mm, last.run.result.gate_mm
    numbers: list[tuple[str, str, str]] = []
    if errors is not None:
        numbers.append(("mean error now", short(errors["mean"], "mm"), "after"))
    if gate is not None:
        numbers.append(("gate", f"{gate:g} mm", ""))
    numbers.append((f"changes in {len(result.runs)} calibrations", f"{len(result.changes)}", ""))
    figure = doc.Figure("errors-over-time", _errors_picture(result), _over_time_caption(result))
    return doc.Card(
        (badge, f" {_when(result)}"),
        tuple(numbers),
        f"Error at poses that were not fitted, calibration of {last.date}. {_LEVEL}",
        _next_step(result),
        (figure,) * bool(figure.pictures),
    )


def _next_step(result: TrendResult) -> str:
    last = result.runs[-1]
    errors, gate = last.run.result.after_mm, last.run.result.gate_mm
    if errors is not None and gate is not None and errors["mean"] > gate:
        return f"The calibration of {last.date} is above its gate: see its page, and calibrate again."
    if not result.changes:
        return f"Keep the calibration of {last.date}. Check the arm each month with lab verify."
    before, after = (result.runs[result.changes[-1].after + i].date for i in (0, 1))
    return (
        f"Use the calibration of {last.date}, which includes the change. Find what happened between {before} and "
        f"{after}: {_CAUSES}?"
    )


def _over_time_caption(result: TrendResult) -> str:
    gates = any(each.run.result.gate_mm is not None for each in result.runs)
    parts = ["Validation error of each calibration"]
    parts += ["dashed: the gate of the mean"] * gates
    parts += ["shaded: between the calibrations around a change"] * bool(result.changes)
    return f"{'; '.join(parts)}."


def _when(result: TrendResult) -> str:
    """Name the days around each change, of many around the last; of an unchanged robot the first and the last."""
    changes = result.changes
    spans = [(change.after, change.after + 1) for change in changes] or [(0, -1)]
    days = [f"between {result.runs[i].date} and {result.runs[j].date}" for i, j in spans]
    return " and ".join(days) if len(changes) <= _LISTED else f"{len(changes)} times, the last time {days[-1]}"


def _first_document(result: TrendResult, name: str) -> doc.Document:
    """Build the document of a single calibration: no change is testable yet, but the next one can be compared."""
    only = result.runs[0]
    errors, gate = only.run.result.after_mm, only.run.result.gate_mm
    card = doc.Card(
        (doc.Badge("one run: no trend yet"), f" the calibration of {only.date} is the first"),
        () if errors is None else (("mean error", short(errors["mean"], "mm"), "after"),),
        "Error at poses that were not fitted." + ("" if gate is None else f" The gate is {gate:g} mm."),
        "Calibrate again in some months, with --date: then a change would show. Until then use lab verify.",
    )
    return doc.Document(
        f"{name}: one run, no trend yet",
        (
            *card.everywhere,
            doc.Warnings(result.warnings),
            doc.Section("Errors", (_runs(result),)),
            doc.Section("Minimum detectable change", (_detectable(result), doc.Paragraph(_explained(result), "note"))),
        ),
    )


def change_rows(result: TrendResult, change: ChangePoint) -> list[doc.Row]:
    """Return the rows of a table for a change, one for each parameter: days, what changed, by how much; when found."""
    before, after, found = (result.runs[i] for i in (change.after, change.after + 1, change.found_at))
    named = [
        (parameter_text(name), *_size(result, name, size, half))
        for name, size, half in zip(change.named, change.changes, change.half_widths, strict=True)
    ] or [("the links; no single parameter", "", "", "")]
    joined = "and" if change.several else "or"
    first = (_day(before), _day(after), *named[0], found.date.isoformat(), chance_text(change.p))
    return [first, *(("", "", f"{joined} {what}", *by, "", "") for what, *by in named[1:])]


def _day(of: DatedRun) -> str:
    """Return the date of a run, with its folder's name where that is another."""
    name = of.run.folder.name
    return f"{of.date}" if str(of.date) == name else f"{of.date} ({name})"


def _size(result: TrendResult, name: str, size: float, half: float) -> tuple[str, str, str]:
    """Return a change, half of its 95 % interval, and the unit."""
    unit = _unit(result, name)
    digits = digits_of(unit.of(half), _MOST_DIGITS)
    return fixed(unit.of(size), digits, signed=True), plus_minus(unit.of(half), digits), unit.name


def _unit(result: TrendResult, name: str) -> Unit:
    units = {each.name: each.unit_of_change for each in result.parameters}
    zeros = {f"zero of joint {each.joint}": each.unit for each in result.detectable}
    return {**zeros, **units}[name]


def _runs(result: TrendResult) -> doc.Table:
    rows: list[doc.Row] = []
    named = any(each.run.folder.name != each.date.isoformat() for each in result.runs)
    for each in result.runs:
        errors = each.run.result.after_mm
        numbers = ("–", "–") if errors is None else (short(errors["mean"]), short(errors["p95"]))
        found = each.run.result
        gate = "none" if found.gate_mm is None else f"{found.gate_mm:g}"
        name = (doc.Code(each.run.folder.name),) * named
        rows.append((each.date.isoformat(), *name, found.verdict, gate, *numbers))
    caption = "Errors at positions that were not fitted, and the gate of their mean, mm"
    return doc.Table(("date", *("run",) * named, "verdict", "gate", "mean", "95 %"), tuple(rows), caption)


def _moved(result: TrendResult) -> tuple[doc.Block, ...]:
    own = _moved_pictures(result)
    caption = (
        "All parameters: differences from the first calibration. Faint: within the interval, as an unchanged arm is in "
        "19 of 20 cases. Blue: larger; vermilion: smaller. Lines mark changes. The scale is logarithmic beyond ±1."
    )
    if own:
        caption = f"Differences from the first calibration with 95 % intervals; shaded: around a change. {caption}"
    several = "Where rows are joined by 'or', the calibrations do not decide which of them changed."
    doubted = any(len(change.named) > 1 and not change.several for change in result.changes)
    return (
        doc.Paragraph(several if doubted else "", "note"),
        doc.Paragraph("" if result.changes else "Nothing: no parameter of the links differs.", shown_in=doc.PAGE),
        doc.Figure("parameters-over-time", (*own, _parameters_picture(result)), caption, wide=True),
    )


def _detectable(result: TrendResult) -> doc.Table:
    anew = " and ".join(group for group in SETUP if group not in result.options.kept)
    columns = (f"{anew} set up anew" * bool(anew), "base and tool unchanged")
    rows: list[doc.Row] = []
    for each in result.detectable:
        sizes = [_or_none(each.links_alone)] * bool(anew) + [_or_none(each.all_kept)]
        rows.append((f"joint {each.joint}", *sizes, each.unit.name))
    caption = "Change of a joint's zero that the next calibration detects in 95 of 100 cases"
    return doc.Table(("", *filter(None, columns), "unit"), tuple(rows), caption)


def _or_none(size: float) -> str:
    return "–" if size == float("inf") else short(MM.of(size))


def _explained(result: TrendResult) -> str:
    hidden = [str(each.joint) for each in result.detectable if each.links_alone == float("inf")]
    if not hidden:
        return ""
    which = f"the zero of joint {hidden[0]}" if len(hidden) == 1 else f"the zeros of joints {' and '.join(hidden)}"
    return (
        f"A dash marks confounding: {which} cannot be separated from the setup of base and tool. If instrument, base "
        "and tool stay in place between the calibrations, --kept base,tool compares them as well."
    )


_WITHIN = 1e-6  # of a joint's effect that the identified parameters may lack


@takes(TrendOptions)
def trend(folder: str | Path | TrendOptions, **options: Any) -> TrendResult:
    """Read the dated runs of a folder, and test after each whether the robot has changed.

    Args:
        folder: that holds the folders of runs of ``lab calibrate`` or ``lab identify``; or all options in one object.
        options: those of ``lab trend``, by name: ``kept``, ``serial``, ``force``, ``accept_edited``.

    Returns:
        The calibrations by date, the changes between them, and which change would be found.

    Raises:
        LabError: there is no dated run, or they are of different arms, robots or parameters.

    Example:
        >>> import lab, pathlib, tempfile
        >>> runs = pathlib.Path(tempfile.mkdtemp())
        >>> for seed, date in ((7, "2026-03-02"), (7, "2026-04-02")):
        ...     result = lab.calibrate("irb120", seed=seed, date=date, no_recording=True, poses=40 + seed)
        ...     _ = result.save(runs / date)
        >>> len(lab.trend(runs, force=True).runs)
        1
    """
    requested = folder
    if not isinstance(requested, TrendOptions):
        requested = options_of("lab.trend", TrendOptions, {"folder": folder, **options})
    requested.check()
    left_out: list[str] = []
    runs = list(_dated(requested, left_out))
    if not runs:
        why = f" ({'; '.join(left_out)})" if left_out else ""
        raise LabError(
            f"{requested.folder}: holds 0 dated runs of lab calibrate or lab identify{why}; give the folder that "
            "contains the runs' folders"
        )
    return followed(requested, runs, tuple(left_out))


def followed(options: TrendOptions, dated: Sequence[DatedRun], left_out: tuple[str, ...] = ()) -> TrendResult:
    """Test after each of one or more runs of an arm whether it has changed.

    Raises:
        LabError: they are of different arms, robots or parameters.
    """
    runs = tuple(sorted(dated, key=lambda each: (each.date, each.run.folder.name)))
    serials = {str(each.run.folder): each.run.serial for each in runs}
    serial = one_serial(serials, "give --serial to follow one of them")
    without = tuple(group for group in SETUP if group not in options.kept)
    estimates = [each.run.estimate.subset(without) for each in runs]
    refuse_other_parameters([each.run for each in runs], estimates)
    last = runs[-1].run.estimate
    zeros = _joint_zeros(last)  # (f, joints) of all identified parameters
    compared = [last.free_names.index(name) for name in estimates[0].names]
    days = [float(each.date.toordinal()) for each in runs]
    series = Series(estimates, days, _directions(estimates[0].names, zeros[compared]))
    everything = Series([each.run.estimate.subset(()) for each in runs], days, _directions(last.free_names, zeros))
    changes = series.change_points()
    start = max((change.after + 1 for change in changes), default=0)
    found = _detectable_changes(series, zeros[compared], start), _detectable_changes(everything, zeros, start)
    detectable = tuple(
        _DetectableChange(i + 1, MM if slides else MRAD, float(found[0][i]), float(found[1][i]))
        for i, slides in enumerate(last.rigid.chain.prismatic)
    )
    return TrendResult(options, runs, tuple(estimates), changes, detectable, left_out, serial)


def _dated(options: TrendOptions, left_out: list[str]) -> Iterator[DatedRun]:
    """The runs that a trend is made of; of the others, why not goes to ``left_out``."""
    if not options.folder.is_dir():
        raise LabError(f"{options.folder}: is no folder; give the one that holds the runs")
    seen: dict[str, str] = {}
    for folder in sorted(path for path in options.folder.iterdir() if (path / "config.json").is_file()):
        try:
            config = read_config(folder, "make the run again")
        except LabError as error:
            left_out.append(f"{error}; the run is left out")
            continue
        if config.command not in CALIBRATIONS:
            left_out.append(f"{folder}: is no run of lab calibrate or lab identify, and is left out")
        elif config.options.get("date") is None:
            left_out.append(f"{folder}: has no date, and is left out; identify again with --date YYYY-MM-DD")
        elif options.serial not in (None, serial := config.options.get("serial")):
            of = "has no serial number" if serial is None else f"is of the arm {serial}"
            left_out.append(f"{folder}: {of}, and is left out of the trend of {options.serial}")
        elif (twin := seen.setdefault(content_of(folder), folder.name)) != folder.name:
            left_out.append(f"{folder}: has the same measurements as {twin}, and is left out")
        else:
            try:
                run = load_run(folder, accept_edited=options.accept_edited)
            except LabError as error:
                left_out.append(f"{error}; the run is left out")
                continue
            if run.result.usable or options.force:
                yield DatedRun(day(f"{folder}/config.json:", str(run.options.date)), run)
            else:
                left_out.append(f"{folder}: its verdict is '{run.result.verdict}', and it is left out without --force")


def content_of(folder: Path) -> str:
    """Return what identifies the measurements of a run: two runs of the same file have the same."""
    path = folder / MEASUREMENTS_FILE
    return sha256(path.read_bytes()).hexdigest() if path.is_file() else str(folder)


def _joint_zeros(estimate: Estimate) -> Array:
    """Compute the change of the identified parameters ``(f, joints)`` per unit of joint zero; NaN if impossible."""
    arm, at = estimate.arm, list(estimate.free)
    inputs = arm.structure_joints(STRUCTURE_POSES, rng_for(0, "structure"))
    jacobian = arm.observe(inputs, arm.rank_point(estimate.nominal))[1].reshape(-1, len(arm.names))
    wanted = jacobian @ arm.rigid.joint_derivatives(np.eye(len(arm.names)))
    size = np.linalg.norm(jacobian[:, at], axis=0)
    found = np.linalg.lstsq(jacobian[:, at] / size, wanted, rcond=None)[0]
    left = np.linalg.norm(jacobian[:, at] / size @ found - wanted, axis=0)
    found = np.where(np.abs(found) > _WITHIN * np.abs(found).max(), found, 0.0) / size[:, None]
    return np.where(left > _WITHIN * np.linalg.norm(wanted, axis=0), np.nan, found)


def _directions(names: tuple[str, ...], zeros: Array) -> Directions:
    """Return the tested directions: each parameter, and each observable joint zero that is no single parameter."""
    one = np.eye(len(names))
    other = [i for i in range(zeros.shape[1]) if np.count_nonzero(zeros[:, i]) > 1 and np.isfinite(zeros[:, i]).all()]
    zeros_of = tuple(f"zero of joint {i + 1}" for i in other)
    return Directions((*names, *zeros_of), np.concatenate([one, zeros[:, other]], axis=1))


def _detectable_changes(series: Series, zeros: Array, start: int) -> Array:
    """The minimum detectable change of each joint's zero; infinite where nothing shows it."""
    shown = np.isfinite(zeros).all(axis=0) & (zeros != 0).any(axis=0)
    found = series.detectable(np.where(shown, np.nan_to_num(zeros), 0.0), start)
    return np.where(shown, found, np.inf)
