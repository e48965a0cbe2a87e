"""Document of a motion: its moves, the joints against their limits over time, and the errors of the tool."""

from dataclasses import replace

import numpy as np

from lab.core import se3
from lab.core.number_text import fixed, sentence, short
from lab.core.se3 import Array
from lab.core.units import MM
from lab.extensions.robotics.trajectory.path_errors import Tracking
from lab.extensions.robotics.trajectory.trajectory_result import TrajectoryResult, angles_deg, lengths_mm, mean_and_max
from lab.kinematics.effects.effect import AXES
from lab.library.result import joint_values
from lab.report import document as doc
from lab.report.charts.chart import axes_picture, shades
from lab.report.charts.marks import Axes
from lab.report.page_scene import ArmScene, Line, moments, moving_arm
from lab.report.scene import magnification, moved
from lab.report.style import BEFORE, COLOUR_SCALE, GATE, GRID, SERIES, rgb
from lab.report.view import View

__all__ = ["VIEW", "main_picture", "page_scene", "tool_speeds", "trajectory_document"]

VIEW = View(
    f"{__name__}:trajectory_document",
    f"{__name__}:main_picture",
    f"{__package__}.trajectory_recording:record_trajectory",
)

_STILL = 1e-9  # rad/s or m/s
_LEAST_MM = 1e-4
_PARTED = "Vertical lines part the moves."
_MAX_LEGS = 40  # rows of the table of moves
_LAWS = {
    "common": "In moves of the joints all have their phases in common: from rest to rest they move in a straight line.",
    "own": "In moves of the joints all start and stop together, each with phases of its own.",
    "independent": "In moves of the joints all start together, and each stops as soon as it can.",
}


_RATES = (
    "Speeds and accelerations of the joints, each as a share of its own limit (dashed). Vertical lines part the moves."
)
_MOTION = (
    "The robot on its way, in its own time. The darker the tool's path, the faster the tool: {low} to {high} mm/s."
)
_MISSED = " The orange path is where the tool really goes, its errors magnified {factor} times."
_ARROW = 0.06  # of the reach: how long the mean error is drawn
_LIMITS = "Each joint's position over time; dashed lines are its limits, and vertical lines part the moves."


def main_picture(result: TrajectoryResult) -> doc.Picture:
    """Return the joint positions over time."""
    return _curves("positions", result, _positions(result), " or ".join(sorted(set(_units(result)))), limited=False)


def trajectory_document(result: TrajectoryResult) -> doc.Document:
    """Summarise a motion; show it, its joints against their limits, and the errors of the tool."""
    points = sum(len(leg.points) - 1 for leg in result.legs) + 1
    law = doc.Paragraph(_LAWS[result.options.law], "note")
    return doc.Document(
        f"{result.robot.name}: {fixed(result.motion.seconds, 5)} s through {points} points",
        (
            _card(result),
            doc.Warnings(result.warnings),
            doc.Section(
                "Moves",
                (
                    doc.Scene("motion-scene", lambda: page_scene(result), _scene_caption(result)),
                    _legs(result),
                    doc.Paragraph(_files(result), shown_in=doc.PAGE),
                ),
            ),
            doc.Section(
                "Joints against their limits",
                (
                    doc.Figure("positions-figure", _position_pictures(result), _LIMITS),
                    doc.Figure("rates-figure", _rate_pictures(result), _RATES),
                    doc.Section(
                        "Ranges, peak rates and shortest times",
                        (_joints(result), law, *_own_times(result)),
                        folded=True,
                    ),
                ),
            ),
            *_errors(result),
            doc.Section("Files", (doc.Paragraph(_files(result)),), shown_in=doc.NARROW),
        ),
    )


@doc.guarded
def _card(result: TrajectoryResult) -> doc.Card:
    """Summarise the motion: whether it can be run, how long it takes, how near its limits it comes, what to do."""
    badge = doc.Badge("not checked for collisions", "doubtful")
    if result.checked:
        badge = doc.Badge("free of collisions", "good")
    if result.exit_code:
        badge = doc.Badge("the correction is incomplete", "bad")
    numbers = [("takes", short(result.motion.seconds, "s"), "")]
    if result.tracking is not None:
        before, after = (
            float(lengths_mm(each).mean()) for each in (result.tracking.total, result.tracking.corrected.left)
        )
        left = short(after, "mm") if after >= _LEAST_MM else "< 0.0001 mm"
        numbers += [("misses its path by", short(before, "mm"), "before"), ("corrected", left, "after")]
    for name, peaks, limits in zip(("speed", "acceleration"), result.motion.peaks, _rate_limits(result), strict=True):
        share = 100 * peaks / limits
        worst = int(share.argmax())
        if share[worst] > 0:
            numbers.append((f"{name}, of the limit of {result.chain.joint_names[worst]}", f"{share[worst]:.0f} %", ""))
    about = f"The tool's speed is {short(1e3 * float(tool_speeds(result).max()))} mm/s at most."
    if result.tracking is not None:
        about += " The errors are means along the way, by the model."
    return doc.Card(("Motion: ", badge), tuple(numbers), about, _next(result), (_speed_figure(result),))


