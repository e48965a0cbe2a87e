"""Robot tables in TOML: Denavit-Hartenberg rows, limits, elastic links.

Keys as in the README: ``name``, ``convention``, and one ``[[joint]]`` each. Written tables (``theta_rad``, ``d_m``,
``beta_rad``, …, ``[base]``, ``[tool]``) read back to the bit. Sections ``[[link]]`` describe elastic links, in a table,
or in a file whose ``robot`` is another robot's name or file.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from lab.core import se3
from lab.core.errors import LabError
from lab.core.limits import JOINTS, TARGETS, checked_name, checked_target
from lab.core.se3 import Array
from lab.core.units import MM
from lab.formats.description import DescriptionFormat, IdentifiedRobot
from lab.formats.drives_toml import Drives, drives_in, drives_lines
from lab.formats.structured import is_number, read_toml
from lab.formats.ur_calibration import read_corrections
from lab.kinematics.dynamics.beam import MATERIALS, LinkSections, Material, tube
from lab.kinematics.serial.axes_to_dh import JointAxes, chain_from_axes
from lab.kinematics.serial.chain import COLUMNS, Chain, Convention, parallel_links
from lab.kinematics.serial.khalil_frames import ANGULAR, SYMBOLS, KhalilFrame, khalil_frame, pose_of
from lab.kinematics.serial.serial_arm import SerialArm

__all__ = [
    "ANGLES",
    "LENGTHS",
    "RATES",
    "TABLE_TOML",
    "JointSection",
    "JointSections",
    "RobotTable",
    "TrackedSection",
    "described_links",
    "is_mechanism",
    "links_of",
    "quoted",
    "read_base",
    "read_height",
    "read_table",
    "read_tool",
    "refuse_unknown_keys",
    "write_table",
    "written_base_and_tool",
]

ANGLES = {"rad": 1.0, "deg": np.pi / 180}
LENGTHS = {"m": 1.0, "mm": 1e-3}
RATES = {"speed": "per_s", "acceleration": "per_s2"}


class TrackedSection:
    """A section whose read keys are tracked, so that a misspelt one is refused.

    Attributes:
        where: its name in messages.
    """

    def __init__(self, where: str, content: Any) -> None:
        if not isinstance(content, dict):
            raise LabError(f"{where}: is {content!r}; write a section of it, [[...]] with one key a line")
        self.content, self.unread, self.where = content, set(content), where

    def take(self, key: str, default: Any = None) -> Any:
        """Return the value of a key."""
        self.unread.discard(key)
        return self.content.get(key, default)

    def optional(self, quantity: str, units: dict[str, float]) -> float | None:
        """Return a number in one of some units, in SI, or None."""
        keys = [f"{quantity}_{unit}" for unit in units if f"{quantity}_{unit}" in self.content]
        if len(keys) > 1:
            raise LabError(f"{self.where}: {' and '.join(keys)} are both given; keep one")
        if not keys:
            return None
        number = self.take(keys[0])
        if not is_number(number):
            raise LabError(f"{self.where}: {keys[0]} is {number!r}; give a finite number")
        return float(number) * units[keys[0].removeprefix(quantity + "_")]

    def value(self, quantity: str, units: dict[str, float]) -> float:
        """Return a required number."""
        number = self.optional(quantity, units)
        if number is None:
            raise LabError(f"{self.where}: {quantity} is missing; give {quantity}_{' or _'.join(units)}")
        return number

    def positive(self, quantity: str, units: dict[str, float]) -> float:
        """Return a number above zero, or NaN."""
        number = self.optional(quantity, units)
        if number is not None and not number > 0:
            raise LabError(f"{self.where}: {quantity} is {number:g}; give more than zero, or leave it out")
        return np.nan if number is None else number

    def flag(self, key: str) -> bool:
        """Return a boolean; false if the key is absent."""
        value = self.take(key, False)
        if not isinstance(value, bool):
            raise LabError(f"{self.where}: {key} is {value!r}; write true or false")
        return value

    def refuse_the_rest(self, known: str) -> None:
        """Raise a LabError for a key that was not read."""
        if self.unread:
            raise LabError(f"{self.where}: unknown key '{sorted(self.unread)[0]}'; known are {known}")


class JointSection(TrackedSection):
    """Section ``[[joint]]``."""

    def __init__(self, path: Path, index: int, content: Any) -> None:
        super().__init__(f"{path}, joint {index + 1}", content)
        self.name = str(self.take("name", f"q{index + 1}"))
        self.where = f"{path}, joint {self.name}"
        kind = self.take("type", "revolute")
        if kind not in ("revolute", "prismatic"):
            raise LabError(f'{self.where}: type is {kind!r}; write "revolute" or "prismatic"')
        self.prismatic = kind == "prismatic"

    def rate(self, quantity: str) -> float:
        """Return the limit of speed or acceleration, or NaN."""
        units = LENGTHS if self.prismatic else ANGLES
        return self.positive(quantity, {f"{unit}_{RATES[quantity]}": factor for unit, factor in units.items()})

    def torque(self) -> float:
        """Return the limit of the torque, for a slide force, or NaN."""
        return self.positive("force", {"n": 1.0}) if self.prismatic else self.positive("torque", {"nm": 1.0})

    def sign(self) -> float:
        """Return +1 or -1, the direction of the joint's position."""
        sign = self.take("sign", 1)
        if sign not in (1, -1) or isinstance(sign, bool):
            raise LabError(f"{self.where}: sign is {sign!r}; write 1 or -1")
        return float(sign)

    def limits(self, warnings: list[str]) -> tuple[float, float]:
        """Return the lower and the upper limit; ``warnings`` is extended by assumptions."""
        units = LENGTHS if self.prismatic else ANGLES
        low, high = self.optional("lower", units), self.optional("upper", units)
        absent = [end for end, value in (("lower", low), ("upper", high)) if value is None]
        if absent and self.prismatic:
            raise LabError(f"{self.where}: a slide needs its limits; give {' and '.join(f'{a}_mm' for a in absent)}")
        if absent:
            warnings.append(f"{self.where}: no {' or '.join(absent)} limit given, so it moves to ±180° there")
        low, high = -np.pi if low is None else low, np.pi if high is None else high
        if not low < high:
            raise LabError(f"{self.where}: the lower limit is not below the upper one; swap or correct them")
        return low, high


