"""The points of a motion as CSV: one row per point, by joint positions or by a position of the tool.

The column ``move`` says how the point is reached: ``joint`` (where it is empty or missing), ``line``, or ``circle``
through the point of the row above it, whose move is ``via``. A point that is passed without a stop has a velocity:
``vx_mm_per_s``, ``vy_mm_per_s``, ``vz_mm_per_s`` of the tool, or ``speed_<joint>_deg_per_s`` (``_mm_per_s``).
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from lab.core.errors import LabError
from lab.core.limits import PASSED
from lab.core.se3 import AngleConvention, Array
from lab.core.units import joints_to_si
from lab.formats.csv_table import CsvTable
from lab.formats.measurement_csv import ObservedColumns, read_measurements
from lab.formats.target_csv import holds_targets, read_targets

__all__ = ["MOVES", "PathRows", "read_path"]

MOVES = ("joint", "line", "via", "circle")
_VELOCITY = ("vx_mm_per_s", "vy_mm_per_s", "vz_mm_per_s")


@dataclass(frozen=True)
class PathRows:
    """The points of a motion.

    Attributes:
        ids: of the rows.
        moves: how each point is reached; the first one is where the motion starts.
        joints: ``(n, joints)`` rad or m; NaN where the point is given by the tool's position.
        positions: ``(n, 3)`` m, NaN where the point is given by joint positions.
        rotations: ``(n, 3, 3)``, NaN where the orientation is not given.
        velocities: ``(n, 3)`` m/s of the tool there, zero where it stops.
        speeds: ``(n, joints)`` rad/s or m/s of the joints there, zero where they stop.
        warnings: what a reader should be told.
    """

    ids: tuple[str, ...]
    moves: tuple[str, ...]
    joints: Array
    positions: Array
    rotations: Array
    velocities: Array
    speeds: Array
    warnings: tuple[str, ...]

    def __len__(self) -> int:
        return len(self.ids)


def read_path(
    path: Path, joint_names: Sequence[str], prismatic: Sequence[bool], meaning: AngleConvention | None = None
) -> PathRows:
    """Read the points of a motion.

    Args:
        path: of the file.
        joint_names: the robot's; the file may call them q1 ... qn.
        prismatic: which of them slide.
        meaning: of three angles (``lab.core.se3``).

    Raises:
        LabError: with the file, and where there is one the line and the column.
    """
    texts, size = CsvTable(path, PASSED).texts("move"), len(joint_names)
    units = ["mm" if slides else "deg" for slides in prismatic]
    speeds = [f"speed_{name}_{unit}_per_s" for name, unit in zip(joint_names, units, strict=True)]
    columns = ObservedColumns(orientations=True, numbers=(*_VELOCITY, *speeds), texts=("move",))
    if holds_targets(path):
        found = read_targets(path, joint_names, prismatic, meaning, columns)
        ids, given, lines, warnings = found.ids, found.conditions, found.lines, found.warnings
        positions, rotations, joints = found.positions, found.rotations, found.joints
    else:
        rows = read_measurements(path, joint_names, prismatic, points=False, columns=columns)
        ids, given, lines, warnings = rows.ids, rows.conditions, rows.lines, rows.warnings
        positions, rotations, joints = np.full((len(ids), 3), np.nan), np.full((len(ids), 3, 3), np.nan), rows.joints
    table = CsvTable(path)
    row_of = {line: i for i, line in enumerate(table.lines)}
    moves = tuple((texts[row_of[line]] if texts else "") or "joint" for line in lines)
    for line, move in zip(lines, moves, strict=True):
        if move not in MOVES:
            raise table.fail(row_of[line], "move", f"'{move}' is unknown; write one of {', '.join(MOVES)}")
    _refuse_half_circles(path, moves, lines)
    if len(ids) < 2:
        raise LabError(f"{path}: {len(ids)} point; give two or more, the first being where the motion starts")
    by_joint = np.stack([_column(given, name, len(ids)) for name in speeds], axis=1).reshape(-1, size)
    return PathRows(
        ids, moves, joints, positions, rotations,
        1e-3 * np.stack([_column(given, name, len(ids)) for name in _VELOCITY], axis=1),
        joints_to_si(by_joint, prismatic), warnings,
    )  # fmt: skip


def _refuse_half_circles(path: Path, moves: Sequence[str], lines: Sequence[int]) -> None:
    """Refuse a via without its circle in the row below, or a circle without its via in the row above."""
    for above, move, line in zip(("", *moves[:-1]), moves, lines, strict=True):
        if (move == "circle") != (above == "via"):
            raise LabError(
                f"{path}: line {line}, column move: a circle is two rows, via and below it circle; give both"
            )
    if moves and (moves[-1] == "via" or moves[0] in ("via", "circle")):
        raise LabError(f"{path}: a circle starts where the row above it ends: give its start, via and circle")


def _column(given: Mapping[str, Array], name: str, count: int) -> Array:
    """A column's numbers ``(n,)``; zero where it is empty or missing."""
    return np.nan_to_num(given[name]) if name in given else np.zeros(count)
