"""List the sensors by name, with their options; a sensor's module is imported when it is used.

This module imports no numpy, so that a command line is parsed quickly. A new sensor is a new line of ``SENSORS``, and
its options, if it has any, are a new base of ``SensorOptions`` or new fields of ``VirtualSetup``.
"""

from collections.abc import Mapping
from dataclasses import dataclass, fields
from pkgutil import resolve_name
from typing import TYPE_CHECKING, Annotated, Any, Literal

import tyro

from lab.core.errors import LabError
from lab.core.orientation import AngleConvention

if TYPE_CHECKING:
    from lab.sensors.virtual_sensor import VirtualSensor

__all__ = [
    "SENSORS",
    "FitInputs",
    "PoseOptions",
    "SensorName",
    "SensorOptions",
    "SocketOptions",
    "VirtualSetup",
    "configured_sensor",
    "sensor_named",
    "sensors_with",
]

SENSORS: Mapping[str, str] = {  # in the order of --help
    "points": "lab.sensors.points:PointSensor",
    "pose": "lab.sensors.full_pose:PoseSensor",
    "cable": "lab.sensors.cable:CableSensor",
    "socket": "lab.sensors.socket:SocketSensor",
    "plane": "lab.sensors.plane:PlaneSensor",
}
"""The class of each sensor, as ``module:name``."""

SensorName = Annotated[
    str,
    tyro.constructors.PrimitiveConstructorSpec(
        nargs=1,
        metavar="{" + ",".join(SENSORS) + "}",
        instance_from_str=lambda given: given[0],
        is_instance=lambda instance: isinstance(instance, str),
        str_from_instance=lambda name: [name],
        choices=tuple(SENSORS),
    ),
]
"""A sensor's name, as a command line takes it."""


@dataclass(frozen=True, kw_only=True)
class PoseOptions:
    """Options of measured positions and orientations."""

    orientation: AngleConvention | None = None
    """What the angles rx, ry, rz of a measured pose mean."""
    noise_mrad: float | None = None
    """Weigh measured orientations by this noise, beside --noise-mm; without both the ratio is estimated."""
    method: Literal["global", "sequential"] = "global"
    """Fit everything at once; or of poses the angles first, then the lengths."""


@dataclass(frozen=True, kw_only=True)
class SocketOptions:
    """Options of a ball in sockets."""

    socket_distance_mm: float | None = None
    """Known distance between the sockets of a location."""


@dataclass(frozen=True, kw_only=True)
class SensorOptions(SocketOptions, PoseOptions):
    """The options of all sensors."""


@dataclass(frozen=True, kw_only=True)
class VirtualSetup:
    """Measurement set-up of a virtual arm, beside arm and instrument; each sensor names the fields that it reads."""

    occlusion: Annotated[
        bool,
        tyro.conf.FlagCreatePairsOff,
        tyro.conf.arg(help_behavior_hint=lambda default: "" if default == "False" else "(given)"),  # by --config
    ] = False
    """Leave out what the instrument does not see: out of its sight, or behind the arm."""
    orientation_share: float = 1.0
    """Share of the poses whose orientation is measured, by chance; of the others the position alone."""
    fixtures: int = 4
    """How many anchors of a cable, locations of two sockets each, or planes."""


@dataclass(frozen=True)
class FitInputs:
    """The options of an identification beside a sensor's own, by which the sensor checks these.

    Attributes:
        noise_mm: the noise that is assumed of a position (1σ per axis); None where it is not given.
        prior: whether the manufacturing tolerances are a prior.
        instrument, validation_file: whether these are given, which are of points alone.
    """

    noise_mm: float | None = None
    prior: bool = False
    instrument: bool = False
    validation_file: bool = False

    def refuse_those_of_points(self, sensor: str) -> None:
        """Refuse what only measured points can be judged or weighted by.

        Raises:
            LabError: an instrument or a validation file is given.
        """
        if self.instrument or self.validation_file:
            raise LabError(f"--observe {sensor}: --validate and --instrument are of points; leave them out")

    def refuse_validation_file(self, sensor: str) -> None:
        """Refuse a file of points to validate on.

        Raises:
            LabError: there is one.
        """
        if self.validation_file:
            raise LabError(f"--observe {sensor}: --validate is of points; leave it out")


def sensor_named(name: str) -> "type[VirtualSensor]":
    """Return the sensor of this name.

    Raises:
        LabError: there is none.
    """
    if name not in SENSORS:
        raise LabError(f"--observe {name}: unknown; give one of {', '.join(SENSORS)}")
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
    for other in (sensor_named(each) for each in SENSORS):
        if other is not chosen and (given := _flags_given(options, other.flags)):
            raise LabError(f"{given[0]} is of --observe {other.name}; give that too, or leave it out")
    return sensor


def _flags_given(options: object, flags: type[Any] | None) -> list[str]:
    """Return the flags of one sensor that differ from their defaults, as they are typed; none without ``flags``."""
    given = []
    for field in fields(flags) if flags is not None else ():
        if (value := getattr(options, field.name)) != field.default:
            name = "--" + field.name.replace("_", "-")
            given.append(name if field.default is None else f"{name} {value}")
    return given
