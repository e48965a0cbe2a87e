"""Joint positions from a controller: a row for each pose, or a log over time.

Columns are recognized by the robot's joint names, by q1, J1, A1, joint 1, axis 1 or rax 1 and so on, or by
``actual_q_0`` ... of Universal Robots' real-time data exchange, with angles in radians and ``timestamp`` in seconds
(RTDE guide, "Robot controller outputs"). Joint states of ROS are recognized as ``rostopic echo -p``, bagpy,
PlotJuggler and ``ros2 topic echo --csv`` (which writes no header) export them: numbered positions go to the joints that
the cells of the names state, which are often in alphabetical order; angles are in rad and slides in m (REP 103).
"""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from lab.core.errors import LabError, option_name
from lab.core.se3 import Array
from lab.formats.loose_table import JointColumns, LeftOut, LooseTable, heading_of, read_loose
from lab.formats.time_columns import Clock, ColumnTimes, column_times, stamp_times

__all__ = ["JointLog", "read_joint_log"]

_FORMS = ("q{0}", "q {0}", "j{0}", "j {0}", "a{0}", "a {0}", "joint{0}", "joint {0}", "axis{0}", "axis {0}", "rax {0}",
          "q{0} actual", "actual q{0}", "position {0}")  # fmt: skip
_RTDE = "actual q {0}"  # counted from 0
_NAMES = ("name", "pose", "point", "id", "point name", "pose name", "label", "position name", "no", "nr", "number")
_TIMES = ("time", "timestamp", "time stamp", "date time", "datetime", "date and time", "t")
_DATES = ("date", "day")
_SCALES = {"deg": np.pi / 180, "rad": 1.0}
_LENGTHS = {"mm": 1e-3, "m": 1.0}
_POSITION, _NAME = re.compile(r"(?:.* )?position ?(\d+)"), re.compile(r"(?:.* )?name ?(\d+)")
_BEFORE_NAMES = 3  # seconds, nanoseconds and frame of a joint state without a header
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
    at, states = _joint_columns(table, joint_names, columns)
    given = unit or columns.unit
    scales = [_scale(table, c, slides, given, in_si=states) for c, slides in zip(at, prismatic, strict=True)]
    joints = np.stack([table.numbers(column, empty=False) for column in at], axis=1) * scales
    turning = [j for j, slides in enumerate(prismatic) if not slides]
    if turning:
        stated = any(_stated_unit(table, at[j]) for j in turning)
        _refuse_other_unit(path, joints, turning, {scales[j] == 1.0 for j in turning}, stated)
    name = None if states else table.find("name", _NAMES, columns.name)  # such a column of states names joints
    times = _times(table, columns, bare_states=states and table.headings is None)
    used = {joint: table.name(column) for joint, column in zip(joint_names, at, strict=True)}
    names: tuple[str, ...] = ("",) * len(joints)
    if name is not None:
        used["name"], names = table.name(name), table.texts(name)
    if times.columns:
        used["time"] = times.columns
    return JointLog(
        path,
        names,
        table.lines,
        joints,
        times.seconds,
        times.clock,
        used,
        table.left_out,
    )


def _joint_columns(table: LooseTable, joint_names: tuple[str, ...], columns: JointColumns) -> tuple[list[int], bool]:
    """Return the column of each joint, and whether the table is an export of ROS joint states."""
    map_name, states = option_name("columns"), None
    if columns.joints:
        at = _mapped_joints(table, joint_names, columns)
    elif (states := _joint_states(table, joint_names)) is not None:
        at = states
    elif table.headings is None:
        raise LabError(f"{table.path}: no header names the joints' columns; name them in the {map_name} file")
    else:
        at = [_joint(table, j, name) for j, name in enumerate(joint_names)]
    if len(set(at)) < len(at):
        raise LabError(
            f"{table.path}: one column is assigned to two joints; name a column for each in the {map_name} file"
        )
    return at, states is not None


def _mapped_joints(table: LooseTable, joint_names: tuple[str, ...], columns: JointColumns) -> list[int]:
    if len(columns.joints) != len(joint_names):
        raise LabError(
            f"{table.path}: the {option_name('columns')} file names {len(columns.joints)} joints; the robot has "
            f"{', '.join(joint_names)}"
        )
    return [table.column(each) for each in columns.joints]


def _times(table: LooseTable, columns: JointColumns, *, bare_states: bool) -> ColumnTimes:
    """Return the times of the rows: those of a map of columns, else stamps of messages, else known columns."""
    if not columns.time and (stamps := stamp_times(table, (0, 1) if bare_states else None)) is not None:
        return stamps
    time, day = table.find("time", _TIMES, columns.time), table.find("date", _DATES, columns.date)
    return column_times(table, time, day, columns.dates or "")


def _keys(j: int, name: str) -> tuple[str, ...]:
    return (heading_of(name).key, *(form.format(j + 1) for form in _FORMS))


def _joint_states(table: LooseTable, joint_names: tuple[str, ...]) -> list[int] | None:
    """Return the columns of positions in an export of ROS joint states; None where the table is none."""
    if table.headings is None:
        return _bare_states(table, joint_names)
    keys = [each.key for each in table.headings]
    ends = [[i for i, key in enumerate(keys) for each in _keys(j, name) if f" {key}".endswith(f" {each} position")]
            for j, name in enumerate(joint_names)]  # fmt: skip
    if all(len(each) == 1 for each in ends):
        return [each[0] for each in ends]
    positions = _numbered(keys, _POSITION)
    return _numbered_states(table, joint_names, keys, positions) if 0 in positions else None


