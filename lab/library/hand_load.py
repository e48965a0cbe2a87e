"""Load at the flange as ``lab payload`` identified it, for calibrations and corrections."""

import json
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from lab.core.errors import LabError
from lab.core.limits import LENGTH_M, PAYLOAD_KG
from lab.core.linear_model import refuse_impossible_covariance
from lab.core.measurements import Measurements
from lab.core.se3 import Array
from lab.formats.structured import read_structured
from lab.library.result import plain_numbers
from lab.library.run_folder import check_edits
from lab.robots.config_file import LOAD_FILE
from lab.robots.robot import Robot

__all__ = ["HandLoad", "carrying", "read_hand_load"]


@dataclass(frozen=True)
class HandLoad:
    """A load at the flange, with mass and centre of mass."""

    mass_kg: float
    centre_m: Array  # (3,), its centre of mass in the last frame
    covariance: Array  # (4, 4) of mass and first moment, kg and kg m

    def write(self, folder: Path) -> None:
        """Write it into the folder of a run."""
        content = {
            "frame": "flange",
            "mass_kg": plain_numbers(self.mass_kg),
            "com_m": plain_numbers(self.centre_m),
            "covariance_of_mass_and_moment": plain_numbers(self.covariance),
        }
        (folder / LOAD_FILE).write_text(json.dumps(content, indent=2, allow_nan=False) + "\n", encoding="utf-8")

    def carried_by(self, robot: Robot) -> Robot:
        """The robot with payloads' centre of mass where this load's is.

        Raises:
            LabError: the robot has no masses.
        """
        if robot.loads is None:
            raise LabError(f"--load: robot {robot.name} has no masses, so nothing bends under a load; give its masses")
        return replace(robot, loads=replace(robot.loads, payload_at_m=self.centre_m))

    def with_payload(self, data: Measurements) -> Measurements:
        """Return rows with this payload, where they have no payload of their own."""
        if "payload_kg" in data.conditions:
            return data
        return replace(data, conditions={**data.conditions, "payload_kg": np.full(len(data), self.mass_kg)})


@dataclass(frozen=True)
class _SavedLoad:
    """Content of ``load.json``; its keys. None marks a value that was not identified."""

    mass_kg: float | None
    com_m: tuple[float | None, ...]
    covariance_of_mass_and_moment: tuple[tuple[float | None, ...], ...]

    def __post_init__(self) -> None:
        rows = self.covariance_of_mass_and_moment
        if len(self.com_m) != 3 or [len(row) for row in rows] != [4] * 4:
            raise LabError("com_m has 3 numbers, covariance_of_mass_and_moment 4 rows of 4")
        if self.mass_kg is not None and abs(self.mass_kg) not in PAYLOAD_KG:
            raise LabError(f"mass_kg is {self.mass_kg:g}; give {PAYLOAD_KG.shown}")
        if any(each is not None and abs(each) not in LENGTH_M for each in self.com_m):
            raise LabError("com_m is farther away than any payload hangs")


def carrying(robot: Robot, folder: Path | None, *, accept_edited: bool = False) -> tuple[Robot, HandLoad | None]:
    """The robot with payloads where the load hangs that a run of ``lab payload`` found, and that load; None without."""
    if folder is None:
        return robot, None
    load = read_hand_load(folder, accept_edited=accept_edited)
    return load.carried_by(robot), load


def read_hand_load(folder: Path, *, accept_edited: bool = False) -> HandLoad:
    """Read the load that ``lab payload`` identified.

    Args:
        accept_edited: whether the file may have been changed since the run was written.

    Raises:
        LabError: the folder is no such run, or mass or centre of mass were not identified.
    """
    path = folder / LOAD_FILE
    try:
        found = read_structured(path, _SavedLoad, "give a run of lab payload")
    except LabError as error:
        raise LabError(f"--load {error}") from error
    centre = np.array(found.com_m, dtype=np.float64)  # None is NaN
    covariance = np.array(found.covariance_of_mass_and_moment, dtype=np.float64)
    if found.mass_kg is None or not found.mass_kg > 0 or not np.isfinite(centre).all():
        raise LabError(f"--load {folder}: mass and centre of mass were not identified there; record more poses")
    if np.isfinite(covariance).all():
        refuse_impossible_covariance(f"--load {path}", covariance)
    check_edits(folder, (LOAD_FILE,), accept=accept_edited)
    return HandLoad(found.mass_kg, centre, covariance)
