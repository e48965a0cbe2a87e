"""A robot's cell in TOML: obstacles, tool, joint ranges, and poses of the instrument.

Lengths are in mm, angles in degrees. Poses are in the cell's frame: that of the robot's model, unless ``[robot]``
places the robot. A rotation is roll, pitch and yaw about the fixed axes x, y and z, as in a URDF.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields, is_dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np

from lab.core import se3
from lab.core.errors import LabError
from lab.core.limits import DISTANCE_MM, REFLECTOR_DEG, checked_name
from lab.core.se3 import Array
from lab.core.units import MM, joints_to_si
from lab.formats.structured import read_toml, refuse_unbounded, structured
from lab.kinematics.joints import JointSpec

__all__ = ["Cell", "Obstacle", "Place", "ToolPoint", "read_cell"]

_Triple = tuple[float, ...]
# Largest incidence angles, representative: hollow corner cubes 30 degrees, cat's eyes 60 to 75.
_ACCEPTANCE_DEG = {"corner cube": 30.0, "cat's eye": 75.0}
_SIZES = {"box": ("size_mm",), "cylinder": ("radius_mm", "height_mm"), "mesh": ("file",)}
_UNITS = {"mm": 1e-3, "m": 1.0}


@dataclass(frozen=True, kw_only=True)
class Place:
    """Position and rotation of an object."""

    position_mm: _Triple = (0.0, 0.0, 0.0)
    rotation_deg: _Triple = (0.0, 0.0, 0.0)

    def __post_init__(self) -> None:
        for name in ("position_mm", "rotation_deg"):
            if len(getattr(self, name)) != 3:
                raise LabError(f"{name} is {list(getattr(self, name))}: give three numbers, [x, y, z]")
        if any(abs(length) not in DISTANCE_MM for length in self.position_mm):
            raise LabError(f"position_mm is {list(self.position_mm)}: farther than a kilometre; give it in mm")

    @property
    def pose(self) -> Array:
        """Pose ``(4, 4)`` (m)."""
        rotation = se3.rotation_from_roll_pitch_yaw(np.deg2rad(self.rotation_deg))
        return se3.pose(rotation, MM.to_si(np.array(self.position_mm)))


@dataclass(frozen=True, kw_only=True)
class Obstacle(Place):
    """A solid in the cell, or on the flange, with its pose in the robot's last frame.

    A box has edges ``size_mm``, a cylinder (along z) ``radius_mm`` and ``height_mm``, both about their middle; a mesh
    the ``file`` of an STL or OBJ in ``unit``, of which the convex hull is used.
    """

    name: str
    shape: Literal["box", "cylinder", "mesh"]
    size_mm: _Triple = ()
    radius_mm: float = 0.0
    height_mm: float = 0.0
    file: Path = Path()
    unit: Literal["mm", "m"] = "mm"
    clearance_mm: float | None = None

    def __post_init__(self) -> None:
        super().__post_init__()
        where = f"{self.shape} '{self.name}'"
        allowed = _SIZES[self.shape]
        for each in ("size_mm", "radius_mm", "height_mm", "file"):
            given = getattr(self, each) != type(self).__dataclass_fields__[each].default
            if given != (each in allowed):
                what = "not of this shape" if given else "missing"
                raise LabError(f"{where}: {each} is {what}; it has {_list(allowed)}")
        if self.shape == "box" and len(self.size_mm) != 3:
            raise LabError(f"{where}: size_mm is {list(self.size_mm)}; give the lengths of three edges")
        lengths = {"box": self.size_mm, "cylinder": (self.radius_mm, self.height_mm), "mesh": ()}[self.shape]
        if any(not length > 0 for length in lengths):
            raise LabError(f"{where}: a length is not above zero")
        if self.clearance_mm is not None and self.clearance_mm < 0:
            raise LabError(f"{where}: clearance_mm is {self.clearance_mm:g}; give zero or more")

    @property
    def scale(self) -> float:
        """Metres per unit of the mesh."""
        return _UNITS[self.unit]


@dataclass(frozen=True, kw_only=True)
class ToolPoint:
    """A measured point of the tool, in the robot's last frame, and the axis of its reflector."""

    name: str
    position_mm: _Triple
    axis: _Triple = (0.0, 0.0, 1.0)

    def __post_init__(self) -> None:
        for name in ("position_mm", "axis"):
            if len(getattr(self, name)) != 3:
                raise LabError(f"{name} of tool point '{self.name}' is {list(getattr(self, name))}: give three numbers")
        if not np.linalg.norm(self.axis) > 0:
            raise LabError(f"axis of tool point '{self.name}' is zero: give its reflector's direction")

    @property
    def position(self) -> Array:
        """Position ``(3,)`` m."""
        return MM.to_si(np.array(self.position_mm))

    @property
    def rotation(self) -> Array:
        """Rotation ``(3, 3)`` with the reflector's axis as z."""
        return se3.rotation_between(np.array([0.0, 0.0, 1.0]), np.array(self.axis) / np.linalg.norm(self.axis))


