"""Targets and joint positions in CSV files."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from lab.core import se3
from lab.core.errors import LabError, counted, error_context, option_name
from lab.core.limits import ROWS, Limit
from lab.core.measurements import Measurements, measured
from lab.core.orientation import AngleConvention
from lab.core.se3 import Array
from lab.core.values import Value
from lab.formats.csv_table import CsvTable
from lab.formats.measurement_csv import ObservedColumns, PoseReader, read_measurements
from lab.formats.orientations import ENDS, read_orientations

__all__ = ["Targets", "holds_targets", "read_joints", "read_targets"]


@dataclass(frozen=True, eq=False, repr=False)
class Targets(Value):
    """Target poses of a point of the tool, in the frame of the measurements.

    Attributes:
        tool: the point's name.
        ids: of the rows.
        positions: ``(n, 3)`` m.
        rotations: ``(n, 3, 3)`` of the tool's axes; NaN if free.
        joints: ``(n, joints)`` rad or m, selecting the nearest IK solution, or NaN.
        conditions: ``payload_kg``, ``approach_<joint>``, ``(n,)`` each.
        lines: of the file.
        warnings: messages for the user.
    """

    tool: str
    ids: tuple[str, ...]
    positions: Array
    rotations: Array
    joints: Array
    conditions: Mapping[str, Array] = field(default_factory=dict)
    lines: tuple[int, ...] = ()
    warnings: tuple[str, ...] = ()

    def __len__(self) -> int:
        return len(self.positions)

    def _about(self) -> str:
        return f"{counted(len(self), 'pose')} of {self.tool}"

    def take(self, rows: NDArray[np.int_]) -> "Targets":
        """Return some rows."""
        return replace(
            self,
            ids=tuple(self.ids[i] for i in rows),
            positions=self.positions[rows],
            rotations=self.rotations[rows],
            joints=self.joints[rows],
            conditions={name: column[rows] for name, column in self.conditions.items()},
            lines=tuple(self.lines[i] for i in rows),
        )


def read_targets(
    path: Path,
    joint_names: Sequence[str],
    prismatic: Sequence[bool],
    meaning: AngleConvention | None = None,
    columns: ObservedColumns = ObservedColumns(orientations=True),  # noqa: B008
) -> Targets:
    """Read a file of targets: a position each, and optionally a quaternion or three angles.

    Args:
        joint_names: the robot's, or q1…qn, for columns of joint positions, each row all or none.
        prismatic: flags of slides.
        meaning: convention of three angles.
        columns: further columns; numbers become conditions.
    """
    return _TargetReader(path, list(joint_names), list(prismatic), columns).read_all(meaning)


class _TargetReader(PoseReader):
    """Reader of a file of targets."""

    unknown_are = "passed over"

    def read_all(self, meaning: AngleConvention | None) -> Targets:
        joints = self._joints()
        self._refuse_further_joints()
        names = self._targets()
        self._refuse_unknown_axes(names)
        if len(names) != 1:
            problem = f"targets of {', '.join(names)}: give those of one point" if names else "no target"
            raise self.wrong(f"{problem}, in columns like x_mm, y_mm, z_mm")
        positions = np.stack([self._coordinate(names[0], axis) for axis in "xyz"], axis=1)
        self._refuse_half_seen(names[0], positions)
        if np.isnan(positions).any():
            row = int(np.isnan(positions).any(axis=1).argmax())
            raise self.fail(row, self._coordinate_column(names[0], "x"), "empty; give every target a position")
        ids, use, conditions = self._ids(self.texts("id")), self._uses(self.texts("use")), self._conditions()
        rotations = self._rotations(names[0], positions, meaning)
        retained = np.array([i for i, each in enumerate(use) if each != "skip"], dtype=np.int_)
        if not len(retained):
            raise LabError(f"{self.path}: every row has use = skip; leave one to correct")
        return Targets(
            names[0],
            tuple(ids[i] for i in retained),
            positions[retained],
            rotations[retained],
            joints[retained],
            {name: column[retained] for name, column in conditions.items()},
            tuple(self.lines[i] for i in retained),
            tuple(self.warnings),
        )

    def _joints(self) -> Array:
        stems = {*self.joint_names, *(f"q{j + 1}" for j in range(len(self.joint_names)))}
        columns = [column for column in self.header if column.rsplit("_", 1)[0] in stems or column in stems]
        if not columns:
            return np.full((len(self), len(self.joint_names)), np.nan)
        joints = np.stack([self._joint(j, empty=True) for j in range(len(self.joint_names))], axis=1)
        empty = np.isnan(joints)
        half = empty.any(axis=1) & ~empty.all(axis=1)
        if half.any():
            row = int(half.argmax())
            name = self.joint_names[int(empty[row].argmax())]
            raise self.fail(row, name, "empty beside other joints; give all of them or none")
        self._warn_of_degrees(np.nan_to_num(joints))
        return joints

    def _rotations(self, name: str, positions: Array, meaning: AngleConvention | None) -> Array:
        rest = self._rest([name])
        rotations = np.full((len(positions), 3, 3), np.nan)
        angles = [end for end in ENDS if end.startswith("r")]
        if meaning is not None and not {f"{name}_{end}" for end in angles}.union(angles).intersection(rest):
            raise LabError(
                f"{option_name('orientation')} {meaning}: {self.path} has no angles rx_deg, ry_deg, rz_deg; "
                f"leave it out"
            )
        if not {f"{name}_{end}" for end in ENDS}.union(ENDS).intersection(rest):
            return rotations
        data = measured((), np.empty((len(positions), 0)), (name,), positions[:, None])
        with error_context(self.path):
            quaternions = read_orientations(replace(data, other=rest, lines=tuple(self.lines)), name, meaning)
        oriented = np.isfinite(quaternions).all(axis=1)
        rotations[oriented] = se3.rotation_from_quaternion(quaternions[oriented])
        return rotations


def holds_targets(path: Path, most: Limit = ROWS) -> bool:
    """Check whether a file has positions of a point (columns ending in ``x_mm`` or ``x_m``), not joints alone.

    A plan has such columns, too: while they are empty, it is a file of joint positions.
    """
    table = CsvTable(path, most)
    columns = [name for name in table.header if name in ("x_mm", "x_m") or name.endswith(("_x_mm", "_x_m"))]
    return any(cell for name in columns for cell in table.texts(name) or ())


def read_joints(path: Path, joint_names: Sequence[str], prismatic: Sequence[bool]) -> Measurements:
    """Read a file of joint positions, without the rows of use ``skip``; it may call the joints q1 ... qn."""
    rows = read_measurements(path, joint_names, prismatic, points=False, columns=ObservedColumns())
    return rows[[use != "skip" for use in rows.use]]
