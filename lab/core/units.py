"""Display units of quantities, and their conversion from and to SI units."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TypeVar

import numpy as np

from lab.core.se3 import Array

__all__ = ["DEGREES", "KELVIN", "MICRONS", "MICRORADIANS", "MM", "MRAD", "PPM", "Unit", "joints_to_si", "short_length"]

_Quantity = TypeVar("_Quantity", float, Array)


@dataclass(frozen=True)
class Unit:
    """A display unit.

    Attributes:
        si: the SI unit of the same quantity, ``rad/Nm``; empty for a ratio.
        name: as displayed, ``µrad/Nm``.
        factor: number of this unit in one SI unit.
        decimals: maximum decimals of a displayed parameter.
    """

    si: str
    name: str
    factor: float
    decimals: int = 3

    @property
    def key(self) -> str:
        """Name in JSON keys, CSV columns and flags: ``deg``, ``um``, ``k_per_m``."""
        return self.name.replace("°", "deg").replace("µ", "u").replace("/", "_per_").lower()

    def of(self, size: _Quantity) -> _Quantity:
        """Convert from SI units: ``MM.of(length_m)``."""
        return self.factor * size

    def to_si(self, size: _Quantity) -> _Quantity:
        """Convert to SI units: ``MM.to_si(length_mm)``."""
        return size / self.factor

    def text(self, size: float, digits: int = 3) -> str:
        """Write a size (SI) with its unit and significant digits: ``1.23 mm``, ``2,500 mm``, ``30°``."""
        value = self.of(size)
        number = f"{value:,.0f}" if abs(value) >= 10 ** (digits - 1) else f"{value:.{digits}g}"
        return f"{number}{self.name}" if self.name == "°" else f"{number} {self.name}"


MM = Unit("m", "mm", 1e3, 4)
MICRONS = Unit("m", "µm", 1e6)
DEGREES = Unit("rad", "°", 180 / np.pi, 5)
MRAD = Unit("rad", "mrad", 1e3, 4)
MICRORADIANS = Unit("rad", "µrad", 1e6)
PPM = Unit("", "ppm", 1e6, 2)
KELVIN = Unit("K", "K", 1.0)


def joints_to_si(joints: Array, prismatic: Sequence[bool]) -> Array:
    """Convert joint positions or rates ``(..., n)``, in degrees or in mm of a slide, to rad or m."""
    return np.asarray(joints * np.where(prismatic, 1e-3, np.pi / 180))


def short_length(length_m: float) -> str:
    """Write a length with two digits: ``52 µm``, ``590 µm``, ``1.5 mm``."""
    unit = MICRONS if length_m < 0.95e-3 else MM
    return f"{float(f'{unit.of(length_m):.2g}'):g} {unit.name}"
