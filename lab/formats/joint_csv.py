"""Joint positions as CSV: one row per pose, in the columns and units of a measurement file, without measured points."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from lab.core.limits import ROWS, Limit
from lab.core.se3 import Array
from lab.formats.csv_table import CsvTable
from lab.formats.measurement_csv import ObservedColumns, read_measurements

__all__ = ["JointRows", "holds_targets", "read_joints"]


@dataclass(frozen=True)
class JointRows:
    """Joint positions of a file.

    Attributes:
        ids: of the rows.
        joints: ``(n, joints)`` rad or m.
        warnings: what a reader should be told.
    """

    ids: tuple[str, ...]
    joints: Array
    warnings: tuple[str, ...] = ()


def holds_targets(path: Path, most: Limit = ROWS) -> bool:
    """Whether a file gives positions of a point (columns that end in ``x_mm`` or ``x_m``), not joint positions alone.

    A plan has such columns, too, to be filled in: as long as they are empty, it is a file of joint positions.

    Args:
        path: of the file.
        most: how many rows it may have.

    Raises:
        LabError: it cannot be read, or has more rows than ``most``.
    """
    table = CsvTable(path, most)
    columns = [name for name in table.header if name in ("x_mm", "x_m") or name.endswith(("_x_mm", "_x_m"))]
    return any(cell for name in columns for cell in table.texts(name) or ())


def read_joints(path: Path, joint_names: Sequence[str], prismatic: Sequence[bool]) -> JointRows:
    """Read a file of joint positions.

    Args:
        path: of the file.
        joint_names: the robot's; the file may call them q1 ... qn.
        prismatic: which of them slide.

    Raises:
        LabError: with the file, the line as an editor counts it, and the column.
    """
    data = read_measurements(path, joint_names, prismatic, points=False, columns=ObservedColumns())
    kept = np.array([i for i, use in enumerate(data.use) if use != "skip"], dtype=np.int_)
    return JointRows(tuple(data.ids[i] for i in kept), data.joints[kept], data.warnings)
