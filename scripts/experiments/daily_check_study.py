"""How often does the daily check at a socket raise a false alarm, and does it name the joint whose zero moved?

Each arm has four configurations at one socket, of random ones that touch it those in which causes are told apart best,
at the best of five places. Errors of the touches are drawn: independent, or with what days share (a socket that drifts,
a tool and a socket that follow the temperature of a year, touches that are autocorrelated from day to day).
In years without a change alarms are counted.
In others a zero, the socket or the tool moves after a day drawn at random, by a multiple of the repeatability: the
standard deviation of a touch along an axis, against the ball's displacement (root mean square over configurations).
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from shared import Answer, Document, Flag, Section, named_values, paragraphs, run_script

from lab.calibration.statistics.joint_rounding import by_joint_positions
from lab.campaign.robot import load_virtual
from lab.core.random import rng_for
from lab.core.se3 import Array
from lab.sensors.socket import Sockets
from lab.verification.socket_checks import Cause, Scan, SocketChecks, best_configurations, causes_of

_CHOICES = 60  # configurations to choose from
_SIGMA_M = 20e-6
_WITHIN = 3  # checks
_PLACES = 5  # of the socket, of which the best is taken


@dataclass(frozen=True)
class Options:
    """How much to simulate."""

    robot: str = "irb120"
    """Which arm."""
    years: int = 1000
    """Years without a change, of independent noise; a fifth of each other kind."""
    days: int = 250
    """Checks a year."""
    slips: int = 200
    """Changes of each kind."""
    configurations: int = 4
    """At the socket."""
    arms: int = 10
    """Sets of configurations, each at a socket of its own."""
    times: float = 5.0
    """How far the ball is displaced, in repeatabilities."""
    seed: int = 0
    """Random seed."""
    json: Flag = False
    """Print one JSON object."""


def checks(robot_name: str, count: int, seed: int) -> SocketChecks:
    """Return the tests in configurations that tell causes apart, at the best of some places of the socket."""
    rng = rng_for(seed, "poses")
    found = [_at_a_socket(robot_name, count, rng) for _ in range(_PLACES)]
    return SocketChecks(max(found, key=lambda each: each[1])[0])


def _at_a_socket(robot_name: str, count: int, rng: np.random.Generator) -> tuple[tuple[Cause, ...], float]:
    """Return the causes in the best of random configurations at a socket within reach, and how distinct they are."""
    robot = load_virtual(robot_name)
    arm = robot.arm(("p1",))
    nominal = np.asarray(arm.nominal(robot.tool))
    model = Sockets(arm, nominal, (0,), ("",))
    at = arm.points(arm.structure_joints(1, rng), nominal)[0, 0]
    near = np.column_stack([arm.structure_joints(4 * _CHOICES, rng), np.zeros(4 * _CHOICES)])
    joints = model.inputs_in_contact(near, np.concatenate([nominal, at]))[:_CHOICES, :-1]
    if len(joints) < count:
        return (), 0.0
    by_joint = by_joint_positions(arm, joints, nominal, robot.chain.size)[:, 0]
    tool = [arm.names.index(f"tool.p1.{axis}") for axis in "xyz"]
    by_tool, points = arm.observe(joints, nominal)[1][:, 0][..., tool], arm.points(joints, nominal)[:, 0]
    names = robot.chain.joint_names
    chosen, share = best_configurations(names, by_joint, by_tool, points, count, rng)
    return causes_of(names, by_joint[chosen], by_tool[chosen], points[chosen], ("",) * count), share


def _autocorrelated(rng: np.random.Generator, shape: tuple[int, ...], rho: float) -> Array:
    noise, found = rng.standard_normal(shape), np.empty(shape)
    found[0] = noise[0]
    for day in range(1, shape[0]):
        found[day] = rho * found[day - 1] + np.sqrt(1 - rho**2) * noise[day]
    return found


def _shared(tests: SocketChecks, kind: str, numbers: Array) -> Array:
    columns = next(cause.columns for cause in tests.causes if cause.kind == kind)
    return np.asarray(numbers @ columns.T)


def _independent(tests: SocketChecks, days: int, rng: np.random.Generator) -> Array:
    return rng.standard_normal((days, len(tests.causes[0].columns)))


def _touches(tests: SocketChecks, days: int, rng: np.random.Generator) -> Array:
    return _autocorrelated(rng, (days, len(tests.causes[0].columns)), 0.7)


def _drift(tests: SocketChecks, days: int, rng: np.random.Generator) -> Array:
    return _independent(tests, days, rng) + _shared(tests, "socket", 2 * _autocorrelated(rng, (days, 3), 0.9))


def _temperature(tests: SocketChecks, days: int, rng: np.random.Generator) -> Array:
    """Socket and tool follow a temperature: a wave of a year, with weather and what differs from day to day."""
    year = 3 * np.sin(2 * np.pi * (np.arange(days) / 250 + rng.uniform()))
    temperature = year + _autocorrelated(rng, (days,), 0.8) + 0.5 * rng.standard_normal(days)
    follow = [temperature[:, None] * rng.normal(0, 1 / np.sqrt(3), 3) for _ in range(2)]
    return (
        _independent(tests, days, rng)
        + _shared(tests, "socket", follow[0])
        + _shared(tests, "tool", 0.3 * follow[1])
        + 0.1 * temperature[:, None] * rng.standard_normal(len(tests.causes[0].columns))
    )


NOISES: dict[str, Callable[[SocketChecks, int, np.random.Generator], Array]] = {
    "independent": _independent,
    "autocorrelated touches": _touches,
    "drifting socket": _drift,
    "temperature of the year": _temperature,
}


def _errors(tests: SocketChecks, noise: str, days: int, rng: np.random.Generator) -> Array:
    return _SIGMA_M * NOISES[noise](tests, days, rng).reshape(days, -1, 3)


def false_alarms(options: Options, arms: list[SocketChecks], noise: str) -> float:
    """Return the share of unchanged years with an alarm that lasts, or a bad touch."""
    stream: Any = f"noise {noise}"  # of its own
    rng, alarms = rng_for(options.seed, stream), 0
    years = options.years if noise == "independent" else max(1, options.years // 5)
    for year in range(years):
        tests = arms[year % len(arms)]
        found = tests.scan(_errors(tests, noise, tests.reference + options.days, rng))
        alarms += found.change is not None or bool(found.bad_touches)
    return alarms / years


def _moved(cause: Cause, times: float, rng: np.random.Generator) -> Array:
    """Return errors ``(m, 3)`` of a change in a random direction, in m."""
    numbers = rng.standard_normal(cause.columns.shape[1])
    errors = (cause.columns @ numbers).reshape(-1, 3)
    return np.asarray(errors * times * _SIGMA_M / np.sqrt((errors**2).sum(axis=1).mean()))


def _joints(found: Scan) -> list[str]:
    return [] if found.change is None else [c.cause.name for c in found.change.candidates if c.cause.kind == "joint"]


def changes(options: Options, arms: list[SocketChecks], noise: str) -> dict[str, dict[str, float]]:
    """Return by cause: shares detected, named within three checks, named with another, and of a wrong joint alone."""
    found: dict[str, dict[str, float]] = {}
    stream: Any = f"changes {noise}"  # of its own
    rng = rng_for(options.seed, stream)
    for index, first in enumerate(arms[0].causes):
        if first.kind == "touch":
            continue
        sums = dict.fromkeys(("detected", "named_alone", "among_the_named", "only_wrong_joints"), 0)
        delays = []
        for number in range(options.slips):
            tests = arms[number % len(arms)]
            before = tests.reference + int(rng.integers(0, 50))
            errors = _errors(tests, noise, before + _WITHIN, rng)
            errors[before:] += _moved(tests.causes[index], options.times, rng)
            last: Scan | None = None
            for checked in range(1, _WITHIN + 1):
                scan = tests.scan(errors[: before + checked])
                if scan.change is not None and last is None:
                    delays.append(checked)
                last = scan if scan.change is not None else last
            if last is None or last.change is None:
                continue
            named = [(c.cause.kind, c.cause.name) for c in last.change.candidates]
            sums["detected"] += 1
            sums["named_alone"] += last.change.named and named == [(first.kind, first.name)]
            sums["among_the_named"] += last.change.explained and (first.kind, first.name) in named
            sums["only_wrong_joints"] += bool(_joints(last)) and all(
                kind == "joint" and name != first.name for kind, name in named
            )
        name = f"{first.kind} {first.name}".strip()
        found[name] = {key: value / options.slips for key, value in sums.items()}
        found[name]["mean_delay_in_checks"] = float(np.mean(delays)) if delays else float("nan")
    return found


def answer(options: Options) -> Answer:
    """Count false alarms by each noise, and what is named after a change by independent and by drifting noise."""
    arms = [checks(options.robot, options.configurations, options.seed + arm) for arm in range(options.arms)]
    alarms = {noise: false_alarms(options, arms, noise) for noise in NOISES}
    moved = {noise: changes(options, arms, noise) for noise in ("independent", "temperature of the year")}
    sections = [Section("years without a change that raise an alarm", paragraphs(named_values(alarms)))]
    for noise, by_cause in moved.items():
        sections += [
            Section(f"{cause} moved, noise: {noise}", paragraphs(named_values(values)))
            for cause, values in by_cause.items()
        ]
    values = {"years_with_an_alarm": alarms, "changes": moved}
    return Answer(values, Document("The daily check at a socket", tuple(sections)))


if __name__ == "__main__":
    run_script("daily_check_study")