def is_mechanism(path: Path) -> bool:
    """Check whether a TOML file describes a mechanism rather than a table."""
    return "frame" in read_toml(path)


def read_height(path: Path, document: dict[str, Any]) -> float | None:
    """Return ``height_mm``, in m."""
    height = document.get("height_mm")
    if height is not None and not (is_number(height) and height >= 0):
        raise LabError(f"{path}: height_mm is {height!r}; give frame 0's height above the floor, or leave it out")
    return None if height is None else MM.to_si(float(height))


class JointSections:
    """The sections ``[[joint]]`` of a robot's file, in order."""

    def __init__(self, path: Path, contents: list[Any]) -> None:
        self.path = path
        self.joints = [JointSection(path, i, content) for i, content in enumerate(contents)]
        self.names = [joint.name for joint in self.joints]
        JOINTS(path, self.names)
        for i, name in enumerate(self.names):
            checked_name(f"{path}: joint {i + 1}", name)
            if (first := self.names.index(name)) < i:
                raise LabError(f"{path}: joints {first + 1} and {i + 1} are both named {name}; rename one")

    def numbers(self, of_a_joint: Callable[[JointSection], float | tuple[float, float]]) -> Array:
        """Return a number of each joint ``(n,)``, or two ``(n, 2)``."""
        return np.array([of_a_joint(joint) for joint in self.joints])

    def values(self, warnings: list[str]) -> dict[str, Any]:
        """Return names, kinds, signs and limits as a chain or a mechanism has them; assumptions extend ``warnings``."""
        limits = self.numbers(lambda joint: joint.limits(warnings))
        return {
            "joint_names": tuple(self.names),
            "prismatic": tuple(joint.prismatic for joint in self.joints),
            "sign": self.numbers(JointSection.sign),
            "lower": limits[:, 0],
            "upper": limits[:, 1],
            "speed": self.numbers(lambda joint: joint.rate("speed")),
            "acceleration": self.numbers(lambda joint: joint.rate("acceleration")),
        }

    def refuse_the_rest(self, known: str) -> None:
        """Raise a LabError for a key that was not read."""
        for joint in self.joints:
            joint.refuse_the_rest(known)


