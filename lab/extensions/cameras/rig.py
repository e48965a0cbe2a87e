"""Describe cameras and boards, and read them from TOML.

A camera or a board is fixed in the world, or to the frame of a tip of the arm, which is named by a target of that tip.
Places in a picture are kept in thousands of pixels, so that a pixel has the size of a millimetre in all that weighs
them: the limits and tolerances of lengths then serve places too.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any, Final, Literal

import numpy as np
from numpy.typing import NDArray

from lab.core import se3
from lab.core.errors import LabError
from lab.core.limits import CORNERS, FIXTURES, LENGTH_M, OPTION_SIZE, checked_name
from lab.core.se3 import Array
from lab.core.units import MM, Unit
from lab.extensions.cameras.geometry import INTRINSICS
from lab.formats.structured import read_toml, structured
from lab.kinematics.tree import first_of_tips, tip_of
from lab.sensors.size import PRINTED, checked_size_u

__all__ = ["HAND", "KINDS", "PX", "WORLD", "Board", "BoardKind", "Camera", "Rig", "Simulated", "read_rig", "usual_rig"]

PX: Final = Unit("kpx", "px", 1e3)
WORLD, HAND = "world", "hand"
BoardKind = Literal["checkerboard", "charuco", "apriltag", "points"]
KINDS: Final = ("checkerboard", "charuco", "apriltag", "points")
_LEAST_CORNERS = 4  # that place a board
_PRIOR_PX, _PRIOR_DISTORTION = 10.0, 0.05
_SIZE_PX = 100_000.0
_DISTORTION = 10.0


@dataclass(frozen=True, kw_only=True)
class Simulated:
    """Camera and scene of a simulation, beside the geometry.

    Attributes:
        noise_px: noise of a corner in focus, each coordinate (1 sigma).
        focus_mm: distance of best focus; None for a lens that is sharp everywhere.
        blur_px: diameter of the blur of a point at twice that distance; twice as large infinitely far away.
        incidence_deg: largest angle between the board's normal and the line of sight.
        missed: share of the visible corners that the detector misses.
        wrong: share of the corners that it places wrongly, by ``wrong_px``.
        wrong_px: largest error of a wrong corner, uniform.
        corners: number of corners that a picture needs to count.
        nearest_mm, farthest_mm: distances of the board's middle at which poses are drawn.
    """

    noise_px: float = 0.1
    focus_mm: float | None = None
    blur_px: float = 2.0
    incidence_deg: float = 60.0
    missed: float = 0.0
    wrong: float = 0.0
    wrong_px: float = 5.0
    corners: int = 6
    nearest_mm: float = 200.0
    farthest_mm: float = 900.0

    def __post_init__(self) -> None:
        for name in ("noise_px", "blur_px", "wrong_px"):
            if getattr(self, name) not in OPTION_SIZE:
                raise LabError(f"{name} is {getattr(self, name):g}; give a number from 0 to {OPTION_SIZE.most:g}")
        if self.focus_mm is not None and not 0 < self.focus_mm <= MM.of(LENGTH_M.most):
            raise LabError(f"focus_mm is {self.focus_mm:g}; give a distance above 0, or leave it out")
        if not 0 < self.incidence_deg < 90:
            raise LabError(f"incidence_deg is {self.incidence_deg:g}; give an angle above 0, below 90")
        if not (0 <= self.missed < 1 and 0 <= self.wrong < 1):
            raise LabError("missed and wrong are shares; give numbers from 0, below 1")
        if not 0 < self.nearest_mm < self.farthest_mm <= MM.of(LENGTH_M.most):
            raise LabError("nearest_mm, farthest_mm: give distances above 0, the nearest below the farthest")
        if self.corners < _LEAST_CORNERS:
            raise LabError(f"corners is {self.corners}; a board's pose needs at least {_LEAST_CORNERS}")


@dataclass(frozen=True, kw_only=True)
class Camera:
    """Pinhole camera with Brown's distortion.

    Attributes:
        name: as in the column ``camera``.
        size_px: width and height.
        focal_px: focal lengths fx, fy.
        centre_px: cx, cy; the middle of the first pixel is (0, 0).
        distortion: k1, k2, p1, p2, k3.
        fixed_to: ``world``, ``hand``, or a target of the tip that carries it.
        intrinsics: whether they are given, identified, or identified with a prior at the given values.
        prior_px: standard deviation of the prior of focal lengths and centre.
        prior_distortion: that of the five coefficients of distortion.
        position_mm, rotation_deg: nominal place in what it is fixed to (of ``world``: in the robot's frame 0), for
            simulation and planning alone; position and rotation vector. Drawn where not given.
    """

    name: str = "camera"
    size_px: tuple[int, ...] = (1280, 960)
    focal_px: tuple[float, ...] = (1200.0, 1200.0)
    centre_px: tuple[float, ...] = (639.5, 479.5)
    distortion: tuple[float, ...] = (0.0, 0.0, 0.0, 0.0, 0.0)
    fixed_to: str = HAND
    intrinsics: Literal["fixed", "free", "prior"] = "fixed"
    prior_px: float = _PRIOR_PX
    prior_distortion: float = _PRIOR_DISTORTION
    position_mm: tuple[float, ...] | None = None
    rotation_deg: tuple[float, ...] | None = None

    def __post_init__(self) -> None:
        checked_name("camera", self.name)
        for key, count in (("size_px", 2), ("focal_px", 2), ("centre_px", 2), ("distortion", 5)):
            _refuse_count(key, getattr(self, key), count)
        if not all(0 < value <= _SIZE_PX for value in (*self.size_px, *self.focal_px)):
            raise LabError(f"size_px and focal_px: give numbers above 0, up to {_SIZE_PX:,.0f}")
        if not all(abs(value) <= _SIZE_PX for value in self.centre_px):
            raise LabError(f"centre_px: give numbers of at most {_SIZE_PX:,.0f}")
        if not all(abs(value) <= _DISTORTION for value in self.distortion):
            raise LabError(f"distortion: give k1, k2, p1, p2, k3 of at most {_DISTORTION:g}")
        if not (0 < self.prior_px <= _SIZE_PX and 0 < self.prior_distortion <= _DISTORTION):
            raise LabError("prior_px and prior_distortion: give standard deviations above 0")
        _placed("camera", self.position_mm, self.rotation_deg)

    @property
    def intrinsic_values(self) -> Array:
        """``(9,)`` in the order of ``INTRINSICS``: thousands of pixels, and the distortion."""
        return np.array([*PX.to_si(np.array([*self.focal_px, *self.centre_px])), *self.distortion])

    @property
    def prior_sigma(self) -> Array:
        """``(9,)`` standard deviations of the prior, in the order of ``INTRINSICS``."""
        lengths = len(INTRINSICS) - 5
        return np.array([PX.to_si(self.prior_px)] * lengths + [self.prior_distortion] * 5)

    @property
    def T_mount(self) -> Array | None:
        """Nominal pose ``(4, 4)`` (m) in what it is fixed to; None where not given."""
        return _pose(self.position_mm, self.rotation_deg)

    def sees(self, places: Array) -> NDArray[np.bool_]:
        """Return ``(n,)``: whether places ``(n, 2)`` (thousands of pixels) lie in the picture."""
        px = PX.of(places)
        with np.errstate(invalid="ignore"):
            return np.asarray(((px > -0.5) & (px < np.array(self.size_px) - 0.5)).all(axis=1))


@dataclass(frozen=True, kw_only=True)
class Board:
    """Board of corners with known places.

    Attributes:
        name: as in the column ``board``.
        kind: ``checkerboard`` and ``charuco``: inner corners, numbered row by row from 0; ``apriltag``: a grid of tags,
            whose corner c of tag t has the number 4 t + c, clockwise from the tag's top left; ``points``: any.
        columns, rows: numbers of inner corners, or of tags.
        square_mm: side of a square.
        tag_mm, gap_mm: side of a tag, and distance between tags.
        marker_mm, dictionary: of a ChArUco board's markers, for detection alone.
        points_mm: of ``points``, three numbers each.
        fixed_to: ``world``, ``hand``, or a target of the tip that carries it.
        size_u_percent: standard uncertainty of its size; 0 where it is exact, infinite where nothing is known. Where
            nothing is stated, 0.5 as of a printed board.
        position_mm, rotation_deg: as for ``Camera``.
    """

    name: str = "board"
    kind: BoardKind = "checkerboard"
    columns: int = 9
    rows: int = 6
    square_mm: float = 20.0
    tag_mm: float = 30.0
    gap_mm: float = 10.0
    marker_mm: float = 15.0
    dictionary: str = "DICT_4X4_250"
    points_mm: tuple[tuple[float, ...], ...] = ()
    fixed_to: str = WORLD
    size_u_percent: float | None = None
    position_mm: tuple[float, ...] | None = None
    rotation_deg: tuple[float, ...] | None = None

    def __post_init__(self) -> None:
        checked_name("board", self.name)
        if self.kind == "points":
            for each in self.points_mm:
                _refuse_count("points_mm", each, 3)
        elif self.columns < 1 or self.rows < 1:
            raise LabError(f"columns, rows are {self.columns}, {self.rows}; give whole numbers above 0")
        if len(self) < _LEAST_CORNERS:
            raise LabError(f"board {self.name} has {len(self)} corners; its pose needs at least {_LEAST_CORNERS}")
        CORNERS(f"board {self.name}", len(self))
        for key in ("square_mm", "tag_mm", "marker_mm"):
            if not 0 < getattr(self, key) <= MM.of(LENGTH_M.most):
                raise LabError(f"{key} is {getattr(self, key):g}; give a length above 0")
        if not 0 <= self.gap_mm <= MM.of(LENGTH_M.most):
            raise LabError(f"gap_mm is {self.gap_mm:g}; give a distance from 0")
        checked_size_u("size_u_percent", self.size_u_percent, PRINTED)
        _placed("board", self.position_mm, self.rotation_deg)
        spread = np.linalg.svd(self.corners - self.corners.mean(axis=0), compute_uv=False)
        if spread[1] < 1e-9 * max(spread[0], 1e-300):
            raise LabError(f"board {self.name}: its corners lie on a line; give more columns or rows")

    def __len__(self) -> int:
        if self.kind == "points":
            return len(self.points_mm)
        return self.columns * self.rows * (4 if self.kind == "apriltag" else 1)

    @property
    def size_u(self) -> float:
        """Standard uncertainty of its size, as a share."""
        return checked_size_u("size_u_percent", self.size_u_percent, PRINTED)

    @cached_property
    def corners(self) -> Array:
        """Places ``(c, 3)`` m in the board's frame: x along a row, y along a column, z away from the viewer."""
        if self.kind == "points":
            return np.asarray(MM.to_si(np.array(self.points_mm, dtype=np.float64)))
        pitch = self.tag_mm + self.gap_mm if self.kind == "apriltag" else self.square_mm
        down, along = np.divmod(np.arange(self.columns * self.rows), self.columns)
        grid = pitch * np.column_stack([along, down, np.zeros_like(along)])
        if self.kind == "apriltag":
            around = self.tag_mm * np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])
            grid = (grid[:, None] + around).reshape(-1, 3)
        return np.asarray(MM.to_si(grid.astype(np.float64)))

    @property
    def T_mount(self) -> Array | None:
        """Nominal pose ``(4, 4)`` (m) in what it is fixed to; None where not given."""
        return _pose(self.position_mm, self.rotation_deg)


