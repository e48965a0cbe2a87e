"""Read the task region of an option: a name, a box, or a file of targets."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np

from lab.core.errors import LabError, error_context
from lab.core.limits import OPTION_SIZE
from lab.core.random import rng_for
from lab.core.se3 import Array, transform
from lab.core.units import MM
from lab.formats.target_csv import Targets, read_targets

__all__ = ["REGION_HELP", "RegionKind", "TaskRegion", "task_region"]

REGION_HELP = (
    "Region in which the verdict holds: measured (around the measured poses), workspace (within the joints' "
    "limits), a box x0,x1,y0,y1,z0,z1 in mm in the robot's frame 0, or a CSV file of targets, as lab compensate takes"
)
RegionKind = Literal["measured", "workspace", "box", "targets"]
_BOX_POINTS = 200
_NUMBERS = 6


@dataclass(frozen=True)
class TaskRegion:
    """A region of an option.

    Attributes:
        kind: form of the option.
        box_m: ``(3, 2)`` m, the ends of a box along each axis of frame 0; None for another kind.
        file: of targets; None for another kind.
    """

    kind: RegionKind
    box_m: Array | None = None
    file: Path | None = None

    def points(self, T_instrument_frame0: Array, joint_names: Sequence[str], prismatic: Sequence[bool]) -> Array:
        """Return points ``(n, 3)`` m of the box or the file, in the frame of the measurements; none of another kind.

        Args:
            T_instrument_frame0: ``(4, 4)`` pose of frame 0 in the frame of the measurements.
            joint_names, prismatic: of the robot.

        Raises:
            LabError: the file cannot be read.
        """
        if self.box_m is not None:
            low, high = self.box_m.T
            drawn = low + (high - low) * rng_for(0, "places").random((_BOX_POINTS, 3))
            return np.asarray(transform(T_instrument_frame0, drawn))
        if self.file is not None:
            return self._targets(joint_names, prismatic).positions
        return np.empty((0, 3))

    def joints(self, joint_names: Sequence[str], prismatic: Sequence[bool]) -> Array:
        """Return the joint positions ``(n, joints)`` (rad or m) that the file gives, in the rows that have them.

        Args:
            joint_names, prismatic: of the robot.

        Raises:
            LabError: the file cannot be read.
        """
        if self.file is None:
            return np.empty((0, len(joint_names)))
        given = self._targets(joint_names, prismatic).joints
        return given[np.isfinite(given).all(axis=1)]

    def names(self, joint_names: Sequence[str], prismatic: Sequence[bool]) -> tuple[str, ...]:
        """Return the names of the points: the ids of a file's targets; none of another kind.

        Args:
            joint_names, prismatic: of the robot.

        Raises:
            LabError: the file cannot be read.
        """
        return () if self.file is None else self._targets(joint_names, prismatic).ids

    def _targets(self, joint_names: Sequence[str], prismatic: Sequence[bool]) -> Targets:
        assert self.file is not None
        with error_context("--region"):
            return read_targets(self.file, joint_names, prismatic)


def task_region(text: str) -> TaskRegion:
    """Read the option.

    Raises:
        LabError: it is no name, box or file.
    """
    if text in ("measured", "workspace"):
        return TaskRegion("measured" if text == "measured" else "workspace")
    wrong = LabError(
        f"--region {text}: give measured, workspace, a box x0,x1,y0,y1,z0,z1 in mm, or a CSV file of targets"
    )
    try:
        numbers = [float(each) for each in text.split(",")]
    except ValueError:
        if Path(text).suffix.lower() != ".csv":
            raise wrong from None
        return TaskRegion("targets", file=Path(text))
    box = MM.to_si(np.array(numbers).reshape(-1, 2)) if len(numbers) == _NUMBERS else np.empty((0, 2))
    if not len(box) or not all(abs(each) in OPTION_SIZE for each in numbers):
        raise wrong
    if not (box[:, 0] < box[:, 1]).all():
        raise LabError(f"--region {text}: each axis of the box goes from a smaller to a larger coordinate")
    return TaskRegion("box", box)
