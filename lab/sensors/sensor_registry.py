"""List the sensors by name; a sensor's module is imported when it is used.

This module imports no numpy, so that a command line is parsed quickly. A new sensor is a new line of ``SENSORS``, and
its options, if it has any, are a new base of ``SensorOptions`` or new fields of ``VirtualSetup``. A package adds one
by an entry point of ``lab.sensors``, as the lab's own cameras do.
"""

from collections.abc import Mapping
from contextlib import suppress
from dataclasses import Field, fields
from functools import cache
from importlib import import_module
from pkgutil import resolve_name
from typing import TYPE_CHECKING, Annotated, Any

import tyro

from lab.core.errors import LabError, option_name
from lab.extension_points import PartKind
from lab.sensors.sensor_options import FitInputs, SensorOptions

if TYPE_CHECKING:
    from lab.sensors.virtual_sensor import VirtualSensor

__all__ = ["JOINED", "OWN_SENSORS", "SENSORS", "SensorName", "configured_sensor", "sensor_named", "sensors_with"]

SENSORS: Mapping[str, str] = {  # in the order of --help
    "points": "lab.sensors.points:PointSensor",
    "pose": "lab.sensors.full_pose:PoseSensor",
    "cable": "lab.sensors.cable:CableSensor",
    "socket": "lab.sensors.socket:SocketSensor",
    "plane": "lab.sensors.plane:PlaneSensor",
    "cube": "lab.sensors.cube:CubeSensor",
    "sphere-plate": "lab.sensors.sphere_plate:SpherePlateSensor",
    "ball-bar": "lab.sensors.ball_bar:BallBarSensor",
    "dial": "lab.sensors.dial:DialSensor",
}
"""The class of each sensor, as ``module:name``."""

JOINED = "+"  # between the names of sensors that measure together
OWN_SENSORS = PartKind("lab.sensors", "sensor", "observe", tuple(SENSORS), is_made=False)
_NAMES = OWN_SENSORS.names  # that a command line takes


def _name(given: list[str]) -> str:
    if unknown := [name for name in given[0].split(JOINED) if name not in _NAMES]:
        raise ValueError(f"{unknown[0]!r} is unknown; give {', '.join(_NAMES)}, or several joined by {JOINED}")
    return given[0]


SensorName = Annotated[
    str,
    tyro.constructors.PrimitiveConstructorSpec(
        nargs=1,
        metavar="{" + ",".join(_NAMES) + "}[+...]",
        instance_from_str=_name,
        is_instance=lambda instance: isinstance(instance, str),
        str_from_instance=lambda name: [name],
    ),
]
"""A sensor's name, or several joined by +, as a command line takes it."""


def sensor_named(name: str) -> "type[VirtualSensor]":
    """Return the sensor of this name, or of several joined by +.

    Raises:
        LabError: there is none, they do not measure together, or its package cannot be imported or gives something
            else.
    """
    if JOINED in name:
        combine = resolve_name("lab.sensors.combined:combined_sensor")
        joined: type[VirtualSensor] = combine(tuple(name.split(JOINED)))
        return joined
    if name in SENSORS:
        return _known_sensor(name)
    import_module("lab.sensors.virtual_sensor")  # which imports numpy, and is the base of such sensors
    own: type[VirtualSensor] = OWN_SENSORS.named(name)
    return own


@cache
def _known_sensor(name: str) -> "type[VirtualSensor]":
    sensor: type[VirtualSensor] = resolve_name(SENSORS[name])
    return sensor


def sensors_with(setting: str) -> tuple[str, ...]:
    """Return the names of the sensors whose simulation reads this field of ``VirtualSetup``."""
    return tuple(name for name in SENSORS if setting in sensor_named(name).setup)


def configured_sensor(name: str, options: SensorOptions, fit: FitInputs) -> "VirtualSensor":
    """Return the sensor of this name with its options.

    Args:
        name: as ``--observe`` takes it.
        options: of all sensors.
        fit: the other options of the identification.

    Raises:
        LabError: there is no such sensor, an option is of another sensor, or makes no sense.
    """
    chosen = sensor_named(name)
    sensor = chosen.configured(options, fit)
    taken = {field.name for kind in (chosen, *chosen.combines) for field in _flags_of(kind)}
    for field in fields(SensorOptions):
        value = getattr(options, field.name)
        if field.name not in taken and value != field.default:
            flag = "--" + field.name.replace("_", "-")
            given = flag if field.default is None else f"{flag} {value}"
            raise LabError(
                f"{given} is of {option_name('observe')} {_taker(field.name)}; give that too, or leave it out"
            )
    return sensor


def _flags_of(kind: "type[VirtualSensor]") -> "tuple[Field[Any], ...]":
    return fields(kind.flags) if kind.flags is not None else ()


def _taker(option: str) -> str:
    """Return the name of the first sensor that takes an option; of a sensor that is not installed, a description."""
    for name in OWN_SENSORS.names:
        with suppress(LabError):  # of a package that cannot be imported
            if any(field.name == option for field in _flags_of(sensor_named(name))):
                return name
    return "a sensor that is not installed"
