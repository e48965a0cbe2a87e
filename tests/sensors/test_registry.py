"""The registry of sensors: each answers by its name, and takes its own options."""

import inspect
from dataclasses import fields

import pytest

from lab.calibration.sensor import ArmSensor
from lab.core.errors import LabError
from lab.sensors.sensor_options import FitInputs, SensorOptions, VirtualSetup
from lab.sensors.sensor_registry import SENSORS, configured_sensor, sensor_named
from lab.sensors.virtual_sensor import VirtualSensor


@pytest.mark.parametrize("name", [*SENSORS, "pixels"])
def test_a_sensor_is_registered_by_its_name(name: str) -> None:
    kind = sensor_named(name)
    assert kind.name == name and VirtualSensor in kind.__mro__
    assert not inspect.isabstract(kind)
    assert configured_sensor(name, SensorOptions(), FitInputs()) == kind()
    for declared in inspect.get_annotations(ArmSensor):  # what has no default is said by every kind
        assert hasattr(kind, declared), declared
    assert set(kind.setup) <= {field.name for field in fields(VirtualSetup)}
    words = kind.terms
    assert all(getattr(words, field.name) for field in fields(words) if field.name != "names_targets")


REFUSED = {
    "unknown": ("camera", {}, {}, "--observe camera: unknown; give one of points, pose, cable"),
    "another kind's flag": ("points", {"orientation": "fixed-xyz"}, {}, "--orientation is of --observe pose; give"),
    "another kind's value": ("cable", {"method": "sequential"}, {}, "--method sequential is of --observe pose; give"),
    "another kind's distance": (
        "pose",
        {"socket_distance_mm": 50.0},
        {},
        "--socket-distance-mm is of --observe socket",
    ),
    "a file of cameras": ("points", {"noise_px": 0.1}, {}, "--noise-px is of --observe pixels; give that too"),
    "a radius of nothing touched": ("points+plane", {"tip_radius_mm": 2.0}, {}, "--tip-radius-mm is of --observe cube"),
    "a distance of nothing": ("socket", {"socket_distance_mm": 0.0}, {}, "--socket-distance-mm 0: give a number above"),
    "a noise alone": ("pose", {"noise_mrad": 0.1}, {}, "--noise-mrad sets the weight .* --noise-mm too"),
    "a noise of nothing": ("pose", {"noise_mrad": 0.0}, {"noise_mm": 0.1}, "--noise-mrad 0: give a number above zero"),
    "sequential with a prior": ("pose", {"method": "sequential"}, {"prior": True}, "--prior is of --method global"),
    "an instrument": ("cable", {}, {"instrument": True}, "--observe cable: --validate and --instrument are of points"),
    "a validation file": ("pose", {}, {"validation_file": True}, "--observe pose: --validate is of points"),
}


@pytest.mark.parametrize(("name", "options", "fit", "what"), REFUSED.values(), ids=REFUSED)
def test_options_that_do_not_go_together_are_refused(name, options, fit, what) -> None:
    with pytest.raises(LabError, match=what):
        configured_sensor(name, SensorOptions(**options), FitInputs(**fit))


def test_options_reach_their_kind() -> None:
    pose = configured_sensor("pose", SensorOptions(noise_mrad=0.3, orientation="fixed-xyz"), FitInputs(noise_mm=0.1))
    assert pose.ratio == pytest.approx(3.0) and pose.orientation == "fixed-xyz" and pose.solve is None
    assert configured_sensor("pose", SensorOptions(method="sequential"), FitInputs()).solve is not None
    socket = configured_sensor("socket", SensorOptions(socket_distance_mm=50.0), FitInputs())
    assert socket.distance_m == pytest.approx(0.05)
    points_and_cube = configured_sensor("points+cube", SensorOptions(tip_radius_mm=2.0), FitInputs())
    assert points_and_cube.parts[1].tip_m == pytest.approx(0.002)
