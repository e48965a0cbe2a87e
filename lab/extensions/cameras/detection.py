"""Find the corners of boards in pictures by OpenCV (the extra ``camera``)."""

from pathlib import Path
from typing import Any

import numpy as np

from lab.core.errors import LabError
from lab.core.extras import optional
from lab.core.se3 import Array
from lab.extensions.cameras.rig import Board

__all__ = ["TAGS", "charuco_pattern", "detected", "picture_of"]

_LEAST_CORNERS = 4
TAGS = "DICT_APRILTAG_36h11"
_WINDOW = 3  # pixels, half of the window in which a tag's corner is settled


def _opencv() -> Any:
    """Return OpenCV.

    Raises:
        LabError: it is not installed.
    """
    return optional("cv2", "finding corners in pictures (without columns u_px and v_px)")


def picture_of(path: Path) -> np.ndarray:
    """Read a grey picture ``(height, width)`` of 8 bits.

    Raises:
        LabError: there is none, or OpenCV cannot read it or is not installed.
    """
    cv2 = _opencv()
    if not path.is_file():
        raise LabError(f"{path}: is no picture; check the column image")
    picture = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)
    if picture is None:
        raise LabError(f"{path}: cannot be read as a picture; give PNG, JPEG, TIFF or BMP")
    return np.asarray(picture)


def detected(picture: np.ndarray, board: Board) -> tuple[np.ndarray, Array]:
    """Find a board's corners in a grey picture.

    Returns:
        Numbers ``(c,)`` of the corners that were found, and their places ``(c, 2)`` in pixels; none if the board is not
        in the picture.

    Raises:
        LabError: the board has no pattern that can be found, or looks the same turned by half a turn.
    """
    if board.kind == "points":
        raise LabError(f"board {board.name} of points has no pattern to be found: give u_px and v_px")
    cv2 = _opencv()
    if board.kind == "checkerboard":
        return _checkerboard(cv2, picture, board)
    if board.kind == "charuco":
        places, numbers, _, _ = cv2.aruco.CharucoDetector(charuco_pattern(cv2, board)).detectBoard(picture)
        return _found(numbers, places)
    return _tags(cv2, picture, board)


def _checkerboard(cv2: Any, picture: np.ndarray, board: Board) -> tuple[np.ndarray, Array]:
    """Find inner corners; of the two orders, the one whose first square is black."""
    if (board.columns + board.rows) % 2 == 0:
        raise LabError(
            f"board {board.name}: a checkerboard of {board.columns} by {board.rows} corners looks the same turned by "
            "half: take one with an odd and an even number of them, or a ChArUco board"
        )
    done, places = cv2.findChessboardCornersSB(picture, (board.columns, board.rows), None, cv2.CALIB_CB_ACCURACY)
    if not done:
        return _found(None, None)
    grid = np.asarray(places, dtype=np.float64).reshape(board.rows, board.columns, 2)
    first = _level(picture, grid[0, 0], grid[0, 1], grid[1, 0])
    last = _level(picture, grid[-1, -1], grid[-1, -2], grid[-2, -1])
    if first > last:
        grid = grid[::-1, ::-1]
    return np.arange(board.columns * board.rows), grid.reshape(-1, 2)


def _level(picture: np.ndarray, corner: Array, along: Array, down: Array) -> float:
    """Return the grey level in the middle of the square that is diagonally outside of a corner."""
    middle = corner - 0.5 * (along - corner) - 0.5 * (down - corner)
    u, v = np.clip(np.round(middle), 0, np.array(picture.shape[::-1]) - 1).astype(np.int_)
    return float(picture[max(v - 1, 0) : v + 2, max(u - 1, 0) : u + 2].mean())


def _tags(cv2: Any, picture: np.ndarray, board: Board) -> tuple[np.ndarray, Array]:
    parameters = cv2.aruco.DetectorParameters()
    parameters.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_SUBPIX
    parameters.cornerRefinementWinSize = _WINDOW
    dictionary = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, TAGS))
    corners, numbers, _ = cv2.aruco.ArucoDetector(dictionary, parameters).detectMarkers(picture)
    if numbers is None:
        return _found(None, None)
    found = [
        (4 * int(tag) + i, place)
        for tag, four in zip(np.ravel(numbers), corners, strict=True)
        if tag < board.columns * board.rows
        for i, place in enumerate(np.reshape(four, (4, 2)))
    ]
    return _found([number for number, _ in found], [place for _, place in found])


def _found(numbers: Any, places: Any) -> tuple[np.ndarray, Array]:
    if numbers is None or len(numbers) < _LEAST_CORNERS:
        return np.empty(0, dtype=np.int_), np.empty((0, 2))
    return np.ravel(numbers).astype(np.int_), np.asarray(places, dtype=np.float64).reshape(-1, 2)


def charuco_pattern(cv2: Any, board: Board) -> Any:
    """Return OpenCV's board.

    Raises:
        LabError: there is no such dictionary, or a marker does not fit into a square.
    """
    if not board.dictionary.startswith("DICT_") or not hasattr(cv2.aruco, board.dictionary):
        raise LabError(f"board {board.name}: dictionary '{board.dictionary}' is unknown; give one like DICT_4X4_250")
    if board.marker_mm >= board.square_mm:
        raise LabError(f"board {board.name}: marker_mm is to be less than square_mm")
    dictionary = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, board.dictionary))
    size = (board.columns + 1, board.rows + 1)
    return cv2.aruco.CharucoBoard(size, board.square_mm, board.marker_mm, dictionary)
