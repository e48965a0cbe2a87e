"""Description of an arm's drives in TOML: gear ratios with their signs, couplings, drive gains, encoders.

The sections stand in a file of their own, or in a robot's table.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from lab.core.errors import LabError
from lab.core.limits import COUNTS, COUPLING_SIZE, GEAR, MOTOR_ZERO_DEG
from lab.core.se3 import Array
from lab.formats.structured import read_toml, structured
from lab.kinematics.joints import Encoders

__all__ = ["Drives", "drives_in", "drives_lines", "read_drives", "write_drives"]


@dataclass(frozen=True)
class Drives:
    """The drives of an arm.

    Attributes:
        gear_ratio: ``(J,)`` turns of each motor for a turn of its joint (rad per m of a slide), negative where they
            turn against each other.
        couplings: C ``(J, J)``, what each drive turns by the joints' positions, as its own joint feels it: one on the
            diagonal (``kinematics.dynamics.arm_dynamics``).
        torque_nm_per_a: ``(J,)`` drive gains, torque at the motor for its current; None where they are not given.
        counts_per_turn: ``(J,)`` of the encoders at the motors; None where they are not given.
        motor_zero_rad: ``(J,)`` what the motors' positions are where all joints are at zero; None where that is zero.
    """

    gear_ratio: Array
    couplings: Array
    torque_nm_per_a: Array | None
    counts_per_turn: Array | None = None
    motor_zero_rad: Array | None = None

    @property
    def encoders(self) -> Encoders | None:
        """The encoders; None where their counts are not given."""
        if self.counts_per_turn is None:
            return None
        return Encoders(self.gear_ratio, self.couplings, self.counts_per_turn)

    def joints(self, motors: Array) -> Array:
        """The joint positions ``(n, J)`` (rad, m) of motor positions ``(n, J)`` rad: q = (G C)^-1 (motors - zero)."""
        if np.linalg.matrix_rank(self.couplings) < len(self.couplings):
            raise LabError("the couplings of the drives are not independent: give ratios of another motor")
        turned = motors if self.motor_zero_rad is None else motors - self.motor_zero_rad
        joints: Array = (turned / self.gear_ratio) @ np.linalg.inv(self.couplings).T
        return joints

    def torques(self, currents: Array) -> Array:
        """Return the drives' torques ``(n, J)`` (Nm; N of a slide) at the joints from motor currents ``(n, J)`` A."""
        if self.torque_nm_per_a is None:
            raise LabError("the drives have no gains: give torque_nm_per_a of each, or torques instead of currents")
        torques: Array = currents * self.torque_nm_per_a * self.gear_ratio
        return torques


@dataclass(frozen=True)
class _DriveSection:
    gear_ratio: float
    torque_nm_per_a: float | None = None
    counts_per_turn: float | None = None
    motor_zero_deg: float = 0.0


@dataclass(frozen=True)
class _CouplingSection:
    drive: int
    joint: int
    ratio: float


@dataclass(frozen=True)
class _DrivesFile:
    drive: tuple[_DriveSection, ...]
    coupling: tuple[_CouplingSection, ...] = ()


def read_drives(path: Path, joints: int) -> Drives:
    """Read the drives of an arm: a ``[[drive]]`` for each joint, and ``[[coupling]]``."""
    return _drives_of(path, read_toml(path), joints)


def drives_in(path: Path, table: Mapping[str, Any], joints: int) -> Drives | None:
    """The drives that a robot's table names; None where it names none."""
    sections = {key: table[key] for key in ("drive", "coupling") if key in table}
    return _drives_of(path, sections, joints) if sections else None