def refuse_unknown_keys(path: Path, document: Mapping[str, Any], known: Sequence[str]) -> None:
    """Raise a LabError for a key at the top of a file that is none of these."""
    if unknown := set(document) - set(known):
        raise LabError(f"{path}: unknown key '{sorted(unknown)[0]}'; known are {', '.join(known)}")


def read_base(path: Path, section: Any) -> Array:
    """Return ``[base]``, ``(6,)`` m and rad."""
    parts = ("position_m", "rotation_vector_rad")
    numbers = [section.get(part) if isinstance(section, dict) else None for part in parts]
    for part, number in zip(parts, numbers, strict=True):
        if not isinstance(number, list) or len(number) != 3 or not all(is_number(v) for v in number):
            raise LabError(f"{path}: [base] {part} is {number!r}; give three numbers, [x, y, z]")
    return np.array(numbers, dtype=np.float64).ravel()


def _read_khalil_frame(where: str, section: Any) -> KhalilFrame:
    """Read ``gamma_deg``, ``b_mm``, ``alpha_deg``, ``d_mm``, ``theta_deg``, ``r_mm``, in canonical form."""
    read = TrackedSection(where, section)
    values = [read.value(name, ANGLES if turns else LENGTHS) for name, turns in zip(SYMBOLS, ANGULAR, strict=True)]
    read.refuse_the_rest(", ".join(SYMBOLS) + ", with _deg or _rad, and _mm or _m")
    return khalil_frame(pose_of(np.array(values)))


def read_tool(path: Path, section: Any) -> dict[str, Array]:
    """Return ``[tool]``: targets (m)."""
    if not isinstance(section, dict):
        raise LabError(f"{path}: tool is {section!r}; write a [tool] section with a line p1 = [x, y, z]")
    tool = {}
    TARGETS(f"{path}: [tool]", section)
    for name, point in section.items():
        checked_target(f"{path}: [tool]", name)
        if not isinstance(point, list) or len(point) != 3 or not all(is_number(v) for v in point):
            raise LabError(f"{path}: [tool] {name} is {point!r}; give three numbers in metres, [x, y, z]")
        tool[str(name)] = np.array(point, dtype=np.float64)
    return tool


def quoted(text: str) -> str:
    """Return a TOML string."""
    return '"' + text.replace("\\", "\\\\").replace('"', '\\"') + '"'


def written_base_and_tool(base: Array | None, tool: Mapping[str, Array], where: str) -> list[str]:
    """Return lines of ``[base]``, if given, and ``[tool]`` that read back to the bit."""
    lines: list[str] = []
    if base is not None:
        position, rotation = (", ".join(repr(float(v)) for v in part) for part in (base[:3], base[3:]))
        lines += ["", "[base]  # in the tracker's frame"]
        lines += [f"position_m = [{position}]", f"rotation_vector_rad = [{rotation}]"]
    lines += ["", f"[tool]  # targets in {where}"]
    return [*lines, *(f"{quoted(name)} = [{', '.join(repr(float(v)) for v in point)}]" for name, point in tool.items())]


_LINK_KEYS = (
    "number, material (or young_gpa, shear_gpa) with tube_mm, or ei_nm2 (or ei_y_nm2, ei_z_nm2), gj_nm2, ea_n; path_mm"
)
_MODULI = {"gpa": 1e9}


def described_links(path: Path) -> tuple[str, Any] | None:
    """Return the robot that a file refers to and its ``[[link]]`` sections; None without a reference."""
    content = read_toml(path)
    if "robot" not in content:
        return None
    if unknown := set(content) - {"robot", "link"}:
        raise LabError(f"{path}: unknown key '{sorted(unknown)[0]}'; valid are robot and [[link]] sections")
    if not isinstance(content["robot"], str) or not content["robot"]:
        raise LabError(f'{path}: robot is {content["robot"]!r}; give a model\'s name or a file, e.g. "irb120"')
    return content["robot"], content.get("link", [])