def _numbered_states(
    table: LooseTable, joint_names: tuple[str, ...], keys: Sequence[str], positions: dict[int, int]
) -> list[int]:
    """Return the column of each joint, of numbered positions by the names that other columns hold."""
    if named := _numbered(keys, _NAME):
        shared = sorted(set(named) & set(positions))
        cells = _constant(table, [named[k] for k in shared])
        return _by_cells(table, joint_names, cells, [positions[k] for k in shared])
    if "name" in keys:
        cells = re.findall(r"[^\s\[\](),'\"]+", _constant(table, [keys.index("name")])[0])
        if set(range(len(cells))) <= set(positions):
            return _by_cells(table, joint_names, cells, [positions[k] for k in range(len(cells))])
    raise LabError(
        f"{table.path}: its positions are numbered and no column names their joints; export the names as well, or "
        f"name the joints' columns in the {option_name('columns')} file"
    )


def _bare_states(table: LooseTable, joint_names: tuple[str, ...]) -> list[int] | None:
    """Return the columns of positions in joint states without a header: they follow the joints' names."""
    after = table.rows[0][_BEFORE_NAMES:]
    count = next((k for k, cell in enumerate(after) if re.fullmatch(r"[-+0-9.eE]*", cell)), 0)
    if not count or len(after) < 2 * count:
        return None
    names = range(_BEFORE_NAMES, _BEFORE_NAMES + count)
    return _by_cells(table, joint_names, _constant(table, names), [column + count for column in names])


def _numbered(keys: Sequence[str], pattern: re.Pattern[str]) -> dict[int, int]:
    """Return the columns whose keys have a number by a pattern, by this number."""
    return {int(match[1]): i for i, key in enumerate(keys) if (match := pattern.fullmatch(key))}


def _constant(table: LooseTable, columns: Sequence[int]) -> list[str]:
    """Return the names of joints in columns that hold the same in every row."""
    first = [table.rows[0][column] for column in columns]
    for row, line in zip(table.rows, table.lines, strict=True):
        if [row[column] for column in columns] != first:
            raise LabError(
                f"{table.path}: line {line}: joints are named in another order than in line {table.lines[0]}; "
                "export the messages of one publisher"
            )
    return first


def _by_cells(
    table: LooseTable, joint_names: tuple[str, ...], cells: Sequence[str], positions: Sequence[int]
) -> list[int]:
    """Return the column of each joint, by the names in the cells of each column of positions."""
    keys = [heading_of(cell).key for cell in cells]
    columns = []
    for j, name in enumerate(joint_names):
        same = next((keys.index(key) for key in _keys(j, name) if keys.count(key) == 1), None)
        if same is None:
            raise LabError(
                f"{table.path}: no joint is {name} (the file names {', '.join(cells)}); give the right --robot, or "
                f"name the joints' columns in the {option_name('columns')} file"
            )
        columns.append(positions[same])
    return columns


def _joint(table: LooseTable, j: int, name: str) -> int:
    column = table.find(f"joint {name}", (*_keys(j, name), _RTDE.format(j)))
    if column is None:
        raise LabError(
            f"{table.path}: no column is joint {name} ({table.named}); name the joints in the {option_name('columns')} "
            "file"
        )
    return column


def _stated_unit(table: LooseTable, column: int, *, slides: bool = False) -> str:
    """Return the unit that a joint's column states, "" for none; the real-time columns of UR are in rad."""
    in_rad = table.headings is not None and table.headings[column].key.startswith("actual q ") and not slides
    return table.unit(column) or ("rad" if in_rad else "")


def _scale(table: LooseTable, column: int, slides: bool, given: str | None, *, in_si: bool) -> float:
    """Return the factor of a joint's column to rad or m."""
    stated = _stated_unit(table, column, slides=slides)
    if in_si and not stated:
        stated = "m" if slides else given or "rad"
    where = f"{table.path}: column {table.name(column)}"
    if not slides:
        return _angle_scale(where, stated, given)
    if stated not in _LENGTHS:
        raise LabError(f"{where}: the joint slides, and no unit of lengths is stated; call the column ..._mm or ..._m")
    return _LENGTHS[stated]


def _angle_scale(where: str, stated: str, given: str | None) -> float:
    option = option_name("joint_unit")
    if stated and given and stated != given:
        raise LabError(f"{where}: the file states {stated}; leave out {option} {given}")
    unit = stated or given
    if not unit:
        raise LabError(f"{where}: its unit is not stated; give {option} deg or {option} rad")
    if unit not in _SCALES:
        raise LabError(f"{where}: {unit} is not a unit of angle; use deg or rad")
    return float(_SCALES[unit])


def _refuse_other_unit(path: Path, joints: Array, turning: list[int], in_radians: set[bool], stated: bool) -> None:
    """Refuse angles whose sizes are those of the other unit; a unit that the file states is corrected there.

    Args:
        turning: the revolute joints.
        in_radians: whether they were read as radians.
        stated: whether the header states the unit of one.
    """
    largest = float(np.abs(joints[:, turning]).max())
    in_degrees = np.rad2deg(largest)
    if in_radians == {True} and largest > _FULL_TURNS * 2 * np.pi:
        what, unit = f"joints reach {largest:.4g} rad, which are degrees", "deg"
    elif in_radians == {False} and len(joints) > 2 and in_degrees < 2 * np.pi and np.ptp(joints, axis=0).max():
        what, unit = f"no joint turns by more than {in_degrees:.3g}°; they are in radians", "rad"
    else:
        return
    remedy = (
        f"correct the unit in the header of the joints' columns to {unit}"
        if stated
        else f"give {option_name('joint_unit')} {unit}"
    )
    raise LabError(f"{path}: {what}; {remedy}")
