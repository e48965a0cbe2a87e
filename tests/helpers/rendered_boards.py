"""Render pictures of boards in software: rays through parts of each pixel, with blur and noise."""

import numpy as np
import pytest
import scipy  # its filters are loaded at their first use

from lab.core import se3
from lab.core.se3 import Array
from lab.core.units import MM
from lab.extensions.cameras.detection import TAGS, charuco_pattern
from lab.extensions.cameras.geometry import sight_lines
from lab.extensions.cameras.rig import PX, Board, Camera

__all__ = ["rendered"]

_WHITE, _BLACK, _ROOM = 230.0, 25.0, 120.0  # grey levels of paper, ink and what is around
_PARTS = 4  # of a pixel, along each side
_PER_SQUARE = 40  # pixels of a pattern's picture
_BLUR_PX, _NOISE_GREY = 0.7, 2.0


def rendered(camera: Camera, board: Board, T_camera_board: Array, rng: np.random.Generator) -> np.ndarray:
    """Return a grey picture ``(height, width)``, of 8 bits, of a board at a pose in the camera, with noise."""
    grey, cell_m, corner = _pattern(board)
    width, height = (int(each) for each in camera.size_px)
    v, u = np.mgrid[:height, :width]
    T, parts = se3.inverse(T_camera_board), (np.arange(_PARTS) + 0.5) / _PARTS - 0.5
    places = PX.to_si(np.column_stack([u.ravel(), v.ravel()]).astype(np.float64))
    flat, picture = sight_lines(places, camera.intrinsic_values).reshape(height, width, 2), np.zeros((height, width))
    by_v, by_u = np.gradient(flat, axis=(0, 1))
    for du in parts:
        for dv in parts:
            rays = (flat + du * by_u + dv * by_v).reshape(-1, 2)
            directions = np.column_stack([rays, np.ones(u.size)]) @ T[:3, :3].T
            points = T[:2, 3] - T[2, 3] / directions[:, 2:] * directions[:, :2]  # in the plane of the board
            column, row = np.floor((points - np.array(corner)).T / cell_m).astype(np.int_)
            inside = (column >= 0) & (column < grey.shape[1]) & (row >= 0) & (row < grey.shape[0])
            seen = np.full(u.size, _ROOM)
            seen[inside] = grey[row[inside], column[inside]]
            picture += seen.reshape(picture.shape) / _PARTS**2
    picture = scipy.ndimage.gaussian_filter(picture, _BLUR_PX) + _NOISE_GREY * rng.standard_normal(picture.shape)
    return np.clip(np.round(picture), 0, 255).astype(np.uint8)


def _pattern(board: Board) -> tuple[Array, float, tuple[float, float]]:
    """Return the grey levels of a board's printed cells, the size of a cell (m), and the first one's corner."""
    if board.kind == "checkerboard":
        down, along = np.mgrid[-2 : board.rows + 2, -2 : board.columns + 2]
        inside = (down >= -1) & (down < board.rows) & (along >= -1) & (along < board.columns)
        side = float(MM.to_si(board.square_mm))
        return np.where(inside & ((down + along) % 2 == 0), _BLACK, _WHITE), side, (-2 * side, -2 * side)
    picture, cell_m, corner = _printed(board, _PER_SQUARE)
    return np.where(picture > 127, _WHITE, _BLACK), cell_m, corner


def _printed(board: Board, per_square: int) -> tuple[np.ndarray, float, tuple[float, float]]:
    """Return the pattern of a ChArUco board or of tags, as it is printed.

    Args:
        per_square: pixels of a square, or of a tag and its gap.

    Returns:
        Grey levels ``(h, w)``, the side of their pixels (m), and where the first one begins (m) on the board.
    """
    cv2 = pytest.importorskip("cv2")
    if board.kind == "charuco":
        size = (per_square * (board.columns + 1), per_square * (board.rows + 1))
        picture = np.pad(np.asarray(charuco_pattern(cv2, board).generateImage(size)), per_square, constant_values=255)
        side = float(MM.to_si(board.square_mm))
        return picture, side / per_square, (-2 * side, -2 * side)
    dictionary = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, TAGS))
    pixel_mm = board.tag_mm / (10 * max(per_square // 10, 1))
    side, gap = round(board.tag_mm / pixel_mm), round(board.gap_mm / pixel_mm)
    edge = max(gap, side // 4)
    across, down = (edge * 2 + count * side + (count - 1) * gap for count in (board.columns, board.rows))
    picture = np.full((down, across), 255, dtype=np.uint8)
    for tag in range(board.columns * board.rows):
        row, column = divmod(tag, board.columns)
        y, x = (edge + i * (side + gap) for i in (row, column))
        picture[y : y + side, x : x + side] = cv2.aruco.generateImageMarker(dictionary, tag, side)
    start = float(MM.to_si(-edge * pixel_mm))
    return picture, float(MM.to_si(pixel_mm)), (start, start)