def _next(result: TrajectoryResult) -> str:
    """Return what to do with a motion."""
    if result.incomplete_points:
        return f"Move {', '.join(result.incomplete_points)}, where the correction is incomplete; then plan again."
    if result.exit_code:
        return "Look up in corrected.csv where the correction is incomplete, and move the path away from there."
    if not result.checked:
        return "Run it without the work-piece and slowly at first, or describe the surroundings with --cell."
    file = "corrected.csv" if result.tracking is not None else "trajectory.csv"
    if result.program is not None:
        return f"Run {result.program} slowly at first, and compare one pose with {file}."
    return f"Give {file} to the controller, and run it slowly at first."


def _scene_caption(result: TrajectoryResult) -> str:
    speeds = 1e3 * tool_speeds(result)
    text = _MOTION.format(low=f"{speeds.min():.0f}", high=f"{speeds.max():.0f}")
    return text if result.tracking is None else text + _MISSED.format(factor=f"{_error_factor(result):,g}")


def tool_speeds(result: TrajectoryResult) -> Array:
    """Return the speeds ``(k,)`` m/s of the tool's point at the sampled times."""
    arm, sampled = result.robot.arm(("p1",)), result.sampled
    _, jacobian = arm.tool(sampled.joints, arm.nominal({"p1": result.options.tool_m}))
    return np.asarray(np.linalg.norm((jacobian[:, :3] @ sampled.speeds[:, :, None])[..., 0], axis=1))


def _error_factor(result: TrajectoryResult) -> float:
    """Return the magnification of the tool's errors along its path."""
    assert result.tracking is not None
    reach = float(np.linalg.norm(result.sampled.Ts_base_tool[:, :3, 3], axis=1).max())
    return max(magnification(1e-3 * float(lengths_mm(result.tracking.total).mean()), _ARROW * reach), 1.0)


def page_scene(result: TrajectoryResult) -> ArmScene:
    """The robot on its way, the tool's path coloured by its speed, and the path as missed."""
    sampled, model, arm = result.sampled, result.robot.model, result.robot.arm(("p1",))
    values = arm.nominal({"p1": result.options.tool_m})
    names, rows = result.passed
    moving = moving_arm(model, arm, values, sampled.joints, sampled.times, rows, names)
    shown = moments(len(sampled.times), rows)
    speeds = tool_speeds(result)[shown]
    share = (speeds - speeds.min()) / (float(np.ptp(speeds)) or 1.0)
    (path,) = moving.lines
    lines = [replace(path, rgb=np.round(255 * shades(share, COLOUR_SCALE)).astype(int))]
    if (tracking := result.tracking) is not None and result.tracked is not None:
        tracked = result.tracked
        T = model.T_world_frame0 @ se3.inverse(tracked.arm.rigid.T_tracker_frame0(tracked.nominal))
        missed = tracking.wanted[shown, :3, 3] + _error_factor(result) * tracking.total[shown, :3]
        lines.append(Line(f"path with errors × {_error_factor(result):,g}", moved(T, missed), rgb(BEFORE)))
    return replace(moving, lines=lines, kind="point")


def _speed_figure(result: TrajectoryResult) -> doc.Figure:
    speeds = 1e3 * tool_speeds(result)

    def draw(axes: Axes) -> None:
        axes.plot(result.sampled.times, speeds, "-", color=SERIES[2][0], linewidth=1.6)
        _part_moves(axes, result)
        axes.set(xlabel="time, s", ylabel="mm/s", title="speed of the tool", ylim=(0, 1.1 * (speeds.max() or 1.0)))

    text = f"Speed of the tool over time, {short(float(speeds.max()))} mm/s at most"
    return doc.Figure("speed-figure", (axes_picture("speed", text, (4.8, 2.2), draw, (0.7, 0.5, 0.1, 0.3)),), _PARTED)


def _files(result: TrajectoryResult) -> str:
    """Report the checks, the program, and the decisions it leaves to the controller."""
    checked = (
        "The whole motion was checked for collisions, with the arm itself and with the surroundings that are known."
        if result.checked
        else f"Nothing was checked for collisions: {result.unchecked_reason}."
    )
    if result.program is None:
        return f"{checked} {sentence(result.no_program or '')}"
    text = f"{checked} {result.program} has the moves; the controller stops at each point and finds the way between."
    ends = [leg.move.at(np.array([leg.move.seconds]))[1] for leg in result.legs[:-1] if leg.kind == "joint"]
    passed = result.options.blend(result.chain) is not None or any(np.abs(speeds).max() > _STILL for speeds in ends)
    return f"{text} Points that are passed without a stop here are stopped at there." if passed else text


