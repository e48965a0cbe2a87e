"""What a person reads of a motion: how long it takes, how near the joints come to their limits, and the curves."""

import numpy as np

from lab.commands.provenance import provenance_section
from lab.commands.trajectory.result import TrajectoryResult
from lab.commands.values import joint_values
from lab.compensation.elastic_tracking import Tracking
from lab.core.se3 import Array
from lab.render.charts.axes import Axes
from lab.render.document import Document, Figure, Paragraph, Picture, Section, Table, Warnings
from lab.render.format import fixed
from lab.render.style import SERIES
from lab.render.svg import axes_picture

__all__ = ["curve_pictures", "trajectory_document"]

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
            Section("Joints", (_joints(result), Paragraph(_LAWS[result.options.law], "note"))),
            *_errors(result),
            Section("Over time", (_figure(result),)),
            provenance_section("trajectory", result.options, result.robot.sha256),
        ),
    )


_LAWS = {
    "common": "In moves of the joints all have their phases in common: from rest to rest they move in a straight line.",
    "own": "In moves of the joints all start and stop together, each with phases of its own.",
    "independent": "In moves of the joints all start together, and each stops as soon as it can.",
}


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
    """Joint positions, speeds and accelerations over time; slides in mm, others in degrees."""
    sampled, chain = result.sampled, result.robot.chain
    parts = (("positions", sampled.joints, ""), ("speeds", sampled.speeds, "/s"),
             ("accelerations", sampled.accelerations, "/s²"))  # fmt: skip
    units = {"mm" if slides else "°" for slides in chain.prismatic}
    return tuple(_curves(name, result, values, f"{' or '.join(sorted(units))}{per}") for name, values, per in parts)


def _curves(name: str, result: TrajectoryResult, values: Array, unit: str) -> Picture:
    shown, times = joint_values(result.robot.chain.prismatic, values), result.sampled.times

    def draw(axes: Axes) -> None:
        for j, (joint, column) in enumerate(zip(result.robot.chain.joint_names, shown.T, strict=True)):
            colour = SERIES[j % len(SERIES)][0]
            axes.plot(times, column, "-", color=colour, linewidth=1.3, label=joint, drawstyle=_STYLES[name])
        for start in result.motion.starts[1:-1]:
            axes.axvline(start, color="0.85", linewidth=0.8, zorder=0)
        axes.set(xlabel="time, s", ylabel=unit, title=name)
        if name == "positions":
            axes.legend(loc="best", fontsize=7)

    return axes_picture(name, f"Joint {name} over time", (7.5, 2.4), draw, (0.8, 0.5, 0.2, 0.3))


_STYLES = {"positions": "default", "speeds": "default", "accelerations": "steps-post"}


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
    chain, sampled, rows = result.robot.chain, result.sampled, []
    ends = np.stack([sampled.joints.min(axis=0), sampled.joints.max(axis=0)])
    numbers = [*ends, *result.motion.peaks, result.chain.speed, result.chain.acceleration]
    shown = [joint_values(chain.prismatic, each) for each in numbers]
    for j, name in enumerate(chain.joint_names):
        low, high, speed, pull, most, most_pull = (each[j] for each in shown)
        unit = "mm" if chain.prismatic[j] else "°"
        rows.append((name, unit, f"{fixed(low, 2)} … {fixed(high, 2)}", f"{fixed(speed, 2)} of {fixed(most, 1)}",
                     f"{fixed(pull, 2)} of {fixed(most_pull, 1)}"))  # fmt: skip
    return Table(("joint", "", "from … to", "peak speed, per s", "peak acceleration, per s²"), tuple(rows))


def _figure(result: TrajectoryResult) -> Figure:
    caption = "Joint positions, speeds and accelerations; grey lines part the moves."
    return Figure("curves", curve_pictures(result), caption)