def links_of(path: Path, sections: Any, size: int) -> LinkSections:
    """Read the ``[[link]]`` sections of an arm with so many links."""
    if not isinstance(sections, list) or not sections:
        raise LabError(f"{path}: no links; give each elastic link a [[link]] section")
    compliances, paths, numbers = np.zeros((size, 4)), {}, set()
    for i, content in enumerate(sections):
        section = TrackedSection(f"{path}, [[link]] {i + 1}", content)
        number = section.take("number")
        if not isinstance(number, int) or isinstance(number, bool) or not 1 <= number <= size:
            raise LabError(f"{section.where}: number is {number!r}; give a link's, from 1 to {size}")
        if number in numbers:
            raise LabError(f"{section.where}: link {number} has a section already; keep one")
        numbers.add(number)
        section.where = f"{path}, link {number}"
        compliances[number - 1] = _compliances(section)
        if (line := _path(section)) is not None:
            paths[number - 1] = line
        section.refuse_the_rest(_LINK_KEYS)
    return LinkSections(compliances, paths)


def _compliances(section: TrackedSection) -> Array:
    """Return ``(4,)``, from a tube or from stiffnesses."""
    stated = [section.positive(name, {unit: 1.0}) for name, unit in _STIFFNESSES]
    both, y, z, twist, extension = stated
    if "tube_mm" in section.content:
        if not np.isnan(stated).all():
            raise LabError(f"{section.where}: tube_mm and stiffnesses are both given; keep one")
        return _tube(section)
    if "material" in section.content or {"young_gpa", "shear_gpa"} & section.unread:
        raise LabError(f"{section.where}: a material needs a cross-section; give tube_mm = [outer diameter, wall]")
    if not np.isnan(both) and not np.isnan([y, z]).all():
        raise LabError(f"{section.where}: ei_nm2 is for every axis; leave out ei_nm2, or ei_y_nm2 and ei_z_nm2")
    bending = [y, z] if np.isnan(both) else [both, both]
    stiffness = np.array([*bending, twist, extension])
    if np.isnan(stiffness).all() and "path_mm" not in section.content:
        raise LabError(f"{section.where}: its stiffness is missing; valid keys are {_LINK_KEYS}")
    return np.nan_to_num(1 / stiffness)


_STIFFNESSES = (("ei", "nm2"), ("ei_y", "nm2"), ("ei_z", "nm2"), ("gj", "nm2"), ("ea", "n"))


def _tube(section: TrackedSection) -> Array:
    material, size = _material(section), section.take("tube_mm")
    if not isinstance(size, list) or len(size) != 2 or not all(is_number(each) and each > 0 for each in size):
        raise LabError(f"{section.where}: tube_mm is {size!r}; give [outer diameter, wall], e.g. [80, 4]")
    outer, wall = (float(each) * LENGTHS["mm"] for each in size)
    if 2 * wall > outer:
        raise LabError(
            f"{section.where}: tube_mm: the wall of {size[1]:g} mm exceeds half the diameter of {size[0]:g} mm"
        )
    return tube(outer, wall, material)


def _material(section: TrackedSection) -> Material:
    """Return the material of a link's tube: of a name, or of moduli."""
    name, known = section.take("material"), ", ".join(MATERIALS)
    moduli = [section.positive(each, _MODULI) for each in ("young", "shear")]
    if name is None:
        if np.isnan(moduli).any():
            raise LabError(f"{section.where}: give a material ({known}), or young_gpa and shear_gpa")
        return Material(*moduli)
    if not isinstance(name, str) or name not in MATERIALS:
        raise LabError(f"{section.where}: material is {name!r}; known are {known}; or give young_gpa and shear_gpa")
    if not np.isnan(moduli).all():
        raise LabError(f"{section.where}: a material and moduli are both given; keep one")
    return MATERIALS[name]


def _path(section: TrackedSection) -> Array | None:
    """Return the path ``(k, 3)`` m, or None."""
    line = section.take("path_mm")
    if line is None:
        return None
    points = line if isinstance(line, list) else []
    if len(points) < 2 or not all(isinstance(p, list) and len(p) == 3 and all(map(is_number, p)) for p in points):
        raise LabError(f"{section.where}: path_mm is to be a list of two or more points [x, y, z]")
    return np.array(points, dtype=np.float64) * LENGTHS["mm"]


