"""Limits of a user's input, refused before any work begins by errors with the option, the value and the limit.

Limits of size are far above what a calibration needs, and small enough that the work ends and fits into memory. Ranges
are wider than those of arms, instruments and rooms: a number outside is in another unit or from another column.
docs/reference/limits.md lists them.
"""

import re
from collections.abc import Mapping, Sized
from dataclasses import dataclass
from datetime import date
from typing import Final

import numpy as np
from numpy.typing import NDArray

from lab.core.errors import LabError, option_name
from lab.core.se3 import Array

__all__ = [
    "CAMPAIGNS", "CANDIDATES", "CANDIDATE_POINTS", "CELLS", "CLOCKS_S", "CLOCK_DRIFT_PPM", "COLUMNS",
    "CONFIGURATIONS", "COORDINATE_SIZE", "COPIES", "CORNERS", "CORRECTION_A_M", "CORRECTION_D_M", "CORRECTION_RAD",
    "COUNTS", "COUPLING_SIZE", "DAYS", "DEPTH", "DESIGN_POINTS", "DIGITS", "DISTANCE_MM", "DRAWN_POINTS", "DRAWS",
    "EARTH_GRAVITY", "ELEVATION_DEG", "FIXTURES", "FRAMES", "FRICTION_PERCENT", "GEAR", "HOLDOUT",
    "HUMIDITY_PERCENT", "JOINTS",
    "JOINT_SPAN", "LENGTH_M", "LIMITS", "LINE", "LINE_OF_TEXT", "MESH_BYTES", "MOMENTS", "MOTOR_ZERO_DEG", "NAME",
    "NESTED_ELEMENTS", "NUMBER_SIZE", "OPTION_SIZE", "ORIENTATIONS", "PASSED", "PATIENCE_S", "PAYLOAD_KG",
    "PIXELS", "PLACED", "PLACES", "POSES", "POSITION_MM", "POSITIVE_OPTION", "PRESSURE_HPA",
    "PROGRAM_BYTES", "PROGRAM_FRAMES", "PROGRAM_MOVES", "PROGRAM_TARGETS", "QUATERNION_NORM", "RANGES", "READINGS",
    "REFLECTOR_DEG", "ROBOTS", "ROOM_C", "ROTATION_ERROR", "ROUNDED_NORM", "ROUNDS", "ROWS", "SEED", "SIGMA_MM",
    "SIMULATION_S", "SIMULATION_SIZE", "STARTS", "TABLE_BYTES", "TARGETS", "TEXT_BYTES", "TOML_BYTES", "UNCERTAINTY",
    "VALUES", "WAYPOINTS", "WORKERS", "Limit", "Range", "called", "check_serial", "checked_name", "checked_target",
    "day", "one_serial", "positive", "whole",
]  # fmt: skip

_MIB: Final = 1 << 20


@dataclass(frozen=True)
class Limit:
    """Maximum number of something.

    Attributes:
        what: the noun in the plural, for errors and the documentation.
        most: the maximum.
        why: the reason, for the documentation.
    """

    what: str
    most: int
    why: str

    @property
    def shown(self) -> str:
        """The maximum as text."""
        if self.most % _MIB == 0 and self.what.startswith("bytes"):
            return f"{self.most // _MIB} MiB"
        return f"{self.most:,}"

    def __call__(self, where: object, given: int | Sized) -> None:
        """Refuse more with a LabError.

        Args:
            where: the option or the file, with which the message begins.
            given: a number, or a collection of so many.
        """
        count = given if isinstance(given, int) else len(given)
        if count > self.most:
            shown = f"{count:,}" if count < 10**15 else f"{float(min(count, 10**300)):.0e}"
            raise LabError(f"{where}: {shown} {self.what} are too many; give at most {self.shown}")