@dataclass(frozen=True)
class Rig:
    """Cameras and boards that may see each other.

    Attributes:
        simulated: camera and scene of a simulation.
        source: path of the file, "" without one.
    """

    cameras: tuple[Camera, ...]
    boards: tuple[Board, ...]
    simulated: Simulated = field(default_factory=Simulated)
    source: str = ""

    def __post_init__(self) -> None:
        for what, parts in (("cameras", self.cameras), ("boards", self.boards)):
            names = [part.name for part in parts]
            if not names:
                raise LabError(f"no {what}: give at least one")
            if twice := next((name for name in names if names.count(name) > 1), None):
                raise LabError(f"two {what} are called '{twice}'; give each its own name")
            FIXTURES(what, names)

    def of_size(self, percent: float | None) -> "Rig":
        """Return the rig with a standard uncertainty of the size of boards that state none."""
        boards = [
            replace(each, size_u_percent=percent) if each.size_u_percent is None else each for each in self.boards
        ]
        return replace(self, boards=tuple(boards))

    @property
    def corners_each(self) -> int:
        """Largest number of corners of a board, by which the numbers of all corners count."""
        return max(map(len, self.boards))

    def number(self, camera: int, board: int, corner: int) -> int:
        """Return the number of a corner as a camera sees it, among all."""
        return (camera * len(self.boards) + board) * self.corners_each + corner

    def parts(self, numbers: NDArray[np.int_]) -> tuple[NDArray[np.int_], NDArray[np.int_], NDArray[np.int_]]:
        """Return camera, board and corner ``(n,)`` of ``number``."""
        pair, corner = np.divmod(numbers, self.corners_each)
        camera, board = np.divmod(pair, len(self.boards))
        return camera, board, corner

    def mount(self, part: "Camera | Board", targets: tuple[str, ...]) -> int | None:
        """Return the index of the target whose tip carries a camera or board; None in the world.

        Raises:
            LabError: it is fixed to something that the arm does not have.
        """
        if part.fixed_to == WORLD:
            return None
        kind = "camera" if isinstance(part, Camera) else "board"
        if part.fixed_to == HAND:
            if len(first := first_of_tips(targets)) > 1:
                raise LabError(
                    f"{self.source or 'cameras'}: {kind} {part.name} is fixed to {HAND}, and the arm has several tips; "
                    f"name a target of one: {', '.join(targets[i] for i in first)}"
                )
            return 0
        if part.fixed_to in targets:
            return targets.index(part.fixed_to)
        raise LabError(
            f"{self.source or 'cameras'}: {kind} {part.name} is fixed to '{part.fixed_to}'; give {WORLD}, {HAND}, or a "
            f"target: {', '.join(targets)}"
        )

    @property
    def pairs(self) -> list[tuple[int, int]]:
        """Indices of each camera and each board that move against each other: not both in the world, or on one tip."""
        return [
            (i, j)
            for i, camera in enumerate(self.cameras)
            for j, board in enumerate(self.boards)
            if _carrier(camera) != _carrier(board)
        ]

    @property
    def targets(self) -> tuple[str, ...]:
        """Targets of the tips that carry cameras and boards: those that are named, ``p1`` of a hand or without any."""
        parts: tuple[Camera | Board, ...] = (*self.cameras, *self.boards)
        carriers = dict.fromkeys(part.fixed_to for part in parts if part.fixed_to != WORLD)
        named = [name for name in carriers if name != HAND]
        return tuple(dict.fromkeys((*(("p1",) if HAND in carriers or not named else ()), *named)))


