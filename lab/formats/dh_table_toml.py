"""Denavit-Hartenberg tables as TOML files, the exact form of a robot that has no model.

Keys as in the README: ``name``, ``convention``, and one ``[[joint]]`` each. What the lab writes
(``theta_rad``, ``d_m``, ``beta_rad``, …, ``[base]``, ``[tool]``) reads back to the bit.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from lab.core import se3
from lab.core.errors import LabError
from lab.core.limits import checked_name
from lab.core.se3 import Array
from lab.formats.description import DescriptionFormat, IdentifiedRobot
from lab.formats.drives_toml import Drives, drives_in, drives_lines
from lab.formats.links_toml import links_of
from lab.formats.robot_toml import (
    ANGLES,
    LENGTHS,
    RATES,
    JointSection,
    jerks_of,
    quoted,
    read_base,
    read_height,
    read_khalil_frame,
    read_tool,
    refuse_doubled_names,
    written_base_and_tool,
)
from lab.formats.toml import read_toml
from lab.formats.ur_calibration import read_corrections
from lab.kinematics.dynamics.sections import LinkSections
from lab.kinematics.serial.arm import SerialArm
from lab.kinematics.serial.axes_to_dh import JointAxes, chain_from_axes
from lab.kinematics.serial.chain import COLUMNS, Chain, parallel_links
from lab.kinematics.serial.khalil_frames import pose_of

__all__ = ["TABLE_TOML", "RobotTable", "read_table"]

_QUANTITIES = {"theta": ANGLES, "alpha": ANGLES, "beta": ANGLES, "d": LENGTHS, "a": LENGTHS}
_TURNED = 1e-9  # of a rotation's elements
_KNOWN = (
    "name, type, sign, theta_deg, d_mm, a_mm, alpha_deg, beta_deg (or _rad, _m), lower and upper with _deg or _rad "
    "(of a slide _mm or _m), speed with _per_s, acceleration with _per_s2 and jerk with _per_s3 after that, torque_nm "
    "(force_n), mass_kg"
)
_TOP_KEYS = {
    "name", "convention", "height_mm", "joint", "base", "tool", "corrections", "drive", "coupling", "link", "Z", "E"
}  # fmt: skip


@dataclass(frozen=True)
class RobotTable:
    """What a table file holds.

    Attributes:
        base: ``(6,)`` of an identified arm, as ``base.x y z rx ry rz``; None of a nominal robot.
        tool: targets (m, in the last frame).
        height_m: of frame 0 above the floor that the arm stands on; None where there is none.
        mass_kg: ``(n,)`` of the links that the joints move; NaN where unknown.
        torque: ``(n,)`` largest ones of the joints, Nm or N; NaN where unknown.
        warnings: what a user should be told.
        T_world_frame0: pose ``(4, 4)`` (m) of frame 0 in the world, where the file gives Khalil's Z; else it follows
            from the height.
        links: its elastic links; None where the file has none.
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
    readers = [JointSection(path, i, joint) for i, joint in enumerate(joints)]
    refuse_doubled_names(path, [reader.name for reader in readers])
    limits = [reader.limits(warnings) for reader in readers]
    table = np.array([[_cell(reader, name) for name in COLUMNS] for reader in readers])
    parallel = list(parallel_links(convention, table[:, 3]))
    for i, reader in enumerate(readers):
        if table[i, 4] != 0 and not parallel[i]:
            raise LabError(f"{reader.where}: beta is for links between nearly parallel axes; leave it out here")
    signs = np.array([reader.sign() for reader in readers])
    speed, acceleration, jerk = (np.array([reader.rate(name) for reader in readers]) for name in RATES)
    mass_kg = np.array([reader.positive("mass", {"kg": 1.0}) for reader in readers])
    torque = np.array([reader.torque() for reader in readers])
    for reader in readers:
        reader.refuse_the_rest(_KNOWN)
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
        jerk=jerks_of(jerk),
        parallel=tuple(parallel),
    )
    if "corrections" in document:
        chain = _corrected(path, chain, document["corrections"])
    if (drives := drives_in(path, document, chain.size)) is not None:
        chain = replace(chain, encoders=drives.encoders, gear_ratio=drives.gear_ratio)
    base = read_base(path, document["base"]) if "base" in document else None
    tool = {**read_tool(path, document.get("tool", {})), **_khalil_tool(path, document, warnings)}
    height_m, place = read_height(path, document), _place(path, document)
    links = links_of(path, document["link"], chain.size) if "link" in document else None
    return RobotTable(chain, base, tool, height_m, mass_kg, torque, tuple(warnings), place, links)