def _drives_of(path: Path, sections: Mapping[str, Any], joints: int) -> Drives:
    """The drives that sections ``drive`` and ``coupling`` of a file describe."""
    found = structured(path, _DrivesFile, sections)
    if len(found.drive) != joints:
        raise LabError(f"{path}: {len(found.drive)} [[drive]], but the robot has {joints} joints; give one for each")
    gears = np.array([each.gear_ratio for each in found.drive])
    for i, each in enumerate(found.drive, start=1):
        for name, value in (("gear_ratio", each.gear_ratio), ("torque_nm_per_a", each.torque_nm_per_a)):
            if value is not None and abs(value) not in GEAR:
                raise LabError(f"{path}: [[drive]] {i}: {name} is {value:g}; give a number that is not zero")
        if each.counts_per_turn is not None and each.counts_per_turn not in COUNTS:
            raise LabError(
                f"{path}: [[drive]] {i}: counts_per_turn is {each.counts_per_turn:g}; give the counts of one motor turn"
            )
        if abs(each.motor_zero_deg) not in MOTOR_ZERO_DEG:
            raise LabError(
                f"{path}: [[drive]] {i}: motor_zero_deg is {each.motor_zero_deg:g}; give an angle in degrees"
            )
    gains, counts = ([getattr(each, name) for each in found.drive] for name in ("torque_nm_per_a", "counts_per_turn"))
    couplings, zeros = (
        _couplings(path, found.coupling, gears),
        np.deg2rad([each.motor_zero_deg for each in found.drive]),
    )
    return Drives(
        gears,
        couplings,
        _of_all(path, "torque_nm_per_a", gains),
        _of_all(path, "counts_per_turn", counts),
        zeros if zeros.any() else None,
    )


def _of_all(path: Path, name: str, values: list[float | None]) -> Array | None:
    """A number of every drive; None where none has it."""
    given = [value for value in values if value is not None]
    if given and len(given) < len(values):
        raise LabError(f"{path}: [[drive]] {values.index(None) + 1} has no {name}; give it for all drives or for none")
    return np.array(given) if given else None


def _couplings(path: Path, sections: tuple[_CouplingSection, ...], gears: Array) -> Array:
    couplings = np.eye(len(gears))
    for each in sections:
        for name, value in (("drive", each.drive), ("joint", each.joint)):
            if not 1 <= value <= len(gears):
                raise LabError(f"{path}: [[coupling]] {name} is {value}; give a number from 1 to {len(gears)}")
        if each.drive == each.joint:
            raise LabError(
                f"{path}: [[coupling]] drive {each.drive} with joint {each.joint}: give this ratio as its gear_ratio"
            )
        if abs(each.ratio) not in COUPLING_SIZE:
            raise LabError(f"{path}: [[coupling]] ratio is {each.ratio:g}; give the motor's turns for one of the joint")
        couplings[each.drive - 1, each.joint - 1] = each.ratio / gears[each.drive - 1]
    return couplings


def write_drives(path: Path, drives: Drives) -> None:
    """Write the TOML that ``read_drives`` reads back, to rounding."""
    path.write_text("\n".join(drives_lines(drives)), encoding="utf-8")


def drives_lines(drives: Drives) -> list[str]:
    """The lines of these sections."""
    lines = []
    for j, gear in enumerate(drives.gear_ratio.tolist()):
        lines += ["[[drive]]", f"gear_ratio = {gear!r}"]
        for name in ("torque_nm_per_a", "counts_per_turn"):
            if (values := getattr(drives, name)) is not None:
                lines.append(f"{name} = {float(values[j])!r}")
        if drives.motor_zero_rad is not None:
            lines.append(f"motor_zero_deg = {float(np.rad2deg(drives.motor_zero_rad[j]))!r}")
        lines.append("")
    for drive, joint in np.argwhere(drives.couplings - np.eye(len(drives.gear_ratio))).tolist():
        ratio = float(drives.couplings[drive, joint] * drives.gear_ratio[drive])
        lines += ["[[coupling]]", f"drive = {drive + 1}", f"joint = {joint + 1}", f"ratio = {ratio!r}", ""]
    return lines