@doc.guarded
def _errors(result: TrajectoryResult) -> tuple[doc.Section, ...]:
    if result.tracked is None or result.tracking is None:
        return ()
    tracking, values = result.tracking, result.to_dict()["tracking"]
    errors = {
        "in all": tracking.total,
        **tracking.parts,
        "left after the correction, by the model": tracking.corrected.left,
    }
    cells = tuple(
        (
            name,
            *map(_um, mean_and_max(lengths_mm(each)).values()),
            *map(_um, mean_and_max(angles_deg(each)).values()),
        )
        for name, each in errors.items()
    )
    chain, largest = result.chain, values["largest_corrections"]
    joints = ", ".join(
        f"{name} {size:.3g}{' mm' if slides else '°'}"
        for name, size, slides in zip(chain.joint_names, largest, chain.prismatic, strict=True)
    )
    text = (
        f"With {values['payload_kg']:.4g} kg, under gravity and the inertia of the motion, at rest at each instant: "
        f"vibration is left out. Joint positions that make up for it are in corrected.csv: by up to {joints}."
    )
    displacing, turning = tracking.corrected.directions
    if displacing + turning < len(AXES):
        text += (
            f" The joints correct the position in {displacing} of 3 directions and the rotation in {turning} of 3. "
            "These change with the pose; the rest of the error remains."
        )
    if values["not_made_up_for"]:
        text += f" No joint moves the tool along {', '.join(values['not_made_up_for'])} at any time."
    figure = doc.Figure(
        "errors", (_error_picture(result, tracking),), "What the tool misses its path by, in all and by part."
    )
    table = doc.Table(("part", "mean, µm", "max, µm", "mean, m°", "max, m°"), cells)
    return (doc.Section("Errors along the way", (doc.Paragraph(text), table, figure)),)


def _um(length_mm: float | None) -> str:
    return "–" if length_mm is None else f"{1e3 * length_mm:.3g}" if length_mm >= 1e-6 else "< 0.001"


def _error_picture(result: TrajectoryResult, tracking: Tracking) -> doc.Picture:
    curves = {"in all": tracking.total, **tracking.parts}

    def draw(axes: Axes) -> None:
        for i, (name, error) in enumerate(curves.items()):
            axes.plot(
                result.sampled.times,
                lengths_mm(error),
                "-",
                color=SERIES[i % len(SERIES)][0],
                linewidth=1.3,
                label=name,
            )
        axes.set(xlabel="time, s", ylabel="mm", title="errors of the tool")
        axes.legend(loc="best")

    return axes_picture("errors", "Errors of the tool over time", (7.5, 2.4), draw, (0.8, 0.5, 0.2, 0.3))


def _units(result: TrajectoryResult) -> list[str]:
    return ["mm" if slides else "°" for slides in result.robot.chain.prismatic]


def _positions(result: TrajectoryResult) -> Array:
    return joint_values(result.robot.chain.prismatic, result.sampled.joints)


def _rate_limits(result: TrajectoryResult) -> tuple[Array, Array]:
    return result.chain.speed, result.chain.acceleration


def _part_moves(axes: Axes, result: TrajectoryResult) -> None:
    for start in result.motion.starts[1:-1]:
        axes.axvline(start, color=GRID, linewidth=0.8, zorder=0)


def _position_pictures(result: TrajectoryResult) -> tuple[doc.Picture, ...]:
    """Draw each joint's position over time between its limits; its title says how near these it comes."""
    chain, times = result.robot.chain, result.sampled.times
    lower, upper = (joint_values(chain.prismatic, each) for each in (chain.lower, chain.upper))
    columns = zip(chain.joint_names, _units(result), _positions(result).T, lower, upper, strict=True)

    def picture(number: int, name: str, unit: str, positions: Array, low: float, high: float) -> doc.Picture:
        left = min(float(positions.min()) - low, high - float(positions.max()))
        title = f"{name}: {short(left)} {unit} from a limit" if np.isfinite(left) else f"{name}: no limits"
        room = 0.08 * (high - low)

        def draw(axes: Axes) -> None:
            axes.plot(times, positions, "-", color=SERIES[2][0], linewidth=1.8)
            _part_moves(axes, result)
            if np.isfinite(room):
                for limit in (low, high):
                    axes.axhline(limit, color=GATE, linewidth=1, linestyle="--")
                axes.set(ylim=(low - room, high + room))
            axes.set(xlabel="time, s", ylabel=f"position, {unit}", title=title)

        return axes_picture(f"position{number}", f"Position of {title}", (4.2, 1.9), draw, (0.65, 0.45, 0.1, 0.3))

    return tuple(picture(i, *column) for i, column in enumerate(columns))