TABLE_BYTES = Limit("bytes of a CSV file", 512 * _MIB, "a million rows of three targets have 300 MiB")
TOML_BYTES = Limit("bytes of a TOML file", _MIB, "descriptions and studies have some KiB")
TEXT_BYTES = Limit("bytes of a JSON, MJCF or URDF file", 16 * _MIB, "runs and models have less than 1 MiB")
PROGRAM_BYTES = Limit("bytes of a controller's program", 4 * _MIB, "ten thousand targets have 2 MiB")
PROGRAM_FRAMES = Limit("tools and bases of a program", 10_000, "a controller stores some hundred")
PROGRAM_MOVES = Limit("moves of a program that is read", 20_000, "the path of each move is checked")
PROGRAM_TARGETS = Limit("targets of a program that is written", 10_000, "a controller loads no larger file")
MESH_BYTES = Limit("bytes of all meshes and pictures of a robot", 512 * _MIB, "they are loaded into memory")
ROWS = Limit("rows of a CSV file", 1_000_000, "a measurement session has some hundred")
COLUMNS = Limit("columns of a CSV file", 2_000, "joints, targets and conditions have some ten")
LINE = Limit("characters of a line of a CSV file", 1_000_000, "2,000 columns of numbers have 50,000")
DEPTH = Limit("levels of nested values", 30, "no description nests more than five")
VALUES = Limit("values of a TOML or JSON file", 200_000, "a run of many parameters has some thousand")
PIXELS = Limit("pixels of a texture, or points of a height field", 1 << 26, "they are loaded into memory")
COPIES = Limit("copies of a part in an MJCF", 10_000, "they are loaded into memory")
NESTED_ELEMENTS = Limit("levels of elements in an MJCF or URDF", 500, "an element contains the bodies mounted on it")
NAME = Limit("characters of a name", 100, "names are columns, titles and labels")
JOINTS = Limit("joints of a robot", 40, "the work grows with their cube")
FRAMES = Limit("frames, rods or pins of a mechanism", 100, "six legs have some twenty; the work grows with their cube")
TARGETS = Limit("targets of a tool", 100, "the work grows with their square")
POSES = Limit("poses", 100_000, "a measurement session has some hundred")
WAYPOINTS = Limit("waypoints of a plan", 10_000, "every path between them is checked")
PASSED = Limit("points of a motion", 2_000, "the path between them is planned and drawn")
MOMENTS = Limit("times of a motion", 100_000, "each is a row; --step-ms sets how far they are apart")
PLACED = Limit("poses of a robot's models", 10_000, "each is reported in full, with every solution")
FIXTURES = Limit("anchors, locations or planes", 100, "each needs poses of its own")
CORNERS = Limit("corners of a board", 10_000, "printed boards have some hundred")
READINGS = Limit("readings of a point", 1_000_000, "the noise of their mean is negligible")
CANDIDATES = Limit("candidates of a plan", 100_000, "2,000 give an equally good plan")
CANDIDATE_POINTS = Limit("points of all candidates of a plan", 170_000, "memory must hold their derivatives")
DESIGN_POINTS = Limit(
    "points of all candidates of a plan, with all payloads", 600_000,
    "memory must hold their derivatives",
)  # fmt: skip
STARTS = Limit("starts of a plan's search", 1_000, "4 give an equally good plan")
ROBOTS = Limit("robots of a study", 100_000, "files are numbered with five digits")
DRAWS = Limit("draws of a study", 100_000, "the draws of one robot are computed together")
CELLS = Limit("cells of a study", 10_000, "files are numbered with four digits")
CAMPAIGNS = Limit("simulated calibrations of a study", 1_000_000_000, "they run for days on a hundred cores")
DRAWN_POINTS = Limit("points of all draws of a study's robot", 20_000_000, "they are loaded into memory")
PLACES = Limit("places of a workspace", 2_000_000, "200,000 give the volume to a thousandth")
ORIENTATIONS = Limit("orientations at a place", 10_000, "60 cover the sphere to 30°")
ROUNDS = Limit("rounds of a path's search", 100, "one gives a nearly equal path")
LINE_OF_TEXT = Limit("characters of a text in a certificate", 200, "it has one line on the page")
DAYS = Limit("days between checks", 3_660, "checks ten years apart show no trend")
CONFIGURATIONS = Limit("configurations of a daily check", 50, "four tell most causes apart")
WORKERS = Limit("worker processes", 1_024, "each loads its own Python interpreter")
SEED = Limit("as a seed", (1 << 63) - 1, "a seed is a whole number of 63 bits")

LIMITS: Final = tuple(value for value in list(globals().values()) if isinstance(value, Limit))

_NOT_IN_NAMES = frozenset("./\\,;")  # of parameters, folders and lists of names
_NOT_FIRST = frozenset("=+-@")  # beginnings of a formula in a spreadsheet


