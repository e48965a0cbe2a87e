"""Mistakes in readings at fixtures are named by how far the nominal arm misses them, read otherwise."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from helpers.campaigns import session

from lab.core.measurements import Measurements
from lab.diagnosis.hypothesis import Hypothesis
from lab.kinematics.model import RigidArm
from lab.sensors.fixtures import FixtureSensor
from lab.sensors.sensor_registry import sensor_named

KINDS = ("socket", "plane", "cable", "dial", "ball-bar")


def rows(kind: str, robot: str = "ur5e", poses: int = 60) -> tuple[FixtureSensor, RigidArm, Measurements]:
    simulated, sensor = session(robot, observe=kind, poses=poses, seed=4), sensor_named(kind)()
    assert isinstance(sensor, FixtureSensor)
    return sensor, simulated.robot.arm(sensor.targets(simulated.measurements)), simulated.measurements


def cost(misses: np.ndarray) -> float:
    """Capped squares (mm²): a row that is far off counts as 50 mm."""
    return float((np.minimum(1e3 * misses[~np.isnan(misses)], 50.0) ** 2).mean())


def best(sensor: FixtureSensor, arm: RigidArm, data: Measurements) -> tuple[Hypothesis | None, float, float]:
    nominal = arm.nominal()
    tried: list[tuple[float, Hypothesis | None]] = [(np.inf, None)]
    for each in sensor.mistakes(arm, data):
        assert each.corrected is not None
        read = each.sensor or sensor
        tried.append((cost(read.misses(arm, each.corrected(data), nominal)), each))
    least, named = min(tried, key=lambda pair: pair[0])
    return named, least, cost(sensor.misses(arm, data, nominal))


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("robot", ["irb120", "ur5e"])
def test_a_nominal_arm_misses_sound_readings_by_little_also_where_some_are_wrong(kind: str, robot: str) -> None:
    sensor, arm, data = rows(kind, robot)
    misses = sensor.misses(arm, data, arm.nominal())
    assert np.median(misses) < 3e-3
    if kind == "dial":  # its stroke is 10 mm: many readings of another row are as near as a nominal arm comes
        return
    # joint positions of every fifth row are those of another one
    some = np.arange(0, len(data), 5)
    joints = data.joints.copy()
    joints[some] = np.roll(joints[some], 1, axis=0)
    spoilt = sensor.misses(arm, replace(data, joints=joints), arm.nominal())
    rest = np.setdiff1d(np.arange(len(data)), some)
    assert np.median(spoilt[rest]) < 2 * np.median(misses) + 5e-4


def test_rows_at_another_socket_are_named() -> None:
    sensor, arm, data = rows("socket")
    wrong = [7, 20, 33]
    other = {"a": "b", "b": "a"}
    sockets = tuple(other[name] if i in wrong else name for i, name in enumerate(data.other["socket"]))
    named, least, as_read = best(sensor, arm, replace(data, other={**data.other, "socket": sockets}))
    assert named is not None and named.name == "socket_exchanged"
    assert sorted(named.of) == sorted(data.ids[i] for i in wrong)
    assert least < as_read / 4
    assert (
        named.corrected(replace(data, other={**data.other, "socket": sockets})).other["socket"] == data.other["socket"]
    )


@pytest.mark.parametrize(
    ("kind", "name", "moved"),
    [
        ("socket", "socket_moved", lambda data: data),
        ("cable", "cable_unit", lambda data: data),
    ],
)
def test_sound_readings_are_not_far_better_otherwise(
    kind: str, name: str, moved: Callable[[Measurements], Measurements]
) -> None:
    sensor, arm, data = rows(kind)
    named, least, as_read = best(sensor, arm, data)
    assert named is None or least > 0.4 * as_read


@pytest.mark.parametrize(("unit", "factor"), [("cm", 0.1), ("inches", 1 / 25.4), ("m", 1e-3)])
def test_the_unit_of_a_cable_is_named(unit: str, factor: float) -> None:
    sensor, arm, data = rows("cable")
    wrong = replace(data, conditions={**data.conditions, "cable_mm": factor * data.conditions["cable_mm"]})
    named, least, as_read = best(sensor, arm, wrong)
    assert named is not None and (named.name, named.of) == ("cable_unit", (unit,))
    assert least < as_read / 10


def test_the_unit_of_a_distance_between_sockets_is_named() -> None:
    _, arm, data = rows("socket")
    named, least, as_read = best(sensor_named("socket")(distance_m=0.01), arm, data)  # 0.1 m, in cm
    assert named is not None and (named.name, named.of) == ("socket_unit", ("cm",))
    assert least < as_read / 4


def test_an_anchor_that_moved_within_a_session_is_named_with_the_row() -> None:
    sensor, arm, data = rows("cable", poses=80)
    one = sorted(set(data.sessions))[0]
    of_it = [i for i, name in enumerate(data.sessions) if name == one]
    lengths = data.conditions["cable_mm"].copy()
    later = of_it[len(of_it) // 2 :]
    lengths[later] += 40.0
    named, least, as_read = best(sensor, arm, replace(data, conditions={**data.conditions, "cable_mm": lengths}))
    assert named is not None and named.name == "anchor_moved" and named.of == (one, data.ids[later[0]])
    assert least < as_read / 4


def test_a_reading_at_a_fixture_with_too_few_rows_cannot_be_explained() -> None:
    sensor, arm, data = rows("socket")
    names = ("alone", *data.other["location"][1:])
    misses = sensor.misses(arm, replace(data, other={**data.other, "location": names}), arm.nominal())
    assert np.isinf(misses[0]) and np.isfinite(misses[1:]).all()
