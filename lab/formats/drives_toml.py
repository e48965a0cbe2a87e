"""How an arm's drives turn its joints: gear ratios with their signs, couplings, and drive gains, as TOML."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from lab.core.errors import LabError
from lab.core.se3 import Array
from lab.formats.structured import structured
from lab.formats.toml import read_toml

__all__ = ["Drives", "read_drives", "write_drives"]

_LARGEST = 1e6


@dataclass(frozen=True)
class Drives:
    """The drives of an arm.

    Attributes:
        gear_ratio: ``(J,)`` turns of each motor for a turn of its joint (rad per m of a slide), negative where they
            turn against each other.
        couplings: C ``(J, J)``, what each drive turns by the joints' positions, as its own joint feels it: one on the
            diagonal (``kinematics.dynamics.arm_dynamics``).
        torque_nm_per_a: ``(J,)`` drive gains, torque at the motor for its current; None where they are not given.
    """

    gear_ratio: Array
    couplings: Array
    torque_nm_per_a: Array | None

    def torques(self, currents: Array) -> Array:
        """The drives' torques ``(n, J)`` (Nm; N of a slide), as the joints feel them, of motor currents ``(n, J)`` A.

        Raises:
            LabError: there are no drive gains.
        """
        if self.torque_nm_per_a is None:
            raise LabError(
                "the drives have no gains: give torque_nm_per_a of each, or torques in the place of currents"
            )
        torques: Array = currents * self.torque_nm_per_a * self.gear_ratio
        return torques


@dataclass(frozen=True)
class _DriveSection:
    gear_ratio: float
    torque_nm_per_a: float | None = None


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
    """Read the drives of an arm with so many joints: a ``[[drive]]`` for each, and ``[[coupling]]`` where it has some.

    Raises:
        LabError: the file is missing or malformed, or a number cannot be.
    """
    found = structured(path, _DrivesFile, read_toml(path))
    if len(found.drive) != joints:
        raise LabError(f"{path}: {len(found.drive)} [[drive]], but the robot has {joints} joints; give one for each")
    gears = np.array([each.gear_ratio for each in found.drive])
    for i, each in enumerate(found.drive, start=1):
        for name, value in (("gear_ratio", each.gear_ratio), ("torque_nm_per_a", each.torque_nm_per_a)):
            if value is not None and not 0 < abs(value) < _LARGEST:
                raise LabError(f"{path}: [[drive]] {i}: {name} is {value:g}; give a number that is not zero")
    gains = [each.torque_nm_per_a for each in found.drive]
    given = [gain for gain in gains if gain is not None]
    if given and len(given) < joints:
        raise LabError(f"{path}: [[drive]] {gains.index(None) + 1} has no torque_nm_per_a; give it of all or none")
    return Drives(gears, _couplings(path, found.coupling, gears), np.array(given) if given else None)


def _couplings(path: Path, sections: tuple[_CouplingSection, ...], gears: Array) -> Array:
    couplings = np.eye(len(gears))
    for each in sections:
        for name, value in (("drive", each.drive), ("joint", each.joint)):
            if not 1 <= value <= len(gears):
                raise LabError(f"{path}: [[coupling]] {name} is {value}; give a number from 1 to {len(gears)}")
        if each.drive == each.joint:
            raise LabError(f"{path}: [[coupling]] drive {each.drive} with joint {each.joint}: that is its gear_ratio")
        if not abs(each.ratio) < _LARGEST:
            raise LabError(f"{path}: [[coupling]] ratio is {each.ratio:g}; give the motor's turns for one of the joint")
        couplings[each.drive - 1, each.joint - 1] = each.ratio / gears[each.drive - 1]
    return couplings


def write_drives(path: Path, drives: Drives) -> None:
    """Write the TOML that ``read_drives`` reads back, to rounding."""
    lines = []
    for j, gear in enumerate(drives.gear_ratio.tolist()):
        lines += ["[[drive]]", f"gear_ratio = {gear!r}"]
        if drives.torque_nm_per_a is not None:
            lines.append(f"torque_nm_per_a = {float(drives.torque_nm_per_a[j])!r}")
        lines.append("")
    for drive, joint in np.argwhere(drives.couplings - np.eye(len(drives.gear_ratio))).tolist():
        ratio = float(drives.couplings[drive, joint] * drives.gear_ratio[drive])
        lines += ["[[coupling]]", f"drive = {drive + 1}", f"joint = {joint + 1}", f"ratio = {ratio!r}", ""]
    path.write_text("\n".join(lines), encoding="utf-8")
