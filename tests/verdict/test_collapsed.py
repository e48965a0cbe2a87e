"""Links of another arm, where readings alone constrain their sizes, are named, and no error is stated."""

from dataclasses import replace

import numpy as np
import pytest
from helpers.campaigns import session

import lab
from lab.calibration.identification import Identification, identify
from lab.sensors.sensor_registry import sensor_named


def fitted(observe: str) -> Identification:
    simulated, sensor = session("irb120", observe=observe, poses=60, seed=4), sensor_named(observe)()
    data = simulated.measurements
    arm = simulated.robot.arm(sensor.targets(data))
    model, observed = sensor.observation(arm, data, arm.nominal())
    observation = getattr(model, "nominal", None)
    return identify(model, observed, arm.nominal() if observe == "points" else observation(arm.nominal()))


def moved(found: Identification, name: str, by: float) -> Identification:
    values = found.values.copy()
    values[found.model.names.index(name)] += by
    return replace(found, values=values)


@pytest.mark.parametrize(
    ("name", "by", "is_named"),
    [("link2.alpha", 1.5, True), ("link3.a", -0.05, True), ("link3.theta", 0.5, False), ("link2.alpha", 0.05, False)],
)
def test_a_link_of_another_arm_is_named_where_contacts_alone_constrain_it(name: str, by: float, is_named: bool) -> None:
    found = fitted("plane")
    assert found.collapsed == ()
    assert (name in moved(found, name, by).collapsed) == is_named


def test_points_constrain_the_arm() -> None:
    assert moved(fitted("points"), "link2.alpha", np.pi / 2).collapsed == ()


@pytest.mark.thorough
def test_a_sound_campaign_of_contacts_states_its_errors() -> None:
    result = lab.identify(session("irb120", observe="plane", poses=60, seed=4).measurements, observe="plane")
    assert not result.state.identification.collapsed and result.validated