def _carrier(part: Camera | Board) -> str | None:
    """Return the tip that carries a camera or board, "" of an arm that has one; None in the world."""
    return None if part.fixed_to == WORLD else "" if part.fixed_to == HAND else tip_of(part.fixed_to)


def usual_rig(in_hand: bool = True) -> Rig:
    """Return a camera of 1280 by 960 pixels and a board of 9 by 6 corners, one of them in the hand."""
    camera, board = (HAND, WORLD) if in_hand else (WORLD, HAND)
    return Rig((Camera(fixed_to=camera),), (Board(fixed_to=board),))


def read_rig(path: Path) -> Rig:
    """Read cameras and boards: ``[[camera]]``, ``[[board]]``, and optionally ``[simulated]``.

    Raises:
        LabError: the file cannot be read, or a value makes no sense; the message says where.
    """
    content = read_toml(path)
    if unknown := sorted(set(content) - {"camera", "board", "simulated"}):
        raise LabError(f"{path}: {unknown[0]}: unknown; there are camera, board and simulated")
    cameras = tuple(structured(where, Camera, each) for where, each in _tables(path, content, "camera"))
    boards = tuple(structured(where, Board, each) for where, each in _tables(path, content, "board"))
    simulated = structured(f"{path}: [simulated]", Simulated, content.get("simulated", {}))
    try:
        return Rig(cameras, boards, simulated, str(path))
    except LabError as error:
        raise LabError(f"{path}: {error}") from error


