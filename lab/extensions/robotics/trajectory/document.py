"""What a person reads of a motion: how long it takes, how near the joints come to their limits, and the curves."""

from collections.abc import Sequence

import numpy as np

from lab.commands.provenance import provenance_section
from lab.commands.values import joint_values
from lab.core.se3 import Array
from lab.extensions.robotics.trajectory.elastic import Tracking
from lab.extensions.robotics.trajectory.result import TrajectoryResult
from lab.formats.programs.registry import path_file, refusal
from lab.render.charts.axes import Axes
from lab.render.document import Document, Figure, Paragraph, Picture, Section, Table, Warnings
from lab.render.format import fixed, sentence
from lab.render.style import SERIES
from lab.render.svg import axes_picture

__all__ = ["curve_pictures", "trajectory_document"]

_STILL = 1e-9  # rad/s or m/s
MOST_LEGS = 40  # rows of the table of moves


def trajectory_document(result: TrajectoryResult) -> Document:
    """The moves, the joints' peaks beside their limits, and how the joints move over time."""
    seconds = result.motion.seconds
    points = sum(len(leg.points) - 1 for leg in result.legs) + 1
    return Document(
        f"{result.robot.name}: {fixed(seconds, 5)} s through {points} points",
        (
            Warnings(result.warnings),
            Section("Moves", (_legs(result),)),
            Section("Joints", (_joints(result), Paragraph(_laws(result), "note"))),
            *_errors(result),
            Section("Over time", (_figure(result),)),
            Section("Files", (_files(result),)),
            provenance_section("trajectory", result.options, result.robot.sha256),
        ),
    )


_LAWS = {
    "common": "In moves of the joints all have their phases in common: from rest to rest they move in a straight line.",
    "own": "In moves of the joints all start and stop together, each with phases of its own.",
    "independent": "In moves of the joints all start together, and each stops as soon as it can.",
}


def _laws(result: TrajectoryResult) -> str:
    """How the joints move together, and whether their jerk is limited."""
    smooth = "Jerk is limited" if result.chain.jerk is not None else "Jerk is not limited (--jerks)"
    return f"{_LAWS[result.options.law]} {smooth}."


def _files(result: TrajectoryResult) -> Paragraph:
    """What was checked, the program, and what it leaves to the controller."""
    chain, controller = result.robot.chain, result.options.controller
    checked = (
        "The whole motion was checked for collisions, with the arm itself and with the surroundings that are known."
        if result.checked
        else f"Nothing was checked for collisions: {result.unchecked_reason}."
    )
    name = path_file(chain, controller)
    if name is None:
        return Paragraph(f"{checked} {sentence(refusal(chain, controller) or '')}")
    words = f"{checked} {name} has the moves for the controller, which stops at each point and finds the way between."
    passed = result.options.blend(result.chain) is not None or any(_passed(result))
    return Paragraph(f"{words} Points that are passed without a stop here are stopped at there." if passed else words)


def _passed(result: TrajectoryResult) -> Sequence[bool]:
    """Whether the joints move at the end of each leg but the last."""
    ends = [leg.move.at(np.array([leg.move.seconds]))[1] for leg in result.legs[:-1] if leg.kind == "joint"]
    return [bool(np.abs(speeds).max() > _STILL) for speeds in ends]


def _errors(result: TrajectoryResult) -> tuple[Section, ...]:
    """What the arm misses along the way, by part, and what is done about it."""
    if result.tracked is None or result.tracking is None:
        return ()
    found, values = result.tracking, result.to_dict()["tracking"]
    left = ("left after the correction, by the model", values["left_mm"])
    rows = [("in all", values["error_mm"]), *values["parts_mm"].items(), left]
    cells = tuple((name, *(_um(each[key]) for key in ("mean", "max"))) for name, each in rows)
    chain, largest = result.chain, values["largest_corrections"]
    joints = ", ".join(
        f"{name} {size:.3g}{' mm' if slides else '°'}"
        for name, size, slides in zip(chain.joint_names, largest, chain.prismatic, strict=True)
    )
    words = (
        f"With {values['payload_kg']:.4g} kg, under gravity and the inertia of the motion, at rest at each instant: "
        f"vibration is left out. Joint positions that make up for it are in corrected.csv: by up to {joints}."
    )
    if values["not_made_up_for"]:
        words += f" No joint moves the tool along {', '.join(values['not_made_up_for'])}, so that is not made up for."
    figure = Figure("errors", (_error_picture(result, found),), "What the tool misses its path by, in all and by part.")
    return (Section("Errors along the way", (Paragraph(words), Table(("part", "mean, µm", "max, µm"), cells), figure)),)


def _um(length_mm: float) -> str:
    return f"{1e3 * length_mm:.3g}" if length_mm >= 1e-6 else "< 0.001"


