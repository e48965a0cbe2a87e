"""Joint positions from a controller: a row for each pose, or a log over time.

Columns are recognized by the robot's joint names, by q1, J1, A1, joint 1, axis 1 or rax 1 and so on, or by
``actual_q_0`` ... of Universal Robots' real-time data exchange, with angles in radians and ``timestamp`` in seconds
(RTDE guide, "Robot controller outputs").
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from lab.core.errors import LabError, option_name
from lab.core.se3 import Array
from lab.formats.loose_table import JointColumns, LeftOut, LooseTable, column_named, heading_of, read_loose
from lab.formats.tracker_export import Clock, column_times

__all__ = ["JointLog", "read_joint_log"]

_FORMS = ("q{0}", "q {0}", "j{0}", "j {0}", "a{0}", "a {0}", "joint{0}", "joint {0}", "axis{0}", "axis {0}", "rax {0}",
          "q{0} actual", "actual q{0}", "position {0}")  # fmt: skip
_RTDE = "actual q {0}"  # counted from 0
_NAMES = ("name", "pose", "point", "id", "point name", "pose name", "label", "position name", "no", "nr", "number")
_TIMES = ("time", "timestamp", "time stamp", "date time", "datetime", "date and time", "t")
_DATES = ("date", "day")
_SCALES = {"deg": np.pi / 180, "rad": 1.0}
_LENGTHS = {"mm": 1e-3, "m": 1.0}
_FULL_TURNS = 2.0  # larger angles in rad are degrees


@dataclass(frozen=True)
class JointLog:
    """Joint positions of a controller's file.

    Attributes:
        names: of the rows, or "".
        lines: of the rows in the file.
        joints: ``(n, joints)`` rad, m of a slide.
        seconds: ``(n,)`` s, time of each row, or NaN.
        clock: origin of the times.
        used: columns by meaning.
        left_out: unused parts of the file.
    """

    path: Path
    names: tuple[str, ...]
    lines: tuple[int, ...]
    joints: Array
    seconds: Array
    clock: Clock
    used: dict[str, str]
    left_out: tuple[LeftOut, ...]


def read_joint_log(
    path: Path, joint_names: tuple[str, ...], prismatic: tuple[bool, ...], columns: JointColumns, unit: str | None
) -> JointLog:
    """Read the joint positions of a controller's file.

    Args:
        columns: map of its columns.
        unit: of revolute joints, deg or rad, if the file does not state it.
    """
    table = read_loose(path, len(joint_names))
    if table.headings is None and not columns.joints:
        raise LabError(f"{path}: no header names the joints' columns; name them in the {option_name('columns')} file")
    if columns.joints and len(columns.joints) != len(joint_names):
        raise LabError(
            f"{path}: the {option_name('columns')} file names {len(columns.joints)} joints; the robot has "
            f"{', '.join(joint_names)}"
        )
    at = (
        [column_named(table, each) for each in columns.joints]
        if columns.joints
        else [_joint(table, j, name) for j, name in enumerate(joint_names)]
    )
    if len(set(at)) < len(at):
        raise LabError(
            f"{path}: one column is assigned to two joints; name a column for each in the {option_name('columns')} file"
        )
    scales = [_scale(table, c, slides, unit or columns.unit) for c, slides in zip(at, prismatic, strict=True)]
    joints = np.stack(
        [scale * table.numbers(column, empty=False) for column, scale in zip(at, scales, strict=True)], axis=1
    )
    _refuse_other_unit(path, joints, prismatic, scales)
    name = _other(table, columns.name, _NAMES)
    time, day = _other(table, columns.time, _TIMES), _other(table, columns.date, _DATES)
    time, day = (time, day) if time is not None else (day, None)
    found = column_times(table, time, day, columns.dates or "") if time is not None else None
    used = {joint: table.name(column) for joint, column in zip(joint_names, at, strict=True)}
    used |= {what: table.name(column) for what, column in (("name", name), ("time", time)) if column is not None}
    return JointLog(
        path,
        table.texts(name) if name is not None else ("",) * len(joints),
        table.lines,
        joints,
        np.full(len(joints), np.nan) if found is None else found.seconds,
        "seconds" if found is None else found.clock,
        used,
        table.left_out,
    )


def _joint(table: LooseTable, j: int, name: str) -> int:
    keys = (heading_of(name).key, *(form.format(j + 1) for form in _FORMS), _RTDE.format(j))
    headings = table.headings or ()
    for key in keys:
        same = [i for i, each in enumerate(headings) if each.key == key]
        if len(same) > 1:
            raise LabError(
                f"{table.path}: {len(same)} columns may be joint {name} ({key}); name one by {option_name('columns')}"
            )
        if same:
            return same[0]
    known = ", ".join(each.text for each in headings if each.text)
    raise LabError(
        f"{table.path}: no column is joint {name} ({known}); name the joints in the {option_name('columns')} file"
    )


def _other(table: LooseTable, given: str, known: tuple[str, ...]) -> int | None:
    if given:
        return column_named(table, given)
    headings = table.headings or ()
    return next((i for key in known for i, each in enumerate(headings) if each.key == key), None)


def _scale(table: LooseTable, column: int, slides: bool, given: str | None) -> float:
    heading = table.headings[column] if table.headings is not None else None
    stated = heading.unit if heading is not None else ""
    if heading is not None and heading.key.startswith("actual q ") and not slides:
        stated = stated or "rad"
    where = f"{table.path}: column {table.name(column)}"
    if slides:
        if stated not in _LENGTHS:
            raise LabError(
                f"{where}: the joint slides, and no unit of lengths is stated; call the column ..._mm or ..._m"
            )
        return _LENGTHS[stated]
    if stated and given and stated != given:
        raise LabError(f"{where}: the file states {stated}; leave out {option_name('joint_unit')} {given}")
    unit = stated or given
    if not unit:
        raise LabError(
            f"{where}: its unit is not stated; give {option_name('joint_unit')} deg or {option_name('joint_unit')} rad"
        )
    if unit not in _SCALES:
        raise LabError(f"{where}: {unit} is not a unit of angle; use deg or rad")
    return float(_SCALES[unit])


def _refuse_other_unit(path: Path, joints: Array, prismatic: tuple[bool, ...], scales: list[float]) -> None:
    turning = [j for j, slides in enumerate(prismatic) if not slides]
    if not turning:
        return
    largest = float(np.abs(joints[:, turning]).max())
    used_scales = [scales[j] for j in turning]
    if all(scale == 1.0 for scale in used_scales) and largest > _FULL_TURNS * 2 * np.pi:
        raise LabError(
            f"{path}: joints reach {largest:.4g} rad, which are degrees; give {option_name('joint_unit')} deg"
        )
    in_degrees = np.rad2deg(largest)
    if (
        all(scale != 1.0 for scale in used_scales)
        and len(joints) > 2
        and in_degrees < 2 * np.pi
        and np.ptp(joints, axis=0).max()
    ):
        raise LabError(
            f"{path}: no joint turns by more than {in_degrees:.3g}°; they are in radians; give "
            f"{option_name('joint_unit')} rad"
        )