def _tables(path: Path, content: Mapping[str, Any], kind: str) -> list[tuple[str, Any]]:
    given = content.get(kind, [])
    if not isinstance(given, list):
        raise LabError(f"{path}: {kind} is to be a list of tables; write [[{kind}]]")
    return [(f"{path}: [[{kind}]] {i + 1}", each) for i, each in enumerate(given)]


def _refuse_count(key: str, values: tuple[float, ...], count: int) -> None:
    if len(values) != count:
        raise LabError(f"{key} has {len(values)} numbers; give {count}")


def _placed(what: str, position: tuple[float, ...] | None, rotation: tuple[float, ...] | None) -> None:
    if (position is None) != (rotation is None):
        raise LabError(f"{what}: position_mm and rotation_deg place it together; give both, or neither")
    for key, values in (("position_mm", position), ("rotation_deg", rotation)):
        if values is not None:
            _refuse_count(key, values, 3)
            if not all(abs(value) <= MM.of(LENGTH_M.most) for value in values):
                raise LabError(f"{key}: give numbers of at most {MM.of(LENGTH_M.most):g}")


def _pose(position: tuple[float, ...] | None, rotation: tuple[float, ...] | None) -> Array | None:
    if position is None or rotation is None:
        return None
    return se3.pose(se3.exp(np.deg2rad(np.array(rotation))), MM.to_si(np.array(position)))