_QUANTITIES = {"theta": ANGLES, "alpha": ANGLES, "beta": ANGLES, "d": LENGTHS, "a": LENGTHS}
_TURNED = 1e-9  # of a rotation's elements
_TABLE_KEYS = (
    "name, type, sign, theta_deg, d_mm, a_mm, alpha_deg, beta_deg (or _rad, _m), lower and upper with _deg or _rad "
    "(of a slide _mm or _m), speed with _per_s, acceleration with _per_s2 after that, torque_nm "
    "(force_n), mass_kg"
)
_TOP_KEYS = {
    "name", "convention", "height_mm", "joint", "base", "tool", "corrections", "drive", "coupling", "link", "Z", "E"
}  # fmt: skip


@dataclass(frozen=True)
class RobotTable:
    """Content of a robot's table file.

    Attributes:
        base: ``(6,)`` of an identified arm, as ``base.x y z rx ry rz``; None for a nominal robot.
        tool: targets (m, in the last frame).
        height_m: of frame 0 above the floor, or None.
        mass_kg: ``(n,)`` of the links, or NaN.
        torque: ``(n,)`` torque limits of the joints, Nm or N, or NaN.
        warnings: messages for the user.
        T_world_frame0: pose ``(4, 4)`` (m) of frame 0 in the world by Khalil's Z; otherwise it follows from the height.
        links: its elastic links, or None.
    """

    chain: Chain
    base: Array | None
    tool: dict[str, Array]
    height_m: float | None
    mass_kg: Array
    torque: Array
    warnings: tuple[str, ...]
    T_world_frame0: Array | None = None
    links: LinkSections | None = None


def read_table(path: Path) -> RobotTable:
    """Read a Denavit-Hartenberg table."""
    document = read_toml(path)
    refuse_unknown_keys(path, document, sorted(_TOP_KEYS))
    convention = document.get("convention")
    if convention not in ("distal", "craig"):
        raise LabError(f'{path}: convention is {convention!r}; write convention = "distal" or "craig"')
    sections = document.get("joint")
    if not isinstance(sections, list) or not all(isinstance(each, dict) for each in sections) or not sections:
        raise LabError(f"{path}: no joints; give each joint a [[joint]] section")
    warnings: list[str] = []
    joints = JointSections(path, sections)
    values = joints.values(warnings)
    table, parallel = _rows(joints, convention)
    mass_kg = joints.numbers(lambda joint: joint.positive("mass", {"kg": 1.0}))
    torque = joints.numbers(JointSection.torque)
    joints.refuse_the_rest(_TABLE_KEYS)
    name = str(document.get("name", path.stem))
    chain = Chain(name=name, convention=convention, table=table, parallel=parallel, **values)
    if "corrections" in document:
        chain = _corrected(path, chain, document["corrections"])
    if (drives := drives_in(path, document, chain.size)) is not None:
        chain = replace(chain, encoders=drives.encoders, gear_ratio=drives.gear_ratio)
    base = read_base(path, document["base"]) if "base" in document else None
    tool = {**read_tool(path, document.get("tool", {})), **_khalil_tool(path, document, warnings)}
    height_m, place = read_height(path, document), _place(path, document)
    links = links_of(path, document["link"], chain.size) if "link" in document else None
    return RobotTable(chain, base, tool, height_m, mass_kg, torque, tuple(warnings), place, links)


def _rows(joints: JointSections, convention: Convention) -> tuple[Array, tuple[bool, ...]]:
    """Return the rows ``(n, 5)`` of the table, and which links join nearly parallel axes."""
    table = np.array([[_cell(joint, name) for name in COLUMNS] for joint in joints.joints])
    parallel = parallel_links(convention, table[:, 3])
    for joint, beta, near in zip(joints.joints, table[:, 4], parallel, strict=True):
        if beta != 0 and not near:
            raise LabError(f"{joint.where}: beta is for links between nearly parallel axes; leave it out")
    return table, parallel


