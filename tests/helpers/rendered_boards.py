"""Render pictures of boards in software: rays through each pixel, averaged over parts of it, with blur and noise."""

import numpy as np
import scipy  # its filters are loaded at their first use

from lab.core import se3
from lab.core.errors import LabError
from lab.core.se3 import Array
from lab.core.units import MM
from lab.sensors.cameras.geometry import distorted, projected, sight_lines
from lab.sensors.cameras.rig import PX, Board, Camera

__all__ = ["rendered"]

_WHITE, _BLACK, _ROOM = 230.0, 25.0, 120.0  # grey levels of paper, ink and what is around
_EDGE = 20  # points along each side of a pattern
_PARTS = 4  # of a pixel, along each side
_PER_SQUARE = 40  # pixels of a pattern's picture


def rendered(
    camera: Camera,
    board: Board,
    T_camera_board: Array,
    rng: np.random.Generator,
    *,
    blur_px: float = 0.7,
    noise_grey: float = 2.0,
) -> np.ndarray:
    """Return a grey picture ``(height, width)`` of a board, of 8 bits.

    Args:
        T_camera_board: pose ``(4, 4)`` (m) of the board in the camera.
        rng: of the noise.
        blur_px: standard deviation of the lens's blur.
        noise_grey: standard deviation of the grey levels.

    Raises:
        LabError: the board has no printed pattern.
    """
    pattern = _pattern(board)
    width, height = (int(each) for each in camera.size_px)
    picture = np.full((height, width), _ROOM)
    box = _box(camera, pattern, T_camera_board)
    v, u = np.mgrid[box]
    places = PX.to_si(np.column_stack([u.ravel(), v.ravel()]).astype(np.float64))
    flat = sight_lines(places, camera.intrinsic_values)
    _, slope, _ = distorted(flat, np.broadcast_to(camera.intrinsic_values[4:], (len(flat), 5)))
    by_place = np.linalg.inv(slope) / camera.intrinsic_values[:2]
    T = se3.inverse(T_camera_board)
    parts = PX.to_si((np.arange(_PARTS) + 0.5) / _PARTS - 0.5)
    grey = np.zeros(len(flat))
    for du in parts:
        for dv in parts:
            rays = flat + by_place @ np.array([du, dv])
            grey += _seen(pattern, T, rays)
    picture[box] = (grey / _PARTS**2).reshape(v.shape)
    picture = scipy.ndimage.gaussian_filter(picture, blur_px) if blur_px else picture
    picture = picture + noise_grey * rng.standard_normal(picture.shape)
    return np.clip(np.round(picture), 0, 255).astype(np.uint8)


class _Pattern:
    """What is printed: grey levels ``(h, w)`` of cells of a size (m), the first corner at (x, y)."""

    def __init__(self, grey: Array, cell_m: float, corner: tuple[float, float]) -> None:
        self.grey, self.cell_m, self.corner = grey, cell_m, corner

    def at(self, points: Array) -> Array:
        """Return the grey levels at points ``(n, 2)`` m of the board."""
        column, row = np.floor((points - np.array(self.corner)).T / self.cell_m)
        height, width = self.grey.shape
        inside = (column >= 0) & (column < width) & (row >= 0) & (row < height)
        found = np.full(len(points), _ROOM)
        found[inside] = self.grey[row[inside].astype(np.int_), column[inside].astype(np.int_)]
        return found


def _box(camera: Camera, pattern: _Pattern, T_camera_board: Array) -> tuple[slice, slice]:
    """Return the rows and columns of a picture between which the pattern lies; all where it is beside the camera."""
    height, width = pattern.grey.shape
    edge = np.linspace(0.0, 1.0, _EDGE)
    around = [(edge, 0 * edge), (edge, 0 * edge + 1), (0 * edge, edge), (0 * edge + 1, edge)]
    outline = np.concatenate([np.column_stack(each) for each in around]) * [width, height] * pattern.cell_m
    points = np.column_stack([outline + np.array(pattern.corner), np.zeros(len(outline))])
    points = points @ T_camera_board[:3, :3].T + T_camera_board[:3, 3]
    most = np.array(camera.size_px, dtype=np.int_)
    low, high = np.zeros(2, dtype=np.int_), most
    if (points[:, 2] > 0.01).all():
        places = PX.of(projected(points, camera.intrinsic_values)[0])
        low = np.clip(np.floor(places.min(axis=0)) - 2, 0, most - 1).astype(np.int_)
        high = np.clip(np.ceil(places.max(axis=0)) + 3, low + 1, most).astype(np.int_)
    return slice(int(low[1]), int(high[1])), slice(int(low[0]), int(high[0]))


def _seen(pattern: _Pattern, T_board_camera: Array, rays: Array) -> Array:
    """Return what rays ``(n, 2)`` from the camera meet in the board's plane."""
    origin, turn = T_board_camera[:3, 3], T_board_camera[:3, :3]
    directions = rays @ turn[:, :2].T + turn[:, 2]
    far = -origin[2] / np.where(np.abs(directions[:, 2]) < 1e-12, np.nan, directions[:, 2])
    points = origin[:2] + far[:, None] * directions[:, :2]
    met = np.isfinite(points).all(axis=1) & (far > 0)
    found = np.full(len(rays), _ROOM)
    found[met] = pattern.at(points[met])
    return found


def _pattern(board: Board) -> _Pattern:
    if board.kind == "checkerboard":
        down, along = np.mgrid[-2 : board.rows + 2, -2 : board.columns + 2]
        inside = (down >= -1) & (down < board.rows) & (along >= -1) & (along < board.columns)
        grey = np.where(inside & ((down + along) % 2 == 0), _BLACK, _WHITE)
        side = float(MM.to_si(board.square_mm))
        return _Pattern(grey, side, (-2 * side, -2 * side))
    if board.kind == "points":
        raise LabError(f"board {board.name} of points has no printed pattern: take a checkerboard, charuco or apriltag")
    from lab.sensors.cameras.detection import printed

    picture, cell_m, corner = printed(board, _PER_SQUARE)
    return _Pattern(np.where(picture > 127, _WHITE, _BLACK), cell_m, corner)