def checked_name(where: object, name: str) -> str:
    """Return a name of a joint or a target; refuse one that is empty, too long, or not writable in every format."""
    if not name.strip():
        raise LabError(f"{where}: an empty name; name it")
    NAME(f"{where}: the name {name[:20]}…", name)
    if wrong := next((c for c in name if c in _NOT_IN_NAMES or not c.isprintable()), None):
        raise LabError(f"{where}: the name {name!r} has a {wrong!r}; use letters, digits and '_'")
    if name[0] in _NOT_FIRST:
        raise LabError(f"{where}: the name {name!r} begins with {name[0]!r}; begin it with a letter")
    return name


def checked_target(where: object, name: str) -> str:
    """Return a target's name, which may begin with its tip's and a dot: ``left.p1``; refuse it as ``checked_name``."""
    tip, dot, point = name.partition(".")
    if dot:
        checked_name(where, tip)
    checked_name(where, point if dot else name)
    return name


@dataclass(frozen=True)
class Range:
    """Allowed range of a number.

    Attributes:
        what: the quantity, for the documentation.
        unit: unit of both ends; "" of a plain number.
        why: what a number outside means, for the documentation.
    """

    what: str
    least: float
    most: float
    unit: str
    why: str

    @property
    def shown(self) -> str:
        """The ends as text."""
        return f"{self.least:,.10g} to {self.most:,.10g} {self.unit}".replace("-", "−").strip()

    def __contains__(self, value: float) -> bool:
        return self.least <= value <= self.most

    def outside(self, values: Array) -> NDArray[np.bool_]:
        """Flag the numbers ``(...)`` outside the range; NaN, an empty cell, passes."""
        return np.asarray((values < self.least) | (values > self.most))

    def __call__(self, where: object, value: float) -> None:
        """Refuse a number outside with a LabError that begins with ``where``, an option or a name in a file."""
        if value not in self:
            raise LabError(f"{where} is {value:g}; give {self.shown}")


NUMBER_SIZE = Range("size of any number in a file", 0, 1e15, "", "squares of more overflow")
OPTION_SIZE = Range("size of a number in an option", 0, 1e9, "", "no unit of an option needs more")
POSITIVE_OPTION = Range("number of an option above zero", 1e-9, 1e9, "", "no unit of an option needs more")
SIGMA_MM = Range("standard deviation in a column", 1e-9, 1e3, "mm", "no instrument has such a noise")
PAYLOAD_KG = Range("payload of a row", 0, 1e3, "kg", "no arm carries more")
GEAR = Range("size of a gear ratio, or of a drive's gain", 1e-9, 1e6, "", "a ratio of zero turns no joint")
COUPLING_SIZE = Range("size of a coupling's ratio", 0, 1e6, "", "no gear has a larger ratio")
COUNTS = Range("counts of an encoder in a turn", 1, 1e12, "", "encoders have at most 40 bits")
MOTOR_ZERO_DEG = Range("size of a motor's zero", 0, 1e9, "°", "a motor turns some thousand times")
CORRECTION_RAD = Range("size of an angle in calibration.conf", 0, 4, "rad", "a larger angle is in another unit")
CORRECTION_A_M = Range("size of a length a in calibration.conf", 0, 1, "m", "arms are shorter")
CORRECTION_D_M = Range("size of a length d in calibration.conf", 0, 1e5, "m", "between parallel axes it can be large")
JOINT_SPAN = Range("span of a joint's limits", 1e-9, 1e15, "rad, m", "the joint cannot move")
LENGTH_M = Range("size of a length in a mechanism", 0, 1e6, "m", "robots are shorter")
DISTANCE_MM = Range("size of a coordinate in a cell", 0, 1e6, "mm", "a cell is smaller than a kilometre")
REFLECTOR_DEG = Range("half-angle of a reflector's acceptance", 1e-3, 180, "°", "a smaller one returns no beam")
ELEVATION_DEG = Range("elevation in an instrument's view", -90, 90, "°", "larger angles point to the other side")
UNCERTAINTY = Range("uncertainty in an instrument's file", 0, 1e5, "µm, µrad", "no instrument errs by 0.1 m or 0.1 rad")
COORDINATE_SIZE = Range("size of a number in a program's position", 0, 1e10, "", "missing axes are written as 9e9")
DIGITS = Range("decimals in a program", 0, 12, "", "no controller resolves more")
QUATERNION_NORM = Range("norm of a quaternion", 0.999, 1.001, "", "the columns are others, or in another order")
ROUNDED_NORM = Range("norm of a quaternion in --frames", 0.99, 1.01, "", "they are typed with three digits")
ROTATION_ERROR = Range("error of RᵀR of a rotation's matrix", 0, 0.005, "", "it is no rotation, or has two digits")
ROOM_C = Range("temperature of a room", -50, 100, "°C", "the value is in kelvin or fahrenheit")
HUMIDITY_PERCENT = Range("relative humidity", 0, 100, "%", "it is a percentage")
PRESSURE_HPA = Range("pressure of air", 300, 1200, "hPa", "the value is in bar, Pa or mmHg")
EARTH_GRAVITY = Range("acceleration of gravity", 9, 10.5, "m/s²", "on Earth it is 9.76 to 9.84")
PATIENCE_S = Range("wait of lab next for a new row", 0.1, 86_400, "s", "a session of more than a day is another one")
CLOCKS_S = Range("size of the difference of two clocks", 0, 1e10, "s", "1e10 s are three hundred years")
CLOCK_DRIFT_PPM = Range("size of the drift between two clocks", 0, 100, "ppm", "two quartz clocks drift less")
HOLDOUT = Range("share of a path held out of the fit", 0, 0.8, "", "the rest is fitted")
SIMULATION_SIZE = Range("a simulation's noise, inertia, lag or filter", 0, 1e3, "", "the value is in another unit")
FRICTION_PERCENT = Range("Coulomb friction of a simulation", 0, 30, "%", "too little torque remains for the motion")
POSITION_MM = Range(
    "coordinate of a payload, or tilt of a base (°), of a simulation", 0, 1e4, "mm", "no arm reaches farther"
)
SIMULATION_S = Range("seconds of a simulation's motion", 2, 1e9, "s", "a shorter motion shows too little")