def _rate_pictures(result: TrajectoryResult) -> tuple[doc.Picture, ...]:
    """Draw speeds and accelerations as percentages of their limits."""
    sampled, chain = result.sampled, result.chain
    rates = (("speeds", sampled.speeds, chain.speed), ("accelerations", sampled.accelerations, chain.acceleration))
    return tuple(
        _curves(name, result, 100 * values / limit, "% of the limit", limited=True) for name, values, limit in rates
    )


def _curves(name: str, result: TrajectoryResult, shown: Array, unit: str, *, limited: bool) -> doc.Picture:
    times, steps = result.sampled.times, name == "accelerations"
    names, title = result.robot.chain.joint_names, name
    if limited:
        row, worst = np.unravel_index(int(np.abs(shown).argmax()), shown.shape)
        title = f"{name}: nearest to its limit is {names[worst]}, at {times[row]:.2f} s"

    def draw(axes: Axes) -> None:
        for j, (joint, column) in enumerate(zip(names, shown.T, strict=True)):
            colour, style = SERIES[j % len(SERIES)][0], "steps-post" if steps else "default"
            axes.plot(times, column, "-", color=colour, linewidth=1.5, label=joint, drawstyle=style)
        _part_moves(axes, result)
        for limit in (-100, 100) if limited else ():
            axes.axhline(limit, color=GATE, linewidth=1, linestyle="--", zorder=0)
        axes.set(xlabel="time, s", ylabel=unit, title=title)
        if limited:
            axes.set(ylim=(-112, 112), yticks=(-100, -50, 0, 50, 100))
        axes.legend(loc="center left", bbox_to_anchor=(1.01, 0.5))

    return axes_picture(name, f"Joint {title}", (6.4, 2.6), draw, (0.7, 0.5, 0.7, 0.3))


def _legs(result: TrajectoryResult) -> doc.Table:
    rows = []
    for leg, start in zip(result.legs, result.motion.starts, strict=False):
        along = "" if np.isnan(leg.length_m) else f"{fixed(MM.of(leg.length_m), 2)} mm"
        along += f", turns {fixed(np.rad2deg(leg.turn_rad), 2)}°" if leg.turn_rad > 1e-9 else ""
        rows.append((" → ".join(leg.points), leg.kind, fixed(start, 5), fixed(leg.move.seconds, 5), along))
    columns = ("points", "move", "starts at, s", "takes, s", "path of the tool")
    return doc.Table(columns, tuple(rows), most_rows=_MAX_LEGS)


def _own_times(result: TrajectoryResult) -> tuple[doc.Table, ...]:
    """Tabulate the shortest time of each joint alone, and the joint that constrains the move."""
    rows = []
    for leg, values in zip(result.legs, result.to_dict()["legs"], strict=True):
        if values["constrained_by"] is not None:
            times = (fixed(sum(phases), 5) for phases in values["own_phases"])
            by_phase = ", ".join(name or "–" for name in values["phases_constrained_by"])
            rows.append((" → ".join(leg.points), *times, f"{values['constrained_by']} ({by_phase})"))
    names = (f"{name}, s" for name in result.robot.chain.joint_names)
    caption = (
        "Shortest time of each joint alone, not synchronised, and the joint that constrains the move (and each of its "
        "phases: change of speed, cruise, change of speed)."
    )
    heads = ("points", *names, "constrained by")
    return (doc.Table(heads, tuple(rows), caption, most_rows=_MAX_LEGS, rest_in="--json"),) if rows else ()


def _joints(result: TrajectoryResult) -> doc.Table:
    chain, sampled = result.chain, result.sampled
    low, high = (joint_values(chain.prismatic, each(sampled.joints, axis=0)) for each in (np.min, np.max))
    speeds, accelerations = result.motion.peaks
    rates = {"speed, per s": (speeds, chain.speed), "acceleration, per s²": (accelerations, chain.acceleration)}
    columns = [_peaks(result, *each) for each in rates.values()]
    rows = tuple(
        (name, "mm" if chain.prismatic[j] else "°", f"{fixed(low[j], 2)} … {fixed(high[j], 2)}",
         *(column[j] for column in columns))
        for j, name in enumerate(chain.joint_names)
    )  # fmt: skip
    return doc.Table(("joint", "", "from … to", *(f"peak {name}" for name in rates)), rows)


def _peaks(result: TrajectoryResult, peaks: Array, limits: Array) -> list[str]:
    """Format the largest rate of each joint, beside its limit."""
    shown = (joint_values(result.chain.prismatic, each) for each in (peaks, limits))
    return [
        f"{fixed(peak, 2)} of {fixed(most, 1)}" if most < np.inf else "not limited"
        for peak, most in zip(*shown, strict=True)
    ]
