"""A sensor of one's own from a function of the tool's pose: parameters are recovered, and a wrong one is refused."""

from dataclasses import replace
from typing import Any

import numpy as np
import own_sensors
import pytest

import lab
from lab import extension_points
from lab.core.errors import LabError
from lab.robots.load_robot import load_virtual

ROBOT = load_virtual("irb120")
SENSORS = (own_sensors.Wire, own_sensors.Inclinometer, own_sensors.LaserLine)


@pytest.fixture(autouse=True)
def _own_parts(monkeypatch: pytest.MonkeyPatch) -> None:
    """The sensors of a test, in it alone."""
    monkeypatch.setattr(extension_points, "_given", {})


@pytest.mark.thorough
@pytest.mark.parametrize("sensor", SENSORS)
@pytest.mark.parametrize("sigma", [20e-6, 1e-9])
def test_parameters_are_recovered_and_as_surely_as_said(sensor: type[lab.Sensor], sigma: float) -> None:
    """The normalized squared error of f parameters is chi squared over f: within 4 of its standard deviations.

    Almost without noise they are recovered to nanometres and nanoradians, times the condition.
    """
    kind = type("Sized", (sensor,), {"sigma": sigma})
    result = lab.calibrate("irb120", poses=80, seed=7, observe=kind)
    assert result.truth is not None
    compared = result.truth.comparison
    assert compared is not None
    assert result.verdict.word == "good"
    count = len(compared.error)
    assert abs(compared.nees_per_parameter - 1) < 4 * np.sqrt(2 / count) and compared.coverage_95 > 0.8
    names = {f"{sensor.name}.{symbol}" for symbol in sensor.parameters}
    assert names <= set(result.estimate.identified)
    if sigma < 1e-8:
        assert np.abs(compared.error).max() < 1e-6


@pytest.mark.parametrize("sensor", SENSORS)
def test_derivatives_are_those_of_the_readings(sensor: type[lab.Sensor]) -> None:
    arm = ROBOT.arm(("p1",))
    rng = np.random.default_rng(0)
    joints = ROBOT.chain.random_joints(6, rng)
    data = lab.measurements(joints, robot=ROBOT, conditions={column: np.ones(6) for column in sensor.columns_read})
    model, rows = sensor().observation(arm, data, arm.nominal(ROBOT.tool))
    assert len(rows) == 6
    values = model.nominal(arm.nominal(ROBOT.tool))
    values += 1e-3 * rng.standard_normal(len(values))
    _, derivative = model.observe(joints, values)
    step = 1e-5
    for i in range(len(values)):
        moved = step * (np.arange(len(values)) == i)
        slope = (model.points(joints, values + moved) - model.points(joints, values - moved)) / (2 * step)
        np.testing.assert_allclose(derivative[..., i], slope, atol=1e-8)  # differences: step squared, rounding over it


@pytest.mark.thorough
def test_a_wrong_unit_and_a_wrong_model_are_not_called_good() -> None:
    """A right one is: the tests of points, which know the robot's size, are not made of other quantities."""
    day = lab.simulate("irb120", poses=80, seed=7, observe=own_sensors.Wire)
    assert lab.identify(day.measurements, observe=own_sensors.Wire).verdict.word == "good"
    metres = {"wire_mm": day.measurements.conditions["wire_mm"] / 1000}
    wrong = lab.identify(replace(day.measurements, conditions=metres), observe=own_sensors.Wire)
    assert wrong.verdict.word != "good"

    class Squared(own_sensors.Wire):
        def readings(self, Ts: np.ndarray, values: np.ndarray) -> np.ndarray:
            return super().readings(Ts, values) ** 2

    assert lab.identify(day.measurements, observe=Squared).verdict.word != "good"


@pytest.mark.thorough
def test_a_sensor_of_one_s_own_measures_beside_points_and_its_run_is_loaded_again(tmp_path: Any) -> None:
    result = lab.calibrate("irb120", poses=60, seed=7, observe=("points", own_sensors.Wire))
    assert result.options.observe == "points+wire" and result.truth is not None
    assert result.truth.comparison is not None and 0.4 < result.truth.comparison.nees_per_parameter < 2
    run = lab.calibrate("irb120", poses=80, seed=7, observe=own_sensors.Wire).save(tmp_path / "run")
    extension_points._given.clear()
    with pytest.raises(LabError, match="observe wire: unknown; give one of points"):
        lab.load_run(run)
    assert "wire.x" in lab.load_run(run, parts=[own_sensors.Wire]).estimate.identified


WRONG: dict[str, tuple[dict[str, Any], str]] = {
    "unit": ({"columns_read": ("wire",)}, r"end the column wire with its unit, _mm, _mrad, _deg"),
    "name": ({"name": "tool"}, "parameters of the arm have this name"),
    "two": ({"columns_read": ("one_mm", "two_mm")}, "readings returns 1 a pose; return 2"),
}


@pytest.mark.parametrize("case", WRONG)
def test_an_impossible_sensor_is_refused(case: str) -> None:
    changes, said = WRONG[case]
    with pytest.raises(LabError, match=said):
        lab.simulate("irb120", poses=10, observe=type("Wrong", (own_sensors.Wire,), {"columns_read": (), **changes}))
    with pytest.raises(LabError, match="column wire_mm is missing"):
        lab.identify(lab.simulate("irb120", poses=10).measurements, observe=own_sensors.Wire)