RANGES: Final = tuple(value for value in list(globals().values()) if isinstance(value, Range))


def whole(flag: str, value: int, least: int, most: Limit) -> None:
    """Refuse a count below ``least`` or above a limit with a LabError."""
    if value < least:
        raise LabError(f"{flag} {value}: give a whole number of {least} or more")
    most(flag, value)


def positive(flag: str, value: float) -> None:
    """Refuse a number outside ``POSITIVE_OPTION`` with a LabError."""
    if value not in POSITIVE_OPTION:
        least, most = POSITIVE_OPTION.least, POSITIVE_OPTION.most
        raise LabError(f"{flag} {value:g}: give a number above zero, from {least:g} to {most:g}")


def day(where: str, text: str) -> date:
    """Parse a date YYYY-MM-DD, or raise a LabError that begins with ``where``, the option or file."""
    try:
        if not re.fullmatch(r"[0-9]{4}-[0-9]{2}-[0-9]{2}", text):  # no other form of ISO 8601
            raise ValueError
        return date.fromisoformat(text)
    except ValueError:
        raise LabError(f"{where} {text}: is no day; write it as 2026-03-01") from None


def check_serial(serial: str | None) -> None:
    """Refuse an option ``--serial`` that is empty, longer than a line, or not printable, with a LabError."""
    if serial is None:
        return
    if len(serial) > LINE_OF_TEXT.most or not serial.isprintable() or serial != serial.strip() or not serial:
        raise LabError(
            f"{option_name('serial')} {serial!r}: give one line of 1 to {LINE_OF_TEXT.most} characters, without "
            f"blanks around"
        )


def called(robot: str, serial: str | None) -> str:
    """Return the name of an arm: its model, and its serial number if given."""
    return robot if serial is None else f"{robot} {serial}"


def one_serial(serials: Mapping[str, str | None], mend: str) -> str | None:
    """Return the serial number that several sources share, or None without any; refuse different ones.

    Args:
        serials: the serial numbers by their source's name in messages.
        mend: advice for the end of the message.
    """
    stated = [(where, serial) for where, serial in serials.items() if serial is not None]
    for where, serial in stated[1:]:
        if serial != stated[0][1]:
            raise LabError(f"{where}: names the arm {serial}, but {stated[0][0]} names {stated[0][1]}; {mend}")
    return stated[0][1] if stated else None
