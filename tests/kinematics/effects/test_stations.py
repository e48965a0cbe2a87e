"""Stations of an instrument: what is fitted undoes what is simulated, whatever else moves the frame."""

import numpy as np

from lab.core import se3
from lab.core.measurements import STATION
from lab.kinematics.effects.arm_with_effects import affected
from lab.kinematics.effects.effect import PoseConditions
from lab.kinematics.effects.sessions import (
    StationPoses,
    at_first_station,
    further_stations,
    station_parameters,
    stations,
)
from lab.kinematics.effects.temperature import drift
from lab.robots.load_robot import load_robot

ROBOT = load_robot("irb120")
PLACES = np.stack(
    [
        se3.pose(se3.exp(np.array(turn)), np.array(place))
        for turn, place in (
            ((0.0, 0.0, 0.0), (1.0, 2.0, 3.0)),
            ((0.1, 0.2, 2.9), (2.0, 3.0, -0.4)),
            ((0.3, -1.0, 0.2), (-2.0, 0.5, 0.1)),
        )
    ]
)


def seen(rows: int = 9) -> tuple[np.ndarray, np.ndarray]:
    """Joint positions with a time, and which station measures each pose."""
    rng = np.random.default_rng(3)
    station = np.arange(rows) % 3
    joints = ROBOT.chain.random_joints(rows, rng)
    return np.column_stack([joints, station == 1, station == 2, rng.uniform(0, 3600, rows)]), station


def test_points_are_seen_from_each_station_after_what_else_moves_the_frame() -> None:
    rng = np.random.default_rng(1)
    inputs, station = seen()
    alone = affected(ROBOT.arm(("p1", "p2")), [drift(0.0)])
    arm = affected(ROBOT.arm(("p1", "p2")), [*stations(("a", "b", "c")), drift(0.0)])
    geometry, moved = alone.nominal(ROBOT.tool)[: len(alone.rigid.names)], 1e-3 * rng.normal(size=7)
    first = alone.points(inputs[:, [*range(6), 8]], np.concatenate([geometry, moved]))
    there = arm.points(inputs, np.concatenate([geometry, station_parameters(PLACES).ravel(), moved]))
    Ts_first_station = se3.inverse(PLACES[0]) @ PLACES
    for k, T in enumerate(Ts_first_station):
        np.testing.assert_allclose(there[station == k], se3.transform(se3.inverse(T), first[station == k]), atol=1e-13)
    simulated = StationPoses({"b": Ts_first_station[1], "c": Ts_first_station[2]})
    columns = {STATION + "b": inputs[:, 6], STATION + "c": inputs[:, 7]}
    by_effect = simulated.seen_after(first, PoseConditions(columns, len(first), ROBOT.chain.joint_names))
    np.testing.assert_allclose(there, by_effect, atol=1e-13)
    truth, further = simulated.true_parameters(), further_stations(arm.parameters)
    for k, name in ((0, "b"), (1, "c")):
        known = [truth[f"station.{name}.{axis}"] for axis in ("x", "y", "z", "rx", "ry", "rz")]
        np.testing.assert_allclose(known, station_parameters(PLACES)[k], atol=1e-13)
        assert arm.names[further[STATION + name][0]] == f"station.{name}.x"


def test_derivatives_are_those_of_differences() -> None:
    inputs, _ = seen()
    arm = affected(ROBOT.arm(("p1",)), [*stations(("a", "b", "c")), drift(0.0)])
    values = np.concatenate(
        [ROBOT.arm(("p1",)).nominal(ROBOT.tool), station_parameters(PLACES).ravel(), 1e-3 * np.ones(7)]
    )
    jacobian = arm.observe(inputs, values)[1]
    for i in range(len(values)):
        step = np.zeros(len(values))
        step[i] = 1e-6
        slope = (arm.points(inputs, values + step) - arm.points(inputs, values - step)) / 2e-6
        np.testing.assert_allclose(jacobian[..., i], slope, atol=2e-8)


def test_the_first_station_needs_no_parameters() -> None:
    inputs, _ = seen()
    arm = affected(ROBOT.arm(("p1",)), [*stations(("a", "b", "c")), drift(0.0)])
    assert stations(("a",)) == () and stations(()) == ()
    first = at_first_station(arm.conditions, inputs)
    assert not first[:, 6:8].any() and (first[:, [*range(6), 8]] == inputs[:, [*range(6), 8]]).all()
    assert at_first_station(("time_s",), inputs) is inputs
