"""Sections of a robot's TOML file: joints with their limits, the base, targets; every misspelt key is noticed."""

from pathlib import Path
from typing import Any

import numpy as np

from lab.core.errors import LabError
from lab.core.limits import JOINTS, TARGETS, checked_name
from lab.core.se3 import Array
from lab.formats.toml import is_number, read_toml
from lab.kinematics.serial.khalil_frames import ANGULAR, SYMBOLS, KhalilFrame, khalil_frame, pose_of

__all__ = [
    "ANGLES",
    "LENGTHS",
    "RATES",
    "JointSection",
    "Section",
    "is_mechanism",
    "jerks_of",
    "quoted",
    "read_base",
    "read_height",
    "read_khalil_frame",
    "read_tool",
    "refuse_doubled_names",
    "written_base_and_tool",
]

ANGLES = {"rad": 1.0, "deg": np.pi / 180}
LENGTHS = {"m": 1.0, "mm": 1e-3}
RATES = {"speed": "per_s", "acceleration": "per_s2", "jerk": "per_s3"}


class Section:
    """A section; every key read is crossed off, so that a misspelt one is noticed.

    Attributes:
        where: the section, for a person.
    """

    def __init__(self, where: str, content: Any) -> None:
        if not isinstance(content, dict):
            raise LabError(f"{where}: is {content!r}; write a section of it, [[...]] with a line a key")
        self.content, self.unread, self.where = content, set(content), where

    def take(self, key: str, default: Any = None) -> Any:
        """The value of a key."""
        self.unread.discard(key)
        return self.content.get(key, default)

    def optional(self, quantity: str, units: dict[str, float]) -> float | None:
        """A number in one of some units, in SI; None where there is none.

        Raises:
            LabError: it is given in two units, or is no finite number.
        """
        keys = [f"{quantity}_{unit}" for unit in units if f"{quantity}_{unit}" in self.content]
        if len(keys) > 1:
            raise LabError(f"{self.where}: {' and '.join(keys)} are both there; keep one")
        if not keys:
            return None
        number = self.take(keys[0])
        if not is_number(number):
            raise LabError(f"{self.where}: {keys[0]} is {number!r}; give a finite number")
        return float(number) * units[keys[0].removeprefix(quantity + "_")]

    def value(self, quantity: str, units: dict[str, float]) -> float:
        """A number that must be there.

        Raises:
            LabError: it is missing, or no finite number.
        """
        found = self.optional(quantity, units)
        if found is None:
            raise LabError(f"{self.where}: {quantity} is missing; give {quantity}_{' or _'.join(units)}")
        return found

    def positive(self, quantity: str, units: dict[str, float]) -> float:
        """A number above zero; NaN where there is none.

        Raises:
            LabError: it is not above zero.
        """
        found = self.optional(quantity, units)
        if found is not None and not found > 0:
            raise LabError(f"{self.where}: {quantity} is {found:g}; give more than zero, or leave it out")
        return np.nan if found is None else found

    def flag(self, key: str) -> bool:
        """Whether something is so; false where it is not said.

        Raises:
            LabError: it is neither true nor false.
        """
        said = self.take(key, False)
        if not isinstance(said, bool):
            raise LabError(f"{self.where}: {key} is {said!r}; write true or false")
        return said

    def refuse_the_rest(self, known: str) -> None:
        """A LabError for a key that nothing has asked for."""
        if self.unread:
            raise LabError(f"{self.where}: unknown key '{sorted(self.unread)[0]}'; known are {known}")


class JointSection(Section):
    """One ``[[joint]]``."""

    def __init__(self, path: Path, index: int, content: Any) -> None:
        super().__init__(f"{path}, joint {index + 1}", content)
        self.name = str(self.take("name", f"q{index + 1}"))
        self.where = f"{path}, joint {self.name}"
        kind = self.take("type", "revolute")
        if kind not in ("revolute", "prismatic"):
            raise LabError(f'{self.where}: type is {kind!r}; write "revolute" or "prismatic"')
        self.prismatic = kind == "prismatic"

    def rate(self, quantity: str) -> float:
        """The largest speed, acceleration or jerk; NaN where it is not given."""
        units = LENGTHS if self.prismatic else ANGLES
        return self.positive(quantity, {f"{unit}_{RATES[quantity]}": factor for unit, factor in units.items()})

    def torque(self) -> float:
        """The largest torque, of a slide force; NaN where it is not given."""
        return self.positive("force", {"n": 1.0}) if self.prismatic else self.positive("torque", {"nm": 1.0})

    def sign(self) -> float:
        """+1 or -1: how the joint's position counts.

        Raises:
            LabError: it is neither 1 nor -1.
        """
        sign = self.take("sign", 1)
        if sign not in (1, -1) or isinstance(sign, bool):
            raise LabError(f"{self.where}: sign is {sign!r}; write 1 or -1")
        return float(sign)

    def limits(self, warnings: list[str]) -> tuple[float, float]:
        """The lower and the upper one; ``warnings`` takes what is assumed.

        Raises:
            LabError: a slide has none, or the lower one is not below the upper one.
        """
        units = LENGTHS if self.prismatic else ANGLES
        low, high = self.optional("lower", units), self.optional("upper", units)
        absent = [end for end, value in (("lower", low), ("upper", high)) if value is None]
        if absent and self.prismatic:
            raise LabError(f"{self.where}: a slide needs its limits; give {' and '.join(f'{a}_mm' for a in absent)}")
        if absent:
            warnings.append(f"{self.where}: no {' or '.join(absent)} limit given, so it moves to ±180° there")
        low, high = -np.pi if low is None else low, np.pi if high is None else high
        if not low < high:
            raise LabError(f"{self.where}: the lower limit is not below the upper one; swap or mend them")
        return low, high


