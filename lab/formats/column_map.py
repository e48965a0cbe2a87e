"""Which columns of an instrument's and a controller's files mean what, where their names do not say: a TOML file."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

from lab.core.errors import LabError
from lab.formats.loose_table import LooseTable, heading_of
from lab.formats.structured import structured
from lab.formats.toml import read_toml

__all__ = ["ColumnMap", "JointColumns", "PointColumns", "column_named", "read_column_map"]

Dates = Literal["dmy", "mdy"] | None


@dataclass(frozen=True)
class PointColumns:
    """Columns of the instrument's file, each by its name or by its number as a text; "" for those that are found.

    Attributes:
        name: of the point.
        target: which of the tool's points it is, where poses have several.
        x, y, z: its coordinates.
        unit: of the coordinates and their uncertainties.
        sigma: uncertainties along x, y and z, or one of the whole position.
        time: when it was measured; a date may stand in a column of its own.
        dates: whether dates begin with the day or the month.
    """

    name: str = ""
    target: str = ""
    x: str = ""
    y: str = ""
    z: str = ""
    unit: Literal["mm", "m", "in", "um"] | None = None
    sigma: tuple[str, ...] = ()
    time: str = ""
    date: str = ""
    dates: Dates = None
    temperature: str = ""
    pressure: str = ""
    humidity: str = ""


@dataclass(frozen=True)
class JointColumns:
    """Columns of the controller's file.

    Attributes:
        name: of the pose.
        time: when the row was written; a date may stand in a column of its own.
        joints: the columns of the joints, in the robot's order.
        unit: of the joints that turn.
    """

    name: str = ""
    time: str = ""
    date: str = ""
    dates: Dates = None
    joints: tuple[str, ...] = ()
    unit: Literal["deg", "rad"] | None = None


@dataclass(frozen=True)
class ColumnMap:
    """What columns mean, in both files."""

    points: PointColumns = field(default_factory=PointColumns)
    joints: JointColumns = field(default_factory=JointColumns)


def read_column_map(path: Path | None) -> ColumnMap:
    """Read a map of columns; an empty one without a file.

    Raises:
        LabError: it cannot be read, or says what no column can be.
    """
    if path is None:
        return ColumnMap()
    found = structured(path, ColumnMap, read_toml(path))
    if len(found.points.sigma) not in (0, 1, 3):
        raise LabError(f"{path}: points.sigma has {len(found.points.sigma)} columns; give those of x, y and z, or one")
    given = [each for each in (found.points.x, found.points.y, found.points.z) if each]
    if len(given) not in (0, 3):
        raise LabError(f"{path}: points has some of x, y and z; give all three or none")
    return found


def column_named(table: LooseTable, wanted: str) -> int:
    """The column that a map names, by its header or its number from 1.

    Raises:
        LabError: there is none, or several are called so.
    """
    headings = table.headings or ()
    same = [i for i, each in enumerate(headings) if each.text == wanted]
    same = same or [i for i, each in enumerate(headings) if each.key == heading_of(wanted).key]
    if len(same) == 1:
        return same[0]
    if same:
        raise LabError(f"{table.path}: {len(same)} columns are called '{wanted}'; give the number of the right one")
    if wanted.isdecimal() and 1 <= int(wanted) <= table.width:
        return int(wanted) - 1
    known = ", ".join(each.text for each in headings if each.text) or "none has a name"
    raise LabError(f"{table.path}: no column '{wanted}' ({known}); give a name, or a number from 1 to {table.width}")
