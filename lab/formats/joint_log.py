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
from lab.formats.loose_table import JointColumns, LeftOut, LooseTable, column_named, heading_of, read_loose
from lab.formats.tracker_export import Clock, column_times, stamp_times

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
    stated = None if columns.joints else _joint_states(table, joint_names)
    if table.headings is None and not columns.joints and stated is None:
        raise LabError(f"{path}: no header names the joints' columns; name them in the {option_name('columns')} file")
    if columns.joints and len(columns.joints) != len(joint_names):
        raise LabError(
            f"{path}: the {option_name('columns')} file names {len(columns.joints)} joints; the robot has "
            f"{', '.join(joint_names)}"
        )
    at = (
        [column_named(table, each) for each in columns.joints]
        if columns.joints
        else stated or [_joint(table, j, name) for j, name in enumerate(joint_names)]
    )
    if len(set(at)) < len(at):
        raise LabError(
            f"{path}: one column is assigned to two joints; name a column for each in the {option_name('columns')} file"
        )
    scales = [
        _scale(table, c, slides, unit or columns.unit, in_si=stated is not None)
        for c, slides in zip(at, prismatic, strict=True)
    ]
    joints = np.stack(
        [scale * table.numbers(column, empty=False) for column, scale in zip(at, scales, strict=True)], axis=1
    )
    _refuse_other_unit(path, joints, prismatic, scales, [_stated_unit(table, column) for column in at])
    name = _other(table, columns.name, _NAMES)
    time, day = _other(table, columns.time, _TIMES), _other(table, columns.date, _DATES)
    time, day = (time, day) if time is not None else (day, None)
    found = column_times(table, time, day, columns.dates or "") if time is not None else None
    time_from = "" if time is None else table.name(time)
    stamp = (0, 1) if stated is not None and table.headings is None else None
    if not columns.time and (stamps := stamp_times(table, stamp)) is not None:
        found, time_from = stamps
    if stated is not None:
        name = None  # a column called name holds those of joints
    used = {joint: table.name(column) for joint, column in zip(joint_names, at, strict=True)}
    used |= {what: column for what, column in (("name", _called(table, name)), ("time", time_from)) if column}
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


def _called(table: LooseTable, column: int | None) -> str:
    return "" if column is None else table.name(column)


def _keys(j: int, name: str) -> tuple[str, ...]:
    return (heading_of(name).key, *(form.format(j + 1) for form in _FORMS))


def _joint_states(table: LooseTable, joint_names: tuple[str, ...]) -> list[int] | None:
    """Return the columns of positions in an export of ROS joint states; None where the table is none."""
    if table.headings is None:
        after = table.rows[0][_BEFORE_NAMES:]
        count = next((k for k, cell in enumerate(after) if re.fullmatch(r"[-+0-9.eE]*", cell)), 0)
        if not count or len(after) < 2 * count:
            return None
        names = range(_BEFORE_NAMES, _BEFORE_NAMES + count)
        return _by_cells(table, joint_names, _constant(table, names), [column + count for column in names])
    keys = [each.key for each in table.headings]
    ends = [[i for i, key in enumerate(keys) for each in _keys(j, name) if f" {key}".endswith(f" {each} position")]
            for j, name in enumerate(joint_names)]  # fmt: skip
    if all(len(each) == 1 for each in ends):
        return [each[0] for each in ends]
    positions = {int(match[1]): i for i, key in enumerate(keys) if (match := _POSITION.fullmatch(key))}
    if 0 not in positions:
        return None
    named = {int(match[1]): i for i, key in enumerate(keys) if (match := _NAME.fullmatch(key))}
    if named:
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
    found = []
    for j, name in enumerate(joint_names):
        same = next((keys.index(key) for key in _keys(j, name) if keys.count(key) == 1), None)
        if same is None:
            raise LabError(
                f"{table.path}: no joint is {name} (the file names {', '.join(cells)}); give the right --robot, or "
                f"name the joints' columns in the {option_name('columns')} file"
            )
        found.append(positions[same])
    return found


def _joint(table: LooseTable, j: int, name: str) -> int:
    keys = (*_keys(j, name), _RTDE.format(j))
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


def _stated_unit(table: LooseTable, column: int, *, slides: bool = False) -> str:
    """Return the unit that a joint's column states, "" for none; the real-time columns of UR are in rad."""
    if table.headings is None:
        return ""
    heading = table.headings[column]
    return heading.unit or ("rad" if heading.key.startswith("actual q ") and not slides else "")


def _scale(table: LooseTable, column: int, slides: bool, given: str | None, *, in_si: bool) -> float:
    stated = _stated_unit(table, column, slides=slides)
    where = f"{table.path}: column {table.name(column)}"
    if in_si and not stated:
        stated = "m" if slides else given or "rad"
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


def _refuse_other_unit(
    path: Path, joints: Array, prismatic: tuple[bool, ...], scales: list[float], stated: list[str]
) -> None:
    """Refuse angles whose sizes are those of the other unit; a unit that the file states is corrected there."""
    turning = [j for j, slides in enumerate(prismatic) if not slides]
    if not turning:
        return
    largest = float(np.abs(joints[:, turning]).max())
    used_scales = [scales[j] for j in turning]
    if all(scale == 1.0 for scale in used_scales) and largest > _FULL_TURNS * 2 * np.pi:
        raise LabError(f"{path}: joints reach {largest:.4g} rad, which are degrees; {_correct(stated, turning, 'deg')}")
    in_degrees = np.rad2deg(largest)
    if (
        all(scale != 1.0 for scale in used_scales)
        and len(joints) > 2
        and in_degrees < 2 * np.pi
        and np.ptp(joints, axis=0).max()
    ):
        raise LabError(
            f"{path}: no joint turns by more than {in_degrees:.3g}°; they are in radians; "
            f"{_correct(stated, turning, 'rad')}"
        )


def _correct(stated: list[str], turning: list[int], unit: str) -> str:
    """Advise how to give the unit of the joints: in the header where it states one, else as an option."""
    if any(stated[j] for j in turning):
        return f"correct the unit in the header of the joints' columns to {unit}"
    return f"give {option_name('joint_unit')} {unit}"