def is_mechanism(path: Path) -> bool:
    """Whether a TOML file describes a mechanism, not a table."""
    return "frame" in read_toml(path)


def read_height(path: Path, document: dict[str, Any]) -> float | None:
    """``height_mm``, in m.

    Raises:
        LabError: it is no finite number.
    """
    height = document.get("height_mm")
    if height is not None and not (is_number(height) and height >= 0):
        raise LabError(f"{path}: height_mm is {height!r}; give frame 0's height above the floor, or leave it out")
    return None if height is None else float(height) / 1e3


def refuse_doubled_names(path: Path, names: list[str]) -> None:
    """A LabError where joints are too many, share a name, or have none that a file can hold."""
    JOINTS(path, names)
    for i, name in enumerate(names):
        checked_name(f"{path}: joint {i + 1}", name)
        if name in names[:i]:
            raise LabError(f"{path}: joints {names.index(name) + 1} and {i + 1} are both named {name}; rename one")


def read_base(path: Path, section: Any) -> Array:
    """``[base]``, ``(6,)`` m and rad.

    Raises:
        LabError: a part is not three numbers.
    """
    parts = ("position_m", "rotation_vector_rad")
    numbers = [section.get(part) if isinstance(section, dict) else None for part in parts]
    for part, number in zip(parts, numbers, strict=True):
        if not isinstance(number, list) or len(number) != 3 or not all(is_number(v) for v in number):
            raise LabError(f"{path}: [base] {part} is {number!r}; give three numbers, [x, y, z]")
    return np.array(numbers, dtype=np.float64).ravel()


def read_khalil_frame(where: str, section: Any) -> KhalilFrame:
    """A section of six parameters, ``gamma_deg``, ``b_mm``, ``alpha_deg``, ``d_mm``, ``theta_deg``, ``r_mm``.

    Returns:
        The six as the pose that they make has them.

    Raises:
        LabError: one is missing, given twice or no number, or there is another key.
    """
    read = Section(where, section)
    values = [read.value(name, ANGLES if turns else LENGTHS) for name, turns in zip(SYMBOLS, ANGULAR, strict=True)]
    read.refuse_the_rest(", ".join(SYMBOLS) + ", with _deg or _rad, and _mm or _m")
    return khalil_frame(pose_of(np.array(values)))


def read_tool(path: Path, section: Any) -> dict[str, Array]:
    """``[tool]``: targets (m).

    Raises:
        LabError: it is no section, or a target is not three numbers.
    """
    if not isinstance(section, dict):
        raise LabError(f"{path}: tool is {section!r}; write a [tool] section with a line p1 = [x, y, z]")
    tool = {}
    TARGETS(f"{path}: [tool]", section)
    for name, point in section.items():
        checked_name(f"{path}: [tool]", name)
        if not isinstance(point, list) or len(point) != 3 or not all(is_number(v) for v in point):
            raise LabError(f"{path}: [tool] {name} is {point!r}; give three numbers in metres, [x, y, z]")
        tool[str(name)] = np.array(point, dtype=np.float64)
    return tool


def jerks_of(rates: Array) -> Array | None:
    """Largest jerks ``(n,)`` of joints, infinite where one is not given (NaN); None where none is."""
    return None if np.isnan(rates).all() else np.where(np.isnan(rates), np.inf, rates)


def quoted(text: str) -> str:
    """A TOML string."""
    return '"' + text.replace("\\", "\\\\").replace('"', '\\"') + '"'


def written_base_and_tool(base: Array, tool: dict[str, Array], where: str) -> list[str]:
    """Lines of ``[base]`` and ``[tool]`` that read back to the bit."""
    position, rotation = (", ".join(repr(float(v)) for v in part) for part in (base[:3], base[3:]))
    lines = ["", "[base]  # in the tracker's frame"]
    lines += [f"position_m = [{position}]", f"rotation_vector_rad = [{rotation}]"]
    lines += ["", f"[tool]  # targets in {where}"]
    return [*lines, *(f"{quoted(name)} = [{', '.join(repr(float(v)) for v in point)}]" for name, point in tool.items())]