def _corrected(path: Path, chain: Chain, file: Any) -> Chain:
    """Return the chain with a controller's corrections of its table, in canonical form."""
    if not isinstance(file, str) or not file:
        raise LabError(f'{path}: corrections is {file!r}; give the name of a file, e.g. "calibration.conf"')
    if chain.convention != "distal" or chain.size != 6 or any(chain.prismatic):
        raise LabError(f"{path}: corrections are for a distal table of six revolute joints; leave them out")
    table = np.array(chain.table)
    table[:, :4] += read_corrections(path.parent / file)
    frames = [np.eye(4)]
    for theta, d, a, alpha, beta in table:
        turn = se3.exp(np.array([0, 0, theta])) @ se3.exp(np.array([alpha, 0, 0])) @ se3.exp(np.array([0, beta, 0]))
        frames.append(frames[-1] @ se3.pose(turn, np.array([a * np.cos(theta), a * np.sin(theta), d])))
    at, last = np.stack(frames[:-1]), frames[-1]
    axes = JointAxes(at[:, :3, 3], at[:, :3, 2] * chain.sign[:, None], np.zeros((0, 3)))
    limits = (chain.lower, chain.upper, chain.speed, chain.acceleration)
    corrected, _ = chain_from_axes(chain.name, chain.joint_names, chain.prismatic, axes, np.eye(4), last, limits)
    return corrected


def _place(path: Path, document: Mapping[str, Any]) -> Array | None:
    """Return the pose ``(4, 4)`` of frame 0 in the world of a section ``[Z]``, or None."""
    if "Z" not in document:
        return None
    if "height_mm" in document:
        raise LabError(f"{path}: height_mm and [Z] both set the height of frame 0; keep one")
    return pose_of(_read_khalil_frame(f"{path}, [Z]", document["Z"]).values)


def _khalil_tool(path: Path, document: Mapping[str, Any], warnings: list[str]) -> dict[str, Array]:
    """Return targets (m) of sections ``[E.<target>]``; warn of rotations, which are ignored."""
    sections = document.get("E", {})
    if not isinstance(sections, dict) or not all(isinstance(each, dict) for each in sections.values()):
        raise LabError(f"{path}: E is {sections!r}; write a section [E.p1] for each target")
    tool = {}
    for name, section in sections.items():
        where = f"{path}, [E.{checked_name(f'{path}: [E]', name)}]"
        if name in document.get("tool", {}):
            raise LabError(f"{where}: [tool] has {name} too; keep one")
        pose = pose_of(_read_khalil_frame(where, section).values)
        tool[name] = np.array(pose[:3, 3])
        if np.abs(pose[:3, :3] - np.eye(3)).max() > _TURNED:
            warnings.append(
                f"{where}: its orientation is not used: the fit identifies the measured one without initial values"
            )
    return tool


def _cell(reader: JointSection, name: str) -> float:
    return (reader.optional if name == "beta" else reader.value)(name, _QUANTITIES[name]) or 0.0


def write_table(chain: Chain, base: Array | None, tool: Mapping[str, Array]) -> str:
    """Write a table that reads back to the bit, with base ``(6,)`` (m, rad), if given, and targets (m)."""
    lines = [f"name = {quoted(chain.name)}", f'convention = "{chain.convention}"']
    for i, joint in enumerate(chain.joint_names):
        unit = "m" if chain.prismatic[i] else "rad"
        lines += ["", "[[joint]]", f"name = {quoted(joint)}"]
        lines += [f'type = "{"prismatic" if chain.prismatic[i] else "revolute"}"', f"sign = {int(chain.sign[i])}"]
        for column, value in zip(COLUMNS, chain.table[i], strict=True):
            if column != "beta" or chain.parallel[i]:
                lines.append(f"{column}_{next(iter(_QUANTITIES[column]))} = {float(value)!r}")
        lines += [f"lower_{unit} = {float(chain.lower[i])!r}", f"upper_{unit} = {float(chain.upper[i])!r}"]
    if (own := chain.encoders) is not None:
        lines += ["", *drives_lines(Drives(own.gear_ratio, own.couplings, None, own.counts_per_turn))]
    elif chain.gear_ratio is not None:
        lines += ["", *drives_lines(Drives(chain.gear_ratio, np.eye(chain.size), None))]
    return "\n".join([*lines, *written_base_and_tool(base, tool, "the last frame")]) + "\n"


def _identified_table(identified: IdentifiedRobot[SerialArm, object]) -> str:
    arm = identified.arm
    base, table, tool = arm.split(identified.values)
    return write_table(arm.chain.with_table(table), base, dict(zip(arm.targets, tool, strict=True)))


TABLE_TOML = DescriptionFormat("calibrated.toml", _identified_table)
