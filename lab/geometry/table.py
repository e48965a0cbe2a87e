"""Denavit-Hartenberg tables as TOML files, the exact form of a robot that has no model.

Keys as in the README: ``name``, ``convention``, and one ``[[joint]]`` each. What the lab writes
(``theta_rad``, ``d_m``, ``beta_rad``, …, ``[base]``, ``[tool]``) reads back to the bit.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from lab.errors import LabError
from lab.frames import Array
from lab.geometry.chain import COLUMNS, Chain, parallel_links
from lab.toml_file import is_number, read_toml

_ANGLES = {"rad": 1.0, "deg": np.pi / 180}
_LENGTHS = {"m": 1.0, "mm": 1e-3}
_QUANTITIES = {"theta": _ANGLES, "alpha": _ANGLES, "beta": _ANGLES, "d": _LENGTHS, "a": _LENGTHS}
_RATES = {"speed": "per_s", "acceleration": "per_s2"}
_TOP_KEYS = {"name", "convention", "height_mm", "joint", "base", "tool"}


@dataclass(frozen=True)
class RobotTable:
    """What a table file holds.

    Attributes:
        base: ``(6,)`` of an identified arm, as ``base.x y z rx ry rz``; None in a drawing.
        tool: targets (m, in the last frame).
        height_m: of frame 0 above the floor that the arm stands on; None where there is none.
        mass_kg: ``(n,)`` of the links that the joints move; NaN where unknown.
        torque: ``(n,)`` largest ones of the joints, Nm or N; NaN where unknown.
        warnings: what a user should be told.
    """

    chain: Chain
    base: Array | None
    tool: dict[str, Array]
    height_m: float | None
    mass_kg: Array
    torque: Array
    warnings: tuple[str, ...]


def read_table(path: Path) -> RobotTable:
    """Read a Denavit-Hartenberg table.

    Raises:
        LabError: the file is missing or malformed, or a joint lacks or doubles a value.
    """
    document = _document(path)
    convention = document.get("convention")
    if convention not in ("distal", "craig"):
        raise LabError(f'{path}: convention is {convention!r}; write convention = "distal" or "craig"')
    joints = document.get("joint")
    if not isinstance(joints, list) or not joints or not all(isinstance(joint, dict) for joint in joints):
        raise LabError(f"{path}: no joints; give each joint a [[joint]] section")
    warnings: list[str] = []
    readers = [_Joint(path, i, joint) for i, joint in enumerate(joints)]
    _refuse_doubled_names(path, [reader.name for reader in readers])
    limits = [reader.limits(warnings) for reader in readers]
    table = np.array([[reader.value(name, _QUANTITIES[name]) for name in COLUMNS] for reader in readers])
    parallel = list(parallel_links(convention, table[:, 3]))
    for i, reader in enumerate(readers):
        if table[i, 4] != 0 and not parallel[i]:
            raise LabError(f"{reader.where}: beta is for links between nearly parallel axes; leave it out here")
    signs = np.array([reader.sign() for reader in readers])
    speed, acceleration = (np.array([reader.rate(name) for reader in readers]) for name in _RATES)
    mass_kg = np.array([reader.positive("mass", {"kg": 1.0}) for reader in readers])
    torque = np.array([reader.torque() for reader in readers])
    for reader in readers:
        reader.refuse_the_rest()
    name = document.get("name", path.stem)
    chain = Chain(
        name=str(name),
        convention=convention,
        joint_names=tuple(reader.name for reader in readers),
        prismatic=tuple(reader.prismatic for reader in readers),
        table=table,
        sign=signs,
        lower=np.array([low for low, _ in limits]),
        upper=np.array([high for _, high in limits]),
        speed=speed,
        acceleration=acceleration,
        parallel=tuple(parallel),
    )
    base = _read_base(path, document["base"]) if "base" in document else None
    tool = _read_tool(path, document.get("tool", {}))
    return RobotTable(chain, base, tool, _height(path, document), mass_kg, torque, tuple(warnings))


def _document(path: Path) -> dict[str, Any]:
    """The file's content, if it is TOML and has no unknown key."""
    document = read_toml(path)
    if unknown := set(document) - _TOP_KEYS:
        raise LabError(f"{path}: unknown key '{sorted(unknown)[0]}'; known are {', '.join(sorted(_TOP_KEYS))}")
    return document


def write_table(chain: Chain, base: Array, tool: dict[str, Array]) -> str:
    """A table that reads back to the bit, with the base ``(6,)`` (m, rad) and the targets (m)."""
    lines = [f"name = {_quoted(chain.name)}", f'convention = "{chain.convention}"']
    for i, joint in enumerate(chain.joint_names):
        unit = "m" if chain.prismatic[i] else "rad"
        lines += ["", "[[joint]]", f"name = {_quoted(joint)}"]
        lines += [f'type = "{"prismatic" if chain.prismatic[i] else "revolute"}"', f"sign = {int(chain.sign[i])}"]
        for column, value in zip(COLUMNS, chain.table[i], strict=True):
            if column != "beta" or chain.parallel[i]:
                lines.append(f"{column}_{next(iter(_QUANTITIES[column]))} = {float(value)!r}")
        lines += [f"lower_{unit} = {float(chain.lower[i])!r}", f"upper_{unit} = {float(chain.upper[i])!r}"]
    position, rotation = (", ".join(repr(float(v)) for v in part) for part in (base[:3], base[3:]))
    lines += [
        "",
        "[base]  # in the tracker's frame",
        f"position_m = [{position}]",
        f"rotation_vector_rad = [{rotation}]",
    ]
    lines += ["", "[tool]  # targets in the last frame"]
    lines += [f"{_quoted(name)} = [{', '.join(repr(float(v)) for v in point)}]" for name, point in tool.items()]
    return "\n".join(lines) + "\n"


