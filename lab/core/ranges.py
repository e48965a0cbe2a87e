"""Which numbers an input may hold: what lies outside is refused where it enters, before any work begins.

The ranges are wider than what arms, instruments and rooms have: a number outside is of another unit, or of another
column. Each is listed in docs/reference/limits.md.
"""

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from lab.core.errors import LabError
from lab.core.se3 import Array

__all__ = [
    "CLOCKS_S",
    "CLOCK_DRIFT_PPM",
    "COORDINATE_SIZE",
    "CORRECTION_A_M",
    "CORRECTION_D_M",
    "CORRECTION_RAD",
    "COUNTS",
    "COUPLING_SIZE",
    "DIGITS",
    "DISTANCE_MM",
    "EARTH_GRAVITY",
    "ELEVATION_DEG",
    "FRICTION_PERCENT",
    "GEAR",
    "HOLDOUT",
    "HUMIDITY_PERCENT",
    "JOINT_SPAN",
    "LENGTH_M",
    "MOTOR_ZERO_DEG",
    "NUMBER_SIZE",
    "OPTION_SIZE",
    "PAYLOAD_KG",
    "POSITION_MM",
    "POSITIVE_OPTION",
    "PRESSURE_HPA",
    "QUATERNION_NORM",
    "RANGES",
    "REFLECTOR_DEG",
    "REHEARSED",
    "REHEARSED_S",
    "ROOM_C",
    "ROUNDED_NORM",
    "SIGMA_MM",
    "UNCERTAINTY",
    "Range",
]


@dataclass(frozen=True)
class Range:
    """The numbers that something may have.

    Attributes:
        what: as the documentation says it.
        least: the smallest.
        most: the largest.
        unit: of both; "" of a plain number.
        why: what lies outside.
    """

    what: str
    least: float
    most: float
    unit: str
    why: str

    @property
    def shown(self) -> str:
        """The ends as a person reads them."""
        return f"{self.least:,.10g} to {self.most:,.10g} {self.unit}".replace("-", "−").strip()

    def __contains__(self, value: float) -> bool:
        """Whether a number is one of them; one that is not finite never is."""
        return self.least <= value <= self.most

    def outside(self, values: Array) -> NDArray[np.bool_]:
        """Which numbers ``(...)`` are none of them; NaN is a cell that is empty, and passes."""
        return np.asarray((values < self.least) | (values > self.most))

    def __call__(self, where: object, value: float) -> None:
        """Refuse another number.

        Args:
            where: the option, or the name in a file, as an error begins.

        Raises:
            LabError: it is outside.
        """
        if value not in self:
            raise LabError(f"{where} is {value:g}; give {self.shown}")


NUMBER_SIZE = Range("size of any number in a file", 0, 1e15, "", "squares of more overflow")
OPTION_SIZE = Range("size of a number in an option", 0, 1e9, "", "no unit of an option needs more")
POSITIVE_OPTION = Range("number of an option above zero", 1e-9, 1e9, "", "no unit of an option needs more")
SIGMA_MM = Range("standard deviation in a column", 1e-9, 1e3, "mm", "no instrument is so good, or so bad")
PAYLOAD_KG = Range("payload of a row", 0, 1e3, "kg", "no arm carries more")
GEAR = Range("size of a gear ratio, or of a drive's gain", 1e-9, 1e6, "", "zero turns nothing")
COUPLING_SIZE = Range("size of a coupling's ratio", 0, 1e6, "", "no gear has more")
COUNTS = Range("counts of an encoder in a turn", 1, 1e12, "", "40 bits")
MOTOR_ZERO_DEG = Range("size of a motor's zero", 0, 1e9, "°", "a motor turns some thousand times")
CORRECTION_RAD = Range("size of an angle in calibration.conf", 0, 4, "rad", "a turn is another unit")
CORRECTION_A_M = Range("size of a length a in calibration.conf", 0, 1, "m", "arms are shorter")
CORRECTION_D_M = Range("size of a length d in calibration.conf", 0, 1e5, "m", "of parallel axes it can be large")
JOINT_SPAN = Range("span of a joint's limits", 1e-9, 1e15, "rad, m", "it stands still")
LENGTH_M = Range("size of a length in a mechanism", 0, 1e6, "m", "robots are shorter")
DISTANCE_MM = Range("size of a coordinate in a cell", 0, 1e6, "mm", "a cell is smaller than a kilometre")
REFLECTOR_DEG = Range("half-angle of what a reflector takes", 1e-3, 180, "°", "less sees nothing")
ELEVATION_DEG = Range("elevation in an instrument's view", -90, 90, "°", "beyond is the other side")
UNCERTAINTY = Range("uncertainty in an instrument's file", 0, 1e5, "µm, µrad", "0.1 m or 0.1 rad is no instrument")
COORDINATE_SIZE = Range("size of a number in a program's position", 0, 1e10, "", "axes that are not there are 9e9")
DIGITS = Range("places behind the point in a program", 0, 12, "", "finer says nothing")
QUATERNION_NORM = Range("norm of a quaternion", 0.999, 1.001, "", "other columns, or another order")
ROUNDED_NORM = Range("norm of a quaternion in --frames", 0.99, 1.01, "", "they are typed with three digits")
ROOM_C = Range("temperature of a room", -50, 100, "°C", "kelvin or fahrenheit")
HUMIDITY_PERCENT = Range("relative humidity", 0, 100, "%", "it is a share")
PRESSURE_HPA = Range("pressure of air", 300, 1200, "hPa", "bar, Pa or mmHg")
EARTH_GRAVITY = Range("acceleration of gravity", 9, 10.5, "m/s²", "the Earth has 9.76 to 9.84")
CLOCKS_S = Range("size of the difference of two clocks", 0, 1e10, "s", "three hundred years")
CLOCK_DRIFT_PPM = Range("size of the drift between two clocks", 0, 100, "ppm", "two quartz clocks drift less")
HOLDOUT = Range("share of a path that is held out", 0, 0.8, "", "the rest identifies")
REHEARSED = Range("a rehearsal's noise, inertia, lag or filter", 0, 1e3, "", "another unit")
FRICTION_PERCENT = Range("Coulomb friction of a rehearsal", 0, 30, "%", "little torque is left for the motion")
POSITION_MM = Range(
    "coordinate of a payload, or tilt of a base (°), of a rehearsal", 0, 1e4, "mm", "farther than arms are"
)
REHEARSED_S = Range("seconds of a rehearsal's motion", 2, 1e9, "s", "too little shows")

RANGES: Final = tuple(value for value in list(globals().values()) if isinstance(value, Range))