@dataclass(frozen=True, kw_only=True)
class _Station(Place):
    """Station of the instrument, with its name."""

    name: str

    def __post_init__(self) -> None:
        super().__post_init__()
        checked_name("[[station]]", self.name)


@dataclass(frozen=True, kw_only=True)
class _CellReflector:
    """Reflector on the tool: its kind, or its largest incidence angle."""

    kind: Literal["corner cube", "cat's eye", "other"] = "corner cube"
    acceptance_deg: float | None = None

    def __post_init__(self) -> None:
        if (self.kind == "other") != (self.acceptance_deg is not None):
            raise LabError('acceptance_deg goes with kind = "other", and only with that')
        if self.degrees not in REFLECTOR_DEG:
            raise LabError(f"acceptance_deg is {self.degrees:g}: give an angle above 0 and up to 180")

    @property
    def degrees(self) -> float:
        return _ACCEPTANCE_DEG[self.kind] if self.acceptance_deg is None else self.acceptance_deg


@dataclass(frozen=True, kw_only=True)
class _JointRange:
    """Narrower limits of a joint, and the range of its cables from home."""

    lower_deg: float | None = None
    upper_deg: float | None = None
    lower_mm: float | None = None
    upper_mm: float | None = None
    cable_deg: float | None = None

    def limits(self, slides: bool, lower: float, upper: float, home: float) -> tuple[float, float]:
        scale, wrong = (1e-3, "deg") if slides else (np.pi / 180, "mm")
        if any(getattr(self, each) is not None for each in (f"lower_{wrong}", f"upper_{wrong}")) or (
            slides and self.cable_deg is not None
        ):
            raise LabError(f"is {'a slide: its limits are in mm' if slides else 'revolute: its limits are in deg'}")
        low, high = (self.lower_mm, self.upper_mm) if slides else (self.lower_deg, self.upper_deg)
        lower = lower if low is None else max(lower, low * scale)
        upper = upper if high is None else min(upper, high * scale)
        if self.cable_deg is not None:
            lower, upper = max(lower, home - self.cable_deg * scale), min(upper, home + self.cable_deg * scale)
        if not lower < upper:
            raise LabError(f"has an empty range, from {lower / scale:g} to {upper / scale:g}")
        return lower, upper


