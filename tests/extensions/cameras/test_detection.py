"""Corners in rendered pictures, found by OpenCV where it is installed, and asked for where it is not."""

import sys
from dataclasses import replace
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest
from helpers.rendered_boards import rendered

import lab
from lab.core import se3
from lab.core.errors import LabError
from lab.core.se3 import Array
from lab.extensions.cameras.detection import detected, picture_of
from lab.extensions.cameras.geometry import projected
from lab.extensions.cameras.pixels import PixelSensor
from lab.extensions.cameras.rig import PX, Board, Camera

SMALL = Camera(size_px=(320, 240), focal_px=(300.0, 301.0), centre_px=(161.0, 118.5), distortion=(-0.1, 0, 0, 0, 0))
BOARDS = {
    "checkerboard": Board(columns=7, rows=4, square_mm=24.0),
    "charuco": Board(kind="charuco", columns=6, rows=4, square_mm=26.0, marker_mm=20.0),
    "apriltag": Board(kind="apriltag", columns=3, rows=2, tag_mm=44.0, gap_mm=14.0),
}
needs_opencv = pytest.mark.skipif(find_spec("cv2") is None, reason="OpenCV is not installed")


def before(board: Board, rng: np.random.Generator) -> Array:
    """A pose of a board in the middle of the picture, a little turned."""
    T = se3.pose(se3.exp(0.25 * rng.standard_normal(3)), np.array([0.0, 0.0, 0.32]))
    T[:3, 3] -= T[:3, :3] @ board.corners.mean(axis=0)
    return T


@needs_opencv
@pytest.mark.parametrize("kind", BOARDS)
def test_corners_are_found_where_they_were_projected(kind: str) -> None:
    board, rng = BOARDS[kind], np.random.default_rng(1)
    T = before(board, rng)
    numbers, places = detected(rendered(SMALL, board, T, rng), board)
    points = board.corners @ T[:3, :3].T + T[:3, 3]
    true = PX.of(projected(points, SMALL.intrinsic_values)[0])
    assert len(numbers) >= 0.8 * len(board)
    assert np.sqrt(((places - true[numbers]) ** 2).mean()) < (0.5 if kind == "apriltag" else 0.25)


@needs_opencv
def test_pictures_beside_a_file_become_corners(tmp_path: Path) -> None:
    import cv2

    board, rng = BOARDS["checkerboard"], np.random.default_rng(2)
    cv2.imwrite(str(tmp_path / "a.png"), rendered(SMALL, board, before(board, rng), rng))
    cv2.imwrite(str(tmp_path / "b.png"), np.full((240, 320), 120, dtype=np.uint8))
    sensor = PixelSensor(replace(PixelSensor().rig, cameras=(SMALL,), boards=(board,)))
    data = lab.simulate("irb120", poses=2, seed=0).measurements
    data = replace(data, other={"image": ("a.png", "b.png")})
    found = sensor.with_files(data, tmp_path)
    assert len(found) == len(board) and set(found.ids) == {f"0:board:{i}" for i in range(len(board))}
    assert any("no board is found in 1 of 2 pictures (b.png)" in text for text in found.warnings)
    with pytest.raises(LabError, match="no board is found in any"):
        sensor.with_files(data[[1]], tmp_path)
    with pytest.raises(LabError, match="is no picture"):
        picture_of(tmp_path / "c.png")


def test_boards_that_cannot_be_found_are_refused_in_words(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    with pytest.raises(LabError, match="no pattern to be found"):
        detected(np.zeros((4, 4)), Board(kind="points", points_mm=((0, 0, 0), (1, 0, 0), (0, 2, 0), (0, 0, 3))))
    if find_spec("cv2") is not None:
        with pytest.raises(LabError, match="looks the same turned"):
            detected(np.zeros((40, 40), dtype=np.uint8), Board(columns=6, rows=4))
    monkeypatch.setitem(sys.modules, "cv2", None)
    with pytest.raises(LabError, match="pip install"):
        picture_of(tmp_path / "a.png")