def _error_picture(result: TrajectoryResult, found: Tracking) -> Picture:
    curves = {"in all": found.total, **found.parts}

    def draw(axes: Axes) -> None:
        for i, (name, error) in enumerate(curves.items()):
            lengths = 1e3 * np.linalg.norm(error[:, :3], axis=1)
            axes.plot(result.sampled.times, lengths, "-", color=SERIES[i % len(SERIES)][0], linewidth=1.3, label=name)
        axes.set(xlabel="time, s", ylabel="mm", title="errors of the tool")
        axes.legend(loc="best", fontsize=7)

    return axes_picture("errors", "Errors of the tool over time", (7.5, 2.4), draw, (0.8, 0.5, 0.2, 0.3))


def curve_pictures(result: TrajectoryResult) -> tuple[Picture, ...]:
    """Joint positions over time, slides in mm and others in degrees; then what they use of each limit, in per cent."""
    sampled, chain = result.sampled, result.chain
    units = {"mm" if slides else "°" for slides in chain.prismatic}
    positions = joint_values(chain.prismatic, sampled.joints)
    rates = [("speeds", sampled.speeds, chain.speed), ("accelerations", sampled.accelerations, chain.acceleration)]
    if sampled.jerks is not None and chain.jerk is not None:
        rates.append(("jerks", sampled.jerks, chain.jerk))
    return (
        _curves("positions", result, positions, f"{' or '.join(sorted(units))}", limited=False),
        *(_curves(name, result, 100 * values / limit, "% of the limit", limited=True) for name, values, limit in rates),
    )


def _curves(name: str, result: TrajectoryResult, shown: Array, unit: str, *, limited: bool) -> Picture:
    times, steps = result.sampled.times, name == ("accelerations" if result.chain.jerk is None else "jerks")

    def draw(axes: Axes) -> None:
        for j, (joint, column) in enumerate(zip(result.robot.chain.joint_names, shown.T, strict=True)):
            colour, style = SERIES[j % len(SERIES)][0], "steps-post" if steps else "default"
            axes.plot(times, column, "-", color=colour, linewidth=1.3, label=joint, drawstyle=style)
        for start in result.motion.starts[1:-1]:
            axes.axvline(start, color="0.85", linewidth=0.8, zorder=0)
        for limit in (-100, 100) if limited else ():
            axes.axhline(limit, color="0.4", linewidth=0.9, linestyle="--", zorder=0)
        axes.set(xlabel="time, s", ylabel=unit, title=name)
        if limited:
            axes.set(ylim=(-112, 112), yticks=(-100, -50, 0, 50, 100))
        else:
            axes.legend(loc="center left", bbox_to_anchor=(1.01, 0.5), fontsize=7)

    return axes_picture(name, f"Joint {name} over time", (7.5, 2.4), draw, (0.8, 0.5, 0.8, 0.3))


def _legs(result: TrajectoryResult) -> Table:
    rows = []
    for leg, start in zip(result.legs, result.motion.starts, strict=False):
        along = "" if np.isnan(leg.length_m) else f"{fixed(1e3 * leg.length_m, 2)} mm"
        along += f", turns {fixed(np.rad2deg(leg.turn_rad), 2)}°" if leg.turn_rad > 1e-9 else ""
        rows.append((" → ".join(leg.points), leg.kind, fixed(start, 5), fixed(leg.move.seconds, 5), along))
    columns = ("points", "move", "starts at, s", "takes, s", "path of the tool")
    return Table(columns, tuple(rows), most_rows=MOST_LEGS)


def _joints(result: TrajectoryResult) -> Table:
    """Each joint's range, and its peaks beside its limits."""
    chain, sampled = result.chain, result.sampled
    low, high = (joint_values(chain.prismatic, each(sampled.joints, axis=0)) for each in (np.min, np.max))
    speeds, accelerations = result.motion.peaks
    rates = {"speed, per s": (speeds, chain.speed), "acceleration, per s²": (accelerations, chain.acceleration)}
    if chain.jerk is not None:
        rates["jerk, per s³"] = (result.motion.peak_jerk, chain.jerk)
    columns = [_peaks(result, *each) for each in rates.values()]
    rows = tuple(
        (name, "mm" if chain.prismatic[j] else "°", f"{fixed(low[j], 2)} … {fixed(high[j], 2)}",
         *(column[j] for column in columns))
        for j, name in enumerate(chain.joint_names)
    )  # fmt: skip
    return Table(("joint", "", "from … to", *(f"peak {name}" for name in rates)), rows)


def _peaks(result: TrajectoryResult, peaks: Array, limits: Array) -> list[str]:
    """The largest rate of each joint, beside its limit."""
    shown = (joint_values(result.chain.prismatic, each) for each in (peaks, limits))
    return [
        f"{fixed(peak, 2)} of {fixed(most, 1)}" if most < np.inf else "not limited"
        for peak, most in zip(*shown, strict=True)
    ]


def _figure(result: TrajectoryResult) -> Figure:
    rates = "speeds and accelerations" if result.chain.jerk is None else "speeds, accelerations and jerks"
    caption = f"Joint positions; {rates} as shares of each joint's limit (dashed). Grey lines part the moves."
    return Figure("curves", curve_pictures(result), caption)
