"""Drives of an arm in TOML: signed gear ratios, couplings, drive gains, encoders; in an own file or a robot's table."""

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

__all__ = ["Drives", "drives_in", "drives_lines", "read_drives"]


@dataclass(frozen=True)
class Drives:
    """Drives of an arm.

    Attributes:
        gear_ratio: ``(J,)`` signed turns of each motor per turn of its joint (rad per m of a slide).
        couplings: C ``(J, J)``, turns of each drive by the joints' positions, as its own joint feels it: unit diagonal.
        torque_nm_per_a: ``(J,)`` drive gains, torque at the motor per current, or None.
        counts_per_turn: ``(J,)`` of the encoders at the motors, or None.
        motor_zero_rad: ``(J,)`` positions of the motors at zero joint positions; None for zero.
    """

    gear_ratio: Array
    couplings: Array
    torque_nm_per_a: Array | None
    counts_per_turn: Array | None = None
    motor_zero_rad: Array | None = None

    @property
    def encoders(self) -> Encoders | None:
        """Encoders; None without counts."""
        if self.counts_per_turn is None:
            return None
        return Encoders(self.gear_ratio, self.couplings, self.counts_per_turn)

    def joints(self, motors: Array) -> Array:
        """Return joint positions ``(n, J)`` (rad, m) of motor positions: q = (G C)^-1 (motors - zero)."""
        if np.linalg.matrix_rank(self.couplings) < len(self.couplings):
            raise LabError("the couplings of the drives are not independent: give ratios of another motor")
        turned = motors if self.motor_zero_rad is None else motors - self.motor_zero_rad
        return np.asarray((turned / self.gear_ratio) @ np.linalg.inv(self.couplings).T)

    def torques(self, currents: Array) -> Array:
        """Return the drives' torques ``(n, J)`` (Nm; N of a slide) at the joints from motor currents ``(n, J)`` A."""
        if self.torque_nm_per_a is None:
            raise LabError("the drives have no gains: give torque_nm_per_a of each, or torques instead of currents")
        return np.asarray(currents * self.torque_nm_per_a * self.gear_ratio)


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
    """Return the drives in a robot's table, or None."""
    sections = {key: table[key] for key in ("drive", "coupling") if key in table}
    return _drives_of(path, sections, joints) if sections else None


def _drives_of(path: Path, sections: Mapping[str, Any], joints: int) -> Drives:
    file = structured(path, _DrivesFile, sections)
    if len(file.drive) != joints:
        raise LabError(f"{path}: {len(file.drive)} [[drive]], but the robot has {joints} joints; give one for each")
    gears = np.array([each.gear_ratio for each in file.drive])
    for i, each in enumerate(file.drive, start=1):
        _refuse_unlikely(f"{path}: [[drive]] {i}", each)
    gains, counts = ([getattr(each, name) for each in file.drive] for name in ("torque_nm_per_a", "counts_per_turn"))
    zeros = np.deg2rad([each.motor_zero_deg for each in file.drive])
    return Drives(
        gears,
        _couplings(path, file.coupling, gears),
        _of_all(path, "torque_nm_per_a", gains),
        _of_all(path, "counts_per_turn", counts),
        zeros if zeros.any() else None,
    )


def _refuse_unlikely(where: str, drive: _DriveSection) -> None:
    """Refuse numbers of a drive that cannot be in their unit."""
    for name, value in (("gear_ratio", drive.gear_ratio), ("torque_nm_per_a", drive.torque_nm_per_a)):
        if value is not None and abs(value) not in GEAR:
            raise LabError(f"{where}: {name} is {value:g}; give a number that is not zero")
    if drive.counts_per_turn is not None and drive.counts_per_turn not in COUNTS:
        raise LabError(f"{where}: counts_per_turn is {drive.counts_per_turn:g}; give the counts of one motor turn")
    if abs(drive.motor_zero_deg) not in MOTOR_ZERO_DEG:
        raise LabError(f"{where}: motor_zero_deg is {drive.motor_zero_deg:g}; give an angle in degrees")


def _of_all(path: Path, name: str, values: list[float | None]) -> Array | None:
    stated = [value for value in values if value is not None]
    if stated and len(stated) < len(values):
        raise LabError(f"{path}: [[drive]] {values.index(None) + 1} has no {name}; give it for all drives or for none")
    return np.array(stated) if stated else None


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


def drives_lines(drives: Drives) -> list[str]:
    """Return the lines of these sections."""
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
