"""The units that a person reads a parameter in."""

from typing import Final, NamedTuple

import numpy as np

from lab.kinematics.parameter import Parameter

__all__ = ["DisplayUnit", "display_unit"]


class DisplayUnit(NamedTuple):
    """A unit: the factor to it from SI, its name, and how many digits after the point a parameter is shown with."""

    factor: float
    name: str
    digits: int


_UNITS: Final = {
    "m": DisplayUnit(1e3, "mm", 4),
    "rad": DisplayUnit(180 / np.pi, "°", 5),
    "rad/Nm": DisplayUnit(1e6, "µrad/Nm", 3),
    "": DisplayUnit(1e6, "ppm", 2),
    "1/(N m^2)": DisplayUnit(1e6, "1/(MN m²)", 3),
    "m/N": DisplayUnit(1e6, "µm/N", 3),
    "kg": DisplayUnit(1.0, "kg", 3),
    "m/h": DisplayUnit(1e3, "mm/h", 4),
    "rad/h": DisplayUnit(1e3, "mrad/h", 4),
    "1/h": DisplayUnit(1e6, "ppm/h", 2),
    "1/K": DisplayUnit(1e6, "ppm/K", 3),
    "rad/K": DisplayUnit(1e6, "µrad/K", 3),
    "m/K": DisplayUnit(1e6, "µm/K", 3),
    "rad/(Nm)^3": DisplayUnit(1e9, "nrad/(Nm)³", 4),
    "m/N^3": DisplayUnit(1e9, "nm/N³", 4),
}
_JOINT_ANGLE: Final = DisplayUnit(1e3, "mrad", 4)  # of an effect, which is small


def display_unit(parameter: Parameter) -> DisplayUnit:
    """In what a person reads this parameter."""
    if parameter.is_angle and (parameter.joint is not None or parameter.wave):
        return _JOINT_ANGLE
    return _UNITS[parameter.unit]