def _corrected(path: Path, chain: Chain, file: Any) -> Chain:
    """The chain with a controller's corrections of its table, described anew from the axes that it then has."""
    if not isinstance(file, str) or not file:
        raise LabError(f'{path}: corrections is {file!r}; give the name of a file, e.g. "calibration.conf"')
    if chain.convention != "distal" or chain.size != 6 or any(chain.prismatic):
        raise LabError(f"{path}: corrections are of a distal table of six joints that turn; leave them out here")
    table = np.array(chain.table)
    table[:, :4] += read_corrections(path.parent / file)
    frames = [np.eye(4)]
    for theta, d, a, alpha, beta in table:
        turn = se3.exp(np.array([0, 0, theta])) @ se3.exp(np.array([alpha, 0, 0])) @ se3.exp(np.array([0, beta, 0]))
        frames.append(frames[-1] @ se3.pose(turn, np.array([a * np.cos(theta), a * np.sin(theta), d])))
    at, last = np.stack(frames[:-1]), frames[-1]
    axes = JointAxes(at[:, :3, 3], at[:, :3, 2] * chain.sign[:, None], np.zeros((0, 3)))
    limits = (chain.lower, chain.upper, chain.speed, chain.acceleration)
    found, _ = chain_from_axes(chain.name, chain.joint_names, chain.prismatic, axes, np.eye(4), last, limits)
    return replace(found, jerk=chain.jerk)


def _place(path: Path, document: Mapping[str, Any]) -> Array | None:
    """The pose ``(4, 4)`` of frame 0 in the world that a section ``[Z]`` says; None where there is none."""
    if "Z" not in document:
        return None
    if "height_mm" in document:
        raise LabError(f"{path}: height_mm and [Z] both say where frame 0 is; keep one")
    return pose_of(read_khalil_frame(f"{path}, [Z]", document["Z"]).values)


def _khalil_tool(path: Path, document: Mapping[str, Any], warnings: list[str]) -> dict[str, Array]:
    """Targets (m) of sections ``[E.<target>]``; a warning for one that is turned, of which the place is taken alone."""
    sections = document.get("E", {})
    if not isinstance(sections, dict) or not all(isinstance(each, dict) for each in sections.values()):
        raise LabError(f"{path}: E is {sections!r}; write a section [E.p1] for each target")
    tool = {}
    for name, section in sections.items():
        where = f"{path}, [E.{checked_name(f'{path}: [E]', name)}]"
        if name in document.get("tool", {}):
            raise LabError(f"{where}: [tool] has {name} too; keep one")
        pose = pose_of(read_khalil_frame(where, section).values)
        tool[name] = np.array(pose[:3, 3])
        if np.abs(pose[:3, :3] - np.eye(3)).max() > _TURNED:
            warnings.append(f"{where}: its orientation is not used: a measured one is identified from no idea of it")
    return tool


def _cell(reader: JointSection, name: str) -> float:
    """A cell of the table; only beta may be left out."""
    return (reader.optional if name == "beta" else reader.value)(name, _QUANTITIES[name]) or 0.0


def _document(path: Path) -> dict[str, Any]:
    """The file's content, if it is TOML and has no unknown key."""
    document = read_toml(path)
    if unknown := set(document) - _TOP_KEYS:
        raise LabError(f"{path}: unknown key '{sorted(unknown)[0]}'; known are {', '.join(sorted(_TOP_KEYS))}")
    return document


def _write_table(chain: Chain, base: Array, tool: dict[str, Array]) -> str:
    """A table that reads back to the bit, with the base ``(6,)`` (m, rad) and the targets (m)."""
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
    return _write_table(arm.chain.with_table(table), base, dict(zip(arm.targets, tool, strict=True)))


TABLE_TOML = DescriptionFormat("calibrated.toml", _identified_table)
