"""What ``lab design`` prints for a person."""

from pathlib import Path
from typing import Any

from rich.console import Console
from rich.table import Table

from lab.commands.design.result import plan_summary
from lab.commands.design.run import Plan
from lab.formats.programs.protocol import PAUSE_S
from lab.formats.programs.registry import PLAN, planned_in


def print_plan(plan: Plan, folder: Path) -> None:
    """The plan in a few lines: what it promises, how good it is, how long it takes, where it is."""
    console, seen = Console(highlight=False, markup=False), plan_summary(plan)
    console.print(f"{seen['robot']}: {headline(seen)}")
    console.print(promise(seen))
    console.print(_curve(seen))
    console.print(certificate(seen))
    console.print(indices_line(seen))
    console.print(candidates_line(seen))
    console.print(tour_line(seen))
    languages, refusals = planned_in(seen)
    programs = "".join(f", {PLAN}{language.suffix} for the controller" for language in languages)
    console.print(f"plan.csv to measure{programs}, curve.png, poses.png, recording.rrd")
    for why in refusals:
        console.print(why)
    console.print(f"plan: {folder}", soft_wrap=True)


def headline(seen: dict[str, Any]) -> str:
    """What was chosen, for what."""
    already = f", added to {seen['measured_already']} measured already" if seen["measured_already"] else ""
    return (
        f"{seen['poses']} poses{already}, targets {', '.join(seen['targets'])}, {seen['instrument']}: "
        f"{seen['parameters']} parameters, criterion {seen['criterion']}"
    )


def promise(seen: dict[str, Any]) -> str:
    """The accuracy, in words."""
    predicted = seen["predicted_mm"]
    return (
        f"predicted error on fresh poses, from the instrument's noise alone, the robot being rigid: "
        f"{predicted['rms']:.4f} mm RMS over all poses, {predicted['max']:.4f} mm RMS at the worst one; "
        f"95 % of the poses within {seen['promise_mm']:.4f} mm in 95 % of the campaigns"
    )


def certificate(seen: dict[str, Any]) -> str:
    """How far from the best possible."""
    return (
        f"certified D-efficiency {seen['d_efficiency']:.3f}, against {seen['pool']['what']} "
        f"(bound's gap {100 * seen['bound_gap']:.2f} %)"
    )


def indices_line(seen: dict[str, Any]) -> str:
    """The observability indices with their scaling."""
    values = seen["indices"]
    names = ("o1", "o2", "o3", "o4", "o5", "condition")
    shown = [f"{name.upper() if name[0] == 'o' else name} {_short(values[name]['value'])}" for name in names]
    return f"{', '.join(shown)} ({values['o1']['scaling']})"


def candidates_line(seen: dict[str, Any]) -> str:
    """How many poses were looked at, and why the others cannot be measured."""
    found, lost = seen["candidates"], seen["candidates"]["rejected"]
    singular = f"{lost['singularity']:,} near a parallel singularity, " if lost["singularity"] else ""
    return (
        f"{found['feasible']:,} feasible candidates of {found['drawn']:,} drawn; rejected: {lost['limits']:,} near a "
        f"joint limit, {singular}{lost['collision']:,} in collision, {lost['visibility']:,} not in the tracker's sight"
    )


def tour_line(seen: dict[str, Any]) -> str:
    """How long the day is."""
    via = f", {seen['via']} of them by way of poses that are only passed" if seen["via"] else ""
    moving = [f"{PLAN}{each.suffix} moves at {each.speed}" for each in planned_in(seen)[0]]
    slower = f"({', '.join(moving)}, which takes longer), " if moving else ""
    return (
        f"tour: {seen['moves']} moves{via}, {seen['tour_seconds']:.1f} s at full speed and acceleration, home to home "
        f"{slower}and {PAUSE_S} s of waiting at each pose"
    )


def _curve(seen: dict[str, Any]) -> Table:
    table = Table(title="mm on fresh poses, by number of poses", title_justify="left")
    for heading in ("poses", "RMS", "worst pose", "95 % in 95 %", "O1"):
        table.add_column(heading, justify="right")
    for step in seen["curve"]:
        lengths = [f"{step[key]:.4f}" for key in ("rms_mm", "worst_mm", "promise_mm")]
        table.add_row(str(step["poses"]), *lengths, f"{step['o1']:.2f}")
    return table


def _short(value: float | None) -> str:
    return "∞" if value is None else f"{value:.4g}"