@dataclass(frozen=True, kw_only=True)
class Cell:
    """A robot's cell.

    Attributes:
        clearance_mm: default clearance of obstacles; None for that of a plan.
        robot: pose of the robot's model in the cell.
        instrument: pose of the tracker or camera; by default that of the robot's model.
        station: poses of the instrument in order, instead of ``instrument``.
        reflector: None for that of the instrument.
        tool: measured points; by default those of the robot.
        plate: solids on the flange, in the robot's last frame.
        obstacle: solids in the cell.
        joints: narrower limits, by joint name.
        home: joint positions ``<joint>_deg`` or ``_mm``, all or none.
    """

    path: Path
    name: str = ""
    clearance_mm: float | None = None
    robot: Place = field(default_factory=Place)
    instrument: Place | None = None
    station: tuple[_Station, ...] = ()
    reflector: _CellReflector | None = None
    tool: tuple[ToolPoint, ...] = ()
    plate: tuple[Obstacle, ...] = ()
    obstacle: tuple[Obstacle, ...] = ()
    joints: Mapping[str, _JointRange] = field(default_factory=dict)
    home: Mapping[str, float] = field(default_factory=dict)

    @property
    def instrument_places(self) -> tuple[Place, ...]:
        """Return the instrument's poses: its stations, or one pose without a name; empty if the cell gives none."""
        return self.station or (() if self.instrument is None else (self.instrument,))

    def clearance_m(self, obstacle: Obstacle) -> float | None:
        """Return the clearance (m) to keep from an obstacle; None if neither it nor the cell states one."""
        stated = self.clearance_mm if obstacle.clearance_mm is None else obstacle.clearance_mm
        return None if stated is None else MM.to_si(stated)

    def joint_spec_values(self, joints: JointSpec) -> tuple[Array, Array, Array | None]:
        """Return lower and upper limits and home ``(n,)`` (rad or m; None if not given) of a robot in this cell."""
        for name in self.joints:
            if name not in joints.joint_names:
                raise LabError(f"{self.path}: [joints.{name}]: the robot has {_list(joints.joint_names)}")
        home = self._home(joints)
        start = joints.home if home is None else home
        lower, upper = joints.lower.copy(), joints.upper.copy()
        for i, name in enumerate(joints.joint_names):
            try:
                limits = self.joints.get(name, _JointRange()).limits(joints.prismatic[i], lower[i], upper[i], start[i])
            except LabError as error:
                raise LabError(f"{self.path}: joint {name} {error}") from None
            lower[i], upper[i] = limits
        return lower, upper, home

    def _home(self, joints: JointSpec) -> Array | None:
        if not self.home:
            return None
        keys = joints.column_names
        if set(self.home) != set(keys):
            raise LabError(f"{self.path}: [home] has {_list(self.home)}; give {_list(keys)}")
        return joints_to_si(np.array([self.home[key] for key in keys]), joints.prismatic)


def read_cell(path: Path) -> Cell:
    """Read a cell file."""
    content = read_toml(path)
    refuse_unbounded(path, content)
    if strange := next((each for each in content if each not in _options()), None):
        raise LabError(f"{path}: '{strange}' is not an option of a cell; valid are {_list(_options())}")
    cell = structured(path, Cell, {**content, "path": path})
    if cell.clearance_mm is not None and cell.clearance_mm < 0:
        raise LabError(f"{path}: clearance_mm is {cell.clearance_mm:g}; give zero or more")
    if cell.station and cell.instrument is not None:
        raise LabError(f"{path}: [instrument] and [[station]] both set the instrument's pose; keep one of them")
    for what, named in (("tool", cell.tool), ("obstacle", (*cell.obstacle, *cell.plate)), ("station", cell.station)):
        _refuse_names(f"{path}: {what}", [each.name for each in named])
    return cell


def _refuse_names(where: str, names: Sequence[str]) -> None:
    """Refuse empty and doubled names."""
    for i, name in enumerate(names):
        if not name or name in names[:i]:
            wrong = "taken" if name else "empty"
            raise LabError(f"{where} {i + 1}: its name '{name}' is {wrong}; give another")


def _options() -> Sequence[str]:
    assert is_dataclass(Cell)
    return [each.name for each in fields(Cell) if each.name != "path"]


def _list(names: Sequence[str] | Mapping[str, Any]) -> str:
    return ", ".join(names)
