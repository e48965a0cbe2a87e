"""Make the sentences of ``lab payload`` and ``lab dynamics`` from their checks."""

from collections.abc import Callable, Sequence

from lab.core.checks import Check
from lab.core.errors import counted
from lab.core.units import MM

__all__ = ["phrase"]

_CAUSES = {
    "arm.delay": "a delay between torques and positions; estimate it (delay)",
    "arm.filter": "a filter that torques came through and positions did not; record without it",
    "arm.load": "a load other than the one that was given; mend it, or have it estimated",
    "arm.load_friction": "friction that grows with what a joint bears",
    "arm.unmodelled_friction": "friction that the model leaves out; take it in",
    "compliance": "compliances other than those given; identify them with a load that was weighed",
    "difference.constant": "a steady torque of each joint, as stiction leaves; approach each pose from both sides",
    "difference.delay": "a delay between torques and positions; estimate it (delay)",
    "difference.filter": "a filter of torques but not of positions; record without it, or filter both",
    "difference.friction": "friction that grows with the load; estimate it (friction)",
    "difference.gains": "gains of the joints' torques",
    "sensor.base_tilt": "a base that is tilted; estimate it (tilt)",
    "sensor.delay": "a delay between wrench and positions; estimate it (delay)",
    "sensor.filter": "a filter that the wrench came through",
    "sensor.mounting": "a sensor that is turned; estimate it (turn)",
    "sensor.scale": "gains of the sensor's axes; calibrate the sensor",
    "slow": "something slow without a name, as the load's own torques are slow",
    "unequal_paths": (
        "the difference between the two runs' paths; subtract the arm's own dynamics, or better ones (own)"
    ),
}  # of residuals that noise does not explain, by ``BiasCandidate.name``


def phrase(check: Check) -> str:
    """Return the clause that states a check."""
    if check.name == "residuals":
        return _residuals(check)
    return _PHRASES[check.name](**check.data)


def _residuals(check: Check) -> str:
    if check.outcome == "not tested":
        return "the residuals are too few to test whether they are noise"
    counts = f"(p = {check.p:.2g}, the least of {check.data['tests']} tests)"
    if check.outcome == "passed":
        return f"the residuals are what independent noise explains {counts}"
    return f"the intervals are too small: the residuals follow {_CAUSES[check.data['cause']]} {counts}"


def _unlike_weight(drive: str, correlation: float, other: str, other_correlation: float) -> str:
    like = "" if other == drive else f", and that of {other} is {other_correlation:.2g}"
    return (
        f"without a load, the torque of {drive} does not follow the arm's own weight (correlation {correlation:.2g}"
        f"{like}): are signs and order of the torques right, and the joint positions?"
    )


def _far_centre(distance_m: float, reach_m: float, units: Sequence[tuple[str, float]]) -> str:
    causes = [f"{unit} (it would be {millimetres:.3g} mm away)" for unit, millimetres in units]
    return (
        f"the centre of mass is {distance_m:.3g} m from the flange, farther than the arm reaches ({reach_m:.2g} m): "
        f"are {', or '.join(causes) or 'moments in another unit'}?"
    )


def _gravity(times: float, in_nmm: bool) -> str:
    cause = "are torques in Nmm?" if in_nmm else "are torques in another unit, or is gravity taken out of them?"
    return f"gravity asks {times:.3g} times what it asks of the arm's nominal masses: {cause}"


def _better(left: float, left_here: float, kg: float) -> str:
    return (
        f"{100 * left:.2g} % of what was measured is then left unexplained, and {100 * left_here:.2g} % is as the file "
        f"stands (the payload would be {kg:.3g} kg)"
    )


_DRIVE_CAUSE = "is its torque in another unit, a current, or without the gear ratio?"
_PHRASES: dict[str, Callable[..., str]] = {
    "channel.constant": lambda channel, value, rows, run: (
        f"{channel} is {value:.4g} in all {rows} rows of the {run} run: is its sensor connected, and is the column the "
        "right one?"
    ),
    "channel.saturated": lambda channel, count, rows, run: (
        f"{channel} stays at the end of its range in {count} of the {rows} rows of the {run} run: it saturates; move "
        "more slowly, or with a smaller load"
    ),
    "channel.unlike_weight": _unlike_weight,
    "sample.wild": lambda column, sigmas, part: (
        f"a sample of column {column} of what is explained is {sigmas:.0f} standard deviations off, at {part:.0%} of "
        "the rows: the intervals are invalid; fix it, or leave it out"
    ),
    "points.elsewhere": lambda distance_m: (
        f"the points are {MM.text(distance_m)} from where the calibrated arm has them: are they in the frame, the "
        "axes and the unit of the run? Measure from the same base frame, or calibrate again"
    ),
    "mass.large": lambda kg, most_kg, unit: (
        f"{kg:.4g} kg are more than an arm of its size carries ({most_kg:.3g} kg): are torques or forces in {unit}?"
    ),
    "mass.negative": lambda kg: f"the payload would weigh {kg:.3g} kg: are loaded and unloaded rows exchanged?",
    "mass.uncertain": lambda kg, half_width_kg: (
        f"the mass is {kg:.2g} ± {half_width_kg:.2g} kg, which no load at all explains as well: was one carried, and "
        "are loaded and unloaded rows marked as they were?"
    ),
    "centre.far": _far_centre,
    "otherwise.shifted": lambda rows, **found: (
        f"the joint positions seem to be {counted(abs(rows), 'row')} {'later' if rows > 0 else 'earlier'} than what "
        f"was measured there: {_better(**found)}"
    ),
    "otherwise.half": lambda half, **found: (
        f"every row is marked as loaded, but only the {half} half seems to be: {_better(**found)}"
    ),
    "otherwise.radians": lambda **found: (
        f"the joint positions seem to be radians in columns of degrees: {_better(**found)}"
    ),
    "otherwise.degrees": lambda **found: (
        f"the joint positions seem to be degrees in columns of radians: {_better(**found)}"
    ),
    "torques.constant": lambda: (
        "the torques do not change along the motion: are they of another record, or of drives that were off?"
    ),
    "torques.unexplained": lambda percent: (
        f"the motion does not explain {percent:.2g} % of what the torques change by: are torques and positions of the "
        "same motion, of the same joints, in the units of their columns?"
    ),
    "gravity.differs": _gravity,
    "drive.weak": lambda drive, times: (
        f"the drive of {drive} gives {times:.2g} times the torque that the nominal masses need: {_DRIVE_CAUSE}"
    ),
    "drive.strong": lambda drive, times: (
        f"the drive of {drive} gives {times:.2g} times the largest torque that nominal masses need: {_DRIVE_CAUSE}"
    ),
    "arm.impossible": lambda sigmas, p: (
        f"the parameters are {sigmas:,.4g} standard deviations from those of any arm, whose masses, inertias and "
        f"friction are positive (p = {p:.2g}): are the signs, the order and the units of the torques right, and does "
        "each drive turn its joint?"
    ),
}  # by the check's name, from its data
