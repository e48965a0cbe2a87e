"""Several sensors in one fit: rows of each, ratios of their noises, and what they show together."""

import numpy as np
import pytest
from helpers.robots import IRB120, assert_derivatives

import lab
from lab.calibration.fit_options import PLAIN
from lab.calibration.identification import identify
from lab.core.errors import LabError
from lab.kinematics.serial.serial_arm import SerialArm
from lab.sensors.combined import Combined, combined_sensor
from lab.sensors.sensor_options import FitInputs, SensorOptions
from lab.sensors.sensor_registry import sensor_named

ARM = SerialArm(IRB120.chain)
NOMINAL = ARM.nominal(IRB120.tool)


def observed(observe: str, **options: object) -> tuple[Combined, lab.Measurements]:
    day = lab.simulate("irb120", observe=observe, **{"poses": 8, "seed": 1, "instrument": "exact", **options})
    sensor = sensor_named(observe).configured(SensorOptions(), FitInputs())
    model, data = sensor.observation(ARM, day.measurements, NOMINAL)
    assert isinstance(model, Combined)
    return model, data


def test_derivatives_are_those_of_the_prediction() -> None:
    model, data = observed("points+pixels", poses=3)
    inputs = data.inputs(model.conditions)[:: max(len(data) // 10, 1)]
    values = model.nominal(NOMINAL) + 0.01 * np.random.default_rng(0).standard_normal(len(model.names))
    assert_derivatives(lambda v: model.points(inputs, v), model.observe(inputs, values)[1], values)


@pytest.mark.parametrize("observe", ["points+pixels", pytest.param("socket+pixels", marks=pytest.mark.thorough)])
def test_without_noise_everything_is_found(observe: str) -> None:
    result = lab.calibrate("irb120", observe=observe, poses=14, seed=2, instrument="exact", size_u_percent=0.0)
    assert result.truth.comparison is not None and np.abs(result.truth.comparison.error).max() < 1e-9


def test_a_row_holds_the_numbers_of_its_sensor_alone() -> None:
    model, data = observed("points+pixels")
    sensor = data.conditions["fixture sensor"]
    seen = np.isfinite(data.points[..., 0])
    assert (seen[sensor == 0] == [True, True, True, False, False]).all()
    assert (seen[sensor == 1] == [False, False, False, True, True]).all()
    assert len(model.units) == 5 and model.conditions[-1] == "fixture sensor"


@pytest.mark.thorough
def test_ratios_of_noises_are_estimated() -> None:
    result = lab.calibrate("irb120", observe="points+pixels", poses=40, seed=3, instrument="optical-cmm")
    values = result.to_dict()
    assert values["noise_mm"] == pytest.approx(0.03, rel=0.2) and values["noise_px"] == pytest.approx(0.1, rel=0.1)
    assert result.truth.comparison is not None and 0.6 < result.truth.comparison.nees_per_parameter < 1.6


def test_two_sensors_together_are_better_than_each() -> None:
    """The covariance of both is that of the sum of their informations, with the same noise."""
    day = lab.simulate("irb120", observe="points+pixels", poses=12, seed=4, instrument="optical-cmm")
    data, stds = day.measurements, {}
    for observe in ("points", "points+pixels"):
        sensor = sensor_named(observe).configured(SensorOptions(), FitInputs())
        rows = np.flatnonzero(sensor.rows(data))
        model, table = sensor.observation(ARM, data[rows], NOMINAL)
        model = sensor.balanced(model, table, NOMINAL, PLAIN)
        found = identify(model, table.with_points(), NOMINAL)
        stds[observe] = dict(zip([model.names[i] for i in found.fit.free], found.std / found.sigma_m, strict=True))
    links = [name for name in stds["points"] if name.startswith("link") and name in stds["points+pixels"]]
    assert len(links) >= 15 and all(stds["points+pixels"][name] < stds["points"][name] for name in links)


def test_names_that_cannot_measure_together_are_refused() -> None:
    for names, said in (
        (("points", "points"), "name each sensor once"),
        (("points", "pose"), "poses hold the points too"),
        (("points", "nothing"), "unknown"),
    ):
        with pytest.raises(LabError, match=said):
            combined_sensor(names)
    day = lab.simulate("irb120", poses=6, seed=0)
    sensor = sensor_named("points+pixels").configured(SensorOptions(), FitInputs())
    with pytest.raises(LabError, match="no row holds a corner in a picture"):
        sensor.observation(ARM, day.measurements, NOMINAL)