def _quoted(text: str) -> str:
    return '"' + text.replace("\\", "\\\\").replace('"', '\\"') + '"'


class _Joint:
    """One [[joint]] section; every key read is crossed off, so that a misspelt one is noticed."""

    def __init__(self, path: Path, index: int, section: dict[str, Any]) -> None:
        self.section, self.unread = section, set(section)
        self.name = str(self.take("name", f"q{index + 1}"))
        self.where = f"{path}, joint {self.name}"
        kind = self.take("type", "revolute")
        if kind not in ("revolute", "prismatic"):
            raise LabError(f'{self.where}: type is {kind!r}; write "revolute" or "prismatic"')
        self.prismatic = kind == "prismatic"

    def take(self, key: str, default: Any) -> Any:
        self.unread.discard(key)
        return self.section.get(key, default)

    def has(self, quantity: str) -> bool:
        return any(key.startswith(quantity + "_") for key in self.section)

    def value(self, quantity: str, units: dict[str, float]) -> float:
        found = self.optional(quantity, units)
        if found is None and quantity != "beta":
            raise LabError(f"{self.where}: {quantity} is missing; give {quantity}_{' or _'.join(units)}")
        return found or 0.0

    def optional(self, quantity: str, units: dict[str, float]) -> float | None:
        keys = [f"{quantity}_{unit}" for unit in units if f"{quantity}_{unit}" in self.section]
        if len(keys) > 1:
            raise LabError(f"{self.where}: {' and '.join(keys)} are both there; keep one")
        if not keys:
            return None
        number = self.take(keys[0], None)
        if not is_number(number):
            raise LabError(f"{self.where}: {keys[0]} is {number!r}; give a finite number")
        return float(number) * units[keys[0].removeprefix(quantity + "_")]

    def positive(self, quantity: str, units: dict[str, float]) -> float:
        """A number above zero; NaN where there is none."""
        found = self.optional(quantity, units)
        if found is not None and not found > 0:
            raise LabError(f"{self.where}: {quantity} is {found:g}; give more than zero, or leave it out")
        return np.nan if found is None else found

    def rate(self, quantity: str) -> float:
        """The largest speed or acceleration; NaN where it is not given."""
        units = _LENGTHS if self.prismatic else _ANGLES
        return self.positive(quantity, {f"{unit}_{_RATES[quantity]}": factor for unit, factor in units.items()})

    def torque(self) -> float:
        """The largest torque, of a slide force; NaN where it is not given."""
        return self.positive("force", {"n": 1.0}) if self.prismatic else self.positive("torque", {"nm": 1.0})

    def sign(self) -> float:
        sign = self.take("sign", 1)
        if sign not in (1, -1) or isinstance(sign, bool):
            raise LabError(f"{self.where}: sign is {sign!r}; write 1 or -1")
        return float(sign)

    def limits(self, warnings: list[str]) -> tuple[float, float]:
        units = _LENGTHS if self.prismatic else _ANGLES
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

    def refuse_the_rest(self) -> None:
        if self.unread:
            raise LabError(
                f"{self.where}: unknown key '{sorted(self.unread)[0]}'; known are name, type, sign, theta_deg, d_mm, "
                "a_mm, alpha_deg, beta_deg (or _rad, _m), lower and upper with _deg or _rad (of a slide _mm or _m), "
                "speed with _per_s and acceleration with _per_s2 after that, torque_nm (force_n), mass_kg"
            )


def _height(path: Path, document: dict[str, Any]) -> float | None:
    height = document.get("height_mm")
    if height is not None and not (is_number(height) and height >= 0):
        raise LabError(f"{path}: height_mm is {height!r}; give frame 0's height above the floor, or leave it out")
    return None if height is None else float(height) / 1e3


def _refuse_doubled_names(path: Path, names: list[str]) -> None:
    for i, name in enumerate(names):
        if not name:
            raise LabError(f"{path}: joint {i + 1} has an empty name; name it")
        if name in names[:i]:
            raise LabError(f"{path}: joints {names.index(name) + 1} and {i + 1} are both named {name}; rename one")


def _read_base(path: Path, section: Any) -> Array:
    parts = ("position_m", "rotation_vector_rad")
    numbers = [section.get(part) if isinstance(section, dict) else None for part in parts]
    for part, number in zip(parts, numbers, strict=True):
        if not isinstance(number, list) or len(number) != 3 or not all(isinstance(v, int | float) for v in number):
            raise LabError(f"{path}: [base] {part} is {number!r}; give three numbers, [x, y, z]")
    return np.array(numbers, dtype=np.float64).ravel()


def _read_tool(path: Path, section: Any) -> dict[str, Array]:
    if not isinstance(section, dict):
        raise LabError(f"{path}: tool is {section!r}; write a [tool] section with a line p1 = [x, y, z]")
    tool = {}
    for name, point in section.items():
        if not isinstance(point, list) or len(point) != 3 or not all(is_number(v) for v in point):
            raise LabError(f"{path}: [tool] {name} is {point!r}; give three numbers in metres, [x, y, z]")
        tool[str(name)] = np.array(point, dtype=np.float64)
    return tool
